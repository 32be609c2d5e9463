"""Tests of the search for designs: known optima, bounds, infeasible problems, kinks, stops and resumes."""

import jax.numpy as jnp
import numpy as np
import optax
import pytest

import pdjax as pd
from pdjax.optimise.augmented_lagrangian import DesignEnding

LAW = pd.LinearElastic(1.0, 1.0)


def quiet(*arguments, **options):
    return pd.design(*arguments, show_progress=False, **options)


def same(x):
    return x


def test_a_quadratic_under_two_constraints_ends_at_its_corner():
    """min (x−2)² + (y−1)² with x² ≤ y and x + y ≤ 2 has its optimum at (1, 1), with multipliers 2/3 and 2/3."""
    found = quiet(
        same,
        {"x": jnp.zeros(()), "y": jnp.zeros(())},
        lambda p: (p["x"] - 2) ** 2 + (p["y"] - 1) ** 2,
        {"parabola": lambda p: p["x"] ** 2 - p["y"], "line": lambda p: p["x"] + p["y"] - 2},
    )
    assert found.feasible and found.ending == DesignEnding.CONVERGED
    assert abs(float(found.parameters["x"]) - 1) < 1e-5 and abs(float(found.parameters["y"]) - 1) < 1e-5  # 3e-7
    assert sorted(found.binding) == ["line", "parabola"] and abs(found.objective - 1) < 1e-5


def test_an_unconstrained_optimum_inside_and_on_the_bounds():
    def objective(x):
        return jnp.sum((x - jnp.array([0.3, 5.0])) ** 2)

    inside = quiet(same, jnp.array([0.0, 0.0]), objective)
    assert np.abs(np.asarray(inside.parameters) - [0.3, 5.0]).max() < 1e-5  # measured 1e-8
    on_bound = quiet(same, jnp.array([0.0, 0.0]), objective, bounds=(-1.0, 1.0))
    assert np.abs(np.asarray(on_bound.parameters) - [0.3, 1.0]).max() < 1e-5 and on_bound.binding == []


def test_an_optimiser_of_the_user_is_used():
    found = quiet(same, jnp.array([2.0]), lambda x: jnp.sum(x**2), optimiser=optax.adam(0.1), steps=150)
    assert np.abs(np.asarray(found.parameters)).max() < 1e-2  # measured 6e-4
    assert len(found.history["objective"]) <= 151


KNOWN = {-0.01: 0.0126, -0.05: 0.0618, -0.10: 0.1211}  # the least penalty, from a scan in steps of 0.0001


@pytest.mark.parametrize(
    "a", [-0.05, pytest.param(-0.01, marks=pytest.mark.long), pytest.param(-0.1, marks=pytest.mark.long)]
)
def test_the_least_penalty_of_a_plate_is_that_of_a_scan(a):
    family, cases = pd.lattice_family(2, 3), pd.load_cases("hydrostatic", [a])

    def margin(model):
        return pd.worst_margin(model, family, cases)

    def build(g):
        return pd.SethHill(1.0, LAW, pd.SillingControl(g))

    found = quiet(build, 0.5, lambda model: model.control.g, {"margin": margin}, bounds=(0.0, 2.0))
    assert found.feasible and found.binding == ["margin"]
    g = float(found.parameters)
    assert abs(g - KNOWN[a]) < 1e-4
    assert float(margin(build(g - 1e-4))) > 0 > float(margin(build(g + 1e-4)))


def test_a_problem_without_a_feasible_point_says_so():
    """x ≥ 1 and x ≤ −1 cannot hold together. The closest point violates both by 1."""
    limits = {"above one": lambda x: 1 - x, "below minus one": lambda x: x + 1}
    found = quiet(same, 0.3, lambda x: x**2, limits, bounds=(-3.0, 3.0))
    assert not found.feasible and found.ending == DesignEnding.NO_FEASIBLE_POINT
    assert abs(float(found.parameters)) < 1e-2 and sorted(found.binding) == ["above one", "below minus one"]
    assert "no feasible point" in str(found)


def test_steps_that_leave_the_domain_are_halved_and_counted():
    """A negative penalty is an error of the control. The optimum lies at 0, on the edge of the domain."""
    found = quiet(lambda g: pd.SillingControl(g), 0.5, lambda control: (control.g + 0.1) ** 2)
    assert float(found.parameters) >= 0 and float(found.parameters) < 0.01
    assert any("left the domain" in note and "g must be finite and >= 0" in note for note in found.notes)


def test_a_start_outside_the_domain_is_refused_with_the_reason():
    with pytest.raises(ValueError, match="start must lie in the domain: g must be finite and >= 0"):
        quiet(lambda g: pd.SillingControl(g), -0.5, lambda control: control.g)
    with pytest.raises(ValueError, match=r"start must lie in the domain.*objective was not finite"):
        quiet(same, -1.0, jnp.log)


def test_an_objective_without_parameters_is_refused():
    with pytest.raises(ValueError, match="objective does not depend on the parameters"):
        quiet(same, 1.0, lambda x: 3.0)


def test_a_parameter_without_influence_is_named():
    found = quiet(same, {"used": 1.0, "idle": jnp.ones(2)}, lambda p: p["used"] ** 2)
    assert any("idle[0], idle[1]" in note for note in found.notes)


def test_an_interrupted_search_keeps_its_best_point(tmp_path):
    count = 0

    def objective(x):
        nonlocal count
        count += 1
        if count == 12:
            raise KeyboardInterrupt
        return (x - 3.0) ** 2

    found = quiet(same, 0.0, objective, save=tmp_path / "design.json")
    assert found.ending == DesignEnding.INTERRUPTED and "interrupted" in found.reason
    again = quiet(same, 0.0, objective, save=tmp_path / "design.json")
    assert abs(float(again.parameters) - 3.0) < 1e-5 and again.history["objective"][1] == found.history["objective"][1]
    assert found.objective < 9.0 and found.objective == found.history["objective"].min()


def test_a_stopped_search_goes_on_from_its_file(tmp_path):
    path = tmp_path / "design.json"
    limits = {"circle": lambda x: jnp.sum(x**2) - 1.0}

    def objective(x):
        return (x[0] - 2) ** 2 + (x[1] - 1) ** 2

    def run(steps, **options):
        return quiet(same, jnp.zeros(2), objective, limits, steps=steps, **options)

    first = run(25, save=path)
    again = run(200, save=path)
    whole = run(200)
    assert len(again.history["objective"]) > len(first.history["objective"])
    np.testing.assert_allclose(
        again.history["objective"][: len(first.history["objective"])], first.history["objective"]
    )
    assert np.abs(np.asarray(again.parameters) - np.asarray(whole.parameters)).max() < 1e-5
    assert np.abs(np.asarray(whole.parameters) - np.array([2.0, 1.0]) / np.sqrt(5)).max() < 1e-5
    with pytest.raises(ValueError, match="belongs to another problem"):
        quiet(same, jnp.ones(2), objective, limits, save=path)
    path.write_text("{")
    with pytest.raises(ValueError, match="not a file that design wrote"):
        run(10, save=path)


def test_a_file_of_another_problem_is_refused(tmp_path):
    path = tmp_path / "design.json"
    quiet(same, 0.5, lambda x: (x - 1.0) ** 2, bounds=(0.0, 4.0), save=path)
    with pytest.raises(ValueError, match="belongs to another problem"):
        quiet(same, 0.5, lambda x: (x - 1.0) ** 2, bounds=(0.0, 1.5), save=path)
    with pytest.raises(ValueError, match="belongs to another problem: its last point has the objective"):
        quiet(same, 0.5, lambda x: (x - 3.0) ** 2, bounds=(0.0, 4.0), save=path)


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_feasibility_does_not_depend_on_the_unit_of_a_constraint(unit):
    """min (x − 2)² with x ≤ 0.7, the constraint in any unit."""
    found = quiet(same, 1.5, lambda x: (x - 2) ** 2, {"limit": lambda x: unit * (x - 0.7)}, bounds=(0.0, 2.0))
    assert found.feasible and found.binding == ["limit"] and abs(float(found.parameters) - 0.7) < 1e-5


def test_an_optimum_is_no_parameter_without_influence():
    assert quiet(same, 0.5, lambda x: (x - 1.0) ** 2, bounds=(0.0, 2.0)).notes == []


def test_several_starts_find_the_deeper_of_two_minima():
    def objective(x):
        return (x**2 - 1) ** 2 + 0.3 * x

    gentle = optax.adam(0.002)
    alone = quiet(same, 0.8, objective, bounds=(-2.0, 2.0), optimiser=gentle, steps=100)
    several = quiet(same, 0.8, objective, bounds=(-2.0, 2.0), optimiser=gentle, steps=100, starts=4)
    assert float(alone.parameters) > 0 > float(several.parameters)
    with pytest.raises(ValueError, match="random starts need finite bounds"):
        quiet(same, 0.8, objective, starts=2)


def test_a_design_is_judged_on_a_finer_grid():
    seen = []

    def margin(model):
        from pdjax.infinite_lattice.brillouin import default_intervals

        seen.append(default_intervals(2))
        return model.control.g - 1

    quiet(lambda g: pd.SethHill(1.0, LAW, pd.SillingControl(g)), 0.5, lambda m: m.control.g**2, {"margin": margin})
    assert set(seen) == {16, 32} and seen[-1] == 32


def test_pareto_front_of_two_parabolas():
    """The front of x² and (x − 1)² is √a + √b = 1."""
    front = pd.pareto_front(
        same, 0.5, {"a": lambda x: x**2, "b": lambda x: (x - 1) ** 2}, points=5, bounds=(-1.0, 2.0), show_progress=False
    )
    assert (
        len(front.values) == 5 and (np.diff(front.values[:, 1]) > 0).all() and (np.diff(front.values[:, 0]) < 0).all()
    )
    assert np.abs(np.sqrt(front.values).sum(axis=1) - 1).max() < 2e-4  # measured 1e-6 but for the ends, 3e-5
    assert pd.figures.pareto_front(front) is not None


def test_wrong_input_is_refused():
    with pytest.raises(ValueError, match="bounds must hold lower < upper and contain the start; parameter has"):
        quiet(same, 3.0, lambda x: x, bounds=(0.0, 1.0))
    with pytest.raises(ValueError, match="start must be finite"):
        quiet(same, np.nan, lambda x: x)
    with pytest.raises(ValueError, match="constraint 'c' must be a function"):
        quiet(same, 1.0, lambda x: x, {"c": 3})
    with pytest.raises(ValueError, match="objective must return one number"):
        quiet(same, jnp.ones(2), lambda x: x)
    with pytest.raises(ValueError, match="bounds must be one number or a tree like start"):
        quiet(same, {"a": 0.5, "b": 0.5}, lambda p: p["a"], bounds=({"b": 0.0, "c": 0.0}, {"b": 1.0, "c": 1.0}))
    with pytest.raises(ValueError, match="optimiser must be a method of optax"):
        quiet(same, 1.0, lambda x: x, optimiser="adam")
    with pytest.raises(ValueError, match="must return at least one number"):
        quiet(same, 1.0, lambda x: x, lambda x: jnp.zeros(0))
    with pytest.raises(ValueError, match="save is an option of design"):
        pd.pareto_front(same, 1.0, [lambda x: x, lambda x: -x], save="front.json")
    with pytest.raises(ValueError, match="steps must be an integer >= 1"):
        quiet(same, 1.0, lambda x: x, steps=0)
    with pytest.raises(ValueError, match="two objectives; got 1"):
        pd.pareto_front(same, 1.0, [lambda x: x])


@pytest.mark.parametrize("margin", [0.0, -0.01])
def test_least_penalty_is_the_root_of_the_margin(margin):
    """Against a bracket of the margin itself, on several load paths of a plate."""
    family, cases = pd.lattice_family(2, 2), pd.load_cases(["hydrostatic", "uniaxial-strain"], [-0.05, 0.05])

    def build(g):
        return pd.SethHill(0.0, LAW, pd.SillingControl(g))

    g = pd.least_penalty(build, family, cases, margin)
    assert float(pd.worst_margin(build(g - 1e-6), family, cases)) > margin
    assert float(pd.worst_margin(build(g + 1e-6), family, cases)) < margin


def test_no_penalty_helps_where_long_waves_grow():
    """At 50 % of compression the acoustic tensor of the Seth–Hill plate is indefinite; in tension nothing is needed."""
    family = pd.lattice_family(1, 2)

    def build(g):
        return pd.SethHill(1.0, LAW, pd.SillingControl(g))

    assert pd.least_penalty(build, family, pd.load_cases("hydrostatic", [-0.5])) == np.inf
    assert pd.stability(build(1.0), family, 0.5 * np.eye(1), criterion="affine").verdict == "unstable"
    assert pd.least_penalty(build, family, pd.load_cases("hydrostatic", [0.05])) == 0.0
    assert abs(pd.least_penalty(build, family, pd.load_cases("hydrostatic", [-0.2])) - 0.18) < 1e-12  # (1 − 0.8²)/2
    in_pascal = pd.least_penalty(lambda g: build(1e-10 * g), family, pd.load_cases("hydrostatic", [-0.05]))
    assert abs(in_pascal - 4.875e8) < 1.0
    with pytest.raises(ValueError, match="margin decreases with g"):
        pd.least_penalty(lambda g: build(0.0), family, pd.load_cases("hydrostatic", [-0.05]))
    with pytest.raises(ValueError, match="margin must be at most 0"):
        pd.least_penalty(build, family, pd.load_cases("hydrostatic", [0.05]), margin=0.1)
