"""Padded neighbour arrays, for any model and any cloud: all bonds at once in small bodies, else slot by slot.

All bonds at once compile sooner. Slot by slot, the memory is that of the points and not of points × bonds; that needs a
model made of moments.
"""

import math
from typing import Any, ClassVar

from jaxtyping import Array, Float

from ...geometry.bonds import Families
from ..fields import whole_force
from .backend import Backend
from .streamed import prepare_streamed
from .traversal import SlotTraversal

SMALL = 10_000  # bonds below which all go at once: a third of the time to compile, under a millisecond to run


class Whole(Backend):
    """All bonds of a body at once."""

    takes_complex: ClassVar[bool] = True

    families: Families

    def force(self, model: Any, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point; see `Backend.force`."""
        return whole_force(model, self.families, self.families.bonds(u, F))


def is_small(families: Families) -> bool:
    """Whether all bonds of these families go at once."""
    return families.xi is not None and math.prod(families.xi.shape[:2]) < SMALL


def refusal(model: Any, families: Families) -> str | None:
    """Why there are no padded arrays; None if there are."""
    return "they were made with arrays=False" if families.xi is None else None


def prepare(model: Any, families: Families) -> Backend:
    """The backend for these families."""
    if is_small(families) or not model.by_moments:
        return Whole(families)
    return prepare_streamed(model, families, SlotTraversal)
