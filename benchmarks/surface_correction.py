"""Surface corrections of a pulled plate and a pulled bar: the strain in the middle and at the sides.

Each body is pulled at both ends with the stress that stretches an infinite lattice by ε, and has free sides. Without
errors of the surfaces the axial strain in the middle is ε, and the transverse strain is that of the lattice. The scene
is `pd.scenes.pulled_plate`. The cases are LPS in plane stress for three of Poisson's ratios ν and the bond-based model,
plates of 10 × 30 and 20 × 60 points and a bar of 7 × 7 × 24 points, and seven treatments of the surface.
"""

import argparse
import functools

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
N = 3.015
STRAIN = 1e-6
correct = pd.surface_correction
TREATMENTS = {
    "none": {},
    "volume": {"correction": "volume"},
    "energy, 1 pass": {"correction": functools.partial(correct, passes=1)},
    "energy, 3 passes": {"correction": functools.partial(correct, passes=3)},
    "energy, 5 passes": {"correction": functools.partial(correct, passes=5)},
    "partial volume": {"influence": "partial volume"},
    "partial volume, energy": {"influence": "partial volume", "correction": "energy"},
}


def models(dim: int) -> dict[str, pd.AbstractModel]:
    """The models by name. E = 1."""
    plane = "stress" if dim == 2 else None
    found = {
        f"LPS ν={nu:g}": pd.LPS.from_young(1.0, nu, dim, plane) for nu in ((0.0, 0.25, 0.4) if dim == 2 else (0.25,))
    }
    return {**found, "bond-based": pd.BondBased(1.0)}


def one(shape: tuple[int, ...], model: pd.AbstractModel, how: dict) -> dict:
    """Errors of the strains of one body."""
    scene = pd.scenes.pulled_plate(shape, N, model, STRAIN, **how)
    found = pd.solve(scene, stability=False)
    X, u, known = scene.body.positions, np.asarray(found.u), np.asarray(scene.closed_form)
    third = np.abs(X[:, 0] - shape[0] / 2) < shape[0] / 6

    def slope(some: np.ndarray, values: np.ndarray, axis: int) -> float:
        return float(np.polyfit(X[some, axis], values[some, axis], 1)[0])

    side = third & (X[:, 1] < 1)
    outer = third & (X[:, 1] < 2)
    true = slope(third, known, 1)
    weights = np.asarray(scene.families.weight)[np.asarray(scene.families.is_bond)]
    return {
        "converged": bool(found.converged),
        "axial strain, middle": slope(third, u, 0) / STRAIN - 1,
        "axial strain, side": slope(side, u, 0) / STRAIN - 1,
        "transverse strain of the outer two rows, over ε": (slope(outer, u, 1) - true) / STRAIN,
        "transverse strain of all rows, over ε": (slope(third, u, 1) - true) / STRAIN,
        "least weight": float(weights.min()),
        "largest weight": float(weights.max()),
    }


def draw(numbers: dict) -> Figure:
    """Draw the errors of the axial strain: one panel for each body, one group of bars for each model."""
    bodies = list(dict.fromkeys(row["shape"] for row in numbers["rows"]))
    figure = Figure(figsize=(4.4 * len(bodies), 4.2), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(bodies), sharey=True))
    for axes, shape in zip(panels, bodies, strict=True):
        rows = [row for row in numbers["rows"] if row["shape"] == shape]
        names = list(dict.fromkeys(row["model"] for row in rows))
        width = 0.8 / len(TREATMENTS)
        for k, treatment in enumerate(TREATMENTS):
            at = [names.index(row["model"]) for row in rows if row["treatment"] == treatment]
            errors = [100 * row["axial strain, middle"] for row in rows if row["treatment"] == treatment]
            axes.bar(np.array(at) + (k + 0.5) * width - 0.4, errors, width, color=SERIES[k], label=treatment)
        axes.axhline(0, color="black", linewidth=0.8)
        axes.set_xticks(range(len(names)), names, fontsize=8)
        axes.set_title(f"{shape} points", fontsize=10)
    panels[0].set_ylabel("error of the axial strain in the middle [%]")
    figure.suptitle(f"Pulled bodies with free sides, horizon {N:g} spacings (negative: too stiff)", fontsize=10)
    handles = panels[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the smallest plate only")
    quick = parser.parse_args().quick
    rows = []
    for shape in [(30, 10)] if quick else [(30, 10), (60, 20), (24, 7, 7)]:
        for name, model in models(len(shape)).items():
            for treatment, how in TREATMENTS.items():
                row = {"shape": " × ".join(map(str, shape)), "model": name, "treatment": treatment}
                rows.append(row | one(shape, model, how))
                print(*row.values(), *(f"{100 * x:+.2f}" for x in list(rows[-1].values())[4:8]), flush=True)
    numbers = {"N": N, "strain": STRAIN, "rows": rows}
    write("surface_correction-quick" if quick else "surface_correction", numbers, draw(numbers))


if __name__ == "__main__":
    main()
