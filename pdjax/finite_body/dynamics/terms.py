"""The same motions for diffrax: its terms, and a run that answers with the same `History`.

    y = (q, w):   q' = w,   w' = S (f + λ b)/ρ − c w        q, w (unknowns,): free displacements, velocities

`diffrax_terms` is an `ODETerm` for explicit and implicit Runge–Kutta methods; `symplectic_terms` the pair of terms that
`diffrax.SemiImplicitEuler` takes (undamped). Held components follow the schedule inside the force.
Source: Kidger 2021 (diffrax).
"""

from typing import Any

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array

from ..._internal.checks import is_concrete, namespace, on_device
from ..._internal.public import public_function
from ..observers import Snapshot, check_observers
from .history import DONE, SOLVER_FAILED, Failure, History
from .run import SAVES, run_length, time_step
from .system import Hold, Motion, check_schedule
from .verlet import Energies, State, energies

UNKNOWN = 1e-3  # of the horizon: the size of displacements that only a load will bring about
ROOT = 1e-9  # relative tolerance of the stages of an implicit method with fixed steps


def _acceleration(motion: Motion, t, q: Array) -> Array:
    scene = motion.scene
    factor, _ = motion.factor(t)
    force = motion.force(scene.displacement(q, factor), factor) / motion.mass
    return force.reshape(-1)[scene.unknowns]


@public_function
def diffrax_start(motion: Motion) -> tuple[Array, Array]:
    """y at t = 0: (free displacements [length], free velocities [length/time]), (unknowns,) each."""
    keep = motion.scene.unknowns
    return motion.start.reshape(-1)[keep], motion.velocity.reshape(-1)[keep]


class _Field(eqx.Module):
    """y' = (w, a(q) − c w). Modules, not closures: a new motion of the same shape compiles nothing anew."""

    motion: Motion

    def __call__(self, t, y, args):
        q, w = y
        return w, _acceleration(self.motion, t, q) - self.motion.damping * w


class _Drift(eqx.Module):
    """q' = w."""

    def __call__(self, t, w, args):
        return w


class _Kick(eqx.Module):
    """w' = a(q)."""

    motion: Motion

    def __call__(self, t, q, args):
        return _acceleration(self.motion, t, q)


@public_function
def diffrax_terms(motion: Motion) -> diffrax.ODETerm:
    """y' of the module's head as one term; `args` is not used."""
    return diffrax.ODETerm(_Field(motion.prepared()))


@public_function
def symplectic_terms(motion: Motion) -> tuple[diffrax.ODETerm, diffrax.ODETerm]:
    """(q' = w, w' = a(q)) for `diffrax.SemiImplicitEuler`.

    Raises: ValueError for a damped motion: it is not Hamiltonian.
    """
    if is_concrete(motion.damping) and motion.damping != 0:
        raise ValueError(f"symplectic terms are for undamped motions; this one has damping {motion.damping}")
    return diffrax.ODETerm(_Drift()), diffrax.ODETerm(_Kick(motion.prepared()))


@eqx.filter_jit
def _run(motion, terms, solver, controller, dt, times, most, adjoint):
    found = diffrax.diffeqsolve(
        terms,
        solver,
        times[0],
        times[-1],
        dt,
        diffrax_start(motion),
        stepsize_controller=controller,
        saveat=diffrax.SaveAt(ts=times),
        max_steps=most,
        adjoint=adjoint,
        throw=False,
    )
    return found, found.result == diffrax.RESULTS.successful


@eqx.filter_jit
def _describe(motion: Motion, times, q: Array, w: Array, observers: dict[str, Any]):
    """Fields, energies and observations of every save; the works are not integrated: NaN unless nothing works."""
    scene = motion.scene

    def one(t, q, w):
        factor, rate = motion.factor(t)
        u = scene.displacement(q, factor)
        v = (rate * scene.prescribed).reshape(-1).at[scene.unknowns].set(w).reshape(u.shape)
        force = motion.force(u, factor)
        zero = jnp.zeros_like(t)
        state = State(jnp.ones((), jnp.int32), u, v, force, zero, zero, zero, jnp.asarray(True))
        now = Snapshot(t, factor, u, v, force)
        return u, v, energies(motion, state, t), {name: watch(scene, now) for name, watch in observers.items()}

    return jax.lax.map(lambda x: one(*x), (times, q, w))


@public_function
def simulate_diffrax(
    motion: Motion,
    duration: float | None = None,
    *,
    solver: diffrax.AbstractSolver | None = None,
    dt=None,
    rtol: float | None = None,
    atol: float | None = None,
    saves: int = SAVES,
    observers: dict[str, Any] | None = None,
    max_steps: int = 1_000_000,
    adjoint: diffrax.AbstractAdjoint | None = None,
    throw: bool = False,
) -> History:
    """Run a motion by a diffrax solver.

    Arguments: duration [time], the motion's own by default; solver `diffrax.Tsit5()` by default, explicit, implicit or
        `SemiImplicitEuler`; dt: the step, or the first one if rtol is given (0.8 of the critical step by default);
        rtol, atol: adaptive steps by a PID controller (atol by default rtol times the largest displacement known
        beforehand); saves: evenly spaced, interpolated by the solver; observers as in `simulate`; max_steps; adjoint:
        diffrax's, `RecursiveCheckpointAdjoint` by default.
    Returns: `History` whose energies hold kinetic and strain; works are NaN where supports, loads or damping act, for
        no sum is kept between saves. `dt` is the mean step, `steps` those tried.
    Raises: ValueError for bad arguments; RuntimeError with diffrax's reason if `throw`.
    """
    duration = run_length(motion, duration)
    observers = {} if observers is None else observers
    check_observers(motion.scene, observers)
    if not (float(saves).is_integer() and saves >= 1):
        raise ValueError(f"saves must be a whole number >= 1; got {saves!r}")
    solver = diffrax.Tsit5() if solver is None else solver
    real = motion.start.dtype
    times = np.linspace(0, duration, int(saves) + 1).astype(real)
    check_schedule(motion, np.linspace(0, duration, 1025).astype(real))
    dt = time_step(motion, dt)
    symplectic = isinstance(solver, diffrax.SemiImplicitEuler)
    terms = symplectic_terms(motion) if symplectic else diffrax_terms(motion)
    controller: diffrax.AbstractStepSizeController = diffrax.ConstantStepSize()
    fields = (motion.start, motion.scene.prescribed, motion.velocity)
    xp = namespace(fields, motion.scene.families.horizon)
    start, held, velocity, horizon = (xp.asarray(x) for x in (*fields, motion.scene.families.horizon))
    size = xp.maximum(xp.maximum(abs(start).max(), abs(held).max()), dt * abs(velocity).max())
    unknown = UNKNOWN * horizon
    size = xp.where(size > 0, size, unknown)
    if rtol is not None:
        controller = diffrax.PIDController(rtol=rtol, atol=rtol * size if atol is None else atol)
    elif isinstance(solver, diffrax.AbstractImplicitSolver):  # no controller to take the tolerances of its Newton from
        root = max(ROOT, 100 * float(np.finfo(real).eps))
        # VeryChord calls a residual at rounding diverged
        newton: Any = optx.Chord(rtol=root, atol=root * xp.maximum(size, unknown), norm=optx.max_norm)  # type: ignore[arg-type]
        if eqx.tree_equal(solver.root_finder, type(solver)().root_finder):  # type: ignore[attr-defined, call-arg]
            solver = eqx.tree_at(lambda s: s.root_finder, solver, newton)
    adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
    found, good = _run(motion, terms, solver, controller, np.asarray(dt, real), times, max_steps, adjoint)
    q, w = found.ys
    u, v, budget, observed = _describe(motion, times, q, w, observers)
    budget = _unknown_works(motion, budget)
    steps = found.stats["num_steps"]
    if not is_concrete(motion, observers, u):
        return History(jnp.asarray(times), u, v, budget, observed, duration / steps, steps)
    code, told = DONE, None
    finite = np.isfinite(np.asarray(q)).all(axis=1) & np.isfinite(np.asarray(w)).all(axis=1)
    if not (bool(good) and finite.all()):
        code, told = SOLVER_FAILED, _last_finite(motion, times, u, v, finite, diffrax.RESULTS[found.result])  # type: ignore
        there = slice(0, told.step + 1)
        times, u, v, observed = jax.tree.map(lambda x: np.asarray(x)[there], (times, u, v, observed))
        budget = jax.tree.map(lambda x: on_device(np.asarray(x)[there]), budget)
        told = eqx.tree_at(lambda f: f.step, told, int(steps))
    reached = float(times[-1]) if len(times) > 1 else duration
    history = History(
        np.asarray(times), np.asarray(u), np.asarray(v), budget, observed, reached / int(steps), int(steps), code, told
    )
    if throw and not history.finished:
        raise RuntimeError(f"the motion of the {motion.scene.name} ended early: {history.reason}")
    return history


def _unknown_works(motion: Motion, budget: Energies) -> Energies:
    """Works stay 0 only where nothing can do any."""
    scene = motion.scene
    if is_concrete(motion) and not (
        any(np.asarray(x).any() for x in (scene.prescribed, scene.load, motion.damping))
        or (scene.mean is not None and not isinstance(motion.schedule, Hold))
    ):
        return budget
    kinetic = budget.kinetic
    nothing = on_device(namespace(kinetic).full(kinetic.shape, np.nan, kinetic.dtype))
    return budget._replace(supports=nothing, loads=nothing, dissipated=nothing)


def _last_finite(motion: Motion, times, u, v, finite: np.ndarray, reason: str) -> Failure:
    """Where the saves end."""
    last = max(0, int(np.argmin(finite)) - 1) if not finite.all() else len(finite) - 1
    field = np.asarray(v[last])
    size = max(float(np.linalg.norm(field)), np.finfo(float).tiny)
    point = int(np.argmax(np.linalg.norm(field, axis=1)))
    position = motion.scene.body.positions[point]
    why = f"diffrax says: {reason or 'successful, but not finite'}; last finite save at t = {times[last]:.6g}"
    return Failure(float(times[last]), last, point, position, field / size, None, float("nan"), why)
