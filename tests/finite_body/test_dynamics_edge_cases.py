"""Edge cases of the dynamics, found in a review by a numerical analyst."""

import functools
import warnings

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from bodies import worst
from test_dynamics import BAR, LAW, driven_bar

import pdjax as pd

QUIET = {"show_progress": False}


def loaded(**how):
    """A bar of 8 points, held at one end, pulled at the other by a body force, from rest."""
    body = pd.bar(8, 8.0)
    held, pull = pd.prescribe([0, 1], 0.0), pd.body_force([6, 7], 0.01)
    return pd.motion(pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, BAR), held, pull), **how)


@pytest.mark.parametrize(("schedule", "save_every"), [(pd.Ramp(3.0), 1), (lambda t: jnp.where(t > 30, 1.0, 0.0), 61)])
def test_a_load_that_begins_during_a_run_does_not_stop_it(schedule, save_every):
    """In the first loaded step the points gain velocity before the sum of the work of the load contains it."""
    assert pd.simulate(loaded(schedule=schedule), 60.0, dt=0.5, save_every=save_every, **QUIET).finished


@pytest.mark.parametrize("share", [0.99])
def test_waves_just_below_the_critical_step_run_to_the_end(share):
    """Their energy varies by the factor 1/(1 − share²), but the energy that Verlet conserves is constant."""
    wave = pd.scenes.wave(24, 3, 2 * np.pi * 3 / 24, 1e-6, pd.SethHill(1.0, BAR))
    motion = pd.motion(wave.scene, velocity=wave.start)
    history = pd.simulate(motion, 2000.0, dt=share * pd.critical_time_step(motion), save_every=1, **QUIET)
    assert history.finished
    assert worst(history.u) < 1e-4  # measured 7e-6 at 0.99


@pytest.mark.parametrize(("m", "share", "every"), [(-1.0, 1.5, 50), (-3.0, 1.05, 50)])
def test_an_instability_caused_by_the_step_is_attributed_to_the_step(m, share, every):
    """The bonds may be softer at the end of the run, so the critical step of the start counts too."""
    body = pd.bar(8, 8.0)
    start = 0.01 * np.random.default_rng(1).normal(size=(8, 1))
    motion = pd.motion(pd.scene(body, pd.families(body, 2.0), pd.SethHill(m, BAR), moving=True), start=start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        history = pd.simulate(motion, 4000.0, dt=share * pd.critical_time_step(motion), save_every=every, **QUIET)
    assert not history.finished and "is above the critical step" in history.reason


def test_a_model_without_an_energy_is_monitored_too():
    class Springs(pd.AbstractModel):
        hyperelastic = False

        def force_state(self, bonds):
            return bonds.omega[:, None] * bonds.eta

    body = pd.bar(8, 8.0)
    start = 0.01 * np.random.default_rng(1).normal(size=(8, 1))
    motion = pd.motion(pd.scene(body, pd.families(body, 2.0), Springs(), moving=True), start=start)
    critical = pd.critical_time_step(motion)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert not pd.simulate(motion, 400.0, dt=1.1 * critical, **QUIET).finished
        history = pd.simulate(motion, 400.0, dt=0.8 * critical, **QUIET)
    assert history.finished and np.isnan(history.energies.strain).all()


LOOKS = {
    "closure": (lambda k: lambda s, n: k * n.u[0], 1.0, 2.0),
    "partial": (lambda k: functools.partial(lambda s, n, i: n.u[i], i=k), 0, 3),
    "name": (lambda k: lambda s, n: getattr(jnp, k)(n.u), "cosh", "sinh"),
}


@pytest.mark.parametrize("kind", ["closure", "partial", "name"])
def test_a_checkpoint_distinguishes_observers_by_what_they_compute(kind, tmp_path):
    make, here, there = LOOKS[kind]
    how = {"dt": 0.1, "save_every": 4, "checkpoint": tmp_path / "x.npz", **QUIET}
    pd.simulate(loaded(), 2.0, observers={"x": make(here)}, **how)
    assert pd.simulate(loaded(), 4.0, observers={"x": make(here)}, resume=True, **how).finished
    with pytest.raises(ValueError, match="another run"):
        pd.simulate(loaded(), 4.0, observers={"x": make(there)}, resume=True, **how)


def test_a_checkpoint_distinguishes_laws(tmp_path):
    def motion(k):
        body = pd.bar(8, 8.0)
        law = pd.EnergyLaw(lambda E, c: 0.5 * k * jnp.sum(E * E), "E", {})
        fixed = pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, law), moving=True)
        return pd.motion(fixed, start=0.01 * (body.positions - 4))

    how = {"dt": 0.1, "save_every": 4, "checkpoint": tmp_path / "x.npz", **QUIET}
    pd.simulate(motion(0.5), 2.0, **how)
    assert pd.simulate(motion(0.5), 4.0, resume=True, **how).finished
    with pytest.raises(ValueError, match="another run"):
        pd.simulate(motion(5.0), 4.0, resume=True, **how)
    shorter = pd.simulate(motion(0.5), 2.0, resume=True, **how)
    assert shorter.times[-1] == pytest.approx(2.0) and shorter.steps == 20


def test_a_traced_run_is_nan_after_a_value_is_not_finite():
    """Two points collide. Under jit the run is not monitored, so its results must not be finite numbers."""
    body = pd.bar(6, 6.0)
    velocity = np.zeros((6, 1))
    velocity[2], velocity[3] = 40.0, -40.0
    fixed = pd.scene(body, pd.families(body, 1.0), pd.SethHill(-2.0, BAR), moving=True)

    @jax.jit
    def run(v):
        return pd.simulate(pd.motion(fixed, velocity=v), 1.0, dt=0.0125, save_every=8)

    history = run(velocity)
    assert np.isfinite(history.u[0]).all() and np.isnan(history.u[-1]).all() and np.isnan(history.energies.kinetic[-1])
    assert worst(history.times, 0.1 * np.arange(11)) < 1e-12


def test_energy_budgets_of_a_batch_equal_those_of_single_runs():
    def error(m):
        return pd.simulate(driven_bar(m=m), 4.0, dt=0.1, save_every=10).energies

    many = jax.vmap(error)(jnp.array([1.0, 0.9]))
    for k, m in enumerate((1.0, 0.9)):
        assert worst(many.error[k], error(m).error) < 1e-12


def test_closed_over_motions_observers_and_schedules_are_differentiable():
    base = loaded(schedule=pd.Ramp(3.0))
    inside = jax.jit(lambda x: x * pd.simulate(base, 5.0, dt=0.5).u[-1].sum())(1.0)
    assert float(inside) == pytest.approx(float(pd.simulate(base, 5.0, dt=0.5, **QUIET).u[-1].sum()), rel=1e-12)

    class Twice(pd.observers.Probe):
        size: jax.Array

        def __call__(self, scene, now):
            return self.size * now.u[self.points]

    def seen(size):
        watch = {"x": Twice(np.array([4]), size)}
        return pd.simulate(base, 5.0, dt=0.5, observers=watch).observed["x"][-1, 0, 0]

    assert float(jax.grad(seen)(2.0)) == pytest.approx(float(seen(1.0)), rel=1e-12)

    def slow(duration):  # with the default step, under grad; the kink of the ramp lies between two steps
        return pd.simulate(loaded(schedule=pd.Ramp(duration)), 5.0, **QUIET).u[-1, 4, 0]

    central = float(slow(3.02 + 1e-5) - slow(3.02 - 1e-5)) / 2e-5
    assert float(jax.grad(slow)(3.02)) == pytest.approx(central, rel=1e-5)


def test_diffrax_from_a_start_of_zero():
    """With loads alone or a velocity alone the default tolerances are not zero."""
    for motion in (loaded(schedule=pd.Ramp(3.0)), pd.motion(loaded().scene, velocity=np.full((8, 1), 1e-3))):
        exact = pd.simulate(motion, 4.0, dt=0.01, save_every=400, **QUIET).u[-1]
        for how in ({"rtol": 1e-6}, {"solver": diffrax.Kvaerno3(), "dt": 0.1}):
            found = pd.simulate_diffrax(motion, 4.0, saves=4, max_steps=3000, **how)
            assert found.finished and worst(found.u[-1], exact) < 1e-2 * worst(exact)


def test_diffrax_does_not_recompile_for_new_values():
    def run(m):
        return pd.simulate_diffrax(driven_bar(m=m), 1.0, dt=0.25, saves=1, solver=diffrax.Heun())

    run(1.0)
    counted = []
    original = pd.SethHill.bond_force

    def count(*arguments):
        counted.append(1)
        return original(*arguments)

    pd.SethHill.bond_force = count
    try:
        run(0.7)
    finally:
        pd.SethHill.bond_force = original
    assert not counted


def test_a_root_finder_given_by_the_user_is_kept(monkeypatch):
    seen = []
    from pdjax.finite_body.dynamics import terms

    original = terms._run
    monkeypatch.setattr(terms, "_run", lambda *a: seen.append(a[2].root_finder) or original(*a))
    mine = optx.Newton(1e-3, 1e-3)
    pd.simulate_diffrax(loaded(), 1.0, solver=diffrax.ImplicitEuler(root_finder=mine), dt=0.5, saves=1)
    assert seen == [mine]


def test_diffrax_out_of_steps_reports_the_last_save():
    history = pd.simulate_diffrax(loaded(), 100.0, dt=0.1, max_steps=500, saves=10)
    assert not history.finished and np.isfinite(history.u).all()
    assert history.times[-1] == pytest.approx(40.0, abs=10.1) and history.failure.step == 500


def test_a_body_without_stiffness_needs_a_given_time_step():
    body = pd.bar(8, 8.0)
    soft = pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, pd.LinearElastic(lam=0.0, mu=0.0)), moving=True)
    motion = pd.motion(soft, velocity=np.ones((8, 1)))
    assert pd.critical_time_step(motion) == np.inf
    history = pd.simulate(motion, 2.0, dt=0.1, **QUIET)
    assert history.finished and worst(history.u[-1], np.full((8, 1), 2.0)) < 1e-12
    with pytest.raises(ValueError, match="no stiffness at the start"):
        pd.simulate(motion, 2.0, **QUIET)


def test_short_runs_have_at_least_100_steps():
    assert pd.simulate(loaded(schedule=pd.SmoothRamp(3.0)), 2.0, **QUIET).steps >= 100


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (lambda: pd.simulate(loaded(), 1.0, observers={"x": pd.observers.probe([99])}), "names point 99"),
        (lambda: pd.simulate_diffrax(loaded(), 1.0, observers={"x": pd.observers.reaction([8])}), "names point 8"),
        (lambda: pd.simulate_diffrax(loaded(), 1.0, dt=-0.1), "dt must be finite"),
        (lambda: pd.simulate(loaded(), 1e10, dt=0.1), "fewer than 2³¹ steps"),
        (lambda: pd.observers.section_force(pd.lattice((8, 8), 1.0, periodic=True), 4.0), "periodic along axis 0"),
        (lambda: pd.scenes.wave(9, 2, model=pd.SethHill(1.0, LAW), dim=2, branch=7), "branch must lie in -2 to 1"),
        (lambda: pd.scenes.wave(9, 2, (1.0, 1.0)), "k must have at most 1 components"),
        (lambda: pd.measured_rate([0.0, 1.0, 3.0], [1.0, 2.0, 3.0]), "evenly spaced"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_bad_input_is_named(work, words):
    with pytest.raises(ValueError, match=words):
        work()


def test_float32_runs_stay_float32():
    import subprocess
    import sys

    code = """
import numpy as np, pdjax as pd
body = pd.bar(8, 8.0)
held, pull = pd.prescribe([0, 1], 0.0), pd.body_force([6, 7], 0.01)
scene = pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=0.0)), held, pull)
history = pd.simulate(pd.motion(scene, schedule=pd.Ramp(3.0), damping=0.1), 200.0, show_progress=False)
assert history.finished and history.u.dtype == np.float32 and history.energies.kinetic.dtype == np.float32
print(float(np.abs(history.energies.error).max()))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 0.1
