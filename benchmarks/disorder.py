"""Verdicts of the atlas on disordered and on damaged lattices.

**Disorder** (2D): a periodic cell has 3 × 3 points and a horizon of 2 mean spacings. The points are either jittered at
random (equal volumes, several seeds) or graded (spacings from 0.8 to 1.2, volumes to match). The cell is tested at rest
and at ±2 % hydrostatic strain, after Newton's method has brought it to equilibrium. The verdict comes from the symbol
of the cell on a grid of its Brillouin zone.

**Damage** (2D, 11 × 11 points): all bonds that cross a line are broken. The block ∂f_i/∂x_i of a point i at the line is
compared with that of the intact body, at rest and at ±2 %. The result is λ_max / (4M/h²), where λ_max is the largest
eigenvalue of the block and M the P-wave modulus. A positive value means unstable.
"""

import argparse

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)
MODELS = [
    "LPS",
    "Silling",
    "Silling + penalty",
    "Silling + Wan",
    "Seth–Hill 1",
    "Seth–Hill 0",
    "Seth–Hill 1 + penalty",
    "Seth–Hill 0 + Wan",
    "bond-level",
    "bond-level, two-sided",
    "bond-associated",
    "sub-horizon",
    "reproducing kernel 2",
]
STRAINS = (0.0, -0.02, 0.02)


def cells(jitters, seeds):
    """Yield (name, body) of the regular, the graded and the jittered cells."""
    X = np.asarray(pd.lattice((3, 3)).positions)
    grade = np.cumsum([0.8, 1.0, 1.2]) - np.array([0.4, 0.5, 0.6])
    yield "lattice", pd.cloud(X, 1.0, period=(3, 3))
    G = np.stack([grade[np.floor(X[:, 0]).astype(int)], X[:, 1]], axis=1)
    yield "graded", pd.cloud(G, np.array([0.8, 1.0, 1.2])[np.floor(X[:, 0]).astype(int)], period=(3, 3))
    for jitter in jitters:
        for seed in range(seeds):
            move = jitter * np.random.default_rng(seed).uniform(-1, 1, X.shape)
            yield f"jitter {jitter:g}", pd.cloud(X + move, 1.0, period=(3, 3))


def disorder(name: str, horizon: float, jitters, seeds: int, intervals: int) -> list[dict]:
    """Verdict and margin of one model on every cell at every strain, or the message of the error."""
    family = pd.lattice_family(2, horizon)
    model = pd.CATALOGUE[name](LAW, family)
    M = float(pd.p_wave_modulus(model, family))
    rows = []
    for kind, body in cells(jitters, seeds):
        row = {"model": name, "N": horizon, "cell": kind}
        for a in STRAINS:
            try:
                families = pd.cell_families(body, horizon * (1 + 1e-9))
                F = (1 + a) * jnp.eye(2)
                u = pd.relaxed(model, families, F)
                found = pd.cell_stability(model, families, body.period, F, M, u, intervals)
                row[f"{100 * a:+g} %"] = [found.verdict, found.margin]
            except ValueError as error:
                row[f"{100 * a:+g} %"] = ["refused", str(error)[:90]]
        rows.append(row)
    return rows


def damage(name: str, N: float) -> dict:
    """λ_max / (4M/h²) of the block of one point, in the intact and in the broken body, at every strain."""
    family = pd.lattice_family(2, N)
    model = pd.CATALOGUE[name](LAW, family)
    families = pd.families(pd.lattice((11, 11)), N)
    X = np.asarray(pd.lattice((11, 11)).positions)
    line = 6.0  # between the rows at 5.5 and 6.5, so that the point (5.5, 5.5) keeps the bonds of one side only
    side = X[:, 0] > line
    near = np.asarray(families.neighbours)
    broken = families.with_weight(jnp.asarray(np.where(side[near] == side[:, None], 1.0, 0.0)))
    point = int(np.argmin(np.linalg.norm(X - 5.5, axis=1)))
    unit = float(pd.p_wave_modulus(model, family)) * 4
    row: dict = {"model": name, "N": N}
    for a in STRAINS:
        for label, body in (("intact", families), ("broken", broken)):
            try:
                J = pd.jacobian(model, body, a * X).tocsr()
                block = J[2 * point : 2 * point + 2, 2 * point : 2 * point + 2].toarray()
                row[f"{label} {100 * a:+g} %"] = float(np.linalg.eigvals(block).real.max()) / unit
            except ValueError as error:
                row[f"{label} {100 * a:+g} %"] = str(error)[:90]
    return row


def draw(numbers: dict) -> Figure:
    """Draw the margins of every cell: one row for each model, one panel for each load."""
    rows = numbers["cells"]
    names = list(dict.fromkeys(r["model"] for r in rows))
    figure = Figure(figsize=(9.2, 0.34 * len(names) + 1.6), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    kinds = list(dict.fromkeys(r["cell"] for r in rows))
    for ax, a in zip(axes, STRAINS, strict=True):
        for i, kind in enumerate(kinds):
            for row in rows:
                verdict, margin = row[f"{100 * a:+g} %"]
                if row["cell"] == kind and verdict != "refused":
                    y = names.index(row["model"]) + 0.13 * (i - (len(kinds) - 1) / 2)
                    ax.plot([margin], [y], "o", ms=3.6, mfc="none", color=SERIES[i])
        ax.axvline(0, color="black", lw=0.8)
        ax.set_xscale("symlog", linthresh=1e-3, linscale=0.5)
        ax.set_xlim(-1, 10)  # large margins say little: an unstable optical branch is divided by a small κ²
        ax.set_xticks([-0.1, 0, 0.1], ["−0.1", "0", "0.1"])
        ax.set_title("at rest" if a == 0 else f"hydrostatic {100 * a:+g} %".replace("-", "−"), fontsize=9)
        ax.set_xlabel("margin  [–]   (above 0: unstable)", fontsize=9)
    axes[0].set_yticks(range(len(names)), names, fontsize=8)
    axes[0].set_ylim(len(names) - 0.4, -0.6)
    for i, kind in enumerate(kinds):
        label = kind.replace("lattice", "regular lattice")
        label += " spacings" if kind.startswith("jitter") else ""
        axes[0].plot([], [], "o", mfc="none", color=SERIES[i], label=label)
    figure.suptitle("Periodic cells of 3 × 3 points, 2D, N = 2, λ = μ = 1: margin of the symbol", fontsize=10)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="run two models with one seed")
    quick = parser.parse_args().quick
    names = ["Silling", "Seth–Hill 1"] if quick else MODELS
    jitters, seeds = ((0.1,), 1) if quick else ((0.02, 0.1, 0.2), 4)
    rows, blocks = [], []
    for name in names:
        rows += disorder(name, 2.0, jitters, seeds, 4 if quick else 6)
        blocks.append(damage(name, 2.0))
        print(name, flush=True)
    numbers = {"cells": rows, "blocks": blocks}
    write("disorder-quick" if quick else "disorder", numbers, draw(numbers))


if __name__ == "__main__":
    main()
