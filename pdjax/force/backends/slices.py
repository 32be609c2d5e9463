"""The backend "slices": on a lattice the neighbours of all points at one offset are one slice of an array.

It needs no index arrays.
"""

from ...geometry.bonds import Families
from ...models.base import AbstractModel
from .backend import Backend, lattice_refusal
from .streamed import prepare_streamed
from .traversal import LatticeTraversal


def refusal(model: AbstractModel, families: Families) -> str | None:
    """Why this backend cannot evaluate this model and body, or None if it can."""
    return lattice_refusal(model, families)


def prepare(model: AbstractModel, families: Families) -> Backend:
    """The backend for these families."""
    return prepare_streamed(model, families, LatticeTraversal)
