"""Picture of a neighbour report: the points, coloured by their number of neighbours, with marks on those at fault."""

from typing import Any

from matplotlib.figure import Figure

from .._internal.public import public_function
from ..geometry.points import Points
from ..geometry.report import NeighbourReport
from .fields import drawn_layer, field

MARK = "#E8112D"  # red, which is not among the colours of the field


@public_function
def neighbours(points: Points, report: NeighbourReport, title: str = "", cut=None) -> Figure:
    """Draw the number of neighbours of every point, and mark isolated, thin and separate points.

    Parameters
    ----------
    points : Points
        The body.
    report : NeighbourReport
        The report of this body, from `neighbour_report`.
    title : str
        Title of the figure.
    cut : tuple of (int, float), optional
        (axis, coordinate [length]) of the layer of a 3D body, as in `field`.

    Returns
    -------
    Figure
        The figure. The legend lists the kinds of marks that it contains.

    Raises
    ------
    ValueError
        If the report is that of another body, or cut does not pass through a 3D body.

    Examples
    --------
    >>> body = pd.cloud([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [5.0, 0.0]], 1.0)
    >>> figure = pd.figures.neighbours(body, pd.neighbour_report(body, 1.5))
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['1 point without neighbours']
    """
    if not isinstance(report, NeighbourReport) or not isinstance(points, Points) or len(report.count) != len(points):
        raise ValueError(
            "report must be the neighbour_report of these points, one count for each point; got"
            f" {type(report).__name__} for {type(points).__name__}"
        )
    figure = field(points, report.count, title=title, label="neighbours of a point", cut=cut)
    kept, across, _ = drawn_layer(points, cut)
    X = points.positions[kept][:, across]
    axes: Any = figure.axes[0]
    marks = {
        "without neighbours": (report.alone, "x"),
        "with bonds in a line or a plane": (report.thin, "+"),
        "not in the largest piece": ((report.piece > 0) & ~report.alone, "o"),
    }
    for words, (mask, marker) in marks.items():
        some = mask[kept]
        if not some.any():
            continue
        place = (X[some, 0], report.count[some] if points.dim == 1 else X[some, 1])
        label = f"{mask.sum()} point{'s' * bool(mask.sum() > 1)} {words}"
        look: dict[str, Any] = {"markersize": 6, "markeredgewidth": 1.5, "markerfacecolor": "none", "clip_on": False}
        axes.plot(*place, marker, linestyle="", color=MARK, label=label, **look)
    lines = len(axes.get_legend_handles_labels()[1])
    if lines:
        figure.set_figheight(figure.get_figheight() + 0.25 * lines)
        figure.legend(loc="outside lower center", ncols=1, fontsize=9, frameon=False)
    return figure
