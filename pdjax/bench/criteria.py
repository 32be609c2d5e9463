"""What a critical load costs by each criterion, and how far it is from the exact one: error of a_cr against wall time.

The load is compression at constant width (uniaxial strain) of a 2D lattice, N = 3, order m = −2, λ = 3, μ = 1: there
every criterion fails somewhere on its own. The exact a_cr is the symbol's at 64 intervals of the zone. In the chart
"symbol" is shown over the intervals of its zone, "grid" is the zone's grid without the climb from its best points, and
"body" is the critical strain of a clamped square of n × n points, which tends to the symbol's from outside as n grows.
A criterion that never fails, or fails at once, has an error of 1 or more: it says so in "a_cr".
"""

from collections.abc import Iterator
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np

from ..bloch import homogeneous_tangent, p_wave_modulus, wave_phases
from ..criteria.body_critical import body_critical_load
from ..criteria.critical import critical_load
from ..laws import LinearElastic
from ..models import SethHill
from ..neighbours import lattice_family
from ..paths import uniaxial_strain
from ..scenes import clamped_plate
from ..zone import brillouin_zone, largest_eigenvalue
from .chart import error_against_time
from .harness import Case, Task, hosted

SCENE = "critical-load"
ORDER, LAM, MU, N = -2.0, 3.0, 1.0, 3
CHEAP = ("diagonal", "block", "material_center", "material", "affine", "local", "continuum")
INTERVALS = (4, 6, 8, 12, 16, 24, 32, 48)
SQUARES = (14, 16, 18, 20, 22)
PROBE = -1e-2  # [-], the strain whose multiple is the body's critical load
BISECTIONS = 40


def model() -> SethHill:
    """The one model of this case."""
    return SethHill(ORDER, LinearElastic(lam=LAM, mu=MU))  # type: ignore[call-arg, arg-type]


def load(criterion: str, intervals: int | None = None) -> float:
    """a_cr in compression."""
    fam = lattice_family(2, N)
    return float(critical_load(model(), fam, uniaxial_strain, criterion, "negative", resolution=intervals))


@cache
def exact() -> float:
    """The symbol's a_cr on a fine zone."""
    return load("symbol", 64)


def _row(work) -> dict:
    a, row = hosted(work)
    return row | {"error": abs(a - exact()) / abs(exact()), "a_cr": a}


def criterion(name: str, intervals: int | None = None) -> dict:
    """One criterion of `critical_load`."""
    return _row(partial(load, name, intervals))


def grid(intervals: int) -> dict:
    """a_cr by bisection on the best grid point alone."""
    fam, of, zone = lattice_family(2, N), model(), brillouin_zone(2, intervals, "inversion")

    @jax.jit
    def margin(a):
        phases = wave_phases(fam, jnp.asarray(zone.grid))
        F = uniaxial_strain(a, of, fam)
        top = largest_eigenvalue(homogeneous_tangent(of, fam, F).components(phases))
        return jnp.max(top / phases.kappa2) / p_wave_modulus(of, fam)

    def bisected() -> float:
        stable, unstable = 0.0, 1.5 * exact()
        for _ in range(BISECTIONS):
            middle = 0.5 * (stable + unstable)
            stable, unstable = (stable, middle) if margin(middle) > 0 else (middle, unstable)
        return 0.5 * (stable + unstable)

    return _row(bisected)


def body(n: int) -> dict:
    """The critical strain of a clamped square."""
    scene = clamped_plate((n, n), N, np.diag([1 + PROBE, 1.0]), model())
    return _row(lambda: PROBE * body_critical_load(scene, limit=0.9 / abs(PROBE)).factor)


def plan(quick: bool) -> Iterator[Task]:
    """Cheap criteria, the symbol over its zone, the body over its points."""
    common = {"scene": SCENE, "N": N}
    for name in CHEAP[: 2 if quick else None]:
        yield Task(name, common, partial(criterion, name))
    for intervals in INTERVALS[: 2 if quick else None]:
        yield Task("symbol", {**common, "intervals": intervals}, partial(criterion, "symbol", intervals))
        yield Task("grid", {**common, "intervals": intervals}, partial(grid, intervals))
    for n in SQUARES[: 1 if quick else None]:
        yield Task("body", {**common, "n": n}, partial(body, n))


def draw(rows: list[dict]):
    """A mark for each cheap criterion, a line for the symbol (intervals) and for the body (points along a side)."""
    return error_against_time(
        rows,
        "Critical load in uniaxial strain, 2D, N = 3, m = −2",
        "error of a_cr, relative  [–]",
        note=lambda row: str(row.get("intervals", row.get("n", ""))),
    )


CASE = Case(
    "Criteria: error of the critical load, from the diagonal to the symbol and to bodies",
    plan,
    draw,
    {"m": ORDER, "lam": LAM, "mu": MU, "path": "uniaxial_strain"},
)
