"""Figures: functions that take arrays or results and return a matplotlib Figure.

`import pdjax` does not load this module, because it needs matplotlib. The first use of `pd.figures` loads it. No
function uses pyplot or another global state of matplotlib: `figure.savefig(path)` writes the picture.

    maps and lattices  stability_map, dispersion, dispersion_curves, model_atlas
    bodies             scene, field, bars, neighbours
    audits             audit, audit_states
    motions            motion, cuboid, animation
    fracture           crack, breaking_path, crack_or_instability
    designs            pareto_front
    text               table
    styles             COLOURS, LABELS, SERIES, STYLES
"""

from .atlas import model_atlas
from .audits import audit, audit_states
from .charts import COLOURS, LABELS, SERIES, STYLES, BarCase, bars, dispersion, stability_map
from .cracks import breaking_path, crack
from .fields import field, scene
from .fracture import crack_or_instability
from .fronts import pareto_front
from .motions import Branch, animation, cuboid, dispersion_curves, motion
from .neighbours import neighbours
from .tables import table

__all__ = [
    "COLOURS",
    "LABELS",
    "SERIES",
    "STYLES",
    "BarCase",
    "Branch",
    "animation",
    "audit",
    "audit_states",
    "bars",
    "breaking_path",
    "crack",
    "crack_or_instability",
    "cuboid",
    "dispersion",
    "dispersion_curves",
    "field",
    "model_atlas",
    "motion",
    "neighbours",
    "pareto_front",
    "scene",
    "stability_map",
    "table",
]
