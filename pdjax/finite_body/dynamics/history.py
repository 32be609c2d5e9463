"""The result of a simulation: the saves, the energy budget, the observed values, and how and where the run ended."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, PyTree

from ..._internal.checks import Numbers, Tree, on_device
from ..._internal.ending import Ending
from ..._internal.shown import told
from ..scene import Scene
from .system import Motion
from .verlet import Energies, State


class RunEnding(Ending):
    """How a monitored run ended."""

    DONE = 0, "ran to its end"
    NOT_FINITE = 1, "a value is not finite"
    ENERGY_GREW = 2, "the energy grew beyond what was supplied"
    SOLVER_FAILED = 3, "the solver failed"
    STOPPED = 4, "an observer stopped the run"


# Energy over supplied energy at which a run is stopped. A linear motion with a stable step never exceeds 1.
GROWTH = 10.0


class Failure(eqx.Module):
    """Description of a run that ended early.

    Attributes
    ----------
    time : float
        Time [time] of the last finite state.
    step : int
        Step number of the last finite state. For `simulate_diffrax`: the number of steps that the solver tried.
    point : int
        Number of the fastest point at the last save before the failure.
    position : array, shape (dim,)
        Reference position [length] of that point.
    mode : array, shape (points, dim)
        Velocities at the last save before the failure, scaled to unit length.
    wave_vector : array, shape (dim,), or None
        Wave vector [1/length] of the largest Fourier component of `mode`. None for a body that is not a full
        lattice, and for `simulate_diffrax`.
    critical_step : float
        Critical time step 2/ω_max [time]: the smaller of those at the start and at that save. NaN if neither is
        known, and for `simulate_diffrax`.
    why : str
        All of this in words.

    Examples
    --------
    This chain of springs has a critical time step of 1. The larger dt = 1.1 gives a warning, and the run fails:

    >>> import warnings
    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> with warnings.catch_warnings(action="ignore"):
    ...     history = pd.simulate(motion, 1000.0, dt=1.1, show_progress=False)
    >>> history.finished, round(history.failure.critical_step, 6), history.failure.time < 1000.0
    (False, 1.0, True)
    """

    time: float
    step: int
    point: int
    position: np.ndarray
    mode: np.ndarray
    wave_vector: np.ndarray | None
    critical_step: float
    why: str = eqx.field(static=True)


class History(eqx.Module):
    """Result of `simulate` and of `simulate_diffrax`.

    Attributes
    ----------
    times : array, shape (saves,)
        Times [time] of the saves, including the start.
    u : array, shape (saves, points, dim)
        Displacements [length]. Only the last save, shape (1, points, dim), if the run used `fields=False`.
    v : array, shape (saves, points, dim)
        Velocities [length/time]. Only the last save if the run used `fields=False`.
    energies : Energies
        Energy budget [energy], arrays of shape (saves,).
    observed : dict of str to array, shape (saves, …)
        Values of the observers.
    dt : float
        Time step [time]. For `simulate_diffrax`: the mean step.
    steps : int
        Number of steps.
    code : int or None
        Number of the ending: 0 at its end, 1 a value is not finite, 2 the energy grew, 3 the solver failed, 4 an
        observer stopped the run. None under a transformation of JAX. `ending` is the same as an enumeration.
    failure : Failure or None
        Description of a run that failed.
    stopped_by : str
        Name of the observer that stopped the run and its reason; empty if none did.
    alive : array of bool, shape (points, bonds), or None
        Bonds that exist and have not broken at the end; those of a pre-crack are not. With a smooth criterion: the
        share of each bond that is left [-], float. None if no bond could break.
    broken_at : array, shape (points, bonds), or None
        Time [time] at which each bond broke, inf if it did not. It exceeded the criterion in the state of that time.

    Examples
    --------
    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> history = pd.simulate(motion, 1.0, dt=0.1, show_progress=False)
    >>> history.u.shape, history.steps, history.reason
    ((11, 8, 1), 10, 'ran to its end')
    """

    times: Float[Array | np.ndarray, " saves"]
    u: Float[Array | np.ndarray, "kept points dim"]
    v: Float[Array | np.ndarray, "kept points dim"]
    energies: Energies
    observed: dict[str, PyTree]
    dt: Numbers | float
    steps: Numbers | int
    code: int | None = eqx.field(static=True, default=None)
    failure: Failure | None = None
    stopped_by: str = eqx.field(static=True, default="")
    alive: Bool[Array | np.ndarray, "points bonds"] | Float[Array | np.ndarray, "points bonds"] | None = None
    broken_at: Float[Array | np.ndarray, "points bonds"] | None = None

    @property
    def finished(self) -> bool:
        """True if the run reached its end. False for a run under a transformation of JAX, which is not monitored."""
        return self.code == RunEnding.DONE

    @property
    def ending(self) -> RunEnding | None:
        """How the run ended, as an enumeration; None for a run that was traced."""
        return None if self.code is None else RunEnding.of(self.code)

    @property
    def reason(self) -> str:
        """How the run ended, in words."""
        if self.code is None:
            return "the run was traced and therefore not monitored"
        words = RunEnding.of(self.code).reason
        if self.stopped_by:
            return f"{words}: {self.stopped_by}"
        return words if self.failure is None else f"{words}: {self.failure.why}"

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        error = float(np.max(np.abs(np.asarray(self.energies.error))))
        said = f"energy error {error:.1e} of the largest"
        if np.isnan(np.asarray(self.energies.strain)).all():
            said = "the model has no energy, so there is no energy error"
        elif np.isnan(np.asarray(self.energies.supports)).all():
            said = "works are not tracked, so there is no energy error"
        return (
            f"motion: {self.reason}\n  {int(self.steps)} steps of {float(self.dt):.6g} to"
            f" t = {float(self.times[-1]):.6g}, {len(self.times) - 1} saves; {said}{self._breaks()}"
        )

    def _breaks(self) -> str:
        """How many bonds broke, and when the first of them did."""
        if self.broken_at is None:
            return ""
        at = np.asarray(self.broken_at)
        broke = int(np.isfinite(at).sum()) // 2
        return f"\n  {broke} bonds broke, the first at t = {at.min():.6g}" if broke else "\n  no bond broke"


def dominant_wave(scene: Scene, field: np.ndarray) -> np.ndarray | None:
    """Wave vector (dim,) [1/length] of the largest Fourier component of a field, or None if the body is no lattice."""
    shape, h = scene.body.shape, scene.body.spacing
    if shape is None or h is None or int(np.prod(shape)) != len(scene.body):
        return None
    spectrum = np.fft.fftn(field.reshape(*shape, -1), axes=range(len(shape)))
    size = np.sum(np.abs(spectrum) ** 2, axis=-1)
    size[(0,) * len(shape)] = 0.0
    at = np.unravel_index(int(np.argmax(size)), size.shape)
    return np.array([2 * np.pi * np.fft.fftfreq(n, h)[i] for n, i in zip(shape, at, strict=True)])


def alarmed(first: Energies, last: Energies, swing: float, given: float) -> bool:
    """True if a save holds more energy than GROWTH × `given`: what the start, the supports and the loads could supply.

    Two energies are compared with that limit: the kinetic energy, and the change of the total energy since the start
    minus its `swing` (see `verlet.borrowed`). In a linear motion with a stable step both stay below `given`. With an
    unstable step one of them grows.
    """
    start, now = (Energies(*map(float, x)) for x in (first, last))
    return bool(now.kinetic > GROWTH * given or abs(now.total - start.total - swing) > GROWTH * given)


def failure(motion: Motion, state: State, saved: State, dt: float, critical: tuple[float, float]) -> Failure:
    """Describe a run that ended early: the time of its last finite state, and the place by its last valid save.

    critical: the critical steps at the start and at that save, NaN where unknown.
    """
    v = np.asarray(saved.v if np.any(np.asarray(saved.v)) else state.v, dtype=float)
    size = np.abs(v).max()
    mode = v / size if size > 0 else v
    mode = mode / max(float(np.linalg.norm(mode)), np.finfo(float).tiny)
    point = int(np.argmax(np.linalg.norm(mode, axis=1)))
    position = motion.scene.body.positions[point]
    wave = dominant_wave(motion.scene, mode)
    time = int(state.step) * dt
    where = ", ".join(f"{x:.4g}" for x in position)
    why = f"at t = {time:.6g} (step {int(state.step)}), largest velocity at point {point} ({where})"
    if wave is not None:
        why += f", wave vector ({', '.join(f'{x:.4g}' for x in wave * motion.scene.body.spacing / np.pi)}) π/h"
    least = float(np.fmin(*critical))
    if np.isfinite(least):
        why += f"; dt {dt:.4g} is {'above' if dt > least else 'below'} the critical step"
        why += f" ({critical[0]:.4g} at the start, {critical[1]:.4g} at the last save"
        why += ")" if state.bonds is None else " without the broken bonds)"
        if dt <= least:
            why += ": the step is small enough, and the motion itself grows"
    return Failure(time, int(state.step), point, position, mode, wave, least, why)


def stacked(records: list[Tree]) -> Tree:
    """Combine the records of single saves into one record of arrays (saves, …)."""
    import jax

    return jax.tree.map(lambda *x: np.stack([np.asarray(y) for y in x]), *records)


def as_arrays(energies: Energies) -> Energies:
    """The energy budget as JAX arrays."""
    return on_device(energies)
