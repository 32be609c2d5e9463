"""The order m of a Seth–Hill strain as a plain number, where that saves exponentials."""

from typing import TypeVar

import equinox as eqx
import numpy as np

from .._internal.checks import is_concrete
from .base import AbstractModel
from .kinematics import ORDERS

Model = TypeVar("Model", bound=AbstractModel)


def with_plain_order(model: Model) -> Model:
    """The model with its m as a Python float if the value is known and one of ORDERS, otherwise the model itself.

    A Python float is part of the compiled program. Every such order has its own program.
    """
    m = model.m  # type: ignore[attr-defined]
    if m is None or not is_concrete(m) or np.shape(m) or float(m) not in ORDERS:
        return model
    return eqx.tree_at(lambda model: model.m, model, float(m))
