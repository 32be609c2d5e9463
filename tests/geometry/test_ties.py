"""Rounding does not decide which bonds belong to a family, and coordinates of few digits raise a warning."""

import warnings

import numpy as np
import pytest

import pdjax as pd

SQUARE = pd.lattice((14, 14), 0.01).positions


def counts(positions, horizon, **more):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return np.asarray(pd.families(pd.cloud(positions, 1.0, **more), horizon).count)


def test_a_coordinate_that_rounds_to_the_period_is_zero():
    """np.mod(-1e-17, 1.0) is 1.0, which a search tree refuses."""
    X = np.array([[-1e-17], [0.2], [0.4], [0.6], [0.8]])
    assert counts(X, 0.21, period=[1.0]).tolist() == [2] * 5
    cell = pd.cell_families(pd.cloud(X, 0.2, period=[1.0]), 0.21)
    assert np.asarray(cell.count).tolist() == [2] * 5


@pytest.mark.parametrize("N", [2, 3, 4, 5])
@pytest.mark.parametrize("shift", [0.0, (5e5, 5e6), (-3e4, 1e3)])
def test_a_shift_of_the_origin_changes_no_family(N, shift):
    found = counts(SQUARE + shift, 0.01 * N)
    assert np.array_equal(found, np.asarray(pd.families(pd.lattice((14, 14), 0.01), 0.01 * N).count))


@pytest.mark.parametrize("shift", [0.0, 3.0, (40.0, -7.0)])
def test_float32_coordinates_give_the_families_of_the_lattice(shift):
    single = (SQUARE + shift).astype(np.float32)
    assert np.array_equal(counts(single, 0.03), np.asarray(pd.families(pd.lattice((14, 14), 0.01), 0.03).count))


def test_points_in_another_order_have_the_same_neighbours():
    order = np.random.default_rng(0).permutation(196)
    assert np.array_equal(counts(SQUARE[order] + 1e5, 0.03), counts(SQUARE + 1e5, 0.03)[order])


@pytest.mark.parametrize("digits", [4, 5, 6])
def test_coordinates_of_few_digits_raise_a_warning_with_a_better_horizon(digits):
    body = pd.cloud(np.round(pd.lattice((14, 14), 1 / 70).positions, digits), 1e-4)
    with pytest.warns(UserWarning, match=r"cuts through one shell.*308 bonds.*0\.0430714"):
        pd.families(body, 3 / 70)
    report = pd.neighbour_report(body, 3 / 70)
    assert report.cut is not None and report.cut.within + report.cut.beyond == 308  # 2 × 14 × 11 pairs three apart
    cured = pd.neighbour_report(body, 1.005 * 3 / 70)
    assert cured.cut is None and cured.count.max() == 28


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_random_points_have_no_cut_shell(dim):
    rng = np.random.default_rng(dim)
    for n in (30, 300, 3000):
        report = pd.neighbour_report(pd.cloud(rng.uniform(size=(n, dim)), 1 / n), 3 * n ** (-1 / dim))
        assert report.cut is None


def test_the_report_agrees_with_the_families():
    body = pd.lattice((9, 7, 5), 0.5)
    report, fams = pd.neighbour_report(body, 1.5), pd.families(body, 1.5)
    assert np.array_equal(report.count, np.asarray(fams.count)) and not report.alone.any()
    assert (report.below, report.above) == pytest.approx((1.5, 0.5 * np.sqrt(10)))
    assert report.spacing == pytest.approx(0.5) and report.cut is None
    longest = np.linalg.norm(np.asarray(fams.xi), axis=-1)[np.asarray(fams.is_bond)]
    assert report.at_horizon == (np.abs(longest - 1.5) < 1e-9).sum() / 2
    assert "3 spacings" in str(report) and f"{report.count.min()} to {report.count.max()}" in str(report)


def test_an_isolated_point_is_named():
    body = pd.cloud([[0.0], [1.0], [9.0]], 1.0)
    report = pd.neighbour_report(body, 1.5)
    assert report.alone.tolist() == [False, False, True] and "point 2" in str(report)
    with pytest.raises(ValueError, match="point 2"):
        pd.families(body, 1.5)


@pytest.mark.parametrize("horizon", [0.0, -1.0, np.nan, np.inf, [1.0, 2.0], None, "3"])
def test_an_invalid_horizon_is_refused(horizon):
    for function in (pd.families, pd.neighbour_report):
        with pytest.raises(ValueError, match="horizon must"):
            function(pd.lattice((4, 4)), horizon)
