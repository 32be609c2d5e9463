"""Kinematics: the Seth–Hill strain and its derivatives, shape tensors, exactness under affine maps, local strains."""

import math

import bodies
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from bodies import worst
from hypothesis import given
from hypothesis import strategies as st

from pdjax.models import kinematics as kin

SEEDS = st.integers(0, 2**32 - 1)

# ---------------------------------------------------------------- e_m = (s^{2m} − 1)/2m


def measure_in_m(s, m, order):
    """∂ⁿe_m/∂mⁿ by the power series Σ_k (2m)^k ℓ^{k+1}/(k+1)!, ℓ = log s, in long double."""
    ell, m = np.log(np.longdouble(s)), np.longdouble(m)
    total, term = np.longdouble(0), np.longdouble(0)
    for k in range(order, 120):
        term = (2 * ell) ** k * ell / math.factorial(k + 1) * math.factorial(k) / math.factorial(k - order)
        total += term * m ** (k - order)
    return total


def partial(s, m, in_s, in_m):
    """∂^{a+b}e_m/∂s^a∂m^b: from ∂e/∂s = s^{2m−1} for a > 0, from the series for a = 0."""
    s, m = np.longdouble(s), np.longdouble(m)
    if in_s == 0:
        return measure_in_m(s, m, in_m)
    p, log = 2 * m - 1, np.log(s)
    powers = {  # ∂^{a−1}s^p/∂s^{a−1} as polynomials in p, times s^{p−a+1}; and their derivatives in p
        1: (1, 0, 0),
        2: (p, 1, 0),
        3: (p * (p - 1), 2 * p - 1, 2),
    }[in_s]
    c, dc, ddc = powers
    by_p = (c, dc + c * log, ddc + 2 * dc * log + c * log**2)[in_m]
    return 2**in_m * by_p * s ** (p - in_s + 1)


def _nested(order_s, order_m):
    def measure(s, m):
        return kin.seth_hill(jnp.log(s), m)

    for _ in range(order_s):
        measure = jax.grad(measure, 0)
    for _ in range(order_m):
        measure = jax.grad(measure, 1)
    return measure


ORDERS = [(a, b) for a in range(4) for b in range(4) if a + b <= 3]


@jax.jit
def every_derivative(s, m):
    return jnp.stack([_nested(a, b)(s, m) for a, b in ORDERS])


MS = [0.0, 1e-12, -1e-7, 1e-3, 0.5, 1.0, -0.7, 2.0, -3.0]
SS = [1.0, 1 + 1e-12, 1 - 1e-7, 1.001, 1.3, 0.6, 2.5, 0.3]


def test_seth_hill_strain_and_its_derivatives_to_third_order_equal_the_exact_ones():
    """The points are at, near and far from m = 0 and s = 1, and at |mℓ| = 1, where the two branches meet."""
    ms = [*MS, *(x / np.log(2.5) for x in (1 - 1e-9, 1 + 1e-9, -1 + 1e-9, -1 - 1e-9))]
    s, m = (np.array(x).reshape(-1) for x in np.meshgrid(SS, ms, indexing="ij"))
    found = np.asarray(jax.jit(jax.vmap(every_derivative))(s, m))
    exact = np.array([[partial(a, b, *order) for order in ORDERS] for a, b in zip(s, m, strict=True)])
    # The error is relative to the derivative, or absolute where the derivative is below 1.
    assert worst((found - exact) / np.maximum(np.abs(exact), 1.0)) < 1e-13  # 3e-14
    value, exact = found[:, 0], exact[:, 0].astype(float)
    assert worst(value[exact != 0] / exact[exact != 0], 1.0) < 1e-14  # 7e-16


@pytest.mark.parametrize("m", [0.0, 0.5, 1.0, -0.7])
@pytest.mark.parametrize("size", [1e-12, 1e-8, 1e-3, 0.5])
def test_no_cancellation_at_tiny_strain(m, size):
    """ℓ and e_m of a bond from its displacement equal those in long double to a relative 1e-14."""
    xi, direction = np.array([0.3, -0.7, 0.2]), np.array([0.4, 0.1, -0.8])
    eta = size * direction
    exact_xi, exact_eta = xi.astype(np.longdouble), eta.astype(np.longdouble)
    g = np.sum((2 * exact_xi + exact_eta) * exact_eta) / np.sum(exact_xi**2)
    ell = np.log1p(g) / 2
    found = kin.log_stretch(jnp.asarray(xi), jnp.asarray(eta))
    assert worst(found / float(ell), 1.0) < 1e-14  # 4e-16
    strain = ell if m == 0 else np.expm1(2 * m * ell) / (2 * m)
    assert worst(kin.seth_hill(found, m) / float(strain), 1.0) < 1e-14  # 7e-16


# ---------------------------------------------------------------- shape tensors and Mandel vectors


@given(seed=SEEDS)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_mandel_vectors_keep_the_inner_product(dim, seed):
    A, B = np.random.default_rng(seed).normal(size=(2, dim, dim))
    A, B = A + A.T, B + B.T
    a, b = kin.to_mandel(jnp.asarray(A)), kin.to_mandel(jnp.asarray(B))
    assert a.shape == (dim * (dim + 1) // 2,)
    assert worst(a @ b, np.sum(A * B)) < 1e-13  # 4e-15
    assert worst(kin.from_mandel(a, dim), A) < 1e-14  # 4e-16


def family_bonds(dim, kind, i, seed):
    """The padded bonds of one point under a random displacement, and its true bonds alone."""
    fams = bodies.families(dim, kind)
    every = fams.bonds(jnp.asarray(bodies.displacement(dim, kind, seed)))
    mine = jax.tree.map(lambda x: x[i], every)
    true = np.asarray(fams.weight[i]) > 0
    return mine, jax.tree.map(lambda x: np.asarray(x)[true] if x.ndim else x, mine)


shape_L, shape_K = jax.jit(kin.shape_tensor_L), jax.jit(kin.shape_tensor_K)


@pytest.mark.parametrize("dim, kind", bodies.BODIES)
def test_shape_tensors_of_surface_points(dim, kind):
    """L applied to a tensor A is Σ w (n·An) n⊗n, L⁻¹ gives the dual of the reference module, and K is Σ w ξ⊗ξ."""
    mine, bonds = family_bonds(dim, kind, 0, 1)
    w = bonds.omega * bonds.volume
    n = bonds.xi / np.linalg.norm(bonds.xi, axis=1)[:, None]
    A = bodies.random(dim).normal(size=(dim, dim))
    A = A + A.T
    L, K = np.asarray(shape_L(mine)), np.asarray(shape_K(mine))
    applied = kin.from_mandel(jnp.asarray(L @ np.asarray(kin.to_mandel(jnp.asarray(A)))), dim)
    exact = sum(weight * (d @ A @ d) * np.outer(d, d) for weight, d in zip(w, n, strict=True))
    assert worst(applied, exact) < 1e-14  # 7e-16
    assert worst(K, sum(weight * np.outer(x, x) for weight, x in zip(w, bonds.xi, strict=True))) < 1e-14  # 1e-16
    dual = np.linalg.solve(L, np.asarray(kin.direction_mandel(jnp.asarray(bonds.xi))).T).T
    assert worst(kin.from_mandel(jnp.asarray(dual), dim), ref._dual(bonds.xi, w)) < 1e-10  # 6e-15


# ---------------------------------------------------------------- nonlocal strain


@jax.jit
def gradients(fams, u):
    return jax.vmap(kin.displacement_gradient)(fams.bonds(u))


@jax.jit
def mean_strains(fams, u, m):
    """Ē_m at every point."""
    strains = jax.vmap(lambda bonds: kin.bond_average_strain(bonds, m))(fams.bonds(u))
    return jax.vmap(lambda v: kin.from_mandel(v, fams.dim))(strains)


def affine(dim, kind, H):
    """u = H X."""
    return jnp.asarray(bodies.points(dim, kind).positions @ np.asarray(H).T)


@pytest.mark.parametrize("dim, kind", bodies.BODIES)
@given(seed=SEEDS)
def test_mean_deformation_gradient_is_exact_for_affine_maps_at_every_point(dim, kind, seed):
    H = np.random.default_rng(seed).normal(size=(dim, dim))  # any map, also with det F < 0
    found = gradients(bodies.families(dim, kind), affine(dim, kind, H))
    assert worst(found, np.broadcast_to(H, found.shape)) < 1e-12  # 2e-15


def classical(F, m):
    """E_m(F) by the eigenvectors of C = FᵀF, in NumPy."""
    value, vector = np.linalg.eigh(F.T @ F)
    strain = np.log(value) / 2 if abs(m) < 1e-100 else np.expm1(m * np.log(value)) / (2 * m)
    return vector @ np.diag(strain) @ vector.T


@pytest.mark.parametrize("dim, kind", bodies.BODIES)
@given(seed=SEEDS, stretch=st.floats(0.5, 1.8), m=st.floats(-2, 2))
def test_mean_strain_is_exact_for_similarities_and_for_m_1(dim, kind, seed, stretch, m):
    fams = bodies.families(dim, kind)
    points = len(fams)
    similar = stretch * bodies.rotation(dim, seed)
    exact = np.broadcast_to(classical(similar, m), (points, dim, dim))
    assert worst(mean_strains(fams, affine(dim, kind, similar - np.eye(dim)), m), exact) < 1e-11  # 2e-14
    F = bodies.deformation(dim, seed, size=0.4)
    exact = np.broadcast_to(classical(F, 1.0), (points, dim, dim))
    assert worst(mean_strains(fams, affine(dim, kind, F - np.eye(dim)), 1.0), exact) < 1e-11  # 3e-15


@pytest.mark.parametrize("dim, kind", [body for body in bodies.BODIES if body[0] > 1])
@pytest.mark.parametrize("m", [0.0, -0.7, 0.5, 2.0])
def test_mean_strain_is_otherwise_exact_to_first_order_only(dim, kind, m):
    """The error |Ē_m − E_m| under F = I + εG is not zero and decreases as ε²."""
    fams, G = bodies.families(dim, kind), np.random.default_rng(3).normal(size=(dim, dim))
    defect = []
    for size in (1e-3, 5e-4):
        found = mean_strains(fams, affine(dim, kind, size * G), m)
        defect.append(worst(found, np.broadcast_to(classical(np.eye(dim) + size * G, m), found.shape)))
    assert defect[1] > 1e-9
    assert abs(np.log2(defect[0] / defect[1]) - 2) < 0.01  # 3e-3


# ---------------------------------------------------------------- the classical strain E_m(F)

local = jax.jit(kin.local_strain)


@pytest.mark.parametrize("dim", [1, 2, 3])
@given(seed=SEEDS, m=st.floats(-2, 2))
def test_local_strain_equals_the_one_by_eigenvectors(dim, seed, m):
    """The principal stretches differ by a factor of up to 5."""
    stretch = np.random.default_rng(seed).uniform(np.sqrt(0.2), np.sqrt(5.0), dim)
    F = bodies.rotation(dim, seed + 1) @ np.diag(stretch) @ bodies.rotation(dim, seed)
    exact = classical(F, m)
    assert worst(local(F, m) / np.linalg.norm(exact), exact / np.linalg.norm(exact)) < 1e-12  # 3e-15


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("m", [0.0, 1.0, -0.7])
def test_local_strain_of_equal_and_tiny_stretches(dim, m):
    for stretch in (1.0, 0.7, 1.6):
        exact = np.log(stretch) if m == 0 else (stretch ** (2 * m) - 1) / (2 * m)
        assert worst(local(stretch * jnp.eye(dim), m), exact * np.eye(dim)) < 1e-14  # 6e-16
    G = bodies.random(dim).normal(size=(dim, dim))
    tiny = np.asarray(local(jnp.eye(dim) + 1e-9 * G, m))
    F_minus_I = (np.eye(dim) + 1e-9 * G) - np.eye(dim)
    assert worst(tiny / 1e-9, (F_minus_I + F_minus_I.T) / 2e-9) < 1e-7  # 3e-9


def local_gradient(F, m, G):
    """∂(E_m:G)/∂F."""
    return jax.grad(lambda X: jnp.sum(kin.local_strain(X, m) * G))(F)


@pytest.mark.parametrize("dim, order", [(2, 2), (3, 1)])
def test_local_strain_is_twice_differentiable_at_equal_stretches(dim, order):
    """At F = cI the derivative along G is c^{2m−1} sym G, and the Hessian is the derivative of the gradient."""
    c, step = 1.3, 1e-5
    here, G = c * jnp.eye(dim), jnp.asarray(bodies.random(dim).normal(size=(dim, dim)))
    gradient, hessian = jax.jit(local_gradient), jax.jit(jax.jacfwd(local_gradient))
    for m in (0.0, 1.0, -0.7):
        symmetric = (np.asarray(G) + np.asarray(G).T) / 2
        assert worst(gradient(here, m, G), c ** (2 * m - 1) * symmetric) < 1e-13  # 4e-16
        for index in ((0, 0), (0, 1), (1, 0), (1, 1)) if order == 2 else ():
            up, down = (gradient(here.at[index].add(h), m, G) for h in (step, -step))
            assert worst((up - down) / (2 * step), hessian(here, m, G)[..., *index]) < 1e-8  # 9e-11


def test_log1p_keeps_its_derivative_in_the_reverse_derivative_of_a_loop():
    """JAX drops the derivative that `log1p` defines there. That of its formulas must be the same."""
    u, v = jnp.asarray([0.1, 0.6, 3.0, 40.0, -0.7]), jnp.asarray([1.0, -0.5, 2.0, 0.3, 1.0])

    def f(u):
        return jnp.sum(jax.lax.scan(lambda t, k: (t + kin.log1p(k * u), None), 0 * u, jnp.asarray([0.5, 1.0]))[0] ** 2)

    by_forward = jax.jvp(jax.grad(f), (u,), (v,))[1]
    logs, slopes = (
        sum(g(k, u) for k in (0.5, 1.0)) for g in (lambda k, u: jnp.log1p(k * u), lambda k, u: k / (1 + k * u))
    )
    curve = -sum((k / (1 + k * u)) ** 2 for k in (0.5, 1.0))
    exact = 2 * (slopes**2 + logs * curve) * v
    assert worst(by_forward, exact) < 1e-13 * worst(exact)  # measured: 1e-16
