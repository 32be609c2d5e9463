"""The picture of a neighbour report marks the points at fault, in every dimension."""

import numpy as np
import pytest

import pdjax as pd


def legend(figure):
    return [text.get_text() for entry in figure.legends for text in entry.get_texts()]


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_isolated_and_separate_points_are_marked(dim):
    block = pd.lattice((5, 4, 3)[:dim]).positions
    middle = np.array([0.0, 1.5, 1.0])[:dim]
    away = np.eye(1, dim)[0]
    X = np.concatenate([block, [middle + 12 * away, middle + 20 * away, middle + 21 * away]])
    body = pd.cloud(X, 1.0)
    figure = pd.figures.neighbours(body, pd.neighbour_report(body, 1.6), cut=None if dim < 3 else (2, 1.0))
    said = legend(figure)
    assert "1 point without neighbours" in said and "2 points not in the largest piece" in said


def test_a_body_without_faults_has_no_legend():
    body = pd.lattice((6, 5))
    assert not legend(pd.figures.neighbours(body, pd.neighbour_report(body, 2.1)))


def test_the_report_of_another_body_is_refused():
    report = pd.neighbour_report(pd.lattice((6, 5)), 2.1)
    with pytest.raises(ValueError, match="neighbour_report of these points"):
        pd.figures.neighbours(pd.lattice((6, 6)), report)
