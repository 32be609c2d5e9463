"""Figures: arrays in, a matplotlib Figure out. Imported when first used, by nothing else in the package."""

from .atlas import model_atlas
from .charts import COLOURS, LABELS, SERIES, STYLES, BarCase, bars, dispersion, stability_map
from .motions import Branch, animation, cuboid, dispersion_curves, motion
from .tables import table

__all__ = [
    "COLOURS",
    "LABELS",
    "SERIES",
    "STYLES",
    "BarCase",
    "Branch",
    "animation",
    "bars",
    "cuboid",
    "dispersion",
    "dispersion_curves",
    "model_atlas",
    "motion",
    "stability_map",
    "table",
]
