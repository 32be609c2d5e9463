"""Quasi-static cracks beside fracture mechanics: a cracked plate and the handbook, a double cantilever and beams.

Part 1 pulls a plate with a crack in its middle (`pd.scenes.cracked_plate`). The load factor is K/√(E'G_c). It gives the
load factor of the first break, and the largest one at which the body finds an equilibrium. Beyond it the crack runs.

Part 2 opens a double cantilever (`pd.scenes.double_cantilever`), where only bonds across the plane may break. It gives
the force at the first break and while the crack grows, over the force of beam theory. The effective fracture energy
follows from the force, (P/P_theory)^(4/3). A second route to it is the energy budget: the energy that is released and
dissipated per new area. The new area follows from the compliance, a + χH = (Δ E'H³/(8P))^(1/3).

Both are in plane stress with E = 1, ν = ⅓, G_c = 1e-6, for LPS and BondBased. The criteria are a critical stretch from
the closed form and from the lattice, and a critical bond energy.
"""

import argparse
import time

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
G = 1e-6
NAMES = ("LPS", "bond-based")
CRITERIA = ("stretch", "stretch, lattice", "energy")
PLATES = [(name, kind, 20, 3, 0.01) for name in NAMES for kind in CRITERIA] + [  # model, criterion, n, N, load step
    (name, "stretch", n, N, step) for n, N, step in ((30, 3, 0.01), (40, 3, 0.01), (26, 4, 0.02)) for name in NAMES
]
CANTILEVERS = (
    [(name, kind, 8, 3) for name in NAMES for kind in CRITERIA]
    + [  # model, criterion, n, N
        *((name, "stretch", 12, N) for N in (3, 4) for name in NAMES),
        *(("bond-based", kind, 15, 5) for kind in CRITERIA[:2]),
    ]
)


def model_of(name: str, delta: float) -> pd.AbstractModel:
    """The model of E = 1 and ν = ⅓ in plane stress."""
    if name == "LPS":
        return pd.LPS.from_young(1.0, 1 / 3, 2, "stress")
    return pd.BondBased.from_young(1.0, 1 / 3, delta, 2, "stress")


def criterion_of(kind: str, model: pd.AbstractModel, n: int, N: float, no_fail=None):
    """The criterion of the fracture energy."""
    family = pd.lattice_family(2, N, 1 / n)
    if kind == "energy":
        return pd.CriticalBondEnergy(pd.CriticalBondEnergy.from_fracture_energy(G, family).energy, no_fail=no_fail)
    calibrate = "lattice" if kind == "stretch, lattice" else "closed form"
    return pd.CriticalStretch.from_fracture_energy(G, model, family, calibrate=calibrate, no_fail=no_fail)


def plate(name: str, kind: str, n: int, N: float, step: float) -> dict:
    """One row of part 1."""
    model = model_of(name, N / n)
    scene, _ = pd.scenes.cracked_plate(n, N, model=model, fracture_energy=G)
    criterion = criterion_of(kind, model, n, N)
    start = time.perf_counter()
    path = pd.solve_breaking(scene, criterion, load_steps=np.arange(0.7, 1.6, step), show_progress=False)
    row = {
        "model": name,
        "criterion": kind,
        "n": n,
        "N": N,
        "δ/a": 4 * N / n,
        "first break": float(path.broken_at.min()),
        "largest": float(path.load_factors[path.settled][-1]),
        "step": step,
        "ending": path.ending.name,
        "energy error": float(np.abs(path.energies.error).max()),
        "seconds": time.perf_counter() - start,
    }
    print(*(f"{x:.4g}" if isinstance(x, float) else x for x in row.values()), flush=True)
    return row


def cantilever(name: str, kind: str, n: int, N: float) -> dict:
    """One row of part 2, with its load curve."""
    model = model_of(name, N / n)
    scene, expected = pd.scenes.double_cantilever(n, N, 2.5, 6.5, G, model)
    criterion = criterion_of(kind, model, n, N, expected.arms)
    start = time.perf_counter()
    steps = np.concatenate([np.arange(0.24, 0.32, 0.005), np.arange(0.34, 0.57, 0.02)])
    path = pd.solve_breaking(scene, criterion, load_steps=steps, show_progress=False)
    opening, force = path.load_factors * expected.opening, path.reactions[:, expected.upper, 1].sum(axis=1)
    ratio = force[1:] / expected.force(opening[1:])
    ratio = np.concatenate([[ratio[0]], ratio])
    first = int(np.argmax(path.load_factors >= path.broken_at.min()))
    late = np.flatnonzero(path.load_factors > 0.4)
    arm = np.cbrt(opening[late] / (8 * np.maximum(force[late], 1e-300)))
    spent = path.energies.released + path.energies.dissipated
    area = arm[-1] - arm[0]
    row = {
        "model": name,
        "criterion": kind,
        "n": n,
        "N": N,
        "δ/H": N / n,
        "stiffness": float(ratio[0]),
        "force at the first break": float(ratio[first]),
        "force while growing": float(ratio[late].mean()),
        "G from the force": float(ratio[late].mean() ** (4 / 3)),
        "G from the energies": float((spent[late[-1]] - spent[late[0]]) / area / G),
        "released": float((path.energies.released[late[-1]] - path.energies.released[late[0]]) / area / G),
        "energy error": float(np.abs(path.energies.error).max()),
        "seconds": time.perf_counter() - start,
    }
    print(*(f"{x:.4g}" if isinstance(x, float) else x for x in row.values()), flush=True)
    return row | {
        "opening": (opening / expected.opening_at_onset()).tolist(),
        "force": (force / expected.force(expected.opening_at_onset())).tolist(),
    }


def draw(numbers: dict) -> Figure:
    """Draw the load factors of the plate over the horizon, and the load curves of the cantilever."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    rows = [row for row in numbers["plate"] if row["criterion"] == "stretch"]
    for k, name in enumerate(NAMES):
        for what, marker in (("first break", "o"), ("largest", "^")):
            for N, fill in ((3, SERIES[k]), (4, "white")):
                mine = sorted((row["δ/a"], row[what]) for row in rows if row["model"] == name and row["N"] == N)
                if mine:
                    left.plot(
                        *zip(*mine, strict=True),
                        marker=marker,
                        linestyle="-" if N == 3 else "none",
                        color=SERIES[k],
                        markerfacecolor=fill,
                        markersize=6,
                        label=f"{name}, {what}, N = {N}",
                    )
    left.axhline(1, color="black", linewidth=0.8)
    left.set_xlabel("horizon over half the crack, δ/a [-]")
    left.set_ylabel("stress intensity over √(E'G_c) [-]")
    left.set_title("cracked plate (critical stretch)", fontsize=10)
    left.legend(fontsize=7, frameon=False)
    chosen = [row for row in numbers["cantilever"] if row["criterion"] == "stretch"]
    for k, row in enumerate(chosen):
        label = f"{row['model']}, H/h = {row['n']}, N = {row['N']}"
        right.plot(row["opening"], row["force"], color=SERIES[k % len(SERIES)], linewidth=1.1, label=label)
    at = np.linspace(0, 2.25, 200)
    right.plot(at, np.minimum(at, 1 / np.sqrt(np.maximum(at, 1))), "k--", linewidth=1, label="beam theory, χ = 0.673")
    right.set_xlabel("opening over that of the onset [-]")
    right.set_ylabel("force over that of the onset [-]")
    right.set_title("double cantilever (critical stretch)", fontsize=10)
    right.legend(fontsize=7, frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the coarsest grids only")
    quick = parser.parse_args().quick
    strips = [cantilever(*row) for row in CANTILEVERS[: 1 if quick else None]]
    plates = [plate(*row) for row in PLATES[: 1 if quick else None]]
    numbers = {"fracture energy": G, "plate": plates, "cantilever": strips}
    write("fracture_statics-quick" if quick else "fracture_statics", numbers, draw(numbers))


if __name__ == "__main__":
    main()
