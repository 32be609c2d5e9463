"""Fragments: points whose remaining bonds no longer determine their deformation.

A model with a shape tensor takes it over the bonds that remain, for example K = Σ w ξ⊗ξ. As bonds break, K may become
singular, and F̄ = (Σ w Y⊗ξ) K⁻¹ then has no meaning. Let K₀ be the tensor of the intact family. The smallest eigenvalue
of K₀⁻¹K is the smallest share that any direction has kept:

    min over x of (x·K x)/(x·K₀ x) < LEAST   ⇒   the point is a fragment, and all its bonds break

The share does not depend on the units, on ω or on the shape of the intact family. A fragment takes bonds from its
neighbours, so the test is repeated until no further bond breaks. In a model with a tensor for every bond, such as
`BondAssociated`, a bond breaks if the tensor of its own sub-family fails the test.

Models without a shape tensor, such as BondBased and LPS, have no fragments except points without bonds.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel
from ...models.pointwise import each_point
from .few_points import FEW, bonds_of, model_of, select

# One bond off the line of all others keeps 2 % of K on a square lattice of N = 3. In a plate that Silling's model with
# a control tears apart, LEAST from 1e-3 to 1e-1 breaks the same 336 bonds. In one that Seth–Hill m = 1 shatters, it
# breaks 1360 to 1518 bonds.
LEAST = 0.01


def _kept(model: AbstractModel, bonds: Bonds) -> Float[Array, "*tensors"]:
    """The smallest eigenvalue of K₀⁻¹K for every shape tensor, shape (points,) or (points, bonds)."""
    now, before = (each_point("shape_tensor", model, b) for b in (bonds, bonds._replace(omega=bonds.reference)))
    root = jnp.linalg.cholesky(before)
    half = jax.scipy.linalg.solve_triangular(root, now, lower=True)
    return jnp.linalg.eigvalsh(jax.scipy.linalg.solve_triangular(root, half.mT, lower=True))[..., 0]


def without_fragments(
    model: AbstractModel, families: Families, before: Bool[Array, "points bonds"], after: Bool[Array, "points bonds"]
) -> Bool[Array, "points bonds"]:
    """The bonds that are left when all bonds of fragments have broken too. It works under jit.

    `families` are those before the first break. `before` and `after` tell which bonds have not broken before and after
    this break; `before` has no fragments.
    """
    if not model.has_shape_tensor:
        return after
    changed = jnp.any(before != after, axis=1)

    def some() -> Array:
        """Whether the break makes a fragment of one of few points."""
        points, real = select(changed)
        at_rest = jnp.zeros((len(families), families.dim), families.dtype)
        lost = _lost(model_of(model, len(families), points), bonds_of(families, at_rest, after, points))
        return jnp.any(lost & (real[:, None] & after[points]))

    any_lost = jax.lax.cond(jnp.sum(changed) <= FEW, some, lambda: jnp.asarray(True))
    return jax.lax.cond(any_lost, lambda: _all_without_fragments(model, families, after), lambda: after)


def _lost(model: AbstractModel, bonds: Bonds) -> Bool[Array, "points #bonds"]:
    """Whether each bond breaks because its point is a fragment."""
    lost = ~(_kept(model, bonds) >= LEAST)
    return lost if lost.ndim == 2 else lost[:, None]


def _all_without_fragments(model: AbstractModel, families: Families, alive: Array) -> Bool[Array, "points bonds"]:
    rest = families.bonds(jnp.zeros((len(families), families.dim), families.dtype))
    back = families.neighbours, families.reverse

    def fewer(alive: Array) -> Array:
        omega = jnp.where(alive, rest.omega, 0)
        lost = _lost(model, rest._replace(omega=omega, intact=rest.reference))
        lost = jnp.broadcast_to(lost, alive.shape)
        return alive & ~(lost | lost[back])

    def go_on(both: tuple[Array, Array]) -> Array:
        return jnp.any(both[0] != both[1])

    return jax.lax.while_loop(go_on, lambda both: (both[1], fewer(both[1])), (alive, fewer(alive)))[1]
