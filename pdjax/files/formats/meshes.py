"""From a mesh to points: what the readers of Gmsh, VTK, Exodus and Abaqus files share.

Cells
    Every cell of the highest dimension becomes a point at its centroid, with its length, area or volume. `cells` gives
    the formulas. Nodal fields are averaged over the cell, cell fields stay as they are. Triangles and quadrilaterals
    may be mixed, and so may tetrahedra and hexahedra. Cells of second order are read by their corners.
Clouds
    If a file has no cells, or only vertices, its nodes are the points. A nodal or cell field "volume" is their volume.
Sets
    A set of cells (block, physical group, element set) is a mask of its cells. If a group has cells of a lower
    dimension, such as a physical curve "left" around a surface, its mask holds the cells that have one of these as a
    facet. These are the cells to support or to load. A cell is in a set of nodes if all its nodes are in the set, or
    all nodes of one of its facets on the surface of the body.

Coordinates stay as the file gives them: a plane mesh of a format that knows only three coordinates has three.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..contents import Contents
from ..faults import fault
from .cells import SECOND_ORDER, SHAPES, cells_at, facets, measured, outer

# A cell is degenerate if its volume is smaller than this part of the volume that its longest diagonal allows.
DEGENERATE = 1e-13
# Most entries of all masks together. A file of a few megabytes can name enough sets to fill any memory.
MOST_MARKS = 10**9
VOLUME_NAMES = ("volume", "volumes")
# A field "set:NAME" of zeros and ones is the set NAME. `pdjax.files.vtk` writes sets so, because VTK has none.
SET = "set:"


def check_sets(path: Path, sets: int, entries: int) -> None:
    """Raise ValueError if sets (or fields) of so many entries would take more memory than is reasonable."""
    if sets * entries > max(MOST_MARKS, path.stat().st_size):
        raise fault(path, f"at most {MOST_MARKS:.0e} entries of sets or fields are read; got {sets} of {entries}")


@dataclass
class Mesh:
    """A mesh as the readers of the formats give it.

    Attributes
    ----------
    nodes : array, shape (nodes, 1 to 3)
        Coordinates of the nodes.
    blocks : list of (str, array)
        Type of the cells, a key of SHAPES or SECOND_ORDER or any other word, and their nodes (cells, nodes of a cell).
    node_fields, cell_fields : dict of str to array
        Fields of the nodes, and of the cells of all blocks in order.
    node_sets, cell_sets : dict of str to array of bool
        Masks of the nodes, and of the cells of all blocks in order.
    notes : list of str
        Sentences for the user.
    numbers : array of int, shape (cells,), or None
        Number of each cell in the file. The points get this order, and errors use it. None: 0, 1, …
    """

    nodes: np.ndarray
    blocks: list[tuple[str, np.ndarray]] = field(default_factory=list)
    node_fields: dict[str, np.ndarray] = field(default_factory=dict)
    cell_fields: dict[str, np.ndarray] = field(default_factory=dict)
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)
    cell_sets: dict[str, np.ndarray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    numbers: np.ndarray | None = None


def contents(mesh: Mesh, path: Path) -> Contents:
    """The points of a mesh. Raises ValueError if a cell has a type, a node or a volume that cannot be used."""
    mesh = _with_sets(mesh)
    _check_fields(mesh, path)
    blocks = _corners(mesh, path)
    dim = max((SHAPES[shape].dim for shape, corners in blocks if len(corners)), default=0)
    with np.errstate(all="ignore"):  # a field may hold NaN, and volumes that overflow are refused
        return _cloud(mesh, blocks, path) if dim == 0 else _body(mesh, blocks, dim, path)


def _with_sets(mesh: Mesh) -> Mesh:
    """The mesh with its fields "set:NAME" as sets NAME, and with lists of its own."""
    nodes, cells = dict(mesh.node_fields), dict(mesh.cell_fields)
    node_sets, cell_sets = dict(mesh.node_sets), dict(mesh.cell_sets)
    for fields, sets in ((nodes, node_sets), (cells, cell_sets)):
        for name in [name for name, values in fields.items() if name.startswith(SET) and values.size == len(values)]:
            sets[name.removeprefix(SET)] = fields.pop(name).reshape(-1) != 0
    numbers = np.arange(sum(len(n) for _, n in mesh.blocks)) if mesh.numbers is None else mesh.numbers
    return Mesh(mesh.nodes, mesh.blocks, nodes, cells, node_sets, cell_sets, list(mesh.notes), numbers)


def _check_fields(mesh: Mesh, path: Path) -> None:
    cells = sum(len(nodes) for _, nodes in mesh.blocks)
    for kind, many, count in (
        ("nodes", mesh.node_fields | mesh.node_sets, len(mesh.nodes)),
        ("cells", mesh.cell_fields | mesh.cell_sets, cells),
    ):
        for name, values in many.items():
            if len(values) != count:
                raise fault(path, f"field {name!r} must have a value for each of the {count} {kind}; got {len(values)}")
    if not len(mesh.nodes):
        raise fault(path, "a mesh must have at least one node; it has none")


def _corners(mesh: Mesh, path: Path) -> list[tuple[str, np.ndarray]]:
    """Blocks of supported types, reduced to their corners. Checks the numbers of the nodes."""
    refused: dict[str, int] = {}
    reduced: dict[str, int] = {}
    blocks, first = [], 0
    for name, nodes in mesh.blocks:
        shape = SECOND_ORDER.get(name, name)
        if shape not in SHAPES:
            refused[name] = refused.get(name, 0) + len(nodes)
            continue
        corners = np.asarray(nodes)[:, : SHAPES[shape].corners].astype(np.int64)
        if corners.shape[1] < SHAPES[shape].corners:
            raise fault(path, f"a {shape} must have {SHAPES[shape].corners} nodes; got {corners.shape[1]}")
        wrong = np.flatnonzero(((corners < 0) | (corners >= len(mesh.nodes))).any(axis=1))
        if wrong.size:
            raise fault(
                path,
                f"cell {numbered(mesh, first + int(wrong[0]))} must be made of the {len(mesh.nodes)} nodes of the file,"
                f" counted from 0; got {corners[wrong[0]].tolist()}",
            )
        if shape != name:
            reduced[name] = reduced.get(name, 0) + len(nodes)
        blocks.append((shape, corners))
        first += len(nodes)
    if refused:
        words = ", ".join(f"{count} {name}" for name, count in sorted(refused.items()))
        raise fault(
            path,
            f"cells must be vertices, lines, triangles, quadrilaterals, tetrahedra or hexahedra; got {words}."
            " Divide these cells into tetrahedra or triangles in the mesh generator",
        )
    mesh.notes += [
        f"{count} cells of type {name} are reduced to their corners." for name, count in sorted(reduced.items())
    ]
    return blocks


def numbered(mesh: Mesh, cell: int) -> int:
    """The number that a cell has in the file."""
    return cell if mesh.numbers is None else int(mesh.numbers[cell])


def _volume_name(fields: dict[str, np.ndarray], count: int) -> str | None:
    """Name of the field that holds volumes."""
    for name, values in fields.items():
        if name.lower() in VOLUME_NAMES and values.size == count:
            return name
    return None


def _cloud(mesh: Mesh, blocks: list[tuple[str, np.ndarray]], path: Path) -> Contents:
    """Nodes as points. Fields of vertex cells go to the nodes of these cells."""
    count, notes = len(mesh.nodes), list(dict.fromkeys(mesh.notes))
    vertices = np.concatenate([np.empty(0, np.int64), *(corners[:, 0] for _, corners in blocks)])
    chosen = np.arange(count)
    if len(vertices):
        chosen = np.unique(vertices)
        if len(chosen) < len(vertices):
            raise fault(path, f"every point must have one vertex cell; got {len(vertices)} for {len(chosen)} points")
        if len(chosen) < count:
            notes.append(f"{count - len(chosen)} of {count} nodes are left out, because no vertex cell uses them.")
    order = np.argsort(vertices, kind="stable")
    fields = {name: values[order] for name, values in mesh.cell_fields.items()} if len(vertices) else {}
    fields |= {name: values[chosen] for name, values in mesh.node_fields.items()}
    sets = {name: mask[chosen] for name, mask in mesh.node_sets.items()}
    if len(vertices):
        sets |= {name: mask[order] for name, mask in mesh.cell_sets.items()}
    name = _volume_name(fields, len(chosen))
    volumes = None if name is None else fields.pop(name).reshape(-1)
    return Contents(mesh.nodes[chosen], volumes, fields, sets, lambda point: f"node {int(chosen[point])}", tuple(notes))


def _body(mesh: Mesh, blocks: list[tuple[str, np.ndarray]], dim: int, path: Path) -> Contents:
    """Cells of the highest dimension as points."""
    sizes = [len(corners) for _, corners in blocks]
    is_body = np.repeat([SHAPES[shape].dim == dim for shape, _ in blocks], sizes).astype(bool)
    body = [(shape, corners) for shape, corners in blocks if SHAPES[shape].dim == dim and len(corners)]
    number = np.flatnonzero(is_body)  # number of a point's cell among all cells of the file
    used = np.unique(np.concatenate([corners.reshape(-1) for _, corners in body]))
    if not np.isfinite(mesh.nodes[used]).all():
        lost = int(used[np.argmax(~np.isfinite(mesh.nodes[used]).all(axis=1))])
        raise fault(path, f"coordinates must be finite; node {lost} (counted from 0) has {mesh.nodes[lost].tolist()}")
    origin = mesh.nodes[used].mean(axis=0)  # far from the origin, weights that sum to 1 to rounding cost digits
    volumes, weights, notes = _measured(mesh, body, number, path)
    unused = len(mesh.nodes) - len(used)
    if dim == 3 and (volumes < 0).any():
        notes.append(
            f"{int((volumes < 0).sum())} of {len(volumes)} cells are inverted. Their volume counts without its sign."
        )
    if dim == 2 and 0 < (turned := int((volumes < 0).sum())) < len(volumes) and not np.ptp(mesh.nodes[used, 2:]):
        notes.append(f"{turned} of {len(volumes)} cells are numbered clockwise. Their area counts without its sign.")

    def at_centroids(values: np.ndarray) -> np.ndarray:
        flat = np.asarray(values, float).reshape(len(values), -1)
        parts = [np.einsum("ca,cak->ck", w, flat[corners]) for (_, corners), w in zip(body, weights, strict=True)]
        return np.concatenate(parts).reshape(-1, *values.shape[1:])

    order = np.argsort(mesh.numbers[number], kind="stable") if mesh.numbers is not None else np.arange(len(number))
    fields = {name: at_centroids(values) for name, values in mesh.node_fields.items()}
    fields |= {name: values[number] for name, values in mesh.cell_fields.items()}
    sets = _sets(mesh, blocks, body, dim, number)
    if unused and all(name in SHAPES for name, _ in mesh.blocks):
        mesh.notes.append(f"{unused} of {len(mesh.nodes)} nodes belong to no cell of the body and are left out.")
    return Contents(
        (at_centroids(mesh.nodes - origin) + origin)[order],
        np.abs(volumes)[order],
        {name: values[order] for name, values in fields.items()},
        {name: mask[order] for name, mask in sets.items()},
        lambda point: f"cell {numbered(mesh, int(number[order[point]]))}",
        tuple(dict.fromkeys(mesh.notes + notes)),
        dim,
    )


def _measured(
    mesh: Mesh, body: list[tuple[str, np.ndarray]], number: np.ndarray, path: Path
) -> tuple[np.ndarray, list[np.ndarray], list[str]]:
    """Signed volumes of all cells of the body, and the weights of the corners by block."""
    nodes = np.zeros((len(mesh.nodes), 3))
    nodes[:, : mesh.nodes.shape[1]] = mesh.nodes
    volumes, weights, first, warped = [], [], 0, 0
    for shape, corners in body:
        at = nodes[corners]
        now = measured(shape, at)
        reach = np.ptp(at, axis=1).max(axis=1)
        size = np.abs(now.volumes)
        flat = np.flatnonzero(~((size > DEGENERATE * reach ** SHAPES[shape].dim) & np.isfinite(size)))
        if flat.size:
            cell = int(flat[0])
            raise fault(
                path,
                f"every cell must have a finite volume > 0; cell {numbered(mesh, int(number[first + cell]))}, a {shape}"
                f" with nodes {corners[cell].tolist()} (counted from 0), has {now.volumes[cell]:.3g}."
                f" {flat.size} cells are such. Remove them in the mesh generator",
            )
        if shape == "quadrilateral":
            height = np.einsum("ci,ci->c", np.cross(at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]), at[:, 3] - at[:, 0])
            warped += int((np.abs(height) > 1e-6 * reach**3).sum())
        volumes.append(now.volumes)
        weights.append(now.weights)
        first += len(corners)
    words = "quadrilaterals are not plane. Their area is that of the projection onto the plane of their diagonals."
    return np.concatenate(volumes), weights, [f"{warped} {words}"] if warped else []


def _sets(
    mesh: Mesh, blocks: list[tuple[str, np.ndarray]], body: list[tuple[str, np.ndarray]], dim: int, number: np.ndarray
) -> dict[str, np.ndarray]:
    """Masks of the points of all sets, by the rules of the module's docstring."""
    ends = np.cumsum([0, *(len(corners) for _, corners in blocks)])
    sets = {name: mask[number].copy() for name, mask in mesh.cell_sets.items()}
    lower = [k for k, (shape, _) in enumerate(blocks) if SHAPES[shape].dim < dim]
    for k in lower if sets else []:
        elements, cells = cells_at(body, *blocks[k])
        for name, mask in mesh.cell_sets.items():
            sets[name][cells[mask[ends[k] : ends[k + 1]][elements]]] = True
    if mesh.node_sets:
        counts = {1: (1,), 2: (2,), 3: (3, 4)}[dim]
        surface = [outer(facets(body, dim - 1, count)) for count in counts]
        for name, mask in mesh.node_sets.items():
            inside = np.concatenate([mask[corners].all(axis=1) for _, corners in body])
            for of in surface:
                inside[of.cells[mask[of.nodes].all(axis=1)]] = True
            sets[name] = sets[name] | inside if name in sets else inside
    return sets
