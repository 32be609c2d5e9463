"""Pictures of audits: where a state cannot be trusted, and from which state of a run on."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from .._internal.public import public_function
from ..geometry.points import Points
from ..trust.series import AuditSeries
from ..trust.verdict import Audit
from .charts import SERIES
from .fields import drawn_layer, on_page, outlines, paint

MARK = "#E8112D"  # red, which is not among the colours of the fields
HIGHEST = 3.0  # Scores above are drawn like this one, and the colour bar has an arrow.
PANELS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("score", "score: 1 doubtful, 2 untrusted", {"limits": (0.0, HIGHEST)}),
    ("zero_energy", "zero-energy share  [-]", {"limits": (0.0, 1.0)}),
    ("margin", "margin  [-]: unstable above 0", {"signed": True}),
)


@public_function
def audit(points: Points, state: Audit, title: str = "", cut=None) -> Figure:
    """Draw where a state can be trusted: the score, the zero-energy share and the margin of every point.

    The points are drawn at their deformed positions. Numbers mark the worst places, in the order of the audit's text. A
    1D body is drawn as curves over the position.

    Parameters
    ----------
    points : Points
        The body.
    state : Audit
        The audit of this body, from `audit`.
    title : str
        Title of the figure. Default: the verdict.
    cut : tuple of (int, float), optional
        (axis, coordinate [length]) of the layer of a 3D body, as in `field`. Default: the layer of the worst place.

    Returns
    -------
    Figure
        The figure, with one panel for each measure.

    Raises
    ------
    ValueError
        If the audit is that of another body, or cut does not pass through a 3D body.

    Examples
    --------
    >>> body = pd.lattice((6, 5))
    >>> families = pd.families(body, horizon=3.0)
    >>> state = pd.audit(pd.BondLevel(pd.LinearElastic(1.0, 1.0)), families, 0.01 * body.positions)
    >>> pd.figures.audit(body, state).get_suptitle()
    'trusted'
    """
    if not isinstance(state, Audit) or not isinstance(points, Points) or len(state.score) != len(points):
        raise ValueError(
            f"state must be the audit of these points; got {type(state).__name__} for {type(points).__name__}"
        )
    values = state.fields
    panels = [(values[name], label, look) for name, label, look in PANELS if name in values]
    if points.dim == 3 and cut is None and state.places:
        cut = (2, float(state.places[0].position[2]))
    kept, across, layer = drawn_layer(points, cut)
    place = points.positions + np.asarray(state.displacement)
    if points.dim == 1:
        figure = Figure(figsize=(6.4, 1.9 * len(panels) + 0.8), layout="constrained")
        order = np.argsort(place[:, 0])
        every: Any = figure.subplots(len(panels), 1, sharex=True)
        for axes, (shown, label, _) in zip(every, panels, strict=True):
            axes.plot(place[order, 0], shown[order], ".-", color=SERIES[0], linewidth=1.0, markersize=4)
            axes.set_ylabel(label, fontsize=8)
        every[-1].set_xlabel("deformed position x  [length]")
    else:
        tiles = outlines(points, place, kept, across)
        _, (width, height) = on_page(np.ptp(tiles.reshape(-1, 2), axis=0))
        wide = width > height
        rows, columns = (len(panels), 1) if wide else (1, len(panels))
        size = (0.8 * width + 2.2) * columns, (0.8 * height + 0.9) * rows + 0.6
        figure = Figure(figsize=size, layout="constrained")
        grid: Any = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes, (shown, label, look) in zip(grid.reshape(-1), panels, strict=True):
            paint(axes, tiles, shown[kept], label, across, below=False, **look)
            for number, worst in enumerate(state.places, 1):
                if worst.score >= 1 and kept[worst.point]:
                    at = place[worst.point][list(across)]
                    axes.plot(*at, "o", color=MARK, markersize=10, markerfacecolor="none", markeredgewidth=1.5)
                    around = [withStroke(linewidth=2.5, foreground="white")]
                    words: dict[str, Any] = {"color": MARK, "fontsize": 9, "path_effects": around}
                    axes.annotate(f"{number}", at, (7, 7), textcoords="offset points", **words)
    if title == "":
        title = "; ".join([state.verdict, *dict.fromkeys(found.check for found in state.findings)])
    figure.suptitle("\n".join(word for word in (title, layer) if word), fontsize=10)
    return figure


@public_function
def audit_states(run: AuditSeries, title: str = "", x=None, label: str = "time") -> Figure:
    """Draw the scores of all states of a run, and the states at which it becomes doubtful and untrusted.

    Parameters
    ----------
    run : AuditSeries
        Result of `audit_states`.
    title : str
        Title of the figure. Default: the verdict.
    x : array, shape (states,), optional
        Horizontal coordinate, such as a strain. Default: the times.
    label : str
        Name and unit of the horizontal coordinate.

    Returns
    -------
    Figure
        The figure, with one curve for each check.

    Raises
    ------
    ValueError
        If x does not have one number for each state.

    Examples
    --------
    >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
    >>> model = pd.BondLevel(pd.LinearElastic(1.0, 1.0))
    >>> run = pd.audit_states(model, families, [np.zeros((30, 2))] * 3, show_progress=False)
    >>> len(pd.figures.audit_states(run).axes[0].lines) > 0
    True
    """
    x = run.times if x is None else np.asarray(x, float)
    if x.shape != run.times.shape:
        raise ValueError(f"x must have one number for each of the {len(run.times)} states; got shape {x.shape}")
    figure = Figure(figsize=(6.4, 3.8), layout="constrained")
    axes = figure.subplots()
    for k, name in enumerate(run.checks):
        if (run.scores[:, k] > 0).any():
            axes.plot(x, np.minimum(run.scores[:, k], HIGHEST), ".-", markersize=4, color=SERIES[k], label=name)
    for level, words in ((1.0, "doubtful"), (2.0, "untrusted")):
        axes.axhline(level, color="#888888", linewidth=0.8, linestyle="--", zorder=0)
        at: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "ha": "right", "va": "bottom"}
        axes.text(0.995, level, words, fontsize=8, color="#555555", **at)
    axes.set(xlabel=label, ylabel="largest score of all points", ylim=(0, HIGHEST + 0.1))
    axes.set_title(title or run.verdict, fontsize=10)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure
