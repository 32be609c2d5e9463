"""`simulate`: one door to velocity Verlet. Watched on the host; under jit, vmap and grad the same steps, unwatched.

The run goes from save to save, `save_every` steps in one compiled scan; at a save the budget of energy is drawn up, the
observers read, the checkpoint written. What is not finite, and energy that nothing gave, end it with the time, the
place and the mode.
"""

import math
import os
import time
import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._internal.checks import inside_jit, is_concrete, writable
from ..._internal.progress import progress
from ..._internal.public import public_function
from ..observers import Snapshot, check_observers
from . import checkpoint as checkpoints
from .history import DONE, ENERGY_GREW, NOT_FINITE, Failure, History, alarmed, as_arrays, failure, stacked
from .system import Motion, check_schedule
from .time_step import SAFETY, critical_time_step
from .verlet import Energies, State, advance, before_start, borrowed, energies, initial_state, march

SAVES = 100  # about as many, where save_every is not given
NOISE = 1e6  # steps in which rounding forces of one sign add up: longer runs than that have other worries


class Record(NamedTuple):
    """What a save keeps."""

    t: Array
    fields: tuple[Array, ...]
    energies: Energies
    observed: dict[str, Any]
    borrowed: tuple[Array, Array]
    finite: Array


def _record(motion: Motion, observers: dict[str, Any], state: State, dt, fields: bool) -> Record:
    t = state.step * dt
    now = Snapshot(t, motion.factor(t)[0], state.u, state.v, state.force)
    observed = {name: watch(motion.scene, now) for name, watch in observers.items()}
    kept = (state.u, state.v) if fields else ()
    return Record(t, kept, energies(motion, state, dt), observed, borrowed(motion, state, dt), state.finite)


def _rounding(motion: Motion, dt: float) -> float:
    """Kinetic energy that rounding may lend to bonds that stretch as the start's do: where modes hold no energy it is
    all there is."""
    scene, families = motion.scene, motion.scene.families
    u, neighbours = np.asarray(motion.start), np.asarray(families.neighbours)
    stretch = max((float(np.abs(u[ends] - u).max()) for ends in neighbours.T), default=0.0)
    stretch += float(np.abs(np.asarray(scene.prescribed)).max())
    mass = float(np.sum(np.asarray(motion.density) * np.asarray(families.volumes)))
    return mass * (NOISE * float(np.finfo(u.dtype).eps) * stretch / dt) ** 2


@eqx.filter_jit
def _go_on(motion: Motion, observers: dict[str, Any], state: State, dt, steps, fields: bool):
    """All of a watched run: the steps to the next save, and the first state, which costs one step of no length."""
    state = march(motion, state, dt, steps)
    return state, _record(motion, observers, state, dt, fields)


@eqx.filter_jit
def _traced(motion: Motion, observers: dict[str, Any], dt, saves: int, every: int, fields: bool) -> History:
    """The whole run in one scan."""
    state = initial_state(motion)
    first = _record(motion, observers, state, dt, fields)

    @jax.checkpoint
    def chunk(state, _):
        state = advance(motion, state, dt, every)
        return state, _record(motion, observers, state, dt, fields)

    state, records = jax.lax.scan(chunk, state, length=saves)
    all_of = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, records)

    def alive(x: Array) -> Array:
        """NaN from the save on at which a value was not finite: nobody watches, and a frozen state is no answer."""
        if not jnp.issubdtype(x.dtype, jnp.inexact):
            return x
        return jnp.where(all_of.finite.reshape(-1, *[1] * (x.ndim - 1)), x, jnp.nan)

    _, kept, budget, observed, _, _ = jax.tree.map(alive, all_of)
    u, v = kept if fields else (jnp.where(state.finite, x, jnp.nan)[None] for x in (state.u, state.v))
    times = dt * every * jnp.arange(saves + 1)
    return History(times, u, v, budget, observed, dt, state.step)


def run_length(motion: Motion, duration) -> float:
    """The duration asked for, or the motion's own, checked."""
    duration = motion.duration if duration is None else duration
    if duration is None:
        raise ValueError("duration must be given: this motion has no natural one")
    duration = float(duration)
    if not (math.isfinite(duration) and duration > 0):
        raise ValueError(f"duration must be finite and > 0; got {duration}")
    return duration


def time_step(motion: Motion, dt) -> float:
    """The step asked for, or SAFETY of the critical one, checked."""
    if dt is None:
        dt = SAFETY * critical_time_step(motion)
        if not math.isfinite(dt):
            raise ValueError("nothing resists at the start, so no critical time step exists: give dt")
    if not is_concrete(dt):
        raise ValueError("dt decides how many steps there are, so it can't be traced; pass a plain number")
    dt = float(dt)
    if not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be finite and > 0; got {dt}")
    return dt


def _plan(motion: Motion, duration, dt, save_every) -> tuple[float, int, int]:
    """(dt, saves, save_every)."""
    duration, own = run_length(motion, duration), dt is None
    dt = time_step(motion, dt)
    if own:
        dt = min(dt, duration / SAVES)
    steps = max(1, math.ceil(duration / dt * (1 - 1e-12)))
    if save_every is None:
        save_every = max(1, round(steps / SAVES))
    if not (float(save_every).is_integer() and save_every >= 1):
        raise ValueError(f"save_every must be a whole number of steps >= 1; got {save_every!r}")
    save_every = int(save_every)
    saves = math.ceil(steps / save_every)
    if saves * save_every >= 2**31:
        raise ValueError(f"a run has fewer than 2³¹ steps; duration {duration:g} at dt {dt:g} has {steps:.3g}")
    return (duration / (saves * save_every) if own else dt), saves, save_every


def _warn_above(motion: Motion, dt: float) -> None:
    critical = critical_time_step(motion)
    if dt > critical:
        warnings.warn(
            f"dt = {dt:.6g} is above the critical time step {critical:.6g} of the start: the run will blow up",
            stacklevel=4,
        )


def _warn_beyond(duration: float, dt: float, saves: int, every: int) -> None:
    """A run ends at a save: one that is far beyond what was asked is said."""
    end = saves * every * dt
    if end > 1.1 * duration and every > 1:
        warnings.warn(
            f"the run goes on to t = {end:.6g}, beyond the duration {duration:.6g}: it ends at a save, and save_every ="
            f" {every} steps of {dt:.6g} take {every * dt:.6g}; a smaller save_every ends it nearer",
            stacklevel=4,
        )


class _Keeper:
    """Writes checkpoints, every so many saves, and no more often than costs a twentieth of the run."""

    def __init__(self, path, every: int, name: str):
        self.path, self.every, self.name = path, every, name
        self.not_before = 0.0

    def __call__(self, save: int, state: State, records: list[Record], at_once: bool = False) -> None:
        now = time.monotonic()
        if self.path is None or (not at_once and (save % self.every or now < self.not_before)):
            return
        checkpoints.save(self.path, self.name, state, records)
        self.not_before = now + 20 * (time.monotonic() - now)


def _watch(motion: Motion, observers, dt, saves, every, fields, path, checkpoint_every, resume, show) -> History:
    step, one, many = np.asarray(dt, motion.start.dtype), np.int32(1), np.int32(every)
    ready = motion.prepared()
    state, first = _go_on(ready, observers, before_start(motion), step, one, fields)
    records, name = [first], ""
    if path is not None:
        path = writable(path)
        if path.exists() and not resume:
            old = path.with_name(path.name + ".old")
            os.replace(path, old)
            warnings.warn(f"{path} was there: it is kept as {old}; to go on from it, resume=True", stacklevel=4)
        program = _go_on.lower(ready, observers, state, step, many, fields).as_text()  # type: ignore[attr-defined]
        name = checkpoints.fingerprint(program, dt, every, eqx.filter((motion, observers), eqx.is_array_like))
        if resume:
            state, records = checkpoints.load(path, name, first)
            records = records[: saves + 1]
    keep = _Keeper(path, checkpoint_every, name)
    stored = abs(float(first.energies.strain))
    if not motion.scene.model.hyperelastic:  # no energy to ask: what the forces at the start could do on the way back
        stored = 0.5 * float(np.abs(np.asarray(state.force) * np.asarray(motion.start)).sum())
    floor = _rounding(motion, dt) + float(first.energies.kinetic) + stored
    given, code, saved = max(_given(r) for r in records), DONE, state
    done = len(records) - 1
    if not bool(state.finite):
        code = NOT_FINITE
    try:
        for save in progress(range(done + 1, saves + 1), saves - done, "steps", show) if code == DONE else ():
            state, record = _go_on(ready, observers, saved, step, many, fields)
            if not bool(state.finite):
                code = NOT_FINITE
                break
            record = jax.tree.map(np.asarray, record)
            records.append(record)
            given = max(given, _given(record))
            swing = float(record.borrowed[0]) - float(first.borrowed[0])
            if alarmed(first.energies, record.energies, swing, floor + given):
                code = ENERGY_GREW
                break
            saved = state
            keep(save, state, records, at_once=save == saves)
    except KeyboardInterrupt:
        keep(len(records) - 1, saved, records, at_once=True)
        raise
    told = None if code == DONE else _diagnose(motion, state, saved, dt)
    out = stacked(records)
    last = saved if code == NOT_FINITE else state
    u, v = out.fields if fields else (np.asarray(last.u)[None], np.asarray(last.v)[None])
    steps = min(int(state.step), saves * every)
    return History(out.t, u, v, as_arrays(out.energies), out.observed, dt, steps, code, told)


def _given(record: Record) -> float:
    """The energy that supports and loads had given, or could in a step, at one save."""
    return abs(float(record.energies.supports)) + abs(float(record.energies.loads)) + float(record.borrowed[1])


def _diagnose(motion: Motion, state: State, saved: State, dt: float) -> Failure:
    critical = []
    for u, t in ((motion.start, 0.0), (saved.u, int(saved.step) * dt)):
        try:
            critical.append(critical_time_step(motion, u, t))
        except ValueError:
            critical.append(float("nan"))
    return failure(motion, state, saved, dt, (critical[0], critical[1]))


@public_function
def simulate(
    motion: Motion,
    duration: float | None = None,
    *,
    dt=None,
    save_every: int | None = None,
    observers: dict[str, Any] | None = None,
    fields: bool = True,
    checkpoint: str | os.PathLike | None = None,
    checkpoint_every: int = 1,
    resume: bool = False,
    show_progress: bool = True,
    throw: bool = False,
) -> History:
    """Run a motion by velocity Verlet.

    Arguments: duration [time], the motion's own by default; dt [time], by default 0.8 of the critical step at the
        start or a hundredth of the duration, shortened so that the run ends at duration (a dt of yours is taken as it
        is, the run ends at the first save not before duration, and a checkpoint can be gone on from to a longer one);
        save_every steps, by default such that there are about 100 saves; observers: name → function (scene, `Snapshot`)
        → array, see `pdjax.observers`; fields: keep u and v of every save, or of the last alone; checkpoint: a file,
        written every `checkpoint_every` saves, or less often where that would cost more than a twentieth of the run,
        and when interrupted (one that is there already is kept as FILE.old); resume from it, bit for bit; throw: raise
        where it ends early.
    Returns: `History`. Under jit, vmap or grad: the same numbers, differentiable forward and backward (memory: 2
        √save_every states a save), but unwatched and without checkpoint: NaN from the save on at which a value was
        not finite; under jit and vmap dt must be given.
    Raises: ValueError for bad arguments, a schedule that is not finite, a checkpoint of another run or version;
        RuntimeError with the reason if `throw`. Warns where dt is above the critical step.
    """
    if not isinstance(motion, Motion):
        raise ValueError(f"motion must be a Motion (pdjax.motion or a moving scene); got {type(motion).__name__}")
    if isinstance(checkpoint_every, bool) or not isinstance(checkpoint_every, int | np.integer) or checkpoint_every < 1:
        raise ValueError(f"checkpoint_every must be a whole number of saves >= 1; got {checkpoint_every!r}")
    if resume and checkpoint is None:
        raise ValueError("resume needs checkpoint: the file to go on from")
    observers = {} if observers is None else observers
    check_observers(motion.scene, observers)
    watched = is_concrete(motion, observers) and not inside_jit()
    given = dt is not None
    dt, saves, every = _plan(motion, duration, dt, save_every)
    if not watched:
        return _traced(motion, observers, np.asarray(dt, motion.start.dtype), saves, every, fields)
    check_schedule(motion, np.linspace(0, saves * every * dt, 1025).astype(motion.start.dtype))
    if given:
        _warn_above(motion, dt)
        _warn_beyond(run_length(motion, duration), dt, saves, every)
    history = _watch(motion, observers, dt, saves, every, fields, checkpoint, checkpoint_every, resume, show_progress)
    if throw and not history.finished:
        raise RuntimeError(f"the motion of the {motion.scene.name} ended early: {history.reason}")
    return history
