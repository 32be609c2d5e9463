"""What a critical load costs by each criterion, and how far it is from the exact one: error of a_cr against wall time.

A 2D lattice, N = 3, λ = 3, μ = 1, at constant width (uniaxial strain), under two loads: m = −2 in compression, where
the worst wave sits at the corner of the zone and most criteria fail somewhere of their own, and m = 0.4 in tension,
where it sits at (0.734, 0) π/h, on no grid. The exact a_cr is the symbol's at 64 intervals of the zone. "symbol" is
shown over the intervals of its zone, "grid" is the zone's grid without the climb from its best points, and "body" is
the critical strain of a clamped square of n × n points, in compression, which tends to the symbol's as n grows. A
criterion that never fails has no error: its a_cr is null.
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
FIT_IN_A_BODY = ("m = −2, compression",)  # squares of 14 and 18 points bear 90 % of the other
PROBE = 1e-2  # [-], the strain whose multiple is the body's critical load
BISECTIONS = 40


def model(case: str) -> SethHill:
    """The model of a load."""
    return SethHill(LOADS[case][0], LinearElastic(lam=LAM, mu=MU))  # type: ignore[call-arg, arg-type]


def load(case: str, criterion: str, intervals: int | None = None) -> float:
    """a_cr of one load."""
    family, side = lattice_family(2, N), LOADS[case][1]
    return float(critical_load(model(case), family, uniaxial_strain, criterion, side, resolution=intervals))


@cache
def exact(case: str) -> float:
    """The symbol's a_cr on a fine zone."""
    return load(case, "symbol", 64)


def _row(case: str, work: Callable[[], float]) -> dict:
    a, row = hosted(work)
    return row | {"error": abs(a - exact(case)) / abs(exact(case)), "a_cr": a}


def criterion(case: str, name: str, intervals: int | None = None) -> dict:
    """One criterion of `critical_load`."""
    return _row(case, partial(load, case, name, intervals))


def grid(case: str, intervals: int) -> dict:
    """a_cr by bisection on the best grid point alone."""
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
    """The critical strain of a clamped square."""
    probe = math.copysign(PROBE, exact(case))
    scene = clamped_plate((n, n), N, np.diag([1 + probe, 1.0]), model(case))
    return _row(case, lambda: probe * body_critical_load(scene, limit=0.9 / PROBE).factor)


def plan(quick: bool) -> Iterator[Task]:
    """Cheap criteria, the symbol over its zone, the body over its points."""
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
    """A mark for each cheap criterion, a line for the symbol (intervals) and for the body (points along a side)."""
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
