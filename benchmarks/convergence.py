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

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import COLOURS

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


def main() -> None:
    plates, bars = pd.scenes.manufactured_plate, pd.scenes.singular_bar
    plate_delta = {N: [(N / n, error(plates(n, N))) for n in (20, 40, 80)] for N in (2,)}
    plate_n = {round(1 / delta): [(N, error(plates(round(N / delta), N))) for N in (2, 3, 4)] for delta in (1 / 10,)}
    bar_delta = {N: [(N / n, error(bars(n, N, 1e-3))) for n in (64, 256)] for N in (3,)}
    bar_n = {round(1 / delta): [(N, error(bars(round(N / delta), N, 1e-3))) for N in (1, 2, 4)] for delta in (1 / 32,)}
    figure = Figure(figsize=(10.4, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    palette = ["#000000", COLOURS["diagonal"], COLOURS["local"]]
    for data, mark, name in ((plate_delta, "o-", "plate"), (bar_delta, "s--", "singular bar")):
        for (N, rows), colour in zip(data.items(), palette, strict=False):
            x, y = zip(*rows, strict=True)
            left.loglog(x, y, mark, color=colour, markersize=3, label=f"{name}, N = {N}: order {orders(x, y):.2f}")
    for data, mark, name in ((plate_n, "o-", "plate"), (bar_n, "s--", "singular bar")):
        for (inverse, rows), colour in zip(data.items(), palette, strict=False):
            x, y = zip(*rows, strict=True)
            right.loglog(x, y, mark, color=colour, markersize=3, label=f"{name}, δ = L/{inverse}")
    left.set_xlabel("horizon δ/L at fixed N  [–]")
    right.set_xlabel("N = δ/h at fixed δ  [–]")
    left.set_title("δ-convergence", fontsize=10)
    right.set_title("N-convergence", fontsize=10)
    for axes in (left, right):
        axes.set_ylabel("error from the local solution  [–]")
        axes.legend(frameon=False, fontsize=7)
    numbers = {"plate, delta": plate_delta, "plate, N": plate_n, "bar, delta": bar_delta, "bar, N": bar_n}
    rates = {
        f"{k}, N = {N}": orders(*zip(*v, strict=True))
        for k in ("plate, delta", "bar, delta")
        for N, v in numbers[k].items()
    }
    write("convergence", {"orders": rates, **numbers}, figure)


if __name__ == "__main__":
    main()
