"""Volumes of Voronoi cells: the part of a body that is nearer to a point than to any other.

The cells are clipped to the outline of the body: an interval in 1D, a polygon in 2D that need not be convex, and the
convex hull of vertices in 3D. The sum of the volumes is then the volume of the outline.

Qhull computes the cells. Points far away on all axes make every cell bounded, and their own cells do not reach the
outline. The volume of a cell that lies within the outline is the sum of its pyramids: the facet between points p and q
is the base, and half of |p − q| is the height. The other cells are clipped one by one: in 2D by cutting the outline
with the half-planes of the cell [1]_, in 3D by cutting the cell with the half-spaces of the hull.

In a notch of a polygon, a cell may have parts on both sides of the notch.

References
----------
.. [1] I. E. Sutherland and G. W. Hodgman, Reentrant polygon clipping, Communications of the ACM 17 (1974) 32-42.
"""

from typing import NamedTuple

import numpy as np

from .._internal.checks import finite

FAR = 8.0  # distance of the far points, in diameters of the body
TOUCHING = 1e-9  # diameters; a point this close to the outline lies on it


def voronoi_volumes(positions: np.ndarray, outline: object) -> np.ndarray:
    """The volumes (points,) of the Voronoi cells of positions (points, dim) within the outline of the body.

    Raises ValueError if there is no outline, it has the wrong shape, or a point lies outside it.
    """
    dim = positions.shape[1]
    shape = {1: "(2,), the two ends", 2: "(vertices, 2), a polygon", 3: "(vertices, 3), whose convex hull it is"}[dim]
    if outline is None:
        raise ValueError(
            f"the Voronoi cells of the outer points have no end; pass outline= of shape {shape}, or the volumes"
        )
    corners = finite("outline", outline)
    if dim == 1:
        corners = corners.reshape(-1, 1)
    if corners.ndim != 2 or corners.shape[1] != dim or (len(corners) != 2 if dim == 1 else len(corners) <= dim):
        raise ValueError(f"outline must have shape {shape} in {dim}D; got {corners.shape}")
    volumes = (_intervals, _polygons, _polyhedra)[dim - 1](positions, corners)
    if not (volumes > 0).all():
        k = int(np.argmin(volumes))
        raise ValueError(
            f"the Voronoi cell of point {k} within the outline has the volume {volumes[k]:g}; expected > 0; the outline"
            " must not cross itself, and points must be distinct"
        )
    return volumes


def _refuse_outside(distance: np.ndarray, positions: np.ndarray, size: float) -> None:
    """Raise ValueError if a distance to the outline, positive inside, is negative."""
    k = int(np.argmin(distance))
    if distance[k] < -TOUCHING * size:
        count = int((distance < -TOUCHING * size).sum())
        raise ValueError(
            f"every point must lie within the outline; point {k} at {positions[k].tolist()} is {-distance[k]:g} outside"
            f" ({count} such points)"
        )


def _intervals(positions: np.ndarray, ends: np.ndarray) -> np.ndarray:
    x, (low, high) = positions[:, 0], np.sort(ends[:, 0])
    _refuse_outside(np.minimum(x - low, high - x), positions, high - low)
    order = np.argsort(x)
    edges = np.concatenate([[low], (x[order][1:] + x[order][:-1]) / 2, [high]])
    volumes = np.empty(len(x))
    volumes[order] = np.diff(edges)
    return volumes


class _Cells(NamedTuple):
    """Bounded Voronoi cells.

    volumes (points,). radii (points,): distance to the farthest vertex. pairs (ridges, 2): the points on both sides of
    a facet; numbers from `points` on are far points. sites: positions of all points. ridges: vertices of each facet
    in order. vertices: positions.
    """

    volumes: np.ndarray
    radii: np.ndarray
    pairs: np.ndarray
    sites: np.ndarray
    ridges: list[list[int]]
    vertices: np.ndarray


def _cells(positions: np.ndarray, corners: np.ndarray) -> _Cells:
    from scipy.spatial import Voronoi  # imported here because the import takes a third of a second

    points, dim = positions.shape
    both = np.concatenate([positions, corners])
    low, high = both.min(axis=0), both.max(axis=0)
    away = FAR * float(np.linalg.norm(high - low)) * np.eye(dim)
    middle = (low + high) / 2
    sites = np.concatenate([positions, middle + away, middle - away])
    try:
        found = Voronoi(sites - middle)
    except Exception as error:  # Qhull's own error, which has no public class
        raise ValueError(
            f"Qhull finds no Voronoi cells of these points: {str(error).strip().splitlines()[0]}"
        ) from None
    vertices = found.vertices + middle
    real = (found.ridge_points < points).any(axis=1)
    pairs = found.ridge_points[real]
    ridges = [found.ridge_vertices[k] for k in np.flatnonzero(real)]
    count = np.array([len(r) for r in ridges])
    flat = np.concatenate([np.asarray(r) for r in ridges])
    owner = np.repeat(np.arange(len(ridges)), count)
    half = np.linalg.norm(sites[pairs[:, 0]] - sites[pairs[:, 1]], axis=1) / 2
    first = vertices[flat[np.concatenate([[0], np.cumsum(count)[:-1]])]]
    last = np.cumsum(count) - 1
    following = np.roll(flat, -1)
    following[last] = flat[last - count + 1]
    a, b = vertices[flat] - first[owner], vertices[following] - first[owner]
    if dim == 2:
        areas = np.bincount(owner, np.linalg.norm(b - a, axis=1), len(ridges)) / 2  # each edge is counted twice
    else:
        fan = np.cross(a, b) / 2
        areas = np.linalg.norm(np.stack([np.bincount(owner, c, len(ridges)) for c in fan.T], axis=1), axis=1)
    volumes, radii = np.zeros(len(sites)), np.zeros(len(sites))
    for side in (0, 1):
        volumes += np.bincount(pairs[:, side], areas * half / dim, len(sites))
        at = pairs[owner, side]
        np.maximum.at(radii, at, np.linalg.norm(vertices[flat] - sites[at], axis=1))
    return _Cells(volumes[:points], radii[:points], pairs, sites, ridges, vertices)


def _neighbours(pairs: np.ndarray, wanted: np.ndarray) -> dict[int, list[tuple[int, int]]]:
    """For each wanted point, the other point and the number of each of its facets."""
    is_wanted = np.zeros(int(pairs.max()) + 1, dtype=bool)
    is_wanted[wanted] = True
    out: dict[int, list[tuple[int, int]]] = {int(i): [] for i in wanted}
    for side in (0, 1):
        for facet in np.flatnonzero(is_wanted[pairs[:, side]]):
            out[int(pairs[facet, side])].append((int(pairs[facet, 1 - side]), int(facet)))
    return out


def _to_polygon(positions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Distance of points to a polygon, positive inside and negative outside."""
    squared, inside = np.full(len(positions), np.inf), np.zeros(len(positions), dtype=bool)
    x, y = positions.T
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, from_a = b - a, positions - a
        t = np.clip(from_a @ edge / max(float(edge @ edge), np.finfo(float).tiny), 0.0, 1.0)
        squared = np.minimum(squared, ((from_a - t[:, None] * edge) ** 2).sum(axis=1))
        if a[1] != b[1]:
            inside ^= ((a[1] > y) != (b[1] > y)) & (x < a[0] + (y - a[1]) * edge[0] / edge[1])
    return np.where(inside, 1.0, -1.0) * np.sqrt(squared)


def _cut(polygon: np.ndarray, height: np.ndarray) -> np.ndarray:
    """The part of a polygon (vertices, dim) where the heights of its vertices over a plane are ≥ 0."""
    after, above = np.roll(polygon, -1, axis=0), np.roll(height, -1)
    crosses = (height >= 0) != (above >= 0)
    t = np.divide(height, height - above, out=np.zeros_like(height), where=crosses)
    both = np.stack([polygon, polygon + t[:, None] * (after - polygon)], axis=1).reshape(-1, polygon.shape[1])
    return both[np.stack([height >= 0, crosses], axis=1).reshape(-1)]


def _polygons(positions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    distance = _to_polygon(positions, corners)
    _refuse_outside(distance, positions, size)
    cells = _cells(positions, corners)
    volumes, wanted = cells.volumes, np.flatnonzero(distance < cells.radii)
    x, y = (corners - corners[0]).T
    turn = 1.0 if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) > 0 else -1.0
    for i, near in _neighbours(cells.pairs, wanted).items():
        part = corners - cells.sites[i]
        for j, _ in near:
            towards = cells.sites[j] - cells.sites[i]
            part = _cut(part, towards @ towards / 2 - part @ towards)
        x, y = part.T
        volumes[i] = turn * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    return volumes


def _polyhedra(positions: np.ndarray, corners: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    try:
        planes = np.unique(np.round(ConvexHull(corners).equations, 14), axis=0)  # outward normals and offsets
    except Exception as error:  # Qhull's own error, which has no public class
        raise ValueError(f"outline must span a volume in 3D; Qhull: {str(error).strip().splitlines()[0]}") from None
    normals, offsets = planes[:, :3], planes[:, 3]
    size = float(np.linalg.norm(np.ptp(corners, axis=0)))
    distance = np.full(len(positions), np.inf)
    for normal, offset in zip(normals, offsets, strict=True):
        distance = np.minimum(distance, -(positions @ normal + offset))
    _refuse_outside(distance, positions, size)
    cells = _cells(positions, corners)
    volumes, wanted = cells.volumes, np.flatnonzero(distance < cells.radii)
    for i, near in _neighbours(cells.pairs, wanted).items():
        centre = cells.sites[i]
        faces = [cells.vertices[cells.ridges[facet]] - centre for _, facet in near]
        depths = -(normals @ centre + offsets)
        for k in np.flatnonzero(depths < cells.radii[i]):
            faces = _cut_off(faces, normals[k], depths[k])
        volumes[i] = _volume(faces)
    return volumes


def _cut_off(faces: list[np.ndarray], normal: np.ndarray, depth: float) -> list[np.ndarray]:
    """The faces of the part of a convex polyhedron where normal · x ≤ depth, with the new face in the plane."""
    heights = [depth - face @ normal for face in faces]
    if min(h.min() for h in heights) >= 0:
        return faces
    kept, rim = [], []
    for face, height in zip(faces, heights, strict=True):
        part = _cut(face, height)
        if len(part) >= 3:
            kept.append(part)
            rim.append(part[np.abs(part @ normal - depth) <= 1e-12 * (1.0 + np.abs(heights[0]).max() + abs(depth))])
    points = np.concatenate(rim) if rim else np.zeros((0, 3))
    if len(points) >= 3:
        across = points - points.mean(axis=0)
        first = across[int(np.argmax(np.linalg.norm(across, axis=1)))]
        angle = np.arctan2(across @ np.cross(normal, first), across @ first)
        kept.append(points[np.argsort(angle)])
    return kept


def _volume(faces: list[np.ndarray]) -> float:
    """The volume of a convex polyhedron, from the tetrahedra between the centre of its vertices and its faces."""
    if not faces:
        return 0.0
    centre = np.concatenate(faces).mean(axis=0)
    total = 0.0
    for face in faces:
        a = face - centre
        total += abs(float(np.sum(np.cross(a[1:-1] - a[0], a[2:] - a[0]) @ a[0])))
    return total / 6
