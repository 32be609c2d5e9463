"""Time and accuracy of the critical load by each criterion: error of a_cr against wall time.

The problem is a 2D lattice with N = 3, λ = 3, μ = 1 in uniaxial strain, under two loads. The first is m = −2 in
compression, where the worst wave lies at the corner of the Brillouin zone and most criteria give different critical
loads. The second is m = 0.4 in tension, where the worst wave is (0.734, 0) π/h, which lies on no grid.

The exact a_cr is the symbol's with 64 intervals of the zone. "symbol" is measured over the number of intervals. "grid"
takes the best point of the grid without the ascent from it. "body" is the critical strain of a clamped square of n × n
points in compression, which tends to the symbol's as n grows. A criterion that never becomes unstable has no error, and
its a_cr is null.
"""

import math
from collections.abc import Callable, Iterator
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from ..finite_body.critical_load import body_critical_load
from ..geometry.bonds import lattice_family
from ..infinite_lattice.bloch import homogeneous_tangent, modulus_at_rest, wave_phases
from ..infinite_lattice.brillouin import brillouin_zone, largest_eigenvalue
from ..infinite_lattice.criteria.critical_load import critical_load
from ..infinite_lattice.paths import uniaxial_strain
from ..models import SethHill
from ..models.laws import LinearElastic
from ..scenes import clamped_plate
from .chart import error_against_time
from .harness import Case, Task, hosted

SCENE = "critical-load"
LAM, MU, N = 3.0, 1.0, 3
LOADS = {"m = −2, compression": (-2.0, "negative"), "m = 0.4, tension": (0.4, "positive")}
CHEAP = ("diagonal", "block", "material_center", "material", "affine", "local", "continuum")
INTERVALS = (4, 6, 8, 12, 16, 24, 32, 48)
SQUARES = (14, 16, 18, 20, 22)
# Under the other load, squares of 14 × 14 and 18 × 18 points are stable up to 90 % strain.
FIT_IN_A_BODY = ("m = −2, compression",)
PROBE = 1e-2  # [-], the strain at load factor 1: the critical strain of a body is a multiple of it
BISECTIONS = 40


def model(case: str) -> SethHill:
    """Return the model of a load case."""
    return SethHill(LOADS[case][0], LinearElastic(lam=LAM, mu=MU))  # type: ignore[call-arg, arg-type]


def load(case: str, criterion: str, intervals: int | None = None) -> float:
    """Return a_cr of a load case by one criterion."""
    family, side = lattice_family(2, N), LOADS[case][1]
    return float(critical_load(model(case), family, uniaxial_strain, criterion, side, resolution=intervals))


@cache
def exact(case: str) -> float:
    """Return a_cr by the symbol on a fine grid of the zone."""
    return load(case, "symbol", 64)


def _row(case: str, work: Callable[[], float]) -> dict:
    a, row = hosted(work)
    return row | {"error": abs(a - exact(case)) / abs(exact(case)), "a_cr": a}


def criterion(case: str, name: str, intervals: int | None = None) -> dict:
    """Measure one criterion of `critical_load`."""
    return _row(case, partial(load, case, name, intervals))


def grid(case: str, intervals: int) -> dict:
    """Measure a_cr by bisection, with the margin at the best grid point and no ascent from it."""
    family, of, zone = lattice_family(2, N), model(case), brillouin_zone(2, intervals, "orthorhombic")

    @jax.jit
    def margin(a):
        phases = wave_phases(family, jnp.asarray(zone.grid))
        F = uniaxial_strain(a, of, family)
        top = largest_eigenvalue(homogeneous_tangent(of, family, F).components(phases))
        return jnp.max(top / phases.kappa2) / modulus_at_rest(of, family)

    def bisected() -> float:
        stable, unstable = 0.0, 1.2 * exact(case)
        for _ in range(BISECTIONS):
            middle = 0.5 * (stable + unstable)
            stable, unstable = (stable, middle) if margin(middle) > 0 else (middle, unstable)
        return 0.5 * (stable + unstable)

    return _row(case, bisected)


def body(case: str, n: int) -> dict:
    """Measure the critical strain of a clamped square."""
    probe = math.copysign(PROBE, exact(case))
    scene = clamped_plate((n, n), N, np.diag([1 + probe, 1.0]), model(case))
    return _row(case, lambda: probe * body_critical_load(scene, limit=0.9 / PROBE).factor)


def plan(quick: bool) -> Iterator[Task]:
    """Plan the cheap criteria, the symbol over the intervals of its zone, and the body over its points."""
    for case in list(LOADS)[: 1 if quick else None]:
        common = {"scene": SCENE, "N": N, "load": case}
        for name in CHEAP[: 2 if quick else None]:
            yield Task(name, common, partial(criterion, case, name))
        for intervals in INTERVALS[: 2 if quick else None]:
            yield Task("symbol", {**common, "intervals": intervals}, partial(criterion, case, "symbol", intervals))
            yield Task("grid", {**common, "intervals": intervals}, partial(grid, case, intervals))
        for n in SQUARES[: 1 if quick else None] if case in FIT_IN_A_BODY else ():
            yield Task("body", {**common, "n": n}, partial(body, case, n))


def draw(rows: list[dict]):
    """Draw a mark for each cheap criterion, and lines for the symbol (intervals) and the body (points along a side)."""
    return error_against_time(
        rows,
        "Critical load in uniaxial strain, 2D, N = 3",
        "error of a_cr, relative  [–]",
        note=lambda row: str(row.get("intervals", row.get("n", ""))),
        panel=lambda row: row["load"],
    )


CASE = Case(
    "Criteria: error of the critical load, from the diagonal to the symbol and to bodies",
    plan,
    draw,
    {"lam": LAM, "mu": MU, "path": "uniaxial_strain"},
)
