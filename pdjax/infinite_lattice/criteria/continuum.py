"""The criterion "continuum": the block ∂f/∂x of a point in the limit h → 0 at a fixed horizon.

In this limit only the stress term −2 ∫ B dξ remains, with B = ∂t/∂η at a fixed point state. It is the product of

* a positive radial integral ∫ω r^{d−3} dr, which diverges in 1D and 2D, so that only the sign of the term has a
  meaning, and
* an average over directions, which this module computes by quadrature over the circle or sphere. The quadrature
  directions form a family of bonds of length 1, to which the functions of a model apply unchanged.

For the Seth–Hill model under the hydrostatic strain a the margin has the sign of −aΓ(m). Source: Behzadinasab & Foster,
section 3.2 (continuum limit) and section 3.2.1 (Γ).
"""

from functools import lru_cache

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...geometry.bonds import Bonds, LatticeFamily
from ...models.base import AbstractModel, PointStateModel
from ...tangent.linearise import linearise_states
from ..bloch import modulus_at_rest
from .outcome import Outcome, decide


@lru_cache(maxsize=8)
def sphere_rule(dim: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (q, dim) and weights (q,) with sum 1. Exact to rounding for smooth functions of the direction."""
    if dim == 1:
        return np.array([[1.0], [-1.0]]), np.array([0.5, 0.5])
    turn = (np.arange(64) + 0.5) * 2 * np.pi / 64
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    if dim == 2:
        return circle, np.full(64, 1 / 64)
    z, wz = np.polynomial.legendre.leggauss(24)
    ring = np.sqrt(1 - z**2)[:, None, None] * circle[None]
    points = np.concatenate([ring, np.broadcast_to(z[:, None, None], (24, 64, 1))], axis=2)
    return points.reshape(-1, 3), np.repeat(wz / 2 / 64, 64)


def continuum(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """λ_max(−2 Σ_n weight · B(n)) / M with bonds n of length 1. `family` enters only through M."""
    if not isinstance(model, PointStateModel) or model.controlled:
        raise ValueError(
            "criterion 'continuum' uses the same B(ξ) for bonds of all lengths, so it needs a model with a point state"
            f" and without control of zero-energy modes; got {type(model).__name__}. Use another criterion"
        )
    points, weights = sphere_rule(family.dim)
    xi = jnp.asarray(points, dtype=family.xi.dtype)
    omega: Array = jnp.asarray(weights, dtype=family.xi.dtype)
    bonds = Bonds(
        xi, xi @ (F - jnp.eye(family.dim, dtype=F.dtype)).T, omega, jnp.ones_like(omega), jnp.ones((), xi.dtype)
    )
    value, mode = decide(-2 * jnp.sum(linearise_states(model, bonds).B, axis=0), at)
    unit = modulus_at_rest(model, family)
    frozen, held, fixed = jax.lax.stop_gradient((model, bonds, unit))
    tension = jnp.linalg.norm(frozen.force_state(held), axis=1) / jnp.linalg.norm(held.xi + held.eta, axis=1)
    scale = 2 * jnp.sum(tension) / fixed  # the size of the terms that cancel where Γ(m) = 0
    return Outcome(value / unit, value, mode, scale=scale, at=mode)
