"""Tests of the symbol of cells of several points against the symbol of a lattice and Jacobians of periodic bodies."""

import bodies
import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from table import LINEAR, MODELS
from test_bloch import FarState

import pdjax as pd

INFLUENCE = pd.gaussian_influence
F = bodies.deformation(2, 80, size=0.2)
FACTOR = bodies.random(81).uniform(0.4, 2.5, 4)
symbol = eqx.filter_jit(pd.symbol)


def hermitian(J):
    return worst(J, np.conj(np.swapaxes(J, -1, -2))) / np.abs(J).max()


# ---------------------------------------------------------------- one point, and supercells of a lattice


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "bond_level average", "bond_associated force", "shell control"])
def test_a_cell_of_one_point_has_the_symbol(name):
    """The cell is smaller than its horizon, so that a point is its own neighbour several times."""
    fams = pd.cell_families(pd.lattice((1, 1), 0.5, periodic=True), 0.75, INFLUENCE)
    fam, k = pd.lattice_family(2, 1.5, 0.5, INFLUENCE), bodies.random(82).uniform(-6, 6, (5, 2))
    exact = symbol(MODELS[name], fam, jnp.asarray(F), k)
    assert worst(pd.cell_symbol(MODELS[name], fams, F, k), exact) / np.abs(exact).max() < 1e-13  # 6e-16


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "bond_level average"])
def test_a_supercell_has_the_folded_spectra(name):
    """For 2 × 3 points of one lattice the eigenvalues at k are those of the symbol at k + 2π (i/2, j/3)/h."""
    h = 0.5
    fams = pd.cell_families(pd.lattice((2, 3), h, periodic=True), 1.5 * h, INFLUENCE)
    k = bodies.random(83).uniform(-3, 3, (3, 2))
    J = np.asarray(pd.cell_symbol(MODELS[name], fams, F, k))
    assert J.shape == (3, 12, 12) and hermitian(J) < 1e-14  # 2e-16
    folds = 2 * np.pi / h * np.array([[i / 2, j / 3] for i in range(2) for j in range(3)])
    parts = symbol(MODELS[name], pd.lattice_family(2, 1.5, h, INFLUENCE), jnp.asarray(F), k[:, None] + folds)
    union = np.sort(np.linalg.eigvalsh(parts).reshape(3, -1), axis=1)
    assert worst(np.linalg.eigvalsh(J), union) / np.abs(union).max() < 1e-13  # 1e-15


# ---------------------------------------------------------------- jittered cells


def jittered(repeats=1):
    """Four points of unequal volumes in a cell of period 2, repeated along both axes in the order of the cells."""
    rng = bodies.random(84)
    X = pd.lattice((2, 2)).positions + 0.15 * rng.uniform(-1, 1, (4, 2))
    volumes = rng.uniform(0.8, 1.2, 4)
    shifts = 2.0 * np.array([[i, j] for i in range(repeats) for j in range(repeats)])
    positions = (X[None] + shifts[:, None]).reshape(-1, 2)
    return pd.cloud(positions, np.tile(volumes, repeats**2), period=(2.0 * repeats,) * 2)


GRADED = {
    "two-stage": lambda c: pd.graded(MODELS["bond_level average"], c),
    "law": lambda c: pd.SethHill(0.4, pd.LinearElastic(1.3 * c, 0.7)),
}
FAR = FarState(pd.Correspondence(LINEAR))
JITTERED = ["far state", "sub_horizon", "bond_associated force", *GRADED]


@pytest.mark.parametrize("name", JITTERED)
def test_a_jittered_cell_has_the_spectrum_of_the_big_body(name):
    """V^½ J V^−½ of 3 × 3 cells maps each of its plane waves as `cell_symbol` does, with displacements beside F."""
    repeats, u = 3, 0.05 * bodies.random(85).normal(size=(4, 2))
    model, big_model = (MODELS.get(name, FAR),) * 2
    if name in GRADED:
        model, big_model = (GRADED[name](c) for c in (FACTOR, np.tile(FACTOR, repeats**2)))
    cell, big = jittered(), jittered(repeats)
    k = 2 * np.pi / (2 * repeats) * np.array([[i, j] for i in range(repeats) for j in range(repeats)])
    blocks = np.asarray(pd.cell_symbol(model, pd.cell_families(cell, 1.6, INFLUENCE), F, k, u))
    J = np.asarray(
        pd.jacobian(big_model, pd.families(big, 1.6, INFLUENCE), np.tile(u, (repeats**2, 1)), form="dense", F=F)
    )
    root = np.sqrt(np.repeat(big.volumes, 2))
    J = root[:, None] * J / root
    size = np.abs(J).max()
    for wave, block in zip(k, blocks, strict=True):
        own = np.tile(np.eye(8), (repeats**2, 1))  # Column j moves degree of freedom j of every cell.
        phase = np.repeat(np.exp(1j * big.positions @ wave), 2)[:, None]
        U = phase * own
        assert worst(J @ U, U @ block) / size < 1e-12  # 4e-15
    if model.hyperelastic or model is FAR:  # The force density of FAR derives from an energy.
        assert hermitian(blocks) < 1e-13  # 4e-16
    else:
        assert hermitian(blocks) > 1e-3  # 0.08


def test_relaxed_balances_a_jittered_cell_and_leaves_a_lattice_alone():
    model, unstable = MODELS["silling control"], MODELS["seth_hill m=-0.7"]
    fams = pd.cell_families(jittered(), 1.6, INFLUENCE)
    u = np.asarray(pd.relaxed(model, fams, F))
    before, after = (worst(pd.force_density(model, fams, v, F)) for v in (0 * u, u))
    assert before > 0.1  # 0.45
    assert after < 1e-12  # 1e-16
    assert worst(u[0]) == 0 and worst(u) > 0.1  # 0.23
    lattice = pd.cell_families(pd.lattice((2, 2), periodic=True), 1.6, INFLUENCE)
    assert worst(pd.relaxed(model, lattice, F)) < 1e-14  # 0
    assert worst(pd.relaxed(model, pd.cell_families(pd.lattice((1, 1), periodic=True), 1.6), F)) == 0
    with pytest.raises(ValueError, match="not balanced in 30 Newton steps"):
        pd.relaxed(unstable, fams, F)  # Its Jacobian has an eigenvalue of +0.46.


@pytest.mark.parametrize("name, verdict", [("correspondence svk", "marginal"), ("silling control", "stable")])
def test_stability_of_a_cell_at_rest(name, verdict):
    """A cell of two points has the zero-energy modes of the lattice, and a control removes them."""
    model, body = MODELS[name], pd.lattice((2, 1), periodic=True)
    fams = pd.cell_families(body, 2.0)
    M = float(pd.p_wave_modulus(model, pd.lattice_family(2, 2)))
    out = pd.cell_stability(model, fams, body.period, np.eye(2), M, intervals=4)
    assert out.verdict == verdict
    if verdict == "marginal":
        assert abs(out.margin) < 1e-14  # 0
    else:
        assert out.margin < -0.01  # −0.043


# ---------------------------------------------------------------- wrong use


@pytest.mark.parametrize(
    "body, horizon, named",
    [
        (pd.lattice((3, 3)), 1.5, "periodic along every axis"),
        (pd.lattice((3, 3), periodic=(True, False)), 1.5, "periodic along every axis"),
        (pd.cloud([[0.1, 0.0], [0.1, 0.0]], 1.0, period=(2, 2)), 1.5, "points 0 and 1 coincide"),
        (pd.cloud([[0.0, 0.5], [2.0, 0.5]], 1.0, period=(2, 2)), 1.5, "points 0 and 1 coincide"),
        (pd.lattice((3, 3), periodic=True), np.nan, "horizon must be finite"),
        (pd.lattice((3, 3), periodic=True), -1.0, "horizon must be finite"),
        (pd.lattice((1, 1), periodic=True), 0.5, "neighbour|bonds|lonely"),
    ],
)
def test_invalid_cells_are_refused(body, horizon, named):
    with pytest.raises(ValueError, match=named):
        pd.cell_families(body, horizon)


def test_wrong_use_names_the_argument():
    fams, model = pd.cell_families(pd.lattice((1, 1), periodic=True), 2.0), MODELS["seth_hill m=1"]
    for change, named in (
        ({"k": np.zeros(2)}, "k must have shape"),
        ({"k": np.zeros((3, 1))}, "k must have shape"),
        ({"k": np.full((1, 2), np.nan)}, "k must be finite"),
        ({"F": np.diag([1.0, -1.0])}, "det F > 0"),
        ({"u": np.zeros((2, 2))}, "u must have shape"),
    ):
        use = {"model": model, "fams": fams, "F": np.eye(2), "k": np.zeros((1, 2))} | change
        with pytest.raises(ValueError, match=named):
            pd.cell_symbol(**use)
    with pytest.raises(ValueError, match="has no energy"):
        pd.cell_stability(MODELS["littlewood control"], fams, (1.0, 1.0), np.eye(2), 1.0)
