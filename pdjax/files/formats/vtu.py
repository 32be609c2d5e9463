"""Unstructured grids of VTK as XML: NAME.vtu, the files of ParaView, Peridynamics.jl and others.

The data may be text, base64 or appended, and compressed by zlib or lzma. Several pieces are joined.

Source: VTK, "VTK XML Formats",
https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html
"""

import base64
import lzma
import math
import re
import zlib
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..contents import States
from ..faults import fault, readable
from .meshes import Mesh, contents
from .xml import parsed

WHAT = "unstructured grid of VTK (VTU)"
# Number in the file: name of the type, its number of nodes, and their order if it differs.
TYPES: dict[int, tuple[str, int, tuple[int, ...]]] = {
    1: ("vertex", 1, ()),
    3: ("line", 2, ()),
    5: ("triangle", 3, ()),
    8: ("quadrilateral", 4, (0, 1, 3, 2)),
    9: ("quadrilateral", 4, ()),
    10: ("tetrahedron", 4, ()),
    11: ("hexahedron", 8, (0, 1, 3, 2, 4, 5, 7, 6)),
    12: ("hexahedron", 8, ()),
    13: ("wedge", 6, ()),
    14: ("pyramid", 5, ()),
    21: ("line3", 3, ()),
    22: ("triangle6", 6, ()),
    23: ("quadrilateral8", 8, ()),
    24: ("tetrahedron10", 10, ()),
    25: ("hexahedron20", 20, ()),
    28: ("quadrilateral9", 9, ()),
    29: ("hexahedron27", 27, ()),
    34: ("triangle7", 7, ()),
}
OTHER_TYPES = {4: "polyline", 6: "triangle strip", 7: "polygon", 42: "polyhedron"}
# zlib makes at most 1032 bytes of one. An array that announces more is refused before memory is taken for it.
EXPANSION = 1100
GHOST = "vtkGhostType"  # bit 1: a copy of a cell of another process; bit 32: hidden
_NUMBERS = {
    f"{kind}{size}": f"{letter}{size // 8}"
    for kind, letter in (("Int", "i"), ("UInt", "u"))
    for size in (8, 16, 32, 64)
}
_NUMBERS |= {"Float32": "f4", "Float64": "f8"}


class _File:
    """The XML tree of a VTU file, its appended data, and how its arrays are coded."""

    def __init__(self, path: Path) -> None:
        self.path, body = path, path.read_bytes()
        self.left = EXPANSION * len(body)  # bytes that all arrays together may still announce
        self.appended, self.raw = b"", False
        opening = re.search(rb"<AppendedData[^>]*>", body)
        if opening:
            data = body[opening.end() : max(body.rfind(b"</AppendedData>"), opening.end())]
            self.appended = data[data.find(b"_") + 1 :]
            self.raw = b"raw" in opening.group()
            body = body[: opening.end()] + b"</AppendedData></VTKFile>"
        self.root = parsed(path, body)
        if self.root.get("type") != "UnstructuredGrid":
            raise fault(path, f"the file must hold an UnstructuredGrid; got {self.root.get('type')}. Convert it to VTU")
        self.order = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self.header = np.dtype(self.order + _NUMBERS[self.root.get("header_type", "UInt32")])
        self.compressor = self.root.get("compressor")

    def array(self, element: Element, count: int | None) -> np.ndarray:
        """Numbers of a DataArray, (count,) or (count, components). If count is None, all that there are."""
        name, kind = element.get("Name", "Points"), element.get("type", "")
        if kind not in _NUMBERS:
            raise fault(self.path, f"array {name!r} must hold integers or floats; got type {kind!r}")
        dtype, width = np.dtype(self.order + _NUMBERS[kind]), int(element.get("NumberOfComponents") or 1)
        if width < 1 or width > 10**6:
            raise fault(self.path, f"array {name!r} must have one component or more; got {width}")
        total = None if count is None else count * width
        form = element.get("format", "ascii")
        if form == "ascii":
            words = (element.text or "").split()
            values = np.array(words, dtype.newbyteorder("=")) if words else np.empty(0, dtype)
        elif form == "binary":
            values = self._decoded(name, (element.text or "").strip().encode(), False, dtype, total)
        elif form == "appended":
            offset = int(element.get("offset", "-1").strip())
            if not 0 <= offset <= len(self.appended):
                raise fault(self.path, f"array {name!r} must start in the appended data; got offset {offset}")
            values = self._decoded(name, memoryview(self.appended)[offset:], self.raw, dtype, total)
        else:
            raise fault(self.path, f"array {name!r} must have format ascii, binary or appended; got {form!r}")
        if total is not None and values.size != total:
            raise fault(self.path, f"array {name!r} must hold {count} × {width} numbers; it holds {values.size}")
        values = values.astype(dtype.newbyteorder("="))
        return values.reshape(-1, width) if width > 1 else values

    def _decoded(
        self, name: str, data: bytes | memoryview, raw: bool, dtype: np.dtype, total: int | None
    ) -> np.ndarray:
        """Numbers of a coded array: a head with sizes in bytes, then the data."""
        wanted = None if total is None else total * dtype.itemsize
        blocks, size = 1, self.header.itemsize
        if self.compressor not in (None, "vtkZLibDataCompressor", "vtkLZMADataCompressor"):
            raise fault(
                self.path, f"the data must be compressed by zlib or lzma; got {self.compressor}. Save it with zlib"
            )
        if self.compressor:
            blocks = int(np.frombuffer(_bytes(data, 0, size, raw), self.header, 1)[0])
            if blocks * size > len(data):
                raise fault(self.path, f"array {name!r} announces {blocks} blocks, more than the file can hold")
            head = np.frombuffer(_bytes(data, 0, (3 + blocks) * size, raw), self.header, 3 + blocks).astype(object)
            if blocks == 0:
                return np.empty(0, dtype)
            announced = (blocks - 1) * head[1] + (head[2] or head[1])
            packed = sum(head[3:])
        else:
            announced = packed = int(np.frombuffer(_bytes(data, 0, size, raw), self.header, 1)[0])
        if packed > len(data) or announced > EXPANSION * len(data) or (wanted is not None and announced != wanted):
            most = f"{len(data)} bytes of the file are left" if wanted is None else f"it must hold {wanted} bytes"
            raise fault(self.path, f"array {name!r} announces {announced} bytes ({packed} in the file), but {most}")
        self.left -= announced
        if self.left < 0:  # many arrays may refer to the same data
            raise fault(self.path, f"all arrays together announce more than {EXPANSION} times the bytes of the file")
        if not self.compressor:
            return np.frombuffer(_after(data, size, packed, raw), dtype)
        body, at, parts = _after(data, (3 + blocks) * size, packed, raw), 0, []
        for block, length in enumerate(head[3:]):
            full = head[2] if block == blocks - 1 and head[2] else head[1]
            parts.append(self._expanded(name, body[at : at + length], full))
            at += length
        return np.frombuffer(b"".join(parts), dtype)

    def _expanded(self, name: str, block: bytes, size: int) -> bytes:
        zipped = self.compressor == "vtkZLibDataCompressor"
        machine = zlib.decompressobj() if zipped else lzma.LZMADecompressor(memlimit=2**28)
        out = machine.decompress(block, size + 1)
        if len(out) != size:
            raise fault(
                self.path, f"a block of array {name!r} must expand to {size} bytes; it gives {len(out)} or more"
            )
        return out


def _bytes(data: bytes | memoryview, start: int, count: int, raw: bool) -> bytes:
    """The first bytes of coded data, which start a new group of base64 letters if they are not raw."""
    if raw:
        return bytes(data[start : start + count])
    return base64.b64decode(bytes(data[start : start + 4 * math.ceil(count / 3)]))[:count]


def _after(data: bytes | memoryview, head: int, count: int, raw: bool) -> bytes:
    """`count` bytes that follow a head of `head` bytes. Base64 codes both together, or each in its own letters."""
    if raw:
        return bytes(data[head : head + count])
    letters = 4 * math.ceil(head / 3)
    if head % 3 and b"=" not in bytes(data[:letters]):
        return _bytes(data, 0, head + count, False)[head:]
    return _bytes(data, letters, count, False)


def _children(element: Element | None) -> list[Element]:
    return [] if element is None else [child for child in element if child.tag == "DataArray"]


def _fields(file: _File, piece: Element, tag: str, count: int, notes: list[str]) -> dict[str, np.ndarray]:
    """Fields of a piece. Arrays of nine components are tensors. Arrays of text are left out."""
    fields = {}
    for child in (c for group in piece.findall(tag) for c in group):
        name = child.get("Name", "field")
        if child.tag == "DataArray" and child.get("type") in _NUMBERS:
            values = file.array(child, count)
            fields[name] = values.reshape(-1, 3, 3) if values.shape[1:] == (9,) else values
        else:
            notes.append(f"Array {name!r} is no array of numbers and is left out.")
    return fields


def blocks_of(
    path: Path, types: np.ndarray, starts: np.ndarray, ends: np.ndarray, nodes: np.ndarray
) -> tuple[list, np.ndarray]:
    """Cells of VTK by type, and the number of each. Cell k has the nodes from starts[k] to ends[k]."""
    if (ends < starts).any() or (len(ends) and (starts.min() < 0 or ends.max() > len(nodes))):
        raise fault(path, f"cells must lie in the list of the {len(nodes)} nodes of all cells; offsets are damaged")
    blocks, numbers = [], [np.empty(0, np.int64)]
    for number in np.unique(types).tolist():
        cells = np.flatnonzero(types == number)
        lengths = ends[cells] - starts[cells]
        if number == 2:  # a poly-vertex is a list of vertices
            inner = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
            blocks.append(("vertex", nodes[np.repeat(starts[cells], lengths) + inner][:, None]))
            numbers.append(np.repeat(cells, lengths))
            continue
        if number not in TYPES:
            blocks.append((OTHER_TYPES.get(number, f"VTK {number}"), np.zeros((len(cells), 0), np.int64)))
            numbers.append(cells)
            continue
        name, width, order = TYPES[number]
        if (lengths != width).any():
            wrong = int(np.argmax(lengths != width))
            raise fault(path, f"cell {int(cells[wrong])}, a {name}, must have {width} nodes; got {int(lengths[wrong])}")
        table = nodes[starts[cells][:, None] + np.arange(width)]
        blocks.append((name, table[:, order] if order else table))
        numbers.append(cells)
    return blocks, np.concatenate(numbers)


def _piece(file: _File, piece: Element) -> Mesh:
    points, cells = int(piece.get("NumberOfPoints", "0")), int(piece.get("NumberOfCells", "0"))
    if min(points, cells) < 0 or max(points, cells) > EXPANSION * file.path.stat().st_size:
        raise fault(file.path, f"the numbers of points and cells must fit the file; got {points} and {cells}")
    mesh = Mesh(np.zeros((0, 3)))
    arrays = _children(piece.find("Points"))
    if points and not arrays:
        raise fault(file.path, "a piece must have an array of its points; it has none")
    mesh.nodes = file.array(arrays[0], points).astype(float) if arrays else mesh.nodes
    if mesh.nodes.ndim != 2 or mesh.nodes.shape[1] > 3:
        raise fault(file.path, f"points must have 3 components; got an array of shape {mesh.nodes.shape}")
    listed = {child.get("Name"): child for child in _children(piece.find("Cells"))}
    if cells and not {"connectivity", "offsets", "types"} <= set(listed):
        raise fault(file.path, f"cells must have connectivity, offsets and types; got {sorted(map(str, listed))}")
    mesh.node_fields = _fields(file, piece, "PointData", points, mesh.notes)
    mesh.cell_fields = _fields(file, piece, "CellData", cells, mesh.notes)
    if cells:
        nodes, ends = file.array(listed["connectivity"], None), file.array(listed["offsets"], cells).astype(np.int64)
        types = file.array(listed["types"], cells)
        starts = np.concatenate([[0], ends[:-1]])
        mesh.blocks, mesh.numbers = blocks_of(file.path, types, starts, ends, nodes.astype(np.int64))
    else:
        mesh.numbers = np.empty(0, np.int64)
    mesh.cell_fields = {name: values[mesh.numbers] for name, values in mesh.cell_fields.items()}
    mesh.node_fields.pop(GHOST, None)
    return _without_copies(mesh) if GHOST in mesh.cell_fields else mesh


def _without_copies(mesh: Mesh) -> Mesh:
    """The mesh without the cells that belong to another process or are hidden."""
    assert mesh.numbers is not None
    kept, first, blocks = mesh.cell_fields.pop(GHOST).reshape(-1).astype(np.int64) & 33 == 0, 0, []
    for name, nodes in mesh.blocks:
        blocks.append((name, nodes[kept[first : first + len(nodes)]]))
        first += len(nodes)
    if not kept.all():
        mesh.notes.append(f"{int((~kept).sum())} cells are copies of cells of other parts and are left out.")
    fields = {name: values[kept] for name, values in mesh.cell_fields.items()}
    return replace(mesh, blocks=blocks, cell_fields=fields, numbers=mesh.numbers[kept])


def joined(pieces: list[Mesh]) -> Mesh:
    """Several pieces as one mesh. Fields that not all pieces have are left out."""
    pieces = [piece for piece in pieces if len(piece.nodes)] or pieces[:1]
    if len(pieces) == 1:
        return pieces[0]
    whole = Mesh(np.concatenate([piece.nodes for piece in pieces]), notes=[n for p in pieces for n in p.notes])
    numbers, first, cells = [], 0, 0
    for piece in pieces:
        assert piece.numbers is not None
        whole.blocks += [(name, nodes + first) for name, nodes in piece.blocks]
        numbers.append(piece.numbers + cells)
        first, cells = first + len(piece.nodes), cells + int(piece.numbers.max(initial=-1)) + 1
    whole.numbers = np.concatenate(numbers)
    for mine, of in (
        (whole.node_fields, [p.node_fields for p in pieces]),
        (whole.cell_fields, [p.cell_fields for p in pieces]),
    ):
        for name in of[0]:
            if all(name in fields for fields in of):
                mine[name] = np.concatenate([fields[name] for fields in of])
    return whole


def mesh_of(path: Path) -> Mesh:
    """The mesh of a VTU file."""
    with readable(path, WHAT):
        file = _File(path)
        grid = file.root.find("UnstructuredGrid")
        pieces = [] if grid is None else grid.findall("Piece")
        if not pieces:
            raise fault(path, "an unstructured grid must have a piece; it has none")
        return joined([_piece(file, piece) for piece in pieces])


def states(path: Path) -> States:
    """The single state of a VTU file."""

    def at(state: int):
        mesh = mesh_of(path)
        with readable(path, WHAT):
            return contents(mesh, path)

    return States((), at)
