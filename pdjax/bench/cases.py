"""The table of benchmarks: a new one is one line."""

from . import device, jacobians
from .harness import Case

CASES: dict[str, Case] = {
    device.ROOFS: device.CASE,
    "jacobians": jacobians.CASE,
}
