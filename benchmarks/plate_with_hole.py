"""A plate with a hole under tension, on meshes of Gmsh: the stress concentration against the number of points.

The plate is square, W = 1, with a central hole of diameter d = W/5, in plane stress. Both ends are pulled with the mean
stress σ, by a body force over a layer of three spacings. Gmsh makes meshes of 31, 61 and 121 cells across the plate.
Every cell becomes a point. The stress concentration is the largest σ_xx of all points divided by σ (gross). References:
3 for an infinite plate (Kirsch 1898), and (2 + (1 − d/W)³)/(1 − d/W) = 3.14 for a strip of this width (Heywood 1952).

The stress of a point is that of its cell's centroid, half a cell beside the edge of the hole. Kirsch's stress falls
there by 7/3 of its value over one radius, so a coarse mesh has too small a largest value. The audit of every solution
is recorded.
"""

import argparse
import math
import resource
import time
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
W, RADIUS, YOUNG, NU, STRESS, N = 1.0, 0.1, 1.0, 0.3, 1e-4, 3.015
KIRSCH, HEYWOOD = 3.0, (2 + (1 - 2 * RADIUS / W) ** 3) / (1 - 2 * RADIUS / W)
MESHES = Path(__file__).parents[1] / "notebooks"


def mesh(file: Path, across: int, quadrilaterals: bool = True) -> None:
    """Write the mesh of Gmsh with `across` cells across the plate, and its sides and the hole as physical groups."""
    import gmsh

    gmsh.initialize()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        square, disk = (2, occ.addRectangle(0, 0, 0, W, W)), (2, occ.addDisk(W / 2, W / 2, 0, RADIUS, RADIUS))
        ((_, surface),) = occ.cut([square], [disk])[0]
        occ.synchronize()
        groups: dict[str, list[int]] = {}
        for _, curve in gmsh.model.getEntities(1):
            x, y, _ = occ.getCenterOfMass(1, curve)
            sides = {"left": x, "right": W - x, "bottom": y, "top": W - y}
            side = min(sides, key=lambda name, sides=sides: abs(sides[name]))
            groups.setdefault(side if abs(sides[side]) < 1e-6 else "hole", []).append(curve)
        for name, curves in groups.items():
            gmsh.model.addPhysicalGroup(1, curves, name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="plate")
        for bound in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{bound}", W / across)
        gmsh.option.setNumber("Mesh.Algorithm", 8 if quadrilaterals else 6)
        if quadrilaterals:
            gmsh.model.mesh.setRecombine(2, surface)
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.option.setNumber("Mesh.Binary", 1)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()


def models() -> dict[str, pd.AbstractModel]:
    """The models in plane stress, with E = 1 and ν = 0.3."""
    law = pd.LinearElastic(YOUNG * NU / (1 - NU**2), YOUNG / (2 * (1 + NU)))
    return {
        "bond-level": pd.BondLevel(law),
        "Silling + Wan": pd.Correspondence(law, pd.WanControl()),
        "Silling": pd.Correspondence(law),
        "LPS": pd.LPS.from_young(YOUNG, NU, 2, "stress"),
    }


def plate(file: Path, model: pd.AbstractModel) -> tuple[pd.Points, pd.Scene]:
    """The points of a mesh and the pulled plate. Two points on the middle line stop the rigid motions."""
    points, _ = pd.read_points(file)
    h = math.sqrt(np.median(points.volumes))
    families = pd.families(points, N * h)
    x, y = points.positions.T
    middle = abs(x - W / 2) + abs(y - [[W], [0.0]])
    top, bottom = np.argmin(middle, axis=1)
    pulls = [
        pd.total_force(layer, [sign * STRESS * W, 0.0]) for layer, sign in ((x < 3 * h, -1.0), (x > W - 3 * h, 1.0))
    ]
    return points, pd.scene(points, families, model, pd.prescribe([top], 0.0), pd.prescribe([bottom], 0.0, 0), *pulls)


def one(file: Path, name: str, model: pd.AbstractModel) -> dict:
    """Stress concentration, cost and audit of one solution."""
    start = time.perf_counter()
    points, scene = plate(file, model)
    made = time.perf_counter()
    found = pd.solve(scene)
    solved = time.perf_counter()
    stress = np.asarray(pd.cauchy_stress(model, scene.families, found.u))[:, 0, 0] / STRESS
    state = pd.audit(model, scene.families, found.u, held=~scene.free)
    at = points.positions[np.argmax(stress)] - W / 2
    share = np.sort(state.zero_energy)
    row = {
        "model": name,
        "points": len(points),
        "spacing": math.sqrt(np.median(points.volumes)),
        "stress concentration": float(stress.max()),
        "error against 3.14": float(stress.max() / HEYWOOD - 1),
        "at": at.tolist(),
        "distance from the edge over spacing": float((np.hypot(*at) - RADIUS) / math.sqrt(np.median(points.volumes))),
        "kind": found.kind,
        "verdict": state.verdict,
        "findings": [f.check for f in state.findings],
        "zero-energy share, median": float(np.median(share)),
        "zero-energy share, 99 %": float(share[int(0.99 * len(share))]),
        "seconds to read and search": made - start,
        "seconds to solve": solved - made,
        "seconds to audit": time.perf_counter() - solved,
        "peak memory of the process, GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }
    print(row, flush=True)
    return row


def draw(numbers: dict) -> Figure:
    """Stress concentration over the number of points, and the time beside it."""
    rows = numbers["rows"]
    figure = Figure(figsize=(8.4, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    for k, name in enumerate(dict.fromkeys(row["model"] for row in rows)):
        mine = [row for row in rows if row["model"] == name]
        n = [row["points"] for row in mine]
        left.semilogx(n, [row["stress concentration"] for row in mine], "o-", color=SERIES[k], label=name)
        right.loglog(n, [row["seconds to solve"] for row in mine], "o-", color=SERIES[k])
    for value, words, side in ((KIRSCH, "infinite plate (Kirsch)", "top"), (HEYWOOD, "this width (Heywood)", "bottom")):
        left.axhline(value, color="#888888", linewidth=0.8, linestyle="--")
        left.text(0.98, value, words, transform=left.get_yaxis_transform(), va=side, ha="right", fontsize=8)
    left.set(xlabel="points", ylabel="largest σ_xx / σ")
    right.set(xlabel="points", ylabel="time to solve  [s]")
    figure.legend(loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--across", type=int, nargs="+", default=[31, 61, 121], help="cells across the plate")
    parser.add_argument("--folder", type=Path, default=Path("."), help="folder for the meshes")
    arguments = parser.parse_args()
    rows = []
    for across in arguments.across:
        file = arguments.folder / f"plate_with_hole_{across}.msh"
        if not file.exists():
            mesh(file, across)
        rows += [one(file, name, model) for name, model in models().items()]
        numbers = {"kirsch": KIRSCH, "heywood": HEYWOOD, "rows": rows}
        write("plate_with_hole", numbers, draw(numbers))
