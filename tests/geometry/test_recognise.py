"""Uniform lattices found from positions, and bodies on them in any order and at any place."""

import numpy as np
import pytest

import pdjax as pd
from pdjax.geometry.recognise import recognised, rounding


def written(values, form):
    return np.array([float(form % x) for x in values.reshape(-1)]).reshape(values.shape)


@pytest.mark.parametrize("form", ["%.17g", "%.9g", "%.6g", "%.4f"])
@pytest.mark.parametrize("shift", [0.0, -0.5, 0.1234, 100.0])
@pytest.mark.parametrize("shape, spacing", [((9,), 0.1), ((5, 3), 1 / 3), ((6, 5, 4), 0.025)])
def test_a_lattice_is_recognised_in_any_order_and_by_few_digits(shape, spacing, shift, form):
    body = pd.lattice(shape, spacing, mask=np.arange(np.prod(shape)).reshape(shape) != 4)
    order = np.random.default_rng(0).permutation(len(body))
    positions = written(body.positions[order] + shift, form)
    if form == "%.6g" and shift == 100.0 and spacing != 0.1:  # rounding moves the points by more than 1e-3 spacings
        with pytest.raises(ValueError, match=r"spacings of .* from the lattice"):
            recognised(positions)
        return
    found = recognised(positions)
    assert found.cells == shape and np.array_equal(found.sites, body.sites[order])
    assert found.spacing == pytest.approx(spacing, rel=2e-4)  # measured: 3e-5, for 1/3 in four digits
    made = found.body(np.full(len(body), found.spacing ** len(shape)))
    assert made.uniform and np.abs(made.positions - positions).max() <= 1e-3 * spacing  # measured: 2e-4 spacings


def test_a_full_lattice_in_row_major_order_is_that_of_lattice():
    body = pd.lattice((5, 3), 0.1)
    made = recognised(body.positions).body(body.volumes)
    assert made.shape == (5, 3) and made.sites is None and made.origin is None and made.spacing == 0.1
    assert np.array_equal(made.positions, body.positions)


@pytest.mark.parametrize(
    "positions, words",
    [
        (np.random.default_rng(0).random((50, 2)), "differ by as little as .* cells for 50 points"),
        (np.round(np.random.default_rng(0).random((50, 2)), 2), "cells for 50 points"),
        (np.array([[0.0], [1.0], [2.0], [4.0]]), "point 3 has no neighbour at the spacing 1"),
        (np.array([[0.0, 0.0]]), "do not differ"),
        (np.array([[0.0], [1e-9], [1.0]]), "apart|same cell"),
        (pd.lattice((5, 3)).positions @ np.array([[0.8, 0.6], [-0.6, 0.8]]), "point 0 has no neighbour"),
        (pd.lattice((5, 3)).positions * [1.0, 0.7], "from the lattice"),
    ],
    ids=range(7),
)
def test_the_reason_is_told_if_there_is_no_lattice(positions, words):
    with pytest.raises(ValueError, match=words):
        recognised(positions)


def test_positions_moved_by_more_than_their_digits_are_no_lattice():
    positions = pd.lattice((9, 8), 0.1).positions
    positions = positions + 1e-5 * np.random.default_rng(0).normal(size=positions.shape)
    with pytest.raises(ValueError, match="differ by as little as"):
        recognised(positions)
    positions = pd.lattice((9, 8), 0.1).positions
    positions[::2, 1] += 2e-3
    with pytest.raises(ValueError, match=r"0\.01 spacings of 0\.1 from the lattice"):
        recognised(positions)


def test_rounding_is_half_a_unit_of_the_last_digit():
    assert rounding(np.array([0.05, 0.15, 1.25])) == pytest.approx(0.005, rel=1e-14)  # measured: 0
    assert rounding(np.array([1.23456e-7, 0.0])) == pytest.approx(0.5e-12, rel=1e-14)  # measured: 0
    assert rounding(np.array([1 / 3, 2 / 3])) < 1e-15  # measured: 5e-16


@pytest.mark.parametrize("method", ["slices", "families"])
def test_forces_of_a_lattice_in_another_order_and_place_are_those_of_a_cloud(method):
    model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    rng = np.random.default_rng(0)
    plain = pd.lattice((7, 5), 0.5)
    positions = plain.positions[rng.permutation(35)] + [3.0, -1.25]
    body = recognised(positions).body(plain.volumes)
    assert body.uniform and body.sites is not None and body.origin == (3.0, -1.25)
    u = 1e-3 * rng.normal(size=(35, 2))
    fams = pd.families(body, 1.005, arrays=method == "families")
    cloud = pd.families(pd.cloud(positions, plain.volumes), 1.005)
    force, expected = pd.force_density(model, fams, u), pd.force_density(model, cloud, u)
    assert np.abs(force - expected).max() < 5e-15 * np.abs(expected).max()  # measured: 1e-16
