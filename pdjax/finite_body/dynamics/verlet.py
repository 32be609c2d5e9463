"""Velocity Verlet: one step, many steps as a `lax.scan`, and the energy budget.

    v½ = (1 − c Δt/2) v + (Δt/2) a,   u' = u + Δt v½,   v' = (v½ + (Δt/2) a')/(1 + c Δt/2)

u, v and a are displacement, velocity and acceleration, c is the damping, and a prime marks the end of the step. The
method is of second order and stable for Δt < 2/ω_max. For c = 0 it is symplectic and time-reversible. Held components
follow the schedule. The works are trapezoidal sums, so they have the same order as the integrator:

    W_supports += ½ (R + R')·(u' − u)  over held components, R = −V (f + λ b) the force that a support exerts
    W_loads    += ½ (λ + λ') V b·(u' − u)  over free ones,        D += c ρ V ½ (v + v')·(u' − u)

K is the kinetic energy, Π the strain energy and D the energy lost by damping. K + Π − W_supports − W_loads + D is
constant up to the error of the integration.

The time is always step × Δt. A running sum of Δt would accumulate rounding errors. If a new state is not finite, the
step keeps the last finite state, and the step number of that state shows when this happened.

A forward run needs the memory of one state. Reverse differentiation uses two levels of checkpoints: about 2 √steps
states and one force evaluation.

Sources: Swope et al. 1982; Hairer, Lubich & Wanner 2003.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._internal.checks import Numbers, namespace, on_device, on_host
from ...force.fields import strain_energy
from ...force.operator import fast_energies
from ..scene import Scene
from .breaking import Broken, after_break, pulled, unbroken
from .system import Hold, Motion


class State(NamedTuple):
    """State of a motion: step number, u and v (points, dim), V (f + λ b) (points, dim), works [energy].

    `finite` is True as long as all values have been finite. `bonds` is None if no bond can break.
    """

    step: Int[Array, ""]
    u: Float[Array, "points dim"]
    v: Float[Array, "points dim"]
    force: Float[Array, "points dim"]
    supports: Float[Array, ""]
    loads: Float[Array, ""]
    dissipated: Float[Array, ""]
    finite: Bool[Array, ""]
    bonds: Broken | None = None


class Energies(NamedTuple):
    """Energy budget of a motion, at one time or at all saves.

    Attributes
    ----------
    kinetic : array, shape () or (saves,)
        Kinetic energy K [energy] of the free components.
    strain : array, shape () or (saves,)
        Strain energy Π [energy]. NaN for a model without an energy.
    supports : array, shape () or (saves,)
        Work W_supports [energy] of the supports since the start. For a periodic body: of its mean deformation.
    loads : array, shape () or (saves,)
        Work W_loads [energy] of the body forces since the start.
    dissipated : array, shape () or (saves,)
        Energy D [energy] lost by damping since the start.
    released : array, shape () or (saves,)
        Strain energy [energy] of bonds at the moment of their breaking, since the start.

    Examples
    --------
    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> energies = pd.simulate(motion, 1.0, dt=0.1, show_progress=False).energies
    >>> energies.kinetic.shape, bool(abs(energies.error).max() < 1e-3)
    ((11,), True)
    """

    kinetic: Numbers | float
    strain: Numbers | float
    supports: Numbers | float
    loads: Numbers | float
    dissipated: Numbers | float
    released: Numbers | float = 0.0

    @property
    def total(self):
        """K + Π − W_supports − W_loads + D + released [energy]."""
        return self.kinetic + self.strain - self.supports - self.loads + self.dissipated + self.released

    @property
    def imbalance(self):
        """Change of `total` since the first save [energy]. It is the error of the integration."""
        total = Energies(*on_host(tuple(self))).total
        return on_device(total - total[..., :1])

    @property
    def error(self):
        """The imbalance over the largest of the six energies at any save [-]."""
        xp = namespace(self)
        parts, imbalance = on_host((tuple(self), self.imbalance))
        largest = xp.max(xp.abs(xp.stack(xp.broadcast_arrays(*parts))), axis=0).max(axis=-1, keepdims=True)
        return on_device(imbalance / xp.where(largest > 0, largest, 1.0))


def initial_state(motion: Motion) -> State:
    """The state at t = 0."""
    zero = jnp.zeros((), motion.start.dtype)
    factor, bonds = motion.factor(zero)[0], None
    if motion.breaking is None:
        force = motion.force(motion.start, factor)
    else:
        ready = motion.prepared().scene
        force, bonds = pulled(ready, motion.breaking, motion.start, factor, unbroken(motion.breaking, ready))
    finite = jnp.isfinite(force).all()
    number = jnp.zeros((), jnp.int32)
    return State(number, motion.start, motion.velocity, force, zero, zero, zero, finite, bonds)


def before_start(motion: Motion) -> State:
    """The state from which `march` reaches t = 0 by one step of length zero, which only computes the forces there.

    The program of `march` therefore also computes the initial state, and no second program with the force of the model
    has to be compiled.
    """
    dtype = motion.start.dtype
    zero, force = np.zeros((), dtype), np.zeros(motion.start.shape, dtype)
    bonds = None if motion.breaking is None else unbroken(motion.breaking, motion.scene)
    parts: tuple = (np.int32(-1), motion.start, motion.velocity, force, zero, zero, zero, np.asarray(True))
    return State(*parts, bonds)  # type: ignore[call-arg]


def _work_of_mean(motion: Motion, u: Array, factor: Array, change: Array) -> Array:
    """Work done on a periodic body by a change of its mean deformation."""
    scene = motion.scene
    if scene.mean is None or isinstance(motion.schedule, Hold):
        return jnp.zeros_like(change)
    if not scene.model.hyperelastic:
        return jnp.full_like(change, jnp.nan)

    def energy(x):
        return strain_energy(scene.model, scene.families, u, scene.mean_deformation(x))

    return jax.jvp(energy, (factor,), (change,))[1]


def step(motion: Motion, state: State, dt: Float[Array, ""]) -> State:
    """One step of Δt."""
    free, mass, c = motion.free, motion.mass, motion.damping * dt / 2
    before, _ = motion.factor(state.step * dt)
    after, rate = motion.factor((state.step + 1) * dt)
    half = (1 - c) * state.v + 0.5 * dt * state.force / mass
    u = jnp.where(free, state.u + dt * half, after * motion.scene.prescribed)
    bonds = state.bonds
    if motion.breaking is None or bonds is None:
        force = motion.force(u, after)
    else:
        bonds = after_break(motion.scene, 0.5 * (state.u + u), state.step, bonds)
        force, bonds = pulled(motion.scene, motion.breaking, u, after, bonds)
    v = jnp.where(free, (half + 0.5 * dt * force / mass) / (1 + c), rate * motion.scene.prescribed)
    moved = u - state.u
    pushed = -0.5 * jnp.sum(jnp.where(free, 0.0, (state.force + force) * moved))
    stretched = 0.5 * (
        _work_of_mean(motion, state.u, before, after - before) + _work_of_mean(motion, u, after, after - before)
    )
    volumes = motion.scene.families.volumes[:, None]
    loaded = 0.5 * (before + after) * jnp.sum(jnp.where(free, volumes * motion.scene.load * moved, 0.0))
    lost = motion.damping * 0.5 * jnp.sum(jnp.where(free, mass * (state.v + v) * moved, 0.0))
    finite = state.finite & jnp.isfinite(jnp.sum(force) + jnp.sum(v) + jnp.sum(u))
    new = State(
        state.step + 1,
        u,
        v,
        force,
        state.supports + pushed + stretched,
        state.loads + loaded,
        state.dissipated + lost,
        finite,
        bonds,
    )
    kept = jax.tree.map(
        lambda old, x: jnp.where(finite, x, old), state._replace(finite=finite, bonds=None), new._replace(bonds=None)
    )
    return kept._replace(bonds=bonds)  # In a state that is not finite no bond breaks, so the old bonds are the same.


def advance(motion: Motion, state: State, dt: Float[Array, ""], steps: int) -> State:
    """Take `steps` steps (a static number). Reverse differentiation keeps about 2 √steps states."""

    @jax.checkpoint
    def one(state, _):
        return step(motion, state, dt), None

    @jax.checkpoint
    def block(state, _):
        return jax.lax.scan(one, state, length=size)[0], None

    motion, size = motion.prepared(), max(1, math.isqrt(steps))
    state, _ = jax.lax.scan(block, state, length=steps // size)
    if steps % size:
        state, _ = jax.lax.scan(one, state, length=steps % size)
    return state


def march(motion: Motion, state: State, dt: Float[Array, ""], steps: Int[Array, ""]) -> State:
    """Take `steps` steps (a traced number) of a prepared motion, without reverse differentiation.

    The first step from `before_start` has length zero.
    """

    def one(_, state):
        return step(motion, state, jnp.where(state.step < 0, 0, dt))

    state = jax.lax.fori_loop(0, steps, one, state)
    # The step number is still −1 if the forces at the start are not finite.
    return state._replace(step=jnp.maximum(state.step, 0))


def _strain_energy(scene: Scene, state: State, F: Array | None) -> Float[Array, ""]:
    """Π of the bonds that are alive [energy]."""
    operator = scene.operator
    W = None if operator is None or state.bonds is not None else fast_energies(operator, state.u, F)
    if W is not None:
        return jnp.dot(scene.families.volumes, W)
    families = scene.families if state.bonds is None else scene.families.with_share(state.bonds.alive)
    # The model of the prepared operator has a shorter program where its constants are known.
    return strain_energy(scene.model if operator is None else operator.model, families, state.u, F)


def energies(motion: Motion, state: State, dt: Float[Array, ""]) -> Energies:
    """The energy budget of one state."""
    scene = motion.scene
    kinetic = 0.5 * jnp.sum(jnp.where(motion.free, motion.mass * state.v**2, 0.0))
    released = jnp.zeros_like(kinetic) if state.bonds is None else state.bonds.released
    strain = jnp.full_like(kinetic, jnp.nan)
    if scene.model.hyperelastic:
        factor, _ = motion.factor(state.step * dt)
        strain = _strain_energy(scene, state, scene.mean_deformation(factor))
    return Energies(kinetic, strain, state.supports, state.loads, state.dissipated, released)


def borrowed(motion: Motion, state: State, dt: Float[Array, ""]) -> tuple[Array, Array]:
    """(Δt²/8) Σ F²/m over free components, and (Δt²/2) Σ (λVb)²/m [energy].

    In a linear motion the computed energy K + Π oscillates. Verlet conserves K + Π minus the first value exactly, for
    every step length. The second value is the kinetic energy that the loads can supply in one step, before the sum of
    their work contains any of it.
    """
    free, mass = motion.free, motion.mass
    load = motion.factor(state.step * dt)[0] * motion.scene.families.volumes[:, None] * motion.scene.load
    swing = 0.125 * dt**2 * jnp.sum(jnp.where(free, state.force**2 / mass, 0.0))
    return swing, 0.5 * dt**2 * jnp.sum(jnp.where(free, load**2 / mass, 0.0))
