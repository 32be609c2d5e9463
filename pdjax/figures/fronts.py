"""Figures of designs: Pareto fronts."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ..optimise.pareto import ParetoFront
from .charts import SERIES


def pareto_front(
    fronts: ParetoFront | Mapping[str, ParetoFront], marks: Mapping[str, Any] | None = None, labels=None
) -> Figure:
    """Draw Pareto fronts of two objectives, the better designs to the lower left.

    Parameters
    ----------
    fronts : ParetoFront or dict of ParetoFront
        One front, or several by the name that the legend shows.
    marks : dict of pairs, optional
        Further designs, such as published ones, as (first objective, second objective) by name.
    labels : pair of str, optional
        Labels of the two axes. The defaults are the names of the objectives.

    Returns
    -------
    matplotlib.figure.Figure
        The second objective on the horizontal axis, the first one on the vertical axis.

    Examples
    --------
    >>> front = pd.pareto_front(
    ...     lambda x: x, 0.5, {"a": lambda x: x**2, "b": lambda x: (x - 1) ** 2}, points=3, bounds=(-1.0, 2.0))
    >>> pd.figures.pareto_front(front).axes[0].get_xlabel()
    'b'
    """
    table = fronts if isinstance(fronts, Mapping) else {"": fronts}
    first = next(iter(table.values()))
    down, across = first.names if labels is None else labels
    figure = Figure(figsize=(6, 4.2), layout="constrained")
    axes = figure.add_subplot(xlabel=across, ylabel=down)
    for i, (name, front) in enumerate(table.items()):
        values = np.reshape(front.values, (-1, 2))
        axes.plot(values[:, 1], values[:, 0], "o-", color=SERIES[i % len(SERIES)], ms=4, label=name or None)
    for i, (name, (y, x)) in enumerate((marks or {}).items()):
        axes.plot([x], [y], "sD^v*P"[i % 6], color="#444444", ms=7, label=name)
    axes.grid(alpha=0.3)
    if any(table) or marks:
        axes.legend(frameon=False, fontsize=8)
    return figure
