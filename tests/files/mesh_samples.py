"""Small files of every format that holds a mesh or a list of files: SAMPLES, name → function(folder) → path.

The files in `samples` were written by Gmsh 4.15.2: a plate of 2 × 1 with the physical curves left and right, and a box
of 2 × 1 × 1.5 with the physical surface left. `assembly.inp` follows the layout of Abaqus/CAE.
"""

import shutil
from functools import partial
from pathlib import Path

import meshio
import numpy as np
from scipy.io import netcdf_file

import pdjax as pd
from pdjax.files.vtk import write_vtk

FOLDER = Path(__file__).parent / "samples"


def _copied(name: str, folder: Path) -> Path:
    return Path(shutil.copy(FOLDER / name, folder / name))


def plate_mesh(second: bool = False) -> meshio.Mesh:
    """Two quadrilaterals and two triangles on [0, 3] × [0, 1], with the two boundary lines at x = 0 and y = 0."""
    points = np.array([[x, y, 0.0] for y in (0, 1) for x in range(4)])
    cells = [
        ("line", [[0, 4], [0, 1]]),
        ("quad", [[0, 1, 5, 4], [1, 2, 6, 5]]),
        ("triangle", [[2, 3, 7], [2, 7, 6]]),
    ]
    data = {"heat": 1 + 2 * points[:, 0], "shift": points * [1, 2, 0], "set:low": (points[:, 1] == 0).astype(np.uint8)}
    strength = [np.zeros(2), np.array([1.0, 2.0]), np.array([3.0, 4.0])]
    return meshio.Mesh(points, cells, point_data=data, cell_data={"strength": strength})


def box_mesh() -> meshio.Mesh:
    """Two distorted hexahedra and a tetrahedron."""
    grid = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)])
    grid[7] += [0.1, -0.1, 0.2]
    points = np.vstack([grid, [[3.0, 0.5, 0.5]]])
    cells = [
        ("hexahedron", [[0, 1, 4, 3, 6, 7, 10, 9], [1, 2, 5, 4, 7, 8, 11, 10]]),
        ("tetra", [[2, 5, 8, 12]]),
    ]
    return meshio.Mesh(points, cells, point_data={"heat": points @ [1.0, 2.0, 3.0]})


def _meshio(write, name: str, folder: Path, **options) -> Path:
    write(folder / name, plate_mesh(), **options)
    return folder / name


def _exodus(folder: Path) -> Path:
    return exodus(folder / "plate.exo")


def exodus(path: Path) -> Path:
    """An Exodus file as Cubit and Peridigm write it: two blocks, sets of nodes and sides, three time steps."""
    mesh = plate_mesh()
    with netcdf_file(path, "w", version=2) as file:
        file.createDimension("time_step", None)
        dims = {"len_name": 33, "num_dim": 2, "num_nodes": 8, "num_elem": 4, "num_el_blk": 2, "num_node_sets": 1}
        dims |= {"num_side_sets": 1, "num_nod_var": 2, "num_elem_var": 1, "num_nod_ns1": 2, "num_side_ss1": 1}
        for name, length in dims.items():
            file.createDimension(name, length)
        file.createVariable("time_whole", "d", ("time_step",))[:3] = [0.0, 0.5, 1.0]
        for axis in range(2):
            file.createVariable(f"coord{'xy'[axis]}", "d", ("num_nodes",))[:] = mesh.points[:, axis]
        for k, (kind, block) in enumerate((("QUAD4", mesh.cells[1].data), ("TRI3", mesh.cells[2].data)), 1):
            file.createDimension(f"num_el_in_blk{k}", len(block))
            file.createDimension(f"num_nod_per_el{k}", block.shape[1])
            table = file.createVariable(f"connect{k}", "i", (f"num_el_in_blk{k}", f"num_nod_per_el{k}"))
            table[:], table.elem_type = block + 1, kind
        words = {"eb_names": ("num_el_blk", ["steel", ""]), "ns_names": ("num_node_sets", ["left"])}
        words |= {"name_nod_var": ("num_nod_var", ["DISPLX", "DISPLY"]), "name_elem_var": ("num_elem_var", ["damage"])}
        for name, (dim, rows) in words.items():
            letters = file.createVariable(name, "c", (dim, "len_name"))
            for k, row in enumerate(rows):
                letters[k] = np.array(list(row.ljust(33, "\0")), "S1")
        file.createVariable("eb_prop1", "i", ("num_el_blk",))[:] = [10, 20]
        file.createVariable("ns_prop1", "i", ("num_node_sets",))[:] = [1]
        file.createVariable("ss_prop1", "i", ("num_side_sets",))[:] = [7]
        file.createVariable("node_ns1", "i", ("num_nod_ns1",))[:] = [1, 5]
        file.createVariable("elem_ss1", "i", ("num_side_ss1",))[:] = [3]
        file.createVariable("side_ss1", "i", ("num_side_ss1",))[:] = [2]
        for k in range(2):
            values = file.createVariable(f"vals_nod_var{k + 1}", "d", ("time_step", "num_nodes"))
            for step in range(3):
                values[step] = 0.1 * step * (k + 1) * mesh.points[:, 0]
        damage = file.createVariable("vals_elem_var1eb1", "d", ("time_step", "num_el_in_blk1"))
        damage[:3] = [[0.0, 0.0], [0.1, 0.2], [0.3, 0.4]]
    return path


def spheres(path: Path) -> Path:
    """An Exodus file of three spheres with the attributes radius and volume, as Peridigm reads it."""
    with netcdf_file(path, "w") as file:
        for name, length in {
            "num_dim": 3,
            "num_nodes": 3,
            "num_el_blk": 1,
            "num_el_in_blk1": 3,
            "one": 1,
            "two": 2,
        }.items():
            file.createDimension(name, length)
        for axis in "xyz":
            file.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = [0.0, 1.0, 2.0]
        table = file.createVariable("connect1", "i", ("num_el_in_blk1", "one"))
        table[:], table.elem_type = [[3], [1], [2]], "SPHERE"
        file.createVariable("attrib1", "d", ("num_el_in_blk1", "two"))[:] = [[0.5, 3.0], [0.5, 1.0], [0.5, 2.0]]
    return path


def _written(name: str, folder: Path) -> Path:
    body = pd.cloud(np.random.default_rng(0).random((7, 2)), np.linspace(1, 2, 7))
    stress = np.arange(28.0).reshape(7, 2, 2)
    return write_vtk(body, path=folder / name, fields={"stress": stress}, sets={"low": body.positions[:, 1] < 0.5})


def _series(folder: Path) -> Path:
    _written("step", folder)
    path = folder / "run.vtu.series"
    path.write_text('{"file-series-version": "1.0", "files": [{"name": "step.vtu", "time": 0.5}]}')
    return path


OF_MESHES = sorted(path for path in FOLDER.iterdir() if path.suffix in (".msh", ".inp", ".vtk"))
SAMPLES = {path.name: partial(_copied, path.name) for path in OF_MESHES}
SAMPLES |= {
    "plate.exo": _exodus,
    "points.vtu": partial(_written, "points"),
    "points.pvd": partial(_written, "points.pvd"),
    "run.vtu.series": _series,
    "text.vtu": partial(_meshio, meshio.vtu.write, "text.vtu", binary=False),
    "plain.vtu": partial(_meshio, meshio.vtu.write, "plain.vtu", compression=None),
    "lzma.vtu": partial(_meshio, meshio.vtu.write, "lzma.vtu", compression="lzma"),
    "binary.vtk": partial(_meshio, meshio.vtk.write, "binary.vtk"),
    "text.vtk": partial(_meshio, meshio.vtk.write, "text.vtk", binary=False),
    "text42.vtk": partial(_meshio, meshio.vtk.write, "text42.vtk", binary=False, fmt_version="4.2"),
}
