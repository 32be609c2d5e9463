"""The initial value problem of a scene: density, damping, the load factor as a function of time, initial fields.

    ρ (ü + c u̇) = f(u, λ(t)) + λ(t) b   on free components,      u = λ(t) û   on held ones

ρ is the density and c the damping [1/time], which is proportional to the mass. The load factor λ(t) is called the
schedule. The prescribed displacements û, the body forces b and the mean deformation of a periodic body are all
proportional to it, as in statics. The kinetic energy is that of the free components only. A support carries the mass of
the components that it holds.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike
from jaxtyping import Array, Bool, Float

from ..._internal.checks import Numbers, as_array, as_real, check_positive, is_concrete, namespace, on_device, on_host
from ..._internal.public import public_function
from ...force.fields import point_field
from ..damage.criteria import Criterion
from ..scene import Scene

Schedule = Callable[[Array], ArrayLike]  # the load factor λ as a function of the time


class Hold(eqx.Module):
    """Schedule with the constant load factor λ(t) = 1: the full load acts from the start.

    Examples
    --------
    >>> float(pd.Hold()(2.0))
    1.0
    """

    def __call__(self, t):
        return jnp.ones_like(t)


class Ramp(eqx.Module):
    """Schedule that raises the load factor linearly from 0 to 1.

    λ(t) = t/duration for t < duration, then 1

    Parameters
    ----------
    duration : float
        Duration [time] of the ramp, > 0.

    Raises
    ------
    ValueError
        If `duration` is not finite and positive.

    Examples
    --------
    >>> float(pd.Ramp(10.0)(2.5))
    0.25
    """

    duration: Float[Array, ""] = eqx.field(converter=as_real)

    def __check_init__(self):
        check_positive("duration of a ramp", self.duration)

    def __call__(self, t):
        return jnp.where(t < self.duration, t / self.duration, 1.0)


class SmoothRamp(Ramp):
    """Schedule that raises the load factor smoothly from 0 to 1, without a jump of velocity at either end.

    λ(t) = 3τ² − 2τ³ with τ = t/duration for t < duration, then 1

    Parameters
    ----------
    duration : float
        Duration [time] of the ramp, > 0.

    Raises
    ------
    ValueError
        If `duration` is not finite and positive.

    Examples
    --------
    >>> float(pd.SmoothRamp(10.0)(2.5))
    0.15625
    """

    def __call__(self, t):
        tau = jnp.where(t < self.duration, t / self.duration, 1.0)
        return tau**2 * (3 - 2 * tau)


def _hold(schedule: Hold, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.ones_like(t), np.zeros_like(t)


def _ramp(schedule: Ramp, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    duration = np.asarray(schedule.duration)
    return np.where(t < duration, t / duration, 1), np.where(t < duration, 1 / duration, 0)


def _smooth_ramp(schedule: SmoothRamp, t: np.ndarray) -> tuple[np.ndarray | np.floating, np.ndarray | np.floating]:
    tau, rate = _ramp(schedule, t)
    return tau**2 * (3 - 2 * tau), 6 * tau * (1 - tau) * rate


# λ and dλ/dt of the schedules of this module, in NumPy. The keys are exact types, because a subclass may define
# another λ.
_IN_NUMPY: dict[type, Callable] = {Hold: _hold, Ramp: _ramp, SmoothRamp: _smooth_ramp}


def _value_and_rate(schedule: Schedule, t: Array) -> tuple[Array, Array]:
    return jax.jvp(lambda s: jnp.asarray(schedule(s), t.dtype), (t,), (jnp.ones_like(t),))


_in_one_program = eqx.filter_jit(_value_and_rate)


@eqx.filter_jit
def _values_and_rates(schedule: Schedule, times: Array) -> tuple[Array, Array]:
    return jax.vmap(lambda t: _value_and_rate(schedule, t))(times)


def _factors(schedule: Schedule, times: np.ndarray) -> tuple[Numbers, Numbers]:
    """λ and dλ/dt at every time: in NumPy for concrete schedules of this module, else by one compiled program."""
    known = _IN_NUMPY.get(type(schedule))
    if known is None or not is_concrete(schedule):
        return on_host(_values_and_rates(schedule, on_device(times)))
    value, rate = known(schedule, times)
    return np.asarray(value, times.dtype), np.asarray(rate, times.dtype)


class Motion(eqx.Module):
    """Initial value problem of a scene. Made by `motion`, or by `wave` and `cuboid` of `pdjax.scenes`.

    Attributes
    ----------
    scene : Scene
        The body, its model and its conditions.
    density : array, shape () or (points,)
        Density ρ [mass/length^dim].
    damping : array, shape ()
        Damping c [1/time].
    schedule : function
        Load factor λ [-] as a function of the time.
    start : array, shape (points, dim)
        Displacements [length] at t = 0.
    velocity : array, shape (points, dim)
        Velocities [length/time] at t = 0.
    duration : float or None
        Default duration [time] of a run, or None.
    breaking : Criterion or None
        Criterion by which bonds break; `simulate` sets it.

    Examples
    --------
    >>> motion = pd.scenes.cuboid(9, N=2, strain=0.05, rate=0.01)
    >>> motion.duration, motion.start.shape
    (5.0, (9, 1))
    """

    scene: Scene
    density: Float[Array, "..."]
    damping: Float[Array, ""]
    schedule: Schedule
    start: Float[Array, "points dim"]
    velocity: Float[Array, "points dim"]
    duration: float | None = eqx.field(static=True, default=None)
    breaking: Criterion | None = None

    @property
    def free(self) -> Bool[Array, "points dim"]:
        """Which components are free, as a JAX array."""
        if is_concrete(self.scene.unknowns):
            return on_device(self.scene.free)
        shape = self.scene.prescribed.shape
        flags = jnp.zeros(self.scene.prescribed.size, bool).at[self.scene.unknowns].set(True)
        return flags.reshape(shape)

    @property
    def mass(self) -> Float[Array, "points 1"]:
        """Masses ρ_i V_i [mass] of the points."""
        return (self.density * self.scene.families.volumes)[:, None]

    def prepared(self) -> "Motion":
        """Return the same motion with its force prepared for many evaluations.

        Returns
        -------
        Motion
            The motion, whose scene holds the part of the force that does not depend on u.
        """
        way = "auto" if self.breaking is None else "families"  # bonds break on padded arrays
        return eqx.tree_at(lambda m: m.scene, self, self.scene.prepared(way))

    def factor(self, t) -> tuple[Array, Array]:
        """Compute the load factor and its rate at a time.

        Parameters
        ----------
        t : float or array, shape ()
            Time [time].

        Returns
        -------
        tuple of two arrays, shape () each
            λ [-] and dλ/dt [1/time].
        """
        if not is_concrete(self.schedule, t):
            return _value_and_rate(self.schedule, jnp.asarray(t, self.start.dtype))
        t = np.asarray(t, self.start.dtype)
        if type(self.schedule) in _IN_NUMPY:
            return on_device(_factors(self.schedule, t))
        return _in_one_program(self.schedule, on_device(t))

    def force(self, u: Float[Array, "points dim"], factor) -> Float[Array, "points dim"]:
        """Compute the unbalanced force V (f + λ b) on every point.

        Parameters
        ----------
        u : array, shape (points, dim)
            Displacements [length].
        factor : float or array, shape ()
            Load factor λ [-].

        Returns
        -------
        array, shape (points, dim)
            V (f + λ b) [force]. On held components it is minus the reaction.
        """
        return self.scene.unbalanced(u, factor)


def _density(density: object, points: int, dtype: DTypeLike) -> Array:
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
    schedule: Schedule | None = None,
    start=None,
    velocity=None,
    duration: float | None = None,
) -> Motion:
    """Make the initial value problem of a scene.

    ρ (ü + c u̇) = f(u, λ(t)) + λ(t) b   on free components,      u = λ(t) û   on held ones

    Parameters
    ----------
    scene : Scene
        The body, its model and its conditions. Use `scene(..., moving=True)` for a body that nothing holds.
    density : float or array, shape (points,), optional
        Density ρ > 0 [mass/length^dim]. Default 1.
    damping : float, optional
        Damping c ≥ 0 [1/time], proportional to the mass. Default 0.
    schedule : function, optional
        Load factor λ [-] as a function of the time: `Hold()` (the default), `Ramp`, `SmoothRamp` or any JAX function.
    start : array, shape (points, dim), optional
        Displacements [length] at t = 0. Default zero. On held components the schedule replaces them.
    velocity : array, shape (points, dim), optional
        Velocities [length/time] at t = 0. Default zero. On held components the schedule replaces them.
    duration : float, optional
        Default duration [time] of a run.

    Returns
    -------
    Motion
        The problem, for `simulate`, `simulate_diffrax` and `critical_time_step`.

    Raises
    ------
    ValueError
        If the density is not positive, the damping is negative, the schedule is not one finite number at t = 0, or a
        field has the wrong shape.

    Examples
    --------
    A bar whose right end is moved by 0.1 within 5 units of time:

    >>> body = pd.bar(5, 5.0)
    >>> held, pulled = pd.prescribe([0], 0.0), pd.prescribe([4], 0.1)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held, pulled)
    >>> motion = pd.motion(scene, density=2.0, schedule=pd.Ramp(5.0))
    >>> round(float(motion.velocity[4, 0]), 6)
    0.02
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
    """Raise ValueError if the schedule is not one finite number at every given time.

    Under a transformation of JAX only the shape is checked.
    """
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
