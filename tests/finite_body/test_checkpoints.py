"""Checkpoints: a stopped run continues without loss, and the checkpoint of another run is refused."""

import errno
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from test_dynamics import driven_bar

import pdjax as pd
from pdjax.finite_body.dynamics import checkpoint, run

RUN = {"dt": 0.1, "save_every": 4, "show_progress": False}


def same(one, other):
    """Every number of two histories, bit for bit."""
    pairs = [
        (one.times, other.times),
        (one.u, other.u),
        (one.v, other.v),
        *zip(one.energies, other.energies, strict=True),
    ]
    pairs += [(one.observed[name], other.observed[name]) for name in one.observed]
    return all(np.array_equal(a, b) for a, b in pairs)


def test_a_resumed_run_equals_an_uninterrupted_run_bit_for_bit(tmp_path):
    motion, path = driven_bar(), tmp_path / "run.npz"
    watch = {"tip": pd.observers.probe([7]), "cut": pd.observers.section_force(motion.scene.body, 7.0)}
    whole = pd.simulate(motion, 8.0, observers=watch, **RUN)
    pd.simulate(motion, 3.0, observers=watch, checkpoint=path, checkpoint_every=2, **RUN)
    resumed = pd.simulate(motion, 8.0, observers=watch, checkpoint=path, resume=True, **RUN)
    assert same(whole, resumed) and len(whole.times) == 21
    again = pd.simulate(motion, 8.0, observers=watch, checkpoint=path, resume=True, **RUN)  # no step is left
    assert same(whole, again)


def test_an_interrupted_run_resumes_from_its_checkpoint(tmp_path, monkeypatch):
    motion, path = driven_bar(), tmp_path / "run.npz"
    original, calls = run._go_on, []

    def stops(*arguments):
        calls.append(1)
        if len(calls) == 6:
            raise KeyboardInterrupt
        return original(*arguments)

    stops.lower = original.lower
    monkeypatch.setattr(run, "_go_on", stops)
    with pytest.raises(KeyboardInterrupt):
        pd.simulate(motion, 8.0, checkpoint=path, **RUN)
    monkeypatch.setattr(run, "_go_on", original)
    resumed = pd.simulate(motion, 8.0, checkpoint=path, resume=True, **RUN)
    assert same(pd.simulate(motion, 8.0, **RUN), resumed)
    assert [p.name for p in tmp_path.iterdir()] == ["run.npz"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda: (driven_bar(damping=0.3), RUN), "belongs to another run"),
        (lambda: (driven_bar(m=0.9), RUN), "belongs to another run"),
        (lambda: (driven_bar(n=15), RUN), "belongs to another run"),
        (lambda: (driven_bar(ramp=pd.Ramp), RUN), "belongs to another run"),
        (lambda: (driven_bar(), RUN | {"dt": 0.11}), "belongs to another run"),
        (lambda: (driven_bar(), RUN | {"save_every": 5}), "belongs to another run"),
        (lambda: (driven_bar(), RUN | {"observers": {"x": pd.observers.probe([3])}}), "belongs to another run"),
    ],
)
def test_a_checkpoint_of_another_run_is_refused(tmp_path, change, words):
    path = tmp_path / "run.npz"
    pd.simulate(driven_bar(), 2.0, checkpoint=path, **RUN)
    motion, how = change()
    before = path.read_bytes()
    with pytest.raises(ValueError, match=words):
        pd.simulate(motion, 4.0, checkpoint=path, resume=True, **how)
    assert path.read_bytes() == before


def test_a_checkpoint_distinguishes_schedules_by_what_they_compute(tmp_path):
    """Two functions with the same code and different closures make different runs."""
    path = tmp_path / "run.npz"

    def made(rate):
        base = driven_bar()
        return pd.motion(base.scene, schedule=lambda t: rate * t)

    pd.simulate(made(0.1), 2.0, checkpoint=path, **RUN)
    assert pd.simulate(made(0.1), 4.0, checkpoint=path, resume=True, **RUN).finished
    with pytest.raises(ValueError, match="another run"):
        pd.simulate(made(0.2), 4.0, checkpoint=path, resume=True, **RUN)


def test_files_that_are_not_checkpoints_are_refused(tmp_path, monkeypatch):
    motion, path = driven_bar(), tmp_path / "run.npz"
    with pytest.raises(FileNotFoundError, match="no checkpoint at"):
        pd.simulate(motion, 2.0, checkpoint=path, resume=True, **RUN)
    pd.simulate(motion, 2.0, checkpoint=path, **RUN)
    whole = path.read_bytes()
    for broken in (b"nonsense", whole[: len(whole) // 2], b""):
        path.write_bytes(broken)
        with pytest.raises(ValueError, match="is not a checkpoint of pdjax, or is damaged"):
            pd.simulate(motion, 2.0, checkpoint=path, resume=True, **RUN)
    path.write_bytes(whole)
    monkeypatch.setattr(checkpoint, "VERSION", "99.0")
    with pytest.raises(ValueError, match=r"written by pdjax .*, this is 99\.0"):
        pd.simulate(motion, 2.0, checkpoint=path, resume=True, **RUN)
    with pytest.raises(FileNotFoundError, match="does not exist"):
        pd.simulate(motion, 2.0, checkpoint=tmp_path / "nowhere" / "x.npz", **RUN)


def test_a_full_disk_gives_a_warning_and_the_run_finishes(tmp_path, monkeypatch):
    motion, path = driven_bar(), tmp_path / "run.npz"
    pd.simulate(motion, 2.0, checkpoint=path, **RUN)
    before = path.read_bytes()

    @contextmanager
    def full(path):
        raise OSError(errno.ENOSPC, "No space left on device")
        yield

    monkeypatch.setattr(checkpoint, "written_whole", full)
    with pytest.warns(UserWarning, match="No space left on device"):
        history = pd.simulate(motion, 4.0, checkpoint=path, resume=True, **RUN)
    assert history.finished and path.read_bytes() == before


KILLED = """
import sys
import jax
jax.config.update("jax_enable_x64", True)
sys.path.insert(0, {tests!r})
import pdjax as pd
body = pd.bar(14, 14.0)
fixed = pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0)), moving=True)
motion = pd.motion(fixed, start=0.01 * (body.positions - 7.0))
pd.simulate(motion, 1e7, dt=0.1, save_every=4, checkpoint={path!r}, show_progress=False)
"""


def test_a_killed_run_leaves_a_valid_checkpoint(tmp_path):
    """SIGKILL while the run writes one checkpoint after another: the last one is whole, and the run can continue."""
    path = tmp_path / "run.npz"
    code = KILLED.format(tests=str(Path(__file__).parent), path=str(path))
    child = subprocess.Popen([sys.executable, "-c", code])
    try:
        for _ in range(600):
            if path.exists():
                break
            time.sleep(0.1)
        time.sleep(0.5)
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    saved = len(np.load(path)["record_0"]) - 1
    assert saved > 2
    body = pd.bar(14, 14.0)
    fixed = pd.scene(body, pd.families(body, 2.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0)), moving=True)
    motion = pd.motion(fixed, start=0.01 * (body.positions - 7.0))
    duration = 0.4 * (saved + 3) - 0.05
    resumed = pd.simulate(motion, duration, checkpoint=path, resume=True, **RUN)
    assert same(pd.simulate(motion, duration, **RUN), resumed)


def test_an_existing_checkpoint_is_kept(tmp_path):
    motion, path = driven_bar(), tmp_path / "run.npz"
    pd.simulate(motion, 2.0, checkpoint=path, **RUN)
    first = path.read_bytes()
    with pytest.warns(UserWarning, match=r"is kept as .*run\.npz\.old; to continue from it, pass resume=True"):
        pd.simulate(motion, 2.0, checkpoint=path, **RUN)
    assert (tmp_path / "run.npz.old").read_bytes() == first
