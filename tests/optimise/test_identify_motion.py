"""Inverse problems of dynamics: derivatives through all steps, two constants from one wave record, memory, diffrax."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.optimise.parameters import Parameters
from pdjax.optimise.predict_motions import Dynamics, _run_back, saved_displacements
from pdjax.optimise.predictions import Rates, rates

BODY = pd.lattice((15,), periodic=True)
FAMILIES = pd.families(BODY, 2.0)
WAVE = 0.2 * np.cos(2 * np.pi * 2 / 15 * BODY.positions)
TRUTH = {"m": 0.7, "g": 0.4}
STEPS = {"duration": 8.0, "dt": 0.2, "save_every": 4}


def motion_of(p):
    """A wave on a ring of points; the order m and the penalty g are unknown."""
    model = pd.SethHill(p["m"], pd.LinearElastic(1.0, 0.0), pd.SillingControl(p["g"]))
    return pd.motion(pd.scene(BODY, FAMILIES, model, moving=True), start=WAVE)


def sensor(motion, history):
    """The displacement of point 3 over time."""
    return history.u[:, 3, 0]


def problem(measure=sensor, **steps):
    parameters = Parameters(TRUTH)
    first = motion_of(parameters.tree(parameters.flat))
    return Dynamics(motion_of, parameters, first, measure, **{**STEPS, **steps}), parameters.flat


def test_jacobian_of_a_run_equals_central_differences_and_the_adjoint_one():
    made, at = problem()
    data = np.asarray(made.predict(at))
    index = np.arange(1, data.size)
    tangent, adjoint = (made.jacobian(at, index, a) for a in (False, True))
    np.testing.assert_allclose(adjoint, tangent, rtol=0, atol=1e-12 * np.abs(tangent).max())
    e = 1e-5
    for k in range(2):
        up, down = (np.asarray(made.predict(at + s * e * np.eye(2)[k]))[index] for s in (1, -1))
        central = (up - down) / (2 * e)
        np.testing.assert_allclose(tangent[:, k], central, rtol=0, atol=1e-7 * np.abs(central).max())


def test_order_and_penalty_come_from_one_wave_record():
    history = pd.simulate(motion_of(TRUTH), **STEPS, show_progress=False)
    record = np.asarray(history.u)[:, 3, 0]
    found = pd.identify(motion_of, {"m": 1.0, "g": 0.6}, record, measure=sensor, **STEPS)
    assert found.converged and found.identifiable
    assert {k: float(v) for k, v in found.parameters.items()} == pytest.approx(TRUTH, rel=1e-8)
    assert found.solves.adjoint == 0  # two parameters, eleven data
    fields = pd.identify(motion_of, {"m": 0.8, "g": 0.5}, history.u, **STEPS)
    assert float(fields.parameters["g"]) == pytest.approx(0.4, rel=1e-8)


@pytest.mark.long
def test_memory_of_the_adjoint_grows_slower_than_the_steps():
    def bytes_of(steps):
        made, at = problem(lambda motion, history: history.u[-1, 3], duration=0.05 * steps, dt=0.05, save_every=steps)
        made.predict(at)
        found = rates(made.build, at)
        arguments = (made.motion, made.measure, made.run, np.arange(1), found.where, found.rates)
        return _run_back.lower(*arguments).compile().compiled.memory_analysis().temp_size_in_bytes

    assert bytes_of(1024) < 5 * bytes_of(64)  # 16 times the steps


@pytest.mark.long
def test_adjoint_of_diffrax_agrees_and_identifies():
    """A Runge–Kutta method of order 5 and Verlet at a small step have nearly the same derivatives."""
    times = {"duration": 4.0, "dt": 0.05}

    def by_diffrax(p):
        run = pd.simulate_diffrax(motion_of(p), **times, saves=4, solver=diffrax.Dopri5(), max_steps=256)
        return run.u[:, 3, 0]

    def by_verlet(p):
        return pd.simulate(motion_of(p), **times, save_every=20, show_progress=False).u[:, 3, 0]

    truth = jax.tree.map(jnp.asarray, TRUTH)
    theirs, ours = (flat(jax.jacrev(f)(truth)) for f in (by_diffrax, by_verlet))
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=2e-3 * np.abs(ours).max())
    found = pd.identify(by_diffrax, {"m": 0.8, "g": 0.5}, by_diffrax(truth), derivative="adjoint")
    assert {k: float(v) for k, v in found.parameters.items()} == pytest.approx(TRUTH, rel=1e-7)
    assert found.solves.adjoint == 5 * len(found.history)


def flat(tree):
    return np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(tree)])


def test_defaults_of_the_measurement_are_the_saved_displacements():
    made, at = problem(None)
    assert made.measure is saved_displacements and np.shape(made.predict(at)) == (11, 15, 1)
    assert isinstance(rates(made.build, at), Rates)
