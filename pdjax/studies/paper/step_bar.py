"""The step-size bar: is the load step too large, or is the state a saddle? And its critical strain against its points.

Three panels as in the paper (+100 %, −0.01 %, −0.1 % in one step, m = 1, N = 3) have the mode of the largest eigenvalue
below. Beside them is the strain at which the homogeneous state of such a bar loses its stability, by its exact
spectrum. That strain falls as n⁻² for odd N and as n⁻⁶ for even N. Its limit is 0, as the symbol predicts, and not the
−7.4 % of the diagonal.
"""

import numpy as np
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import NullFormatter

import pdjax as pd

from ...figures import COLOURS, SERIES
from .. import closed_forms as cf
from ..bars import bar_case
from ._common import Found, judge, percent, sizes

N, POINTS = 3, 100
STRAINS = (1.0, -1e-4, -1e-3)  # the paper's
METHODS = (
    ("newton", "none", 1.0),
    ("newton", "tangent", 1.0),
    ("newton", "none", 0.2),
    ("newton_krylov", "none", 1.0),
    ("trust_region", "none", 1.0),
    ("relaxation", "none", 1.0),
)  # method, predictor, load step


def critical(N: int, points: tuple[int, ...]) -> list[dict]:
    """Critical strains against the number of points, as long as they are larger than rounding."""
    rows = []
    for n in points:
        free = n - 4 * N
        guess = float(cf.clamped_bar_critical_strain(free, N)) if free >= 12 else 0.0
        if free < 12:
            continue
        if guess > -1e-12:
            break
        scene = pd.scenes.step_size_bar(n, N, guess, clamp=2 * N)
        found = pd.body_critical_load(scene, limit=0.9 / -guess)
        rows.append({"n": n, "free": free, "strain": guess * found.factor, "law": guess, "proved": found.proved})
    return rows


def slope(rows: list[dict]) -> float:
    """Exponent of the number of free points, fitted over the longer half of the bars (at least two)."""
    half = rows[min(len(rows) // 2, len(rows) - 2) :]
    return float(np.polyfit(np.log([r["free"] for r in half]), np.log([-r["strain"] for r in half]), 1)[0])


def outcomes(methods=METHODS) -> tuple[list, list[dict]]:
    """Results of each method at the strains of the paper: columns of a figure (of Newton's method), and rows."""
    cases, rows = [], []
    for strain in STRAINS:
        scene = pd.scenes.step_size_bar(POINTS, N, strain)
        own = pd.body_stability(scene)
        for method, predictor, step in methods:
            found = pd.solve(scene, method, predictor=predictor, step=step, smallest_step=step)
            name = method if predictor == "none" else f"{method}, tangent predictor"
            name += "" if step == 1.0 else ", steps of a fifth"
            words = f"{percent(strain)} in one step, {name}"
            case, row = bar_case(scene, found, words, strain, {})
            if (method, predictor, step) == METHODS[0]:
                cases.append(case)
            rows.append(
                {"strain": strain, "homogeneous": own.kind, "its positive": own.positive, "method": name, **row}
            )
    return cases, rows


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `step-bar`."""
    points: tuple[int, ...] = (24, 32, 48, 64, 100, 200, 400, 800, 1600)
    horizons: tuple[int, ...] = (1, 2, 3, 4, 5)
    if quick:
        points, horizons = (64, 100, 200), (2, 3)
    curves = {n: critical(n, points) for n in horizons}
    cases, rows = outcomes(METHODS[:3:2] if quick else METHODS)
    scene = pd.scenes.step_size_bar(POINTS, N, -1e-4)
    diagonal = float(cf.critical_load_1d(1.0, N))
    numbers = {
        "own critical strain, n = 100": -1e-4 * float(pd.body_critical_load(scene, limit=10.0).factor),
        "diagonal": diagonal,
        "exponents": {n: slope(found) for n, found in curves.items()},
        "critical strains": curves,
        "outcomes": rows,
    }
    figure = Figure(figsize=(15.4, 7.2), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(10.2, 5.2))[0]
    title = f"Ends displaced in one step: {POINTS} points, N = {N}, m = 1, Newton's method"
    pd.figures.bars(cases, title, ("u / (strain · L)  [–]", "ε / strain  [–]"), left)
    draw_critical(right, curves, diagonal)
    right.suptitle(f"Critical strain of the bar by its Jacobian{sizes(quick)}", fontsize=11)
    return numbers, figure


def draw_critical(on: SubFigure | Figure, curves: dict[int, list[dict]], diagonal: float) -> None:
    """Draw the critical compression of clamped bars over their free points, exact (dots) and leading order (lines)."""
    axes = on.subplots()
    for n, rows in curves.items():
        free = [r["free"] for r in rows]
        label = f"N = {n}: slope {slope(rows):.2f}".replace("-", "−")
        axes.loglog(free, [-r["strain"] for r in rows], "o", color=SERIES[n - 1], markersize=4, label=label)
        axes.loglog(free, [-r["law"] for r in rows], "-", color=SERIES[n - 1], linewidth=0.9)
    axes.axhline(-diagonal, color=COLOURS["diagonal"], linewidth=1.4)
    end = axes.get_xlim()[1]
    axes.text(end, -diagonal * 1.2, f"diagonal, N = {N}: {percent(diagonal)}", ha="right", fontsize=9)
    for strain in STRAINS[1:]:
        axes.axhline(-strain, color="#888888", linewidth=0.8, linestyle=":")
        axes.text(end, -strain * 1.2, f"strain in the paper: {percent(strain)}", ha="right", fontsize=9)
    axes.xaxis.set_minor_formatter(NullFormatter())  # the minor labels would overlap
    axes.set_xlabel("free points between the clamps  [–]")
    axes.set_ylabel("critical compression of the clamped bar  [–]")
    axes.set_title("dots: exact spectrum; lines: leading order; symbol (n → ∞): 0", fontsize=9)
    axes.legend(frameon=False, fontsize=9, loc="lower left")


# --- what the numbers say of the claims


def step_tension(n: dict) -> Found:
    """Section 5.2."""
    rows = [r for r in n["outcomes"] if r["strain"] == 1.0]
    worst = max(r["distance"] for r in rows)
    good = worst < 1e-6 and all(r["kind"] == "minimum" for r in rows)
    return f"a minimum, found by {len(rows)} methods to {worst:.0e}", judge(good)


def step_size(n: dict) -> Found:
    """Section 5.2."""
    at = {s: next(r for r in n["outcomes"] if r["strain"] == s and r["method"] == "newton") for s in (-1e-4, -1e-3)}
    exact, far = at[-1e-4], at[-1e-3]
    fifth = next(r for r in n["outcomes"] if r["strain"] == -1e-3 and r["method"] == "newton, steps of a fifth")
    ours = (
        f"the homogeneous state itself is a {exact['homogeneous']} (positive eigenvalues: {exact['its positive']} at"
        f" −0.01 %, {far['its positive']} at −0.1 %). Newton finds a {exact['kind']} at −0.01 %, an alternating"
        f" {far['kind']} at −0.1 %, and, in steps of a fifth, a {fifth['kind']}, {fifth['distance']:.0e} from"
        " the homogeneous state"
    )
    return ours, judge(all(r["homogeneous"] == "minimum" for r in at.values()), fifth["distance"] < 1e-6)


def step_region(n: dict) -> Found:
    """Section 5.2."""
    own, slopes = n["own critical strain, n = 100"], n["exponents"]
    words = " and ".join(f"n^{slopes[N]:.1f} (N = {N})".replace("-", "−") for N in (3, 2))
    ours = f"100 points: down to {100 * own:.4f} %; with more points this limit falls as {words}".replace("-", "−")
    return ours, judge(own < 0.9 * n["diagonal"])
