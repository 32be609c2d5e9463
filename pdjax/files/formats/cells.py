"""Cells of a mesh as points: centroids, volumes, weights of the nodes, and the facets that two cells share.

A cell of dimension d becomes a point at its centroid, with the length, area or volume of the cell. The shape functions
N_a of its corners give the volume V = ∫ det J dξ, the weights w_a = ∫ N_a det J dξ / V and the centroid Σ_a w_a x_a.
Two Gauss points an axis integrate these exactly for plane quadrilaterals and for hexahedra with bilinear faces. A nodal
field f becomes Σ_a w_a f_a. This is the mean of its interpolation over the cell, so a field that is linear in the
position keeps its values. For lines, triangles and tetrahedra every weight is 1 / corners.

Surfaces may lie in any plane. The area of a quadrilateral that is not plane is that of its projection onto the plane of
its diagonals.
"""

from itertools import product
from typing import NamedTuple

import numpy as np


class Shape(NamedTuple):
    """A type of cell: its dimension, its number of corners, and the corners of its facets of each dimension."""

    dim: int
    corners: int
    facets: dict[int, tuple[tuple[int, ...], ...]]


_EDGES_OF_QUAD = ((0, 1), (1, 2), (2, 3), (3, 0))
SHAPES = {
    "vertex": Shape(0, 1, {}),
    "line": Shape(1, 2, {0: ((0,), (1,))}),
    "triangle": Shape(2, 3, {1: ((0, 1), (1, 2), (2, 0)), 0: ((0,), (1,), (2,))}),
    "quadrilateral": Shape(2, 4, {1: _EDGES_OF_QUAD, 0: ((0,), (1,), (2,), (3,))}),
    "tetrahedron": Shape(
        3,
        4,
        {
            2: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
            1: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
            0: ((0,), (1,), (2,), (3,)),
        },
    ),
    "hexahedron": Shape(
        3,
        8,
        {
            2: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
            1: (*_EDGES_OF_QUAD, (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
            0: tuple((a,) for a in range(8)),
        },
    ),
}
# Types of second order, which are read by their corners. The corners come first in every format.
SECOND_ORDER = {
    "line3": "line",
    "triangle6": "triangle",
    "triangle7": "triangle",
    "quadrilateral8": "quadrilateral",
    "quadrilateral9": "quadrilateral",
    "tetrahedron10": "tetrahedron",
    "hexahedron20": "hexahedron",
    "hexahedron27": "hexahedron",
}
_SIGNS = {
    2: np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]),
    3: np.array([[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1], [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]),
}


class Measured(NamedTuple):
    """Signed volumes of cells, (cells,), and the weights of their corners, (cells, corners)."""

    volumes: np.ndarray
    weights: np.ndarray


def measured(shape: str, corners: np.ndarray) -> Measured:
    """Volumes and weights of cells of one type, from their corners (cells, corners, 3)."""
    edges = corners[:, 1:] - corners[:, :1]  # relative to a corner, so that a far origin costs no digits
    equal = np.full(corners.shape[:2], 1 / corners.shape[1])
    if shape == "vertex":
        return Measured(np.zeros(len(corners)), equal)
    if shape == "line":
        return Measured(np.linalg.norm(edges[:, 0], axis=1), equal)
    if shape == "triangle":
        normal = np.cross(edges[:, 0], edges[:, 1])
        return Measured(_sense(normal) * np.linalg.norm(normal, axis=1) / 2, equal)
    if shape == "tetrahedron":
        return Measured(np.einsum("ci,ci->c", np.cross(edges[:, 0], edges[:, 1]), edges[:, 2]) / 6, equal)
    return _by_quadrature(SHAPES[shape].dim, corners - corners[:, :1])


def _sense(normal: np.ndarray) -> np.ndarray:
    """+1 or −1: the sign of the largest component of a normal, so that cells of one plane can be compared."""
    largest = np.argmax(np.abs(normal), axis=1)
    return np.where(np.take_along_axis(normal, largest[:, None], 1)[:, 0] < 0, -1.0, 1.0)


def _by_quadrature(dim: int, corners: np.ndarray) -> Measured:
    """Volumes and weights of quadrilaterals or hexahedra by two Gauss points an axis, each of weight 1."""
    signs = _SIGNS[dim]
    unit, sense = np.zeros((len(corners), 3)), np.ones(len(corners))
    if dim == 2:
        normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
        length = np.linalg.norm(normal, axis=1)
        unit, sense = normal / np.where(length > 0, length, 1)[:, None], _sense(normal)
    volumes, moments = np.zeros(len(corners)), np.zeros(corners.shape[:2])
    for point in product((-(3**-0.5), 3**-0.5), repeat=dim):
        factors = (1 + signs * np.array(point)) / 2
        values = factors.prod(axis=1)
        gradients = np.stack([signs[:, a] / 2 * np.delete(factors, a, 1).prod(axis=1) for a in range(dim)])
        tangents = np.einsum("ka,cai->kci", gradients, corners)
        third = tangents[2] if dim == 3 else unit
        weight = np.einsum("ci,ci->c", np.cross(tangents[0], tangents[1]), third)
        volumes += weight
        moments += weight[:, None] * values
    weights = moments / np.where(volumes != 0, volumes, 1)[:, None]
    return Measured(volumes * sense, weights)


class Facets(NamedTuple):
    """Facets of cells: sorted node numbers (facets, nodes) and the cell of each (facets,)."""

    nodes: np.ndarray
    cells: np.ndarray


def facets(blocks: list[tuple[str, np.ndarray]], dim: int, count: int) -> Facets:
    """Facets of dimension `dim` that have `count` nodes, of all cells in order."""
    nodes, cells, first = [np.empty((0, count), np.int64)], [np.empty(0, np.int64)], 0
    for shape, corners in blocks:
        for facet in SHAPES[shape].facets.get(dim, ()):
            if len(facet) == count:
                nodes.append(np.sort(corners[:, facet], axis=1))
                cells.append(first + np.arange(len(corners)))
        first += len(corners)
    return Facets(np.concatenate(nodes), np.concatenate(cells))


def keys(rows: np.ndarray) -> np.ndarray:
    """A number for every row of node numbers, the same for equal rows. Much faster than np.unique(rows, axis=0)."""
    many = int(rows.max(initial=0)) + 1
    key = rows[:, 0].astype(np.int64)
    for column in rows[:, 1:].T:
        if key.max(initial=0) >= 2**62 // many:  # renumber before the product could overflow
            _, key = np.unique(key, return_inverse=True)
        key = key * many + column
    return key


def outer(of: Facets) -> Facets:
    """The facets that belong to one cell only: the surface of the body."""
    _, inverse, counts = np.unique(keys(of.nodes), return_inverse=True, return_counts=True)
    alone = counts[inverse] == 1
    return Facets(of.nodes[alone], of.cells[alone])


def cells_at(blocks: list[tuple[str, np.ndarray]], shape: str, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a lower-dimensional element and a cell that has it as a facet: their numbers, from 0.

    `blocks` are the cells, and `corners` (elements, corners) the elements of type `shape`.
    """
    of = facets(blocks, SHAPES[shape].dim, corners.shape[1])
    key = keys(np.concatenate([np.sort(corners, axis=1), of.nodes]))
    order = np.argsort(key[: len(corners)], kind="stable")
    ordered, wanted = key[order], key[len(corners) :]
    first, last = np.searchsorted(ordered, wanted), np.searchsorted(ordered, wanted, side="right")
    count = last - first
    inner = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return order[np.repeat(first, count) + inner], np.repeat(of.cells, count)
