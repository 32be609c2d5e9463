"""Accuracy of the search over the Brillouin zone against its time, with and without local refinement.

The states are random (m, a) of the default map (2D, N = 3). The reference is the refined search at 96 grid intervals.
"grid" takes the best grid point by the closed-form eigenvalue. "refined" is the search that pdjax uses: it starts
damped Newton iterations near the best grid points. Wrong verdicts are counted too. Near the half-reciprocal points the
symbol of Seth–Hill models has flat, narrow valleys, which a grid alone can miss.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.figures import SERIES
from pdjax.infinite_lattice import bloch, criteria
from pdjax.infinite_lattice import brillouin as zone

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)
FAM = pd.lattice_family(2, 3)
STATES = 512


def refined(intervals: int):
    """Compiled function (m, a) → margins by the grid search with local refinement."""
    z = zone.brillouin_zone(2, intervals, "cubic")

    def margin(m, a):
        F = (1 + a) * jnp.eye(2)
        return criteria.evaluate("symbol", pd.SethHill(m, LAW), FAM, F, z).margin

    return jax.jit(jax.vmap(margin))


def grid_only(intervals: int):
    """Compiled function (m, a) → margins at the best grid point."""
    z = zone.brillouin_zone(2, intervals, "cubic")

    def margin(m, a):
        model = pd.SethHill(m, LAW)
        phases = bloch.wave_phases(FAM, jnp.asarray(z.grid))
        top = zone.largest_eigenvalue(bloch.homogeneous_tangent(model, FAM, (1 + a) * jnp.eye(2)).components(phases))
        return jnp.max(top / phases.kappa2) / pd.p_wave_modulus(model, FAM)

    return jax.jit(jax.vmap(margin))


def main() -> None:
    rng = np.random.default_rng(1)
    m, a = jnp.asarray(rng.uniform(-2, 2, STATES)), jnp.asarray(0.3 * rng.uniform(-1, 1, STATES) ** 3)
    exact = np.asarray(refined(96)(m, a))
    rows = []
    for name, make in (("grid", grid_only), ("refined", refined)):
        for intervals in (4, 6, 8, 12, 16, 24, 32, 48, 64):
            kernel = make(intervals)
            error = np.abs(np.asarray(kernel(m, a)) - exact) / np.abs(exact)
            wrong = np.mean(np.sign(np.asarray(kernel(m, a))) != np.sign(exact))
            rows.append(
                {
                    "search": name,
                    "intervals": intervals,
                    "microseconds per state": 1e6 * timed(lambda k=kernel: k(m, a), repeats=9)["fastest"] / STATES,
                    "worst relative error": float(error.max()),
                    "median relative error": float(np.median(error)),
                    "wrong verdicts": float(wrong),
                }
            )
    numbers = {"states": STATES, "rows": rows}
    write("zone_accuracy", numbers, draw(numbers))


def draw(numbers: dict) -> Figure:
    """Draw worst and median error over time. Resolutions below 24 lie too close together to be labelled."""
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    labels = {"grid": "best grid point", "refined": "with local refinement"}
    for name, colour, place in (("grid", SERIES[2], (0, 6)), ("refined", SERIES[0], (0, -11))):
        mine = [r for r in numbers["rows"] if r["search"] == name]
        for key, style in (("worst relative error", "o-"), ("median relative error", "o:")):
            x = [r["microseconds per state"] for r in mine]
            y = [max(r[key], 1e-16) for r in mine]
            axes.loglog(x, y, style, color=colour, label=f"{labels[name]}: {key.split()[0]} error", markersize=4)
            if key.startswith("worst"):
                for r, px, py in zip(mine, x, y, strict=True):
                    if r["intervals"] < 24:
                        continue
                    axes.annotate(
                        str(r["intervals"]), (px, py), textcoords="offset points", xytext=place, fontsize=7, ha="center"
                    )
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("time for one state (m, a)  [µs], fastest of nine runs")
    axes.set_ylabel("relative error of the margin  [–]")
    axes.set_title(
        "Search over the Brillouin zone, 2D, N = 3\nnumbers: grid intervals from 0 to π/h (24 is the default)",
        fontsize=10,
    )
    axes.legend(fontsize=8, frameon=False)
    return figure


if __name__ == "__main__":
    main()
