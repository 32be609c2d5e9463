"""Force states, stresses of affine maps, mean deformations, constants that vary from point to point, and errors."""

import warnings

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from bodies import worst
from table import KINDS, LINEAR, MODELS, EnergyOnly

import pdjax as pd

LAM, MU = 1.3, 0.7
state, force = eqx.filter_jit(pd.force_state), eqx.filter_jit(pd.force_density)

# ---------------------------------------------------------------- one family


@pytest.mark.parametrize("m", [1.0, 0.0, -0.7, None])
@pytest.mark.parametrize("dim, N", [(1, 3), (2, 2), (3, 1.5)])
def test_force_state_is_that_of_the_reference(m, dim, N):
    """The reference computes T on every bond of the centre of a patch. m = None is the correspondence model."""
    X, F = ref.lattice_ball(dim, 2 * N), bodies.deformation(dim, 1, size=0.2)
    args = (X, np.ones(len(X)), N, X @ (F - np.eye(dim)).T)
    if m is None:
        model, states = MODELS["correspondence svk"], ref.correspondence_states(*args, LAM, MU, points=[0])
    else:
        model, states = pd.SethHill(m, LINEAR), ref.seth_hill_states(*args, m, LAM, MU, points=[0])
    near, T = states[0]
    fam = pd.lattice_family(dim, N)
    of = {tuple(xi): t for xi, t in zip(np.asarray(fam.xi), np.asarray(state(model, fam, F)), strict=True)}
    assert len(of) == len(near)
    assert worst([of[tuple(xi)] for xi in X[near]], T) < 1e-14  # 2e-16


@pytest.mark.parametrize("name", [name for name in KINDS if MODELS[name].hyperelastic])
def test_piola_stress_is_the_slope_of_the_energy_of_affine_maps(name):
    """P = ∂W/∂F by autodiff and by central differences. P Fᵀ is symmetric if the model is objective."""
    fam, F = pd.lattice_family(2, 2, 0.5, pd.cubic_spline_influence), bodies.deformation(2, 2, size=0.2)
    _, slope, P, *_ = bodies.homogeneous(MODELS[name], fam, F)
    assert worst(P, slope) < 1e-14  # 1e-16
    if MODELS[name].objective:
        assert worst(P @ F.T, F @ np.asarray(P).T) < 1e-14  # 3e-17
    step, G = 1e-5, bodies.random(2).normal(size=(2, 2))
    up, down = (bodies.homogeneous(MODELS[name], fam, F + h * G)[0] for h in (step, -step))
    assert worst((up - down) / (2 * step), np.sum(P * G)) < 1e-8  # 3e-10


def test_stress_of_a_model_by_its_energy_alone_is_that_of_its_force_state():
    """Σ V T⊗ξ of every point is the P of the law, because Ē₁ is exact under an affine map."""
    F = bodies.deformation(2, 3, size=0.2)
    X = bodies.points(2, "cloud").positions
    out = bodies.respond(MODELS["seth_hill m=1, energy only"], bodies.families(2, "cloud"), X @ (F - np.eye(2)).T)
    E = (F.T @ F - np.eye(2)) / 2
    P = F @ (LAM * np.trace(E) * np.eye(2) + 2 * MU * E)
    assert worst(out.stress, np.broadcast_to(P, out.stress.shape)) < 1e-13  # 9e-16
    assert worst(out.strain, np.broadcast_to(E, out.strain.shape)) < 1e-14  # 1e-16


# ---------------------------------------------------------------- mean deformation, periodic bodies


def test_a_mean_deformation_adds_to_the_displacement():
    X, F = bodies.points(2, "cloud").positions, bodies.deformation(2, 4)
    fams, u = bodies.families(2, "cloud"), bodies.displacement(2, "cloud", 4)
    functions = (pd.force_density, pd.strain_energy, pd.strain, pd.stress)
    all_of = jax.jit(lambda model, fams, u, F: [function(model, fams, u, F) for function in functions])
    exact = bodies.respond(MODELS["seth_hill m=0"], fams, u + X @ (F - np.eye(2)).T)
    for value, name in zip(
        all_of(MODELS["seth_hill m=0"], fams, u, F), ("force", "energy", "strain", "stress"), strict=True
    ):
        assert worst(value, getattr(exact, name)) < 1e-14  # 4e-16


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "correspondence neo-hookean"])
def test_a_homogeneous_periodic_body_is_in_equilibrium_and_moves_freely(name):
    body = pd.lattice((5, 7), 0.5, periodic=True)
    fams, F = pd.families(body, 1.0), jnp.asarray(bodies.deformation(2, 5, size=0.3))
    shift = jnp.broadcast_to(jnp.array([0.3, -2.0]), (35, 2))
    assert worst(force(MODELS[name], fams, shift, F)) < 1e-13  # 8e-17
    one = eqx.filter_jit(pd.strain_energy)(MODELS[name], fams, shift, F)
    W = MODELS[name].energy(pd.lattice_family(2, 2, 0.5).bonds(F))
    assert worst(one / (body.volumes.sum() * W), 1.0) < 1e-13  # 9e-16


# ---------------------------------------------------------------- constants of each point


@pytest.mark.parametrize("m, path", [(1.0, "states"), (1.0, "energy"), (None, "states")])
def test_two_materials_by_hand(m, path):
    """f_i = Σ_j (T_ij − T_ji) V_j, where each T has the λ of its own point. T comes from two uniform bodies."""
    body, u = bodies.points(2, "cloud"), bodies.displacement(2, "cloud", 6)
    soft = body.positions[:, 0] < 2.4
    lam = np.where(soft, 0.4, 2.1)
    args = (body.positions, body.volumes, bodies.HORIZONS[2], u)
    law = pd.LinearElastic(lam, MU)
    if m is None:
        model, each = pd.Correspondence(law), lambda lam: ref.correspondence_states(*args, lam, MU, bodies.gaussian)
    else:
        model, each = pd.SethHill(m, law), lambda lam: ref.seth_hill_states(*args, m, lam, MU, bodies.gaussian)
    states = {lam: each(lam) for lam in (0.4, 2.1)}
    exact = np.zeros_like(u)
    for i in range(len(body)):
        near, T = states[lam[i]][i]
        for slot, j in enumerate(near):
            back, T_j = states[lam[j]][j]
            exact[i] += (T[slot] - T_j[list(back).index(i)]) * body.volumes[j]
    found = bodies.respond(model if path == "states" else EnergyOnly(model), bodies.families(2, "cloud"), u)
    assert worst(found.force, exact) < 1e-14  # 2e-15


def test_every_constant_may_vary():
    """With m, λ and μ of each point, its strain and stress are those of a uniform body with these constants."""
    rng, fams = bodies.random(7), bodies.families(2, "cloud")
    u = jnp.asarray(bodies.displacement(2, "cloud", 7))
    m, lam, mu = rng.uniform(-1, 1, 15), rng.uniform(0.5, 2, 15), rng.uniform(0.5, 2, 15)
    fields = eqx.filter_jit(lambda model: (pd.strain(model, fams, u), pd.stress(model, fams, u)))
    strain, stress = fields(pd.SethHill(m, pd.LinearElastic(lam, mu)))
    for i in (0, 7, 14):
        alone = fields(pd.SethHill(m[i], pd.LinearElastic(lam[i], mu[i])))
        assert worst(strain[i], alone[0][i]) < 1e-15 and worst(stress[i], alone[1][i]) < 1e-14  # 0


# ---------------------------------------------------------------- wrong use

SETH_HILL, CORRESPONDENCE = MODELS["seth_hill m=1"], MODELS["correspondence svk"]
FAM, CROSS = pd.lattice_family(2, 2), pd.lattice_family(2, 1)  # L is singular on the four bonds of CROSS
BODY = pd.families(pd.lattice((5, 3)), 1.5)
REST, NAN = np.zeros((15, 2)), np.full((15, 2), np.nan)
COLLAPSED = [[1.0, 0.0], [0.0, 0.0]]
FOLDED = [[1.0, 0.0], [0.0, -1.0]]


@pytest.mark.parametrize(
    "call, named",
    [
        (lambda: pd.force_state(SETH_HILL, FAM, COLLAPSED), "F must be finite with det F > 0"),
        (lambda: pd.force_state(SETH_HILL, FAM, FOLDED), "F must be finite with det F > 0"),
        (lambda: pd.force_state(SETH_HILL, FAM, np.full((2, 2), np.nan)), "F must be finite"),
        (lambda: pd.force_state(SETH_HILL, FAM, np.eye(3)), r"F must be a \(2, 2\)"),
        (lambda: pd.force_state(SETH_HILL, CROSS, np.eye(2)), "SethHill.*shape tensor.*lattice family.*4 bonds"),
        (lambda: pd.stability(SETH_HILL, CROSS, np.eye(2)), "SethHill.*shape tensor"),
        (lambda: pd.center_block(SETH_HILL, CROSS, np.eye(2)), "SethHill.*shape tensor"),
        (lambda: pd.center_block(SETH_HILL, FAM, FOLDED), "F must be"),
        (lambda: pd.symbol(SETH_HILL, FAM, FOLDED, [0.1, 0.2]), "F must be"),
        (lambda: pd.symbol(SETH_HILL, FAM, np.eye(2), [0.1, 0.2, 0.3]), "k must have shape"),
        (lambda: pd.symbol(SETH_HILL, FAM, np.eye(2), [0.1, np.nan]), "k must be finite"),
        (lambda: pd.force_density(SETH_HILL, BODY, REST[:, :1]), r"u must have shape \(points, dim\) = \(15, 2\)"),
        (lambda: pd.force_density(SETH_HILL, BODY, NAN), "u must be finite; 15 points are not, the first is point 0"),
        (lambda: pd.strain_energy(SETH_HILL, BODY, np.where(np.arange(15)[:, None] == 4, NAN, REST)), "point 4"),
        (lambda: pd.strain(SETH_HILL, BODY, NAN), "u must be finite"),
        (lambda: pd.stress(SETH_HILL, BODY, REST[1:]), "u must have shape"),
        (lambda: pd.force_density(SETH_HILL, BODY, REST, FOLDED), "F must be finite with det F > 0"),
        (lambda: pd.jacobian(SETH_HILL, BODY, NAN), "u must be finite"),
        (lambda: pd.jacobian(SETH_HILL, BODY, NAN, "dense"), "u must be finite"),
        (
            lambda: pd.jacobian(SETH_HILL, BODY, REST, "banded"),
            "form must be one of.* coloured; got 'banded'",
        ),
        (lambda: pd.force_density(SETH_HILL, pd.families(pd.lattice((5, 3)), 1.0), REST), "point 0 .15 such.*2 bonds"),
        (lambda: pd.jacobian(CORRESPONDENCE, pd.families(pd.lattice((5, 1)), 2), REST[:5]), "Correspondence.*point 0"),
        pytest.param(lambda: pd.piola_stress(SETH_HILL, CROSS, jnp.eye(2)), "shape tensor"),
        pytest.param(lambda: pd.piola_stress(SETH_HILL, FAM, jnp.array(FOLDED)), "F must be"),
        pytest.param(lambda: pd.p_wave_modulus(SETH_HILL, CROSS), "shape tensor"),
        pytest.param(lambda: pd.jvp(SETH_HILL, BODY, NAN, REST), "u must be finite"),
        pytest.param(lambda: pd.jvp(SETH_HILL, BODY, REST, NAN), "v must be finite"),
        pytest.param(lambda: pd.jvp(SETH_HILL, BODY, REST, REST[1:]), "v must have shape"),
    ],
)
def test_wrong_use_names_the_argument(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_the_error_for_a_singular_family_names_the_point_and_depends_on_the_model():
    """A plate has a line of single points. L is singular from its first point on, K only from the second on."""
    X = np.concatenate([pd.lattice((3, 2)).positions, [[3.5, 0.5], [4.5, 0.5], [5.5, 0.5]]])
    fams = pd.families(pd.cloud(X, 1.0), 1.5)
    for model, poor in ((SETH_HILL, r"point 6 \(3 such points\)"), (CORRESPONDENCE, r"point 7 \(2 such points\)")):
        with pytest.raises(ValueError, match=poor):
            pd.force_density(model, fams, np.zeros_like(X))
    line = pd.families(pd.cloud(X[6:, :1], 1.0), 1.5)
    assert worst(force(SETH_HILL, line, jnp.zeros((3, 1)))) == 0


@pytest.mark.parametrize(
    "x64",
    [
        True,
        False,
    ],
)
def test_points_on_a_slanted_line_are_refused(x64):
    """K of a straight line is recognised as singular in both precisions, despite rounding."""
    for angle in np.arange(0.1, 1.5, 0.05):
        X = 0.7 * np.arange(5)[:, None] * np.array([np.cos(angle), np.sin(angle)])
        with jax.enable_x64(x64), pytest.raises(ValueError, match="shape tensor"):
            pd.force_density(pd.Correspondence(pd.LinearElastic(1.0, 1.0)), pd.families(pd.cloud(X, 1.0), 1.5), 0 * X)


@pytest.mark.parametrize("bad", [COLLAPSED, FOLDED, [[1.0, np.nan], [0.0, 1.0]]])
def test_a_bad_traced_deformation_raises_at_run_time(bad):
    with pytest.raises(RuntimeError, match="det F > 0"):
        jax.block_until_ready(state(SETH_HILL, FAM, jnp.asarray(bad)))


def test_a_collapsed_bond_is_named():
    body = pd.lattice((4, 3))
    fams, u = pd.families(body, 1.5), np.zeros((12, 2))
    u[4] = body.positions[5] - body.positions[4]
    with pytest.raises(ValueError, match="bond from point 4 to point 5 has collapsed"):
        pd.force_density(pd.SethHill(0.0, pd.LinearElastic(1.0, 1.0)), fams, u)
    with pytest.raises(ValueError, match="has collapsed"):
        pd.force_density(pd.BondBased(1.0), fams, -body.positions)


def test_springs_of_a_body_have_a_constant_for_each_point():
    """Inside the body it is that of the lattice family. All families then have the same energy in a uniform stretch."""
    body = pd.lattice((9, 8))
    fams, stretch = pd.families(body, 2.0), 1.001 * np.eye(2)
    model = pd.BondBased.from_family(1.5, fams)
    inside = int(np.argmax(np.asarray(fams.count)))
    assert model.c[inside] == pytest.approx(float(pd.BondBased.from_family(1.5, pd.lattice_family(2, 2)).c), rel=1e-14)
    W = np.asarray(pd.energy_density(model, fams, np.zeros((72, 2)), stretch))
    assert np.ptp(W) < 1e-13 * W.max() and W[0] == pytest.approx(0.5 * 1.5 * 4 * 1e-6, rel=1e-12)


def test_displacements_larger_than_the_body_give_a_warning():
    body = pd.lattice((5, 4))
    families, model = pd.families(body, 2.1), pd.BondBased(1.0)
    with pytest.warns(UserWarning, match=r"differ by up to 40, and the body is 4 long: u must be in the unit"):
        pd.force_density(model, families, 10 * body.positions)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pd.force_density(model, families, 0.5 * body.positions)
