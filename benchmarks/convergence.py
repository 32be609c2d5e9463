"""Convergence of a discretised body to the local solution: δ-convergence and N-convergence.

In δ-convergence the horizon δ tends to 0 at a fixed ratio N = δ/h. In N-convergence the spacing h tends to 0 at a fixed
horizon. Both are measured on a manufactured plate in 2D, whose smooth local solution is known, and on the singular bar
in tension. At fixed δ the error stops falling at the distance between the nonlocal and the local solution. For δ → 0
the error continues to fall.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)


def error(scene) -> float:
    """Root mean square error over the free points, relative to the largest fluctuation of the exact solution."""
    found = pd.solve(scene, predictor="tangent", stability=False)
    assert found.converged, found
    wanted = scene.closed_form - jnp.asarray(0.05) * scene.body.positions if scene.body.dim == 2 else scene.closed_form
    difference = (found.u - scene.closed_form).reshape(-1)[scene.unknowns]
    return float(jnp.sqrt(jnp.mean(difference**2)) / jnp.abs(wanted).max())


def orders(x, y) -> float:
    """Order of convergence: the slope of log y over log x."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def draw(numbers: dict) -> Figure:
    """Draw the error over the horizon at fixed N (left) and over N at a fixed horizon (right)."""
    figure = Figure(figsize=(10.4, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for kind, style, name, colour in (("plate", "o-", "plate", SERIES[0]), ("bar", "s--", "singular bar", SERIES[2])):
        how = {"color": colour, "markersize": 4}
        for N, rows in numbers[f"{kind}, delta"].items():
            x, y = zip(*rows, strict=True)
            left.loglog(x, y, style, label=f"{name}, N = {N}: order {orders(x, y):.2f}", **how)
        for inverse, rows in numbers[f"{kind}, N"].items():
            right.loglog(*zip(*rows, strict=True), style, label=f"{name}, δ = L/{inverse}", **how)
    left.set_xlabel("horizon δ/L  [–]")
    right.set_xlabel("horizon over spacing N = δ/h  [–]")
    left.set_title("δ-convergence: the horizon decreases at fixed N", fontsize=10)
    right.set_title("N-convergence: the spacing decreases at fixed horizon", fontsize=10)
    for axes, x, y in ((left, (0.01, 0.02, 0.05, 0.1), (0.002, 0.005, 0.01, 0.02, 0.05)),
                       (right, (1, 2, 3, 4), (0.02, 0.03, 0.04, 0.05, 0.06))):  # fmt: skip
        axes.set_xticks(x, [f"{value:g}" for value in x])
        axes.set_yticks(y, [f"{value:g}" for value in y])
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_ylabel("error from the local solution, relative  [–]")
        axes.legend(frameon=False, fontsize=8)
    return figure


def main() -> None:
    plates, bars = pd.scenes.manufactured_plate, pd.scenes.singular_bar
    numbers = {
        "plate, delta": {N: [(N / n, error(plates(n, N))) for n in (20, 40, 80)] for N in (2,)},
        "plate, N": {n: [(N, error(plates(N * n, N))) for N in (2, 3, 4)] for n in (10,)},
        "bar, delta": {N: [(N / n, error(bars(n, N, 1e-3))) for n in (64, 256)] for N in (3,)},
        "bar, N": {n: [(N, error(bars(N * n, N, 1e-3))) for N in (1, 2, 4)] for n in (32,)},
    }
    rates = {
        f"{k}, N = {N}": orders(*zip(*v, strict=True))
        for k in ("plate, delta", "bar, delta")
        for N, v in numbers[k].items()
    }
    write("convergence", {"orders": rates, **numbers}, draw(numbers))


if __name__ == "__main__":
    main()
