"""Motions for the solvers of diffrax: the terms of the differential equation, and a run that returns a `History`.

    y = (q, w):   q' = w,   w' = S (f + λ b)/ρ − c w

q and w (unknowns,) are the displacements and velocities of the free components, and S selects these components.
`diffrax_terms` makes one `ODETerm` for explicit and implicit Runge–Kutta methods. `symplectic_terms` makes the pair of
terms for `diffrax.SemiImplicitEuler`, for undamped motions. Held components follow the schedule inside the force.

Source: Kidger 2021 (diffrax).
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._internal.checks import is_concrete, namespace, on_device
from ..._internal.public import public_function
from ..observers import Snapshot, check_observers
from .history import Failure, History, RunEnding
from .run import SAVES, Observer, run_length, time_step
from .system import Hold, Motion, check_schedule
from .verlet import Energies, State, energies

if TYPE_CHECKING:
    import diffrax

# Assumed size of the displacements over the horizon, where the start, the velocities and the supports give none.
UNKNOWN = 1e-3
ROOT = 1e-9  # relative tolerance of the stages of an implicit method with fixed steps


def _acceleration(motion: Motion, t, q: Array) -> Array:
    scene = motion.scene
    factor, _ = motion.factor(t)
    force = motion.force(scene.displacement(q, factor), factor) / motion.mass
    return force.reshape(-1)[scene.unknowns]


@public_function
def diffrax_start(motion: Motion) -> tuple[Array, Array]:
    """Return the initial values of a motion for diffrax.

    Parameters
    ----------
    motion : Motion
        The motion, from `motion` or from `pdjax.scenes`.

    Returns
    -------
    tuple of two arrays, shape (unknowns,) each
        Displacements [length] and velocities [length/time] of the free components at t = 0.

    Examples
    --------
    A bar of 3 points, one of which is held, has 2 free components:

    >>> body = pd.bar(3, 3.0)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0], 0.0))
    >>> q, w = pd.diffrax_start(pd.motion(scene, start=[[0.0], [0.1], [0.2]]))
    >>> print(q, w)
    [0.1 0.2] [0. 0.]
    """
    keep = motion.scene.unknowns
    return motion.start.reshape(-1)[keep], motion.velocity.reshape(-1)[keep]


class _Field(eqx.Module):
    """y' = (w, a(q) − c w). It is a Module and no closure, so a new motion of the same shape compiles nothing."""

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
def diffrax_terms(motion: Motion) -> "diffrax.ODETerm":
    """Make the term of a motion for the Runge–Kutta methods of diffrax.

    y = (q, w):   q' = w,   w' = S (f + λ b)/ρ − c w

    Parameters
    ----------
    motion : Motion
        The motion, from `motion` or from `pdjax.scenes`.

    Returns
    -------
    diffrax.ODETerm
        Term of y' for `diffrax.diffeqsolve`. It ignores the argument `args`.

    References
    ----------
    Kidger 2021 (diffrax)

    Examples
    --------
    A mass of 1 on a spring of stiffness 1, displaced by 0.001, has q' = 0 and w' = −0.001 at the start:

    >>> body = pd.bar(2, 2.0)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0], 0.0))
    >>> motion = pd.motion(scene, start=[[0.0], [0.001]])
    >>> rate = pd.diffrax_terms(motion).vf(0.0, pd.diffrax_start(motion), None)
    >>> [round(float(x[0]), 6) + 0.0 for x in rate]
    [0.0, -0.001]
    """
    import diffrax

    return diffrax.ODETerm(_Field(motion.prepared()))


@public_function
def symplectic_terms(motion: Motion) -> "tuple[diffrax.ODETerm, diffrax.ODETerm]":
    """Make the pair of terms of an undamped motion for `diffrax.SemiImplicitEuler`.

    q' = w,   w' = a(q) = S (f + λ b)/ρ

    Parameters
    ----------
    motion : Motion
        An undamped motion.

    Returns
    -------
    tuple of two diffrax.ODETerm
        The terms of q' and of w'.

    Raises
    ------
    ValueError
        If the motion is damped, because it is then not Hamiltonian.

    References
    ----------
    Kidger 2021 (diffrax)

    Examples
    --------
    >>> body = pd.bar(2, 2.0)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0], 0.0))
    >>> drift, kick = pd.symplectic_terms(pd.motion(scene))
    >>> round(float(kick.vf(0.0, jnp.array([0.001]), None)[0]), 6)
    -0.001
    """
    if is_concrete(motion.damping) and motion.damping != 0:
        raise ValueError(
            f"symplectic_terms needs an undamped motion; this one has damping {motion.damping}: use diffrax_terms, or"
            " another solver than SemiImplicitEuler"
        )
    import diffrax

    return diffrax.ODETerm(_Drift()), diffrax.ODETerm(_Kick(motion.prepared()))


@eqx.filter_jit
def _run(motion, terms, solver, controller, dt, times, most, adjoint):
    import diffrax

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
def _describe(motion: Motion, times, q: Array, w: Array, observers: Mapping[str, Observer]):
    """Fields, energies and observed values of every save. The works are not integrated here and stay 0."""
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
    solver: "diffrax.AbstractSolver | None" = None,
    dt=None,
    rtol: float | None = None,
    atol: float | None = None,
    saves: int = SAVES,
    observers: Mapping[str, Observer] | None = None,
    max_steps: int = 1_000_000,
    adjoint: "diffrax.AbstractAdjoint | None" = None,
    throw: bool = False,
) -> History:
    """Run a motion with a solver of diffrax.

    Parameters
    ----------
    motion : Motion
        The motion, from `motion` or from `pdjax.scenes`.
    duration : float, optional
        Duration [time] of the run. Default: `motion.duration`.
    solver : diffrax.AbstractSolver, optional
        An explicit or implicit Runge–Kutta method or `diffrax.SemiImplicitEuler`. Default `diffrax.Tsit5()`.
    dt : float, optional
        Time step [time], or the first step if `rtol` is given. Default: 0.8 of the critical time step at the start.
    rtol : float, optional
        Relative tolerance [-]. If given, a PID controller adapts the steps to it.
    atol : float, optional
        Absolute tolerance [length] for `rtol`. Default: `rtol` times the largest displacement known beforehand.
    saves : int, optional
        Number of evenly spaced saves after the start. The solver interpolates them. Default 100.
    observers : dict of str to function, optional
        Functions (scene, `Snapshot`) → array, evaluated at every save. See `pdjax.observers`.
    max_steps : int, optional
        Largest number of steps. Default 1 000 000.
    adjoint : diffrax.AbstractAdjoint, optional
        How diffrax differentiates the run. Default `diffrax.RecursiveCheckpointAdjoint()`.
    throw : bool, optional
        Raise RuntimeError if the run ends early. Default False.

    Returns
    -------
    History
        The saves. `dt` is the mean step, and `steps` counts all steps that the solver tried. The works in `energies`
        are NaN if supports, loads or damping act, because they are not summed between saves.

    Raises
    ------
    ValueError
        If an argument is invalid or the schedule is not finite.
    RuntimeError
        If `throw` and the run ends early. The message contains the reason that diffrax gives.

    References
    ----------
    Kidger 2021 (diffrax)

    Examples
    --------
    A mass of 1 on a spring of stiffness 1 moves as cos t, so it returns after the time 2π:

    >>> body = pd.bar(2, 2.0)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), pd.prescribe([0], 0.0))
    >>> motion = pd.motion(scene, start=[[0.0], [0.001]])
    >>> history = pd.simulate_diffrax(motion, 2 * np.pi, rtol=1e-6, saves=2)
    >>> np.round(history.u[:, 1, 0], 6)
    array([ 0.001, -0.001,  0.001])
    """
    duration = run_length(motion, duration)
    observers = {} if observers is None else observers
    check_observers(motion.scene, observers, on_host=False)
    if not (float(saves).is_integer() and saves >= 1):
        raise ValueError(f"saves must be a whole number >= 1; got {saves!r}")
    import diffrax
    import optimistix as optx

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
    elif isinstance(solver, diffrax.AbstractImplicitSolver):
        # With fixed steps there is no controller from which the Newton iteration could take its tolerances. Chord
        # replaces VeryChord, which reports divergence when the residual is at the level of rounding.
        root = max(ROOT, 100 * float(np.finfo(real).eps))
        newton: optx.Chord = optx.Chord(rtol=root, atol=root * xp.maximum(size, unknown), norm=optx.max_norm)
        if eqx.tree_equal(solver.root_finder, type(solver)().root_finder):
            solver = eqx.tree_at(lambda s: s.root_finder, solver, newton)
    adjoint = diffrax.RecursiveCheckpointAdjoint() if adjoint is None else adjoint
    found, good = _run(motion, terms, solver, controller, np.asarray(dt, real), times, max_steps, adjoint)
    q, w = found.ys
    u, v, budget, observed = _describe(motion, times, q, w, observers)
    budget = _unknown_works(motion, budget)
    steps = found.stats["num_steps"]
    if not is_concrete(motion, observers, u):
        return History(jnp.asarray(times), u, v, budget, observed, duration / steps, steps)
    code, told = RunEnding.DONE, None
    finite = np.isfinite(np.asarray(q)).all(axis=1) & np.isfinite(np.asarray(w)).all(axis=1)
    if not (bool(good) and finite.all()):
        code, told = RunEnding.SOLVER_FAILED, _last_finite(motion, times, u, v, finite, diffrax.RESULTS[found.result])  # type: ignore
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
    """Set the works to NaN, unless no support, load or damping can do any work: then they stay 0."""
    scene = motion.scene
    if is_concrete(motion) and not (
        any(np.asarray(x).any() for x in (scene.prescribed, scene.load, motion.damping))
        or (scene.mean is not None and not isinstance(motion.schedule, Hold))
    ):
        return budget
    nothing = on_device(namespace(budget.kinetic).full_like(budget.kinetic, np.nan))
    return budget._replace(supports=nothing, loads=nothing, dissipated=nothing)


def _last_finite(motion: Motion, times, u, v, finite: np.ndarray, reason: str) -> Failure:
    """Describe the last finite save."""
    last = max(0, int(np.argmin(finite)) - 1) if not finite.all() else len(finite) - 1
    field = np.asarray(v[last])
    size = max(float(np.linalg.norm(field)), np.finfo(float).tiny)
    point = int(np.argmax(np.linalg.norm(field, axis=1)))
    position = motion.scene.body.positions[point]
    why = f"diffrax reports: {reason or 'success, but a value is not finite'}; last finite save t = {times[last]:.6g}"
    return Failure(float(times[last]), last, point, position, field / size, None, float("nan"), why)
