"""The audit as an observer of `simulate`: it stops a run, records, and survives a checkpoint."""

import jax
import numpy as np
import pytest
from table import LINEAR

import pdjax as pd

SVK = pd.SethHill(1.0, LINEAR)
RUN = {"dt": 0.05, "save_every": 4, "show_progress": False}


def driven():
    """A short bar that is compressed more and more from rest. SethHill m = 1 fails under compression."""
    body = pd.bar(24, 24.0)
    left, right = body.positions[:, 0] < 3, body.positions[:, 0] > 21
    scene = pd.scene(body, pd.families(body, 3.0), SVK, pd.prescribe(left, 0.0), pd.prescribe(right, -1.0))
    return pd.motion(scene, schedule=lambda t: 0.5 * t)


@pytest.fixture(scope="module")
def motion():
    return driven()


@pytest.fixture(scope="module")
def flagged(motion):
    return pd.simulate(motion, 2.0, observers={"trust": pd.trust_observer("flag")}, **RUN)


def test_flag_records_what_audit_measures_at_every_save(motion, flagged):
    seen = flagged.observed["trust"]
    assert flagged.finished and len(flagged.times) == 11 and flagged.stopped_by == ""
    for save in (0, 5, 10):
        state = pd.audit(SVK, motion.scene.families, flagged.u[save], held=~motion.scene.free, body=False)
        assert seen["zero_energy"][save] == state.zero_energy.max() and seen["det"][save] == state.det.min()
        assert seen["margin"][save] == np.nanmax(state.margin)
        assert (seen["score"][save] >= 2) == (state.verdict == "untrusted")
    assert seen["score"][0] < 1 and seen["reason"][0] == ""


def test_stop_ends_the_run_at_the_first_untrusted_save(motion, flagged):
    history = pd.simulate(motion, 2.0, observers={"trust": pd.trust_observer()}, **RUN)
    first = int(np.argmax(flagged.observed["trust"]["score"] >= 2))
    assert 0 < first < 10 and len(history.times) == first + 1
    assert not history.finished and history.ending.name == "STOPPED" and history.failure is None
    reason = str(flagged.observed["trust"]["reason"][first])
    assert history.stopped_by == f"trust, {reason}" and history.reason.endswith(reason) and "point" in reason
    assert np.array_equal(history.u, flagged.u[: first + 1])  # watching changes no number
    with pytest.raises(RuntimeError, match="an observer stopped the run"):
        pd.simulate(motion, 2.0, observers={"trust": pd.trust_observer()}, throw=True, **RUN)


def test_a_resumed_run_is_the_same_bit_for_bit_and_stops_at_the_same_save(motion, flagged, tmp_path):
    path, flag = tmp_path / "run.npz", {"trust": pd.trust_observer("flag")}
    pd.simulate(motion, 1.0, observers=flag, checkpoint=path, **RUN)
    resumed = pd.simulate(motion, 2.0, observers=flag, checkpoint=path, resume=True, **RUN)
    assert np.array_equal(resumed.u, flagged.u) and np.array_equal(resumed.times, flagged.times)
    for key, values in flagged.observed["trust"].items():
        assert np.array_equal(resumed.observed["trust"][key], values, equal_nan=values.dtype.kind == "f"), key
    stop, path = {"trust": pd.trust_observer()}, tmp_path / "stopped.npz"
    stopped = pd.simulate(motion, 2.0, observers=stop, checkpoint=path, **RUN)
    again = pd.simulate(motion, 2.0, observers=stop, checkpoint=path, resume=True, **RUN)
    assert not again.finished and again.stopped_by == stopped.stopped_by and np.array_equal(again.u, stopped.u)
    with pytest.raises(ValueError, match="another"):  # an observer of another action is another run
        pd.simulate(motion, 2.0, observers=flag, checkpoint=path, resume=True, **RUN)


def test_a_run_with_breaking_bonds_is_audited_with_the_bonds_that_remain():
    """With all bonds, the gap of the crack would be a strain without bound."""
    body = pd.lattice((12, 8))
    families, model = pd.families(body, 2.0), pd.LPS(1.0, 0.6)
    apart = np.stack([0.05 * np.sign(body.positions[:, 0] - 5.6), np.zeros(96)], axis=1)
    motion = pd.motion(pd.scene(body, families, model, moving=True), velocity=apart)
    seen = {}

    class Watch:
        def __call__(self, scene, now):
            seen[float(now.t)] = now
            return {"t": now.t}

        def stops(self, value):
            return ""

    watch = {"trust": pd.trust_observer("flag", margins=False), "states": Watch()}
    run = {"dt": 0.5, "save_every": 20, "show_progress": False}
    history = pd.simulate(motion, 40.0, observers=watch, breaking=pd.CriticalStretch(0.02), **run)
    now = seen[float(history.times[-1])]
    remaining = families.with_broken((np.asarray(families.weight) > 0) & ~np.asarray(now.alive))
    state = pd.audit(model, remaining, now.u, margins=False, body=False)
    assert not now.alive[families.is_bond].all() and len(seen) == 5
    assert history.observed["trust"]["zero_energy"][-1] == state.zero_energy.max()
    assert history.observed["trust"]["det"][-1] == state.det.min() > 0.5
    intact = pd.audit(model, families, now.u, margins=False, body=False)
    assert intact.stretches[1] > 2 > state.stretches[1]


def test_only_simulate_without_a_transformation_accepts_it(motion):
    watch = {"trust": pd.trust_observer()}
    with pytest.raises(ValueError, match="runs on the host"):
        pd.simulate_diffrax(motion, 1.0, observers=watch)
    with pytest.raises(ValueError, match="runs on the host"):
        jax.jit(lambda x: pd.simulate(motion, 1.0 + 0 * 1, observers=watch, **RUN).u * x)(1.0)
    with pytest.raises(ValueError, match="action"):
        pd.trust_observer("halt")


class Counting:
    """A host observer of a user. It stops after three saves."""

    def __init__(self):
        self.times, self.kinds = [], set()

    def __call__(self, scene, now):
        self.times.append(float(now.t))
        self.kinds |= {type(x) for x in (now.u, now.v, now.force)}
        return {"n": len(self.times), "mid": now.u[12]}

    def stops(self, value):
        return "three saves" if value["n"] == 3 else ""


def test_a_users_observer_is_called_once_a_save_with_numpy_arrays(motion, flagged):
    watch = Counting()
    history = pd.simulate(motion, 2.0, observers={"mine": watch, "tip": pd.observers.probe([23])}, **RUN)
    assert watch.times == history.times.tolist() == pytest.approx([0.0, 0.2, 0.4], rel=1e-15)  # measured 0
    assert watch.kinds == {np.ndarray} and history.stopped_by == "mine, three saves"
    assert np.array_equal(history.observed["mine"]["mid"], flagged.u[:3, 12])
    assert np.abs(history.observed["tip"][:, 0, 0] - [0.0, -0.1, -0.2]).max() < 1e-16  # measured 0
