"""The neighbour report finds what is wrong with points from a file, and says in sentences what to do."""

import warnings

import numpy as np
import pytest

import pdjax as pd
from pdjax.geometry import neighbour_sums
from pdjax.geometry.report import THIN


def jittered(shape, seed=0):
    """A cloud near a lattice of spacing 1, with different volumes."""
    rng = np.random.default_rng(seed)
    X = pd.lattice(shape).positions
    return pd.cloud(X + rng.uniform(-0.2, 0.2, X.shape), rng.uniform(0.7, 1.4, len(X)))


def shape_ratios(body, horizon):
    """Ratios of the eigenvalues of K from the arrays of the families."""
    fams = pd.families(body, horizon)
    w = np.asarray(fams.weight) * np.asarray(fams.volumes)[np.asarray(fams.neighbours)]
    values = np.linalg.eigvalsh(np.einsum("pb,pbi,pbj->pij", w, fams.xi, fams.xi))
    return values[:, 0] / values[:, -1]


@pytest.mark.parametrize("shape", [(40,), (9, 7), (5, 4, 6)])
def test_the_report_agrees_with_the_families_of_a_cloud(shape):
    body = jittered(shape)
    report, fams = pd.neighbour_report(body, 2.3), pd.families(body, 2.3)
    assert np.array_equal(report.count, fams.count)
    assert np.allclose(report.shape_ratio, shape_ratios(body, 2.3), atol=1e-12)  # measured 3e-15
    lengths = np.linalg.norm(np.asarray(fams.xi), axis=-1)
    assert np.allclose(report.nearest, np.where(fams.is_bond, lengths, np.inf).min(axis=1))
    assert report.below == pytest.approx(lengths[np.asarray(fams.is_bond)].max())
    assert report.ok and report.pieces == 1 and not report.piece.any()


def test_the_size_of_the_chunks_changes_nothing(monkeypatch):
    body = pd.cloud(np.concatenate([jittered((9, 7)).positions, 30 + jittered((3, 4)).positions]), 1.0)
    whole = pd.neighbour_report(body, 2.3)
    monkeypatch.setattr(neighbour_sums, "BONDS", 100)
    parts = pd.neighbour_report(body, 2.3)
    for name, values in whole.fields.items():
        assert np.allclose(values, parts.fields[name], rtol=1e-12), name
    assert (whole.below, whole.above, whole.at_horizon) == (parts.below, parts.above, parts.at_horizon)


def test_a_periodic_body_has_full_families():
    X = pd.lattice((8, 9)).positions - 4.0  # partly outside the box
    report = pd.neighbour_report(pd.cloud(X, 1.0, period=[8.0, 9.0]), 2.0)
    assert (report.count == 12).all() and np.allclose(report.shape_ratio, 1.0) and report.ok
    assert report.above == pytest.approx(np.sqrt(5.0))


def test_the_next_shell_is_found_up_to_half_a_horizon_beyond():
    assert pd.neighbour_report(pd.lattice((6, 6)), 1.0).above == pytest.approx(np.sqrt(2.0))
    assert pd.neighbour_report(pd.lattice((6,)), 1.2).above == np.inf  # the next bond is 1.67 horizons long


def test_separate_pieces_are_counted_labelled_and_joined_by_the_advised_horizon():
    """A plate, a smaller plate at a distance of 5, and a bar of two points."""
    plate, small = pd.lattice((6, 5)).positions, pd.lattice((3, 3)).positions
    body = pd.cloud(np.concatenate([small + np.array([10.0, 0.0]), plate, [[0.5, 12.5], [1.5, 12.5]]]), 1.0)
    report = pd.neighbour_report(body, 1.5)
    assert report.pieces == 3 and report.piece_sizes.tolist() == [30, 9, 2]
    assert report.piece.tolist() == [1] * 9 + [0] * 30 + [2] * 2
    assert report.joining == pytest.approx(8.0)  # from y = 4.5 to y = 12.5
    assert not report.ok and "3 separate pieces of 30, 9, 2 points" in str(report)
    assert pd.neighbour_report(body, report.joining).pieces == 1


def test_an_isolated_point_is_advised_a_horizon_that_reaches_its_neighbour():
    body = pd.cloud(np.concatenate([pd.lattice((4, 4)).positions, [[9.5, 0.5]]]), 1.0)
    report = pd.neighbour_report(body, 2.0)
    assert report.alone.sum() == 1 and report.pieces == 2
    assert report.nearest[-1] == pytest.approx(6.0)
    assert len(report.advice) == 1 and "first is point 16" in report.advice[0] and "at least 6" in report.advice[0]
    assert not pd.neighbour_report(body, 6.0).alone.any()


def test_a_single_point_has_no_nearest_distance():
    report = pd.neighbour_report(pd.cloud([[0.0, 0.0]], 1.0), 1.0)
    assert report.alone.all() and np.isinf(report.nearest[0]) and "add points" in str(report)


@pytest.mark.parametrize(
    ("shape", "N", "least"),
    [
        ((12, 12), 2, 0.583),
        ((12, 12), 3, 0.455),
        ((12, 12), 5, 0.309),
        ((12, 2), 3, 0.126),  # two layers
        ((12, 2), 5, 0.044),
        ((8, 8, 8), 3, 0.281),
        ((8, 8, 2), 3, 0.097),
        ((8, 8, 1), 3, 0.0),  # one layer
    ],
)
def test_only_a_single_layer_of_a_lattice_is_thin(shape, N, least):
    report = pd.neighbour_report(pd.lattice(shape), N)
    assert report.shape_ratio.min() == pytest.approx(least, abs=5e-4)
    assert report.thin.any() == (least < THIN) == (not report.ok)


def test_a_thin_ligament_is_found_and_named():
    """A line of points between two plates is a place where the shape tensor is singular."""
    left = pd.lattice((5, 5)).positions
    line = np.stack([np.arange(5.5, 15.5), np.full(10, 2.5)], axis=1)
    body = pd.cloud(np.concatenate([left, line, left + np.array([15.0, 0.0])]), 1.0)
    report = pd.neighbour_report(body, 2.0)
    middle = np.flatnonzero(report.thin)
    assert set(middle) <= set(range(25, 35)) and len(middle) == 8
    assert "8 points have bonds that nearly lie in a line or a plane" in str(report)
    assert f"the first is point {middle[0]}" in str(report)


def test_a_horizon_of_another_unit_is_found():
    report = pd.neighbour_report(pd.lattice((5, 4)), 3000.0)
    assert not report.ok and "Every point is a neighbour of all others" in report.advice[0]
    assert pd.neighbour_report(pd.lattice((5, 4)), 6.0).ok


def test_volumes_of_another_unit_are_found():
    body = pd.cloud(pd.lattice((8, 8), 0.1).positions, 1.0)  # 100 times too large
    (advice,) = pd.neighbour_report(body, 0.31).advice
    assert "volumes do not fit the positions" in advice and "the nearest point is 0.1 away" in advice


def test_a_horizon_below_the_size_of_some_cells_is_found():
    fine, coarse = pd.lattice((8, 8), 0.25), pd.lattice((4, 4), 1.0)
    X = np.concatenate([fine.positions, coarse.positions + np.array([2.0, 0.0])])
    report = pd.neighbour_report(pd.cloud(X, np.concatenate([fine.volumes, coarse.volumes])), 1.2)
    (advice,) = report.advice
    assert "16 points have cells that are too large" in advice and "a horizon of 2, two of the largest cells" in advice
    assert report.fields["horizon_over_cell"].min() == pytest.approx(1.2)
    assert "a ratio of 16" in str(report)


def test_fields_have_a_number_for_every_point():
    report = pd.neighbour_report(jittered((9, 7)), 2.3)
    assert all(values.shape == (63,) for values in report.fields.values())
    assert {"neighbours", "piece", "thin", "alone", "shape_ratio"} <= set(report.fields)


def test_a_good_body_is_told_that_nothing_needs_to_be_changed():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for dim in (1, 2, 3):
            report = pd.neighbour_report(pd.lattice((9, 7, 5)[:dim], 0.5), 1.5)
            assert report.ok and str(report).endswith("Nothing needs to be changed.")
