"""A model's functions at every point of a body: with the point's own constants, and with a family that may be empty.

A constant varies from point to point where the first axis of its leaf is as long as the body has points.

A point that has lost all its bonds, a fragment, has no force, energy, strain or stress, whatever the model. Its sums
are 0, and models divide by them. So `regular` puts a family of bonds at rest in the place of an empty one, which every
model can take, and what comes of it is replaced by 0. All derivatives are finite; those by the weights of an empty
family are 0 by convention, for what a first bond would do depends on which it is.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool

from ..geometry.bonds import Bonds
from .base import AbstractModel


def split_model(model: AbstractModel, points: int) -> tuple[Any, Any]:
    """(leaves that vary from point to point, everything else)."""
    return eqx.partition(model, lambda leaf: eqx.is_array(leaf) and leaf.ndim > 0 and leaf.shape[0] == points)


def directions_of_rest(dim: int, count: int) -> np.ndarray:
    """Unit vectors (count, dim): the axes, the diagonals of the coordinate planes, their opposites, over and over. The
    first dim (dim + 3)/2 tell all polynomials of degree 2 apart."""
    eye = np.eye(dim)
    plus, minus = ([(eye[i] + s * eye[j]) / math.sqrt(2) for i in range(dim) for j in range(i)] for s in (1, -1))
    return np.resize(np.array([*eye, *plus, *-eye, *minus]), (count, dim))


def regular(bonds: Bonds) -> tuple[Bonds, Bool[Array, " points"]]:
    """(families that every model can take, whether each was empty): see the module."""
    empty = ~jnp.any(bonds.omega > 0, axis=-1)
    rest = directions_of_rest(bonds.xi.shape[-1], bonds.xi.shape[-2]).astype(bonds.xi.dtype)
    here = empty[:, None, None]
    xi = jnp.where(here, bonds.horizon[:, None, None] * rest, bonds.xi)
    eta = jnp.where(here, 0, bonds.eta)
    return bonds._replace(xi=xi, eta=eta, omega=jnp.where(empty[:, None], 1, bonds.omega)), empty


def none_if_empty(values: Any, empty: Bool[Array, " points"]) -> Any:
    """A tree of arrays (points, …) with 0 where the family is empty."""
    return jax.tree.map(lambda x: jnp.where(empty.reshape(-1, *(1,) * (x.ndim - 1)), 0, x), values)


def each_point(method: str, model: AbstractModel, bonds: Bonds) -> Any:
    """model.method(bonds) at every point, with that point's own constants; 0 for an empty family."""
    bonds, empty = regular(bonds)
    return none_if_empty(of_each_point(method, model, bonds), empty)


def of_each_point(method: str, model: AbstractModel, bonds: Bonds) -> Any:
    """model.method(bonds) at every point of families that are `regular`."""
    varying, shared = split_model(model, bonds.xi.shape[0])
    return jax.vmap(lambda mine, b: getattr(eqx.combine(mine, shared), method)(b))(varying, bonds)
