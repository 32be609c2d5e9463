"""Growth rate and frequency of one mode, measured from its amplitude at equal intervals.

Any a(t) = A e^{γt} + B e^{−γt} obeys a(t + h) + a(t − h) = 2 cosh(γh) a(t), any oscillation the same with cos(ωh): one
number, by least squares over all triples, gives γ or ω whatever the start was.

    c = Σ a_n (a_{n+1} + a_{n−1}) / 2 Σ a_n²,     γ = arccosh(c)/h if c > 1,     ω = arccos(c)/h otherwise

Verlet with step Δt does not run at ω but at (2/Δt) arcsin(ωΔt/2), and grows at (2/Δt) arcsinh(γΔt/2): `verlet_rate`.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import is_concrete
from ..._internal.public import public_function


class Rate(NamedTuple):
    """growth γ and frequency ω [1/time]: one of them is 0."""

    growth: Any
    frequency: Any


@public_function
def amplitude(field, mode) -> Float[Array, " saves"]:
    """⟨mode, field⟩/⟨mode, mode⟩ of fields (saves, points, dim) on a mode (points, dim)."""
    field, mode = jnp.asarray(field), jnp.asarray(mode)
    return jnp.tensordot(field, mode, ((-2, -1), (-2, -1))) / jnp.sum(mode**2)


@public_function
def measured_rate(times, amplitudes) -> Rate:
    """γ or ω of one mode.

    Arguments: times (saves,) [time], evenly spaced; amplitudes (saves,), any unit. Growing modes: choose the saves
    where the mode stands above the rest and is still small. A frequency is known up to π/h.
    Damping, an offset and noise are not part of the model: noise of σ times the amplitude raises a frequency by about
    (σ/ωh)² of itself.
    Raises: ValueError for fewer than 3 saves, or uneven times.
    """
    times, a = jnp.asarray(times), jnp.asarray(amplitudes)
    if a.shape[0] < 3 or a.shape != times.shape:
        raise ValueError(f"a rate needs at least 3 saves, times and amplitudes alike; got {times.shape} and {a.shape}")
    if is_concrete(times) and np.ptp(np.diff(times)) > 1e-3 * float(times[-1] - times[0]) / (len(times) - 1):
        raise ValueError("a rate needs evenly spaced times")
    return _fit(times, a)


@jax.jit
def _fit(times: Array, a: Array) -> Rate:
    h = (times[-1] - times[0]) / (len(times) - 1)
    size = jnp.max(jnp.abs(a))
    a = a / jnp.where(size > 0, size, 1.0)
    square = jnp.sum(a[1:-1] ** 2)
    # c − 1 by second differences: no cancellation where the motion is slow
    bend = jnp.sum(a[1:-1] * (a[2:] - 2 * a[1:-1] + a[:-2])) / (2 * jnp.where(square > 0, square, 1.0))

    def root(x: Array) -> Array:
        """√x where x > 0, else 0, with a derivative of 0 there."""
        return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), 0.0)

    growth = 2 / h * jnp.arcsinh(root(bend / 2))
    frequency = 2 / h * jnp.arcsin(root(jnp.minimum(-bend / 2, 1.0)))
    return Rate(growth, frequency)


@public_function
def verlet_rate(rate: Any, dt: Any) -> Rate:
    """The `Rate` at which velocity Verlet with step dt runs a mode of the true rate: exact for linear motions."""
    growth, frequency = rate
    return Rate(2 / dt * jnp.arcsinh(growth * dt / 2), 2 / dt * jnp.arcsin(frequency * dt / 2))
