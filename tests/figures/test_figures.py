"""Figures: axes have labels with units, every drawn line is in the legend, and no display is needed."""

import numpy as np
import pytest

import pdjax as pd


@pytest.fixture(scope="module")
def grid(law):
    return pd.stability_map(
        np.linspace(-2, 2, 9), np.linspace(-0.3, 0.3, 8), law=law, lines=("diagonal", "continuum"), show_progress=False
    )


def test_map_names_axes_units_and_criteria(grid):
    figure = pd.figures.stability_map(grid)
    left, right = figure.axes
    assert "[–]" in left.get_xlabel() and "[%]" in left.get_ylabel()
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"stable", "unstable", "symbol (exact)", "diagonal", "diagonal, as printed in the paper"} <= set(words)
    assert "diagonal" in right.get_title()
    assert "LinearElastic(lam=1, mu=1)" in figure.get_suptitle()


def test_printed_criterion_only_where_the_paper_prints_one(grid):
    assert pd.figures.charts._printed(grid, 3.0) is not None
    assert pd.figures.charts._printed(grid, 3.5) is None
    other = dict(grid.settings, path="uniaxial_strain")
    moved = pd.StabilityMap(
        grid.m, grid.a, grid.N, grid.margin, grid.eigenvalue, grid.tolerance, grid.line_m, grid.line_a, {}, other
    )
    assert pd.figures.charts._printed(moved, 3.0) is None


def test_a_table_is_text_that_a_notebook_draws():
    made = pd.figures.table(("k", "|λ|"), [(1, "a|b"), (2.5, None)])
    assert made == "| k | \\|λ\\| |\n| --- | --- |\n| 1 | a\\|b |\n| 2.5 | None |"
    assert made._repr_markdown_() == str(made)
    with pytest.raises(ValueError, match="row 1 must have 2 cells"):
        pd.figures.table(("k", "λ"), [(1, 2), (3,)])


def test_no_series_has_the_colour_of_a_criterion():
    assert not {colour.upper() for colour in pd.figures.SERIES} & {c.upper() for c in pd.figures.COLOURS.values()}


def test_unknown_attribute_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'figure'"):
        _ = pd.figure


def test_zeros_of_a_branch_are_a_mask_or_numbers():
    k, omega = np.linspace(0, 1, 5), np.linspace(0, 1, 5)
    for zero in (np.array([False, False, True, False, True]), np.array([2, 4])):
        figure = pd.figures.dispersion_curves({"a": [pd.figures.Branch("symbol", k, omega, zero=zero)]}, "title")
        rings = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
        assert np.array_equal(rings[0].get_xdata(), [0.5, 1.0])
