"""Lattices, boxes and clouds have the requested points and volumes, and refuse wrong arguments."""

import numpy as np
import pytest

import pdjax as pd

NAN, INF = float("nan"), float("inf")


def test_lattice_points_sit_in_their_cells_the_last_axis_fastest():
    body = pd.lattice((2, 3), spacing=0.5)
    expected = [[0.25, 0.25], [0.25, 0.75], [0.25, 1.25], [0.75, 0.25], [0.75, 0.75], [0.75, 1.25]]
    assert body.positions.tolist() == expected
    assert body.volumes.tolist() == [0.25] * 6
    assert (len(body), body.dim, body.spacing, body.shape, body.period) == (6, 2, 0.5, (2, 3), None)


@pytest.mark.parametrize(
    "body, shape, spacing, volume",
    [
        (lambda: pd.bar(7, 3.5), (7,), 0.5, 3.5),
        (lambda: pd.plate((1.5, 0.9), 0.3), (5, 3), 0.3, 1.35),
        (lambda: pd.cuboid((0.8, 0.4, 0.6), 0.2), (4, 2, 3), 0.2, 0.192),
        (lambda: pd.lattice((5, 3, 2)), (5, 3, 2), 1.0, 30.0),
    ],
)
def test_boxes_fill_their_lengths(body, shape, spacing, volume):
    body = body()
    assert body.shape == shape and abs(body.spacing - spacing) < 1e-15  # 0
    assert len(body) == np.prod(shape)
    assert abs(body.volumes.sum() / volume - 1) < 1e-14  # 9e-16
    edge = np.array(shape) * spacing
    assert np.allclose(body.positions.min(axis=0), spacing / 2, rtol=1e-14)  # 0
    assert np.allclose(body.positions.max(axis=0), edge - spacing / 2, rtol=1e-14)  # 4e-16


def test_period_is_the_box_along_periodic_axes_only():
    assert pd.lattice((5, 3), 0.5, periodic=True).period == (2.5, 1.5)
    assert pd.lattice((5, 3), 0.5, periodic=(False, True)).period == (INF, 1.5)
    assert pd.lattice((5, 3), 0.5, periodic=(False, False)).period is None


def test_cloud_copies_its_arrays():
    positions, volumes = np.array([[0.0, 1.0], [2.0, 0.5], [1.0, 1.0]]), np.array([1.0, 2.0, 3.0])
    body = pd.cloud(positions, volumes)
    volumes[:] = 9
    assert body.volumes.tolist() == [1.0, 2.0, 3.0] and np.array_equal(body.positions, positions)
    assert pd.cloud(positions, 0.5).volumes.tolist() == [0.5] * 3
    assert pd.cloud([[0], [1]], 1).positions.dtype == float
    assert (body.spacing, body.shape, body.period, body.dim) == (None, None, None, 2)


@pytest.mark.parametrize(
    "call, named",
    [
        (lambda: pd.lattice((5, 0)), "shape"),
        (lambda: pd.lattice(()), "shape"),
        (lambda: pd.lattice((2, 2, 2, 2)), "shape"),
        (lambda: pd.lattice((5, 3), 0.0), "spacing"),
        (lambda: pd.lattice((5, 3), -1.0), "spacing"),
        (lambda: pd.lattice((5, 3), NAN), "spacing"),
        (lambda: pd.lattice((5, 3), INF), "spacing"),
        (lambda: pd.lattice((5, 3), periodic=(True,)), "periodic"),
        (lambda: pd.bar(4, NAN), "spacing"),
        (lambda: pd.bar(4, -1.0), "spacing"),
        (lambda: pd.bar(0), "n must"),
        (lambda: pd.plate((1.0, 2.0, 3.0), 0.5), "lengths"),
        (lambda: pd.plate((1.0, 0.7), 0.5), "length"),
        (lambda: pd.plate((1.0, -2.0), 0.5), "length"),
        (lambda: pd.plate((1.0, 0.1), 0.5), "length"),
        (lambda: pd.plate((1.0, NAN), 0.5), "length"),
        (lambda: pd.plate((INF, 1.0), 0.5), "length"),
        (lambda: pd.plate((1.0, 2.0), 0.0), "spacing"),
        (lambda: pd.cuboid((1.0, 2.0), 0.5), "lengths"),
        (lambda: pd.cloud([[0.0, NAN], [1.0, 0.0]], 1.0), "positions.*flat index 1"),
        (lambda: pd.cloud([[0.0, 1.0], [INF, 0.0]], 1.0), "positions"),
        (lambda: pd.cloud([0.0, 1.0], 1.0), "positions"),
        (lambda: pd.cloud(np.zeros((3, 4)), 1.0), "positions"),
        (lambda: pd.cloud(np.zeros((0, 2)), 1.0), "positions"),
        (lambda: pd.cloud([[0.0], [1.0]], [1.0, 2.0, 3.0]), "volumes"),
        (lambda: pd.cloud([[0.0], [1.0]], [1.0, NAN]), "volumes"),
        (lambda: pd.cloud([[0.0], [1.0]], [1.0, 0.0]), "volumes.*point 1"),
        (lambda: pd.cloud([[0.0], [1.0]], -1.0), "volumes"),
    ],
)
def test_wrong_use_names_the_argument(call, named):
    with pytest.raises(ValueError, match=named):
        call()
