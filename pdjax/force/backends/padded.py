"""The backend "families": padded neighbour arrays, for every model and every cloud of points.

Small bodies are evaluated with all bonds at once, which compiles faster. Larger bodies are evaluated one slot of the
neighbour arrays at a time, so that memory grows with the points and not with points × bonds. This needs a model made of
moments. Other models are evaluated with all bonds at once at every size.
"""

import math
from typing import ClassVar

from jaxtyping import Array, Bool, Float

from ...geometry.bonds import Families
from ...models.base import AbstractModel
from ..fields import whole_force
from .backend import Backend
from .streamed import prepare_streamed
from .traversal import SlotTraversal

# Below this number of bonds all are evaluated at once. That takes a third of the time to compile, and less than a
# millisecond to run (measured).
SMALL = 10_000


class Whole(Backend):
    """The backend that evaluates all bonds of a body at once."""

    takes_complex: ClassVar[bool] = True

    families: Families

    def with_share(
        self,
        model: AbstractModel,
        share: Bool[Array, "points bonds"] | Float[Array, "points bonds"],
        sums: Float[Array, "entries points"] | None,
    ) -> "Whole":
        """The backend with broken bonds; see `Backend.with_share`."""
        return Whole(self.families.with_share(share))

    def force(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point; see `Backend.force`."""
        return whole_force(model, self.families, self.families.bonds(u, F))


def is_small(families: Families) -> bool:
    """Whether all bonds of these families are evaluated at once."""
    return families.xi is not None and math.prod(families.xi.shape[:2]) < SMALL


def refusal(model: AbstractModel, families: Families) -> str | None:
    """Why this backend cannot be used, or None if it can: it needs families with padded arrays."""
    return "the families were made with arrays=False" if families.xi is None else None


def prepare(model: AbstractModel, families: Families) -> Backend:
    """The backend for these families."""
    if is_small(families) or not model.by_moments:
        return Whole(families)
    return prepare_streamed(model, families, SlotTraversal)
