"""The cracked plate and the double cantilever: their formulas, their stiffness, and the load at which they break."""

import numpy as np
import pytest

import pdjax as pd
from pdjax.scenes.cracked_plate import shape_factor

G = 1e-6
QUIET = {"show_progress": False}


def stretch(scene, n, N, no_fail=None):
    family = pd.lattice_family(2, N, 1 / n)
    found = pd.CriticalStretch.from_fracture_energy(G, scene.model, family)
    return pd.CriticalStretch(found.stretch, no_fail=no_fail)


def test_shape_factor_is_that_of_isida_and_of_an_infinite_plate():
    """Isida's values for a long plate, a/w = 0.2, 0.4, 0.6, 0.8: 1.0246, 1.1094, 1.3033, 1.8160."""
    assert shape_factor(1e-6) == pytest.approx(1.0, abs=1e-9)
    known = {0.2: 1.0246, 0.4: 1.1094, 0.6: 1.3033, 0.8: 1.8160}
    for ratio, value in known.items():
        assert shape_factor(ratio) == pytest.approx(value, rel=1e-3)  # measured 3e-4


def test_load_factor_one_is_the_load_of_the_fracture_energy():
    for n, crack, energy in ((20, 0.5, 1e-6), (32, 0.3, 4e-5)):
        scene, expected = pd.scenes.cracked_plate(n, crack=crack, fracture_energy=energy)
        assert expected.stress_intensity(expected.stress) == pytest.approx(np.sqrt(energy), rel=1e-12)
        force = np.asarray(scene.load) * np.asarray(scene.body.volumes)[:, None]
        upper = scene.body.positions[:, 1] > 1
        assert force[upper, 1].sum() == pytest.approx(expected.stress, rel=1e-12)  # the width is 1
        assert np.abs(force.sum(axis=0)).max() < 1e-15
        assert abs(expected.half_crack - crack / 2) <= 0.5 / n


def test_the_crack_of_the_plate_is_made_of_broken_bonds():
    scene, expected = pd.scenes.cracked_plate(20)
    families, X = scene.families, scene.body.positions
    lost = (np.asarray(families.intact) > 0) & ~(np.asarray(families.weight) > 0)
    i, slot = np.nonzero(lost)
    j = np.asarray(families.neighbours)[i, slot]
    assert ((X[i, 1] - 1) * (X[j, 1] - 1) < 0).all()
    crossing = X[i, 0] + (X[j, 0] - X[i, 0]) * (1 - X[i, 1]) / (X[j, 1] - X[i, 1])
    assert np.abs(crossing - 0.5).max() <= expected.half_crack + 1e-12
    damage = lost.sum(axis=1).reshape(20, 40)
    assert np.array_equal(damage, damage[::-1]) and np.array_equal(damage, damage[:, ::-1])


@pytest.fixture(scope="module")
def broken_plate():
    scene, _ = pd.scenes.cracked_plate(20)
    return scene, pd.solve_breaking(scene, stretch(scene, 20, 3), load_steps=[0.9, 0.95, 1.0, 1.05, 1.1, 1.15], **QUIET)


def test_supports_of_the_plate_carry_no_force(broken_plate):
    scene, path = broken_plate
    size = float(np.abs(np.asarray(scene.load) * np.asarray(scene.body.volumes)[:, None]).sum())
    assert np.abs(path.reactions).max() < 1e-9 * size  # measured 6e-14


def test_the_plate_breaks_near_the_stress_intensity_of_the_handbook(broken_plate):
    """The criterion is made from the fracture energy alone. The crack is 3.3 horizons long: δ/a = 0.6."""
    _, path = broken_plate
    assert path.ending.name in ("LOAD_LOST", "NO_EQUILIBRIUM")
    largest = path.load_factors[path.settled][-1]
    assert 0.95 < path.broken_at.min() < 1.1 and 0.95 < largest < 1.1  # measured 1.05 and 1.0, in steps of 0.05


def test_beam_theory_is_consistent():
    """The force is A/(a + χH) while the crack grows, and Δ and P give G = G_c by P²/2 dC/da."""
    _, expected = pd.scenes.double_cantilever(6, crack=2, length=5)
    H, onset = expected.height, expected.opening_at_onset()

    def compliance(a):
        return 8 * (a + 0.673 * H) ** 3 / H**3

    P, e = float(expected.force(onset)), 1e-5
    rate = (compliance(expected.crack + e) - compliance(expected.crack - e)) / (2 * e)
    assert 0.5 * P**2 * rate == pytest.approx(expected.fracture_energy, rel=1e-8)
    assert P * compliance(expected.crack) == pytest.approx(onset, rel=1e-12)
    assert float(expected.force(0.5 * onset)) == pytest.approx(0.5 * P, rel=1e-12)
    a = np.cbrt(3 * onset / (8 * float(expected.force(3 * onset)))) - 0.673  # the length that the compliance gives
    P = float(expected.force(3 * onset))
    assert 12 * P**2 * (a + 0.673) ** 2 == pytest.approx(expected.fracture_energy, rel=1e-12)
    assert expected.opening == pytest.approx(4 * onset, rel=1e-12)


def test_stiffness_of_the_cantilever_is_that_of_fichter():
    """A route that knows no beam: the force at a small opening over the theory. Plain beam theory is 60 % too stiff."""
    scene, expected = pd.scenes.double_cantilever(8, crack=4, length=10)
    found = pd.solve_breaking(scene, pd.CriticalStretch(1.0), load_steps=[1e-3], **QUIET)
    force = float(found.reactions[-1, expected.upper, 1].sum())
    theory = float(expected.force(1e-3 * expected.opening))
    assert abs(force / theory - 1) < 0.03  # measured -0.014 for LPS, H/δ = 2.7
    assert float(expected.force(1e-3 * expected.opening, root=0.0)) > 1.5 * force


def test_the_cantilever_breaks_between_its_arms():
    scene, expected = pd.scenes.double_cantilever(6, crack=2, length=5)
    path = pd.solve_breaking(scene, stretch(scene, 6, 3, expected.arms), load_steps=[0.2, 0.25, 0.3, 0.4], **QUIET)
    force = path.reactions[:, expected.upper, 1].sum(axis=1)
    theory = expected.force(path.load_factors * expected.opening)
    first = int(np.argmax(path.load_factors >= path.broken_at.min()))
    assert path.ending.name == "FINISHED" and path.broken_bonds > 0
    assert 0.9 < force[first] / theory[first] < 1.25  # measured 1.22: the opening grows in steps of 0.05
    ends = np.nonzero(np.isfinite(path.broken_at))
    y = scene.body.positions[:, 1] - 1
    assert (y[ends[0]] * y[np.asarray(scene.families.neighbours)[ends]] < 0).all()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pd.scenes.cracked_plate(21), "n must be even"),
        (lambda: pd.scenes.cracked_plate(20, crack=0.9), "crack must lie between 0 and 0.8"),
        (lambda: pd.scenes.cracked_plate(20, crack=0.01), "shorter than two spacings"),
        (lambda: pd.scenes.cracked_plate(20, fracture_energy=-1.0), "fracture_energy must be finite and > 0"),
        (lambda: pd.scenes.double_cantilever(3), "n must be a whole number >= 5"),
        (lambda: pd.scenes.double_cantilever(8, crack=1.0), "need crack >= 2"),
        (lambda: pd.scenes.double_cantilever(8, length=5.0), "length >= crack"),
        (lambda: pd.scenes.double_cantilever(8, fracture_energy=np.nan), "fracture_energy must be finite and > 0"),
    ],
)
def test_what_is_wrong_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
