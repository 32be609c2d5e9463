"""Legacy files of VTK: NAME.vtk with an unstructured grid or polygonal data, as text or binary, versions 1.0 to 5.1.

Source: VTK, "VTK Legacy File Format", https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html
"""

import re
from itertools import islice
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from ..contents import Contents, States
from ..faults import fault, readable
from .meshes import Mesh, contents
from .vtu import blocks_of

WHAT = "legacy file of VTK"
_TYPES = {
    "bit": "u1",
    "char": "i1",
    "unsigned_char": "u1",
    "short": "i2",
    "unsigned_short": "u2",
    "int": "i4",
    "unsigned_int": "u4",
    "long": "i8",
    "unsigned_long": "u8",
    **{f"vtktype{sign}int{8 * size}": f"{sign or 'i'}{size}" for sign in ("", "u") for size in (1, 2, 4, 8)},
    "vtkidtype": "i4",
    "float": "f4",
    "double": "f8",
}
_WIDTHS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "TENSORS6": 6}
_POLYGONS = ("VERTICES", "LINES", "POLYGONS", "TRIANGLE_STRIPS")


class _Cursor:
    """A place in the file that moves on as lines and numbers are read."""

    def __init__(self, path: Path) -> None:
        self.path, self.body, self.at, self.binary = path, path.read_bytes(), 0, False

    def line(self, skip_blank: bool = True) -> list[str]:
        """Words of the next line. No words at the end of the file."""
        while self.at < len(self.body):
            end = self.body.find(b"\n", self.at)
            end = len(self.body) if end < 0 else end
            words = self.body[self.at : end].decode("utf-8").split()
            self.at = end + 1
            if words or not skip_blank:
                return words
        return []

    def numbers(self, count: int, kind: str) -> np.ndarray:
        if kind.lower() not in _TYPES:
            raise fault(self.path, f"arrays must hold integers or floats; got type {kind!r}")
        dtype, left = np.dtype(_TYPES[kind.lower()]), len(self.body) - self.at
        if not 0 <= count * (dtype.itemsize if self.binary else 1) <= left:
            raise fault(self.path, f"{count} numbers of type {kind} are announced, but {left} bytes follow")
        if self.binary:
            found = np.frombuffer(self.body, dtype.newbyteorder(">"), count, self.at).astype(dtype)
            self.at += count * dtype.itemsize
            return found
        words, end = [], self.at
        for word in islice(re.compile(rb"\S+").finditer(self.body, self.at), count):
            words.append(word.group())
            end = word.end()
        if len(words) < count:
            raise fault(self.path, f"{count} numbers of type {kind} are announced, but {len(words)} follow")
        self.at = end
        return np.array(words, float).astype(dtype) if dtype.kind == "f" else np.array([int(w) for w in words], dtype)

    def skip_words(self, count: int) -> None:
        """Pass over an array of text: a line each, or in binary files the length and the letters of each."""
        if count > len(self.body) - self.at:
            raise fault(self.path, f"{count} words are announced, but {len(self.body) - self.at} bytes follow")
        for _ in range(count):
            if not self.binary:
                self.line(False)
                continue
            first = self.body[self.at]  # its two highest bits tell how many bytes hold the length
            width = {3: 1, 2: 2, 1: 4, 0: 8}[first >> 6]
            length = int.from_bytes(self.body[self.at : self.at + width], "big") & ((1 << (8 * width - 2)) - 1)
            self.at += width + length


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path, self.cursor = path, _Cursor(path)
        if not self.cursor.body.startswith(b"# vtk DataFile Version"):
            raise fault(path, f"a {WHAT} must start with '# vtk DataFile Version'; got {self.cursor.body[:22]!r}")
        self.cursor.line(False)
        self.cursor.line(False)
        kind = " ".join(self.cursor.line()).upper()
        if kind not in ("ASCII", "BINARY"):
            raise fault(path, f"line 3 must be ASCII or BINARY; got {kind[:40]!r}")
        self.cursor.binary = kind == "BINARY"
        self.mesh = Mesh(np.zeros((0, 3)))
        self.starts, self.ends, self.nodes = np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.int64)
        self.types: np.ndarray | None = None
        self.counts: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self.fields: dict[str, np.ndarray] = {}
        self.count = 0
        self.dataset = ""
        while words := self.cursor.line():
            self._section(words[0].upper(), words[1:])

    def _section(self, name: str, words: list[str]) -> None:
        cursor = self.cursor
        if name == "DATASET":
            self.dataset = words[0].upper()
            if self.dataset not in ("UNSTRUCTURED_GRID", "POLYDATA"):
                raise fault(
                    self.path,
                    f"the dataset must be UNSTRUCTURED_GRID or POLYDATA; got {words[0]}. Save it as the first",
                )
        elif name == "POINTS":
            self.mesh.nodes = cursor.numbers(3 * int(words[0]), words[1]).astype(float).reshape(-1, 3)
        elif name == "CELLS" or name in _POLYGONS:
            self._cells(name, int(words[0]), int(words[1]))
        elif name == "CELL_TYPES":
            self.types = cursor.numbers(int(words[0]), "int")
        elif name in ("POINT_DATA", "CELL_DATA"):
            self.count = int(words[0])
            self.fields = self.mesh.node_fields if name == "POINT_DATA" else self.mesh.cell_fields
        elif name == "SCALARS":
            width, at = int(words[2]) if len(words) > 2 else 1, cursor.at
            if (cursor.line() or [""])[0].upper() != "LOOKUP_TABLE":
                cursor.at = at
            self._keep(words[0], self.count, width, words[1])
        elif name in _WIDTHS:
            self._keep(words[0], self.count, _WIDTHS[name], words[1])
        elif name == "TEXTURE_COORDINATES":
            self._keep(words[0], self.count, int(words[1]), words[2])
        elif name == "COLOR_SCALARS":
            cursor.numbers(self.count * int(words[1]), "unsigned_char" if cursor.binary else "float")
        elif name == "LOOKUP_TABLE":
            cursor.numbers(4 * int(words[1]), "unsigned_char" if cursor.binary else "float")
        elif name == "FIELD":
            for _ in range(int(words[1])):
                head = cursor.line()
                if head and head[0] == "METADATA":
                    self._metadata()
                    head = cursor.line()
                self._keep(head[0], int(head[2]), int(head[1]), head[3])
        elif name == "METADATA":
            self._metadata()
        else:
            raise fault(self.path, f"sections must be those of a {WHAT}; got {name[:40]!r} before byte {cursor.at}")

    def _metadata(self) -> None:
        while self.cursor.line(False):
            pass

    def _keep(self, name: str, count: int, width: int, kind: str) -> None:
        if width < 1 or count < 0:
            raise fault(self.path, f"array {name!r} must have components and entries; got {width} and {count}")
        if kind.lower() == "string":
            self.cursor.skip_words(count * width)
            self.mesh.notes.append(f"Array {unquote(name)!r} is no array of numbers and is left out.")
            return
        values = self.cursor.numbers(count * width, kind)
        if self.count:  # arrays before POINT_DATA belong to the whole data set, such as its time
            shape = {1: (), 9: (3, 3)}.get(width, (width,))
            self.fields[unquote(name)] = values.reshape(count, *shape)

    def _cells(self, name: str, count: int, size: int) -> None:
        at = self.cursor.at
        head = self.cursor.line()
        if head and head[0].upper() == "OFFSETS":  # version 5.1
            bounds = self.cursor.numbers(count, head[1]).astype(np.int64)
            head = self.cursor.line()
            if not head or head[0].upper() != "CONNECTIVITY" or (len(bounds) and bounds[0] != 0):
                raise fault(self.path, "OFFSETS must start with 0, and CONNECTIVITY must follow")
            nodes = self.cursor.numbers(size, head[1]).astype(np.int64)
            starts, ends = bounds[:-1], bounds[1:]
        else:
            self.cursor.at = at
            nodes = self.cursor.numbers(size, "int").astype(np.int64)
            flat, begins, place = nodes.tolist(), [], 0
            for _ in range(count):
                if place >= len(flat) or flat[place] < 0:
                    raise fault(
                        self.path, f"{name} announces {count} cells, but its list of {size} numbers ends before"
                    )
                begins.append(place + 1)
                place += flat[place] + 1
            starts = np.array(begins, np.int64)
            ends = starts + nodes[starts - 1] if count else starts
        self.starts = np.concatenate([self.starts, starts + len(self.nodes)])
        self.ends = np.concatenate([self.ends, ends + len(self.nodes)])
        self.nodes = np.concatenate([self.nodes, nodes])
        if name in _POLYGONS:
            kinds = {
                "VERTICES": (2, {}),
                "LINES": (4, {2: 3}),
                "POLYGONS": (7, {3: 5, 4: 9}),
                "TRIANGLE_STRIPS": (6, {}),
            }
            other, known = kinds[name]
            types = np.full(len(starts), other)
            for length, number in known.items():
                types[ends - starts == length] = number
            self.types = types if self.types is None else np.concatenate([self.types, types])

    def finished(self) -> Mesh:
        types = np.empty(0, np.int64) if self.types is None else self.types
        if len(types) != len(self.starts):
            raise fault(
                self.path, f"CELL_TYPES must list a type for each of the {len(self.starts)} cells; got {len(types)}"
            )
        self.mesh.blocks, self.mesh.numbers = blocks_of(self.path, types, self.starts, self.ends, self.nodes)
        for name, values in self.mesh.cell_fields.items():
            if len(values) != len(types):
                raise fault(
                    self.path, f"field {name!r} must have a value for each of the {len(types)} cells; got {len(values)}"
                )
        self.mesh.cell_fields = {n: values[self.mesh.numbers] for n, values in self.mesh.cell_fields.items()}
        return self.mesh


def states(path: Path) -> States:
    """The single state of a legacy VTK file."""

    def at(state: int) -> Contents:
        with readable(path, WHAT):
            return contents(_Reader(path).finished(), path)

    return States((), at)
