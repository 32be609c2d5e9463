"""Values that JSON can hold."""

import math
from typing import Any


def plain(value: Any) -> Any:
    """JSON has no infinity or NaN: they become the strings a reader expects."""
    if isinstance(value, dict):
        return {k: plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value
