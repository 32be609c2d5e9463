"""The closed forms against the NumPy reference, quadrature, roots of the exact diagonal, and literal loops.

The number beside a tolerance is the largest error measured, in float64. S1 to S15 are the slips of
`closed_forms.SLIPS`.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from scipy.integrate import dblquad
from scipy.optimize import brentq
from scipy.special import sici

from pdjax.studies import closed_forms as cf

jax.config.update("jax_enable_x64", True)

RNG = np.random.default_rng(7)


def isotropic(dim, lam, mu):
    """dS/dE of S = λ tr(E) I + 2μE."""
    one = np.eye(dim)
    pairs = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    return lam * np.einsum("ij,kl->ijkl", one, one) + mu * pairs


def peer(dim, N, m, lam, mu, omega=None):
    """The function force_of_u of the reference for `patch_row`: the force of the centre only."""

    def force(X, u):
        return ref.seth_hill_force(X, np.ones(len(X)), N, u, m, lam, mu, omega, rows=[0])

    return force


def moved_centre(dim, N, a, m, lam, mu):
    """∂f_1/∂x_1 of the centre in x = (1 + a) X by one complex step of the reference, spacing 1."""
    X = ref.lattice_ball(dim, 2 * N)
    u = (a * X).astype(complex)
    u[0, 0] += 1e-30j
    return float(np.imag(peer(dim, N, m, lam, mu)(X, u)[0, 0]) / 1e-30)


def spherical(dim):
    """Directions and weights (with sum 1) whose average over the sphere is exact for polynomials up to degree 8."""
    if dim == 1:
        return np.array([[1.0], [-1.0]]), np.full(2, 0.5)
    angle = 2 * np.pi * np.arange(16) / 16
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if dim == 2:
        return circle, np.full(16, 1 / 16)
    z, w = np.polynomial.legendre.leggauss(8)
    flat = np.sqrt(1 - z**2)[:, None, None] * circle[None]
    height = np.broadcast_to(z[:, None, None], (8, 16, 1))
    return np.concatenate([flat, height], axis=2).reshape(-1, 3), np.repeat(w / 2 / 16, 16)


def decaying(rate):
    """An influence for NumPy that is neither constant (except for rate 0) nor a power."""
    return lambda r, horizon: np.exp(-rate * r / horizon)


# ---------------------------------------------------------------- continuum


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_gamma_is_the_average_over_directions(dim):
    """Γ/R = L⁻¹_pqii ⟨n_p n_q [2(m−1) n_1² + 1]⟩ with L = ⟨nnnn⟩. The printed 3D form is 1 too small (S11)."""
    n, weight = spherical(dim)
    trace_dual = np.einsum("bii->b", ref._dual(n, weight))
    for m in (-1.0, -0.5, 0.0, 0.3, 1.0, 2.0):
        exact = np.sum(weight * trace_dual * (2 * (m - 1) * n[:, 0] ** 2 + 1))
        assert abs(cf.gamma(m, dim) - exact) < 1e-13  # 2.7e-15
        off = cf.gamma(m, dim, form="printed") - exact
        assert abs(off + (dim == 3)) < 1e-13  # printed 3D: 1 too small, at every m
    assert abs(cf.gamma(cf.m_cr(dim), dim)) == 0
    assert [cf.m_cr(d, "printed") for d in (1, 2, 3)] == [0.5, 0.0, 0.0]
    assert [cf.m_cr(d) for d in (1, 2, 3)] == [0.5, 0.0, -0.5]


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("power", [1.5, 2.0, 3.0])
def test_radial_factor_of_power_influences(dim, power):
    horizon = 0.3
    exact = (dim + power) / ((dim + power - 2) * horizon**2)
    value = cf.radial_factor(dim, horizon, lambda r, delta: (r / delta) ** power)
    assert abs(value / exact - 1) < 1e-12  # 5e-15


def test_radial_factor_diverges_for_constant_influence_below_3d():
    def constant(r, delta):
        return jnp.ones_like(r)

    assert np.isinf(cf.radial_factor(1, 1.0)) and np.isinf(cf.radial_factor(2, 1.0, constant))
    assert np.isinf(cf.radial_factor(3, 1.0, lambda r, delta: delta / r))
    assert abs(cf.radial_factor(3, 2.0) - cf.radial_factor(3, 2.0, constant)) < 1e-13  # 4e-15
    p = ref.lattice_ball(3, 12)[1:]
    lattice = 12**2 * np.mean(1 / np.sum(p**2, axis=1))
    assert abs(lattice - cf.radial_factor(3, 1.0)) < 0.2  # 0.16, the share of the excluded centre at N = 12


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 3), (3, 2)])
@pytest.mark.parametrize("a", [-0.1, 0.2])
def test_material_test_of_the_moved_centre(dim, N, a):
    """dT·dY of the reference equals the corrected form; the printed one has another sign and, above 1D, size (S6)."""
    m, lam, mu, eps = 0.8, 1.3, 0.7, 0.01
    X = ref.lattice_ball(dim, N)
    u = (a * X).astype(complex)
    u[0, 0] += 1e-30j
    states = ref.seth_hill_states(X, np.ones(len(X)), N, u, m, lam, mu, points=[0])
    exact = eps**2 * np.sum(np.imag(states[0][1][:, 0]) / 1e-30 * -1.0)  # dY_1 = −ε for all bonds
    stress = (dim * lam + 2 * mu) * ((1 + a) ** (2 * m) - 1) / (2 * m)
    radial = np.mean(1 / np.sum(X[1:] ** 2, axis=1))
    corrected = cf.material_test(stress, a, m, dim, radial, eps)
    printed = cf.material_test(stress, a, m, dim, radial, eps, form="printed")
    assert abs(corrected / exact - 1) < 1e-12  # 2e-15
    assert abs(printed / exact + dim * (2 * m - 1) / (dim + 2 * (m - 1))) < 1e-12  # −1, −0.75, −0.69
    # The continuum diagonal is −2 dT·dY/ε² with the same R: the two tests are one.
    assert abs(cf.continuum_diagonal(stress, a, m, dim, radial) * eps**2 / exact + 2) < 1e-12  # 3e-15


# ---------------------------------------------------------------- one dimension


@pytest.mark.parametrize("N", [1, 2, 5])
@pytest.mark.parametrize("m", [-1.0, 0.0, 0.3, 0.5, 1.0, 2.0])
def test_diagonal_1d_is_exact(N, m):
    lam, mu = 0.4, 0.9
    for a in (-0.3, -0.01, 0.5):
        exact = moved_centre(1, N, a, m, lam, mu)
        strain = np.log(1 + a) if m == 0 else ((1 + a) ** (2 * m) - 1) / (2 * m)
        kappa = lam + 2 * mu
        value = cf.diagonal_1d(a, m, N, kappa * strain, kappa)
        assert abs(value - exact) < 1e-12 * abs(exact) + 1e-13  # 7e-15
        assert np.sign(cf.bracket_1d(a, m, N)) == -np.sign(exact)
        assert abs(cf.lattice_diagonal(a, m, 1, N, lam, mu) - exact) < 1e-12 * abs(exact) + 1e-13  # 7e-15


def test_critical_loads_1d():
    """The two numbers of Remark 4, and the roots of the reference's diagonal."""
    assert round(float(cf.critical_load_1d(1.0, 1)), 3) == -0.184
    assert round(float(cf.critical_load_1d(1.0, 3)), 3) == -0.074
    for m, N, low, high in (
        (1.0, 1, -0.5, 0.0),
        (1.0, 3, -0.5, 0.0),
        (0.0, 3, 0.0, 1.0),
        (-1.0, 2, 0.0, 1.0),
    ):
        root = brentq(lambda a, m=m, N=N: moved_centre(1, N, a, m, 0.0, 0.5), low, high, xtol=1e-15)
        assert abs(cf.critical_load_1d(m, N) - root) < 1e-13  # 2e-16
    # 2N/(4N + 1) ≤ m ≤ 1/2: tension never fails on the diagonal.
    assert np.all(np.isinf(cf.critical_load_1d(jnp.array([6 / 13, 0.48, 0.5]), 3)))
    assert np.isfinite(cf.critical_load_1d(6 / 13 - 1e-3, 3))
    assert moved_centre(1, 3, 1e6, 0.48, 0.0, 0.5) < 0


def test_forms_in_1d_are_smooth_at_order_zero():
    """∂/∂m at m = 0 of criterion and critical load: autodiff equals central differences."""
    for function, step in (
        (lambda m: cf.bracket_1d(0.4, m, 3), 1e-5),
        (lambda m: cf.critical_load_1d(m, 3), 1e-5),
    ):
        slope = (function(step) - function(-step)) / (2 * step)
        assert abs(jax.grad(function)(0.0) - slope) < 1e-9  # 9e-11, of the difference
    # Nothing jumps where the Taylor branch begins, not even the second derivative.
    second = jax.vmap(jax.grad(jax.grad(lambda m: cf.bracket_1d(0.4, m, 3))))
    at = 0.1 / (2 * np.log(1.4)) + np.array([-1e-9, 1e-9])
    assert abs(np.diff(second(jnp.asarray(at)))[0]) < 1e-7  # 7e-10


@pytest.mark.parametrize("m", [-0.5, 0.0, 1.0, 1.5])
def test_dispersion_1d(m):
    """ω² is that of a complex wave in the reference's force; for vanishing amplitude it is the symbol of the patch."""
    N, lam, mu = 3, 0.4, 0.9
    kappa, X = lam + 2 * mu, ref.lattice_ball(1, 6)
    for k, amplitude in itertools.product((0.4, 1.9, 3.0), (1e-6, 0.05)):
        u = amplitude * np.exp(1j * k * X)
        force = peer(1, N, m, lam, mu)(X, u)[0, 0]
        exact = -force / (2.5 * amplitude)
        value = cf.dispersion_1d(k, amplitude, m, N, kappa, 2.5)
        assert abs(value - exact) < 1e-9 * abs(exact) + 1e-10  # 1e-11: cancellation in f/u₀ at 1e-6
    row = ref.patch_row(1, N, peer(1, N, m, lam, mu), np.eye(1))
    for k in (0.4, 1.9, np.pi):
        limit = cf.dispersion_limit_1d(k, N, kappa, 2.5)
        assert abs(limit + ref.symbol_of_row(row, [k])[0, 0] / 2.5) < 1e-14  # 6e-17
        assert abs(limit - cf.dispersion_1d(k, 1e-9, m, N, kappa, 2.5)) < 1e-8  # 2e-10, of the order of u₀ = 1e-9


def test_dispersion_of_the_continuum_is_the_sine_integral_and_the_limit_of_lattices():
    k = np.linspace(0, 400, 2001)
    known = sici(k * 0.5)[0] ** 2 * 3.0 / (2.5 * 0.25)
    assert abs(cf.dispersion_continuum_1d(k, 0.5, 3.0, 2.5) - known).max() < 2e-11  # measured 9e-12, at k = 400
    with pytest.raises(ValueError, match="at most 200"):
        cf.dispersion_continuum_1d(401.0, 0.5)
    omega = float(cf.dispersion_continuum_1d(7.0, 0.5)) ** 0.5
    gaps = [omega - float(cf.dispersion_limit_1d(7.0, N, spacing=0.5 / N)) ** 0.5 for N in (40, 80, 160)]
    # Σ h f(ph) falls short of the integral by ½h (f(0) − f(δ)) to first order, f(ξ) = sin(kξ)/ξ
    first = 0.5 * (7.0 - np.sin(3.5) / 0.5) / 0.5 * 0.5 / np.array([40, 80, 160])
    assert np.allclose(gaps, first, rtol=0.01)
    assert abs(gaps[0] / gaps[1] - 2) < 0.02 and abs(gaps[1] / gaps[2] - 2) < 0.01


def test_singular_bar():
    """The strain is the slope of the displacement, and E ε is the same stress everywhere."""
    length, ratio, alpha = 2.0, 1e-3, 10.0
    x = np.array([0.3, 0.9, 1.1, 1.6, 1.95])
    slope = (
        cf.singular_bar_displacement(x + 1e-6, length, ratio, alpha)
        - cf.singular_bar_displacement(x - 1e-6, length, ratio, alpha)
    ) / 2e-6
    strain = cf.singular_bar_strain(x, length, ratio, alpha)
    assert np.max(np.abs(slope - strain)) < 1e-10  # 2e-12, of the difference
    modulus = np.where(x <= 1, 1.0, 1 / (1 + alpha / (2 * np.sqrt(np.maximum(x / length - 0.5, 1e-300)))))
    assert np.max(np.abs(modulus * strain / ratio - 1)) < 1e-13  # 0


# ---------------------------------------------------------------- two dimensions


def test_lattice_sums_2d():
    """The printed sums are their ring plus the integral. The finite sums, computed by loops, differ (S2)."""
    powers = ((0, 0), (2, 0), (4, 0), (2, 2), (6, 0), (4, 2))
    for N in (1, 3, 4.5):
        printed, exact = cf.lattice_sums_2d(N, "printed"), cf.lattice_sums_2d(N)
        for (i, j), p, e in zip(powers, printed, exact, strict=True):
            total = 0.0
            for x, y in itertools.product(range(-5, 6), repeat=2):
                if 0 < x * x + y * y <= N * N:
                    total += x**i * y**j / (x * x + y * y) ** ((i + j + 2) / 2)
            assert abs(e - total) < 1e-13  # 5e-15

            def density(angle, r, i=i, j=j):
                return 4 * np.cos(angle) ** i * np.sin(angle) ** j / r

            ring = {(0, 0): 8, (2, 2): 0, (4, 2): 0}.get((i, j), 4)
            assert abs(p - ring - dblquad(density, 1, N, 0, np.pi / 2)[0]) < 1e-12  # 2e-15
        # The printed sum counts the axis points of the first ring twice. The loops count them once.
        assert cf.lattice_sums_2d(1, "printed").s00 == 2 * cf.lattice_sums_2d(1).s00 == 8
    # S1: the weighted volume over V is the number of bonds: 28 at N = 3; πN² = 28.3, printed πN = 9.4.
    assert [len(cf.lattice_bonds(2, N)) for N in (1, 2, 3, 30)] == [4, 12, 28, 2820]
    assert abs(2820 / (np.pi * 30**2) - 1) < 3e-3  # 2.6e-3
    values = cf.lattice_sums_2d(3, "printed").s00, cf.lattice_sums_2d(3).s00
    assert np.allclose(values, (14.903, 9.544), atol=5e-4)


def test_index_tensor_2d():
    """It equals the fifteen printed terms, added one by one, and has the contraction used in appendix C."""
    printed = np.zeros((2,) * 6)
    terms = (
        "ij jk kl rs|is  ij jk kr ls|is  ij jl lr ks|is  ik kl lr js|is  jk kl lr is|ij  ij jk ks lr|ir  "
        "ij jl ls kr|ir  ik kl ls jr|ir  jk kl ls ir|ij  ij jr rs kl|il  ik kr rs jl|il  jk kr rs il|ij  "
        "il lr rs jk|ik  jl lr rs ik|ij  kl lr rs ij|is"
    ).split("  ")
    for index in np.ndindex(*printed.shape):
        at = dict(zip("ijklrs", index, strict=True))
        for term in terms:
            equal, differ = term.split("|")
            printed[index] += all(at[p] == at[q] for p, q in equal.split()) and at[differ[0]] != at[differ[1]]
    assert len(terms) == 15 and np.array_equal(printed, cf.index_tensor_2d())
    assert np.array_equal(np.einsum("iiklrr->kl", printed), 3 * np.eye(2))


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_inverse_shape_tensor(dim):
    """L⁻¹ : n⊗n equals the numerical inverse of the directional average."""
    n, weight = spherical(dim)
    closed = np.einsum("ijkl,bk,bl->bij", cf.inverse_shape_tensor(dim, 2.0), n, n)
    assert np.max(np.abs(closed - ref._dual(n, 2 * weight))) < 1e-12  # 4e-15
    appendix = np.einsum("km,ln->klmn", np.eye(2), np.eye(2))
    appendix = 2 * appendix + 2 * appendix.swapaxes(2, 3) - np.einsum("kl,mn->klmn", np.eye(2), np.eye(2))
    assert np.max(np.abs(cf.inverse_shape_tensor(2, 1.0) - appendix)) < 1e-14  # 0


def loops_2d(F, m, N, S, C, volume):
    """The 2D entry under a uniform deformation by loops over bonds, with the isotropic L⁻¹; spacing 1."""
    total = np.zeros((2, 2))
    for p in ref.lattice_ball(2, N)[1:]:
        r2, y = p @ p, F @ p
        s = np.sqrt(y @ y / r2)
        D = 4 * np.outer(p, p) - r2 * np.eye(2)
        total -= s ** (4 * m - 2) * np.outer(y, y) / (y @ y) * np.sum(D * np.tensordot(C, D)) / r2**3 / volume**2
        stiff = 2 * (m - 1) * np.outer(y, y) / (y @ y) + np.eye(2)
        total -= 2 * s ** (2 * m - 2) * np.sum(S * D) / r2**2 * stiff / volume
    return total


def test_jacobian_2d_uniform_and_hydrostatic():
    """The direct sums equal loops for any F and law. The form with six sums equals them under hydrostatic load."""
    N, m, a = 3, 0.7, -0.1
    S = RNG.normal(size=(2, 2))
    S, C = S + S.T, isotropic(2, 0.7, 0.4) + 0.1 * np.einsum("ij,kl->ijkl", S, S + S.T)
    F = np.eye(2) + 0.2 * RNG.normal(size=(2, 2))
    for form, volume in (("printed", np.pi * N), ("corrected", np.pi * N**2)):
        direct = cf.jacobian_2d_uniform(F, m, N, S, C, 1.0, form)
        assert np.max(np.abs(direct - loops_2d(F, m, N, S, C, volume))) < 1e-13  # 9e-16
    hydro = (1 + a) * np.eye(2)
    for form, slips in (("printed", ("S2",)), ("corrected", ("S1", "S2"))):
        direct = cf.jacobian_2d_uniform(hydro, m, N, S, C, 0.5, form)
        sums = cf.jacobian_2d_hydrostatic(a, m, N, S, C, 0.5, slips)
        assert np.max(np.abs(direct - sums)) < 1e-12  # 4e-15
    # The printed general formula with its coefficients, entry by entry.
    printed = cf.jacobian_2d_hydrostatic(a, m, N, S, C, 1.0, "printed")
    assert np.max(np.abs(printed - literal_2ddfss(a, m, N, S, C))) < 1e-12  # 2e-15


def literal_2ddfss(a, m, N, S, C):
    """The general hydrostatic formula as printed, index by index, with one symbol for each Kronecker delta."""
    log, pi, out = np.log(N), np.pi, np.zeros((2, 2))
    gam, d = np.asarray(cf.index_tensor_2d()), np.eye(2)

    def mixed(i, j, k, l):
        pairs = d[i, j] * d[k, l] * (1 - d[i, k]) + d[i, k] * d[j, l] * (1 - d[i, j])
        pairs += d[i, l] * d[j, k] * (1 - d[i, j])
        return pairs * pi / 4 * log + (i == j == k == l) * (4 + 3 * pi / 4 * log)

    for k, l, i, j in np.ndindex(2, 2, 2, 2):
        rest = 4 * (m - 1) * mixed(i, j, k, l) + (2 - m) * d[i, j] * d[k, l] * (4 + pi * log)
        out[k, l] -= 4 / (pi * N) * (1 + a) ** (2 * m - 2) * S[i, j] * rest
        for r, s in np.ndindex(2, 2):
            brace = gam[i, j, k, l, r, s] * pi / 2 * log + (i == j == k == l == r == s) * (16 + 5 * pi / 2 * log)
            brace += d[i, j] * d[r, s] * d[k, l] * (1 + pi / 4 * log)
            brace -= d[r, s] * mixed(i, j, k, l) + d[i, j] * mixed(r, s, k, l)
            out[k, l] -= 4 / (pi * N) ** 2 * (1 + a) ** (4 * m - 2) * C[i, j, r, s] * brace
    return out


@pytest.mark.parametrize("m", [-0.6, 0.5, 1.0])
def test_printed_2d_diagonal_differs_by_a_factor_from_the_general_formula(m):
    """The paper's general formula has half the stress term of its hydrostatic diagonal (S4)."""
    N, a, kappa, h = 3, -0.07, 1.7, 0.2
    strain = ((1 + a) ** (2 * m) - 1) / (2 * m)
    log = np.pi * np.log(N)
    literal = -4 * (4 + log) / (np.pi * N * h) ** 2 * kappa * (1 + a) ** (4 * m - 2)
    literal *= 1 + 2 * np.pi * N * (1 - (1 + a) ** (-2 * m))
    assert abs(cf.diagonal_2d(a, m, N, kappa, h, "printed") / literal - 1) < 1e-13  # 6e-15
    tangent = kappa * np.einsum("ij,rs->ijrs", np.eye(2), np.eye(2))
    general = cf.jacobian_2d_hydrostatic(a, m, N, kappa * strain * np.eye(2), tangent, h, "printed")
    assert np.max(np.abs(general - cf.diagonal_2d(a, m, N, kappa, h, ("S4",)) * np.eye(2))) < 1e-11  # 1e-14
    assert abs(cf.diagonal_2d(a, m, N, kappa, h, "printed") / general[0, 0] - 1) > 0.3


@pytest.mark.parametrize("N", [2, 3, 4.5])
@pytest.mark.parametrize(("law", "lam", "mu"), [("bulk", 0.5, 0.0), ("symmetric", 0.0, 0.5)])
def test_diagonal_2d_corrected_is_exact(N, law, lam, mu):
    """With all slips corrected (κ = 1) it is the exact discrete diagonal of the lattice, S = ½ tr(E) I or S = E."""
    for m, a in itertools.product((-0.5, 0.0, 1.0), (-0.2, 0.1)):
        exact = moved_centre(2, N, a, m, lam, mu)
        assert abs(cf.diagonal_2d(a, m, N, law=law) / exact - 1) < 1e-11  # 2e-14
        assert abs(cf.lattice_diagonal(a, m, 2, N, lam, mu) / exact - 1) < 1e-11  # 2e-14
        assert np.sign(cf.bracket_2d(a, m, N, law=law)) == -np.sign(exact)


@pytest.mark.parametrize(("dim", "N"), [(2, 2), (3, 1.5), (3, 2)])
def test_lattice_diagonal_and_its_root(dim, N):
    for m, a in itertools.product((-1.0, -0.3, 0.0, 1.0), (-0.15, 0.2)):
        exact = moved_centre(dim, N, a, m, 1.1, 0.6)
        assert abs(cf.lattice_diagonal(a, m, dim, N, 1.1, 0.6) - exact) < 1e-12 * abs(exact) + 1e-13  # 3e-15
        assert abs(cf.lattice_diagonal(a, m, dim, N, 1.1, 0.6, 0.5) - 4 * exact) < 1e-11 * abs(exact) + 1e-12  # 1e-14
    root = brentq(lambda a: moved_centre(dim, N, a, 1.0, 1.1, 0.6), -0.5, 0.0, xtol=1e-15)
    assert abs(cf.lattice_critical_load(1.0, dim, N, 1.1, 0.6) - root) < 1e-12  # 3e-17


def test_chain_2d():
    """S1 to S5 in numbers, m = 1, N = 3, from the root of the printed criterion to that of the exact diagonal."""
    bulk = cf.chain_2d(1.0, 3, "bulk")
    symmetric = cf.chain_2d(1.0, 3, "symmetric")
    loads = {step.slip: float(step.load) for step in bulk}
    assert [step.slip for step in bulk] == ["printed", "S13", "S14", "S4", "S1", "S3", "S2"]
    expected = (-0.02551, -0.02551, -0.02551, -0.04917, -0.01723, -0.00873, -0.00881)
    assert np.allclose([float(step.load) for step in bulk], expected, atol=5e-6)
    assert np.allclose([float(step.load) for step in symmetric[-2:]], (-0.04148, -0.04119), atol=5e-6)
    root = brentq(lambda a: 1 + 6 * np.pi * (1 - (1 + a) ** -2.0), -0.5, 0.0, xtol=1e-15)
    assert abs(loads["printed"] - root) < 1e-14  # 1e-16
    for steps, lam, mu in ((bulk, 0.5, 0.0), (symmetric, 0.0, 0.5)):
        root = brentq(lambda a, lam=lam, mu=mu: moved_centre(2, 3, a, 1.0, lam, mu), -0.5, 0.0, xtol=1e-15)
        assert abs(float(steps[-1].load) - root) < 1e-13  # 9e-17
        assert abs(float(cf.lattice_critical_load(1.0, 2, 3, lam, mu)) - root) < 1e-13  # 9e-17
    # S5: −0.037 needs q between 12.59 and 12.95. No choice of corrections gives a load that rounds to it.
    for law, size in itertools.product(("bulk", "symmetric"), range(5)):
        for slips in itertools.combinations(("S1", "S2", "S3", "S4"), size):
            assert round(float(cf.critical_load_2d(1.0, 3, slips, law)), 3) != -0.037
    # It is half the 1D value, and Remark 5 compares the two.
    assert round(float(cf.critical_load_1d(1.0, 3)) / 2, 3) == -0.037


def test_criteria_2d_inequality_and_hencky_branch():
    """As printed, the undeformed body is unstable (S13), and the branch m = 0 is not the limit (S14)."""
    assert moved_centre(2, 3, 0.0, 1.0, 1.0, 1.0) < 0
    assert cf.satisfies_criterion_2d(0.0, 1.0, 3) and not cf.satisfies_criterion_2d(0.0, 1.0, 3, "printed")
    a = -0.3
    assert abs(cf.bracket_2d(a, 1e-9, 3, "printed") - 1) < 1e-7  # 1.3e-8
    assert abs(cf.bracket_2d(a, 0.0, 3, "printed") - (1 + 6 * np.pi * np.log(0.7))) < 1e-13  # 9e-16
    assert cf.bracket_2d(a, 0.0, 3) == 1
    for load in (-0.9, -0.3, 5.0):
        assert moved_centre(2, 3, load, 0.0, 1.0, 1.0) < 0  # Remark 7 holds for the 2D diagonal
    assert moved_centre(3, 2, -0.1, 0.0, 1.0, 1.0) > 0  # 0.087: it does not hold in 3D, where Γ(0) > 0 (S11)
    assert abs(cf.critical_load_2d(0.0, 3, "printed") - np.expm1(-1 / (6 * np.pi))) < 1e-15  # 0
    assert np.isposinf(cf.critical_load_2d(0.0, 3))
    # Remark 7's window m < 0: the load is large near 0 but finite, here e^{1.77} − 1.
    load = float(cf.critical_load_2d(-0.005, 3))
    assert abs(load - brentq(lambda a: moved_centre(2, 3, a, -0.005, 0.5, 0.0), 1, 20)) < 1e-9  # 4e-13
    assert 4.8 < load < 5.0


# ---------------------------------------------------------------- any homogeneous deformation


FAMILIES = [(1, 3, 0.0), (2, 2, 0.0), (2, 2, 1.2), (3, 1.5, 0.8)]


def random_gradient(dim):
    return np.eye(dim) + 0.15 * RNG.normal(size=(dim, dim))


@pytest.mark.parametrize(("dim", "N", "decay"), FAMILIES)
@pytest.mark.parametrize("m", [0.0, 1.0, -0.7])
def test_jacobian_entry_at_every_eta(dim, N, decay, m):
    """The whole row of the Jacobian, within two horizons, equals complex steps, for any F and any influence."""
    lam, mu, omega_of = 1.1, 0.6, decaying(decay)
    F = random_gradient(dim)
    xi = cf.lattice_bonds(dim, N)
    omega = omega_of(np.linalg.norm(xi, axis=1), N)
    stress = ref._law(ref.seth_hill_strain(xi, xi @ F.T, omega, m), lam, mu)
    tangent = isotropic(dim, lam, mu)
    eta, blocks = ref.patch_row(dim, N, peer(dim, N, m, lam, mu, omega_of), F)
    entry = jax.jit(jax.vmap(lambda e: cf.jacobian_terms(e, xi, omega, 1.0, F, m, stress, tangent)))
    terms = np.asarray(entry(eta))
    assert np.max(np.abs(terms.sum(axis=1) - blocks)) < 1e-12 * np.abs(blocks).max()  # 3e-15
    assert np.max(np.abs(blocks[1:])) > 1e-3 and np.max(np.abs(terms[1:, 2])) == 0
    T = cf.uniform_force_state(F, m, stress, xi, omega, 1.0)
    X = ref.lattice_ball(dim, N)
    near, exact = ref.seth_hill_states(
        X, np.ones(len(X)), N, X @ (F - np.eye(dim)).T, m, lam, mu, omega_of, points=[0]
    )[0]
    order = [int(np.argmin(np.linalg.norm(xi - x, axis=1))) for x in X[near]]
    assert np.max(np.abs(T[np.array(order)] - exact)) < 1e-13  # 1e-16


def test_jacobian_terms_scale_with_the_spacing():
    """In units of h, with V = h^d, every term is proportional to 1/h²."""
    F, m, h = np.diag([1.1, 0.95]), 1.0, 0.25
    xi = cf.lattice_bonds(2, 2)
    tangent, stress = isotropic(2, 1.0, 1.0), np.diag([0.3, -0.1])
    one = cf.jacobian_terms(np.zeros(2), xi, np.ones(len(xi)), 1.0, F, m, stress, tangent)
    scaled = cf.jacobian_terms(np.zeros(2), h * xi, np.ones(len(xi)), h**2, F, m, stress, tangent)
    assert np.max(np.abs(scaled - one / h**2)) < 1e-12  # 0, h being a power of two
    assert np.max(np.abs(one[1])) == 0


def test_static_equation_sign():
    """The summand of a bond, T_ij − T_ji, is the sum 2T. The printed difference is zero (S15)."""
    X, F = ref.lattice_ball(2, 4), np.array([[1.1, 0.2], [0.0, 0.9]])
    u = X @ (F - np.eye(2)).T
    states = ref.seth_hill_states(X, np.ones(len(X)), 2, u, 0.5, 1.0, 1.0, points=range(13))
    near, here = states[0]
    back = np.array([states[j][1][np.flatnonzero(states[j][0] == 0)[0]] for j in near])  # T[−ξ](X+ξ)
    bonds = X[near]
    there = np.array(
        [
            states[j][1][np.argmin(np.linalg.norm(X[states[j][0]] - X[j] - b, axis=1))]
            for j, b in zip(near, bonds, strict=True)
        ]
    )
    actual = here - back
    assert np.max(np.abs(cf.static_integrand(here, there) - actual)) < 1e-13  # 0
    assert np.max(np.abs(actual - 2 * here)) < 1e-13  # 1e-17
    assert np.max(np.abs(cf.static_integrand(here, there, "printed"))) < 1e-13 < 0.01 < np.max(np.abs(actual))


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 3), (3, 2)])
def test_nonlocal_strain_is_exact_only_for_order_one_and_similarities(dim, N):
    """F̄ is exact. Ē_m is exact for m = 1, for similarities and in 1D; else its error is of second order (S12)."""
    xi = cf.lattice_bonds(dim, N)
    omega = decaying(0.5)(np.linalg.norm(xi, axis=1), N)
    G = RNG.normal(size=(dim, dim))
    Q = np.linalg.qr(G)[0]
    for F in (np.eye(dim) + 0.2 * G, 1.3 * Q):
        assert np.max(np.abs(cf.gradient_defect(F, xi, omega))) < 1e-13  # 4e-16
        assert np.max(np.abs(cf.strain_defect(F, 1.0, xi, omega))) < 1e-13  # 3e-16
    for m in (-1.0, 0.0, 0.5, 2.0):
        assert np.max(np.abs(cf.strain_defect(1.3 * Q, m, xi, omega))) < 1e-13  # 2e-16
        stretch = np.diag(np.linspace(1.0, -0.5, dim))  # any traceful, anisotropic strain
        small = [np.max(np.abs(cf.strain_defect(np.eye(dim) + e * stretch, m, xi, omega))) for e in (1e-2, 1e-3)]
        if dim == 1:
            assert max(small) < 1e-14  # 2e-18
        else:
            assert small[0] > 1e-5  # 1.3e-5 to 5.2e-5 at a strain of 1e-2, far above rounding
            assert abs(small[0] / small[1] - 100) < 2  # 0.6: second order
        # Both strains also agree with another computation.
        F = np.eye(dim) + 0.1 * G
        other = ref.seth_hill_strain(xi, xi @ F.T, omega, m)
        assert np.max(np.abs(cf.nonlocal_strain(F, m, xi, omega) - other)) < 1e-13  # 1e-16
    C = F.T @ F
    assert np.max(np.abs(cf.local_strain(F, 2.0) - (C @ C - np.eye(dim)) / 4)) < 1e-13  # 1e-16
    assert np.max(np.abs(cf.local_strain(F, -1.0) - (np.eye(dim) - np.linalg.inv(C)) / 2)) < 1e-13  # 4e-16


# ---------------------------------------------------------------- Silling's model


def kirchhoff_tangent(F, lam, mu):
    """∂P/∂F, P = F S(E), by complex step."""
    dim = len(F)
    A = np.zeros((dim,) * 4)
    for l, n in np.ndindex(dim, dim):
        G = F.astype(complex)
        G[l, n] += 1e-30j
        A[:, :, l, n] = np.imag(G @ ref._law((G.T @ G - np.eye(dim)) / 2, lam, mu)) / 1e-30
    return A


@pytest.mark.parametrize(("dim", "N", "decay"), FAMILIES)
def test_silling_entry_at_every_eta(dim, N, decay):
    lam, mu, omega_of = 1.1, 0.6, decaying(decay)
    F = random_gradient(dim)

    def force(X, u):
        return ref.correspondence_force(X, np.ones(len(X)), N, u, lam, mu, omega_of, rows=[0])

    eta, blocks = ref.patch_row(dim, N, force, F)
    xi = cf.lattice_bonds(dim, N)
    omega, A = omega_of(np.linalg.norm(xi, axis=1), N), kirchhoff_tangent(F, lam, mu)
    entries = jax.vmap(lambda e: cf.silling_entry(e, xi, omega, 1.0, A))(jnp.asarray(eta))
    assert np.max(np.abs(entries - blocks)) < 1e-13 * np.abs(blocks).max()  # 2e-16
    # The half-reciprocal points are zero-energy modes: the symbol vanishes there for any F.
    for k in cf.half_reciprocal_points(dim):
        assert np.max(np.abs(ref.symbol_of_row((eta, blocks), k))) < 1e-13 * np.abs(blocks).max()  # 7e-16


def test_silling_diagonal_3d_is_that_of_the_lattice_with_the_shape_tensor_of_a_ball():
    A = kirchhoff_tangent(np.diag([1.1, 0.9, 1.0]), 1.0, 1.0)
    ratios = []
    for N in (2, 4, 8):
        xi = cf.lattice_bonds(3, N)
        K = np.sum(xi[:, 0] ** 2)
        # Σ ω² ξξ = K: the pair sum reduces to K⁻¹ exactly, so the whole block is −A_kplp/K.
        exact = -np.einsum("kplp->kl", A) / K
        if N < 5:
            entry = cf.silling_entry(np.zeros(3), xi, np.ones(len(xi)), 1.0, A)
            assert np.max(np.abs(entry - exact)) < 1e-13  # 6e-17
        printed = np.asarray(cf.silling_diagonal_3d(A, float(N), 1.0))
        ratios.append(float(printed[0, 0] / exact[0, 0]))
    assert np.allclose(ratios, (0.9699, 0.9279, 0.9722), atol=1e-4)
    assert np.max(np.linalg.eigvalsh((printed + printed.T) / 2)) < 0


# ---------------------------------------------------------------- thresholds of the symbol


@pytest.mark.parametrize(("dim", "N", "decay"), [(1, 3, 0.0), (2, 2, 0.0), (2, 3, 0.0), (2, 3, 1.5), (3, 1.5, 0.0)])
def test_hydrostatic_thresholds(dim, N, decay):
    """The signs of brute-force symbols change at each threshold, and the symbol agrees at finite load."""
    lam, mu = 1.0, 0.7
    influence = (lambda r, delta: jnp.exp(-decay * r / delta)) if decay else None
    low, high = (float(m) for m in cf.hydrostatic_thresholds(dim, N, influence))
    assert low <= cf.m_cr(dim) + 1e-15 and high >= cf.m_cr(dim) - 1e-15
    k_all = cf.half_reciprocal_points(dim)

    def brute(a, m):
        row = ref.patch_row(dim, N, peer(dim, N, m, lam, mu, decaying(decay)), (1 + a) * np.eye(dim))
        return np.array([ref.symbol_of_row(row, k) for k in k_all])

    for a, m, unstable in (
        (0.01, high + 0.02, False),
        (0.01, high - 0.02, True),
        (-0.01, low + 0.02, True),
        (-0.01, low - 0.02, False),
    ):
        symbols = brute(a, m)
        assert np.max(np.abs(symbols.imag)) < 1e-12  # 6e-32
        assert (np.linalg.eigvalsh(symbols.real).max() > 0) == unstable
        closed = cf.half_reciprocal_symbol(a, m, dim, N, lam, mu, influence=influence)
        assert np.max(np.abs(closed - symbols)) < 1e-13  # 2.5e-15
    closed = cf.half_reciprocal_symbol(0.3, 0.4, dim, N, lam, mu, influence=influence)
    assert np.max(np.abs(closed - brute(0.3, 0.4))) < 1e-12  # 3e-15: no expansion in a is needed


def test_thresholds_leave_no_order_stable_on_both_sides():
    """Both are 1/2 in 1D; −∞ means that no compression is stable; m = 0 is unstable on both sides in 2D for every N."""
    assert [tuple(float(m) for m in cf.hydrostatic_thresholds(1, N)) for N in (1, 3, 6)] == [(0.5, 0.5)] * 3
    assert [float(m) for m in cf.hydrostatic_thresholds(2, 1)] == [-np.inf, 0.5]
    for N in (1, 2, 3, 4, 6, 8):
        low, high = cf.hydrostatic_thresholds(2, N)
        assert low < 0 < high
    low, high = cf.hydrostatic_thresholds(3, 3)
    assert low < -0.5 < high < 0  # in 3D at N = 3 these waves show m = 0 unstable in compression only
    N2, N3 = (np.array(cf.hydrostatic_thresholds(2, N)) for N in (2, 3))
    assert np.allclose(N2, (-1.0, 1 / 3), atol=1e-12) and np.allclose(N3, (-0.531165, 0.257556), atol=1e-6)


# ---------------------------------------------------------------- wrong use, transformations


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: cf.gamma(1.0, 4), "dim"),
        (lambda: cf.m_cr(0), "dim"),
        (lambda: cf.gamma(1.0, 2, form="exact"), "form"),
        (lambda: cf.continuum_diagonal(1.0, -1.0, 1.0, 2, 1.0), "a must"),
        (lambda: cf.bracket_1d(np.array([0.1, -1.5]), 1.0, 3), "a must"),
        (lambda: cf.critical_load_1d(1.0, 0), "N"),
        (lambda: cf.critical_load_1d(1.0, 2.5), "N"),
        (lambda: cf.lattice_sums_2d(0.5), "N"),
        (lambda: cf.lattice_bonds(2, np.nan), "N"),
        (lambda: cf.bracket_2d(0.1, 1.0, 3, form=("S1", "S9")), "form"),
        (lambda: cf.bracket_2d(0.1, 1.0, 3, law="hookean"), "law"),
        (lambda: cf.lattice_diagonal(0.1, 1.0, 2, 1, 1.0, 1.0), "shape tensor L"),
        (
            lambda: cf.jacobian_entry(np.zeros(1), [[1.0], [2.0]], [1.0, 1.0], 1.0, np.eye(1), 1.0, np.eye(1), 1.0),
            "xi",
        ),
        (lambda: cf.silling_diagonal_3d(np.zeros((2, 2, 2, 2)), 1.0, 1.0), "tangent"),
        (lambda: cf.dispersion_1d(1.0, 0.0, 1.0, 3), "amplitude"),
        (lambda: cf.static_integrand(np.zeros(2), np.zeros(2), "right"), "form"),
    ],
)
def test_wrong_use_names_the_argument(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_transformations():
    """jit, vmap and grad work. The derivative of an entry with respect to m equals a central difference."""
    ms = jnp.array([-1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
    loads = jax.jit(jax.vmap(lambda m: cf.lattice_critical_load(m, 2, 3, 1.0, 1.0)))(ms)
    assert np.array_equal(np.isfinite(loads), np.asarray(ms) != 0)
    xi = cf.lattice_bonds(2, 2)
    omega, tangent, stress = np.ones(len(xi)), isotropic(2, 1.0, 0.5), np.diag([0.2, -0.1])
    F = np.array([[1.1, 0.1], [0.0, 0.9]])

    def entry(m):
        return cf.jacobian_entry(jnp.array([1.0, 1.0]), xi, omega, 1.0, F, m, stress, tangent)[0, 1]

    slope = (entry(0.6 + 1e-5) - entry(0.6 - 1e-5)) / 2e-5
    assert abs(jax.jit(jax.grad(entry))(0.6) - slope) < 1e-9  # 8e-14
    width = jax.grad(lambda w: cf.hydrostatic_thresholds(2, 3, lambda r, d: jnp.exp(-w * r / d))[1])(0.5)
    up, down = (cf.hydrostatic_thresholds(2, 3, lambda r, d, w=w: jnp.exp(-w * r / d))[1] for w in (0.50001, 0.49999))
    assert abs(width - (up - down) / 2e-5) < 1e-8  # 7e-13


# ---------------------------------------------------------------- the reference itself


@pytest.mark.parametrize("m", [0.0, 1.0])
def test_reference_force_is_the_derivative_of_its_energy(m):
    """f = −(1/V) ∂Π/∂u on an irregular cloud with unequal volumes, and the two Jacobians of the reference agree."""
    X = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(-1, 2)
    X = X + 0.1 * RNG.uniform(-1, 1, X.shape)
    volumes, u = RNG.uniform(0.8, 1.2, len(X)), 0.05 * RNG.normal(size=X.shape)
    omega = decaying(0.7)
    for force, energy in (
        (
            lambda v: ref.seth_hill_force(X, volumes, 2.3, v, m, 1.0, 0.6, omega),
            lambda v: ref.seth_hill_energy(X, volumes, 2.3, v, m, 1.0, 0.6, omega),
        ),
        (
            lambda v: ref.correspondence_force(X, volumes, 2.3, v, 1.0, 0.6, omega),
            lambda v: ref.correspondence_energy(X, volumes, 2.3, v, 1.0, 0.6, omega),
        ),
    ):
        slope = ref.complex_step_jacobian(energy, u).reshape(X.shape)
        assert np.max(np.abs(force(u) + slope / volumes[:, None])) < 1e-13  # 4e-16
        J = ref.complex_step_jacobian(force, u)
        assert np.max(np.abs(J - ref.central_difference_jacobian(force, u, 1e-6))) < 1e-8  # 4e-10
        VJ = np.repeat(volumes, 2)[:, None] * J
        assert np.max(np.abs(VJ - VJ.T)) < 1e-13  # 9e-16
