"""The picture of a fracture shows the verdicts, and refuses another body."""

import matplotlib.colors as colors
import numpy as np
import pytest
from matplotlib.collections import LineCollection, PathCollection, PolyCollection

import pdjax as pd
from pdjax.figures.fracture import VERDICT_COLOURS, WHOLE


def result(points):
    """Point 0 lost half of its bonds in a crack, point 1 all of them in an instability."""
    place = np.zeros(points.dim)
    bursts = (
        pd.Burst("crack", 0.5, 0.6, 5, 4, place, 3, -0.08, 0.1, None, "why"),
        pd.Burst("instability first", 0.7, 0.7, 7, 6, place, 12, np.inf, 0.9, None, "why"),
        pd.Burst("undecided", 0.8, 0.8, 8, 7, place, 1, np.nan, np.nan, None, "why"),
    )
    damage, of = np.zeros(len(points)), np.full(len(points), -1)
    damage[:2], of[:2] = (0.5, 1.0), (0, 1)
    return pd.FractureVerdict(bursts, damage, of, "t")


@pytest.mark.parametrize("shape, kind", [((9,), LineCollection), ((4, 3), PolyCollection), ((4, 3, 2), PolyCollection)])
def test_colours_are_those_of_the_verdicts_and_of_the_damage(shape, kind, tmp_path):
    points = pd.lattice(shape)
    figure = pd.figures.crack_or_instability(points, result(points))
    body, upper, lower = figure.axes
    drawn = next(c for c in body.collections if isinstance(c, kind))
    shown = np.asarray(drawn.get_colors() if kind is LineCollection else drawn.get_facecolors())[:, :3]
    assert np.allclose(shown[1], colors.to_rgb(VERDICT_COLOURS["instability first"])) or len(shape) == 3
    assert any(np.allclose(c, colors.to_rgb(WHOLE)) for c in shown)
    marks = [next(c for c in axes.collections if isinstance(c, PathCollection)) for axes in (upper, lower)]
    assert [len(mark.get_offsets()) for mark in marks] == [3, 3]
    assert np.ma.getdata(marks[0].get_offsets())[1, 1] == 1.0  # collapsed matter is drawn at the upper end
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert words == [
        "crack: 1 burst, 3 bonds",
        "instability first: 1 burst, 12 bonds",
        "undecided: 1 burst, 1 bond",
    ]
    assert figure.get_suptitle().startswith("crack: 3 bursts")
    figure.savefig(tmp_path / "picture.png", dpi=50)


def test_a_run_in_which_nothing_broke_is_drawn_too(tmp_path):
    points = pd.lattice((4, 3))
    found = pd.FractureVerdict((), np.zeros(12), np.full(12, -1), "load factor")
    figure = pd.figures.crack_or_instability(points, found)
    assert figure.get_suptitle() == "nothing broke" and not figure.legends
    figure.savefig(tmp_path / "picture.png", dpi=50)


def test_another_body_is_refused():
    with pytest.raises(ValueError, match="crack_or_instability for these points"):
        pd.figures.crack_or_instability(pd.lattice((5, 5)), result(pd.lattice((4, 3))))
