"""`simulate`: one door to velocity Verlet. Watched on the host; under jit, vmap and grad the same steps, unwatched.

The run goes from save to save, `save_every` steps in one compiled scan; at a save the budget of energy is drawn up, the
observers read, the checkpoint written. What is not finite, and energy that nothing gave, end it with the time, the
place and the mode.
"""

import math
import os
import warnings
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._checks import is_concrete, writable
from .._progress import progress
from ..observers import Snapshot
from . import checkpoint as checkpoints
from .history import DONE, ENERGY_GREW, NOT_FINITE, Failure, History, as_arrays, failure, grew, stacked, supplied
from .system import Motion, check_schedule
from .time_step import SAFETY, critical_time_step
from .verlet import Energies, State, advance, energies, initial_state

SAVES = 100  # about as many, where save_every is not given
NOISE = 1e6  # steps in which rounding forces of one sign add up: longer runs than that have other worries


class Record(NamedTuple):
    """What a save keeps."""

    t: Array
    fields: tuple[Array, ...]
    energies: Energies
    observed: dict[str, Any]


def _record(motion: Motion, observers: dict[str, Any], state: State, dt: Array, fields: bool) -> Record:
    t = state.step * dt
    now = Snapshot(t, motion.factor(t)[0], state.u, state.v, state.force)
    observed = {name: watch(motion.scene, now) for name, watch in observers.items()}
    return Record(t, (state.u, state.v) if fields else (), energies(motion, state, dt), observed)


@eqx.filter_jit
def _begin(motion: Motion, observers: dict[str, Any], dt: Array, fields: bool) -> tuple[State, Record]:
    state = initial_state(motion)
    return state, _record(motion, observers, state, dt, fields)


@eqx.filter_jit
def _rounding(motion: Motion, dt: Array) -> Array:
    """Kinetic energy that rounding may lend to bonds that stretch as the start's do: where modes hold no energy it is
    all there is."""
    bonds = motion.scene.families.bonds(motion.start)
    stretch = jnp.max(jnp.abs(bonds.eta)) + jnp.max(jnp.abs(motion.scene.prescribed))
    return jnp.sum(motion.mass) * (NOISE * jnp.finfo(dt.dtype).eps * stretch / dt) ** 2


@eqx.filter_jit
def _go_on(motion: Motion, observers: dict[str, Any], state: State, dt: Array, steps: int, fields: bool):
    state = advance(motion, state, dt, steps)
    return state, _record(motion, observers, state, dt, fields)


def _traced(motion: Motion, observers: dict[str, Any], dt: Array, saves: int, every: int, fields: bool) -> History:
    """The whole run in one scan."""
    state, first = _begin(motion, observers, dt, fields)

    @jax.checkpoint
    def chunk(state, _):
        return _go_on(motion, observers, state, dt, every, fields)

    state, records = jax.lax.scan(chunk, state, length=saves)
    all_of = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, records)
    u, v = all_of.fields if fields else (state.u[None], state.v[None])
    return History(all_of.t, u, v, all_of.energies, all_of.observed, dt, state.step)


def _plan(motion: Motion, duration, dt, save_every) -> tuple[float, int, int]:
    """(dt, saves, save_every)."""
    duration = motion.duration if duration is None else duration
    if duration is None:
        raise ValueError("duration must be given: this motion has no natural one")
    duration = float(duration)
    if not (math.isfinite(duration) and duration > 0):
        raise ValueError(f"duration must be finite and > 0; got {duration}")
    own = dt is None
    if own:
        dt = SAFETY * critical_time_step(motion)
        if not math.isfinite(dt):
            raise ValueError("nothing resists at the start, so no critical time step exists: give dt")
    dt = float(dt)
    if not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be finite and > 0; got {dt}")
    steps = max(1, math.ceil(duration / dt * (1 - 1e-12)))
    if save_every is None:
        save_every = max(1, round(steps / SAVES))
    if not (float(save_every).is_integer() and save_every >= 1):
        raise ValueError(f"save_every must be a whole number of steps >= 1; got {save_every!r}")
    saves = math.ceil(steps / save_every)
    return (duration / (saves * int(save_every)) if own else dt), saves, int(save_every)


def _warn_above(motion: Motion, dt: float) -> None:
    critical = critical_time_step(motion)
    if dt > critical:
        warnings.warn(
            f"dt = {dt:.6g} is above the critical time step {critical:.6g} of the start: the run will blow up",
            stacklevel=4,
        )


def _watch(motion: Motion, observers, dt, saves, every, fields, path, checkpoint_every, resume, show) -> History:
    step = jnp.asarray(dt, motion.start.dtype)
    state, first = _begin(motion, observers, step, fields)
    records, name = [first], ""
    if path is not None:
        name = checkpoints.fingerprint(motion, observers, dt, every, fields)
        path = writable(path)
        if resume:
            state, records = checkpoints.load(path, name, first)
    code, told = DONE, None
    floor, given = float(_rounding(motion, step)), max(supplied(r.energies) for r in records)
    done = len(records) - 1
    if not bool(state.finite):
        code = NOT_FINITE
    for save in progress(range(done, saves), saves - done, "steps", show) if code == DONE else ():
        state, record = _go_on(motion, observers, state, step, every, fields)
        if not bool(state.finite):
            code = NOT_FINITE
            break
        records.append(jax.tree.map(np.asarray, record))
        given = max(given, supplied(record.energies))
        if grew(first.energies, record.energies, floor + given):
            code = ENERGY_GREW
            break
        if path is not None and ((save + 1) % checkpoint_every == 0 or save + 1 == saves):
            checkpoints.save(path, name, state, records)
    if code != DONE:
        told = _diagnose(motion, state, dt, code)
    out = stacked(records)
    u, v = out.fields if fields else (np.asarray(state.u)[None], np.asarray(state.v)[None])
    return History(out.t, u, v, as_arrays(out.energies), out.observed, dt, int(state.step), code, told)


def _diagnose(motion: Motion, state: State, dt: float, code: int) -> Failure:
    try:
        critical = critical_time_step(motion, state.u, state.step * dt)
    except ValueError:
        critical = float("nan")
    return failure(motion, state, dt, code, critical)


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
        start, shortened so that the run ends at duration (a dt of yours is taken as it is, and the run ends at the
        first save not before duration); save_every steps, by default such that there are about 100 saves; observers:
        name → function (scene, `Snapshot`) → array, see `pdjax.observers`; fields: keep u and v of every save, or of
        the last alone; checkpoint: a file, written every `checkpoint_every` saves; resume from it, bit for bit; throw:
        raise where it ends early.
    Returns: `History`. Under jit, vmap or grad: the same numbers, differentiable forward and backward (memory: 2
        √save_every states a save), but unwatched, without checkpoint; under jit and vmap dt must be given.
    Raises: ValueError for bad arguments, a schedule that is not finite, a checkpoint of another run or version;
        RuntimeError with the reason if `throw`. Warns where dt is above the critical step.
    """
    if not isinstance(motion, Motion):
        raise ValueError(f"motion must be a Motion (pdjax.motion or a moving scene); got {type(motion).__name__}")
    if checkpoint_every < 1:
        raise ValueError(f"checkpoint_every must be at least one save; got {checkpoint_every!r}")
    if resume and checkpoint is None:
        raise ValueError("resume needs checkpoint: the file to go on from")
    observers = {} if observers is None else observers
    watched = is_concrete(motion)
    given = dt is not None
    if not is_concrete(dt):
        raise ValueError("dt decides how many steps there are, so it can't be traced; pass a plain number")
    dt, saves, every = _plan(motion, duration, dt, save_every)
    if not watched:
        return _traced(motion, observers, jnp.asarray(dt, motion.start.dtype), saves, every, fields)
    check_schedule(motion, jnp.linspace(0, saves * every * dt, 1025).astype(motion.start.dtype))
    if given:
        _warn_above(motion, dt)
    history = _watch(motion, observers, dt, saves, every, fields, checkpoint, checkpoint_every, resume, show_progress)
    if throw and not history.finished:
        raise RuntimeError(f"the motion of the {motion.scene.name} ended early: {history.reason}")
    return history
