"""The initial value problem of a scene: what has mass, how the load factor runs in time, where it starts.

    ρ (ü + c u̇) = f(u, λ(t)) + λ(t) b   on free components,      u = λ(t) û   on held ones

ρ density, c damping [1/time] (mass-proportional), λ(t) the load factor: a schedule. Prescribed displacements, loads and
the mean deformation of a periodic body all follow it, as in statics. Kinetic energy is that of the free components; a
support carries the mass of what it holds.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._internal.checks import as_array, as_real, check_positive, is_concrete, namespace, on_device, on_host
from ..._internal.public import public_function
from ...force.fields import point_field
from ..scene import Scene


class Hold(eqx.Module):
    """λ(t) = 1: the whole load from the start."""

    def __call__(self, t):
        return jnp.ones_like(t)


class Ramp(eqx.Module):
    """λ(t) = t/duration up to 1, then 1. duration > 0 [time]."""

    duration: Float[Array, ""] = eqx.field(converter=as_real)

    def __check_init__(self):
        check_positive("duration of a ramp", self.duration)

    def __call__(self, t):
        return jnp.where(t < self.duration, t / self.duration, 1.0)


class SmoothRamp(Ramp):
    """λ = 3τ² − 2τ³, τ = t/duration up to 1: starts and ends without a jump of velocity."""

    def __call__(self, t):
        tau = jnp.where(t < self.duration, t / self.duration, 1.0)
        return tau**2 * (3 - 2 * tau)


def _hold(schedule: Any, t: np.ndarray) -> tuple[Any, Any]:
    return np.ones_like(t), np.zeros_like(t)


def _ramp(schedule: Any, t: np.ndarray) -> tuple[Any, Any]:
    duration = np.asarray(schedule.duration)
    return np.where(t < duration, t / duration, 1), np.where(t < duration, 1 / duration, 0)


def _smooth_ramp(schedule: Any, t: np.ndarray) -> tuple[Any, Any]:
    tau, rate = _ramp(schedule, t)
    return tau**2 * (3 - 2 * tau), 6 * tau * (1 - tau) * rate


# λ and dλ/dt of the schedules made here, in NumPy. By their exact types: a subclass may have another λ.
_IN_NUMPY: dict[Any, Callable] = {Hold: _hold, Ramp: _ramp, SmoothRamp: _smooth_ramp}


def _value_and_rate(schedule: Callable[[Any], Any], t: Array) -> tuple[Array, Array]:
    return jax.jvp(lambda s: jnp.asarray(schedule(s), t.dtype), (t,), (jnp.ones_like(t),))


_in_one_program = eqx.filter_jit(_value_and_rate)


@eqx.filter_jit
def _values_and_rates(schedule: Callable[[Any], Any], times: Array) -> tuple[Array, Array]:
    return jax.vmap(lambda t: _value_and_rate(schedule, t))(times)


def _factors(schedule: Callable[[Any], Any], times: np.ndarray) -> tuple[Any, Any]:
    """λ and dλ/dt at every time: in NumPy where the schedule is known and made here, else by one program."""
    known = _IN_NUMPY.get(type(schedule))
    if known is None or not is_concrete(schedule):
        return on_host(_values_and_rates(schedule, on_device(times)))
    value, rate = known(schedule, times)
    return np.asarray(value, times.dtype), np.asarray(rate, times.dtype)


class Motion(eqx.Module):
    """A scene with mass and a clock. Made by `motion` or by the moving scenes of `pdjax.scenes`.

    density () or (points,) [mass/length^dim]; damping () [1/time]; schedule t → λ; start, velocity (points, dim) at t =
    0; duration [time]: how long the scene wants to run, or None.
    """

    scene: Scene
    density: Float[Array, "..."]
    damping: Float[Array, ""]
    schedule: Callable[[Any], Any]
    start: Float[Array, "points dim"]
    velocity: Float[Array, "points dim"]
    duration: float | None = eqx.field(static=True, default=None)

    @property
    def free(self) -> Bool[Array, "points dim"]:
        """Which components move freely (traced)."""
        if is_concrete(self.scene.unknowns):
            return on_device(self.scene.free)
        shape = self.scene.prescribed.shape
        flags = jnp.zeros(self.scene.prescribed.size, bool).at[self.scene.unknowns].set(True)
        return flags.reshape(shape)

    @property
    def mass(self) -> Float[Array, "points 1"]:
        """ρ_i V_i [mass]."""
        return (self.density * self.scene.families.volumes)[:, None]

    def prepared(self) -> "Motion":
        """The same motion with its force prepared for many evaluations."""
        return eqx.tree_at(lambda m: m.scene, self, self.scene.prepared())

    def factor(self, t) -> tuple[Array, Array]:
        """λ and dλ/dt at t."""
        if not is_concrete(self.schedule, t):
            return _value_and_rate(self.schedule, jnp.asarray(t, self.start.dtype))
        t = np.asarray(t, self.start.dtype)
        if type(self.schedule) in _IN_NUMPY:
            return on_device(_factors(self.schedule, t))
        return _in_one_program(self.schedule, on_device(t))

    def force(self, u: Float[Array, "points dim"], factor) -> Float[Array, "points dim"]:
        """V (f + λ b) [force] on every point."""
        return self.scene.unbalanced(u, factor)


def _density(density: Any, points: int, dtype: Any) -> Array:
    density = as_array(density, dtype)
    if density.shape not in ((), (points,)):
        raise ValueError(f"density must be one number or one for each of the {points} points; got {density.shape}")
    if is_concrete(density):
        value = np.asarray(density)
        if not (np.isfinite(value) & (value > 0)).all():
            raise ValueError(f"density must be finite and > 0 everywhere; the smallest is {value.min():g}")
    return density


@public_function
def motion(
    scene: Scene,
    density=1.0,
    *,
    damping=0.0,
    schedule: Callable[[Any], Any] | None = None,
    start=None,
    velocity=None,
    duration: float | None = None,
) -> Motion:
    """The initial value problem of a scene.

    Arguments: density ρ > 0, one number or (points,) [mass/length^dim]; damping c ≥ 0 [1/time]; schedule t [time] → λ
        [-], `Hold()` by default, or `Ramp`, `SmoothRamp`, any JAX function; start, velocity (points, dim) [length],
        [length/time], zero by default: on held components the schedule's values take their place; duration [time] the
        run wants, if it has a natural one.
    Raises: ValueError for a density or damping that can't be, a schedule not finite at t = 0, fields of a wrong shape.
    """
    if not isinstance(scene, Scene):
        raise ValueError(f"scene must be a Scene (pdjax.scene or pdjax.scenes); got {type(scene).__name__}")
    dtype = scene.prescribed.dtype
    density = _density(density, len(scene.body), dtype)
    damping = as_array(damping, dtype)
    if is_concrete(damping) and not (damping.shape == () and 0 <= np.asarray(damping) < np.inf):
        raise ValueError(f"damping must be one number >= 0 [1/time]; got {damping}")
    zero = on_device(np.zeros(scene.prescribed.shape, dtype))
    start, velocity = (
        zero if x is None else as_array(point_field(as_real(x), scene.families, name), dtype)
        for x, name in ((start, "start"), (velocity, "velocity"))
    )
    schedule = Hold() if schedule is None else schedule
    made = Motion(scene, density, damping, schedule, start, velocity, duration)
    check_schedule(made, np.zeros(1, dtype))
    factor, rate = (x[0] for x in _factors(schedule, np.zeros(1, dtype)))

    def on_held(field, scale):
        xp = namespace(made.free, field, scale, scene.prescribed)
        free, field, scale, held = (xp.asarray(x) for x in (made.free, field, scale, scene.prescribed))
        return on_device(xp.where(free, field, scale * held))

    return Motion(scene, density, damping, schedule, on_held(start, factor), on_held(velocity, rate), duration)


def check_schedule(motion: Motion, times: Float[Array | np.ndarray, " times"]) -> None:
    """Refuse a schedule that is not one finite number at the times given; under a transformation it can't look."""
    if not callable(motion.schedule):
        raise ValueError(f"schedule must be a function of time such as pdjax.Ramp(10.0); got {motion.schedule!r}")
    shape = jax.eval_shape(lambda: motion.factor(0.0))[0].shape
    if shape != ():
        raise ValueError(f"schedule must give one load factor; at t = 0 it gives an array of shape {shape}")
    if not is_concrete(motion, times):
        return
    times = np.asarray(times)
    values, rates = _factors(motion.schedule, times)
    bad = ~(np.isfinite(values) & np.isfinite(rates))
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"schedule must be finite, and so must its rate; at t = {float(times[i]):g} it is {float(values[i]):g}"
            f" with rate {float(rates[i]):g}"
        )
