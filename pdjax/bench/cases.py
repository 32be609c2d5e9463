"""The table of benchmarks. A new benchmark needs one line here."""

from . import criteria, device, integrators, jacobians, precision, start, statics, ways
from .harness import Case

CASES: dict[str, Case] = {
    device.ROOFS: device.CASE,
    "start": start.CASE,
    "jacobians": jacobians.CASE,
    "criteria": criteria.CASE,
    "statics": statics.CASE,
    "integrators": integrators.CASE,
    "precision": precision.CASE,
    "ways": ways.CASE,
}
