"""Is the load step too large, or is the state a saddle? The clamped bar's critical strain against its points.

The paper's step-size bar (m = 1) fails in compression at −0.1 %, far inside the diagonal's limit (−7.4 % for N = 3).
Its own Jacobian, at the homogeneous state, is indefinite beyond a strain that falls as n⁻² for odd N and n⁻⁶ for even
N; the symbol's limit, 0, is where that goes. The table is what each method finds at the paper's strains.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import COLOURS

jax.config.update("jax_enable_x64", True)
POINTS = (24, 32, 48, 64, 100, 140, 200, 280, 400, 560, 800, 1600, 3200)
PALETTE = {1: COLOURS["local"], 2: COLOURS["diagonal"], 3: "#000000", 4: COLOURS["affine"], 5: COLOURS["material"]}


def critical(N: int) -> list[dict]:
    """Critical strains over n; stops where rounding takes over."""
    rows = []
    for n in POINTS:
        free = n - 4 * N
        if free < 12:
            continue
        guess = float(pd.closed_forms.clamped_bar_critical_strain(free, N))
        if guess > -1e-12:
            break
        scene = pd.scenes.step_size_bar(n, N, guess, clamp=2 * N)
        found = pd.body_critical_load(scene, limit=0.9 / -guess)
        rows.append({"n": n, "free": free, "strain": guess * found.factor, "law": guess, "proved": found.proved})
    return rows


def slope(rows: list[dict]) -> float:
    """Exponent of the free points, fitted over the largest half."""
    half = rows[len(rows) // 2 :]
    return float(np.polyfit(np.log([r["free"] for r in half]), np.log([-r["strain"] for r in half]), 1)[0])


def outcomes() -> list[dict]:
    """What each method finds at the paper's strains, n = 100, N = 3."""
    rows = []
    for strain in (1.0, -1e-4, -1e-3):
        scene = pd.scenes.step_size_bar(100, 3, strain)
        own = pd.body_stability(scene)
        for method, predictor in (
            ("newton", "none"),
            ("newton", "tangent"),
            ("newton_krylov", "none"),
            ("trust_region", "none"),
            ("relaxation", "none"),
        ):
            found = pd.solve(scene, method, predictor=predictor, smallest_step=1.0)
            distance = float(jnp.linalg.norm(found.u - scene.closed_form) / jnp.linalg.norm(scene.closed_form))
            rows.append(
                {
                    "strain": strain,
                    "homogeneous state": own.kind,
                    "its positive eigenvalues": own.positive,
                    "method": method if predictor == "none" else f"{method}, tangent predictor",
                    "converged": found.converged,
                    "found": found.kind,
                    "positive": found.stability.positive,
                    "distance": distance,
                    "iterations": int(found.iterations),
                }
            )
    return rows


def main() -> None:
    curves = {N: critical(N) for N in (1, 2, 3, 4, 5)}
    figure = Figure(figsize=(7.4, 5.2), layout="constrained")
    axes = figure.subplots()
    for N, rows in curves.items():
        free = [r["free"] for r in rows]
        label = f"N = {N}: slope {slope(rows):.2f}"
        axes.loglog(free, [-r["strain"] for r in rows], "o", color=PALETTE[N], markersize=4, label=label)
        axes.loglog(free, [-r["law"] for r in rows], "-", color=PALETTE[N], linewidth=0.9)
    diagonal = -float(pd.closed_forms.critical_load_1d(1.0, 3))
    axes.axhline(diagonal, color=COLOURS["diagonal"], linewidth=1.2)
    axes.text(axes.get_xlim()[1], diagonal * 1.25, "diagonal, N = 3: −7.4 %", ha="right", fontsize=8)
    for strain in (1e-3, 1e-4):
        axes.axhline(strain, color="#888888", linewidth=0.8, linestyle=":")
        axes.text(axes.get_xlim()[1], strain * 1.25, f"the paper's −{100 * strain:g} %", ha="right", fontsize=8)
    axes.set_xlabel("free points between the clamps  [–]")
    axes.set_ylabel("critical compression of the clamped bar  [–]")
    axes.set_title("m = 1, 1D: dots exact spectrum, lines leading-order law, symbol (n → ∞): 0", fontsize=10)
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    write(
        "step_bar",
        {
            "exponents": {N: slope(rows) for N, rows in curves.items()},
            "diagonal, N = 3": -diagonal,
            "critical strains": curves,
            "what each method finds, n = 100, N = 3": outcomes(),
        },
        figure,
    )


if __name__ == "__main__":
    main()
