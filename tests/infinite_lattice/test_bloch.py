"""Tests of the symbol against sums over patches, periodic bodies, the NumPy reference and the energy of affine maps.

`Peer` is an independent NumPy implementation of the symbol and of its quotient. The tests of the zone and of the
criteria import it. The comment beside a tolerance is the largest measured error (float64).
"""

import itertools
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from hypothesis import given
from hypothesis import strategies as st
from table import KINDS, LINEAR, MODELS, EnergyOnly

import pdjax as pd

LAM, MU = 1.3, 0.7  # those of table.LINEAR
FAMILY = {1: (3, pd.cubic_spline_influence), 2: (2, pd.gaussian_influence), 3: (1.5, pd.constant_influence)}
PEER_INFLUENCE = {1: lambda r, d: np.where(2 * r <= d, 1 - 6 * (r / d) ** 2 + 6 * (r / d) ** 3, 2 * (1 - r / d) ** 3)}
PEER_INFLUENCE[2] = lambda r, d: np.exp(-4 * (r / d) ** 2)
PEER_INFLUENCE[3] = None

compiled, center_block = eqx.filter_jit(pd.symbol), eqx.filter_jit(pd.center_block)


def symbol(model, fam, F, k):
    """`pd.symbol` at k (waves, dim), four waves in each call, so that each class of model compiles once."""
    parts = np.array_split(k, range(4, len(k), 4))
    padded = [np.concatenate([part, part[:1].repeat(4 - len(part), axis=0)]) for part in parts]
    return np.concatenate([compiled(model, fam, F, part) for part in padded])[: len(k)]


# ---------------------------------------------------------------- peers in NumPy


def seth_hill_state(dim, N, m, lam=LAM, mu=MU, omega=None):
    """The function (X, u) → neighbours of the centre and its T, computed by the reference."""
    return lambda X, u: ref.seth_hill_states(X, np.ones(len(X)), N, u, m, lam, mu, omega, points=[0])[0]


def correspondence_state(dim, N, lam=LAM, mu=MU, omega=None):
    """The same for the original correspondence model with the St. Venant–Kirchhoff law."""
    return lambda X, u: ref.correspondence_states(X, np.ones(len(X)), N, u, lam, mu, omega, points=[0])[0]


class Peer:
    """One lattice family of unit spacing under x = F X, linearised by complex steps of a NumPy force state."""

    def __init__(self, dim, N, F, state):
        X = ref.lattice_ball(dim, N)
        u = X @ (np.asarray(F, dtype=float) - np.eye(dim)).T
        near, self.T = state(X, u)
        self.xi, bonds = X[near], len(near)
        self.Y = self.xi @ np.asarray(F, dtype=float).T
        self.C = np.zeros((bonds, dim, bonds, dim))  # ∂T_bi/∂Y_cj
        for c, j in itertools.product(range(bonds), range(dim)):
            moved = u.astype(complex)
            moved[near[c], j] += 1e-30j
            self.C[:, :, c, j] = np.imag(state(X, moved)[1]) / 1e-30
        stretched = np.zeros_like(X, dtype=complex)
        stretched[:, 0] = 1e-30j * X[:, 0]
        self.M = np.sum(np.imag(state(X, stretched)[1])[:, 0] / 1e-30 * self.xi[:, 0])
        self.mirror = np.array([int(np.argmin(np.abs(self.xi + x).sum(axis=1))) for x in self.xi])

    def symbol(self, k):
        """Σ_ξ [δT(ξ) − e^{ik·ξ} δT(−ξ)], δY = e (e^{ik·ξ} − 1), for k (waves, dim)."""
        phase = np.exp(1j * np.atleast_2d(k) @ self.xi.T)
        dT = np.einsum("bicj,kc->kbij", self.C, phase - 1, optimize=True)
        J = np.sum(dT - phase[:, :, None, None] * dT[:, self.mirror], axis=1)
        assert np.max(np.abs(J.imag)) < 1e-12 * np.abs(self.C).max() * len(self.xi)  # 2e-16: real by parity
        return J.real

    def top(self, k):
        """λ_max of the symbol."""
        J = self.symbol(k)
        return np.linalg.eigvalsh((J + J.swapaxes(1, 2)) / 2)[:, -1]

    def quotient(self, k):
        """λ_max/(M κ²), κ² = Σ (2 sin(k_i/2))²."""
        return self.top(k) / (self.M * np.sum((2 * np.sin(np.atleast_2d(k) / 2)) ** 2, axis=1))

    def long_wave(self, direction):
        """The limit k → 0 of the quotient, from the acoustic tensor of P(F) = Σ T⊗ξ, contracted from C."""
        n = np.atleast_2d(direction) / np.linalg.norm(np.atleast_2d(direction), axis=1, keepdims=True)
        x = n @ self.xi.T
        acoustic = np.einsum("kb,bicj,kc->kij", x, self.C, x, optimize=True)
        return -np.linalg.eigvalsh((acoustic + acoustic.swapaxes(1, 2)) / 2)[:, 0] / self.M

    def supremum(self, value, intervals, kept=24):
        """(max, k) of `quotient` or `top` over the zone, on a fine grid and then on finer stencils around its best
        points."""
        dim = self.xi.shape[1]
        axis = np.pi * np.arange(-intervals, intervals + 1) / intervals
        k = np.stack(np.meshgrid(axis[intervals:], *[axis] * (dim - 1), indexing="ij"), axis=-1).reshape(-1, dim)
        k = k[(k != 0).any(axis=1)]
        best = k[np.argsort(-value(k))[:kept]]
        return climb(value, best, np.pi / intervals)

    def long_wave_supremum(self):
        """(max, direction) of `long_wave`."""
        dim = self.xi.shape[1]
        n = np.concatenate([np.eye(dim), random(dim).normal(size=(400, dim))])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        return climb(self.long_wave, n[np.argsort(-self.long_wave(n))[:8]], 0.1)


def climb(value, x, step):
    """Move every point of x (points, dim) to the best of the 3^dim around it, halving the step down to 1e-9."""
    stencil = np.array(list(itertools.product((-1, 0, 1), repeat=x.shape[1])))
    while step > 1e-9:
        near = x[:, None, :] + step * stencil
        near = np.where(np.abs(near).sum(axis=2, keepdims=True) < 1e-3, x[:, None, :], near)  # 0/0 at k = 0
        values = value(near.reshape(-1, x.shape[1])).reshape(len(x), -1)
        x = near[np.arange(len(x)), np.argmax(values, axis=1)]
        step *= 0.6
    values = value(x)
    return float(np.max(values)), x[np.argmax(values)]


def random(*key):
    return np.random.default_rng([11, *key])


def gradient(dim, size, *key):
    return np.eye(dim) + size * random(dim, *key).normal(size=(dim, dim))


def waves(dim, *key, count=4):
    return random(dim, 1, *key).uniform(-np.pi, np.pi, (count, dim))


def difference(a, b):
    """The largest difference, relative to the largest entry of b."""
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b))) / np.max(np.abs(np.asarray(b))))


# ---------------------------------------------------------------- the sum over a patch


class FarState(pd.PointStateModel):
    """T = ω (¾ Z_here + ¼ Z_there) ξ with the correspondence states of both ends of the bond."""

    base: pd.Correspondence
    hyperelastic = False
    needs_other_end = True

    def point_state(self, bonds):
        return self.base.point_state(bonds)

    def bond_force(self, here, there, bond):
        return bond.omega * ((0.75 * here + 0.25 * there) @ bond.xi)


ALL = {**KINDS, "far state": FarState(pd.Correspondence(LINEAR))}


def patch_body(dim, rings):
    """A box that reaches `rings` horizons from its centre: families, positions relative to the centre, its index."""
    N, influence = FAMILY[dim]
    body = pd.lattice((2 * int(max(rings, 2) * N) + 1,) * dim)
    centre = len(body) // 2
    return pd.families(body, float(N), influence), body.positions - body.positions[centre], centre


@eqx.filter_jit
def patch_blocks(model, fams, X, centre, F):
    """J⟨η⟩ = ∂f(X)/∂u(X + η) at the centre of the patch, by autodiff of its force density at u = (F − I) X."""
    mode = jax.jacfwd if X.shape[1] < 3 else jax.jacrev  # In 3D, 1029 columns for 343 points would take gigabytes.
    u = X @ (F - jnp.eye(X.shape[1])).T
    return mode(lambda v: pd.force_density(model, fams, v)[centre])(u)


CASES = [(name, 2 if model.rings < 3 else 1) for name, model in ALL.items()] + [
    (name, 1) for name in ("seth_hill m=-0.7", "correspondence svk", "far state")
]
CASES += [("seth_hill m=0", 3), ("correspondence neo-hookean", 3)]


@pytest.mark.parametrize(("name", "dim"), CASES)
def test_symbol_is_the_sum_over_a_patch(name, dim):
    """Ĵ(k) = Σ_η J⟨η⟩ e^{ik·η}, with J⟨η⟩ from a finite body, for random F and k and three influence functions."""
    model, (N, influence), (fams, X, centre) = ALL[name], FAMILY[dim], patch_body(dim, ALL[name].rings)
    F, k = gradient(dim, 0.12, 2), waves(dim, 2)
    blocks = np.moveaxis(patch_blocks(model, fams, X, centre, F), 0, 1)
    direct = np.einsum("kn,nij->kij", np.exp(1j * k @ X.T), blocks)
    fam = pd.lattice_family(dim, N, influence=influence)
    assert difference(symbol(model, fam, F, k), direct) < 1e-12  # 7e-16


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 2), (3, 1.5)])
@pytest.mark.parametrize("m", [0.0, 1.0, -0.7, None])
def test_symbol_is_that_of_the_reference(dim, N, m):
    """The reference sums a patch of complex steps in NumPy. m = None is the original correspondence model."""
    model = pd.Correspondence(LINEAR) if m is None else pd.SethHill(m, LINEAR)
    omega = PEER_INFLUENCE[dim]
    F, k = gradient(dim, 0.12, 3), waves(dim, 3)

    def force(X, u):
        if m is None:
            return ref.correspondence_force(X, np.ones(len(X)), N, u, LAM, MU, omega, rows=[0])
        return ref.seth_hill_force(X, np.ones(len(X)), N, u, m, LAM, MU, omega, rows=[0])

    row = ref.patch_row(dim, N, force, F)
    direct = np.array([ref.symbol_of_row(row, one) for one in k])
    fam = pd.lattice_family(dim, N, influence=FAMILY[dim][1])
    assert difference(symbol(model, fam, F, k), direct) < 1e-12  # 2e-15
    state = correspondence_state(dim, N, omega=omega) if m is None else seth_hill_state(dim, N, m, omega=omega)
    peer = Peer(dim, N, F, state)
    assert difference(peer.symbol(k), direct) < 1e-12  # 2e-15: the peers of the other tests


# ---------------------------------------------------------------- the spectrum of a periodic body


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("seth_hill m=-0.7", (9, 7)),
        ("correspondence neo-hookean", (9, 7)),
        ("seth_hill m=-0.7", (11,)),
        ("seth_hill m=1, energy only", (11,)),
    ],
)
def test_periodic_body_has_the_symbols_spectrum(name, shape):
    """The eigenvalues of the dense Jacobian under F are those of Ĵ at the allowed k = 2π n/(h shape)."""
    dim, h, model = len(shape), 0.5, MODELS[name]
    N = FAMILY[dim][0]
    F = gradient(dim, 0.1, 4)
    fams = pd.families(pd.lattice(shape, h, periodic=True), N * h, pd.gaussian_influence)
    dense = np.asarray(pd.jacobian(model, fams, np.zeros((len(fams), dim)), form="dense", F=F))
    k = 2 * np.pi / h * np.array([np.array(n) / shape for n in np.ndindex(*shape)])
    J = np.asarray(symbol(model, pd.lattice_family(dim, N, h, pd.gaussian_influence), F, k))
    expected = np.sort(np.linalg.eigvalsh(J).reshape(-1))
    assert difference(np.linalg.eigvalsh((dense + dense.T) / 2), expected) < 1e-12  # 2e-15
    # The Jacobian maps a plane wave to a plane wave.
    positions = pd.lattice(shape, h).positions
    e = random(5).normal(size=dim)
    wave = np.exp(1j * positions @ k[5])[:, None] * e
    image = np.exp(1j * positions @ k[5])[:, None] * (J[5] @ e)
    assert difference((dense @ wave.reshape(-1)).reshape(wave.shape), image) < 1e-12  # 4e-15


# ---------------------------------------------------------------- fast path, invariants, transformations


BY_ENERGY = [n for n, m in KINDS.items() if m.hyperelastic and "only" not in n and not isinstance(m, pd.TwoStageModel)]


@pytest.mark.parametrize("name", BY_ENERGY)
def test_fast_path_is_the_general_path(name):
    """The symbol from b, g and r of the point state equals that from V ∂T/∂η of the energy."""
    fam = pd.lattice_family(2, 2, influence=pd.inverse_distance_influence)
    F, k = gradient(2, 0.12, 6), waves(2, 6)
    assert difference(symbol(MODELS[name], fam, F, k), symbol(EnergyOnly(MODELS[name]), fam, F, k)) < 1e-12  # 6e-16


@pytest.mark.parametrize("name", ["seth_hill user law", "correspondence neo-hookean", "seth_hill m=1, energy only"])
@given(seed=st.integers(0, 2**32 - 1))
def test_symbol_is_zero_at_the_zero_wave_vector_symmetric_and_even(name, seed):
    """Ĵ(0) = 0, Ĵ = Ĵᵀ and Ĵ(−k) = Ĵ(k) = Ĵ(k + 2π n/h) for any F and k."""
    rng = np.random.default_rng(seed)
    fam = pd.lattice_family(2, 2, 0.5)
    F, k = np.eye(2) + 0.1 * rng.uniform(-1, 1, (2, 2)), rng.uniform(-6, 6, 2)
    turn = 2 * np.pi / 0.5 * rng.integers(-2, 3, 2)
    J = np.asarray(symbol(MODELS[name], fam, F, np.stack([k, -k, k + turn, 0 * k])))
    size = 4 * (LAM + 2 * MU) / 0.5**2  # M κ² at its largest
    assert np.array_equal(J[3], np.zeros((2, 2)))
    assert np.max(np.abs(J[0] - J[0].T)) < 1e-12 * size  # 1e-15
    assert np.max(np.abs(J[1:3] - J[0])) < 1e-12 * size  # 5e-15


def test_batched_and_vmapped_symbols_equal_a_loop():
    """k has any leading shape, and vmap runs over F, m, a constant of the law and k."""
    fam, k = pd.lattice_family(2, 2), waves(2, 7)
    F = np.stack([gradient(2, 0.1, 7, i) for i in range(3)])
    ms, lams = jnp.array([-0.4, 0.0, 1.2]), jnp.array([0.1, 1.0, 3.0])

    def one(m, lam, F, k):
        return pd.symbol(pd.SethHill(m, pd.LinearElastic(lam, jnp.array(1.0))), fam, F, k)

    batched = jax.vmap(jax.vmap(one, (None, None, None, 0)), (0, 0, 0, None))
    mapped = jax.jit(batched)(ms, lams, F, k.reshape(2, 2, 2))
    loop = np.array(
        [
            symbol(pd.SethHill(m, pd.LinearElastic(lam, jnp.array(1.0))), fam, G, k)
            for m, lam, G in zip(ms, lams, F, strict=True)
        ]
    )
    assert mapped.shape == (3, 2, 2, 2, 2)
    assert difference(np.reshape(mapped, loop.shape), loop) < 1e-13  # 2e-16


def test_spacing_scales_the_symbol():
    """Ĵ(k/h) h² does not depend on the spacing h."""
    F, k, model = gradient(2, 0.1, 8), waves(2, 8), MODELS["seth_hill m=0"]
    one = symbol(model, pd.lattice_family(2, 2, 1.0, pd.gaussian_influence), F, k)
    fine = symbol(model, pd.lattice_family(2, 2, 1e-3, pd.gaussian_influence), F, k * 1e3)
    assert difference(fine * 1e-6, one) < 1e-13  # 6e-16


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_centre_block_is_the_mean_of_the_symbol(dim):
    """D = ∂f(X)/∂x(X) is the mean of Ĵ over a grid that resolves its highest harmonic, 2N."""
    N, model = FAMILY[dim][0], MODELS["seth_hill m=-0.7"]
    fam, F = pd.lattice_family(dim, N), gradient(dim, 0.1, 9)
    axis = 2 * np.pi * np.arange(4 * int(N) + 1) / (4 * int(N) + 1)
    k = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    mean = np.mean(np.asarray(symbol(model, fam, F, k)), axis=0)
    assert difference(center_block(model, fam, F), mean) < 1e-12  # 5e-16


# ---------------------------------------------------------------- long waves


@pytest.mark.parametrize(
    ("name", "dim"), [("seth_hill m=-0.7", 2), ("correspondence neo-hookean", 2), ("seth_hill m=-0.7", 3)]
)
def test_long_wave_limit_of_the_symbol_is_the_acoustic_tensor_of_affine_maps(name, dim):
    """Ĵ(tN)/t² → −N·∂²W·N as t → 0. The criterion "affine" is the largest eigenvalue of this limit."""
    model, fam, F = MODELS[name], pd.lattice_family(dim, FAMILY[dim][0]), gradient(dim, 0.1, 10)
    I = np.eye(dim)

    def energy(flat):
        return model.energy(fam.bonds(I + flat.reshape(dim, dim)))

    fourth = jax.jit(jax.hessian(energy))((F - I).reshape(-1)).reshape((dim,) * 4)
    n = waves(dim, 10)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    acoustic = np.einsum("iJkL,nJ,nL->nik", fourth, n, n)
    t = 1e-2
    near, nearer, nearest = (symbol(model, fam, F, n * x) / x**2 for x in (t, t / 2, t / 4))
    limit = (64 * nearest - 20 * nearer + near) / 45  # the terms in t² and t⁴ cancel
    assert difference(limit, -acoustic) < 1e-12  # 2e-15
    affine = pd.stability(model, fam, F, criterion="affine")
    along = np.asarray(affine.direction)
    worst = -np.linalg.eigvalsh(np.einsum("iJkL,J,L->ik", fourth, along, along))[0]
    assert abs(float(affine.eigenvalue) - worst) < 1e-12 * abs(worst)  # 3e-16
    assert float(affine.eigenvalue) > -np.linalg.eigvalsh(acoustic)[:, 0].min() - 1e-12  # 3e-16 below
    M = float(pd.p_wave_modulus(model, fam))
    assert abs(float(affine.margin) - worst / M) < 1e-12  # 2e-16


# ---------------------------------------------------------------- wrong use


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"k": np.array([0.1, np.nan])}, "k must be finite"),
        ({"k": np.zeros(3)}, "k must have shape"),
        ({"k": 0.3}, "k must have shape"),
        ({"F": np.diag([1.0, -1.0])}, "det F > 0"),
        ({"F": np.eye(3)}, "F must be"),
        ({"F": np.full((2, 2), np.nan)}, "F must be finite"),
        ({"family": pd.lattice_family(2, 1)}, "shape tensor"),
    ],
)
def test_wrong_use_names_the_argument(change, named):
    use = {
        "model": MODELS["seth_hill m=1"],
        "family": pd.lattice_family(2, 2),
        "F": np.eye(2),
        "k": np.ones(2),
    } | change
    with pytest.raises(ValueError, match=named):
        pd.symbol(**use)


def test_a_traced_negative_determinant_raises_at_run_time():
    fam = pd.lattice_family(1, 2)
    call = eqx.filter_jit(partial(pd.symbol, MODELS["seth_hill m=1"], fam))
    with pytest.raises(Exception, match="det F > 0"):
        call(jnp.array([[-0.5]]), jnp.ones(1))
