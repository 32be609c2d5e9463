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
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
STRAIN = -0.01
MODEL = pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))


def symbol() -> np.ndarray:
    """Eigenvalues of the symbol over the Brillouin zone, λ h² / M [–], in ascending order."""
    k = jnp.linspace(0, jnp.pi, 20001)[:, None]
    values = pd.symbol(MODEL, pd.lattice_family(1, 3), (1 + STRAIN) * jnp.eye(1), k)
    return np.sort(np.asarray(values)[:, 0, 0])


def bars() -> list[dict]:
    """Distances of the spectrum of clamped bars from the symbol's."""
    known, rows = symbol(), []
    for n in (24, 36, 48, 72, 100, 200, 400, 800, 1400):
        values, _, about = pd.body_spectrum(pd.scenes.step_size_bar(n, 3, STRAIN))
        cdf = np.interp(np.sort(values) / n**2, known, np.linspace(0, 1, len(known)))
        kolmogorov = float(np.abs(cdf - (np.arange(len(values)) + 0.5) / len(values)).max())
        rows.append({"n": n, "top gap": float(known[-1]) - float(values[0]) / n**2, "largest gap of shares": kolmogorov,
                     "residual / norm": float(about["residuals"].max() / about["norm"])})  # fmt: skip
    return rows


def plates() -> list[dict]:
    """Seconds to compute the largest eigenvalue of clamped plates, by method."""
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
    return rows


def draw(numbers: dict) -> Figure:
    """Draw the three panels. The spectra of the left one are computed here, which takes a few seconds."""
    figure = Figure(figsize=(13.5, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    known = symbol()
    left.plot(known, np.linspace(0, 1, len(known)), color="#000000", linewidth=2, label="symbol, n → ∞")
    for n, colour in zip((24, 48, 200), SERIES, strict=False):
        values = np.sort(pd.body_spectrum(pd.scenes.step_size_bar(n, 3, STRAIN))[0]) / n**2
        shares = (np.arange(len(values)) + 0.5) / len(values)
        left.step(values, shares, where="mid", color=colour, label=f"bar, n = {n}")
    left.axvline(0, color="#888888", linewidth=0.8)
    left.set_xlabel("eigenvalue λ h² / M  [–]   (above 0: unstable)")
    left.set_ylabel("share of eigenvalues below λ  [–]")
    left.set_title("spectrum of a clamped bar", fontsize=10)
    left.legend(frameon=False, fontsize=8)
    n = np.array([row["n"] for row in numbers["bars"]])
    names = {"top gap": "largest eigenvalue", "largest gap of shares": "shares, largest difference"}
    for (key, name), colour in zip(names.items(), SERIES, strict=False):
        y = np.array([row[key] for row in numbers["bars"]])
        rate = np.polyfit(np.log(n[3:]), np.log(y[3:]), 1)[0]
        label = f"{name}: slope {rate:.2f}".replace("-", "−")
        middle.loglog(n, y, "o-", color=colour, markersize=3, label=label)
    middle.set_xlabel("points n  [–]")
    middle.set_ylabel("difference from the symbol  [–]")
    middle.set_title("clamped bars", fontsize=10)
    middle.legend(frameon=False, fontsize=8)
    for method, colour in zip(("dense", "sparse", "matrix_free"), SERIES, strict=False):
        mine = [row for row in numbers["plates"] if row["method"] == method]
        x, y = [row["unknowns"] for row in mine], [row["seconds"] for row in mine]
        right.loglog(x, y, "o-", color=colour, markersize=4, label=method.replace("_", "-"))
    right.set_xlabel("unknowns  [–]")
    right.set_ylabel("time for the largest eigenvalue  [s]")
    right.set_title("clamped plates, 2D, N = 2", fontsize=10)
    right.legend(frameon=False, fontsize=8)
    figure.suptitle("Spectrum of finite bodies and of the infinite lattice: m = 1, compressed by 1 %", fontsize=11)
    return figure


def main() -> None:
    numbers = {"symbol's supremum": float(symbol()[-1]), "bars": bars(), "plates": plates()}
    write("body_spectrum", numbers, draw(numbers))


if __name__ == "__main__":
    main()
