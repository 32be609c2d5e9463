"""Constants that vary from point to point: a leaf of the model whose first axis is as long as the body has points."""

from typing import Any

import equinox as eqx
import jax

from ..neighbours import Bonds
from .base import AbstractModel


def split_model(model: AbstractModel, points: int) -> tuple[Any, Any]:
    """(leaves that vary from point to point, everything else)."""
    return eqx.partition(model, lambda leaf: eqx.is_array(leaf) and leaf.ndim > 0 and leaf.shape[0] == points)


def each_point(method: str, model: AbstractModel, bonds: Bonds) -> Any:
    """model.method(bonds) at every point, with that point's own constants."""
    varying, shared = split_model(model, bonds.xi.shape[0])
    return jax.vmap(lambda mine, b: getattr(eqx.combine(mine, shared), method)(b))(varying, bonds)
