"""The chart of the benchmarks: error against wall time, one line for each method."""

from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import matplotlib.figure

# The colours of figures.SERIES, which mean no criterion, and three more. They are repeated here so that reading this
# module does not load matplotlib.
SHADES = ("#332288", "#44AA99", "#CC6677", "#999933", "#AA4499", "#117733", "#661100", "#888888", "#DDCC77", "#6699CC")
LEAST = 1e-17  # an error of 0 is drawn at this value, which lies below rounding errors


def error_against_time(
    rows: list[dict],
    title: str,
    error: str,
    line: Callable[[dict], str] = lambda row: row["method"],
    note: Callable[[dict], str] = lambda row: "",
    panel: Callable[[dict], str] = lambda row: "",
) -> "matplotlib.figure.Figure":
    """Draw error against wall time on logarithmic axes; return the matplotlib Figure.

    Rows with the same `line` are joined in the order of their measurement. `note` gives the text beside a point,
    `panel` the axes to which a row belongs, `error` the label of the vertical axis. The bars reach from the fastest
    call to the slowest. Rows without an error are not drawn.
    """
    from matplotlib.figure import Figure

    from ..figures import COLOURS

    rows = [row for row in rows if row.get("error") is not None]
    panels = list(dict.fromkeys(panel(row) for row in rows)) or [""]
    figure = Figure(figsize=(1.2 + 5.6 * len(panels), 4.8), layout="constrained")
    names = list(dict.fromkeys(line(row) for row in rows))
    for axes, which in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        notes: list[tuple] = []
        for name in names:
            mine = [row for row in rows if line(row) == name and panel(row) == which]
            if not mine:
                continue
            x, y = [row["seconds"] for row in mine], [max(row["error"], LEAST) for row in mine]
            bars = [
                [row["seconds"] - row["fastest"] for row in mine],
                [row["slowest"] - row["seconds"] for row in mine],
            ]
            shade = COLOURS.get(name, SHADES[names.index(name) % len(SHADES)])
            axes.errorbar(x, y, xerr=bars, fmt="o-", ms=3.5, lw=1.1, elinewidth=0.6, color=shade, label=name)
            notes += [(note(row), place, shade) for row, place in zip(mine, zip(x, y, strict=True), strict=True)]
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.tick_params(axis="x", which="minor", labelsize=6)
        _annotate(axes, notes)
        axes.set_xlabel("wall time without compilation  [s]")
        axes.set_ylabel(error)
        axes.set_title(which, fontsize=10)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, fontsize=8)
    figure.suptitle(title, fontsize=11)
    return figure


def _annotate(axes, notes: list[tuple]) -> None:
    """Write each (text, point, colour) beside its point, except where it would cover an earlier text."""
    taken: list[tuple[float, float]] = []
    for text, place, shade in notes:
        x, y = axes.transData.transform(place)
        if any(abs(x - left) < 18 and abs(y - below) < 8 for left, below in taken):
            continue
        taken.append((x, y))
        axes.annotate(text, place, textcoords="offset points", xytext=(4, 4), fontsize=6, color=shade)
