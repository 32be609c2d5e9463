"""A model's functions at every point of a body: with the point's own constants, and with a family that may be empty.

A constant is a number, or an array with one number for each point of the body. An array that all points share is
declared: the class of the model or law names its field in `shared`, and `EnergyLaw(..., shared=("b",))` names constants
of its own. An array that is not declared varies from point to point if its first axis is as long as the body has
points.

A point that has lost all its bonds, a fragment, has no force, energy, strain or stress, whatever the model. Its sums
are 0, and models divide by them. So `regular` replaces an empty family by one of bonds at rest, which every model can
take, and `none_if_empty` replaces the result by 0. All derivatives are finite. Those with respect to the weights of an
empty family are 0 by convention, because the effect of a first bond depends on which bond it is.
"""

import math
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, PyTree

from ..geometry.bonds import Bonds
from .base import AbstractModel

Model = TypeVar("Model", bound=AbstractModel)


def is_shared(model: AbstractModel, path: tuple) -> bool:
    """Whether a module along the path declares this constant as an array that all points share."""
    names = [getattr(key, "name", getattr(key, "key", None)) for key in path]
    node: object = model
    for i, name in enumerate(names):
        if isinstance(node, eqx.Module):
            if set(names[i:]) & set(getattr(node, "shared", ())):
                return True
            node = getattr(node, str(name))
        else:
            return False
    return False


def split_model(model: Model, points: int) -> tuple[Model, Model]:
    """(leaves that vary from point to point, everything else)."""

    def varies(path: tuple, leaf: PyTree) -> bool:
        long = eqx.is_array(leaf) and leaf.ndim > 0 and leaf.shape[0] == points
        return long and not is_shared(model, path)

    return eqx.partition(model, jax.tree_util.tree_map_with_path(varies, model))


def directions_of_rest(dim: int, count: int) -> np.ndarray:
    """Unit vectors (count, dim): the axes, the diagonals of the coordinate planes, their opposites, over and over. The
    first dim (dim + 3)/2 tell all polynomials of degree 2 apart."""
    eye = np.eye(dim)
    plus, minus = ([(eye[i] + s * eye[j]) / math.sqrt(2) for i in range(dim) for j in range(i)] for s in (1, -1))
    return np.resize(np.array([*eye, *plus, *-eye, *minus]), (count, dim))


def regular(bonds: Bonds) -> tuple[Bonds, Bool[Array, " points"]]:
    """(families that every model can take, whether each was empty): see the module."""
    empty = ~jnp.any(bonds.omega != 0, axis=-1)  # with a signed influence ω may be negative
    rest = directions_of_rest(bonds.xi.shape[-1], bonds.xi.shape[-2]).astype(bonds.xi.dtype)
    here = empty[:, None, None]
    xi = jnp.where(here, bonds.horizon[:, None, None] * rest, bonds.xi)
    eta = jnp.where(here, 0, bonds.eta)
    omega, intact = jax.tree.map(lambda x: jnp.where(empty[:, None], 1, x), (bonds.omega, bonds.intact))
    return bonds._replace(xi=xi, eta=eta, omega=omega, intact=intact), empty


def none_if_empty(values: PyTree, empty: Bool[Array, " points"]) -> PyTree:
    """A tree of arrays (points, …) with 0 where the family is empty."""
    return jax.tree.map(lambda x: jnp.where(empty.reshape(-1, *(1,) * (x.ndim - 1)), 0, x), values)


def each_point(method: str, model: AbstractModel, bonds: Bonds) -> PyTree:
    """model.method(bonds) at every point, with that point's own constants; 0 for an empty family."""
    bonds, empty = regular(bonds)
    return none_if_empty(of_each_point(method, model, bonds), empty)


def of_each_point(method: str, model: AbstractModel, bonds: Bonds) -> PyTree:
    """model.method(bonds) at every point of families that are `regular`."""
    varying, shared = split_model(model, bonds.xi.shape[0])
    return jax.vmap(lambda mine, b: getattr(eqx.combine(mine, shared), method)(b))(varying, bonds)
