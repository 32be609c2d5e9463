"""Stability criteria against NumPy: brute force over waves, explicit quotients, closed forms, differences.

Beside each tolerance: the largest error measured (float64).
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
import scipy.linalg
from table import LINEAR, MODELS, EnergyOnly
from test_bloch import LAM, MU, Peer, climb, correspondence_state, difference, gradient, random, seth_hill_state

import pdjax as pd
from pdjax import closed_forms

try:
    from jax import enable_x64
except ImportError:  # jax < 0.8
    from jax.experimental import enable_x64

AT_A_POINT = ("diagonal", "block", "material_center", "material_neighbour", "material", "affine", "continuum")
FAMILIES = {1: 3, 2: 2, 3: 1.5}


@eqx.filter_jit
def judge(model, fam, F, names):
    """{criterion: Stability}, all in one compiled function; F is traced, so that the zone is not folded."""
    return {name: pd.stability(model, fam, F, name) for name in names}


def seth_hill(m, lam=LAM, mu=MU):
    return pd.SethHill(jnp.asarray(m, float), pd.LinearElastic(jnp.asarray(lam, float), jnp.asarray(mu, float)))


# ---------------------------------------------------------------- the symbol's margin

HYDROSTATIC = {
    "1D compression": (1, 1.0, 0.9),
    "1D tension": (1, 1.0, 1.1),
    "3D compression": (3, 1.0, 0.9),
    "3D tension": (3, 1.0, 1.2),
    "3D Hencky": (3, 0.0, 0.95),
}


def check_waves(found, peer):
    """The definition: sup over k ≠ 0 and the limit k → 0 of λ_max/(M κ²); what is reported belongs to a true wave."""
    over_waves, over_limits = peer.supremum(peer.quotient, 32)[0], peer.long_wave_supremum()[0]
    exact = max(over_waves, over_limits)
    assert abs(float(found.margin) - exact) < 1e-9 * max(abs(exact), 1e-2)  # 
    k, mode, value = (np.asarray(x) for x in (found.wave_vector, found.mode, found.eigenvalue))
    assert found.verdict == ("unstable" if exact > 0 else "stable") and abs(exact) > 1e-4
    assert abs(np.linalg.norm(mode) - 1) < 1e-12  # 
    if not k.any():
        assert over_limits > over_waves and value == 0
        assert abs(peer.long_wave(found.direction)[0] - float(found.margin)) < 1e-12  # 
        return
    J = peer.symbol(k)[0]
    assert np.max(np.abs(J @ mode - value * mode)) < 1e-6 * np.max(np.abs(J)) + 1e-9  # 
    if exact > 0:
        assert abs(value / peer.supremum(peer.top, 32)[0] - 1) < 1e-9  #  the fastest growing wave
    else:
        assert abs(peer.quotient(k)[0] - exact) < 1e-12  #  the wave of the margin
    assert difference(np.abs(found.direction), np.abs(k) / np.linalg.norm(k)) < 1e-12  # 


@pytest.mark.parametrize("name", HYDROSTATIC)
def test_margin_is_the_supremum_over_waves_and_the_limit(name):
    dim, m, stretch = HYDROSTATIC[name]
    N, F = FAMILIES[dim], stretch * np.eye(dim)
    found = judge(seth_hill(m), pd.lattice_family(dim, N), F, ("symbol",))["symbol"]
    check_waves(found, Peer(dim, N, F, seth_hill_state(dim, N, m)))


@pytest.mark.parametrize("dim", [1, 3])
def test_margin_in_general_position(dim):
    N = FAMILIES[dim]
    for i, m in enumerate((-0.7, 0.2, 1.5)):
        F = gradient(dim, 0.15, 20, i)
        found = judge(seth_hill(m), pd.lattice_family(dim, N), F, ("symbol",))["symbol"]
        check_waves(found, Peer(dim, N, F, seth_hill_state(dim, N, m)))


def test_the_limit_of_long_waves_can_be_the_margin():
    """Silling's model past the ellipticity of St. Venant–Kirchhoff: sin² of the waves falls below k², the limit wins."""
    F = np.diag([0.5, 0.7])
    found = judge(pd.Correspondence(LINEAR), pd.lattice_family(2, 2), F, ("symbol", "affine"))
    peer = Peer(2, 2, F, correspondence_state(2, 2))
    exact, direction = peer.long_wave_supremum()
    assert found["symbol"].verdict == "unstable"
    for name in ("symbol", "affine"):
        assert abs(float(found[name].margin) - exact) < 1e-12  # 
    assert peer.supremum(peer.quotient, 32)[0] < exact
    # an unstable state reports its fastest wave, not the limit, which does not grow
    fastest, k = peer.supremum(peer.top, 64)
    assert abs(float(found["symbol"].eigenvalue) / fastest - 1) < 1e-9  # 
    assert difference(np.abs(found["symbol"].wave_vector), np.abs(k)) < 1e-5  # 
    assert abs(abs(direction @ np.asarray(found["affine"].direction)) / np.linalg.norm(direction) - 1) < 1e-9  # 


def test_zero_energy_modes_are_marginal_and_thresholds_sit_on_the_line():
    """Seth–Hill at rest; Silling's model at any stretch; 2D, N = 2, m = −1 in compression: the threshold itself."""
    fam = pd.lattice_family(2, 2)
    states = [(seth_hill(m), 1.0) for m in (-1.0, 0.0, 1.0)] + [(pd.Correspondence(LINEAR), a) for a in (0.9, 1.0, 1.1)]
    for model, stretch in (*states, (seth_hill(-1.0), 0.99), (seth_hill(-1.0), 0.7)):
        found = judge(model, fam, stretch * np.eye(2), ("symbol",))["symbol"]
        assert found.verdict == "marginal"
        assert abs(float(found.margin)) < 1e-15 < float(found.tolerance)  # 
        corner = np.asarray(found.wave_vector) / np.pi
        assert corner.any() and np.max(np.abs(corner - np.rint(corner))) < 1e-6  # 
    assert float(closed_forms.hydrostatic_thresholds(2, 2)[0]) == pytest.approx(-1, abs=1e-14)
    for m, verdict in ((-1.001, "stable"), (-0.999, "unstable")):
        assert judge(seth_hill(m), fam, 0.99 * np.eye(2), ("symbol",))["symbol"].verdict == verdict


def test_verdicts_of_batches_and_of_nan():
    fam = pd.lattice_family(1, 3)
    stretches = jnp.array([0.9, 1.0, 1.1, jnp.nan])
    batch = jax.jit(jax.vmap(lambda s: criteria_of(s, fam)))(stretches)
    assert batch.verdict.tolist() == ["unstable", "marginal", "stable", "undefined"]


def criteria_of(stretch, fam):
    """Unchecked, as the drivers see it: a NaN deformation must come out as "undefined"."""
    from pdjax.criteria import Stability, evaluate, family_zone, margin_tolerance

    out = evaluate("symbol", seth_hill(1.0), fam, stretch * jnp.eye(1), family_zone(fam, "cubic", 4))
    tolerance = margin_tolerance(out.margin.dtype, out.scale)
    return Stability("symbol", out.margin, out.eigenvalue, out.mode, out.wave_vector, None, tolerance, 4)


# ---------------------------------------------------------------- at one point


@functools.cache
def point_case(dim, kind):
    """(found, peer, F, N) of one state for all criteria that look at a point."""
    N = FAMILIES[dim]
    F = 0.93 * np.eye(dim) if kind == "hydrostatic" else gradient(dim, 0.12, 21)
    fam = pd.lattice_family(dim, N, 0.5, pd.gaussian_influence)
    found = judge(seth_hill(0.6), fam, F, AT_A_POINT)
    state = seth_hill_state(dim, N, 0.6, omega=omega)
    return found, Peer(dim, N, F, state), F, N


def omega(r, horizon):
    """`pdjax.gaussian_influence` in NumPy."""
    return np.exp(-((2 * r / horizon) ** 2))


def weights(peer, N):
    return omega(np.linalg.norm(peer.xi, axis=1), N)


CASES = [(dim, kind) for dim in (1, 2, 3) for kind in ("hydrostatic", "general")]


@pytest.mark.parametrize(("dim", "kind"), CASES)
def test_diagonal_and_block(dim, kind):
    """D by complex steps of the reference's force at the moved centre (h = 1; D scales with 1/h², its unit too)."""
    found, _, F, N = point_case(dim, kind)

    def force(X, u):
        return ref.seth_hill_force(X, np.ones(len(X)), N, u, 0.6, LAM, MU, omega, rows=[0])

    X = ref.lattice_ball(dim, 2 * N)
    D = np.zeros((dim, dim))
    for j in range(dim):
        u = (X @ (F - np.eye(dim)).T).astype(complex)
        u[0, j] += 1e-30j
        D[:, j] = np.imag(force(X, u)[0]) / 1e-30
    unit = (LAM + 2 * MU) * 2 * dim
    values, vectors = np.linalg.eigh(D)
    assert abs(float(found["block"].margin) - values[-1] / unit) < 1e-13  # 
    assert abs(float(found["diagonal"].margin) - np.diag(D).max() / unit) < 1e-13  # 
    assert abs(float(found["block"].eigenvalue) - 4 * values[-1]) < 1e-12  # 
    assert np.asarray(found["diagonal"].mode)[np.argmax(np.diag(D))] == 1 or kind == "hydrostatic"
    if kind == "general":
        assert abs(abs(np.asarray(found["block"].mode) @ vectors[:, -1]) - 1) < 1e-12  # 
        assert dim == 1 or values[-1] > np.diag(D).max() + 1e-3  # the block sees more than its diagonal


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 2), (3, 1.5)])
def test_hydrostatic_diagonal_is_the_closed_form(dim, N):
    fam = pd.lattice_family(dim, N)
    for m, a in ((0.0, -0.05), (1.0, -0.3), (-1.0, 0.4)):
        F = (1 + a) * np.eye(dim)
        exact = closed_forms.lattice_diagonal(a, m, dim, N, LAM, MU)
        found = judge(seth_hill(m), fam, F, ("diagonal", "block"))
        for name in ("diagonal", "block"):
            assert abs(float(found[name].eigenvalue / exact) - 1) < 1e-12  # 


def quotient(peer, w, dY, unit):
    """−dT·dY over Σ w|dY|², scaled."""
    return -np.einsum("bi,bicj,cj->", dY, peer.C, dY) / np.sum(w[:, None] * dY**2) * unit


def material_unit(peer, w):
    """K₁₁/M, for which a uniaxial strain of the resting lattice has −1."""
    return np.sum(w * peer.xi[:, 0] ** 2) / (LAM + 2 * MU)


@pytest.mark.parametrize(("dim", "kind"), CASES)
def test_material_centre_and_neighbour(dim, kind):
    """dT·dY of the reference's C, for every direction of the centre and of every neighbour."""
    found, peer, _, N = point_case(dim, kind)
    w, bonds = weights(peer, N), len(peer.xi)
    unit = material_unit(peer, w)
    centre = -np.linalg.eigvalsh(np.einsum("bicj->ij", peer.C))[0] / np.sum(w) * unit
    each = [-np.linalg.eigvalsh(peer.C[b, :, b])[0] / w[b] * unit for b in range(bonds)]
    assert abs(float(found["material_center"].margin) - centre) < 1e-12  # 
    assert abs(float(found["material_neighbour"].margin) - max(each)) < 1e-12  # 
    # the modes are displacements whose own quotient is the margin
    e = np.asarray(found["material_center"].mode)
    assert abs(quotient(peer, w, np.broadcast_to(-e, (bonds, dim)), unit) - centre) < 1e-12  # 
    dY = in_peer_order(found["material_neighbour"].mode, dim, N, peer)
    assert np.count_nonzero(np.abs(dY).sum(axis=1)) == 1
    assert abs(quotient(peer, w, dY, unit) - max(each)) < 1e-12  # 


def in_peer_order(field, dim, N, peer):
    """A field on the package's bonds on the reference's."""
    xi = np.asarray(pd.lattice_family(dim, N).xi)
    return np.asarray(field)[[int(np.argmin(np.abs(xi - x).sum(axis=1))) for x in peer.xi]]


def rigid_fields(peer):
    """Translations and δY = ΩY, as columns."""
    dim = peer.xi.shape[1]
    fields = [np.broadcast_to(e, peer.Y.shape) for e in np.eye(dim)]
    for i in range(dim):
        for j in range(i):
            spin = np.zeros((dim, dim))
            spin[i, j], spin[j, i] = 1, -1
            fields.append(peer.Y @ spin.T)
    return np.stack([f.reshape(-1) for f in fields], axis=1)


def worst_free(peer, w, unit):
    """The generalised eigenproblem C z = −λ w z over dY that are w-orthogonal to the rigid fields, bonds of weight only."""
    dim = peer.xi.shape[1]
    live = np.repeat(w > 0, dim)
    mass = np.repeat(w, dim)[live]
    C = peer.C.reshape(len(live), len(live))[np.ix_(live, live)]
    basis = scipy.linalg.null_space((mass[:, None] * rigid_fields(peer)[live]).T)
    A = basis.T @ (C + C.T) @ basis / 2
    return -scipy.linalg.eigh(A, basis.T @ (mass[:, None] * basis), eigvals_only=True)[0] * unit


@pytest.mark.parametrize(("dim", "kind"), CASES)
def test_material_worst_case(dim, kind):
    found, peer, _, N = point_case(dim, kind)
    w = weights(peer, N)
    unit = material_unit(peer, w)
    exact = worst_free(peer, w, unit)
    assert abs(float(found["material"].margin) - exact) < 1e-12  # 
    dY = in_peer_order(found["material"].mode, dim, N, peer)
    assert abs(quotient(peer, w, dY, unit) - exact) < 1e-12  # 
    rigid = rigid_fields(peer)
    assert np.max(np.abs(np.repeat(w, dim) * dY.reshape(-1) @ rigid)) < 1e-12  # 
    assert float(found["material"].margin) > float(found["material_center"].margin) - 1e-12 or dim > 1


def test_unit_and_rotations_of_the_material_test():
    """A uniaxial strain at rest has −1. Under tension a rotation's own work is positive here; it is not counted."""
    peer = Peer(2, 2, np.eye(2), seth_hill_state(2, 2, 0.6, omega=omega))
    w = weights(peer, 2)
    strained = np.stack([peer.xi[:, 0], np.zeros(len(w))], axis=1)
    assert abs(quotient(peer, w, strained, material_unit(peer, w)) + 1) < 1e-12  # 
    _, pressed, _, N = point_case(2, "hydrostatic")
    spin = rigid_fields(pressed)[:, 2].reshape(-1, 2)
    w = weights(pressed, N)
    assert quotient(pressed, w, spin, material_unit(pressed, w)) > 0.01  # work of a rotation, no instability


@pytest.mark.parametrize("influence", [pd.linear_influence, pd.cubic_spline_influence])
def test_bonds_of_no_weight_do_not_count(influence):
    """Influences that vanish at the horizon: every margin is finite, and that of the family without those bonds."""
    N, F = 2, gradient(2, 0.1, 22)

    def without(r, horizon):
        return influence(r, jnp.asarray(2.0))

    # N = √3 has the bonds up to √2 alone; those of length 2 have weight 0
    full = judge(seth_hill(0.6), pd.lattice_family(2, N, influence=influence), F, AT_A_POINT)
    less = judge(seth_hill(0.6), pd.lattice_family(2, 3**0.5, influence=without), F, AT_A_POINT)
    for name in AT_A_POINT:
        assert abs(float(full[name].margin) - float(less[name].margin)) < 1e-12, name  # 
        assert np.all(np.isfinite(full[name].mode))


# ---------------------------------------------------------------- acoustic tensors


@pytest.mark.parametrize(("dim", "kind"), CASES)
def test_affine_is_the_ellipticity_of_the_energy_of_affine_maps(dim, kind):
    """−min over directions of N·∂²W·N, ∂²W contracted from the reference's C."""
    found, peer, _, _ = point_case(dim, kind)
    exact, direction = peer.long_wave_supremum()
    assert abs(float(found["affine"].margin) - exact) < 1e-12  # 
    assert abs(peer.long_wave(found["affine"].direction)[0] - exact) < 1e-12  # 
    assert not np.asarray(found["affine"].wave_vector).any() and direction.shape == (dim,)


def acoustic_supremum(fourth, M):
    """max over N of −λ_min(N·A·N)/M."""
    dim = fourth.shape[0]

    def value(n):
        n = n / np.linalg.norm(n, axis=1, keepdims=True)
        acoustic = np.einsum("iJkL,nJ,nL->nik", fourth, n, n)
        return -np.linalg.eigvalsh((acoustic + acoustic.swapaxes(1, 2)) / 2)[:, 0] / M

    n = random(dim, 23).normal(size=(300, dim))
    return climb(value, n[np.argsort(-value(n))[:8]], 0.1)[0]


def svk_tangent(F):
    """∂P/∂F of P = F (λ tr(E) I + 2μE): δ_ik S_JL + F_iM C_MJNL F_kN."""
    I = np.eye(len(F))
    E = (F.T @ F - I) / 2
    S = LAM * np.trace(E) * I + 2 * MU * E
    C = LAM * np.einsum("MJ,NL->MJNL", I, I) + MU * (np.einsum("MN,JL->MJNL", I, I) + np.einsum("ML,JN->MJNL", I, I))
    return np.einsum("ik,JL->iJkL", I, S) + np.einsum("iM,kN,MJNL->iJkL", F, F, C)


def neo_hookean_tangent(F):
    """∂P/∂F of P = μ(F − F⁻ᵀ) + λ log J F⁻ᵀ."""
    I, G, log_J = np.eye(len(F)), np.linalg.inv(F), np.log(np.linalg.det(F))
    rest = (MU - LAM * log_J) * np.einsum("Li,Jk->iJkL", G, G) + LAM * np.einsum("Ji,Lk->iJkL", G, G)
    return MU * np.einsum("ik,JL->iJkL", I, I) + rest


def hencky_tangent(F, m, step=2e-3):
    """∂²Ψ(E_m(F))/∂F² by fourth-order differences of the energy, E_m by eigenvectors in NumPy."""
    dim = len(F)

    def energy(G):
        squares, axes = np.linalg.eigh(G.T @ G)
        strain = np.log(squares) / 2 if m == 0 else (squares**m - 1) / (2 * m)
        E = axes @ np.diag(strain) @ axes.T
        return LAM * np.trace(E) ** 2 / 2 + MU * np.sum(E**2)

    stencil = [(-2, 1 / 12), (-1, -2 / 3), (1, 2 / 3), (2, -1 / 12)]
    fourth = np.zeros((dim,) * 4)
    for i, J, k, L in np.ndindex(*fourth.shape):
        one, two = np.zeros((dim, dim)), np.zeros((dim, dim))
        one[i, J], two[k, L] = step, step
        fourth[i, J, k, L] = sum(p * q * energy(F + a * one + b * two) for a, p in stencil for b, q in stencil) / step**2
    return fourth


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("law", ["seth-hill m=1", "svk", "neo-hookean", "seth-hill m=0", "seth-hill m=-0.7"])
def test_local_is_the_classical_acoustic_tensor(dim, law):
    """In closed form for m = 1 and the neo-Hookean law, where it is "affine" too; for other m the two differ."""
    model, tangent, exact = {
        "seth-hill m=1": (seth_hill(1.0), svk_tangent, True),
        "svk": (pd.Correspondence(LINEAR), svk_tangent, True),
        "neo-hookean": (MODELS["correspondence neo-hookean"], neo_hookean_tangent, True),
        "seth-hill m=0": (seth_hill(0.0), lambda F: hencky_tangent(F, 0.0), False),
        "seth-hill m=-0.7": (seth_hill(-0.7), lambda F: hencky_tangent(F, -0.7), False),
    }[law]
    if dim == 3 and law in ("svk", "seth-hill m=-0.7"):
        pytest.skip("shares its compiled function with none of the others")
    F = gradient(dim, 0.2, 24)
    found = judge(model, pd.lattice_family(dim, FAMILIES[dim]), F, ("local", "affine"))
    margin = acoustic_supremum(tangent(F), LAM + 2 * MU)
    assert abs(float(found["local"].margin) - margin) < (1e-12 if exact else 1e-7)  # 
    gap = abs(float(found["affine"].margin) - float(found["local"].margin))
    assert gap < 1e-12 if exact else gap > 1e-3  # 


# ---------------------------------------------------------------- the continuum


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_continuum_has_the_value_and_sign_of_gamma(dim):
    """λ = −2 S (1+a)^{2m−2} R γ(m) with R = 1 on unit bonds; zero at m_cr = 1 − d/2; blind to the discretisation."""
    fam = pd.lattice_family(dim, FAMILIES[dim])
    threshold = closed_forms.m_cr(dim)
    assert threshold == 1 - dim / 2
    for m in (threshold - 0.3, threshold, threshold + 0.2, 1.0, 0.0):
        for a in (-0.2, 0.1):
            strain = np.log1p(a) if m == 0 else ((1 + a) ** (2 * m) - 1) / (2 * m)
            stress = (dim * LAM + 2 * MU) * strain
            found = judge(seth_hill(m), fam, (1 + a) * np.eye(dim), ("continuum",))["continuum"]
            exact = closed_forms.continuum_diagonal(stress, a, m, dim, 1.0)
            assert abs(float(found.eigenvalue - exact)) < 1e-12  # 
            assert abs(float(found.margin - exact / (LAM + 2 * MU))) < 1e-12  # 
            gamma = float(closed_forms.gamma(m, dim))
            word = "marginal" if m == threshold else "unstable" if -a * gamma > 0 else "stable"
            assert found.verdict == word


# ---------------------------------------------------------------- derivatives

SMOOTH = ("symbol", "diagonal", "block", "material", "material_neighbour", "material_center", "affine", "continuum")


@functools.cache
def slopes():
    """Margins, their forward and reverse derivatives in (m, λ, μ, width), and central differences, at three states.

    One compiled function, vmapped over states and shifted parameters: jit, vmap, jacfwd and jacrev together.
    """

    def margins(p, F):
        m, lam, mu, width = p
        fam = pd.lattice_family(2, 2, influence=functools.partial(pd.gaussian_influence, width=width))
        model = pd.SethHill(m, pd.LinearElastic(lam, mu))
        return jnp.stack([pd.stability(model, fam, F, name).margin for name in SMOOTH])

    def everything(p, F):
        return margins(p, F), jax.jacfwd(margins)(p, F), jax.jacrev(margins)(p, F)

    step = 1e-5
    point = np.array([0.8, LAM, MU, 0.6])
    shifted = np.concatenate([[point], point + step * np.eye(4), point - step * np.eye(4)])
    states = np.stack([0.95 * np.eye(2), gradient(2, 0.08, 25), 1.05 * np.eye(2)])
    over_p = jax.vmap(everything, (0, None))
    values, forward, reverse = jax.jit(jax.vmap(over_p, (None, 0)))(shifted, states)
    return (values[:, 1:5] - values[:, 5:]).swapaxes(1, 2) / (2 * step), forward[:, 0], reverse[:, 0], values[:, 0]


@pytest.mark.parametrize("state", ["hydrostatic compression", "general", "hydrostatic tension"])
@pytest.mark.parametrize("name", SMOOTH)
def test_margins_differentiate_at_double_eigenvalues_too(name, state):
    """In m, λ, μ and the width of the influence, forward and reverse, against central differences."""
    i, c = ["hydrostatic compression", "general", "hydrostatic tension"].index(state), SMOOTH.index(name)
    central, forward, reverse, values = (x[i, c] for x in slopes())
    assert np.max(np.abs(forward - central)) < 1e-8  # 
    assert np.max(np.abs(reverse - forward)) < 1e-12  # 
    assert np.max(np.abs(forward)) > 1e-4  # nothing is differentiated away


def test_the_states_of_the_derivatives_are_what_they_are_meant_to_be():
    """Hydrostatic: both eigenvalues of the block agree, and in tension those of the symbol at its wave (π, π)."""
    fam = pd.lattice_family(2, 2, influence=functools.partial(pd.gaussian_influence, width=0.6))
    for stretch in (0.95, 1.05):
        D = np.asarray(pd.center_block(seth_hill(0.8), fam, stretch * np.eye(2)))
        assert np.max(np.abs(D - D[0, 0] * np.eye(2))) < 1e-13  # 
    found = judge(seth_hill(0.8), fam, 1.05 * np.eye(2), ("symbol",))["symbol"]
    assert np.max(np.abs(np.abs(found.wave_vector) - np.pi)) < 1e-6, found


def test_derivative_of_one_margin_without_jit():
    """`jax.grad` of a public call as it stands."""
    fam = pd.lattice_family(1, 3)

    def margin(m):
        return pd.stability(pd.SethHill(m, LINEAR), fam, 0.9 * np.eye(1), "diagonal").margin

    central = (margin(jnp.array(1.0 + 1e-5)) - margin(jnp.array(1.0 - 1e-5))) / 2e-5
    assert abs(float(jax.grad(margin)(jnp.array(1.0)) - central)) < 1e-9  # 


# ---------------------------------------------------------------- compiled once


def test_new_numbers_do_not_recompile():
    """Orders, constants, deformations of the same symmetry, influences, spacings: one trace of a user's law."""
    traces = []

    def counted(E, c):
        traces.append(1)
        return 0.5 * c["lam"] * jnp.trace(E) ** 2 + c["mu"] * jnp.sum(E * E)

    def look(m, lam, stretch, spacing, width):
        law = pd.EnergyLaw(counted, "E", {"lam": jnp.asarray(lam), "mu": jnp.asarray(0.7)})
        fam = pd.lattice_family(1, 2, spacing, functools.partial(pd.gaussian_influence, width=width))
        return pd.stability(pd.SethHill(m, law), fam, stretch * np.eye(1))

    first = look(1.0, 1.3, 0.9, 1.0, 0.5)
    count = len(traces)
    assert count > 0
    again = [look(m, 0.2, 1.1, 0.5, 0.8) for m in (-0.5, 0.0, 2.0)]
    assert len(traces) == count
    assert len({float(s.margin) for s in (first, *again)}) == 4


# ---------------------------------------------------------------- single precision


def test_float32_says_what_it_can_not_resolve():
    """The same verdicts beyond its tolerance, "marginal" within it, and a line about it; float64 has no such line."""
    judged = []
    for wide in (True, False):
        with enable_x64(wide):
            fam = pd.lattice_family(1, 2)
            model = pd.SethHill(1.0, pd.LinearElastic(1.3, 0.7))
            judged.append([pd.stability(model, fam, s * np.eye(1)) for s in (0.99, 1 - 1e-6, 1.01)])
    double, single = judged
    assert [s.verdict for s in double] == ["unstable", "unstable", "stable"]
    assert [s.verdict for s in single] == ["unstable", "marginal", "stable"]
    for exact, coarse in zip(double, single, strict=True):
        assert coarse.margin.dtype == coarse.eigenvalue.dtype == jnp.float32 and exact.margin.dtype == jnp.float64
        assert abs(float(coarse.margin) - float(exact.margin)) < 1e-6 < float(coarse.tolerance)  # 
        assert "float32: margins within ±3.1e-05 can't be told from zero" in str(coarse)
        assert "float32" not in str(exact) and exact.verdict in str(exact) and "wave vector" in str(exact)


# ---------------------------------------------------------------- wrong use


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"criterion": "bloch"}, "criterion must be one of diagonal, block"),
        ({"F": -np.eye(2)[::-1]}, "det F > 0"),
        ({"F": np.eye(3)}, "F must be"),
        ({"fam": pd.lattice_family(2, 1)}, "shape tensor"),
        ({"model": EnergyOnly(MODELS["seth_hill m=1"]), "criterion": "local"}, "no classical law"),
        ({"model": EnergyOnly(MODELS["seth_hill m=1"]), "criterion": "continuum"}, "point state"),
    ],
)
def test_wrong_use_names_the_argument(change, named):
    use = {"model": MODELS["seth_hill m=1"], "fam": pd.lattice_family(2, 2), "F": np.eye(2), "criterion": "diagonal"}
    with pytest.raises(ValueError, match=named):
        pd.stability(**(use | change))
