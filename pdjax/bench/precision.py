"""float32 compared with float64: accuracy and time of a map, an equilibrium and a motion.

    map       the symbol's margin on a coarse default map (2D, N = 3), over the intervals of the zone; the error is
              the largest difference of margins from the float64 map with 64 intervals
    statics   the singular bar by Newton (see statics)
    dynamics  a travelling wave by velocity Verlet and Dopri8 (see integrators)

Every row computes everything in its own precision, starting with the points. The references are in float64.
"""

from collections.abc import Iterator
from functools import cache, partial

import numpy as np

from ..infinite_lattice.maps import StabilityMap, stability_map
from ..models.laws import LinearElastic
from . import integrators, statics
from .chart import error_against_time
from .harness import Case, Task, enable_x64, hosted

DTYPES = ("float64", "float32")
ORDERS, LOADS = (-2.0, 2.0, 24), (-0.3, 0.3, 25)
FINE = 64
PANELS = {
    "map": "map: largest error of a margin",
    statics.SCENE: "singular bar: error of u, relative",
    integrators.SCENE: "wave: largest error of u and v, relative",
}


def _map(intervals: int, shape: tuple[int, int]) -> StabilityMap:
    """Compute the coarse map in the current precision."""
    m, a = (np.linspace(low, high, n) for (low, high, _), n in zip((ORDERS, LOADS), shape, strict=True))
    law = LinearElastic(lam=1.0, mu=1.0)  # type: ignore[call-arg, arg-type]
    return stability_map(m, a, law=law, resolution=intervals, show_progress=False)


@cache
def _fine(shape: tuple[int, int]) -> StabilityMap:
    with enable_x64(True):
        return _map(FINE, shape)


def margins(intervals: int, shape: tuple[int, int]) -> dict:
    """Measure a map with a number of intervals."""
    found, row = hosted(lambda: _map(intervals, shape))
    exact = _fine(shape)
    differ = found.verdict != exact.verdict
    return row | {
        "error": float(np.abs(found.margin - exact.margin).max()),
        "verdicts that differ": float(np.mean(differ)),
        "of these called marginal": float(np.mean(differ & (found.verdict == "marginal"))),
    }


def plan(quick: bool) -> Iterator[Task]:
    """Plan all parts in both precisions."""
    shape = (6, 5) if quick else (ORDERS[2], LOADS[2])
    for dtype in DTYPES:
        for intervals in (8,) if quick else (8, 16, 24, 48):
            settings = {"scene": "map", "N": 3, "intervals": intervals}
            yield Task("symbol", settings, partial(margins, intervals, shape), dtype)
        for n in statics.POINTS[: 2 if quick else -1]:
            yield statics.task("newton", n, 3, dtype)
        for name, counts in ((integrators.VERLET, integrators.VERLET_STEPS), ("Dopri8 (8)", (16, 32, 64))):
            for steps in counts[: 1 if quick else None]:
                yield integrators.task(name, steps, dtype)


def draw(rows: list[dict]):
    """Draw a panel for each part. The numbers are intervals, points or steps."""
    return error_against_time(
        rows,
        "float32 compared with float64",
        "error  [–]",
        line=lambda row: f"{row['method']}, {row['dtype']}",
        note=lambda row: str(row.get("intervals", row.get("steps", row.get("n")))),
        panel=lambda row: PANELS[row["scene"]],
    )


CASE = Case("Precision: float32 compared with float64 for a map, statics and dynamics", plan, draw)
