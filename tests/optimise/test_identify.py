"""Inverse problems of statics: exact Jacobians, exact recovery, covariance, and what the data do not determine."""

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.optimise.parameters import Parameters
from pdjax.optimise.predict_statics import Statics

LAW = pd.LinearElastic(1.0, 0.0)
BAR = pd.bar(12, 1.0)
BAR_FAMILIES = pd.families(BAR, 2 / 12)
PLATE = pd.lattice((6, 5))
FAMILIES = pd.families(PLATE, 2.1)
LEFT, RIGHT = PLATE.positions[:, 0] < 2, PLATE.positions[:, 0] > 4
ENDS = (pd.prescribe(LEFT, 0.0), pd.prescribe(RIGHT, [0.05, -0.02]))
PULLED = (pd.prescribe(LEFT, 0.0), pd.body_force(RIGHT, [0.01, 0.004]))
COMPILED = [0]


def _count(name, seconds, **_):
    COMPILED[0] += name == "/jax/core/compile/backend_compile_duration"


jax.monitoring.register_event_duration_secs_listener(_count)


def bar(p):
    """A bar of varying modulus and order m, pulled by a force and by a support that are parameters too."""
    factor = 1.0 + p["modulus"] * np.linspace(0, 1, 12) ** 2
    model = pd.graded(pd.SethHill(p["m"], LAW), factor)
    held, pull = pd.prescribe([0, 1], p["support"]), pd.body_force([9, 10, 11], p["load"])
    return pd.scene(BAR, BAR_FAMILIES, model, held, pull)


def seth_hill(p):
    return pd.scene(PLATE, FAMILIES, pd.SethHill(1.0, pd.LinearElastic(p["lam"], p["mu"])), *PULLED)


def stretched(p):
    """The plate between two held ends."""
    return pd.scene(PLATE, FAMILIES, pd.SethHill(1.0, pd.LinearElastic(p["lam"], p["mu"])), *ENDS)


def lps(p):
    return pd.scene(PLATE, FAMILIES, pd.LPS(p["bulk"], p["shear"]), *PULLED)


def penalty(p):
    model = pd.Correspondence(pd.LinearElastic(1.0, p["mu"]), pd.SillingControl(p["g"]))
    return pd.scene(PLATE, FAMILIES, model, *PULLED)


def influence(p):
    families = pd.families(PLATE, 2.1, lambda r, horizon: jnp.exp(-p["width"] * (r / horizon) ** 2))
    return pd.scene(PLATE, families, pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), *PULLED)


def reaction(scene, u):
    """Total force on the left end and all displacements: two measurements in one tree."""
    return {"force": -jnp.sum(scene.unbalanced(u)[np.flatnonzero(LEFT)], axis=0), "u": u}


# name: scene_of, what is measured, the true parameters, the start of the search
CASES = {
    "Seth–Hill 1D": (bar, None, {"m": 0.7, "modulus": 0.4, "support": 0.01, "load": 0.05}, None),
    "Seth–Hill 2D": (seth_hill, None, {"lam": 1.3, "mu": 0.8}, {"lam": 1.0, "mu": 1.0}),
    "held ends": (stretched, reaction, {"lam": 1.3, "mu": 0.8}, {"lam": 1.0, "mu": 1.0}),
    "LPS 2D": (lps, None, {"bulk": 2.0, "shear": 0.9}, {"bulk": 1.5, "shear": 1.2}),
    "correspondence with control": (penalty, None, {"mu": 1.1, "g": 0.6}, {"mu": 1.0, "g": 0.3}),
    "influence function": (influence, None, {"width": 1.5}, {"width": 0.5}),
}


def solved(name):
    """The problem of a case, predicted at its true parameters."""
    scene_of, measure, truth, _ = CASES[name]
    parameters = Parameters(truth)
    problem = Statics(scene_of, parameters, scene_of(parameters.tree(parameters.flat)), measure)
    return problem, parameters.flat, problem.predict(parameters.flat)


def flat(tree):
    return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(tree)])


@pytest.mark.parametrize("name", CASES)
def test_jacobian_equals_central_differences_and_the_adjoint_one(name):
    problem, at, data = solved(name)
    index = np.arange(flat(data).size)
    tangent, adjoint = (problem.jacobian(at, index, a) for a in (False, True))
    np.testing.assert_allclose(adjoint, tangent, rtol=0, atol=1e-11 * np.abs(tangent).max())  # measured: 1e-13
    e = 1e-5
    for k in range(at.size):
        up, down = (flat(problem.predict(at + s * e * np.eye(at.size)[k])) for s in (1, -1))
        central = (up - down) / (2 * e)
        np.testing.assert_allclose(tangent[:, k], central, rtol=0, atol=1e-7 * max(np.abs(central).max(), 1e-3))


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if case[3] is not None])
def test_exact_data_give_back_the_parameters(name):
    scene_of, measure, truth, start = CASES[name]
    _, _, data = solved(name)
    found = pd.identify(scene_of, start, jax.device_get(data), measure=measure)
    assert found.converged and found.identifiable
    assert {k: float(v) for k, v in found.parameters.items()} == pytest.approx(truth, rel=1e-8)
    assert found.history[-1] < 1e-18 * found.history[0] and found.misfit < 1e-9


def test_gradient_of_the_misfit_equals_its_central_difference():
    problem, at, data = solved("Seth–Hill 2D")
    observed = 1.1 * flat(data)

    def misfit(p):
        return 0.5 * np.sum((flat(problem.predict(p)) - observed) ** 2)

    direction = np.array([0.6, -0.8])
    e = 1e-5
    central = (misfit(at + e * direction) - misfit(at - e * direction)) / (2 * e)
    data = problem.predict(at)
    slope = problem.jacobian(at, np.arange(observed.size), True).T @ (flat(data) - observed)
    assert slope @ direction == pytest.approx(central, rel=1e-7)


def test_iterations_after_the_first_compile_nothing():
    problem, at, data = solved("Seth–Hill 2D")
    index = np.arange(flat(data).size)
    problem.jacobian(at, index, False)
    problem.predict(1.01 * at)  # the first warm start
    problem.jacobian(1.01 * at, index, False)
    before = COMPILED[0]
    problem.predict(1.02 * at)
    problem.jacobian(1.02 * at, index, False)
    assert COMPILED[0] == before


def test_one_factorisation_serves_each_jacobian(monkeypatch):
    from pdjax.optimise import predict_statics

    made, factorised = [], predict_statics.factorised

    def counted(*arguments):
        made.append(1)
        return factorised(*arguments)

    monkeypatch.setattr(predict_statics, "factorised", counted)
    problem, at, data = solved("Seth–Hill 2D")
    for adjoint in (False, True):
        problem.jacobian(at, np.arange(flat(data).size), adjoint)
    assert len(made) == 1


def test_solves_are_counted_beside_those_of_finite_differences():
    data = np.asarray(solved("Seth–Hill 2D")[2])
    tangent = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0}, data, derivative="tangent")
    linearised = len(tangent.history)
    assert tangent.solves.tangent == tangent.solves.finite_differences == 2 * linearised
    assert tangent.solves.adjoint == 0 and tangent.solves.forward >= linearised
    one = np.zeros(30, bool)
    one[29] = True
    both = np.stack([one, np.zeros(30, bool)], axis=1)
    adjoint = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0}, data, where=both)
    assert adjoint.solves.adjoint == len(adjoint.history) and adjoint.solves.tangent == 0


def test_few_points_and_one_component_suffice_for_two_moduli():
    data = np.asarray(solved("Seth–Hill 2D")[2])
    where = np.zeros((30, 2), bool)
    where[[21, 25, 29], 0] = True
    hidden = np.where(where, data, np.nan)  # what was not measured may be NaN
    found = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0}, hidden, where=where)
    assert float(found.parameters["lam"]) == pytest.approx(1.3, rel=1e-7)
    assert np.isnan(found.residual).sum() == 57


def test_both_moduli_come_back_in_3d():
    body = pd.lattice((4, 3, 3))
    families, x = pd.families(body, 1.8), body.positions[:, 0]
    ends = pd.prescribe(x < 1, 0.0), pd.body_force(x > 3, [0.01, 0.004, 0.002])

    def cantilever(p):
        return pd.scene(body, families, pd.SethHill(1.0, pd.LinearElastic(p["lam"], p["mu"])), *ends)

    data = np.asarray(pd.solve(cantilever({"lam": 1.2, "mu": 0.8}), stability=False, show_progress=False).u)
    found = pd.identify(cantilever, {"lam": 1.0, "mu": 1.0}, data)
    assert found.converged and found.identifiable
    np.testing.assert_allclose([found.parameters["lam"], found.parameters["mu"]], [1.2, 0.8], rtol=1e-6)


def test_held_ends_determine_the_ratio_of_the_moduli_only():
    """The result names the direction along which both moduli grow in proportion. A reaction force adds the scale."""
    data = jax.device_get(solved("held ends")[2])
    found = pd.identify(stretched, {"lam": 1.3, "mu": 0.8}, data["u"])
    assert not found.identifiable
    assert found.words == "not identifiable: no datum changes along +1 lam, +1 mu (in units of their scales)"
    assert np.isinf(np.diag(found.covariance)).all()
    assert pd.identify(stretched, {"lam": 1.3, "mu": 0.8}, data, measure=reaction).identifiable


def test_a_parameter_that_no_datum_depends_on_is_named():
    data = np.asarray(solved("Seth–Hill 2D")[2])
    found = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0, "unused": 2.0}, data)
    assert not found.identifiable
    assert found.words == "not identifiable: the data do not depend on unused"
    assert float(found.parameters["mu"]) == pytest.approx(0.8, rel=1e-8)
    assert np.isinf(found.standard_deviation["unused"]) and np.isfinite(found.standard_deviation["mu"])


def constant(p):
    return pd.scene(PLATE, FAMILIES, pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), *PULLED)


def one_factor(p):
    """Two held ends: the displacements do not depend on the common factor p of both moduli."""
    return pd.scene(PLATE, FAMILIES, pd.SethHill(1.0, pd.LinearElastic(p, p)), *ENDS)


@pytest.mark.parametrize("scene_of", [constant, one_factor, lambda p: np.ones((30, 2))])
def test_predictions_without_parameters_are_refused_after_two_solves(scene_of):
    calls = []

    def counted(p):
        calls.append(isinstance(p, jax.core.Tracer))
        return scene_of(p)

    with pytest.raises(ValueError, match="the predictions do not depend on the parameters"):
        pd.identify(counted, 2.0, np.full((30, 2), 0.01))
    assert calls.count(False) <= 3  # the kind of the problem, the start and the point near by


def test_a_start_where_all_derivatives_vanish_is_no_lack_of_dependence():
    found = pd.identify(lambda p: (1 - p**2) * jnp.ones(3), 0.0, np.ones(3))
    assert found.converged and float(found.parameters) == 0.0


def test_truth_lies_within_the_stated_uncertainty():
    """In about 95 % of the repetitions; the two estimates of σ, given and from the residuals, agree."""
    data = np.asarray(solved("Seth–Hill 2D")[2])
    sigma = 0.01 * np.sqrt(np.mean(data**2))
    random = np.random.default_rng(3)
    inside = np.zeros(2)
    for _ in range(20):
        noisy = data + sigma * random.normal(size=data.shape)
        found = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0}, noisy, noise=sigma)
        error = np.array([found.parameters["lam"] - 1.3, found.parameters["mu"] - 0.8])
        inside += np.abs(error) < 2 * np.sqrt(np.diag(found.covariance))
        assert 0.6 < found.misfit < 1.2
    assert (inside >= 16).all()  # fewer has the probability 2e-3 for each parameter
    unknown = pd.identify(seth_hill, {"lam": 1.0, "mu": 1.0}, noisy)
    np.testing.assert_allclose(unknown.covariance, found.covariance, rtol=0.6)


def test_a_modulus_field_comes_back_point_by_point():
    """Each of 20 points of a bar has its own modulus, and the data are the displacements under a force."""
    n, layer = 24, 4
    body = pd.bar(n, 1.0)
    families, base = pd.families(body, 2 / n), pd.SethHill(1.0, LAW)
    ends = (pd.prescribe(np.arange(layer)), pd.total_force(np.arange(n - layer, n), [1e-3]))
    truth = 1 / (1 + 5 * np.linspace(0, 1, n - layer) ** 2)

    def graded(field):
        factor = jnp.concatenate([jnp.ones(layer), jnp.exp(field)])
        return pd.scene(body, families, pd.graded(base, factor), *ends)

    data = pd.solve(graded(jnp.log(truth)), tolerance=1e-12).u
    found = pd.identify(graded, np.zeros(n - layer), data)
    assert found.converged
    np.testing.assert_allclose(np.exp(found.parameters), truth, rtol=1e-8)  # measured: 1e-12
