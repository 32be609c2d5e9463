"""The families of a few points of a body, such as those whose bonds break in a step.

A break changes the energy, the reference sums and the shape tensor of the points at its ends alone. Programs have
arrays of fixed sizes, so a selection has room for FEW points. If fewer are selected, point 0 fills the rest.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ...geometry.bonds import Bonds, Families, without_collapse
from ...models.base import AbstractModel
from ...models.pointwise import split_model

FEW = 512  # a crack that runs through 10⁵ points in 2D breaks bonds of about 50 of them in one step (measured)


def select(points: Bool[Array, " points"]) -> tuple[Int[Array, " few"], Bool[Array, " few"]]:
    """The numbers of the marked points, if there are at most FEW of them, and which entries are real."""
    size = min(FEW, points.shape[0])
    return jnp.nonzero(points, size=size, fill_value=0)[0], jnp.arange(size) < jnp.sum(points)


def bonds_of(
    families: Families,
    u: Float[Array, "points dim"],
    share: Bool[Array, "points bonds"] | Float[Array, "points bonds"],
    some: Int[Array, " few"],
) -> Bonds:
    """The bonds of some points, as `families.with_share(share).bonds(u)` gives them for all."""
    near = families.neighbours[some]
    influence, weight = families.influence[some], families.weight[some]
    intact = weight if families.intact is None else families.intact[some]
    horizon = jnp.broadcast_to(families.horizon, (len(families),))[some]
    eta = u[near] - u[some][:, None]
    omega = influence * weight * share[some]
    eta = without_collapse(families.xi[some], eta, omega)
    return Bonds(families.xi[some], eta, omega, families.volumes[near], horizon, influence * intact)


def model_of(model: AbstractModel, points: int, some: Int[Array, " few"]) -> AbstractModel:
    """The model with the constants of some points, where constants vary from point to point."""
    varying, shared = split_model(model, points)
    return eqx.combine(jax.tree.map(lambda x: x[some], varying), shared)
