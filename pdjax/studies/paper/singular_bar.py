"""The singular bar: four panels for the model of order m = 1 and for Silling's model, with the verdict of each.

The modulus of the bar drops to zero just beyond its middle. The figure shows displacement, strain, and the eigenvector
of the largest eigenvalue of the bar's Jacobian at the solution. The paper does not give the number of points. The
numbers show how the verdict depends on it.
"""

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

from ..bars import bar_case, singular_curves
from ._common import OPEN, Found, judge, linear, of_order, sizes

N = 3
STRESSES = {"tension": 1e-3, "compression": -1e-5}  # over E₀, the paper's
_SHOWN = {"tension": "10⁻³", "compression": "−10⁻⁵"}
BAR_LAW = linear(1.0, 0.0)
MODELS = {"m = 1": of_order(1.0, BAR_LAW), "Silling": pd.Correspondence(BAR_LAW)}


def alternation(u: np.ndarray, known: np.ndarray) -> float:
    """‖¼ δ²(u − u_known)‖ / ‖u_known‖ with the second difference δ²; an alternation ±ε counts with its size ε."""
    return float(np.linalg.norm(np.diff(u - known, 2) / 4) / np.linalg.norm(known))


def solve(name: str, side: str, n: int):
    """Solve one bar by Newton in one load step: (its column of the figure, its numbers)."""
    stress = STRESSES[side]
    scene = pd.scenes.singular_bar(n, N, stress, model=MODELS[name])
    curves = singular_curves(scene, stress)
    result = pd.solve(scene, smallest_step=1.0)
    case, row = bar_case(scene, result, f"{name}, {side},\nσ/E₀ = {_SHOWN[side]}", stress, curves)
    local, printed = curves.values()
    return case, {
        **row,
        "n": n,
        "from printed": float(np.linalg.norm(case.u - printed) / np.linalg.norm(printed)),
        "printed from local": float(np.linalg.norm(printed - local) / np.linalg.norm(local)),
        "alternation": alternation(case.u, local),
    }


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `singular-bar`."""
    points = (100, 200) if quick else (50, 100, 200, 400, 800)
    drawn = points[-1] if quick else 400
    numbers: dict = {"points drawn": drawn}
    cases = {}
    for name in MODELS:
        for side in STRESSES:
            rows = []
            for n in points if name == "m = 1" or not quick else points[-1:]:
                case, row = solve(name, side, n)
                rows.append(row)
                if n == drawn:
                    cases[name, side] = case
            numbers[f"{name}, {side}"] = rows
    count, error = np.log([[row["n"], row["distance"]] for row in numbers["m = 1, tension"]]).T
    numbers["order of convergence, m = 1, tension"] = float(-np.polyfit(count, error, 1)[0])
    title = f"Singular bar, {drawn} points, N = {N}: solution, and mode of the largest eigenvalue{sizes(quick)}"
    return numbers, pd.figures.bars(list(cases.values()), title, ("E₀ u / (σ L)  [–]", "E₀ ε / σ  [–]"))


# --- what the numbers say of the claims


def bar_tension(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, tension"]
    best, order = rows[-1], n["order of convergence, m = 1, tension"]
    ours = f"a {best['kind']}; the error is {best['distance']:.1%} at {best['n']} points and falls as n^−{order:.2f}"
    falls = all(a["distance"] > b["distance"] for a, b in pairwise(rows))
    return ours, judge(all(r["kind"] == "minimum" for r in rows) and falls)


def bar_form(n: dict) -> Found:
    """Section 5.1: the local solution of the model's law is nonlinear."""
    gap = n["m = 1, tension"][-1]["printed from local"]
    ours = f"it is {gap:.1%} from the nonlinear local solution, to which the bar converges"
    return ours, judge(gap < 0.01, n["m = 1, tension"][-1]["distance"] < n["m = 1, tension"][-1]["from printed"])


def bar_compression(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, compression"]
    saddles = [r["n"] for r in rows if r["kind"] == "saddle"]
    minima = [r["n"] for r in rows if r["kind"] == "minimum"]
    ours = (
        f"a saddle from {min(saddles)} points on; up to {max(minima)} points a minimum that alternates"
        if saddles
        else "a minimum"
    )
    return ours, judge(bool(saddles) and max(minima) < min(saddles))


def bar_points(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, compression"]
    return "the answer depends on it: " + ", ".join(f"{r['n']}: {r['kind']}" for r in rows), OPEN


def bar_silling(n: dict) -> Found:
    """Section 5.1: the displacement alternates, but the state is not a saddle."""
    rows = [*n["Silling, tension"], *n["Silling, compression"]]
    positive, least = max(r["positive"] for r in rows), min(r["alternation"] for r in rows)
    ours = f"no positive eigenvalue, so it is not unstable; yet u alternates (by {least:.0%} of u or more)"
    return ours, judge(positive > 0, positive == 0 and least > 0.01)
