"""Growth rate and frequency of one mode, measured from its amplitude at equal intervals.

A growing or decaying mode a(t) = A e^{γt} + B e^{−γt} satisfies a(t + h) + a(t − h) = 2 cosh(γh) a(t) for any interval
h. An oscillation satisfies the same equation with cos(ωh) in place of cosh(γh). The factor c = cosh(γh) or cos(ωh)
does not depend on the initial values A and B. A least-squares fit over all triples of successive amplitudes gives it:

    c = Σ a_n (a_{n+1} + a_{n−1}) / 2 Σ a_n²,     γ = arccosh(c)/h if c > 1,     ω = arccos(c)/h otherwise

Velocity Verlet with step Δt changes both rates. A mode of frequency ω oscillates at (2/Δt) arcsin(ωΔt/2), and a mode of
growth rate γ grows at (2/Δt) arcsinh(γΔt/2). `verlet_rate` computes them.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import Numbers, is_concrete
from ..._internal.public import public_function


class Rate(NamedTuple):
    """Growth rate and frequency of one mode. One of the two is 0.

    Attributes
    ----------
    growth : array, shape ()
        Growth rate γ [1/time] of a growing mode, else 0.
    frequency : array, shape ()
        Angular frequency ω [1/time] of an oscillating mode, else 0.

    Examples
    --------
    >>> times = np.linspace(0.0, 1.0, 11)
    >>> rate = pd.measured_rate(times, np.exp(0.5 * times))
    >>> round(float(rate.growth), 6), float(rate.frequency)
    (0.5, 0.0)
    """

    growth: Numbers | float
    frequency: Numbers | float


@public_function
def amplitude(field, mode) -> Float[Array, " saves"]:
    """Compute the amplitude of a mode in a field, at every save.

    a = ⟨mode, field⟩/⟨mode, mode⟩, with ⟨·, ·⟩ the sum over all points and components

    Parameters
    ----------
    field : array, shape (saves, points, dim)
        Displacements or velocities, for example `History.u`.
    mode : array, shape (points, dim)
        The mode. The unit of the result is that of `field` over that of `mode`.

    Returns
    -------
    array, shape (saves,)
        Amplitude of the mode at every save.

    Examples
    --------
    >>> mode = np.array([[1.0], [-1.0]])
    >>> field = np.stack([2.0 * mode, 3.0 * mode])
    >>> print(pd.amplitude(field, mode))
    [2. 3.]
    """
    field, mode = jnp.asarray(field), jnp.asarray(mode)
    return jnp.tensordot(field, mode, ((-2, -1), (-2, -1))) / jnp.sum(mode**2)


@public_function
def measured_rate(times, amplitudes) -> Rate:
    """Measure the growth rate or the frequency of a mode from its amplitudes.

    c = Σ a_n (a_{n+1} + a_{n−1}) / 2 Σ a_n²,     γ = arccosh(c)/h if c > 1,     ω = arccos(c)/h otherwise

    Parameters
    ----------
    times : array, shape (saves,)
        Evenly spaced times [time], with interval h.
    amplitudes : array, shape (saves,)
        Amplitudes of the mode in any unit, for example from `amplitude`.

    Returns
    -------
    Rate
        `growth` γ and `frequency` ω [1/time], one of which is 0.

    Raises
    ------
    ValueError
        If there are fewer than 3 saves, if the shapes differ, or if the times are not evenly spaced.

    Notes
    -----
    For a growing mode choose saves at which the mode exceeds all other modes but its amplitude is still small. A
    frequency above π/h cannot be measured. The fit does not account for damping, an offset or noise. Noise of σ times
    the amplitude raises the frequency by about the relative amount (σ/ωh)².

    Examples
    --------
    >>> times = np.linspace(0.0, 1.0, 11)
    >>> round(float(pd.measured_rate(times, np.cos(3.0 * times)).frequency), 6)
    3.0
    """
    times, a = jnp.asarray(times), jnp.asarray(amplitudes)
    if a.shape[0] < 3 or a.shape != times.shape:
        raise ValueError(
            "measured_rate needs at least 3 saves, and one amplitude for each time; got times of shape"
            f" {times.shape} and amplitudes of shape {a.shape}"
        )
    if is_concrete(times) and np.ptp(np.diff(times)) > 1e-3 * float(times[-1] - times[0]) / (len(times) - 1):
        raise ValueError("measured_rate needs evenly spaced times; choose saves at equal intervals")
    return _fit(times, a)


@jax.jit
def _fit(times: Array, a: Array) -> Rate:
    h = (times[-1] - times[0]) / (len(times) - 1)
    size = jnp.max(jnp.abs(a))
    a = a / jnp.where(size > 0, size, 1.0)
    square = jnp.sum(a[1:-1] ** 2)
    # Second differences give c − 1 directly: c itself would lose digits by cancellation in a slow motion.
    bend = jnp.sum(a[1:-1] * (a[2:] - 2 * a[1:-1] + a[:-2])) / (2 * jnp.where(square > 0, square, 1.0))

    def root(x: Array) -> Array:
        """√x for x > 0, else 0 with derivative 0."""
        return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1.0)), 0.0)

    growth = 2 / h * jnp.arcsinh(root(bend / 2))
    frequency = 2 / h * jnp.arcsin(root(jnp.minimum(-bend / 2, 1.0)))
    return Rate(growth, frequency)


@public_function
def verlet_rate(rate, dt) -> Rate:
    """Compute the rate that velocity Verlet gives to a mode of known rate.

    γ_Δt = (2/Δt) arcsinh(γΔt/2),     ω_Δt = (2/Δt) arcsin(ωΔt/2)

    Parameters
    ----------
    rate : Rate or tuple of two arrays
        Growth rate γ and frequency ω [1/time] of the exact motion.
    dt : float or array
        Time step Δt [time].

    Returns
    -------
    Rate
        Growth rate and frequency [1/time] of the computed motion, exact for linear motions.

    Examples
    --------
    At the critical step, ωΔt = 2, the computed frequency is π/2 times the exact one:

    >>> round(float(pd.verlet_rate((0.0, 1.0), 2.0).frequency), 4)
    1.5708
    """
    growth, frequency = rate
    return Rate(2 / dt * jnp.arcsinh(growth * dt / 2), 2 / dt * jnp.arcsin(frequency * dt / 2))
