"""Conversion of values to those that JSON can hold."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np


def plain(value: object, not_finite: Callable[[float], object] = str) -> Any:
    """The tree of dictionaries and lists with NumPy scalars converted to Python numbers.

    JSON has no infinity and no NaN. `not_finite` gives the value that replaces such a number, by default its name as a
    string.
    """
    if isinstance(value, dict):
        return {k: plain(v, not_finite) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v, not_finite) for v in value]
    value = value.item() if isinstance(value, np.generic) else value
    return not_finite(value) if isinstance(value, float) and not math.isfinite(value) else value
