"""Sums over the neighbours of every point, without arrays over all bonds.

`neighbour_sums` goes through the points in the order of the search tree, which keeps points that are near each other
together. It finds about `BONDS` bonds at a time and adds them to the results: counts, shape tensors, connected
pieces, lengths next to the horizon. The memory grows with the number of points only, apart from the lengths within 2 %
of the horizon.

The shape tensor here has the influence 1, K = Σ V ξ⊗ξ. It tells whether the bonds of a point span all directions.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .neighbour_search import bond_vectors, in_box, search_tree
from .points import Points
from .ties import BAND, tie_radius

BONDS = 2_000_000  # bonds that are found at a time; their arrays take about 200 MB
FIRST = 1.12  # radius over horizon of the first search: it holds the next shell of a lattice for N = 2, 3, 4, …
LAST = 1.5  # radius over horizon within which a bond beyond the horizon is looked for


@dataclass(frozen=True)
class NeighbourSums:
    """What `neighbour_sums` finds.

    `count` (points,) is the number of neighbours, `shape` (points, dim, dim) is K [length^(2 + dim)], and `piece`
    (points,) is the number of the connected piece, where piece 0 is the largest one. `lengths` are those of the pairs
    within 2 % of the horizon. `below` and `above` are the lengths next to the horizon, as in `NeighbourReport`.
    """

    count: np.ndarray
    shape: np.ndarray
    piece: np.ndarray
    lengths: np.ndarray
    at_horizon: int
    below: float
    above: float


def _bonds_within(body: Points, radius: float) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """i, j and X_j − X_i of all directed bonds within `radius`, for some points i at a time."""
    from scipy.spatial import cKDTree

    tree, X, box = search_tree(body, radius)
    sample = X[:: max(1, len(body) // 1000)]
    most = int(tree.query_ball_point(sample, radius, return_length=True).max())
    chunk = max(1, BONDS // most)
    for at in range(0, len(body), chunk):
        some = tree.indices[at : at + chunk]
        part = cKDTree(X[some], boxsize=box)
        # Points at the distance 0 are the points themselves: `search_tree` has refused points that coincide.
        near = part.sparse_distance_matrix(tree, radius, output_type="ndarray")
        i, j = some[near["i"]], near["j"]
        other = i != j
        i, j = i[other], j[other]
        yield i, j, bond_vectors(body, box, i, j)


def _joined(piece: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """The pieces after the bonds (i, j) have joined them."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    a, b = piece[i], piece[j]
    differ = a != b
    a, b = a[differ], b[differ]
    pieces = int(piece.max()) + 1
    graph = coo_array((np.ones(len(a), np.int8), (a, b)), shape=(pieces, pieces))
    _, found = connected_components(graph, directed=False)
    return found[piece]


def _by_size(piece: np.ndarray) -> np.ndarray:
    """The same pieces, numbered from the largest to the smallest. Pieces of one size keep their order."""
    sizes = np.bincount(piece)
    number = np.empty(len(sizes), np.int32)
    number[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    return number[piece]


def _limit(body: Points, horizon: float) -> float:
    """The largest radius of a search: `LAST` horizons, or less in a short periodic box."""
    if body.period is None or min(body.period) > 2 * LAST * horizon:
        return LAST * horizon
    return max(tie_radius(body, horizon), min(horizon * (1 + BAND), 0.499 * min(body.period)))


def neighbour_sums(body: Points, horizon: float) -> NeighbourSums:
    """Compute the sums over all bonds within the horizon.

    Raises ValueError if points coincide, or if a periodic box is not longer than two horizons.
    """
    radius, limit = tie_radius(body, horizon), _limit(body, horizon)
    wide = min(limit, max(radius, FIRST * horizon))
    points, dim = len(body), body.dim
    count, shape = np.zeros(points, np.int64), np.zeros((points, dim, dim))
    piece, near = np.arange(points), []
    at_horizon, below, above = 0, 0.0, np.inf
    for i, j, vectors in _bonds_within(body, wide):
        lengths = np.linalg.norm(vectors, axis=1)
        within = lengths <= radius
        once = i < j
        near.append(lengths[once & (abs(lengths - horizon) <= BAND * horizon)])
        at_horizon += int((once & (abs(lengths - horizon) <= radius - horizon)).sum())
        above = min(above, float(lengths[~within].min(initial=np.inf)))
        i, j, vectors = i[within], j[within], vectors[within]
        below = max(below, float(lengths[within].max(initial=0.0)))
        count += np.bincount(i, minlength=points)
        for a in range(dim):
            for b in range(a, dim):
                shape[:, a, b] += np.bincount(i, body.volumes[j] * vectors[:, a] * vectors[:, b], points)
        piece = _joined(piece, i, j)
    for a in range(dim):
        shape[:, a, :a] = shape[:, :a, a]
    if not np.isfinite(above) and limit > wide:
        for _, _, vectors in _bonds_within(body, limit):
            lengths = np.linalg.norm(vectors, axis=1)
            above = min(above, float(lengths[lengths > radius].min(initial=np.inf)))
    return NeighbourSums(count, shape, _by_size(piece), np.concatenate(near), at_horizon, below, above)


def nearest_distances(body: Points) -> np.ndarray:
    """Distance of the nearest other point [length], shape (points,), inf for a single point.

    It does not see the images of the point itself in a periodic box.
    """
    from scipy.spatial import cKDTree

    X, box = in_box(body)
    distances, _ = cKDTree(X, boxsize=box).query(X, k=2)
    return distances[:, 1]


def joining_horizon(body: Points, piece: np.ndarray) -> float:
    """A horizon [length] that joins all pieces to the largest one, piece 0."""
    from scipy.spatial import cKDTree

    X, box = in_box(body)
    away, _ = cKDTree(X[piece == 0], boxsize=box).query(X)
    gap = np.full(int(piece.max()) + 1, np.inf)
    np.minimum.at(gap, piece, away)
    return float(gap[1:].max(initial=0.0))
