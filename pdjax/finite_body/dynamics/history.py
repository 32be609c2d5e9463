"""What a simulation says: the saves, the budget of energy, what was observed, and where and how it ended."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import on_device
from ..scene import Scene
from .verlet import Energies

DONE, NOT_FINITE, ENERGY_GREW, SOLVER_FAILED = range(4)
REASONS = (
    "ran to its end",
    "a value is not finite",
    "energy grew without cause",
    "the solver gave up",
)
GROWTH = 10.0  # energy over what was given, beyond which it has no cause (linear motions of a stable step: at most 1)


class Failure(eqx.Module):
    """Where a run ended early.

    time, step: of the last finite state; point: where |v| is largest at the last save before, at position (dim,); mode
    (points, dim): v there, of unit length; wave_vector (dim,) [1/length]: the largest Fourier component of the mode on
    a lattice, or None; critical_step: 2/ω_max, the smaller of that at the start and there, NaN where it can't be found;
    why: the whole in words.
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
    """The answer of `simulate` and of `simulate_diffrax`.

    times (saves,) [time], the start included; u, v (saves, points, dim), or of the last save alone if fields were not
    kept; energies: `Energies` of (saves,) arrays; observed: a dictionary of arrays (saves, …); dt; steps taken; code:
    how it ended (`reason` in words), None under a transformation; failure: `Failure` or None.
    """

    times: Float[Array | np.ndarray, " saves"]
    u: Float[Array | np.ndarray, "kept points dim"]
    v: Float[Array | np.ndarray, "kept points dim"]
    energies: Energies
    observed: dict[str, Any]
    dt: Any
    steps: Any
    code: int | None = eqx.field(static=True, default=None)
    failure: Failure | None = None

    @property
    def finished(self) -> bool:
        """Whether it ran to its end."""
        return self.code == DONE

    @property
    def reason(self) -> str:
        """How it ended, in words."""
        if self.code is None:
            return "traced: nothing was watched"
        return REASONS[self.code] if self.failure is None else f"{REASONS[self.code]}: {self.failure.why}"

    def __str__(self) -> str:
        error = float(np.max(np.abs(np.asarray(self.energies.error))))
        said = f"energy error {error:.1e} of the largest"
        if np.isnan(np.asarray(self.energies.strain)).all():
            said = "a model without an energy, so no energy error"
        elif np.isnan(np.asarray(self.energies.supports)).all():
            said = "works are not tracked, so no energy error"
        return (
            f"motion: {self.reason}\n  {int(self.steps)} steps of {float(self.dt):.6g} to"
            f" t = {float(self.times[-1]):.6g}, {len(self.times) - 1} saves; {said}"
        )


def dominant_wave(scene: Scene, field: np.ndarray) -> np.ndarray | None:
    """Wave vector (dim,) [1/length] of the largest Fourier component of a field on a full lattice, else None."""
    shape, h = scene.body.shape, scene.body.spacing
    if shape is None or h is None or int(np.prod(shape)) != len(scene.body):
        return None
    spectrum = np.fft.fftn(field.reshape(*shape, -1), axes=range(len(shape)))
    size = np.sum(np.abs(spectrum) ** 2, axis=-1)
    size[(0,) * len(shape)] = 0.0
    at = np.unravel_index(int(np.argmax(size)), size.shape)
    return np.array([2 * np.pi * np.fft.fftfreq(n, h)[i] for n, i in zip(shape, at, strict=True)])


def alarmed(first: Energies, last: Energies, swing: float, given: float) -> bool:
    """Whether a save holds energy that nothing gave: more than GROWTH × `given`, all that start, supports, loads could.

    The kinetic energy alone is compared, and the total less its `swing` since the start (see `verlet.borrowed`): both
    stay within `given` for every stable step of a linear motion, and one of them grows with a step that is not.
    """
    start, now = (Energies(*map(float, x)) for x in (first, last))
    return bool(now.kinetic > GROWTH * given or abs(now.total - start.total - swing) > GROWTH * given)


def failure(motion: Any, state: Any, saved: Any, dt: float, critical: tuple[float, float]) -> Failure:
    """Describe a run that ended early: when by its last finite state, where by the last save in order.

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
    why = f"at t = {time:.6g} (step {int(state.step)}), fastest at point {point} ({where})"
    if wave is not None:
        why += f", along the wave ({', '.join(f'{x:.4g}' for x in wave * motion.scene.body.spacing / np.pi)}) π/h"
    least = float(np.fmin(*critical))
    if np.isfinite(least):
        why += f"; dt {dt:.4g} is {'above' if dt > least else 'below'} the critical step"
        why += f" ({critical[0]:.4g} at the start, {critical[1]:.4g} at the last save)"
        if dt <= least:
            why += ": the motion, not the step, is what grew"
    return Failure(time, int(state.step), point, position, mode, wave, least, why)


def stacked(records: list[Any]) -> Any:
    """Records of single saves → one record of arrays (saves, …)."""
    import jax

    return jax.tree.map(lambda *x: np.stack([np.asarray(y) for y in x]), *records)


def as_arrays(energies: Energies) -> Energies:
    """The budget as JAX arrays."""
    return on_device(energies)
