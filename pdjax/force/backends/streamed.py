"""The backend class `Streamed`: prepares a body once and keeps what is reused. `streaming` holds its formulas.

`prepare_streamed` makes the traversal (`traversal`), which yields the bonds one slot at a time, and the sums over the
reference configuration. These sums depend on few constants of the model. They are computed once for each set of these
constants, and the families object keeps them. The forces themselves come from `streaming.streamed_force`.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..._internal.checks import is_concrete
from ..._internal.memory import remember
from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel, PointStateModel
from ...models.pointwise import split_model
from .backend import Backend
from .point_states import kept_reference
from .streaming import (
    breaks_in_the_loop,
    reference_sums,
    streamed_break,
    streamed_force,
    sums_of_families,
)
from .traversal import SlotTraversal, Traversal


class Streamed(Backend):
    """The traversal over the bonds of a body, together with the sums over its reference configuration."""

    traversal: Traversal
    reference: Array  # (entries, flat)
    horizon: Array

    def sums(self, model: AbstractModel) -> Float[Array, "entries points"] | None:
        """The reference sums, if they change as bonds break; see `Backend.sums`."""
        return None if model.keeps_reference else self.reference

    def new_sums(
        self,
        model: AbstractModel,
        sums: Float[Array, "entries points"],
        bonds: Bonds,
        points: Int[Array, " few"],
        real: Bool[Array, " few"],
    ) -> Float[Array, "entries points"]:
        """The sums after few families have changed; see `Backend.new_sums`."""
        assert isinstance(model, PointStateModel)
        new = sums_of_families(model, bonds)
        return sums.at[:, jnp.where(real, points, sums.shape[1])].set(new, mode="drop")

    def with_share(
        self,
        model: AbstractModel,
        share: Bool[Array, "points bonds"] | Float[Array, "points bonds"],
        sums: Float[Array, "entries points"] | None,
    ) -> "Streamed":
        """The backend with broken bonds; see `Backend.with_share`."""
        assert isinstance(self.traversal, SlotTraversal)
        traversal = eqx.tree_at(lambda t: t.share, self.traversal, share.T, is_leaf=lambda x: x is None)
        if model.keeps_reference:
            sums = self.reference
        elif sums is None:
            sums = reference_sums(split_model(model, share.shape[0]), traversal, len(traversal.xi), self.horizon)
        return Streamed(traversal, sums, self.horizon)

    def breaking(
        self,
        model: AbstractModel,
        u: Float[Array, "points dim"],
        alive: Bool[Array, "points bonds"],
        limit: Array,
        sums: Float[Array, "entries points"] | None,
    ) -> tuple[Float[Array, "points dim"], Bool[Array, "points bonds"]] | None:
        """f and the bonds above the limit; see `Backend.breaking`."""
        split = split_model(model, len(u))
        if not (isinstance(self.traversal, SlotTraversal) and breaks_in_the_loop(model, split, self.traversal)):
            return None
        reference = self.reference if sums is None else sums
        return streamed_break(split, self.traversal, reference, u, self.horizon, alive, limit)

    def force(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point; see `Backend.force`."""
        gradient = None if F is None else F - jnp.eye(u.shape[1], dtype=u.dtype)
        split = split_model(model, len(u))
        return streamed_force(split, self.traversal, self.reference, u, gradient, self.horizon)


@eqx.filter_jit
def _reference(model: AbstractModel, traversal: Traversal, horizon: Array, points: int, dim: int) -> Array:
    return reference_sums(split_model(model, points), traversal, dim, horizon)


def prepare_streamed(model: AbstractModel, families: Families, kind: type[Traversal]) -> Streamed:
    """The streamed backend. `kind` is the class of its traversal, `SlotTraversal` or `LatticeTraversal`."""
    assert isinstance(model, PointStateModel)
    points, name = len(families), kind.__name__
    known = is_concrete(families)
    traversal = remember(families, ("traversal", name), lambda: kind.of(families)) if known else kind.of(families)

    def sums(model: AbstractModel) -> Array:
        at_rest = traversal
        if families.intact is not None and model.keeps_reference:
            at_rest = kind.of(eqx.tree_at(lambda f: f.weight, families, families.intact))
        return _reference(model, at_rest, families.horizon, points, families.dim)

    return Streamed(traversal, kept_reference(model, families, name, sums, sums), families.horizon)
