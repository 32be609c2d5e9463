"""The chart of the benchmarks: error against wall time, one line for each method."""

from collections.abc import Callable
from typing import Any

SHADES = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#888888", "#44AA99")
LEAST = 1e-17  # an error of 0 is drawn at this value, which lies below rounding errors


def error_against_time(
    rows: list[dict],
    title: str,
    error: str,
    line: Callable[[dict], str] = lambda row: row["method"],
    note: Callable[[dict], str] = lambda row: "",
    panel: Callable[[dict], str] = lambda row: "",
) -> Any:
    """Draw error against wall time on logarithmic axes; return the matplotlib Figure.

    Rows with the same `line` are joined in the order of their measurement. `note` gives the text beside a point,
    `panel` the axes to which a row belongs, `error` the label of the vertical axis. The bars reach from the fastest
    call to the slowest. Rows without an error are not drawn.
    """
    from matplotlib.figure import Figure

    rows = [row for row in rows if row.get("error") is not None]
    panels = list(dict.fromkeys(panel(row) for row in rows)) or [""]
    figure = Figure(figsize=(1.2 + 5.6 * len(panels), 4.8), layout="constrained")
    names = list(dict.fromkeys(line(row) for row in rows))
    for axes, which in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
        for name in names:
            mine = [row for row in rows if line(row) == name and panel(row) == which]
            if not mine:
                continue
            x, y = [row["seconds"] for row in mine], [max(row["error"], LEAST) for row in mine]
            bars = [
                [row["seconds"] - row["fastest"] for row in mine],
                [row["slowest"] - row["seconds"] for row in mine],
            ]
            shade = SHADES[names.index(name) % len(SHADES)]
            axes.errorbar(x, y, xerr=bars, fmt="o-", ms=3.5, lw=1.1, elinewidth=0.6, color=shade, label=name)
            for row, px, py in zip(mine, x, y, strict=True):
                axes.annotate(note(row), (px, py), textcoords="offset points", xytext=(4, 4), fontsize=6, color=shade)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("wall time without compilation  [s]")
        axes.set_ylabel(error)
        axes.set_title(which, fontsize=10)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(frameon=False, fontsize=8)
    figure.suptitle(title, fontsize=11)
    return figure
