"""Meshes of Gmsh: MSH files of version 2 and 4.1, as text or binary.

A physical group becomes a set with its name, or "surface 3" if it has none. Views of nodes and elements become fields;
views of several times are the states of the file. Cells that belong to several groups are written several times in
version 2, and read once.

Source: Gmsh Reference Manual, section "MSH file format", https://gmsh.info/doc/texinfo/gmsh.html#MSH-file-format
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..contents import Contents, States
from ..faults import fault, places, readable
from .cells import SECOND_ORDER, SHAPES, keys
from .gmsh_numbers import Binary, Stream, Text
from .meshes import Mesh, check_sets, contents

WHAT = "Gmsh mesh (MSH 2 or 4.1)"
# Number in the file: name of the type, number of nodes.
TYPES = {
    1: ("line", 2),
    2: ("triangle", 3),
    3: ("quadrilateral", 4),
    4: ("tetrahedron", 4),
    5: ("hexahedron", 8),
    6: ("wedge", 6),
    7: ("pyramid", 5),
    8: ("line3", 3),
    9: ("triangle6", 6),
    10: ("quadrilateral9", 9),
    11: ("tetrahedron10", 10),
    12: ("hexahedron27", 27),
    13: ("wedge18", 18),
    14: ("pyramid14", 14),
    15: ("vertex", 1),
    16: ("quadrilateral8", 8),
    17: ("hexahedron20", 20),
    18: ("wedge15", 15),
    19: ("pyramid13", 13),
    21: ("triangle10", 10),
    26: ("line4", 4),
    29: ("tetrahedron20", 20),
    36: ("quadrilateral16", 16),
    92: ("hexahedron64", 64),
}
DIMENSIONS = ("point", "curve", "surface", "volume")


class _Elements(NamedTuple):
    """Elements of one type: their tags, the tags of their nodes, and pairs (group, mask) of physical groups."""

    name: str
    tags: np.ndarray
    nodes: np.ndarray
    groups: dict[tuple[int, int], np.ndarray]


class _View(NamedTuple):
    """A field of nodes or elements at one time."""

    name: str
    time: float
    tags: np.ndarray
    values: np.ndarray


class _Reader:
    """The sections of a file, one method each."""

    def __init__(self, path: Path) -> None:
        self.path, self.body = path, path.read_bytes()
        self.version, self.binary, self.order, self.size = 2, False, "<", 8
        self.names: dict[tuple[int, int], str] = {}
        self.physical: dict[tuple[int, int], list[int]] = {}
        self.tags, self.nodes = np.empty(0, np.int64), np.empty((0, 3))
        self.elements: list[_Elements] = []
        self.views: dict[str, list[_View]] = {"NodeData": [], "ElementData": []}
        self.notes: list[str] = []
        at = 0
        while (at := self.body.find(b"$", at)) >= 0:
            end_of_line = self.body.find(b"\n", at)
            name = self.body[at + 1 : end_of_line].strip().decode("latin-1") if end_of_line > 0 else ""
            end = self.body.find(b"$End" + name.encode("latin-1"), end_of_line) if name else -1
            if end < 0:
                raise fault(path, f"section ${name[:40]} must end with $End{name[:40]}; the file may be cut off")
            self._section(name, self.body[end_of_line + 1 : end])
            at = end + 4 + len(name)

    def stream(self, body: bytes) -> Stream:
        return Binary(body, self.order, self.size) if self.binary else Text(body)

    def _section(self, name: str, body: bytes) -> None:
        if name == "MeshFormat":
            self._format(body)
        elif name == "PhysicalNames":
            for line in body.decode("utf-8", "replace").splitlines()[1:]:
                if line.strip():
                    dim, tag, words = line.split(maxsplit=2)
                    self.names[int(dim), int(tag)] = words.strip().strip('"')
        elif name == "Entities" and self.version == 4:
            self._entities(self.stream(body))
        elif name == "Nodes":
            (self._nodes4 if self.version == 4 else self._nodes2)(self.stream(body))
        elif name == "Elements":
            if self.version == 4:
                self._elements4(self.stream(body))
            else:
                self._elements2(self.stream(body))
        elif name in self.views:
            self.views[name].append(self._view(body))
        elif name == "ElementNodeData":
            self.notes.append("Views of the nodes of every element ($ElementNodeData) are left out.")

    def _format(self, body: bytes) -> None:
        line, _, rest = body.partition(b"\n")
        version, kind, size = line.split()[:3]
        if version.startswith(b"2") or version in (b"4.1", b"4"):
            self.version, self.binary, self.size = int(version[:1]), kind != b"0", int(size)
        else:
            word = version.decode("latin-1")
            raise fault(self.path, f"a Gmsh mesh must have version 2.2 or 4.1; got {word}. Save it again as MSH 4.1")
        if self.size not in (4, 8):
            raise fault(self.path, f"the data size in $MeshFormat must be 4 or 8; got {self.size}")
        if self.binary and rest[:4] == b"\0\0\0\1":
            self.order = ">"

    def _entities(self, stream: Stream) -> None:
        for dim, count in enumerate(stream.take("s", 4).tolist()):
            for _ in range(count):
                (tag,) = stream.take("i", 1).tolist()
                stream.take("d", 3 if dim == 0 else 6)
                groups = stream.take("i", int(stream.take("s", 1)[0]))
                self.physical[dim, tag] = np.abs(groups).tolist()
                if dim:
                    stream.take("i", int(stream.take("s", 1)[0]))

    def _nodes2(self, stream: Stream) -> None:
        if self.binary:  # the number of nodes is text in version 2, also in binary files
            stream, count = self._counted(stream)
        else:
            count = int(stream.take("s", 1)[0])
        self.tags, *columns = stream.rows(count, "iddd")
        self.nodes = np.stack(columns, axis=1)

    def _counted(self, stream: Stream) -> tuple[Stream, int]:
        assert isinstance(stream, Binary)
        line, _, rest = stream.body.partition(b"\n")
        return self.stream(rest), int(line)

    def _nodes4(self, stream: Stream) -> None:
        tags, nodes = [np.empty(0, np.int64)], [np.empty((0, 3))]
        for _ in range(int(stream.take("s", 4)[0])):
            dim, _, parametric = stream.take("i", 3).tolist()
            count = int(stream.take("s", 1)[0])
            tags.append(stream.take("s", count))
            width = 3 + (dim if parametric and 0 < dim <= 3 else 0)
            nodes.append(stream.take("d", count * width).reshape(count, width)[:, :3])
        self.tags, self.nodes = np.concatenate(tags), np.concatenate(nodes)

    def _type(self, number: int) -> tuple[str, int]:
        if number not in TYPES:
            raise fault(self.path, f"elements must be of a known type; got Gmsh type {number}")
        return TYPES[number]

    def _elements4(self, stream: Stream) -> None:
        for _ in range(int(stream.take("s", 4)[0])):
            dim, entity, number = stream.take("i", 3).tolist()
            count = int(stream.take("s", 1)[0])
            name, width = self._type(number)
            table = stream.take("s", count * (width + 1)).reshape(count, width + 1)
            groups = {(dim, group): np.ones(count, bool) for group in self.physical.get((dim, entity), [])}
            self.elements.append(_Elements(name, table[:, 0], table[:, 1:], groups))

    def _elements2(self, stream: Stream) -> None:
        if self.binary:
            stream, total = self._counted(stream)
            while total > 0:
                number, count, labels = stream.take("i", 3).tolist()
                if count < 1 or labels < 0:
                    raise ValueError(f"a block of elements must have elements; got {count}")
                name, width = self._type(number)
                table = stream.take("i", count * (1 + labels + width)).reshape(count, -1)
                self._add2(name, table, labels)
                total -= count
            return
        assert isinstance(stream, Text)
        total, numbers = int(stream.take("s", 1)[0]), stream.take("i", len(stream.numbers) - 1)
        flat, at = numbers.tolist(), 0
        starts: dict[tuple[int, int], list[int]] = {}
        for _ in range(total):
            number, labels = flat[at + 1], flat[at + 2]
            width = self._type(number)[1]
            if labels < 0 or at + 3 + labels + width > len(flat):
                raise ValueError(f"{total} elements are announced, and the section ends before")
            starts.setdefault((number, labels), []).append(at)
            at += 3 + labels + width
        for (number, labels), first in starts.items():
            name, width = TYPES[number]
            table = numbers[np.array(first)[:, None] + np.arange(3 + labels + width)]
            self._add2(name, np.delete(table, (1, 2), axis=1), labels)

    def _add2(self, name: str, table: np.ndarray, labels: int) -> None:
        """Elements of version 2: rows (tag, labels, nodes). The first label is the physical group, 0 for none."""
        shape = SHAPES.get(SECOND_ORDER.get(name, name))
        dim = 3 if shape is None else shape.dim
        groups = {}
        if labels:
            for group in np.unique(np.abs(table[:, 1])).tolist():
                if group:
                    groups[dim, group] = np.abs(table[:, 1]) == group
        self.elements.append(_Elements(name, table[:, 0], table[:, 1 + labels :], groups))

    def _view(self, body: bytes) -> _View:
        heads = []
        for _ in range(3):
            line, _, body = body.partition(b"\n")
            words = []
            for _ in range(int(line)):
                word, mark, body = body.partition(b"\n")
                if not mark:
                    raise ValueError("the head of a view is cut off")
                words.append(word.strip().strip(b'"').decode("utf-8", "replace"))
            heads.append(words)
        strings, reals, integers = heads
        width, count = int(integers[1]), int(integers[2])
        if width < 1 or width > 9:
            raise ValueError(f"a view must have 1 to 9 components; got {width}")
        tags, *columns = self.stream(body).rows(count, "i" + width * "d")
        values = columns[0] if width == 1 else np.stack(columns, axis=1)
        return _View(strings[0] if strings else "view", float(reals[0]) if reals else 0.0, tags, values)


def _mesh(reader: _Reader) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """The mesh, tags of all elements in the file, and the number of the cell that each became."""
    mesh = Mesh(reader.nodes, notes=list(dict.fromkeys(reader.notes)))
    parts: dict[str, list[_Elements]] = {}
    for part in reader.elements:
        parts.setdefault(part.name, []).append(part)
    tags, cells, numbers, first = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [np.empty(0, np.int64)], 0
    members: list[tuple[str, np.ndarray]] = []
    for name, blocks in parts.items():
        given = np.concatenate([block.nodes for block in blocks])
        nodes = places(reader.path, reader.tags, given.reshape(-1), "node").reshape(given.shape)
        number = np.arange(len(nodes))
        if reader.version == 2:  # elements of several groups stand in the file once for each group
            _, once, same = np.unique(keys(nodes), return_index=True, return_inverse=True)
            kept = np.sort(once)
            number = np.searchsorted(kept, once[same])
            nodes = nodes[kept]
        mesh.blocks.append((name, nodes))
        tags.append(np.concatenate([block.tags for block in blocks]))
        numbers.append(tags[-1] if reader.version != 2 else tags[-1][kept])
        cells.append(first + number)
        at = 0
        for block in blocks:
            here = cells[-1][at : at + len(block.tags)]
            at += len(block.tags)
            for (dim, group), mask in block.groups.items():
                words = DIMENSIONS[dim] if 0 <= dim < 4 else "group"
                members.append((reader.names.get((dim, group), f"{words} {group}"), here[mask]))
        first += len(nodes)
    check_sets(reader.path, len({label for label, _ in members}), first)
    for label, where in members:
        mesh.cell_sets.setdefault(label, np.zeros(first, bool))[where] = True
    mesh.numbers = np.concatenate(numbers)
    return mesh, np.concatenate(tags), np.concatenate(cells)


def states(path: Path) -> States:
    """The states of a Gmsh file: the times of its views if there are several, else one state."""
    with readable(path, WHAT):
        reader = _Reader(path)
        if not reader.body.lstrip().startswith(b"$"):
            raise fault(path, f"a {WHAT} must start with $MeshFormat; got {reader.body[:20]!r}")
        mesh, tags, cells = _mesh(reader)
    views = [*reader.views["NodeData"], *reader.views["ElementData"]]
    times = tuple(sorted({view.time for view in views}))
    steps: dict[str, int] = {}
    for view in views:
        steps[view.name] = steps.get(view.name, 0) + 1

    def at(state: int) -> Contents:
        now = Mesh(mesh.nodes, mesh.blocks, cell_sets=mesh.cell_sets, notes=mesh.notes, numbers=mesh.numbers)
        count = sum(len(nodes) for _, nodes in mesh.blocks)
        with readable(path, WHAT):
            for kind, total, fields in (
                ("NodeData", len(mesh.nodes), now.node_fields),
                ("ElementData", count, now.cell_fields),
            ):
                chosen = [v for v in reader.views[kind] if steps[v.name] == 1 or v.time == times[state]]
                check_sets(path, sum(view.values[:1].size for view in chosen), total)
                for view in chosen:
                    values = np.full((total, *view.values.shape[1:]), np.nan)
                    if kind == "NodeData":
                        where = places(path, reader.tags, view.tags, "node")
                    else:
                        where = cells[places(path, tags, view.tags, "element")]
                    values[where] = view.values
                    fields[view.name] = values
            return contents(now, path)

    return States(times if len(times) > 1 else (), at)
