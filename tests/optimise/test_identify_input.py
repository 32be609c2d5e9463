"""Inverse problems with wrong input, failing trial points and interruptions: what `identify` says about them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

X = np.linspace(0.5, 2.0, 7)
TRUTH = {"a": 2.0, "b": 0.5}
BODY = pd.bar(6, 6.0)
FAMILIES = pd.families(BODY, 1.0)


def curve(p):
    return p["a"] * jnp.exp(-p["b"] * X)


DATA = np.asarray(curve(TRUTH))
START = {"a": 1.0, "b": 1.0}


def spring(p):
    ends = (pd.prescribe([0]), pd.body_force([5], 0.01))
    return pd.scene(BODY, FAMILIES, pd.BondBased(p["c"]), *ends)


def moving(p):
    return pd.motion(spring(p))


def bad(where, value):
    data = DATA.copy()
    data[where] = value
    return data


WRONG = [
    ((curve, START, bad(2, np.nan)), {}, r"observed must be finite.*1 of 7 data are not.*where=np.isfinite"),
    ((curve, START, DATA[:3]), {}, r"observed must have the shape of the prediction, \(7,\)"),
    ((curve, START, {"u": DATA}), {}, "observed must be an array of numbers"),
    ((spring, {"c": 1.0}, np.zeros(6)), {}, r"\(6, 1\): the displacements of the equilibrium"),
    ((curve, {}, DATA), {}, "start must hold at least one number"),
    ((curve, {"a": np.nan, "b": 1.0}, DATA), {}, "start a must be finite"),
    ((curve, {"a": "one", "b": 1.0}, DATA), {}, "start a must be an array of numbers"),
    ((curve, START, DATA), {"noise": 0.0}, "noise must be a finite standard deviation > 0"),
    (
        (curve, START, DATA),
        {"noise": np.ones(3)},
        "noise must be one standard deviation, or an array of the",
    ),
    ((curve, START, DATA), {"where": np.zeros(7, bool)}, "where selects no datum"),
    ((curve, START, DATA), {"where": np.arange(3)}, "where must be an array of True and False"),
    ((curve, START, DATA), {"where": np.ones(3, bool)}, r"where must have the shape \(7,\)"),
    ((curve, START, DATA), {"bounds": (2.0, 3.0)}, "start must lie within bounds.*a starts at 1 with bounds 2 and 3"),
    ((curve, START, DATA), {"bounds": ({"a": 0.0}, None)}, "the lower bounds must be one number or a tree like start"),
    ((curve, START, DATA), {"bounds": 3}, "bounds must be a pair"),
    ((curve, START, DATA), {"measure": lambda s, u: u}, "measure must be given for a scene or a motion only"),
    ((curve, START, DATA), {"dt": 0.1}, "dt must be given for motions only"),
    ((curve, START, DATA), {"derivative": "fd"}, "derivative must be one of auto, tangent, adjoint"),
    ((curve, START, DATA), {"tolerance": 0.0}, "tolerance must lie between 0 and 1"),
    ((curve, START, DATA), {"max_solves": 0}, "max_solves must be a whole number >= 1"),
    ((curve, START, DATA), {"regularisation": 1.0}, "regularisation must be functions of the parameters"),
    ((moving, {"c": 1.0}, DATA), {}, "dt must be given where scene_of returns a Motion"),
]


@pytest.mark.parametrize(("given", "more", "message"), WRONG)
def test_wrong_arguments_are_named(given, more, message):
    with pytest.raises(ValueError, match=message):
        pd.identify(*given, **more)


def test_a_function_that_reads_its_parameters_is_refused():
    def reads(p):
        return pd.scene(BODY, FAMILIES, pd.BondBased(float(p["c"])), pd.prescribe([0]), pd.body_force([5], 0.01))

    with pytest.raises(ValueError, match="JAX can differentiate, but it reads the value of a parameter"):
        pd.identify(reads, {"c": 1.0}, np.zeros((6, 1)))


def test_a_start_without_an_equilibrium_is_refused():
    def torn(p):
        model, ends = pd.SethHill(0.0, pd.LinearElastic(p, 0.0)), (pd.prescribe([0]), pd.body_force([5], 10.0))
        return pd.scene(BODY, FAMILIES, model, *ends)

    with pytest.raises(ValueError, match="start must be parameters with a prediction: the scene has no equilibrium"):
        pd.identify(torn, 1.0, np.zeros((6, 1)))


def test_float32_is_refused():
    with jax.enable_x64(False), pytest.raises(ValueError, match="identify needs float64"):
        pd.identify(curve, START, DATA)


def test_a_trial_point_outside_the_domain_shortens_the_step_and_is_reported():
    def root(p):
        return jnp.sqrt(p - 0.4) * X  # NaN below 0.4, where the first Gauss–Newton step leads

    found = pd.identify(root, 8.0, np.asarray(root(jnp.asarray(0.5))))
    assert found.converged and float(found.parameters) == pytest.approx(0.5, rel=1e-6)
    assert found.failures > 0 and "had no prediction, so the step was shortened" in found.reason
    assert "a prediction is not finite" in str(found)


def test_a_search_that_cannot_leave_its_point_is_blocked():
    def wall(p):
        return jnp.where(p < 1.0, jnp.nan, p) * X

    found = pd.identify(wall, 1.0, 0.5 * X)
    assert found.ending.name == "BLOCKED" and not found.converged
    with pytest.raises(RuntimeError, match="did not converge: no smaller step stays"):
        pd.identify(wall, 1.0, 0.5 * X, throw=True)


def test_an_interrupted_search_returns_its_best_point():
    calls = []

    def slow(p):
        calls.append(1)
        if len(calls) > 8:
            raise KeyboardInterrupt
        return curve(p)

    found = pd.identify(slow, START, DATA)
    assert found.ending.name == "INTERRUPTED" and found.reason == "interrupted: this is the best point so far"
    assert found.history[-1] == found.history.min() < found.history[0]


def test_a_search_without_solves_left_says_so():
    found = pd.identify(curve, START, DATA, max_solves=2)
    assert not found.converged and found.reason == "the forward solves ran out" and found.solves.forward == 2


def test_bounds_hold_the_parameters():
    found = pd.identify(curve, START, DATA, bounds=({"a": None, "b": 0.6}, 10.0))
    assert float(found.parameters["b"]) == pytest.approx(0.6, abs=1e-3)
    free = pd.identify(curve, START, DATA, bounds=(0.0, None))
    assert float(free.parameters["b"]) == pytest.approx(0.5, rel=1e-8)


def test_the_text_of_a_result_is_one_line_with_values_and_uncertainties():
    found = pd.identify(curve, START, DATA + 0.01 * np.cos(7 * X), noise=0.01)
    assert repr(found) == str(found) and "\n" not in str(found)
    assert str(found).startswith("converged: the cost no longer decreases; a = ") and " ± " in str(found)


def test_names_follow_the_tree():
    found = pd.identify(lambda p: p[0]["x"] @ X[:2] + p[1] * X, ({"x": np.ones(2)}, 1.0), X, max_solves=5)
    assert found.names == ("[0].x[0]", "[0].x[1]", "[1]")
    assert found.residual.shape == (7,)


def test_a_mask_of_entries_is_not_read_as_one_of_points_where_both_fit():
    """Three saves of three points in 1D: a mask (points, dim) selects points, not saves."""
    from pdjax.optimise.measured import Measured

    mask = np.array([[True], [True], [False]])
    data = np.zeros((3, 3, 1))
    assert Measured(data, data, "displacements", mask, None).index.tolist() == [0, 1, 3, 4, 6, 7]
    assert Measured(data, data, "displacements", mask[:, 0], None).index.tolist() == [0, 1, 3, 4, 6, 7]
