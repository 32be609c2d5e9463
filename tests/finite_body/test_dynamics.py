"""Motions compared with linear theory, conservation laws, time reversal and other integrators."""

import warnings

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst

import pdjax as pd
from pdjax.finite_body.dynamics import verlet

BAR = pd.LinearElastic(lam=1.0, mu=0.0)
LAW = pd.LinearElastic(lam=1.0, mu=1.0)


def free_bar(m=0.3, n=14, size=0.02):
    """A free bar in nonlinear motion, with unequal densities."""
    body = pd.bar(n, float(n))
    fams = pd.families(body, 2.0)
    x = body.positions
    start = size * np.sin(2 * np.pi * x / n) + size * np.cos(5 * np.pi * x / n)
    fixed = pd.scene(body, fams, pd.SethHill(m, BAR), moving=True)
    return pd.motion(fixed, np.linspace(1.0, 1.5, n), start=start)


def driven_bar(damping=0.2, m=1.0, n=14, ramp=pd.SmoothRamp):
    """A damped bar, held at one end, moved at the other and loaded between: no term of the energy budget is zero."""
    body = pd.bar(n, float(n))
    fams = pd.families(body, 2.0)
    held = pd.prescribe([0, 1], 0.0), pd.prescribe([n - 2, n - 1], [[0.4], [0.5]])
    load = pd.body_force(np.arange(4, 8), -0.01)
    return pd.motion(pd.scene(body, fams, pd.SethHill(m, BAR), *held, load), 1.3, damping=damping, schedule=ramp(6.0))


def ramped_lattice():
    """A periodic lattice whose mean deformation follows a ramp."""
    body = pd.lattice((7, 5), 1.0, periodic=True)
    mean = np.array([[1.03, 0.01], [0.0, 0.98]])
    fixed = pd.scene(body, pd.families(body, 2.0), pd.SethHill(0.5, LAW), mean=mean, moving=True)
    start = 0.01 * np.random.default_rng(0).normal(size=(35, 2))
    return pd.motion(fixed, schedule=pd.SmoothRamp(4.0), start=start)


def final(motion, duration, dt):
    history = pd.simulate(motion, duration, dt=dt, save_every=round(duration / dt), show_progress=False)
    return np.concatenate([history.u[-1], history.v[-1]])


@pytest.fixture(scope="module")
def exact():
    """The driven bar at t = 5, before its ramp ends, by a method of eighth order."""
    history = pd.simulate_diffrax(driven_bar(), 5.0, solver=diffrax.Dopri8(), rtol=1e-13, dt=0.01, saves=4)
    return np.concatenate([history.u[-1], history.v[-1]])


# --- the integrator -----------------------------------------------------------------------------------------------


def test_verlet_is_of_second_order(exact):
    errors = [worst(final(driven_bar(), 5.0, dt), exact) for dt in (0.2, 0.1, 0.05, 0.025)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert abs(orders[-1] - 2) < 0.02  # measured 1.997
    assert errors[-1] < 1e-4  # measured 2.4e-5


def test_verlet_runs_backwards_to_rounding():
    motion = free_bar()
    there = pd.simulate(motion, 40.0, dt=0.4, show_progress=False)
    back = pd.motion(motion.scene, motion.density, start=there.u[-1], velocity=-there.v[-1])
    home = pd.simulate(back, 40.0, dt=0.4, show_progress=False)
    moved = worst(there.u[-1], motion.start)
    assert moved > 1e-2
    assert worst(home.u[-1], motion.start) < 1e-12 * moved  # measured 2e-14 / 4e-2
    damped = pd.motion(motion.scene, motion.density, damping=1e-3, start=there.u[-1], velocity=-there.v[-1])
    lost = pd.simulate(damped, 40.0, dt=0.4, show_progress=False)
    assert worst(lost.u[-1], motion.start) > 1e-4 * moved  # a damped motion is not reversible


def test_energy_error_stays_bounded_over_1e5_steps():
    motion = free_bar(n=6)
    dt = 0.5 * pd.critical_time_step(motion)
    history = pd.simulate(motion, 1e5 * dt, dt=dt, save_every=100, show_progress=False)
    error = np.abs(np.asarray(history.energies.error))
    assert history.steps == 100_000
    early, late = error[:100].max(), error[-100:].max()
    assert 1e-3 < early < 0.2 and late < 1.5 * early  # measured 0.045 and 0.046
    assert np.abs(np.polyfit(history.times, history.energies.imbalance, 1)[0]) * history.times[-1] < 0.1 * error.max()


@pytest.mark.parametrize("make", [driven_bar, ramped_lattice, free_bar])
def test_budget_of_energy_closes_at_second_order(make):
    """Kinetic energy + strain energy − works + losses is constant up to O(Δt²), so no term is missing."""
    motion = make()
    errors = []
    for dt in (0.1, 0.05, 0.025):
        history = pd.simulate(motion, 8.0, dt=dt, save_every=round(0.4 / dt), show_progress=False)
        errors.append(np.abs(np.asarray(history.energies.error)).max())
    assert errors[-1] < 5e-4  # measured 9e-6, 8e-5, 6e-5
    assert abs(np.log2(errors[-2] / errors[-1]) - 2) < 0.1


def test_momentum_of_a_free_body_is_kept():
    rng = np.random.default_rng(3)
    body = pd.cloud(pd.lattice((5, 4)).positions + 0.1 * rng.uniform(-1, 1, (20, 2)), rng.uniform(0.8, 1.2, 20))
    fixed = pd.scene(body, pd.families(body, 2.3), pd.SethHill(0.0, LAW), moving=True)
    density = rng.uniform(1, 2, 20)
    velocity = 0.05 * rng.normal(size=(20, 2))
    history = pd.simulate(pd.motion(fixed, density, velocity=velocity), 20.0, show_progress=False)
    momentum = np.einsum("p,tpi->ti", density * body.volumes, history.v)
    assert worst(momentum - momentum[0]) < 1e-13  # measured 5e-15
    where = body.positions + history.u
    spin = np.einsum("p,tp->t", density * body.volumes, np.linalg.det(np.stack([where, history.v], -1)))
    assert worst(spin - spin[0]) < 1e-12  # the force state of an objective model has no torque; measured 1e-14
    assert np.abs(spin[0]) > 0.1


def test_supports_follow_the_schedule():
    motion = driven_bar(ramp=pd.Ramp)
    history = pd.simulate(motion, 8.0, show_progress=False)
    factor = np.clip(history.times / 6.0, 0, 1)
    assert worst(history.u[:, -1, 0], 0.5 * factor) < 1e-14
    assert worst(history.u[:, 0]) == 0
    during = history.times < 5.9
    assert worst(history.v[during, -1, 0] - 0.5 / 6) < 1e-14


def test_a_damped_motion_ends_in_the_static_solution():
    motion = driven_bar(damping=0.3)
    rest = pd.solve(motion.scene)
    history = pd.simulate(
        motion,
        400.0,
        observers={
            "left": pd.observers.reaction([0, 1]),
            "right": pd.observers.reaction([12, 13]),
            "cut": pd.observers.section_force(motion.scene.body, 10.0),
            "tip": pd.observers.probe([7]),
        },
        show_progress=False,
    )
    assert worst(history.u[-1], rest.u) < 1e-10  # measured 4e-13
    seen = {name: values[-1].item() for name, values in history.observed.items()}
    assert seen["left"] + seen["right"] == pytest.approx(0.04, abs=1e-10)  # supports carry the load of −0.04
    assert seen["cut"] == pytest.approx(seen["right"], abs=1e-10)  # no load acts between the section and the end
    assert seen["tip"] == pytest.approx(float(rest.u[7, 0]), abs=1e-10)


def test_critical_time_step_is_two_over_the_largest_frequency():
    motion = free_bar()
    fixed = motion.scene
    J = np.asarray(pd.jacobian(fixed.model, fixed.families, motion.start, "dense"))
    largest = np.abs(np.linalg.eigvals(J / np.asarray(motion.density)[:, None])).max()
    assert pd.critical_time_step(motion) == pytest.approx(2 / np.sqrt(largest), rel=1e-3)
    wave = pd.scenes.wave((9, 8), 2, model=pd.SethHill(0.0, LAW), u0=0.0, density=2.0)
    grid = np.stack(np.meshgrid(2 * np.pi * np.arange(9) / 9, 2 * np.pi * np.arange(8) / 8), -1).reshape(-1, 2)
    found = pd.dispersion(pd.SethHill(0.0, LAW), pd.lattice_family(2, 2), np.eye(2), grid, 2.0)
    assert pd.critical_time_step(wave) == pytest.approx(2 / float(found.frequency.max()), rel=1e-3)


# --- diffrax ------------------------------------------------------------------------------------------------------

SOLVERS = [
    (diffrax.Euler(), 1, 128),
    (diffrax.Heun(), 2, 64),
    (diffrax.Bosh3(), 3, 64),
    (diffrax.Tsit5(), 5, 32),
    pytest.param(diffrax.ImplicitEuler(), 1, 128, marks=pytest.mark.long),
    pytest.param(diffrax.Kvaerno3(), 3, 64, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("solver", "order", "coarse"), SOLVERS, ids=lambda x: type(x).__name__)
def test_each_diffrax_solver_has_its_order(exact, solver, order, coarse):
    errors = []
    for steps in (coarse, 2 * coarse):
        history = pd.simulate_diffrax(driven_bar(), 5.0, solver=solver, dt=5.0 / steps, saves=1)
        assert history.finished and history.steps == steps
        errors.append(worst(np.concatenate([history.u[-1], history.v[-1]]), exact))
    measured = np.log2(errors[0] / errors[1])
    assert abs(measured - order) < 0.1  # measured 0.009 to 0.037


def test_symplectic_euler_conserves_energy_and_has_order_one():
    motion = free_bar()
    errors, drift = [], []
    exact = pd.simulate_diffrax(motion, 8.0, solver=diffrax.Dopri8(), rtol=1e-12, dt=0.01, saves=1).u[-1]
    for steps in (64, 128):
        history = pd.simulate_diffrax(motion, 8.0, solver=diffrax.SemiImplicitEuler(), dt=8.0 / steps, saves=16)
        errors.append(worst(history.u[-1], exact))
        drift.append(np.abs(history.energies.error).max())
    assert abs(np.log2(errors[0] / errors[1]) - 1) < 0.2
    assert drift[0] < 0.2 and drift[1] < 0.6 * drift[0]
    with pytest.raises(ValueError, match="undamped"):
        pd.symplectic_terms(driven_bar())


def test_observers_of_verlet_and_diffrax_agree():
    motion = driven_bar()
    watch = {"cut": pd.observers.section_force(motion.scene.body, 7.0), "left": pd.observers.reaction([0, 1])}
    ours = pd.simulate(motion, 8.0, dt=0.005, save_every=400, observers=watch, show_progress=False)
    theirs = pd.simulate_diffrax(motion, 8.0, rtol=1e-9, saves=4, observers=watch)
    for name in watch:
        assert worst(ours.observed[name], theirs.observed[name]) < 1e-5
    assert worst(ours.energies.kinetic, theirs.energies.kinetic) < 1e-5
    assert np.isnan(theirs.energies.supports).all()


# --- derivatives --------------------------------------------------------------------------------------------------


DRIVEN = driven_bar()


def end(m, lam=1.0, steps=64, **how):
    """A probe of the driven bar as a function of its material."""
    base = DRIVEN
    fixed = pd.scene(
        base.scene.body,
        base.scene.families,
        pd.SethHill(m, pd.LinearElastic(lam=lam, mu=0.0)),
        pd.prescribe([0, 1], 0.0),
        pd.prescribe([12, 13], [[0.4], [0.5]]),
    )
    motion = pd.motion(fixed, 1.3, damping=0.2, schedule=pd.SmoothRamp(6.0))
    return pd.simulate(motion, 8.0, dt=8.0 / steps, save_every=steps // 4, show_progress=False, **how).u[-1, 7, 0]


def test_gradients_through_time_equal_central_differences():
    slope = jax.grad(end, (0, 1))(1.0, 1.0)
    forward = jax.jvp(end, (1.0, 1.0), (1.0, 0.0))[1], jax.jvp(end, (1.0, 1.0), (0.0, 1.0))[1]
    e = 1e-5
    central = (end(1 + e) - end(1 - e)) / (2 * e), (end(1.0, 1 + e) - end(1.0, 1 - e)) / (2 * e)
    for got, also, wanted in zip(slope, forward, central, strict=True):
        assert float(got) == pytest.approx(float(wanted), rel=1e-6)  # measured 2e-11
        assert float(also) == pytest.approx(float(got), rel=1e-12)


def test_traced_runs_equal_monitored_runs():
    plain = float(end(1.0))
    assert float(jax.jit(end)(1.0)) == pytest.approx(plain, rel=1e-13)
    many = jax.vmap(end)(jnp.array([0.8, 1.0]))
    assert float(many[1]) == pytest.approx(plain, rel=1e-12)
    assert float(many[0]) == pytest.approx(float(end(0.8)), rel=1e-12)


def test_memory_of_the_gradient_grows_as_the_root_of_the_steps():
    def bytes_of(steps):
        work = jax.jit(jax.grad(lambda m: end(m, steps=steps)))
        return work.lower(0.3).compile().memory_analysis().temp_size_in_bytes

    small, large = bytes_of(64), bytes_of(1024)
    assert large < 4 * small  # 16 times the steps: measured 1.3; it would be 16 if every state were kept


@pytest.mark.long
def test_gradient_of_a_diffrax_run_equals_its_central_difference():
    def theirs(m):
        base = driven_bar(m=m)
        return pd.simulate_diffrax(base, 8.0, dt=0.1, saves=1, solver=diffrax.Dopri5(), max_steps=256).u[-1, 7, 0]

    e = 1e-5
    assert float(jax.grad(theirs)(1.0)) == pytest.approx(float(theirs(1 + e) - theirs(1 - e)) / (2 * e), rel=1e-6)


def test_new_values_do_not_recompile():
    """A new material constant runs the program that was compiled before."""
    count = []
    original = verlet.step

    def counted(*arguments):
        count.append(1)
        return original(*arguments)

    verlet.step = counted
    try:
        end(0.9)
        traced = len(count)
        end(0.97, 1.4)
    finally:
        verlet.step = original
    assert len(count) == traced


# --- failure ------------------------------------------------------------------------------------------------------


def test_a_step_above_the_critical_one_gives_a_warning_and_a_failure():
    motion = pd.scenes.wave(24, 3, None, 1e-4, pd.SethHill(1.0, BAR))
    critical = pd.critical_time_step(motion)
    with pytest.warns(UserWarning, match=f"above the critical time step {critical:.6g}"):
        history = pd.simulate(motion, 2000.0, dt=1.03 * critical, save_every=2, show_progress=False)
    assert not history.finished
    assert history.times[-1] < 2000
    assert np.isfinite(history.u).all()
    assert history.failure.time <= 2000 and np.isfinite(history.failure.mode).all()
    omega = pd.dispersion(motion.scene.model, pd.lattice_family(1, 3), np.eye(1), np.abs(history.failure.wave_vector))
    assert 1.03 * critical * float(omega.frequency[0, 0]) > 1.9  # the wave next to the fastest
    with pytest.raises(RuntimeError, match="ended early"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        pd.simulate(motion, 2000.0, dt=1.03 * critical, save_every=20, show_progress=False, throw=True)


def test_a_collapsing_bond_is_reported_with_time_and_place():
    """Two points collide, so a value is not finite although the time step is small enough."""
    body = pd.bar(6, 6.0)
    velocity = np.zeros((6, 1))
    velocity[2], velocity[3] = 40.0, -40.0
    fixed = pd.scene(body, pd.families(body, 1.0), pd.SethHill(-2.0, BAR), moving=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        history = pd.simulate(pd.motion(fixed, velocity=velocity), 1.0, dt=0.0125, save_every=1, show_progress=False)
    assert not history.finished
    assert history.failure.time < 0.1 and np.isfinite(history.u).all()
    assert history.failure.why in str(history)


BAD = [
    (lambda b: pd.motion(b, 0.0), "density must be finite and > 0"),
    (lambda b: pd.motion(b, np.r_[1.0, -1.0, np.ones(12)]), "the smallest is -1"),
    (lambda b: pd.motion(b, np.ones(3)), "one for each of the 14 points"),
    (lambda b: pd.motion(b, damping=-1.0), "damping must be one number >= 0"),
    (lambda b: pd.motion(b, start=np.full((14, 1), np.nan)), "start must be finite"),
    (lambda b: pd.motion(b, velocity=np.zeros((3, 1))), "velocity must have shape"),
    (lambda b: pd.motion(b, schedule=lambda t: t / 0), "schedule must be finite"),
    (lambda b: pd.motion(b, schedule=lambda t: jnp.stack([t, t])), "one load factor"),
    (lambda b: pd.Ramp(0.0), "duration of a ramp"),
    (lambda b: pd.simulate(pd.motion(b)), "duration must be given"),
    (lambda b: pd.simulate(pd.motion(b), -1.0), "duration must be finite and > 0"),
    (lambda b: pd.simulate(pd.motion(b), 1.0, dt=0.0), "dt must be finite"),
    (lambda b: pd.simulate(pd.motion(b), 1.0, save_every=0), "save_every must be"),
    (lambda b: pd.simulate(pd.motion(b), 1.0, resume=True), "resume needs checkpoint"),
    (lambda b: pd.simulate(pd.motion(b), 1.0, checkpoint_every=True), "checkpoint_every must be a whole number"),
    (lambda b: pd.simulate(pd.motion(b), 1.0, checkpoint_every=0), "whole number of saves >= 1; got 0"),
    (lambda b: pd.simulate(pd.motion(b, schedule=lambda t: 1 / (0.5 - t)), 1.0), "at t = 0.5"),
    (lambda b: pd.observers.section_force(b.body, 99.0), "leaves one side empty"),
    (lambda b: pd.observers.section_force(b.body, 1.0, axis=1), "axis must lie"),
    (lambda b: pd.simulate_diffrax(pd.motion(b)), "duration must be"),
    (lambda b: pd.simulate_diffrax(pd.motion(b), 1.0, saves=0), "saves must be"),
    (lambda b: pd.measured_rate([0.0, 1.0], [1.0, 1.0]), "at least 3 saves"),
    (lambda b: pd.scenes.wave(20, 3, 0.3), "k must fit the periodic box"),
    (lambda b: pd.scenes.wave(6, 3), "longer than two horizons"),
    (lambda b: pd.scenes.cuboid((12, 2, 2), 3), "more than 12 cells"),
    (lambda b: pd.scenes.cuboid((9, 2, 2), 1, rate=0.0), "rate must be"),
    (lambda b: pd.scenes.cuboid((9, 2, 2), 1, strain=0.0), "strain must be"),
    (lambda b: pd.dispersion(b.model, pd.lattice_family(1, 2), np.eye(1), [1.0], density=-1.0), "density must be one"),
    (lambda b: pd.dispersion(b.model, pd.lattice_family(2, 2), np.eye(2), [1.0]), "k must have shape"),
]


@pytest.mark.parametrize(("work", "words"), BAD, ids=[words for _, words in BAD])
def test_bad_input_is_named(work, words):
    with pytest.raises(ValueError, match=words):
        work(driven_bar().scene)


def test_a_run_far_beyond_its_duration_gives_a_warning():
    with pytest.warns(UserWarning, match=r"goes on to t = 100, beyond the duration 8: .* save_every = 1000 steps"):
        history = pd.simulate(pd.motion(driven_bar().scene), 8.0, dt=0.1, save_every=1000, show_progress=False)
    assert history.times[-1] == pytest.approx(100.0)


def test_history_says_that_works_are_not_tracked():
    history = pd.simulate_diffrax(pd.motion(driven_bar().scene, damping=0.1), 1.0, dt=0.1, saves=2)
    assert "works are not tracked" in str(history) and "nan" not in str(history)
