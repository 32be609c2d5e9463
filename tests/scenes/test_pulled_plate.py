"""The pulled plate is homogeneous in the middle, up to the errors of its surfaces, which a correction reduces."""

import functools

import numpy as np
import pytest

import pdjax as pd

LPS = pd.LPS.from_young(1.0, 0.25, 2, "stress")


def strain_error(scene, shape):
    """Error of the mean axial strain between the quarters of the body."""
    u = np.asarray(pd.solve(scene, stability=False).u) - np.asarray(scene.closed_form)
    axial = u[:, 0].reshape(shape[0], -1).mean(axis=1)
    a, b = shape[0] // 4, shape[0] - 1 - shape[0] // 4
    return (axial[b] - axial[a]) / (b - a)


@pytest.mark.parametrize(
    ("model", "name", "least", "most"),
    [
        (pd.BondBased(1.0), None, 0.05, 0.07),
        (pd.BondBased(1.0), "volume", -0.10, -0.08),
        (pd.BondBased(1.0), "energy", -0.015, 0.015),
        (LPS, None, -0.12, -0.10),
        (LPS, "volume", -0.13, -0.11),
        (LPS, "energy", -0.025, 0.015),
        (LPS, functools.partial(pd.surface_correction, passes=1), -0.06, -0.04),
    ],
)
def test_a_correction_reduces_the_error_of_the_strain(model, name, least, most):
    """The numbers of benchmarks/surface_correction.py, measured between the quarters instead of in the middle third."""
    scene = pd.scenes.pulled_plate((30, 10), 3.015, model, 1e-6, correction=name)
    assert least < strain_error(scene, (30, 10)) / 1e-6 < most


@pytest.mark.parametrize("shape", [(11,), (11, 4), (9, 3, 4)])
def test_supports_carry_no_force_to_first_order_in_the_strain(shape):
    model = pd.BondBased(1.0)
    scene = pd.scenes.pulled_plate(shape, 1.5, model, 1e-7, influence="partial volume")
    found = pd.solve(scene, stability=False, tolerance=1e-13)
    assert found.converged
    f = np.asarray(pd.force_density(model, scene.families, found.u)) + np.asarray(scene.load)
    assert np.abs(f).max() < 1e-7 * np.abs(scene.load).max()  # measured 2e-8 in 3D
    assert np.count_nonzero(~scene.free) == {1: 1, 2: 3, 3: 6}[len(shape)]


def test_a_model_that_is_exact_at_surfaces_has_the_closed_form_in_the_middle():
    """A correspondence model with a control has no error of its moduli at the sides."""
    model = pd.Correspondence(pd.LinearElastic(1.0, 1.0), pd.WanControl())
    scene = pd.scenes.pulled_plate((30, 8), 1.5, model, 1e-6)
    assert abs(strain_error(scene, (30, 8))) < 0.03e-6


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"shape": (8, 5)}, "at least 9 points"),
        ({"correction": "force"}, "correction must be one of"),
        ({"layer": 0}, "layer must be"),
        ({"shape": (20, 1)}, None),
        ({"shape": (20, 1, 3)}, "at least 2 points along axis 1"),
    ],
)
def test_wrong_numbers_are_refused(more, words):
    arguments = {"shape": (20, 5), "N": 3, "model": pd.BondBased(1.0)} | more
    if words is None:
        assert len(pd.scenes.pulled_plate(**arguments).body) == 20
        return
    with pytest.raises(ValueError, match=words):
        pd.scenes.pulled_plate(**arguments)
