"""The singular bar, four panels for the paper's model of order m = 1 and four for Silling's, and the verdict of each.

The bar's modulus falls to zero just beyond its middle. Beside displacement and strain: the eigenvector of the largest
eigenvalue of the bar's own Jacobian at the solution found. The paper gives no number of points; the numbers hold how
the verdict depends on it.
"""

import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

from .._run import bar_case, singular_curves
from ._common import linear, of_order, sizes

N = 3
STRESSES = {"tension": 1e-3, "compression": -1e-5}  # over E₀, the paper's
BAR_LAW = linear(1.0, 0.0)
MODELS = {"m = 1": of_order(1.0, BAR_LAW), "Silling": pd.Correspondence(BAR_LAW)}


def alternation(u: np.ndarray, known: np.ndarray) -> float:
    """‖¼ δ²(u − u_known)‖ / ‖u_known‖, δ² the second difference: a pure zigzag counts by its size."""
    return float(np.linalg.norm(np.diff(u - known, 2) / 4) / np.linalg.norm(known))


def solve(name: str, side: str, n: int):
    """One bar by Newton in one load step: (its column of a figure, its numbers)."""
    stress = STRESSES[side]
    scene = pd.scenes.singular_bar(n, N, stress, model=MODELS[name])
    curves = singular_curves(scene, stress)
    result = pd.solve(scene, smallest_step=1.0)
    case, row = bar_case(scene, result, f"{name}, {side}, σ/E₀ = {stress:g}".replace("-", "−"), stress, curves)
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
    title = f"Singular bar, {drawn} points, N = {N}: what was found, and the mode that decides{sizes(quick)}"
    return numbers, pd.figures.bars(list(cases.values()), title, ("E₀ u / (σ L)  [–]", "E₀ ε / σ  [–]"))
