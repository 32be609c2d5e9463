"""Known properties of single models, and measurements of what they do not promise.

The invariants of all models are in `test_models.py`. The comment beside each tolerance is the measured value (float64).
"""

from math import pi

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
import reference_models as peers
from bodies import worst
from table import LINEAR, MODELS, NEO_HOOKEAN

import pdjax as pd
from pdjax.force.fields import check_model, each_point
from pdjax.models.base import Sums
from pdjax.models.control import SillingControl, WanControl
from pdjax.models.with_law import tangent_at_rest

CLOUD, POINTS = bodies.families(2, "cloud"), bodies.points(2, "cloud")
U = bodies.displacement(2, "cloud", 70)


def moment(u, force):
    """Σ V x × f."""
    x = POINTS.positions + u
    return POINTS.volumes @ (x[:, 0] * force[:, 1] - x[:, 1] * force[:, 0])


def asymmetry(jacobian):
    """The asymmetry of V J, relative to its largest entry."""
    VJ = np.repeat(POINTS.volumes, 2)[:, None] * jacobian
    return worst(VJ, VJ.T) / np.abs(VJ).max()


# ---------------------------------------------------------------- what is not promised


def test_wans_control_is_not_objective_on_a_cloud():
    model, Q = MODELS["wan control"], bodies.rotation(2, 70)
    before = bodies.respond(model, CLOUD, U)
    after = bodies.respond(model, CLOUD, (POINTS.positions + U) @ Q.T - POINTS.positions)
    assert not model.objective and not model.balances_moments
    assert worst(after.force, before.force @ Q.T) / worst(before.force) > 0.01  # 0.041
    assert abs(after.energy / before.energy - 1) > 1e-3  # 0.0042
    assert abs(moment(U, before.force)) / worst(before.force) > 1e-4  # 6e-4


def test_wans_control_is_objective_inside_a_lattice():
    """Inside a lattice K is a multiple of I, and so is C₁."""
    fam, Q, model = pd.lattice_family(2, 2), bodies.rotation(2, 71), MODELS["wan control"]
    bonds = fam.bonds(jnp.eye(2))
    eta = 0.2 * bodies.random(71).normal(size=fam.xi.shape)
    turned = (np.asarray(fam.xi) + eta) @ Q.T - np.asarray(fam.xi)
    one, two = (model.energy(bonds._replace(eta=jnp.asarray(e))) for e in (eta, turned))
    assert abs(two / one - 1) < 1e-13  # 0


@pytest.mark.parametrize("name, least", [("littlewood control", 0.02), ("bond_associated force", 0.04)])
def test_forces_without_an_energy_have_no_symmetric_jacobian(name, least):
    """On a cloud the asymmetry of V J is 0.044 and 0.089; inside a lattice the symbol is symmetric nevertheless."""
    assert asymmetry(bodies.respond(MODELS[name], CLOUD, U).jacobian) > least
    F, k = jnp.asarray(bodies.deformation(2, 71)), bodies.random(71).uniform(-3, 3, (5, 2))
    J = np.asarray(pd.symbol(MODELS[name], pd.lattice_family(2, 2, 0.5, pd.gaussian_influence), F, k))
    assert worst(J, J.swapaxes(1, 2)) / np.abs(J).max() < 1e-14  # 1e-16


def test_the_bond_associated_force_exerts_a_moment():
    """Its bonds pull along P_b K_b⁻¹ ξ_b, so Σ T × Y is not zero. The energy-consistent model has no moment."""
    for name, expected in (("bond_associated force", 0.5), ("bond_associated", 0.0)):
        force = bodies.respond(MODELS[name], CLOUD, U).force
        assert abs(abs(moment(U, force)) / worst(force) - expected) < 0.05  # 0.52, 1e-15


MODULI = jax.jit(lambda model, fam: jax.jacfwd(lambda F: pd.piola_stress(model, fam, F))(jnp.eye(fam.dim)))


def cubic_moduli(model, fam):
    """k = ℂ_iijj/d², and the two shear moduli of a cubic solid: ℂ₁₂₁₂ and (ℂ₁₁₁₁ − ℂ₁₁₂₂)/2."""
    C = np.asarray(MODULI(model, fam))
    return np.einsum("iijj->", C) / fam.dim**2, C[0, 1, 0, 1], (C[0, 0, 0, 0] - C[0, 0, 1, 1]) / 2


@pytest.mark.parametrize(
    "N, lps, springs", [(2, (0.4, 1.0), (0.480566, 1.019434)), (3, (0.675294, 0.724706), (0.724252, 0.775748))]
)
def test_moduli_are_off_by_the_anisotropy_of_the_lattice(N, lps, springs):
    """k is exact. The two shear moduli of LPS are 0.4 and 1.0 instead of 0.7 at N = 2, and 0.675 and 0.725 at N = 3.

    In 2D the mean of the two is G. The G of the bond-based model is k/2 = 0.75. ω is 1.
    """
    fam = pd.lattice_family(2, N)
    k, *shear = cubic_moduli(pd.LPS(1.5, 0.7), fam)
    assert worst(k, 1.5) < 1e-14  # 0
    assert worst(shear, lps) < 1e-6 and worst(np.mean(shear), 0.7) < 1e-14  # 0
    k, *shear = cubic_moduli(pd.BondBased.from_family(1.5, fam), fam)
    assert worst(k, 1.5) < 1e-14  # 4e-16
    assert worst(shear, springs) < 1e-6 and worst(np.mean(shear), 0.75) < 1e-14  # 2e-16
    k, *shear = cubic_moduli(pd.TupekRadovitzky(0.4, LINEAR), fam)
    assert worst(k, 2.0) < 1e-14  # 0
    assert abs(shear[0] - shear[1]) > 0.15  # 0.93 and 0.18


def test_bond_associated_force_is_not_the_laws_stress():
    """Σ V T⊗ξ is α P with α = 1.086 in 1D (N = 3, ω = 1), so the model promises no modulus."""
    assert not MODELS["bond_associated force"].moduli_exact and not MODELS["bond_associated force"].affine_exact
    C = MODULI(MODELS["bond_associated force"], pd.lattice_family(1, 3))[0, 0, 0, 0]
    assert worst(C / 2.7, 1.0861320) < 1e-6


def test_extended_correspondence_is_wrong_at_a_surface():
    """For m = 1 under an affine map Ē is exact with the family's own L, and far off with the L of a full ball."""
    F = bodies.deformation(2, 72, size=0.2)
    E, u = peers.green(F), POINTS.positions @ (F - np.eye(2)).T
    right, wrong = (bodies.respond(kind(1.0, LINEAR), CLOUD, u).strain for kind in (pd.SethHill, pd.TupekRadovitzky))
    assert worst(right, np.broadcast_to(E, right.shape)) < 1e-14  # 1e-16
    assert worst(wrong, np.broadcast_to(E, wrong.shape)) / worst(E) > 0.3  # 0.76


# ---------------------------------------------------------------- units, constants


@pytest.mark.parametrize("name", ["wan control", "silling control", "littlewood control"])
def test_lengths_cancel_in_the_controls(name):
    """With all lengths times 1000, f (pressure over length) is a thousandth: no constant of a control has a unit."""
    s = 1000.0
    scaled = pd.cloud(s * POINTS.positions, s**2 * POINTS.volumes)
    fams = bodies.padded(pd.families(scaled, s * bodies.HORIZONS[2], pd.gaussian_influence), 14)
    force = bodies.respond(MODELS[name], CLOUD, U).force
    assert worst(s * bodies.respond(MODELS[name], fams, s * U).force, force) / worst(force) < 1e-12  # 1e-15


def equal_g(dim, N):
    """The g at which Silling's control equals Wan's on a lattice family with ω = 1."""
    bonds = pd.lattice_family(dim, N).bonds(jnp.eye(dim))
    tangent = tangent_at_rest(LINEAR, dim, float)
    K = pd.shape_tensor_K(bonds)
    sums = Sums(K, jnp.zeros_like(K), bonds.horizon, len(K))
    C1 = WanControl().state(sums, tangent)[1]
    assert worst(C1, C1[0, 0] * np.eye(dim)) / C1[0, 0] < 1e-14  # 0
    return float(C1[0, 0] / SillingControl(1.0).state(sums, tangent)[1])


@pytest.mark.parametrize(
    "dim, N, g", [(3, 3, 0.5391), (3, 3.015, 0.5527), (3, 6.015, 0.6101), (2, 3, 0.6237), (1, 3, 0.4821)]
)
def test_silling_control_equals_wan_control_at_a_g_that_tends_to_that_of_the_full_ball(dim, N, g):
    """g tends to 5/8, 2/3 and 3/4 as N → ∞. In 3D g = πδ⁵/(2 Σ|ξ|²): 0.55 and 0.61 at the usual N = 3.015 and 6.015."""
    found, ball = equal_g(dim, N), {3: 5 / 8, 2: 2 / 3, 1: 3 / 4}[dim]
    assert worst(found, g) < 1e-4  # 5e-5
    finer = equal_g(dim, {3: 12, 2: 60, 1: 1000}[dim])
    assert abs(finer - ball) < 0.03 * ball  # 0.020 in 3D, 0.0015 in 1D


def test_micromoduli_of_a_full_ball():
    K, d = 2.0, 1.7
    E_strain, E_stress = 3 * K * (1 - 2 / 4), 3 * K * (1 - 2 / 3)
    assert worst(pd.BondBased.from_bulk(K, d).c * pi * d**4 / K, 18) < 1e-14  # 0
    assert worst(pd.BondBased.from_bulk(K, d, 2, "strain").c * 5 * pi * d**3 / E_strain, 48) < 1e-13  # 0
    assert worst(pd.BondBased.from_bulk(K, d, 2, "stress").c * pi * d**3 / E_stress, 9) < 1e-13  # 0
    assert worst(pd.BondBased.from_bulk(K, d, 2).c * pi * d**3 / K, 12) < 1e-13  # 0
    assert worst(pd.BondBased.from_bulk(K, d, 1).c * d**2 / K, 2) < 1e-14  # 0
    # 9KG/(3K + 4G) is E/(2(1 − ν)), and K + G/3 is λ + G
    G = 0.9
    nu = (3 * K - 2 * G) / (2 * (3 * K + G))
    assert worst(pd.plane_bulk_modulus(K, G, "stress"), 2 * G * (1 + nu) / (2 * (1 - nu))) < 1e-14  # 2e-16
    assert worst(pd.plane_bulk_modulus(K, G, "strain"), K - 2 * G / 3 + G) < 1e-14  # 0


def test_springs_of_a_full_ball_are_too_stiff_on_a_lattice():
    """In 3D at N = 3.015 the energy of a hydrostatic strain is 9.9 % above ½ K tr(ε)²."""
    fam, strain = pd.lattice_family(3, 3.015, 0.5), 1e-4
    bonds = fam.bonds((1 + strain) * jnp.eye(3))
    exact = 4.5 * 1.5 * strain**2
    assert worst(pd.BondBased.from_bulk(1.5, 3.015 * 0.5).energy(bonds) / exact, 1.099) < 1e-3  # 3e-4
    assert worst(pd.BondBased.from_family(1.5, fam).energy(bonds) / exact, 1.0) < 1e-12  # 2e-13


def test_bond_force_of_the_bond_based_model_has_the_closed_form():
    """Along Y: ½ ω c (s − 1) for m = ½ or None, ½ ω c (s² − 1)/2 · s for m = 1, ½ ω c log s/s for m = 0."""
    xi, eta = np.array([0.3, -0.4]), np.array([0.2, 0.1])
    bond = pd.Bonds(*(jnp.asarray(x) for x in (xi, eta, 0.8, 1.1, 2.0)))
    Y = xi + eta
    s = np.linalg.norm(Y) / 0.5
    for m, e in ((None, s - 1), (0.5, s - 1), (1.0, (s**2 - 1) / 2 * s), (0.0, np.log(s) / s)):
        t = pd.BondBased(20.0, m).bond_force((), (), bond)
        assert worst(t, 0.5 * 0.8 * 20.0 * e * Y / np.linalg.norm(Y)) < 1e-14  # 9e-16


# ---------------------------------------------------------------- gradients of bonds and of higher order


def test_reproducing_kernel_of_order_one_is_the_average():
    a, b = (bodies.respond(MODELS[n], CLOUD, U) for n in ("bond_level average", "reproducing_kernel 1"))
    assert worst(a.energy / b.energy, 1.0) < 1e-13  # 0
    assert worst(a.force, b.force) < 1e-13  # 2e-16
    assert worst(a.jacobian, b.jacobian) < 1e-12  # 9e-16


@pytest.mark.parametrize("name", ["bond_level average", "reproducing_kernel 2"])
def test_a_graded_model_of_two_stages_has_the_slope_of_its_energy(name):
    """The energy of point i's bonds has the factor c_i, so the force through the neighbours' states has theirs."""
    c = bodies.random(73).uniform(0.4, 2.5, 15)
    out = bodies.respond(pd.graded(MODELS[name], c), CLOUD, U)
    args = (POINTS.positions, POINTS.volumes, bodies.HORIZONS[2])

    def energy(u):
        found = peers.families(*args, u, bodies.gaussian)
        return peers.BODY_ENERGIES[name](found, c * POINTS.volumes)

    assert worst(out.energy / energy(U), 1.0) < 1e-13  # 6e-16
    force = -ref.complex_step_jacobian(energy, U).reshape(U.shape) / POINTS.volumes[:, None]
    assert worst(out.force, force) / worst(force) < 1e-12  # 3e-15
    assert asymmetry(out.jacobian) < 1e-12  # 1e-16


def test_quadratic_fields_have_their_gradient_at_every_point():
    """The gradient of order 2 is exact, at the surface too. That of order 1 is off by the variation of the gradient."""
    X, A = POINTS.positions, 0.05 * bodies.random(74).normal(size=(2, 2, 2))
    u = np.einsum("kij,pi,pj->pk", A, X, X)
    exact = np.einsum("kij,pi->pkj", A + A.transpose(0, 2, 1), X)
    bonds = CLOUD.bonds(jnp.asarray(u))
    (found, _), (affine, _) = (
        each_point("point_state", pd.ReproducingKernel(LINEAR, order), bonds) for order in (2, 1)
    )
    assert worst(found, exact) < 1e-12  # 1e-15
    assert worst(affine, exact) > 0.1  # 0.13


SYMBOL = eqx.filter_jit(pd.symbol)


@pytest.mark.parametrize(
    "name, costs",
    [
        ("correspondence neo-hookean", False),
        ("silling control", True),
        ("wan control", True),
        ("bond_level", True),
        ("bond_level average", True),
        ("sub_horizon", True),
        ("bond_associated", True),
    ],
)
def test_a_checkerboard_wave_has_energy_except_in_correspondence(name, costs):
    """At rest −eᵀ Ĵ(k) e/2 is the energy of a unit wave. In correspondence it is 0 at every half-reciprocal k."""
    k = np.pi * np.array([[1.0, 1.0], [1.0, 0.0]])
    J = np.asarray(SYMBOL(MODELS[name], pd.lattice_family(2, 2, 1.0, pd.gaussian_influence), jnp.eye(2), k))
    top = np.linalg.eigvalsh((J + J.swapaxes(1, 2)) / 2)[:, -1]
    if costs:
        assert np.max(top) < -0.05  # −1.2
    else:
        assert worst(J) < 1e-15  # 3e-32


# ---------------------------------------------------------------- wrong use


@pytest.mark.parametrize(
    "make, named",
    [
        (lambda: pd.BondBased(-1.0), "c must be finite and > 0"),
        (lambda: pd.BondBased(np.nan), "c must be finite and > 0"),
        (lambda: pd.BondBased.from_bulk(-1.0, 1.0), "bulk must be finite and > 0"),
        (lambda: pd.BondBased.from_bulk(1.0, np.nan), "horizon must be finite and > 0"),
        (lambda: pd.BondBased.from_bulk(1.0, 1.0, 4), "dim must be 1, 2 or 3"),
        (lambda: pd.BondBased.from_bulk(1.0, 1.0, 3, "strain"), "belongs to dim 2"),
        (lambda: pd.BondBased.from_bulk(1.0, 1.0, 2, "flat"), "plane must be one of strain, stress"),
        (lambda: pd.BondBased.from_family(-1.0, pd.lattice_family(2, 2)), "c must be finite and > 0"),
        (lambda: pd.LPS(-1.0, 1.0), "bulk must be finite and > 0"),
        (lambda: pd.LPS(1.0, np.nan), "shear must be finite and > 0"),
        (lambda: pd.SillingControl(-0.1), "g must be finite and >= 0"),
        (lambda: pd.SillingControl(np.nan), "g must be finite and >= 0"),
        (lambda: pd.LittlewoodControl(-0.1), "C must be finite and >= 0"),
        (lambda: pd.LittlewoodControl(np.inf), "C must be finite and >= 0"),
        (lambda: pd.ReproducingKernel(LINEAR, 3), "order must be 1"),
        (lambda: pd.BondAssociated(LINEAR, 0.0), "r must be finite and > 0"),
        (lambda: pd.BondAssociatedForce(LINEAR, np.nan), "r must be finite and > 0"),
        (lambda: pd.TupekRadovitzky(1.0, NEO_HOOKEAN), "needs a law in a strain tensor"),
        (lambda: pd.plane_bulk_modulus(1.0, 1.0, "flat"), "plane must be one of"),
        (lambda: pd.plane_bulk_modulus(-1.0, 1.0, "strain"), "bulk must be finite and > 0"),
        (lambda: pd.plane_bulk_modulus(1.0, np.nan, "stress"), "shear must be finite and > 0"),
        (lambda: pd.strain_energy(MODELS["bond_associated force"], CLOUD, U), "not the derivative of an energy"),
    ],
)
def test_wrong_constants_are_named(make, named):
    with pytest.raises(ValueError, match=named):
        make()


def test_families_with_too_few_bonds_are_refused():
    I = np.eye
    with pytest.raises(ValueError, match="LPS is defined in dimension 2 or 3; this family has dim 1"):
        pd.force_state(MODELS["lps"], pd.lattice_family(1, 2), I(1))
    with pytest.raises(ValueError, match="defined in dimension 2 or 3"):
        pd.force_density(MODELS["lps"], bodies.families(1, "cloud"), np.zeros((7, 1)))
    with pytest.raises(ValueError, match="ReproducingKernel needs an invertible shape tensor"):
        pd.symbol(MODELS["reproducing_kernel 2"], pd.lattice_family(2, 1), I(2), np.ones(2))
    with pytest.raises(ValueError, match=r"that of bond 0, ξ = \(0, 1\), of this lattice family is singular"):
        pd.force_state(pd.BondAssociated(LINEAR, 0.5), pd.lattice_family(2, 1), I(2))
    with pytest.raises(ValueError, match=r"that of bond \d+, ξ = \(.*\), of the family of point \d+ is singular"):
        pd.force_density(pd.BondAssociatedForce(LINEAR, 0.1), CLOUD, U)
    # In a honeycomb each of the three neighbours is alone in its quadrant, so K is invertible but K of no sector is.
    cell = np.array([[0.0, 0.0], [0.0, 1.0], [0.5 * 3**0.5, 1.5], [0.5 * 3**0.5, 2.5]])
    honeycomb = pd.cloud(np.concatenate([cell, np.add(cell, [3**0.5, 0.0])]), 1.0, period=(12**0.5, 3.0))
    check_model(MODELS["correspondence svk"], pd.families(honeycomb, 1.1), pd.Families)
    with pytest.raises(
        ValueError, match="SubHorizon needs an invertible shape tensor, and that of the family of point 0"
    ):
        check_model(MODELS["sub_horizon"], pd.families(honeycomb, 1.1), pd.Families)


@pytest.mark.parametrize("dim, N", [(2, 1), (3, 2)])
def test_sectors_of_small_families_span(dim, N):
    """Bonds on borders are shared, so quadrants at N = 1 and octants at N = 2 span space and affine maps are exact."""
    F = bodies.deformation(dim, 75)
    model, fam = MODELS["sub_horizon"], pd.lattice_family(dim, N)
    P = pd.piola_stress(model, fam, F)
    assert worst(P, peers.svk_stress(F)) < 1e-14  # 2e-16


@pytest.mark.parametrize("name", ["bond_level", "reproducing_kernel 2", "bond_associated"])
def test_padded_bonds_do_not_change_the_forces_after_a_half_turn(name):
    """A padded bond does not rotate: its det F_ξ would be −1, and log det F_ξ of a law in F would be NaN."""
    X = POINTS.positions
    one, turned = bodies.respond(MODELS[name], CLOUD, U), bodies.respond(MODELS[name], CLOUD, -2 * X - U)
    assert worst(turned.force, -one.force) < 1e-13  # 1e-14
    assert worst(turned.jacobian, one.jacobian) < 1e-12  # 2e-14
