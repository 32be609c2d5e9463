"""Tests of the stability criteria against NumPy: brute force over waves, quotients, closed forms and differences.

The comment beside a tolerance is the largest measured error (float64).
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
from pdjax.studies import closed_forms

try:
    from jax import enable_x64
except ImportError:  # jax < 0.8
    from jax.experimental import enable_x64

AT_A_POINT = ("diagonal", "block", "material_center", "material_neighbour", "material", "affine", "continuum")
FAMILIES = {1: 3, 2: 2, 3: 1.5}


@eqx.filter_jit
def judge(model, fam, F, names):
    """{criterion: Stability}, all in one compiled function. F is traced, so that the whole zone is searched."""
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
    """The margin is the supremum over k ≠ 0 and the limit k → 0 of λ_max/(M κ²), and the reported wave is a mode."""
    over_waves, over_limits = peer.supremum(peer.quotient, 32)[0], peer.long_wave_supremum()[0]
    exact = max(over_waves, over_limits)
    assert abs(float(found.margin) - exact) < 1e-9 * max(abs(exact), 1e-2)  # 2e-15
    k, mode, value = (np.asarray(x) for x in (found.wave_vector, found.mode, found.eigenvalue))
    assert found.verdict == ("unstable" if exact > 0 else "stable") and abs(exact) > 1e-4
    assert abs(np.linalg.norm(mode) - 1) < 1e-12  # 5e-16
    J = peer.symbol(k)[0]
    assert np.max(np.abs(J @ mode - value * mode)) < 1e-6 * np.max(np.abs(J)) + 1e-9  # 1e-14
    if exact > 0:
        assert abs(value / peer.supremum(peer.top, 32)[0] - 1) < 1e-9  # 9e-15: the wave that grows fastest
    else:
        assert abs(peer.quotient(k)[0] - exact) < 1e-12  # 2e-16: the wave of the margin
    assert difference(np.abs(found.direction), np.abs(k) / np.linalg.norm(k)) < 1e-8  # 5e-10: k is turned into the zone


@pytest.mark.parametrize("name", HYDROSTATIC)
def test_margin_is_the_supremum_over_waves_and_the_limit(name):
    dim, m, stretch = HYDROSTATIC[name]
    N, F = FAMILIES[dim], stretch * np.eye(dim)
    found = judge(seth_hill(m), pd.lattice_family(dim, N), F, ("symbol",))["symbol"]
    check_waves(found, Peer(dim, N, F, seth_hill_state(dim, N, m)))


@pytest.mark.parametrize("dim", [1, 3])
def test_margin_under_a_general_deformation_is_the_supremum(dim):
    N = FAMILIES[dim]
    for i, m in enumerate((-0.7, 0.2, 1.5)):
        F = gradient(dim, 0.15, 20, i)
        found = judge(seth_hill(m), pd.lattice_family(dim, N), F, ("symbol",))["symbol"]
        check_waves(found, Peer(dim, N, F, seth_hill_state(dim, N, m)))


def test_the_limit_of_long_waves_can_be_the_margin():
    """Silling's model has it where its law is no longer elliptic. For long waves k² exceeds the sin² of a wave."""
    F = np.diag([0.5, 0.7])
    found = judge(pd.Correspondence(LINEAR), pd.lattice_family(2, 2), F, ("symbol", "affine"))
    peer = Peer(2, 2, F, correspondence_state(2, 2))
    exact, direction = peer.long_wave_supremum()
    assert found["symbol"].verdict == "unstable"
    for name in ("symbol", "affine"):
        assert abs(float(found[name].margin) - exact) < 1e-12  # 2e-16
    assert peer.supremum(peer.quotient, 32)[0] < exact
    # An unstable state reports its fastest wave. The limit k → 0 does not grow.
    fastest, k = peer.supremum(peer.top, 64)
    assert abs(float(found["symbol"].eigenvalue) / fastest - 1) < 1e-9  # 3e-16
    assert difference(np.abs(found["symbol"].wave_vector), np.abs(k)) < 1e-5  # 3e-9: flat at a maximum
    assert abs(abs(direction @ np.asarray(found["affine"].direction)) / np.linalg.norm(direction) - 1) < 1e-9  # 0


def test_a_stable_state_can_have_its_margin_in_the_limit():
    """The law softens, so that P' = C F² + S is below the stress that stabilises the short waves. The wave of the
    margin then has λ = 0 and k = 0."""
    law = pd.EnergyLaw(lambda E, c: jnp.sum(E * E) / 2 - c * jnp.trace(E) ** 3, "E", jnp.array(0.6))
    F, E = 1.6**0.5, 0.3
    S, C = E - 3 * 0.6 * E**2, 1 - 6 * 0.6 * E
    found = judge(pd.SethHill(jnp.array(1.0), law), pd.lattice_family(1, 3), np.array([[F]]), ("symbol",))["symbol"]
    assert C < 0 and abs(float(found.margin) + C * F**2 + S) < 1e-12
    # Rounding decides between the limit (k = 0) and a wave of |k| = 5e-9 next to it.
    assert found.verdict == "stable" and np.abs(found.wave_vector).max() < 1e-6 and abs(float(found.eigenvalue)) < 1e-12


def test_zero_energy_modes_and_threshold_orders_are_marginal():
    """Seth–Hill models at rest and Silling's model at any stretch have zero-energy modes. In 2D with N = 2, m = −1 is
    the threshold order in compression."""
    fam = pd.lattice_family(2, 2)
    states = [(seth_hill(m), 1.0) for m in (-1.0, 0.0, 1.0)] + [(pd.Correspondence(LINEAR), a) for a in (0.9, 1.0, 1.1)]
    for model, stretch in (*states, (seth_hill(-1.0), 0.99), (seth_hill(-1.0), 0.7)):
        names = ("symbol",) if isinstance(model, pd.SethHill) else ("symbol", "affine")  # These are compiled already.
        found = judge(model, fam, stretch * np.eye(2), names)["symbol"]
        assert found.verdict == "marginal"
        assert abs(float(found.margin)) < 1e-15 < float(found.tolerance)  # 2e-16
        # The zero-energy modes are the half-reciprocal points. Silling's model has in addition all waves with
        # Σ ξ sin k·ξ = 0, such as 3 sin k + 2 sin 2k = 0 along an axis, cos k = ¼ along an edge and cos k = −1/6 along
        # the diagonal.
        k, xi = np.asarray(found.wave_vector), np.asarray(fam.xi)
        corner = np.max(np.abs(k / np.pi - np.rint(k / np.pi)))
        unseen = isinstance(model, pd.Correspondence) and np.abs(np.sin(xi @ k) @ xi).max() < 1e-6  # 4e-16
        assert k.any() and (corner < 1e-6 or unseen)  # 0
    assert float(closed_forms.hydrostatic_thresholds(2, 2)[0]) == pytest.approx(-1, abs=1e-14)
    for m, verdict in ((-1.001, "stable"), (-0.999, "unstable")):
        assert judge(seth_hill(m), fam, 0.99 * np.eye(2), ("symbol",))["symbol"].verdict == verdict


def test_verdicts_of_batches_and_of_nan():
    def look(stretch):
        return pd.stability(seth_hill(1.0), pd.lattice_family(1, 3), stretch * jnp.eye(1), "continuum")

    batch = jax.jit(jax.vmap(look))(jnp.array([0.9, 1.0, 1.1]))
    assert batch.verdict.tolist() == ["unstable", "marginal", "stable"]
    # A path can have no state at a load. The margin is NaN there and the verdict "undefined".
    assert eqx.tree_at(lambda s: s.margin, batch, jnp.array([jnp.nan, 1.0, jnp.nan])).verdict.tolist() == [
        "undefined",
        "unstable",
        "undefined",
    ]


# ---------------------------------------------------------------- at one point


INFLUENCES = {
    "gaussian": (pd.gaussian_influence, lambda r, horizon: np.exp(-((2 * r / horizon) ** 2))),
    "linear": (pd.linear_influence, lambda r, horizon: 1 - r / horizon),  # zero on the outermost bonds
}
CASES = [
    (2, "hydrostatic", "gaussian"),
    (2, "general", "gaussian"),
    (2, "general", "linear"),
    (3, "general", "gaussian"),
]
cases = pytest.mark.parametrize(("dim", "kind", "influence"), CASES)


@functools.cache
def point_case(dim, kind, influence):
    """(found, peer, w, unit) of one state for all criteria of a point. K₁₁/M is the unit of dT·dY."""
    N, (traced, omega) = FAMILIES[dim], INFLUENCES[influence]
    F = 0.93 * np.eye(dim) if kind == "hydrostatic" else gradient(dim, 0.12, 21)
    found = judge(seth_hill(0.6), pd.lattice_family(dim, N, 0.5, traced), F, AT_A_POINT)
    peer = Peer(dim, N, F, seth_hill_state(dim, N, 0.6, omega=omega))
    w = omega(np.linalg.norm(peer.xi, axis=1), N)
    return found, peer, w, np.sum(w * peer.xi[:, 0] ** 2) / (LAM + 2 * MU)


@cases
def test_diagonal_and_block(dim, kind, influence):
    """They agree with D by complex steps of the force of the reference. D and its unit scale with 1/h²."""
    (found, peer, _, _), N = point_case(dim, kind, influence), FAMILIES[dim]
    X = ref.lattice_ball(dim, 2 * N)
    F = np.linalg.lstsq(peer.xi, peer.Y, rcond=None)[0].T
    D = np.zeros((dim, dim))
    for j in range(dim):
        u = (X @ (F - np.eye(dim)).T).astype(complex)
        u[0, j] += 1e-30j
        force = ref.seth_hill_force(X, np.ones(len(X)), N, u, 0.6, LAM, MU, INFLUENCES[influence][1], rows=[0])
        D[:, j] = np.imag(force[0]) / 1e-30
    unit = (LAM + 2 * MU) * 2 * dim
    values, vectors = np.linalg.eigh(D)
    assert abs(float(found["block"].margin) - values[-1] / unit) < 1e-13  # 1e-16
    assert abs(float(found["diagonal"].margin) - np.diag(D).max() / unit) < 1e-13  # 9e-17
    assert abs(float(found["block"].eigenvalue) - 4 * values[-1]) < 1e-12  # 8e-15
    if kind == "general":
        assert np.asarray(found["diagonal"].mode)[np.argmax(np.diag(D))] == 1
        assert abs(abs(np.asarray(found["block"].mode) @ vectors[:, -1]) - 1) < 1e-12  # 7e-16
        assert values[-1] > np.diag(D).max() + 1e-3  # The block exceeds its diagonal.


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_hydrostatic_diagonal_and_continuum_are_the_closed_forms(dim):
    """They are `lattice_diagonal`, and −2 S (1+a)^{2m−2} R γ(m) with R = 1 on unit bonds, zero at m_cr = 1 − d/2."""
    N, threshold = FAMILIES[dim], closed_forms.m_cr(dim)
    fam = pd.lattice_family(dim, N)
    assert threshold == 1 - dim / 2
    for m in (threshold - 0.3, threshold, threshold + 0.2, 1.0, 0.0):
        for a in (-0.2, 0.1):
            names = AT_A_POINT if dim > 1 else ("diagonal", "block", "continuum")
            found = judge(seth_hill(m), fam, (1 + a) * np.eye(dim), names)
            exact = closed_forms.lattice_diagonal(a, m, dim, N, LAM, MU)
            for name in ("diagonal", "block"):
                assert abs(float(found[name].eigenvalue - exact)) < 1e-12 * max(1, abs(float(exact)))  # 9e-15
            strain = np.log1p(a) if m == 0 else ((1 + a) ** (2 * m) - 1) / (2 * m)
            gamma = float(closed_forms.gamma(m, dim))
            exact = float(closed_forms.continuum_diagonal((dim * LAM + 2 * MU) * strain, a, m, dim, 1.0))
            assert abs(float(found["continuum"].eigenvalue) - exact) < 1e-12  # 1e-13
            assert abs(float(found["continuum"].margin) - exact / (LAM + 2 * MU)) < 1e-12  # 4e-14
            word = "marginal" if m == threshold else "unstable" if -a * gamma > 0 else "stable"
            assert found["continuum"].verdict == word


def quotient(peer, w, dY, unit):
    """−dT·dY over Σ w|dY|², in units of M/K₁₁."""
    return -np.einsum("bi,bicj,cj->", dY, peer.C, dY) / np.sum(w[:, None] * dY**2) * unit


def in_peer_order(field, dim, peer):
    """A field on the bonds of the package, in the order of the bonds of the reference."""
    xi = np.asarray(pd.lattice_family(dim, FAMILIES[dim]).xi)
    return np.asarray(field)[[int(np.argmin(np.abs(xi - x).sum(axis=1))) for x in peer.xi]]


@cases
def test_material_centre_and_neighbour(dim, kind, influence):
    """They agree with dT·dY from C of the reference, over all directions of the centre and of every neighbour."""
    found, peer, w, unit = point_case(dim, kind, influence)
    centre = -np.linalg.eigvalsh(np.einsum("bicj->ij", peer.C))[0] / np.sum(w) * unit
    each = max(-np.linalg.eigvalsh(peer.C[b, :, b])[0] / w[b] * unit for b in np.flatnonzero(w > 1e-12))
    assert abs(float(found["material_center"].margin) - centre) < 1e-12  # 1e-16
    assert abs(float(found["material_neighbour"].margin) - each) < 1e-12  # 5e-16
    # The quotient of each mode is the margin.
    e = np.broadcast_to(-np.asarray(found["material_center"].mode), peer.xi.shape)
    assert abs(quotient(peer, w, e, unit) - centre) < 1e-12  # 1e-16
    dY = in_peer_order(found["material_neighbour"].mode, dim, peer)
    assert np.count_nonzero(np.abs(dY).sum(axis=1)) == 1
    assert abs(quotient(peer, w, dY, unit) - each) < 1e-12  # 5e-16


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


@cases
def test_material_worst_case(dim, kind, influence):
    """It agrees with the generalised eigenproblem C z = −λ w z over the dY that are w-orthogonal to rigid motions."""
    found, peer, w, unit = point_case(dim, kind, influence)
    live, rigid = np.repeat(w > 1e-12, dim), rigid_fields(peer)
    assert live.all() == (influence != "linear")
    mass = np.repeat(w, dim)[live]
    C = peer.C.reshape(len(live), len(live))[np.ix_(live, live)]
    basis = scipy.linalg.null_space((mass[:, None] * rigid[live]).T)
    A, B = basis.T @ (C + C.T) @ basis / 2, basis.T @ (mass[:, None] * basis)
    exact = -scipy.linalg.eigh(A, B, eigvals_only=True)[0] * unit
    assert abs(float(found["material"].margin) - exact) < 1e-12  # 4e-16
    dY = in_peer_order(found["material"].mode, dim, peer)
    assert abs(quotient(peer, w, dY, unit) - exact) < 1e-12  # 4e-16
    assert np.max(np.abs((np.repeat(w, dim) * dY.reshape(-1)) @ rigid)) < 1e-12  # 1e-15
    assert not dY[w <= 1e-12].any()


def test_unit_and_rotations_of_the_material_test():
    """A uniaxial strain at rest has the margin −1. A rotation under compression has dT·dY < 0 and is excluded."""
    _, pressed, w, unit = point_case(2, "hydrostatic", "gaussian")
    rest = Peer(2, 2, np.eye(2), seth_hill_state(2, 2, 0.6, omega=INFLUENCES["gaussian"][1]))
    strained = np.stack([rest.xi[:, 0], np.zeros(len(w))], axis=1)
    assert abs(quotient(rest, w, strained, unit) + 1) < 1e-12  # 3e-16
    spin = rigid_fields(pressed)[:, 2].reshape(-1, 2)
    assert quotient(pressed, w, spin, unit) > 0.01  # 0.109


# ---------------------------------------------------------------- acoustic tensors


@cases
def test_affine_is_the_ellipticity_of_the_energy_of_affine_maps(dim, kind, influence):
    """It is −min over directions N of λ_min(N·∂²W·N), with ∂²W contracted from C of the reference."""
    found, peer, _, _ = point_case(dim, kind, influence)
    exact, direction = peer.long_wave_supremum()
    assert abs(float(found["affine"].margin) - exact) < 1e-12  # 2e-16
    assert abs(peer.long_wave(found["affine"].direction)[0] - exact) < 1e-12  # 3e-16
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
        fourth[i, J, k, L] = (
            sum(p * q * energy(F + a * one + b * two) for a, p in stencil for b, q in stencil) / step**2
        )
    return fourth


@pytest.mark.parametrize(
    ("dim", "law"), [(2, "m=1"), (2, "m=0"), (2, "m=-0.7"), (3, "m=1"), (3, "m=0"), (2, "svk"), (2, "neo-hookean")]
)
def test_local_is_the_classical_acoustic_tensor(dim, law):
    """It agrees with closed forms for m = 1 and laws of F, and for other m with differences of the classical energy."""
    model, tangent = {
        "m=1": (seth_hill(1.0), svk_tangent),
        "m=0": (seth_hill(0.0), lambda F: hencky_tangent(F, 0.0)),
        "m=-0.7": (seth_hill(-0.7), lambda F: hencky_tangent(F, -0.7)),
        "svk": (pd.Correspondence(LINEAR), svk_tangent),
        "neo-hookean": (MODELS["correspondence neo-hookean"], neo_hookean_tangent),
    }[law]
    F = gradient(dim, 0.2, 24)
    found = judge(model, pd.lattice_family(dim, FAMILIES[dim]), F, ("local",))["local"]
    margin = acoustic_supremum(tangent(F), LAM + 2 * MU)
    tolerance = 1e-7 if law in ("m=0", "m=-0.7") else 1e-12
    assert abs(float(found.margin) - margin) < tolerance  # 9e-11 by differences, 2e-15 in closed form
    if "m=" in law:  # For Seth–Hill models "local" equals "affine" for m = 1 only.
        affine = judge(model, pd.lattice_family(dim, FAMILIES[dim]), F, AT_A_POINT)["affine"]
        gap = abs(float(affine.margin) - float(found.margin))
        assert gap < 1e-12 if law == "m=1" else gap > 1e-3  # 2e-16; 0.02 at least


# ---------------------------------------------------------------- derivatives

SMOOTH = ("symbol", "block", "material", "affine")
BACKWARD = 2  # The first two are tested in reverse mode too, which compiles slowly.
LOADED = {"hydrostatic compression": 0.95 * np.eye(2), "hydrostatic tension": 1.05 * np.eye(2)}
LOADED["general"] = gradient(2, 0.08, 25)
PARAMETERS = np.array([0.8, LAM, MU, 0.6])  # m, λ, μ, width of the Gaussian influence in horizons


@functools.cache
def slopes():
    """Central differences of the margins in the parameters, and their derivatives by forward and reverse mode.

    A single compiled function combines jit, vmap over states and shifted parameters, jacfwd and jacrev.
    """

    def margins(p, F, names=SMOOTH):
        fam = pd.lattice_family(2, 2, influence=functools.partial(pd.gaussian_influence, width=p[3]))
        return jnp.stack([pd.stability(seth_hill(*p[:3]), fam, F, name).margin for name in names])

    def everything(p, F):
        backward = jax.jacrev(lambda p: margins(p, F, SMOOTH[:BACKWARD]))
        return margins(p, F), jax.jacfwd(margins)(p, F), backward(p)

    step = 1e-5
    shifted = np.concatenate([[PARAMETERS], PARAMETERS + step * np.eye(4), PARAMETERS - step * np.eye(4)])
    over_p = jax.vmap(everything, (0, None))
    values, forward, reverse = jax.jit(jax.vmap(over_p, (None, 0)))(shifted, np.stack(list(LOADED.values())))
    return (values[:, 1:5] - values[:, 5:]).swapaxes(1, 2) / (2 * step), forward[:, 0], reverse[:, 0]


@pytest.mark.parametrize("state", LOADED)
@pytest.mark.parametrize("name", SMOOTH)
def test_margins_differentiate_at_double_eigenvalues_too(name, state):
    """Forward and reverse derivatives in m, λ, μ and the width of the influence agree with central differences."""
    i, c = list(LOADED).index(state), SMOOTH.index(name)
    central, forward, reverse = (x[i] for x in slopes())
    assert np.max(np.abs(forward[c] - central[c])) < 1e-8  # 6e-10, of the difference
    assert np.max(np.abs(forward[c])) > 1e-3  # 0.04 at least, so that no derivative is lost
    if c < BACKWARD:
        assert np.max(np.abs(reverse[c] - forward[c])) < 1e-13  # 2e-16


def test_hydrostatic_states_have_double_eigenvalues():
    """The state of the test above is at a double eigenvalue: at its wave (π, π) the symbol is a multiple of I."""
    fam = pd.lattice_family(2, 2, influence=functools.partial(pd.gaussian_influence, width=PARAMETERS[3]))
    found = judge(seth_hill(*PARAMETERS[:3]), fam, LOADED["hydrostatic tension"], ("symbol",))["symbol"]
    k = np.asarray(found.wave_vector)
    assert np.max(np.abs(np.abs(k) - np.pi)) < 1e-6  # 0
    state = seth_hill_state(2, 2, *PARAMETERS[:3], omega=lambda r, d: np.exp(-((r / (PARAMETERS[3] * d)) ** 2)))
    J = Peer(2, 2, LOADED["hydrostatic tension"], state).symbol(k)[0]
    assert np.max(np.abs(J - J[0, 0] * np.eye(2))) < 1e-9  # 3e-16


# ---------------------------------------------------------------- compiled once


def test_new_numbers_do_not_recompile():
    """New orders, constants, deformations of the same symmetry, influences and spacings do not trace the law again."""
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


def test_float32_reports_the_margins_that_it_cannot_resolve():
    """The verdicts are those of float64 beyond the tolerance and "marginal" within it. Only float32 prints a line about
    it."""
    judged = []
    for wide, resolution in ((True, 10), (False, 12)):  # JAX keeps the dtype of a grid.
        with enable_x64(wide):
            fam, model = pd.lattice_family(1, 2), pd.SethHill(1.0, pd.LinearElastic(1.3, 0.7))
            judged.append(
                [pd.stability(model, fam, s * np.eye(1), "symbol", resolution) for s in (0.99, 1 - 1e-6, 1.01)]
            )
    double, single = judged
    assert [s.verdict for s in double] == ["unstable", "unstable", "stable"]
    assert [s.verdict for s in single] == ["unstable", "marginal", "stable"]
    for exact, coarse in zip(double, single, strict=True):
        assert coarse.margin.dtype == coarse.eigenvalue.dtype == jnp.float32 and exact.margin.dtype == jnp.float64
        assert abs(float(coarse.margin) - float(exact.margin)) < 1e-6 < float(coarse.tolerance)  # 7e-9
        assert "float32: margins within ±3.1e-05 can't be told from zero" in str(coarse)
        assert "float32" not in str(exact) and exact.verdict in str(exact) and "wave vector" in str(exact)


# ---------------------------------------------------------------- wrong use


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"criterion": "bloch"}, "criterion must be one of diagonal, block"),
        ({"F": -np.eye(2)[::-1]}, "det F > 0"),
        ({"F": np.eye(3)}, "F must be"),
        ({"family": pd.lattice_family(2, 1)}, "shape tensor"),
        ({"model": EnergyOnly(MODELS["seth_hill m=1"]), "criterion": "local"}, "no classical law"),
        ({"model": EnergyOnly(MODELS["seth_hill m=1"]), "criterion": "continuum"}, "point state"),
    ],
)
def test_wrong_use_names_the_argument(change, named):
    use = {"model": MODELS["seth_hill m=1"], "family": pd.lattice_family(2, 2), "F": np.eye(2), "criterion": "diagonal"}
    with pytest.raises(ValueError, match=named):
        pd.stability(**(use | change))
