"""Volumes of Voronoi cells within an outline: their sum, lattices, and counts of random points."""

import itertools

import numpy as np
import pytest
from scipy.spatial import ConvexHull, cKDTree

import pdjax as pd
from pdjax.geometry.voronoi import voronoi_volumes

CUBE = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
L_SHAPE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]])
NOTCHES = [(3, 2), (2, 2), (2, 0.1), (1.9, 0.1), (1.9, 2), (1, 2), (1, 0.2), (0.9, 0.2), (0.9, 2), (0, 2)]
COMB = np.array([(0, 0), (3, 0), *NOTCHES])
TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 1.0, 0.0], [0.1, 0.3, 1.2]])


def area(polygon):
    x, y = polygon.T
    return abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2


def inside(polygon, points):
    from matplotlib.path import Path

    return points[
        Path(polygon).contains_points(points, radius=-1e-9) | Path(polygon).contains_points(points, radius=1e-9)
    ]


@pytest.mark.parametrize("polygon", [SQUARE, L_SHAPE, L_SHAPE[::-1], COMB, SQUARE * 1e-9 + 5.0], ids=range(5))
def test_cells_in_a_polygon_add_up_to_its_area(polygon):
    rng = np.random.default_rng(0)
    low, high = polygon.min(axis=0), polygon.max(axis=0)
    points = inside((polygon - low) / (high - low), rng.random((300, 2))) * (high - low) + low
    points = np.concatenate([points, polygon, (polygon + np.roll(polygon, -1, axis=0)) / 2])  # vertices and edges too
    volumes = voronoi_volumes(points, polygon)
    size = (high - low).max()
    shifted = polygon - low
    # measured: 2e-16; 3e-9 for the polygon of size 1e-9 at distance 5, whose coordinates have 7 digits
    assert volumes.sum() == pytest.approx(area(shifted), rel=5e-15 if size > 1e-3 else 1e-7)
    assert (volumes > 0).all()


@pytest.mark.parametrize("hull", [CUBE, TETRAHEDRON, np.random.default_rng(1).normal(size=(30, 3))], ids=range(3))
def test_cells_in_a_convex_hull_add_up_to_its_volume(hull):
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(len(hull), 0.5), size=150)
    volumes = voronoi_volumes(np.concatenate([weights @ hull, hull[ConvexHull(hull).vertices]]), hull)
    assert volumes.sum() == pytest.approx(ConvexHull(hull).volume, rel=1e-12)  # measured: 2e-14
    assert (volumes > 0).all()


@pytest.mark.parametrize("dim, outline", [(1, [0.0, 1.0]), (2, SQUARE), (3, CUBE)])
def test_a_cell_holds_the_random_points_that_are_nearest_to_its_point(dim, outline):
    rng = np.random.default_rng(2)
    points, samples = rng.random((60, dim)), rng.random((200_000, dim))
    volumes = voronoi_volumes(points, outline)
    counts = np.bincount(cKDTree(points).query(samples)[1], minlength=60) / len(samples)
    # The error of a count is the square root of its mean. Measured: 2.4 of these at most.
    assert (np.abs(counts - volumes) < 4.5 * np.sqrt(volumes / len(samples))).all()


def test_a_cell_in_a_polygon_that_is_not_convex_holds_the_nearest_random_points():
    rng = np.random.default_rng(3)
    points = inside(COMB / 3, rng.random((80, 2))) * 3
    samples = inside(COMB / 3, rng.random((200_000, 2))) * 3
    volumes = voronoi_volumes(points, COMB)
    counts = np.bincount(cKDTree(points).query(samples)[1], minlength=len(points)) / len(samples)
    expected = volumes / area(COMB)
    assert (np.abs(counts - expected) < 4.5 * np.sqrt(expected / len(samples))).all()  # measured: 2.0


@pytest.mark.parametrize("shape", [(7,), (5, 3), (4, 3, 5)])
def test_cells_of_a_lattice_are_its_cells(shape):
    body = pd.lattice(shape, 0.1)
    corners = np.array(list(itertools.product(*[(0.0, 0.1 * n) for n in shape])))
    if len(shape) == 2:
        corners = corners[[0, 1, 3, 2]]
    volumes = voronoi_volumes(body.positions, corners.reshape(-1) if len(shape) == 1 else corners)
    assert np.abs(volumes / body.volumes - 1).max() < 5e-13  # measured: 2e-14


@pytest.mark.parametrize(
    "dim, outline, words",
    [
        (1, None, r"no end; pass outline= of shape \(2,\)"),
        (2, None, r"no end; pass outline= of shape \(vertices, 2\)"),
        (2, [0.0, 1.0], r"outline must have shape \(vertices, 2\)"),
        (2, SQUARE * 0.5, "every point must lie within the outline; point"),
        (3, CUBE * 0.5, "every point must lie within the outline; point"),
        (1, [0.0, 0.5], "every point must lie within the outline; point"),
        (3, CUBE[:3], r"outline must have shape \(vertices, 3\)"),
        (3, CUBE[:4], "outline must span a volume"),
        (2, [[0.0, 0.0], [np.nan, 1.0], [1.0, 1.0]], "outline must be finite"),
        (2, "square", "outline must be an array of numbers"),
    ],
)
def test_a_wrong_outline_is_refused(dim, outline, words):
    points = np.random.default_rng(0).random((20, dim))
    with pytest.raises(ValueError, match=words):
        voronoi_volumes(points, outline)


def test_an_outline_that_crosses_itself_is_refused():
    crossed = [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]]
    with pytest.raises(ValueError, match="must not cross itself"):
        voronoi_volumes(np.array([[0.2, 0.5], [1.9, 1.0], [0.1, 0.3]]), crossed)
