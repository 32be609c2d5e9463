"""A lattice without index arrays: the neighbours of all points at one offset are one slice of an array."""

from typing import Any

from ...geometry.bonds import Families
from .backend import Backend, lattice_refusal
from .streamed import prepare_streamed
from .traversal import LatticeTraversal


def refusal(model: Any, families: Families) -> str | None:
    """Why slices don't apply to this model and body; None if they do."""
    return lattice_refusal(model, families)


def prepare(model: Any, families: Families) -> Backend:
    """The backend for these families."""
    return prepare_streamed(model, families, LatticeTraversal)
