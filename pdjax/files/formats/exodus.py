"""Exodus II files of Cubit, Peridigm, Sierra, MOOSE and others, with all their time steps.

Element blocks, node sets and side sets become sets. Components such as DISPLX, DISPLY, DISPLZ become one vector DISPL.
Blocks of spheres are points. Their volume is the attribute "volume", or the second attribute, where Peridigm keeps it.

Classic netCDF files, the default of most programs, are opened by scipy. Those that are HDF5 inside need the optional
package netCDF4: `pip install "pdjax[meshes]"`. Open HDF5 files only from sources that you trust: that library can take
much memory for a damaged file.

Source: Schoof and Yarberry, EXODUS II: A Finite Element Data Model, SAND92-2137 (1994), appendix A.
"""

import contextlib
import io
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import netcdf_file

from ..contents import Contents, States
from ..faults import fault, readable
from .cells import SHAPES
from .meshes import Mesh, check_sets, contents

WHAT = "Exodus II file"
EXPANSION = 1100  # the compression of HDF5 makes no more bytes of one; classic files are not compressed
_SHAPES = {
    "SPHERE": "vertex",
    "CIRCLE": "vertex",
    "POINT": "vertex",
    "BAR": "line",
    "BEAM": "line",
    "TRUSS": "line",
    "EDGE": "line",
    "TRI": "triangle",
    "TRIANGLE": "triangle",
    "QUAD": "quadrilateral",
    "TET": "tetrahedron",
    "TETRA": "tetrahedron",
    "HEX": "hexahedron",
    "HEXAHEDRON": "hexahedron",
}
_ENDINGS = {2: ("XY", "xy"), 3: ("XYZ", "xyz")}


class _Bounded(io.BufferedReader):
    """A file whose `read` takes memory for no more bytes than follow. That of Python takes what is asked for."""

    def __init__(self, path: Path) -> None:
        super().__init__(io.FileIO(path))
        self.size = path.stat().st_size

    def read(self, size: int | None = -1) -> bytes:
        left = max(self.size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))


class _File:
    """An open netCDF file whose arrays are read only if they can be in it."""

    def __init__(self, path: Path, dataset: Any) -> None:
        self.path, self.dataset, self.size = path, dataset, path.stat().st_size
        self.left = EXPANSION * self.size  # numbers that all arrays together may still announce

    def length(self, name: str) -> int:
        """Length of a dimension, 0 if there is none."""
        dimension = self.dataset.dimensions.get(name)
        return 0 if dimension is None else dimension if isinstance(dimension, int) else len(dimension)

    def has(self, name: str) -> bool:
        return name in self.dataset.variables

    def array(self, name: str, row: int | None = None) -> np.ndarray:
        """An array, or a row of it. Raises ValueError if it would be longer than the file can be."""
        if not self.has(name):
            raise fault(self.path, f"an {WHAT} of this kind must have an array {name}; it has none")
        variable = self.dataset.variables[name]
        count = int(np.prod(variable.shape if row is None else variable.shape[1:], dtype=object))
        self.left -= count
        if self.left < 0:  # many arrays may refer to the same data
            raise fault(self.path, f"array {name} announces {count} numbers, but the file has only {self.size} bytes")
        found = np.array(variable[:] if row is None else variable[row])
        return found if found.dtype.isnative else found.astype(found.dtype.newbyteorder("="))

    def names(self, name: str) -> list[str]:
        """Rows of letters as words. No words if there is no such array."""
        if not self.has(name):
            return []
        rows = self.array(name)
        return [b"".join(row.tolist()).split(b"\0")[0].decode("utf-8", "replace").strip() for row in rows]


def _labels(file: _File, prefix: str, count: int, words: str) -> list[str]:
    """Names of blocks or sets, or their kind and number if they have no name."""
    names = file.names(f"{prefix}_names")
    numbers = file.array(f"{prefix}_prop1").tolist() if file.has(f"{prefix}_prop1") else []
    out = []
    for k in range(count):
        name = names[k] if k < len(names) else ""
        out.append(name or f"{words} {numbers[k] if k < len(numbers) else k + 1}")
    return out


def _type(path: Path, kind: str, width: int) -> str:
    """Name of a type of cells from its word in the file and its number of nodes."""
    word = re.match(r"[A-Z]*", kind.upper()).group()  # type: ignore[union-attr]
    shape = {3: "triangle", 6: "triangle"}.get(width, "quadrilateral") if "SHELL" in word else _SHAPES.get(word)
    if shape is None:
        return word.lower() or "nameless"
    if width < SHAPES[shape].corners:
        raise fault(path, f"elements of type {kind} must have {SHAPES[shape].corners} nodes; got {width}")
    return shape if width == SHAPES[shape].corners else f"{shape}{width}"


def vectors(fields: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Fields whose names end in X, Y, Z or x, y, z joined to vectors. Other fields are unchanged."""
    left = dict(fields)
    for name in fields:
        for count in (3, 2):
            for letters in _ENDINGS[count]:
                stem = name[:-1]
                parts = [stem + letter for letter in letters]
                label = stem.rstrip("_")
                if name == parts[0] and label and set(parts) <= set(left) and label not in left:
                    columns = [left.pop(part) for part in parts]
                    if all(column.ndim == 1 for column in columns):
                        left[label] = np.stack(columns, axis=1)
                    else:
                        left |= dict(zip(parts, columns, strict=True))
    return left


def _nodes(file: _File) -> np.ndarray:
    count, dim = file.length("num_nodes"), file.length("num_dim")
    if dim not in (1, 2, 3) or count < 1:
        raise fault(file.path, f"a mesh must have nodes in 1 to 3 dimensions; got {count} nodes in {dim}")
    if file.has("coord"):
        return file.array("coord").T.astype(float)
    return np.stack([file.array(f"coord{axis}").astype(float) for axis in "xyz"[:dim]], axis=1)


def _blocks(file: _File, mesh: Mesh) -> list[int]:
    """Put the element blocks into the mesh, each of them a set. Returns their lengths."""
    sizes, volumes, spheres = [], [], True
    count = _bounded(file, "num_el_blk")
    for k in range(1, count + 1):
        name = f"connect{k}"
        if not file.has(name):  # a block without elements
            sizes.append(0)
            continue
        table = file.array(name).astype(np.int64) - 1
        word = getattr(file.dataset.variables[name], "elem_type", "")
        kind = word.decode("latin-1") if isinstance(word, bytes) else str(word)
        shape = _type(file.path, kind, table.shape[1] if table.ndim == 2 else 1)
        mesh.blocks.append((shape, table.reshape(len(table), -1)))
        sizes.append(len(table))
        spheres = spheres and shape == "vertex"
        if spheres and file.has(f"attrib{k}"):
            named = [word.lower() for word in file.names(f"attrib_name{k}")]
            given = file.array(f"attrib{k}").astype(float).reshape(len(table), -1)
            column = named.index("volume") if "volume" in named else 1
            if column < given.shape[1]:
                volumes.append(given[:, column])
    ends = np.cumsum([0, *sizes])
    sets = count + _bounded(file, "num_node_sets") + _bounded(file, "num_side_sets")
    check_sets(file.path, sets, max(int(ends[-1]), len(mesh.nodes)))
    for k, label in enumerate(_labels(file, "eb", count, "block")):
        mesh.cell_sets[label] = np.zeros(ends[-1], bool) | mesh.cell_sets.get(label, False)
        mesh.cell_sets[label][ends[k] : ends[k + 1]] = True
    if spheres and volumes and sum(map(len, volumes)) == ends[-1]:
        mesh.cell_fields["volume"] = np.concatenate(volumes)
    return sizes


def _bounded(file: _File, name: str) -> int:
    count = file.length(name)
    if count > file.size:
        raise fault(file.path, f"dimension {name} must fit the file; got {count}")
    return count


def _marked(file: _File, array: str, total: int, what: str) -> np.ndarray:
    """A mask of the entries that an array lists, counted from 1."""
    mask = np.zeros(total, bool)
    if file.has(array):
        listed = file.array(array).astype(np.int64).reshape(-1) - 1
        if listed.size and not (0 <= listed.min() and listed.max() < total):
            raise fault(file.path, f"array {array} must list {what} from 1 to {total}; got {listed.max() + 1}")
        mask[listed] = True
    return mask


def _fields(file: _File, mesh: Mesh, sizes: list[int], step: int) -> None:
    """Put the fields of a time step into the mesh. An element field that a block lacks is NaN there."""
    names = file.names("name_nod_var")
    for k, name in enumerate(names):
        if file.has(f"vals_nod_var{k + 1}"):
            mesh.node_fields[name] = file.array(f"vals_nod_var{k + 1}", step)
        elif file.has("vals_nod_var"):  # of Exodus before version 2.03
            mesh.node_fields[name] = file.array("vals_nod_var", step)[k]
    ends = np.cumsum([0, *sizes])
    for k, name in enumerate(file.names("name_elem_var")):
        values = np.full(ends[-1], np.nan)
        for block in range(len(sizes)):
            array = f"vals_elem_var{k + 1}eb{block + 1}"
            if file.has(array):
                values[ends[block] : ends[block + 1]] = file.array(array, step)
            elif sizes[block]:
                mesh.notes.append(f"Field {name} is not given for block {block + 1}, so it is NaN there.")
        mesh.cell_fields[name] = values
    mesh.node_fields, mesh.cell_fields = vectors(mesh.node_fields), vectors(mesh.cell_fields)


def _mesh(file: _File, step: int | None) -> Mesh:
    mesh = Mesh(_nodes(file))
    sizes = _blocks(file, mesh)
    for k, label in enumerate(_labels(file, "ns", _bounded(file, "num_node_sets"), "node set")):
        mesh.node_sets[label] = _marked(file, f"node_ns{k + 1}", len(mesh.nodes), "nodes")
    for k, label in enumerate(_labels(file, "ss", _bounded(file, "num_side_sets"), "side set")):
        mask = _marked(file, f"elem_ss{k + 1}", sum(sizes), "elements")
        mesh.cell_sets[label] = mesh.cell_sets[label] | mask if label in mesh.cell_sets else mask
    if step is not None:
        _fields(file, mesh, sizes, step)
    return mesh


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[_File]:
    """The open file. Raises ValueError if it is damaged, and ImportError if it needs a package."""
    with path.open("rb") as stream:
        head = stream.read(8)
    if head[:4] in (b"CDF\1", b"CDF\2"):
        try:
            dataset = netcdf_file(_Bounded(path), "r", mmap=True)
        except (TypeError, AttributeError) as error:  # what scipy raises for lengths that do not fit together
            raise fault(path, f"the header of an {WHAT} must fit its arrays; scipy says: {error}") from None
        try:
            yield _File(path, dataset)
        finally:
            with warnings.catch_warnings():  # after an error the traceback still refers to arrays of the file
                warnings.simplefilter("ignore", RuntimeWarning)
                dataset.close()
        return
    if head[:4] != b"CDF\5" and head != b"\x89HDF\r\n\x1a\n":
        raise fault(path, f"an {WHAT} must be a netCDF file; got a file that starts with {head!r}")
    try:
        import netCDF4
    except ImportError as error:
        raise ImportError(f'{path.name} is in HDF5, which needs netCDF4: pip install "pdjax[meshes]"') from error
    try:
        dataset = netCDF4.Dataset(path)
    except OSError as error:
        raise fault(path, f"an {WHAT} must be a complete netCDF file; netCDF4 says: {error}") from error
    with dataset:
        dataset.set_auto_maskandscale(False)
        yield _File(path, dataset)


def states(path: Path) -> States:
    """The time steps of an Exodus file. Each loads the mesh and the fields of its step."""
    with readable(path, WHAT), _opened(path) as file:
        times = tuple(file.array("time_whole").astype(float).tolist()) if file.has("time_whole") else ()

    def at(state: int) -> Contents:
        with readable(path, WHAT), _opened(path) as file:
            return contents(_mesh(file, state if times else None), path)

    return States(times, at)
