"""The singular bar by every method of `pdjax.solve`: error of u against wall time.

The bar is that of `pdjax.scenes.singular_bar` in tension, with σ/E₀ = 1e-3, α = 10 and order m = 1. The error is the
relative root mean square distance of u from its closed form, the nonlinear local solution. It is the error of the
discretisation, and therefore the same for every method that converges. The methods differ in time only. Rows that did
not converge have no error.
"""

from collections.abc import Iterator
from functools import partial

import numpy as np

from ..finite_body.statics import solve
from ..scenes import singular_bar
from .chart import error_against_time
from .harness import Case, Task, hosted

SCENE = "singular-bar"
STRESS = 1e-3
POINTS = (50, 100, 200, 400, 800, 1600, 3200)
MOST = {"newton": 3200, "newton_krylov": 1600, "relaxation": 1600, "trust_region": 400}  # larger ones are dense or slow


def distance(u, known) -> float:
    """Return the relative root mean square distance [-]."""
    u, known = np.asarray(u, float), np.asarray(known, float)
    return float(np.linalg.norm(u - known) / np.linalg.norm(known))


def bar(method: str, n: int, N: int) -> dict:
    """Measure one method on one bar."""
    scene = singular_bar(n, N, STRESS)
    found, row = hosted(lambda: solve(scene, method, stability=False, smallest_step=1.0))
    error = distance(found.u, scene.closed_form) if found.converged else None
    return row | {"error": error, "iterations": int(found.iterations), "reason": found.reason}


def task(method: str, n: int, N: int, dtype: str = "float64") -> Task:
    """Plan one row."""
    return Task(method, {"scene": SCENE, "n": n, "N": N}, partial(bar, method, n, N), dtype)


def plan(quick: bool) -> Iterator[Task]:
    """Plan Newton's method for N = 1, 2, 3, and the other methods for N = 3."""
    for N in (1, 2, 3):
        for n in POINTS[:3] if quick else POINTS:
            yield task("newton", n, N)
    for method in ("newton_krylov", "trust_region", "relaxation"):
        for n in POINTS[: 1 if quick else None]:
            if n <= MOST[method]:
                yield task(method, n, 3)


def draw(rows: list[dict]):
    """Draw a line for each method and N. The numbers are points."""
    return error_against_time(
        rows,
        "Singular bar, m = 1, σ/E₀ = 10⁻³",
        "error of u from the local solution  [–]",
        line=lambda row: f"{row['method']}, N = {row['N']}",
        note=lambda row: str(row["n"]),
    )


CASE = Case("Statics: the methods of pdjax.solve on the singular bar", plan, draw, {"stress": STRESS, "m": 1.0})
