"""The singular bar: error, convergence, failure, and the cost of accuracy by each method of solution.

Errors are relative root mean squares over the points. They are measured from two closed forms: the nonlinear local
solution, to which the bar converges, and the small-strain solution printed in the paper. At σ/E₀ = 10⁻³ the two differ
by a few percent.
"""

import time

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.bench.statics import MOST, POINTS, bar, distance
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
METHODS = {"newton": "Newton", "newton_krylov": "Newton–Krylov, matrix-free", "relaxation": "relaxation"}


def look(scene, stress, **how) -> dict:
    """Solve twice, so that the time excludes the compilation, and compare with both closed forms."""
    pd.solve(scene, stability=False, **how)
    start = time.perf_counter()
    found = pd.solve(scene, stability=False, **how)
    seconds = time.perf_counter() - start
    own = pd.body_stability(scene, found.u)
    x = scene.body.positions[:, 0]
    printed = pd.closed_forms.singular_bar_displacement(x, 1.0, stress)[:, None]
    return {
        "n": len(scene.body),
        "seconds": seconds,
        "converged": found.converged,
        "iterations": int(found.iterations),
        "kind": own.kind,
        "positive": own.positive,
        "turned bonds": int(found.turned),
        "error, nonlinear local": distance(found.u, scene.closed_form),
        "error, printed": distance(found.u, printed),
        "printed from nonlinear": distance(printed, scene.closed_form),
    }


def order(rows: list[dict]) -> float:
    """Order of convergence in 1/n."""
    n, e = (np.array([row[key] for row in rows]) for key in ("n", "error, nonlinear local"))
    return float(-np.polyfit(np.log(n), np.log(e), 1)[0])


def tractions() -> list[dict]:
    """Errors in tension for α = 0, with the exact traction and with a uniform one."""
    rows = []
    for n in (50, 100, 200, 400):
        errors = {}
        for traction in ("exact", "even"):
            scene = pd.scenes.singular_bar(n, 3, 1e-3, alpha=0.0, traction=traction)
            errors[traction] = distance(pd.solve(scene, stability=False, tolerance=1e-13).u, scene.closed_form)
        rows.append({"n": n, **errors})
    return rows


def error(row: dict) -> float:
    """Error from the local solution. Files written before the case `statics` existed name it as `look` does."""
    return row["error"] if "error" in row else row["error, nonlinear local"]


def draw(numbers: dict) -> Figure:
    """Draw the error over n (left) and over time by method (right), for converged solutions only."""
    figure = Figure(figsize=(10.4, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for (N, every), colour in zip(numbers["tension by N"].items(), SERIES, strict=False):
        rows = [r for r in every if r["converged"]]
        lost = [str(r["n"]) for r in every if not r["converged"]]
        label = f"tension, N = {N}: order {order(rows):.2f}" + (f" (stalls at {', '.join(lost)})" if lost else "")
        x, y = [r["n"] for r in rows], [r["error, nonlinear local"] for r in rows]
        left.loglog(x, y, "o-", color=colour, markersize=3, label=label)
    for r in numbers["compression, N = 3"]:
        mark = {"minimum": "s", "saddle": "x"}.get(r["kind"], "d")
        left.loglog([r["n"]], [r["error, nonlinear local"]], mark, color=SERIES[4])
    left.plot([], [], "s", color=SERIES[4], label="compression, N = 3: a minimum")
    left.plot([], [], "x", color=SERIES[4], label="compression, N = 3: a saddle")
    three = numbers["tension by N"]["3"]
    left.loglog(
        [r["n"] for r in three],
        [r["error, printed"] for r in three],
        "k:",
        label="tension, N = 3: error from the printed form",
    )
    left.set_xlabel("points n  [–]")
    left.set_ylabel("error of u from the local solution  [–]")
    left.set_ylim(5e-3, 8)
    left.legend(frameon=False, fontsize=7, loc="upper right")
    for (name, rows), colour in zip(numbers["methods, tension, N = 3"].items(), SERIES, strict=False):
        x, y = [r["seconds"] for r in rows], [error(r) for r in rows]
        right.loglog(x, y, "o-", color=colour, markersize=3, label=METHODS[name])
    for r in numbers["methods, tension, N = 3"]["newton"]:
        place = (r["seconds"], error(r))
        right.annotate(str(r["n"]), place, fontsize=7, xytext=(-4, -9), textcoords="offset points", ha="right")
    right.set_xlabel("time to solve without compilation  [s]")
    right.set_ylabel("error of u from the local solution  [–]")
    right.legend(frameon=False, fontsize=8, title="numbers: points n", title_fontsize=8)
    figure.suptitle("Singular bar, m = 1, α = 10, σ/E₀ = 10⁻³ (tension), −10⁻⁵ (compression)", fontsize=11)
    return figure


def main() -> None:
    tension = {
        str(N): [look(pd.scenes.singular_bar(n, N, 1e-3), 1e-3, smallest_step=1.0) for n in POINTS]
        for N in (1, 2, 3, 4)
    }
    compression = [look(pd.scenes.singular_bar(n, 3, -1e-5), -1e-5, smallest_step=1.0) for n in POINTS[:-1]]
    silling = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    original = {
        stress: [
            look(pd.scenes.singular_bar(n, 3, stress, model=silling), stress, smallest_step=1.0) for n in POINTS[:5]
        ]
        for stress in (1e-3, -1e-5)
    }
    methods = {name: [{"n": n, **bar(name, n, 3)} for n in POINTS if n <= MOST[name]] for name in METHODS}
    numbers = {
        "tension by N": tension,
        "orders": {N: order([r for r in rows if r["converged"]]) for N, rows in tension.items()},
        "compression, N = 3": compression,
        "Silling's model, N = 3": original,
        "methods, tension, N = 3": methods,
        "alpha = 0: error by traction": tractions(),
    }
    write("singular_bar", numbers, draw(numbers))


if __name__ == "__main__":
    main()
