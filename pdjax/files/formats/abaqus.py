"""Meshes in input files of Abaqus, CalculiX and Gmsh (NAME.inp).

Nodes, elements, node sets and element sets are read, other keywords are passed over. The file may hold one part and one
instance of it. Files that *INCLUDE names are not opened, because a file from elsewhere must not choose what is read.

Source: Abaqus documentation, "Input Syntax Rules" and the keywords *NODE, *ELEMENT, *NSET, *ELSET.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..contents import Contents, States
from ..faults import fault, places, readable
from .meshes import Mesh, check_sets, contents

WHAT = "Abaqus input file"
_SOLIDS = {
    4: "tetrahedron",
    10: "tetrahedron10",
    8: "hexahedron",
    20: "hexahedron20",
    27: "hexahedron27",
    6: "wedge",
    15: "wedge15",
    5: "pyramid",
}
_PLANES = {3: "triangle", 4: "quadrilateral", 6: "triangle6", 8: "quadrilateral8", 9: "quadrilateral9"}
# Keywords that make nodes or elements by rules, or read other files.
_REFUSED = ("INCLUDE", "NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")


class _Block(NamedTuple):
    """A keyword, its parameters in capitals, its data lines, and the number of its line."""

    keyword: str
    parameters: dict[str, str]
    lines: list[str]
    line: int


def _blocks(path: Path) -> Iterator[_Block]:
    """The keywords of a file with their data lines, without comments."""
    now, head = _Block("", {}, [], 0), ""
    for number, line in enumerate(path.read_bytes().decode("utf-8", "replace").splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if line.startswith("*") or head:
            head += line
            if head.endswith(","):  # the keyword goes on in the next line
                continue
            yield now
            keyword, *words = head[1:].split(",")
            pairs = (word.partition("=") for word in words if word.strip())
            parameters = {key.strip().upper(): value.strip().strip('"') for key, _, value in pairs}
            now, head = _Block(" ".join(keyword.upper().split()), parameters, [], number), ""
        else:
            now.lines.append(line)
    yield now


def _type(path: Path, block: _Block) -> tuple[str, int]:
    """Name of a type of elements and its number of nodes."""
    kind = block.parameters.get("TYPE", "").upper()
    for pattern, known in (
        (r"(?:C|DC|AC)3D(\d+)", _SOLIDS),
        (r"SC(\d+)R", _SOLIDS),
        (r"STRI(3|6)", _PLANES),
        (r"(?:CPS|CPE|CPEG|CAX|CGAX|DC2D|DCAX|AC2D|ACAX|S|DS|M3D|R3D|SFM3D)(\d+)", _PLANES),
        (r"T[23]D(\d)", {2: "line", 3: "line3"}),
    ):
        found = re.match(pattern, kind)
        if found:
            nodes = int(found.group(1))
            return known.get(nodes, kind), nodes
    if found := re.match(r"B[23]([123])", kind):
        return ("line3", 3) if found.group(1) == "2" else ("line", 2)
    if kind in ("MASS", "ROTARYI"):
        return "vertex", 1
    raise fault(
        path, f"line {block.line}: elements must be of a continuum, shell or truss type; got {kind or 'no TYPE'}"
    )


class _Reader:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.labels: list[int] = []
        self.nodes: list[list[float]] = []
        self.elements: list[tuple[str, np.ndarray]] = []  # type, and rows of element and node numbers
        self.sets: dict[str, dict[str, str]] = {"NSET": {}, "ELSET": {}}  # names by names in capitals
        self.members: list[tuple[str, str, list]] = []  # keyword, name in capitals, what is added to the set
        self.parts = self.instances = 0
        known = False
        for block in _blocks(path):
            keyword = block.keyword
            known = known or bool(keyword)
            if keyword in _REFUSED:
                raise fault(path, f"line {block.line}: *{keyword} is not read. Write the whole mesh into one file")
            if keyword == "NODE":
                self._nodes(block)
            elif keyword == "ELEMENT":
                self._elements(block)
            elif keyword in self.sets:
                self._set(keyword, block)
            elif keyword == "PART":
                self.parts += 1
            elif keyword == "INSTANCE":
                self._instance(block)
            if max(self.parts, self.instances) > 1:
                raise fault(path, f"line {block.line}: a file must hold one part and one instance. Merge the parts")
        if not known or not self.nodes:
            raise fault(path, f"an {WHAT} must hold nodes after *NODE; it holds none")

    def _nodes(self, block: _Block) -> None:
        for line in block.lines:
            words = line.rstrip(",").split(",")
            self.labels.append(int(words[0]))
            self.nodes.append([float(word) if word.strip() else 0.0 for word in words[1:4]])
        self._member("NSET", block, [int(line.split(",")[0]) for line in block.lines])

    def _elements(self, block: _Block) -> None:
        name, width = _type(self.path, block)
        numbers = [int(word) for line in block.lines for word in line.split(",") if word.strip()]
        if len(numbers) % (width + 1):
            kind = block.parameters["TYPE"]
            raise fault(
                self.path,
                f"line {block.line}: elements of type {kind} must have a number and {width} nodes each; got"
                f" {len(numbers)} numbers in all",
            )
        table = np.array(numbers, np.int64).reshape(-1, width + 1)
        self.elements.append((name, table))
        self._member("ELSET", block, [table[:, 0]])

    def _member(self, kind: str, block: _Block, labels: list) -> None:
        """Add labels to the set that a keyword names. Names differ not by capitals."""
        if name := block.parameters.get(kind):
            self.sets[kind].setdefault(name.upper(), name)
            self.members.append((kind, name.upper(), labels))

    def _set(self, kind: str, block: _Block) -> None:
        members: list = []
        for line in block.lines:
            words = [word.strip().strip('"') for word in line.split(",") if word.strip()]
            if "GENERATE" in block.parameters:
                first, last, step = (*map(int, words), 1)[:3]
                if step < 1:
                    raise fault(self.path, f"line {block.line}: the step of GENERATE must be 1 or more; got {step}")
                members.append((first, last, step))
                continue
            for word in words:
                word = word.rpartition(".")[2]  # "PART-1-1.7" is entry 7 of an instance
                if word.isdigit():
                    members.append(int(word))
                elif word.upper() in self.sets[kind]:
                    members.append(word.upper())
                else:
                    raise fault(self.path, f"line {block.line}: a set must name earlier sets or numbers; got {word!r}")
        if kind not in block.parameters:
            raise fault(self.path, f"line {block.line}: *{kind} must have a name, {kind}=; it has none")
        self._member(kind, block, members)

    def _instance(self, block: _Block) -> None:
        self.instances += 1
        if any(float(word or 0) for line in block.lines for word in line.split(",")):
            raise fault(self.path, f"line {block.line}: the instance must not be moved or turned; use the part itself")

    def mesh(self) -> Mesh:
        width = max(map(len, self.nodes))
        mesh = Mesh(np.array([row + [0.0] * (width - len(row)) for row in self.nodes], float))
        labels, numbers = np.array(self.labels, np.int64), [np.empty(0, np.int64)]
        for name, table in self.elements:
            at = places(self.path, labels, table[:, 1:].reshape(-1), "node").reshape(len(table), -1)
            mesh.blocks.append((name, at))
            numbers.append(table[:, 0])
        mesh.numbers = np.concatenate(numbers)
        places(self.path, mesh.numbers, mesh.numbers[:1], "element")  # refuses elements that are defined twice
        tables = {"NSET": (labels, mesh.node_sets), "ELSET": (mesh.numbers, mesh.cell_sets)}
        for kind, (known, _) in tables.items():
            check_sets(self.path, len(self.sets[kind]), len(known))
        for kind, name, members in self.members:
            known, masks = tables[kind]
            whole = {word: masks[self.sets[kind][word]] for word in members if isinstance(word, str)}
            mask = _mask(known, members, whole)
            label = self.sets[kind][name]
            masks[label] = masks[label] | mask if label in masks else mask
        return mesh


def _mask(known: np.ndarray, members: list, whole: dict[str, np.ndarray]) -> np.ndarray:
    """Mask of what a set lists: single numbers, arrays, triples (first, last, step) and masks of other sets."""
    single = [member for member in members if isinstance(member, int)]
    mask = np.isin(known, single)
    for member in members:
        if isinstance(member, str):
            mask |= whole[member]
        elif isinstance(member, np.ndarray):
            mask |= np.isin(known, member)
        elif isinstance(member, tuple):
            first, last, step = member
            mask |= (known >= first) & (known <= last) & ((known - first) % step == 0)
    return mask


def states(path: Path) -> States:
    """The mesh of an Abaqus input file."""

    def at(state: int) -> Contents:
        with readable(path, WHAT):
            return contents(_Reader(path).mesh(), path)

    return States((), at)
