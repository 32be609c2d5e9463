"""Models made of moments over a whole body: constants that vary, sums of the reference configuration, point states.

A layout stores a quantity of the points as an array (components, flat), perhaps with cells that hold no point. It has

    embed      converts (points, components) to this layout
    volumes    of the points (flat,)
    filled     1 in cells that hold a point and 0 elsewhere, or None if every cell holds one

The layouts are the traversals of `traversal` and those of `pdjax.force.backends.compiled.layouts`.
"""

from collections.abc import Callable
from typing import Protocol, TypeVar, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import PyTreeDef
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree

from ..._internal.checks import is_concrete
from ..._internal.dependence import known_part
from ..._internal.memory import remember
from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel, PointStateModel, Sums
from ...models.pointwise import directions_of_rest, split_model
from .components import by_components, join, one_entry, trees

Result = TypeVar("Result")


@runtime_checkable
class Layout(Protocol):
    """How the points of a body are stored; see the module."""

    filled: Array | None

    @property
    def volumes(self) -> Array: ...

    def embed(self, x: Array) -> Array: ...


class Varying:
    """The constants of a model that vary from point to point, in a layout.

    `split` is the result of `split_model`. `rows` holds the constants, each as (components, flat).
    """

    def __init__(self, split: tuple[PyTree, AbstractModel], layout: Layout):
        varying, self.shared = split
        leaves, self.structure = jax.tree.flatten(varying)
        self.shapes = [x.shape[1:] for x in leaves]
        self.first = [x[0].astype(layout.volumes.dtype) for x in leaves]
        self.rows = [self._laid(layout, x) for x in leaves]

    @staticmethod
    def _laid(layout: Layout, x: Array) -> Array:
        """A constant as (components, flat). Empty cells get that of the first point, so that no law divides by 0."""
        x = x.astype(layout.volumes.dtype).reshape(x.shape[0], -1)
        return (
            layout.embed(x) if layout.filled is None else jnp.where(layout.filled > 0, layout.embed(x), x[0][:, None])
        )

    def __bool__(self) -> bool:
        return bool(self.rows)

    def components(self, read: Callable = list) -> list[np.ndarray]:
        """The constants by components. `read` reads one of `rows`, for example at the neighbours of the points."""
        return [trees(None, [s], read(x)) for x, s in zip(self.rows, self.shapes, strict=True)]

    def single(self) -> PointStateModel:
        """The model with the constants of the first point."""
        return self.model(self.first)

    def model(self, leaves: list) -> PointStateModel:
        return eqx.combine(jax.tree.unflatten(self.structure, leaves), self.shared)


def sizes_of_moments(
    model: PointStateModel, which: int, dim: int, dtype: DTypeLike
) -> tuple[PyTreeDef, list[tuple[int, ...]]]:
    """Structure and shapes of the reference moments (`which` = 0) or the deformed moments (1)."""
    one = Bonds(*(jax.ShapeDtypeStruct(s, dtype) for s in ((dim,), (dim,), (), (), ())))  # type: ignore[arg-type]
    tree = jax.eval_shape(model.moments, one)[which]
    leaves, structure = jax.tree.flatten(tree)
    return structure, [x.shape for x in leaves]


def reference_moments(model: PointStateModel, points: int, dim: int) -> PyTree:
    """The contribution of one bond to the sums of the reference configuration.

    Tracing it shows on which constants of the model these sums depend.
    """
    varying, shared = split_model(model, points)
    first = eqx.combine(jax.tree.map(lambda x: x[0], varying), shared)
    return first.moments(Bonds(jnp.ones(dim), jnp.zeros(dim), *map(jnp.ones, ((), (), ()))))[0]


def kept_reference(
    model: PointStateModel,
    families: Families,
    layout: str,
    of_known: Callable[[PointStateModel], Result],
    of_traced: Callable[[PointStateModel], Result],
) -> Result:
    """The sums of the reference configuration in a layout, kept with the families for all models that share them.

    Sums that depend on traced values are `of_traced(model)`, and are not kept.
    """
    part = None
    if is_concrete(families):
        points, dim = len(families), families.dim
        part = known_part(families, "reference", lambda m: reference_moments(m, points, dim), model)
    if part is None:
        return of_traced(model)
    key, there = part
    return remember(families, ("reference sums", layout, key), lambda: of_known(there))


def bonds_of_rest(dim: int, horizon: Array, dtype: DTypeLike) -> Bonds:
    """The bonds that `models.pointwise` gives to a point without bonds."""
    xi = jnp.max(horizon) * directions_of_rest(dim, dim * (dim + 3) // 2).astype(dtype)
    ones = jnp.ones(len(xi), dtype)
    return Bonds(xi, jnp.zeros_like(xi), ones, ones, jnp.max(horizon))


def with_rest(
    model: PointStateModel, sums: Float[Array, "entries flat"], empty: Array, bonds: Bonds
) -> Float[Array, "entries flat"]:
    """Reference sums in which points that are `empty` have those of the family `bonds`.

    No model then divides by 0 or inverts a singular tensor.
    """
    one = jax.vmap(lambda x, e, w, v: model.moments(Bonds(x, e, w, v, bonds.horizon))[0])(*bonds[:4])
    rows = jnp.concatenate([jnp.zeros(0, sums.dtype), *(x.sum(axis=0).reshape(-1) for x in jax.tree.leaves(one))])
    return jnp.where(empty, rows[:, None], sums)


def states(single: PointStateModel, of: Callable, own: list, dim: int, dtype: DTypeLike, sums: tuple, horizon: Array):
    """The point states from both sums (entries, flat): structure, shapes, and one row (flat,) for each entry.

    `single` is a model of one point, which gives the shapes. `of` makes a model from constants, and `own` holds these
    constants by components.
    """
    kinds = [sizes_of_moments(single, k, dim, dtype) for k in (0, 1)]

    def state_of(leaves, reference, deformed, horizon):
        return of(leaves).state(Sums(reference, deformed, horizon, dim))

    both = [trees(*kind, rows) for kind, rows in zip(kinds, sums, strict=True)]
    state = by_components(state_of, dtype)(own, *both, one_entry(horizon))
    leaves, structure = jax.tree.flatten(state)
    rows = [join(e, sums[0].shape[1]) for x in leaves for e in map(one_entry, x.reshape(-1))]
    return structure, [x.shape for x in leaves], rows


def state_rows(model: PointStateModel, dim: int, dtype: DTypeLike, sums: tuple[Array, Array], horizon: Array) -> list:
    """The point states of a body of one material from both sums (entries, points), one row for each entry."""
    return states(model, lambda leaves: model, [], dim, dtype, sums, horizon)[2]
