"""Adaptive dynamic relaxation: a damped fictitious motion that comes to rest at a minimum of the potential energy.

Most peridynamics codes use this method.

    Λ v̇ + c Λ v = r(q),   Λ_i = ¼ Δt² Σ_j |A_ij| (Gershgorin, Δt = 1),   c = 2 √(qᵀ κ q / qᵀ q),  κ_i = −Δ(r_i/Λ_i)/Δq_i

q are the free components of the displacement, v their velocity, r the residual and A = ∂r/∂q. Λ is a diagonal matrix of
fictitious masses from Gershgorin's bound. c is the damping, from the secant stiffness κ of the last step. Central
differences integrate the motion in time.

The motion decreases the energy, so it moves away from a saddle. If the smooth solution of a problem is a saddle, the
method ends at another equilibrium. Sources: Underwood 1983; Kilic & Madenci 2010.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..factorisation import matrix, relative, residual_and_scale, residual_of
from ..scene import Scene
from .result import SolveEnding

CHUNK = 200  # steps between two evaluations of the relative residual
SAFETY = 1.1  # factor on the masses of Gershgorin's bound
HEAVIER = 8  # number of times that the masses may be quadrupled


@eqx.filter_jit
def _advance(scene: Scene, mass, factor, q, v, old) -> tuple[Array, Array, Array]:
    """CHUNK steps of a prepared scene from (q, v, acceleration of the previous step)."""

    def acceleration(q):
        return residual_of(scene, q, factor) / mass

    def step(carry, _):
        q, v, old = carry
        a = acceleration(q)
        moving = v != 0
        stiffness = jnp.where(moving, -(a - old) / jnp.where(moving, v, 1.0), 0.0)
        size = jnp.vdot(q, q)
        ratio = jnp.vdot(q, jnp.maximum(stiffness, 0.0) * q) / jnp.where(size > 0, size, 1.0)
        c = jnp.minimum(2 * jnp.sqrt(ratio), 1.9)
        v = ((2 - c) * v + 2 * a) / (2 + c)
        return (q + v, v, a), None

    (q, v, old), _ = jax.lax.scan(step, (q, v, old), length=CHUNK)
    return q, v, old


def _gershgorin(scene: Scene, u, factor) -> np.ndarray:
    return SAFETY * 0.25 * np.asarray(abs(matrix(scene, u, factor)).sum(axis=1))


def _size(r: Array) -> float:
    with np.errstate(all="ignore"):  # The caller tests whether the size is finite.
        return float(np.linalg.norm(np.asarray(r)))


def relaxation(
    scene: Scene,
    q: np.ndarray,
    factor: float,
    tolerance: float,
    max_iterations: int,
    history: list[float] | None = None,
) -> tuple[np.ndarray, int, list[float]]:
    """Relaxation from q at a fixed load factor. Returns (q, code, relative residuals, one every CHUNK steps)."""
    mass = np.maximum(*(_gershgorin(scene, scene.displacement(q, where), where) for where in (0.0, float(factor))))
    mass = mass.astype(q.dtype)
    ready = scene.prepared()
    factor_array = np.asarray(factor, q.dtype)
    r, scale = residual_and_scale(scene, q, factor_array)
    size = _size(r)
    history = [] if history is None else history
    history.append(float(relative(size, scale)))
    v, old = np.zeros_like(q), np.zeros_like(q)
    worst, left = 4 * size, HEAVIER
    while history[-1] > tolerance and (len(history) - 1) * CHUNK < max_iterations:
        after = _advance(ready, mass, factor_array, q, v, old)
        r, scale = residual_and_scale(scene, after[0], factor_array)
        size = _size(r)
        # The material became stiffer than Gershgorin's bound, so the chunk is repeated with larger masses.
        if not size <= worst:
            if left == 0:
                return q, SolveEnding.NOT_FINITE, history
            mass, left, v, old = 4 * mass, left - 1, np.zeros_like(q), np.zeros_like(q)
            continue
        q, v, old = map(np.asarray, after)
        history.append(float(relative(size, scale)))
    if not np.isfinite(history[-1]):
        return q, SolveEnding.NOT_FINITE, history
    return q, SolveEnding.CONVERGED if history[-1] <= tolerance else SolveEnding.OUT_OF_STEPS, history
