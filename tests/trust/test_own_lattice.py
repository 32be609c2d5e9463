"""Margins of the points' own lattices against `stability` and `critical_load`, one state at a time."""

import bodies
import numpy as np
import pytest
from bodies import worst
from table import LINEAR, MODELS

import pdjax as pd
from pdjax.trust import own_lattice as module
from pdjax.trust.own_lattice import cover, materials, own_lattice, own_lattice_family

PLATE = pd.families(pd.lattice((6, 5), 0.5), 1.01)
FAMILY = pd.lattice_family(2, 1.01 / 0.5, 0.5)
SVK = pd.SethHill(1.0, LINEAR)


def stretches(count, size, *key):
    """Random symmetric U − I."""
    A = size * bodies.random(*key).uniform(-1, 1, (count, 2, 2))
    return (A + A.mT) / 2


def judged(model, G, path=False, families=PLATE):
    family, _ = own_lattice_family(families)
    parts = materials(model, families, family)
    if len(parts) == 1:  # as many points as there are stretches
        parts = [parts[0]._replace(mask=np.ones(len(G), bool))]
    return own_lattice(family, parts, G, path)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_family_of_a_lattice_is_the_one_of_its_inner_points(dim):
    """The influence comes from the bonds of the body, whatever function made it."""
    families = pd.families(pd.lattice((5,) * dim, 0.5), 1.01, pd.gaussian_influence)
    family, words = own_lattice_family(families)
    exact = pd.lattice_family(dim, 1.01 / 0.5, 0.5, pd.gaussian_influence)
    assert words == "" and worst(family.xi, exact.xi) == 0
    assert worst(family.influence, exact.influence) < 1e-15  # measured 0


def test_family_of_a_cloud_is_a_lattice_of_its_median_volume_and_says_so():
    points = bodies.points(2, "cloud")
    family, words = own_lattice_family(pd.families(points, 2.3))
    h = np.sqrt(np.median(points.volumes))
    assert abs(float(family.spacing) / h - 1) < 1e-15 and "approximation" in words
    assert len(family.xi) == np.sum(np.hypot(*np.mgrid[-3:4, -3:4]) * h <= 2.3) - 1


@pytest.mark.parametrize("name", ["seth_hill m=1", "correspondence neo-hookean", "bond_based", "silling control"])
def test_margins_equal_those_of_stability(name):
    """Every point has its own bin here, so its margin is exact: stable, marginal and unstable ones."""
    model = MODELS[name]
    G = np.concatenate([stretches(5, 0.1, 1), [np.zeros((2, 2)), -0.1 * np.eye(2)]])
    found = judged(model, G)
    assert found.bins == 7 and found.error == 0 and found.critical_factor is None
    for i in range(7):
        exact = pd.stability(model, FAMILY, np.eye(2) + G[i])
        assert abs(found.margin[i] - float(exact.margin)) < 1e-14  # measured 7e-17
        assert (found.margin[i] > found.tolerance[i]) == (exact.verdict == "unstable")


def test_margin_of_a_rotated_point_is_that_of_its_stretch_for_an_objective_model():
    G = stretches(4, 0.1, 2)
    one = judged(SVK, G)
    R = bodies.rotation(2, 5)
    for i in range(4):
        exact = pd.stability(SVK, FAMILY, R @ (np.eye(2) + G[i]))
        assert abs(one.margin[i] - float(exact.margin)) < 1e-14  # measured 1e-16


@pytest.mark.parametrize(
    "model, G", [(pd.LPS(1.5, 0.7), np.diag([-0.1, 0.02])), (pd.BondLevel(LINEAR), -0.1 * np.eye(2))]
)
def test_critical_factors_are_those_of_critical_load_on_the_path_of_the_stretch(model, G):
    """The factors are interpolated between the ones tried: a stable, an unstable, and a nearly undeformed point."""
    exact = float(pd.critical_load(model, FAMILY, lambda a, *_: np.eye(2) + a * G, side="positive", limit=6.0))
    assert 1.0 < exact < 6.0
    found = judged(model, np.stack([G * exact / 1.7, G * exact * 1.6, G * exact / 5]), path=True).critical_factor
    assert abs(found[0] / 1.7 - 1) < 0.02  # measured 5e-3 and 1.6e-3
    assert abs(found[1] * 1.6 - 1) < 0.05  # measured 1.0e-2 and 3e-3
    assert found[2] == np.inf  # beyond 4


def test_a_lattice_that_is_unstable_at_once_has_the_factor_of_the_first_trial():
    """SethHill m = 1 in 2D is unstable at any compression: the factor is below the first one that is tried."""
    found = judged(SVK, np.stack([-0.05 * np.eye(2), np.zeros((2, 2))]), path=True)
    assert 0 < found.critical_factor[0] <= 0.1 and found.critical_factor[1] == np.inf


def test_the_error_of_binning_bounds_the_error_at_all_points(monkeypatch):
    """Few bins for many stretches. The error is measured at the 16 points that are farthest from their centres."""
    monkeypatch.setattr(module, "BINS", {2: 12})
    G = stretches(120, 0.1, 3)
    G[0] = -0.2 * np.eye(2)  # the extreme state is a centre, so its margin is exact
    binned = judged(SVK, G)
    monkeypatch.setattr(module, "BINS", {2: 200})
    exact = judged(SVK, G)
    assert binned.bins == 12 and exact.bins == 120 and exact.error == 0
    error = np.abs(binned.margin - exact.margin)
    assert 0 < binned.error and error.max() < 1.5 * binned.error  # measured 1.0: the maximum is among the 16
    assert error[0] < 1e-14 and error.max() < 0.2  # measured 2e-16 and 0.05


def test_cover_is_that_of_gonzalez():
    """Every row is at most as far from its centre as the next centre would be, and the label is the nearest centre."""
    values = bodies.random(4).normal(size=(60, 3))
    centres, label, distance = cover(values, 9)
    table = np.linalg.norm(values[:, None] - values[centres], axis=-1)
    assert worst(distance, table.min(axis=1)) < 1e-15 and (label == table.argmin(axis=1)).all()
    apart = np.linalg.norm(values[centres][:, None] - values[centres], axis=-1)[~np.eye(9, dtype=bool)]
    assert distance.max() <= apart.min()  # measured 1.74 and 2.06
    assert len(cover(np.zeros((5, 3)), 9)[0]) == 1


def test_two_materials_in_one_body_have_the_margins_of_the_two_single_ones():
    """By arrays of constants, and by a graded model, whose factor changes no margin."""
    half = np.arange(30) < 12
    m = np.where(half, 1.0, -0.7)
    G = stretches(30, 0.05, 6)
    both = judged(pd.SethHill(m, LINEAR), G)
    one, other = judged(pd.SethHill(1.0, LINEAR), G), judged(pd.SethHill(-0.7, LINEAR), G)
    assert worst(both.margin, np.where(half, one.margin, other.margin)) < 1e-14  # measured 6e-17
    assert worst(one.margin, other.margin) > 0.01  # measured 0.07
    graded = judged(pd.graded(SVK, np.where(half, 1.0, 3.0)), G)
    assert worst(graded.margin, one.margin) < 1e-14  # measured 6e-17
    parts = materials(pd.graded(SVK, np.where(half, 1.0, 3.0)), PLATE, FAMILY)
    assert sorted(p.mask.sum() for p in parts) == [12, 18]
    ratio = [p.modulus for p in sorted(parts, key=lambda p: p.modulus)]
    assert abs(ratio[1] / ratio[0] - 3) < 1e-14  # measured 4e-16
    with pytest.raises(ValueError, match="30 different values"):
        materials(pd.SethHill(np.linspace(0, 1, 30), LINEAR), PLATE, FAMILY)


def test_moduli_of_a_material_are_those_of_its_law():
    """An affine-exact model has the bulk modulus λ + μ (2D) and the P-wave modulus λ + 2μ of its law."""
    (part,) = materials(pd.Correspondence(LINEAR), PLATE, FAMILY)
    assert part.mask.all()
    assert abs(part.bulk - 2.0) < 1e-14 and abs(part.modulus - 2.7) < 1e-14  # measured 2e-16 and 4e-16


def test_points_without_a_sound_stretch_have_no_margin():
    G = np.zeros((4, 2, 2))
    G[1] = np.diag([-2.5, 0.0])  # inverted
    G[2] = np.nan
    found = judged(SVK, G, path=True)
    assert np.isnan(found.margin[[1, 2]]).all() and np.isfinite(found.margin[[0, 3]]).all()
    assert np.isnan(found.critical_factor[[1, 2]]).all()


def test_a_law_without_a_tangent_gives_no_margin_and_no_error():
    """The tangent of SethHill m = 2 grows with U⁶ and overflows, while det U > 0 is finite."""
    found = judged(pd.SethHill(2.0, LINEAR), np.stack([np.zeros((2, 2)), np.diag([0, 1e60])]), path=True)
    assert np.isfinite(found.margin[0]) and np.isnan(found.margin[1]) and found.bins == 2
