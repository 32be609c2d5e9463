"""Fracture energy of a lattice: the energy that a plane of breaking bonds releases, beside that of a full ball.

Part 1 is exact arithmetic over the bonds of one family. For each N = δ/h and each direction of the plane it gives the
error of the sums over the crossing bonds: B, on which the fracture energy of BondBased depends, and the fracture energy
of LPS for three of Poisson's ratios, in the state "crossing" (`pdjax.finite_body.damage.fracture_energy`).

Part 2 cuts blocks. They are under hydrostatic tension, periodic along the cut, and the released energy is the drop of
the strain energy. It stands beside the sum per area, for BondBased and LPS with the reference sums of the intact
family, and for LPS and correspondence models whose reference sums are those of the remaining bonds.
"""

import argparse

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
RATIOS = (2, 3, 3.015, 4, 5, 6)
NORMALS = {2: [(1, 0), (1, 1), (1, 2), (1, 3)], 3: [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 2, 0), (1, 2, 3)]}
POISSON = (0.1, 0.25, 0.4)
STRAIN = 1e-3


def models(dim: int, N: float) -> dict[str, pd.AbstractModel]:
    """The models by name, E = 1 and δ = N, in 2D in plane strain."""
    plane = "strain" if dim == 2 else None
    springs = pd.BondBased.from_young(1.0, 0.25, N, dim, plane)
    return {"bond-based": springs} | {f"LPS ν={nu:g}": pd.LPS.from_young(1.0, nu, dim, plane) for nu in POISSON}


def lattice_errors() -> list[dict]:
    """The error of the fracture energy of every plane, relative to the closed form."""
    rows = []
    for dim, normals in NORMALS.items():
        for N in RATIOS:
            family = pd.lattice_family(dim, N)
            for name, model in models(dim, N).items():
                criterion = pd.CriticalStretch.from_fracture_energy(1.0, model, family)
                errors = {str(n): float(criterion.fracture_energy(model, family, n)) - 1 for n in normals}
                rows.append({"dim": dim, "N": N, "model": name, "critical stretch": float(criterion.stretch), **errors})
                print(dim, N, f"{name:12s}", *(f"{k} {100 * x:+.1f} %" for k, x in errors.items()), flush=True)
    return rows


def block(model: pd.AbstractModel, shape: tuple[int, ...], N: float) -> dict:
    """Energy per area that a cut across the first axis releases at a uniform expansion, in three ways."""
    dim = len(shape)
    body = pd.lattice(shape, periodic=(False, *[True] * (dim - 1)))
    families, u, F = pd.families(body, N), np.zeros((len(body), dim)), (1 + STRAIN) * np.eye(dim)
    parts = pd.cut(families, pd.Plane((shape[0] / 2, *[0.0] * (dim - 1)), np.eye(dim)[0]))
    broken = np.asarray(parts.weight) < np.asarray(families.weight)
    area = float(np.prod(shape[1:]))
    removed = pd.strain_energy(model, families, u, F) - pd.strain_energy(model, parts, u, F)
    row = {
        "released": float(pd.released_energy(model, families, u, broken, F)) / area / STRAIN**2,
        "released, remaining sums": float(removed) / area / STRAIN**2,
    }
    if model.keeps_reference:
        one = pd.CriticalStretch(1.0)
        row["sum per area"] = float(one.fracture_energy(model, families, np.eye(dim)[0], state="uniform"))
    return row


def blocks(quick: bool) -> list[dict]:
    """The blocks of part 2."""
    rows = []
    for shape, N in [((16, 7), 3.015)] if quick else [((16, 7), 3.015), ((26, 13), 6.0), ((14, 7, 8), 3.015)]:
        law = pd.LinearElastic(0.4, 0.4)  # E = 1 and ν = ¼
        for name, model in {**models(len(shape), N), "Silling": pd.Correspondence(law)}.items():
            rows.append({"shape": " × ".join(map(str, shape)), "N": N, "model": name} | block(model, shape, N))
            print(*(f"{x:.6g}" if isinstance(x, float) else x for x in rows[-1].values()), flush=True)
    return rows


def draw(numbers: dict) -> Figure:
    """Draw the errors of the lattice over N: one panel for each dimension, one colour for each plane."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, dim in zip(figure.subplots(1, 2, sharey=True), NORMALS, strict=True):
        for k, normal in enumerate(NORMALS[dim]):
            for name, style in (("bond-based", "o-"), ("LPS ν=0.4", "s:")):
                rows = [row for row in numbers["lattice"] if row["dim"] == dim and row["model"] == name]
                errors = [100 * row[str(normal)] for row in rows]
                label = f"{normal}" if name == "bond-based" else None
                axes.plot([row["N"] for row in rows], errors, style, color=SERIES[k], markersize=4, label=label)
        axes.axhline(0, color="black", linewidth=0.8)
        axes.set_title(f"{dim}D (circles: bond-based, squares: LPS, ν = 0.4)", fontsize=10)
        axes.set_xlabel("horizon over spacing N [-]")
        axes.legend(title="normal of the plane", fontsize=8, title_fontsize=8, frameon=False)
    figure.axes[0].set_ylabel("error of the fracture energy [%]")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the smallest block only")
    quick = parser.parse_args().quick
    numbers = {"strain": STRAIN, "lattice": lattice_errors(), "blocks": blocks(quick)}
    write("fracture_energy-quick" if quick else "fracture_energy", numbers, draw(numbers))


if __name__ == "__main__":
    main()
