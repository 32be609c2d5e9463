"""`simulate`: runs of velocity Verlet, monitored on the host, or traced under jit, vmap and grad.

A save is a state that the run stores. A monitored run goes from save to save, with `save_every` steps in one compiled
program. At every save it computes the energy budget, evaluates the observers and writes the checkpoint. The run ends
early if a value is not finite, or if the energy exceeds what the start, the supports and the loads supplied. The result
then names the time, the place and the mode of the failure.

Under a transformation of JAX the same steps run without monitoring and without checkpoints.
"""

import math
import os
import time
import warnings
from collections.abc import Mapping
from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, PyTree

from ..._internal.checks import Numbers, inside_jit, is_concrete
from ..._internal.progress import progress
from ..._internal.public import public_function
from ..damage.criteria import Criterion
from ..observers import HostObserver, Snapshot, check_observers
from ..scene import Scene
from . import checkpoint as checkpoints
from .breaking import check_breaking, times_of_breaks
from .history import Failure, History, RunEnding, alarmed, as_arrays, failure, stacked
from .system import Motion, check_schedule
from .time_step import SAFETY, SAFETY_BREAKING, critical_time_step
from .verlet import Energies, State, advance, before_start, borrowed, energies, initial_state, march

SAVES = 100  # approximate number of saves if save_every is not given
NOISE = 1e6  # number of steps over which rounding forces of one sign are assumed to add up


@runtime_checkable
class Observer(Protocol):
    """A function (scene, snapshot) → array or tree of arrays."""

    def __call__(self, scene: Scene, now: Snapshot, /) -> PyTree: ...


class Record(NamedTuple):
    """What a run stores at one save."""

    t: Array
    fields: tuple[Array, ...]
    energies: Energies
    observed: dict[str, PyTree]
    borrowed: tuple[Array, Array]
    finite: Array


def _record(motion: Motion, observers: Mapping[str, Observer], state: State, dt, fields: bool) -> Record:
    t = state.step * dt
    alive = None if state.bonds is None else state.bonds.alive
    now = Snapshot(t, motion.factor(t)[0], state.u, state.v, state.force, alive)
    observed = {name: watch(motion.scene, now) for name, watch in observers.items()}
    kept = (state.u, state.v) if fields else ()
    return Record(t, kept, energies(motion, state, dt), observed, borrowed(motion, state, dt), state.finite)


def _rounding(motion: Motion, dt: float) -> float:
    """Kinetic energy that rounding errors may supply, for bonds stretched as at the start.

    In motions without any other energy, such as those of zero-energy modes, this is the only limit.
    """
    scene, families = motion.scene, motion.scene.families
    u, neighbours = np.asarray(motion.start), np.asarray(families.neighbours)
    stretch = max((float(np.abs(u[ends] - u).max()) for ends in neighbours.T), default=0.0)
    stretch += float(np.abs(np.asarray(scene.prescribed)).max())
    mass = float(np.sum(np.asarray(motion.density) * np.asarray(families.volumes)))
    return mass * (NOISE * float(np.finfo(u.dtype).eps) * stretch / dt) ** 2


@eqx.filter_jit
def _go_on(motion: Motion, observers: Mapping[str, Observer], state: State, dt, steps, fields: bool):
    """The only program of a monitored run: the steps to the next save. From `before_start` it makes the first state."""
    state = march(motion, state, dt, steps)
    return state, _record(motion, observers, state, dt, fields)


@eqx.filter_jit
def _traced(motion: Motion, observers: Mapping[str, Observer], dt, saves: int, every: int, fields: bool) -> History:
    """The whole run in one scan, for a transformation of JAX."""
    state = initial_state(motion)
    first = _record(motion, observers, state, dt, fields)

    @jax.checkpoint
    def chunk(state, _):
        state = advance(motion, state, dt, every)
        return state, _record(motion, observers, state, dt, fields)

    state, records = jax.lax.scan(chunk, state, length=saves)
    all_of = jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, records)

    def alive(x: Array) -> Array:
        """NaN from the first save on that is not finite: `step` repeats the last finite state, which is no result."""
        if not jnp.issubdtype(x.dtype, jnp.inexact):
            return x
        return jnp.where(all_of.finite.reshape(-1, *[1] * (x.ndim - 1)), x, jnp.nan)

    _, kept, budget, observed, _, _ = jax.tree.map(alive, all_of)
    times = (every * jnp.arange(saves + 1)) * dt  # the same products of step and Δt as in a monitored run
    u, v = kept if fields else (jnp.where(state.finite, x, jnp.nan)[None] for x in (state.u, state.v))
    return History(times, u, v, budget, observed, dt, state.step, None, None, "", *_of_bonds(state, dt))


def _of_bonds(state: State, dt) -> tuple[Numbers | None, Numbers | None]:
    """The bonds that are alive, and the times at which the others broke."""
    if state.bonds is None:
        return None, None
    dt = dt if isinstance(dt, jax.core.Tracer) else np.asarray(dt, state.u.dtype)
    return state.bonds.alive, times_of_breaks(state.bonds.at, dt)


def run_length(motion: Motion, duration) -> float:
    """The given duration, or that of the motion, checked."""
    duration = motion.duration if duration is None else duration
    if duration is None:
        raise ValueError("duration must be given: this motion has no default duration")
    duration = float(duration)
    if not (math.isfinite(duration) and duration > 0):
        raise ValueError(f"duration must be finite and > 0; got {duration}")
    return duration


def time_step(motion: Motion, dt) -> float:
    """The given time step, or SAFETY times the critical one, checked."""
    if dt is None:
        dt = (SAFETY if motion.breaking is None else SAFETY_BREAKING) * critical_time_step(motion)
        if not math.isfinite(dt):
            raise ValueError("the body has no stiffness at the start, so it has no critical time step: give dt")
    if not is_concrete(dt):
        raise ValueError("dt determines the number of steps, so it cannot be traced; pass a plain number")
    dt = float(dt)
    if not (math.isfinite(dt) and dt > 0):
        raise ValueError(f"dt must be finite and > 0; got {dt}")
    return dt


def _plan(motion: Motion, duration, dt, save_every) -> tuple[float, int, int]:
    """Return (dt, saves, save_every)."""
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
        raise ValueError(
            f"a run must have fewer than 2³¹ steps; duration {duration:g} with dt {dt:g} has {steps:.3g}: take a larger"
            " dt or a shorter duration"
        )
    return (duration / (saves * save_every) if own else dt), saves, save_every


def _warn_above(motion: Motion, dt: float) -> None:
    critical = critical_time_step(motion)
    if dt > critical:
        warnings.warn(
            f"dt = {dt:.6g} is above the critical time step {critical:.6g} at the start, so the run is probably"
            " unstable; take a smaller dt",
            stacklevel=4,
        )


def _warn_beyond(duration: float, dt: float, saves: int, every: int) -> None:
    """Warn if the run ends far beyond the duration, because a run ends at a save."""
    end = saves * every * dt
    if end > 1.1 * duration and every > 1:
        warnings.warn(
            f"the run goes on to t = {end:.6g}, beyond the duration {duration:.6g}: a run ends at a save, and"
            f" save_every = {every} steps of {dt:.6g} take {every * dt:.6g}; take a smaller save_every to end closer to"
            " it",
            stacklevel=4,
        )


def _warn_shattered(state: State) -> None:
    """Warn if more than half of all bonds break at the start, before anything has moved."""
    if state.bonds is None:
        return
    alive, left = (float(np.sum(np.asarray(x))) / 2 for x in (state.bonds.alive, state.bonds.left))
    if left < 0.5 * alive:
        warnings.warn(
            f"{alive - left:.0f} of {alive:.0f} bonds break in the first step, before anything has moved; check that"
            " the criterion is in the units of the body, or start from a smaller displacement",
            stacklevel=5,
        )


class _Keeper:
    """Writes a checkpoint every `every` saves, or less often, so that writing takes at most a twentieth of the run."""

    def __init__(self, path, every: int, name: str):
        self.path, self.every, self.name = path, every, name
        self.not_before = 0.0

    def __call__(self, save: int, state: State, records: list[Record], at_once: bool = False) -> None:
        now = time.monotonic()
        if self.path is None or (not at_once and (save % self.every or now < self.not_before)):
            return
        checkpoints.save(self.path, self.name, state, records)
        self.not_before = now + 20 * (time.monotonic() - now)


class _Host:
    """The observers of a run that run on the host."""

    def __init__(self, motion: Motion, observers: Mapping[str, Observer]):
        self.motion = motion
        self.observers = {n: o for n, o in observers.items() if isinstance(o, HostObserver)}
        self.factor = jax.jit(lambda t: motion.factor(t)[0]) if self.observers else None

    def added(self, record: Record, state: State) -> Record:
        """The record with the values of these observers."""
        if self.factor is None:
            return record
        fields = (np.asarray(x) for x in (state.u, state.v, state.force))
        now = Snapshot(np.asarray(record.t), np.asarray(self.factor(record.t)), *fields)
        if state.bonds is not None:
            now = now._replace(alive=np.asarray(state.bonds.alive))
        values = {
            name: {key: np.asarray(value) for key, value in watch(self.motion.scene, now).items()}
            for name, watch in self.observers.items()
        }
        return record._replace(observed=record.observed | values)

    def stopped_by(self, record: Record) -> str:
        """The observer that stops the run after this record, and its reason; empty if none does."""
        for name, watch in self.observers.items():
            # Records of a checkpoint hold scalars of NumPy in place of arrays of shape ().
            reason = watch.stops({key: np.asarray(value) for key, value in record.observed[name].items()})
            if reason:
                return f"{name}, {reason}"
        return ""


def _watch(motion: Motion, observers, dt, saves, every, fields, path, checkpoint_every, resume, show) -> History:
    step, one, many = np.asarray(dt, motion.start.dtype), np.int32(1), np.int32(every)
    ready, host = motion.prepared(), _Host(motion, observers)
    observers = {n: o for n, o in observers.items() if n not in host.observers}
    state, first = _go_on(ready, observers, before_start(ready), step, one, fields)
    _warn_shattered(state)
    first = host.added(first, state)
    records, name = [first], ""
    if path is not None:
        path = checkpoints.fresh(path, resume, stacklevel=5)
        program = _go_on.lower(ready, observers, state, step, many, fields).as_text()  # type: ignore[attr-defined]
        # The text tells observers of the host apart.
        on_host = np.frombuffer(repr(host.observers).encode(), np.uint8)
        arrays = eqx.filter((motion, observers), eqx.is_array_like)
        name = checkpoints.fingerprint(program, dt, every, arrays, on_host if host.observers else ())
        if resume:
            state, records = checkpoints.load(path, name, state, first)
            records = records[: saves + 1]
    keep = _Keeper(path, checkpoint_every, name)
    stored = abs(float(first.energies.strain))
    if not motion.scene.model.hyperelastic:
        # The model has no energy. Take the work that the forces at the start would do on the way back to u = 0.
        stored = 0.5 * float(np.abs(np.asarray(state.force) * np.asarray(motion.start)).sum())
    floor = _rounding(motion, dt) + float(first.energies.kinetic) + stored
    given, code, saved = max(_given(r) for r in records), RunEnding.DONE, state
    done = len(records) - 1
    stopped_by = host.stopped_by(records[-1])
    if not bool(state.finite):
        code = RunEnding.NOT_FINITE
    elif stopped_by:
        code = RunEnding.STOPPED
    try:
        for save in progress(range(done + 1, saves + 1), saves - done, "steps", show) if code == RunEnding.DONE else ():
            state, record = _go_on(ready, observers, saved, step, many, fields)
            if not bool(state.finite):
                code = RunEnding.NOT_FINITE
                break
            record = jax.tree.map(np.asarray, host.added(record, state))
            records.append(record)
            given = max(given, _given(record))
            swing = float(record.borrowed[0]) - float(first.borrowed[0])
            if alarmed(first.energies, record.energies, swing, floor + given):
                code = RunEnding.ENERGY_GREW
                break
            saved = state
            stopped_by = host.stopped_by(record)
            keep(save, state, records, at_once=save == saves or bool(stopped_by))
            if stopped_by:
                code = RunEnding.STOPPED
                break
    except KeyboardInterrupt:
        keep(len(records) - 1, saved, records, at_once=True)
        raise
    told = None if code in (RunEnding.DONE, RunEnding.STOPPED) else _diagnose(motion, state, saved, dt)
    out = stacked(records)
    last = saved if code == RunEnding.NOT_FINITE else state
    u, v = out.fields if fields else (np.asarray(last.u)[None], np.asarray(last.v)[None])
    steps = min(int(state.step), saves * every)
    of_bonds = _of_bonds(jax.tree.map(np.asarray, last), dt)
    return History(out.t, u, v, as_arrays(out.energies), out.observed, dt, steps, code, told, stopped_by, *of_bonds)


def _given(record: Record) -> float:
    """The energy that supports, loads and breaking bonds have supplied, plus what loads can supply in one step."""
    work = abs(float(record.energies.supports)) + abs(float(record.energies.loads))
    return work + max(0.0, -float(record.energies.released)) + float(record.borrowed[1])


def _diagnose(motion: Motion, state: State, saved: State, dt: float) -> Failure:
    critical = []
    for at, u, t in ((motion, motion.start, 0.0), (_damaged(motion, saved), saved.u, int(saved.step) * dt)):
        try:
            critical.append(critical_time_step(at, u, t))
        except ValueError:
            critical.append(float("nan"))
    return failure(motion, state, saved, dt, (critical[0], critical[1]))


def _damaged(motion: Motion, state: State) -> Motion:
    """The motion of the body with the bonds that are left after this state."""
    if state.bonds is None:
        return motion
    families = motion.scene.families.with_share(state.bonds.left)
    return eqx.tree_at(lambda m: (m.scene.families, m.breaking), motion, (families, None), is_leaf=lambda x: x is None)


@public_function
def simulate(
    motion: Motion,
    duration: float | None = None,
    *,
    dt=None,
    save_every: int | None = None,
    observers: Mapping[str, Observer] | None = None,
    breaking: Criterion | None = None,
    fields: bool = True,
    checkpoint: str | os.PathLike | None = None,
    checkpoint_every: int = 1,
    resume: bool = False,
    show_progress: bool = True,
    throw: bool = False,
) -> History:
    """Run a motion with velocity Verlet.

    v½ = (1 − c Δt/2) v + (Δt/2) a,   u' = u + Δt v½,   v' = (v½ + (Δt/2) a')/(1 + c Δt/2)

    Parameters
    ----------
    motion : Motion
        The motion, from `motion` or from `pdjax.scenes`.
    duration : float, optional
        Duration [time] of the run. Default: `motion.duration`.
    dt : float, optional
        Time step Δt [time]. A given step is not changed, and the run ends at the first save at or after `duration`.
        Default: 0.8 of the critical time step at the start, at most a hundredth of the duration, and shortened so that
        the run ends exactly at `duration`. With `breaking` it is 0.2 of the critical step: with longer steps the bonds
        at the tip of a fast crack break late, and release more than the fracture energy.
    save_every : int, optional
        Number of steps between saves. Default: such that there are about 100 saves.
    observers : dict of str to function, optional
        Functions (scene, `Snapshot`) → array, evaluated at every save. See `pdjax.observers`. An observer that runs on
        the host, such as `trust_observer`, can stop the run.
    breaking : Criterion, optional
        Criterion by which bonds break during the run, such as `CriticalStretch`. A broken bond stays broken. Models
        with a shape tensor take it over the bonds that remain; a point whose bonds no longer determine its deformation
        loses them all. Default: no bond breaks.
    fields : bool, optional
        Keep u and v of every save. With False only those of the last save are kept. Default True.
    checkpoint : path, optional
        File from which the run can be continued. It is also written if the run is interrupted. An existing file is kept
        as FILE.old.
    checkpoint_every : int, optional
        Number of saves between checkpoints. Writing is less frequent where it would take more than a twentieth of the
        run. Default 1.
    resume : bool, optional
        Continue from `checkpoint`, bit for bit. Default False.
    show_progress : bool, optional
        Show a progress bar, if the error stream is a terminal. Default True.
    throw : bool, optional
        Raise RuntimeError if the run ends early. Default False.

    Returns
    -------
    History
        The saves, the energy budget, the observed values, and how the run ended.

    Raises
    ------
    ValueError
        If an argument is invalid, the schedule is not finite, or another run or version wrote the checkpoint.
    OSError
        If `checkpoint` cannot be written at the start, or if `resume` and there is no such file.
    RuntimeError
        If `throw` and the run ends early. The message contains the reason.

    Warns
    -----
    UserWarning
        If dt is above the critical time step at the start, if the run ends far beyond `duration`, if an existing
        checkpoint is renamed, or if a checkpoint cannot be written.

    Notes
    -----
    Under jit, vmap or grad the run gives the same numbers and is differentiable in forward and reverse mode. A break is
    a jump: derivatives do not see that a bond breaks earlier or later, and that with respect to a critical stretch is
    zero. A criterion with `smoothing` has derivatives beyond the first break. Reverse
    mode keeps 2 √save_every states for each save. Such a run is not monitored and writes no checkpoint. Its results
    are NaN from the first save on that is not finite. Under jit and vmap `dt` must be given.

    To extend a run later from its checkpoint, give `dt` and `save_every`, because their defaults depend on `duration`.

    References
    ----------
    Swope et al. 1982; Hairer, Lubich & Wanner 2003

    Examples
    --------
    A standing wave on a chain of springs, after half a period T = 2π/ω with ω = 2 sin(k/2):

    >>> motion = pd.scenes.wave(8, N=1, u0=1e-3, model=pd.BondBased(1.0))
    >>> half = np.pi / (2 * np.sin(np.pi / 8))
    >>> history = pd.simulate(motion, half, show_progress=False)
    >>> bool(np.allclose(history.u[-1], -motion.start, atol=1e-6))
    True
    """
    if not isinstance(motion, Motion):
        raise ValueError(f"motion must be a Motion (pdjax.motion or a moving scene); got {type(motion).__name__}")
    motion.scene.families.need_arrays()
    if isinstance(checkpoint_every, bool) or not isinstance(checkpoint_every, int | np.integer) or checkpoint_every < 1:
        raise ValueError(f"checkpoint_every must be a whole number of saves >= 1; got {checkpoint_every!r}")
    if resume and checkpoint is None:
        raise ValueError("resume needs checkpoint, the file from which the run continues")
    observers = {} if observers is None else observers
    if breaking is not None:
        check_breaking(breaking, motion.scene)
        motion = eqx.tree_at(lambda m: m.breaking, motion, breaking, is_leaf=lambda x: x is None)
    watched = is_concrete(motion, observers) and not inside_jit()
    check_observers(motion.scene, observers, on_host=watched)
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
