"""Bonds that break in `simulate`: energy budget, irreversibility, both backends, checkpoints, and what is refused."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.force.backends import padded

SHAPE = (24, 16)
BODY = pd.lattice(SHAPE)
X = BODY.positions
NOTCHED = pd.cut(pd.families(BODY, 3.015), pd.Segment((0.0, 8.0), (12.0, 8.0)))
LAW = pd.LinearElastic(1.0, 1.0)
MODELS = {
    "bond-based": pd.BondBased(1.0),
    "LPS": pd.LPS(1.0, 0.6),
    "correspondence": pd.Correspondence(LAW, pd.SillingControl(0.2)),
}
STRETCH = pd.CriticalStretch(0.01)
APART = np.stack([0 * X[:, 0], 0.0025 * (X[:, 1] - 8.0)], axis=1)  # velocities that open the notch


def notched(model, families=NOTCHED, velocity=APART):
    return pd.motion(pd.scene(BODY, families, model, moving=True), velocity=velocity)


def run(motion, share, breaking=STRETCH, steps=60, **more):
    """A run of `steps` critical time steps in steps of `share` of the critical one, with a save every six of them."""
    critical = pd.critical_time_step(motion)
    settings = {"dt": share * critical, "save_every": round(6 / share), "show_progress": False} | more
    return pd.simulate(motion, steps * critical, breaking=breaking, **settings)


@pytest.fixture(scope="module", params=list(MODELS))
def runs(request):
    """The motion of the notched plate, and its runs with steps of 0.4, 0.2 and 0.1 of the critical one."""
    motion = notched(MODELS[request.param])
    watch = {"damage": pd.observers.damage()}
    return motion, [run(motion, share, observers=watch) for share in (0.4, 0.2, 0.1)]


def test_the_energy_budget_closes_to_the_second_order(runs):
    _, found = runs
    assert all(history.finished and float(history.energies.released[-1]) > 0 for history in found)
    errors = [float(np.abs(history.energies.error).max()) for history in found]
    # Measured: bond-based 6e-3, 1.6e-3, 4e-4; LPS 6e-3, 1.6e-3, 4e-4.
    assert errors[0] > 3 * errors[1] > 9 * errors[2] and errors[2] < 1e-3


def test_momentum_is_kept(runs):
    motion, found = runs
    momentum = (np.asarray(motion.mass) * np.asarray(found[0].v[-1])).sum(axis=0)
    assert np.abs(momentum).max() < 1e-13  # measured 2e-15; the speeds sum up to 4


def test_damage_grows_and_is_the_share_of_broken_bonds(runs):
    motion, found = runs
    damage = found[0].observed["damage"]
    assert (np.diff(damage, axis=0) >= 0).all() and damage[0].max() == 0 and damage[-1].max() > 0.3
    alive, families = np.asarray(found[0].alive), motion.scene.families
    before = np.asarray(families.weight) > 0
    assert np.array_equal(alive & ~before, np.zeros_like(alive))
    share = 1 - alive.sum(axis=1) / before.sum(axis=1)
    assert np.abs(damage[-1] - share).max() < 1e-15  # measured 1e-16
    back = np.asarray(families.neighbours), np.asarray(families.reverse)
    assert np.array_equal(alive & before, alive[back] & before)


def test_the_crack_grows_from_the_notch(runs):
    _, found = runs
    hit = found[2].observed["damage"][-1] > 0.2
    assert np.abs(X[hit, 1] - 8.0).max() < 8.0 and X[hit, 0].max() > 13.0
    first = np.argmax((found[2].observed["damage"] > 0).any(axis=1))
    tip = X[found[2].observed["damage"][first] > 0]
    assert np.linalg.norm(tip - [12.0, 8.0], axis=1).min() < 3.015


def test_a_run_in_which_nothing_breaks_is_the_run_without_breaking():
    motion = notched(MODELS["LPS"])
    with_criterion = run(motion, 0.4, pd.CriticalStretch(10.0), steps=12)
    without = run(motion, 0.4, None, steps=12)
    assert without.alive is None and np.array_equal(with_criterion.alive, np.asarray(NOTCHED.weight) > 0)
    size = np.abs(without.u).max()
    assert np.abs(with_criterion.u - without.u).max() < 1e-14 * size  # measured 0
    assert float(with_criterion.energies.released[-1]) == 0


def test_compression_breaks_nothing():
    families = pd.families(BODY, 3.015)
    history = run(notched(MODELS["bond-based"], families, -0.01 * (X - X.mean(axis=0))), 0.2, steps=3)
    stretch = np.linalg.norm(np.asarray(families.bonds(history.u[-1]).eta), axis=-1)
    assert stretch.max() > 0.05 and np.array_equal(history.alive, np.asarray(families.weight) > 0)


def test_bonds_of_the_no_fail_zone_do_not_break():
    safe = X[:, 0] < 11.0
    criterion = pd.CriticalStretch(0.01, no_fail=safe)
    history = run(notched(MODELS["bond-based"]), 0.4, criterion)
    lost = (np.asarray(NOTCHED.weight) > 0) & ~np.asarray(history.alive)
    ends = safe[:, None] | safe[np.asarray(NOTCHED.neighbours)]
    assert lost.any() and not (lost & ends).any()


@pytest.mark.parametrize("name", list(MODELS))
def test_streamed_forces_give_the_same_crack(name, monkeypatch):
    whole = run(notched(MODELS[name]), 0.4, steps=30)
    monkeypatch.setattr(padded, "SMALL", 0)
    fresh = eqx.tree_at(lambda f: f.volumes, NOTCHED, NOTCHED.volumes + 0)  # families that remember no backend
    streamed = run(notched(MODELS[name], fresh), 0.4, steps=30)
    assert np.array_equal(whole.alive, streamed.alive) and not whole.alive.all()
    assert np.abs(whole.u - streamed.u).max() < 1e-12 * np.abs(whole.u).max()  # measured 1e-14


def test_a_run_with_cracks_is_resumed_bit_for_bit(tmp_path):
    motion, file = notched(MODELS["LPS"]), tmp_path / "run.npz"
    dt = 0.4 * pd.critical_time_step(motion)
    settings = {"dt": dt, "save_every": 15, "breaking": STRETCH, "show_progress": False}
    whole = pd.simulate(motion, 90 * dt, **settings)
    pd.simulate(motion, 45 * dt, checkpoint=file, **settings)
    resumed = pd.simulate(motion, 90 * dt, checkpoint=file, resume=True, **settings)
    assert not whole.alive.all() and np.array_equal(whole.alive, resumed.alive)
    assert np.array_equal(whole.u, resumed.u)
    assert np.array_equal(whole.energies.released, resumed.energies.released)
    with pytest.raises(ValueError, match="belongs to another run"):
        pd.simulate(
            motion, 90 * dt, checkpoint=file, resume=True, **(settings | {"breaking": pd.CriticalStretch(0.02)})
        )


def test_the_broken_body_can_be_judged(runs):
    """The families after the run hold the crack, and keep the reference sums of the intact body."""
    motion, found = runs
    after = motion.scene.families.with_broken(~np.asarray(found[0].alive))
    model, u = motion.scene.model, np.asarray(found[0].u[-1])
    energy = float(pd.strain_energy(model, after, u))
    assert energy == pytest.approx(float(found[0].energies.strain[-1]), rel=1e-13)  # measured 1e-15
    alone = pd.force_density(model, after, u)
    gradient = jax.grad(lambda w: pd.strain_energy(model, after, w))(jnp.asarray(u))
    assert np.abs(alone + gradient).max() < 1e-13 * np.abs(alone).max()  # volumes are 1; measured 1e-15


def test_a_gradient_flows_up_to_the_first_break():
    """Before any bond breaks the run is that without breaking, and so are its derivatives; it runs under jit."""
    families = NOTCHED
    dt = 0.4 * pd.critical_time_step(notched(MODELS["bond-based"]))

    def end(c, breaking):
        motion = notched(pd.BondBased(c), families)
        history = pd.simulate(motion, 6 * dt, dt=dt, save_every=6, breaking=breaking, show_progress=False)
        return jnp.sum(history.u[-1] ** 2)

    plain, broken = (jax.jit(jax.grad(lambda c, b=b: end(c, b)))(1.0) for b in (None, pd.CriticalStretch(1.0)))
    assert float(broken) == pytest.approx(float(plain), rel=1e-12)  # measured 1e-15
    assert float(plain) != 0


def test_what_cannot_break_is_refused():
    with pytest.raises(ValueError, match="smoothing cannot serve Correspondence"):
        run(notched(pd.Correspondence(LAW)), 0.4, pd.CriticalStretch(0.01, smoothing=1e-3))
    with pytest.raises(ValueError, match="breaking must be"):
        run(notched(MODELS["LPS"]), 0.4, breaking=0.01)
    wave = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0), F=[[1.01]])
    with pytest.raises(ValueError, match="mean deformation"):
        pd.simulate(wave, 1.0, breaking=STRETCH, show_progress=False)
    with pytest.raises(ValueError, match="no_fail must have one entry for each of the 384 points"):
        run(notched(MODELS["LPS"]), 0.4, pd.CriticalStretch(0.01, no_fail=np.zeros(3, bool)))


def test_the_spall_bar_breaks_where_and_when_wave_theory_says():
    motion, expected = pd.scenes.spall_bar(300)
    families = motion.scene.families
    delta = float(families.horizon)
    dt = 0.4 * pd.critical_time_step(motion)
    history = pd.simulate(
        motion,
        dt=dt,
        save_every=1,
        observers={"damage": pd.observers.damage()},
        breaking=pd.CriticalStretch(0.1 * expected.strain),
        fields=False,
        show_progress=False,
    )
    damage = history.observed["damage"]
    first = int(np.argmax((damage > 0).any(axis=1)))
    place = np.asarray(families.positions)[damage[first] > 0, 0]
    assert abs(place.mean() - expected.place) < 0.5 * delta
    assert 0 < history.times[first] - expected.time < 2 * delta
    assert float(np.abs(history.energies.error).max()) < 1e-3
