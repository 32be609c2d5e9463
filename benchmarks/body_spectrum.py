"""Spectrum of a finite body compared with the symbol of the infinite lattice, and the cost of its largest eigenvalue.

The *symbol* is the Fourier transform of the Jacobian of the infinite lattice. The eigenvalues of a clamped bar are
compared with those of the symbol over the whole Brillouin zone (m = 1, N = 3, compressed by 1 %).

* Left panel: share of the eigenvalues below λ, for bars of n points and for the symbol.
* Middle panel: difference between the symbol's supremum and the largest eigenvalue of the bar, and the largest
  difference of the shares (Kolmogorov distance), against n.
* Right panel: time to compute the largest eigenvalue of clamped 2D plates, by method.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import COLOURS

jax.config.update("jax_enable_x64", True)
STRAIN = -0.01
MODEL = pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))


def main() -> None:
    family = pd.lattice_family(1, 3)
    k = jnp.linspace(0, jnp.pi, 20001)[:, None]
    symbol = np.sort(np.asarray(pd.symbol(MODEL, family, (1 + STRAIN) * jnp.eye(1), k))[:, 0, 0])
    top = float(symbol[-1])
    figure = Figure(figsize=(13.5, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    share = np.linspace(0, 1, len(symbol))
    left.plot(symbol, share, color="#000000", linewidth=2, label="symbol, n → ∞")
    gaps = []
    for n, colour in ((24, COLOURS["diagonal"]), (48, COLOURS["block"]), (200, COLOURS["local"])):
        scene = pd.scenes.step_size_bar(n, 3, STRAIN)
        values = np.sort(pd.body_spectrum(scene)[0]) / n**2
        left.step(
            values, (np.arange(len(values)) + 0.5) / len(values), where="mid", color=colour, label=f"bar, n = {n}"
        )
    left.axvline(0, color="#888888", linewidth=0.8)
    left.set_xlabel("eigenvalue λ h² / κ  [–]")
    left.set_ylabel("share of eigenvalues below λ  [–]")
    left.legend(frameon=False, fontsize=8)
    for n in (24, 36, 48, 72, 100, 200, 400, 800, 1400):
        values, _, about = pd.body_spectrum(pd.scenes.step_size_bar(n, 3, STRAIN))
        cdf = np.interp(np.sort(values) / n**2, symbol, share)
        kolmogorov = float(np.abs(cdf - (np.arange(len(values)) + 0.5) / len(values)).max())
        gaps.append({"n": n, "top gap": top - float(values[0]) / n**2, "largest gap of shares": kolmogorov,
                     "residual / norm": float(about["residuals"].max() / about["norm"])})  # fmt: skip
    n = np.array([g["n"] for g in gaps])
    for key, colour in (("top gap", "#000000"), ("largest gap of shares", COLOURS["local"])):
        y = np.array([g[key] for g in gaps])
        rate = np.polyfit(np.log(n[3:]), np.log(y[3:]), 1)[0]
        middle.loglog(n, y, "o-", color=colour, markersize=3, label=f"{key}: slope {rate:.2f}")
    middle.set_xlabel("points n  [–]")
    middle.set_ylabel("distance from the symbol  [–]")
    middle.legend(frameon=False, fontsize=8)
    law = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    rows = []
    for side in (18, 24, 36, 60, 90):
        scene = pd.scenes.clamped_plate((side, side), 2, (1 + STRAIN) * jnp.eye(2), law)
        for method in ("dense", "sparse", "matrix_free"):
            if (method == "dense" and side > 36) or (method == "matrix_free" and side > 60):
                continue
            pd.body_stability(scene, method=method)
            start = time.perf_counter()
            found = pd.body_stability(scene, method=method)
            rows.append({"method": method, "unknowns": len(scene.unknowns), "seconds": time.perf_counter() - start,
                         "eigenvalue": found.eigenvalue, "positive": found.positive,
                         "residual / norm": found.residual / found.norm,
                         "factorisations": found.factorisations})  # fmt: skip
    for method, colour in (("dense", "#000000"), ("sparse", COLOURS["local"]), ("matrix_free", COLOURS["diagonal"])):
        mine = [r for r in rows if r["method"] == method]
        name = method.replace("_", "-")
        right.loglog([r["unknowns"] for r in mine], [r["seconds"] for r in mine], "o-", color=colour, label=name)
    right.set_xlabel("unknowns, 2D, N = 2, unstable plate  [–]")
    right.set_ylabel("time for the largest eigenvalue  [s]")
    right.legend(frameon=False, fontsize=8)
    figure.suptitle("From the body to the symbol: m = 1, compressed by 1 %", fontsize=11)
    write("body_spectrum", {"symbol's supremum": top, "bars": gaps, "plates": rows}, figure)


if __name__ == "__main__":
    main()
