"""What a simulation says: the saves, the budget of energy, what was observed, and where and how it ended."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..problem import Scene
from .verlet import Energies

DONE, NOT_FINITE, ENERGY_GREW, SOLVER_FAILED = range(4)
REASONS = (
    "ran to its end",
    "a value is not finite",
    "energy grew without cause",
    "the solver gave up",
)
GROWTH = 10.0  # imbalance over the energy that came in, beyond which it has no cause (waves next to Δt_cr reach 5)


class Failure(eqx.Module):
    """Where a run ended early.

    time; step; point: where |v| is largest at the last finite state, at position (dim,); mode (points, dim): v there,
    of unit length; wave_vector (dim,) [1/length]: the largest Fourier component of the mode on a lattice, or None;
    critical_step: 2/ω_max linearised there, NaN where it can't be found; why: the whole in words.
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
        return (
            f"motion: {self.reason}\n  {int(self.steps)} steps of {float(self.dt):.6g} to"
            f" t = {float(self.times[-1]):.6g}, {len(self.times) - 1} saves; energy error {error:.1e} of the largest"
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


def supplied(energies: Energies) -> float:
    """The energy that start, supports and loads had given by one save."""
    return abs(float(energies.supports)) + abs(float(energies.loads))


def grew(first: Energies, last: Energies, given: float) -> bool:
    """Whether energy appeared that neither the start, the supports nor the loads gave (`given`: the most so far)."""
    pair = Energies(*(np.array([float(a), float(b)]) for a, b in zip(first, last, strict=True)))
    start = float(first.kinetic) + abs(float(first.strain))
    return bool(abs(pair.imbalance[1]) > GROWTH * (start + given))


def failure(motion: Any, state: Any, dt: float, code: int, critical: float) -> Failure:
    """Describe the last finite state of a run that ended early."""
    v = np.asarray(state.v, dtype=float)
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
    if np.isfinite(critical):
        above = "above" if dt > critical else "below"
        why += f"; dt {dt:.4g} is {above} the critical step there, {critical:.4g}"
        if dt <= critical:
            why += ": the motion, not the step, is what grew"
    return Failure(time, int(state.step), point, position, mode, wave, critical, why)


def stacked(records: list[Any]) -> Any:
    """Records of single saves → one record of arrays (saves, …)."""
    import jax

    return jax.tree.map(lambda *x: np.stack([np.asarray(y) for y in x]), *records)


def as_arrays(energies: Energies) -> Energies:
    """The budget as JAX arrays."""
    return Energies(*(jnp.asarray(x) for x in energies))
