"""Figures of bodies that break: the damage, the growth of the crack, the energy budget, and a load curve."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..finite_body.dynamics.history import History
from ..finite_body.statics.breaking_path import BreakingPath
from ..geometry.points import Points
from .charts import SERIES
from .fields import outlines, paint


def _panels(X: np.ndarray, beside: str, ratios: tuple[float, float]) -> tuple[Figure, Any]:
    """A figure with the axes "field", `beside` and "energy". An upright body has the other two at its side.

    `ratios` are the heights of the two rows for any other body.
    """
    upright = _upright(X)
    figure = Figure(figsize=(9.6, 6.0) if upright else (8.0, 6.8), layout="constrained")
    places: Any = [["field", beside], ["field", "energy"]] if upright else [["field", "field"], [beside, "energy"]]
    return figure, figure.subplot_mosaic(places, height_ratios=[1, 1] if upright else ratios)


def _upright(X: np.ndarray) -> bool:
    return X.shape[1] == 2 and bool(np.ptp(X[:, 1]) > np.ptp(X[:, 0]))


def _damage(axes: Axes, points: Points, shown: np.ndarray) -> None:
    """The damage of a 2D body."""
    tiles = outlines(points, points.positions, np.ones(len(points), bool), (0, 1))
    limits = (0.0, max(float(shown.max()), 0.5))
    paint(axes, tiles, shown, "damage φ  [-]", (0, 1), not _upright(points.positions), limits=limits)


def _energies(axes: Axes, x: np.ndarray, abscissa: str, budget: Any, names: tuple[str, ...], work: str) -> None:
    """The energy budget: what the body holds, has released and lost, and the work that was done on it."""
    for name, colour in zip(names, SERIES, strict=False):
        axes.plot(x, np.asarray(getattr(budget, name)), color=colour, label=name)
    done = np.asarray(budget.supports) + np.asarray(budget.loads)
    if np.isfinite(done).all() and done.any():
        axes.plot(x, done, "--", color="#444444", label=work)
    axes.set(xlabel=abscissa, ylabel="energy")
    axes.legend(fontsize=8, frameon=False)


def crack(
    points: Points, history: History, damage: str = "damage", tips: dict | None = None, title: str = ""
) -> Figure:
    """Draw the damage of a 1D or 2D body at the end of a run, the way of the crack tips, and the energy budget.

    Parameters
    ----------
    points : Points
        The body.
    history : History
        The run, with an observer `observers.damage()`.
    damage : str, optional
        Name of that observer. Default "damage".
    tips : dict of str to array, shape (saves,), optional
        Distances [length] that crack tips have grown, by name, such as values of `observers.crack_tip`. Default: the
        number of broken bonds is drawn instead.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        If the body is 3D, if no bond could break, or if the run has no such observer.

    Examples
    --------
    >>> motion, expected = pd.scenes.spall_bar(60)
    >>> watch = {"damage": pd.observers.damage()}
    >>> criterion = pd.CriticalStretch(0.1 * expected.strain)
    >>> history = pd.simulate(motion, breaking=criterion, observers=watch, show_progress=False)
    >>> [axes.get_ylabel() for axes in pd.figures.crack(motion.scene.body, history).axes]
    ['damage φ  [-]', 'broken bonds', 'energy']
    """
    if points.dim > 2:
        raise ValueError(
            f"crack draws bodies of dim 1 and 2; got dim {points.dim}. Draw layers with pdjax.figures.field"
        )
    if history.broken_at is None or damage not in history.observed:
        raise ValueError(
            f"crack needs a run with breaking bonds and an observer {damage!r}; its observers are"
            f" {', '.join(history.observed) or 'none'}. Run simulate with breaking=… and"
            f" observers={{'{damage}': pd.observers.damage()}}"
        )
    shown = np.asarray(history.observed[damage])[-1]
    X, times = points.positions, np.asarray(history.times)
    figure, axes = _panels(X, "way", (1.35, 1))
    if points.dim == 1:
        order = np.argsort(X[:, 0])
        axes["field"].plot(X[order, 0], shown[order], ".-", color=SERIES[0], linewidth=1.0, markersize=4)
        axes["field"].set(xlabel="position x  [length]", ylabel="damage φ  [-]", ylim=(-0.02, 1.02))
    else:
        _damage(axes["field"], points, shown)
    axes["field"].set_title(title, fontsize=10)
    if tips:
        for (name, tip), colour in zip(tips.items(), SERIES, strict=False):
            axes["way"].plot(times, np.asarray(tip), color=colour, label=name)
        axes["way"].legend(fontsize=8, frameon=False)
    else:
        at = np.sort(np.asarray(history.broken_at)[np.isfinite(history.broken_at)])
        axes["way"].plot(times, np.searchsorted(at, times, side="right") / 2, color=SERIES[0])
    axes["way"].set(xlabel="t  [time]", ylabel="way of the tip  [length]" if tips else "broken bonds")
    names = ("kinetic", "strain", "released")
    _energies(axes["energy"], times, "t  [time]", history.energies, names, "work of loads and supports")
    return figure


def _with_pre_crack(path: BreakingPath) -> np.ndarray:
    """Share of the bonds of every point that have broken at the end, bonds of a pre-crack included."""
    return 1 - path.alive.sum(axis=1) / np.maximum(np.asarray(path.intact.count), 1)


def breaking_path(
    points: Points,
    path: BreakingPath,
    x: np.ndarray,
    y: np.ndarray,
    theory: np.ndarray | None = None,
    names: tuple[str, str] = ("", ""),
    title: str = "",
) -> Figure:
    """Draw the damage of a 2D body after a slow load, a load curve beside theory, and the energies.

    The damage is that of the last bonds that broke, also if no equilibrium was found after them.

    Parameters
    ----------
    points : Points
        The body.
    path : BreakingPath
        Result of `solve_breaking`.
    x, y : array, shape (states,)
        The load curve, such as openings and forces.
    theory : array, shape (states,), optional
        What theory says of y.
    names : tuple of str, optional
        Names of x and y with their units.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        If the body is not 2D.

    Examples
    --------
    >>> scene, expected = pd.scenes.cracked_plate(12)
    >>> path = pd.solve_breaking(scene, pd.CriticalStretch(1e-2), load_steps=2, show_progress=False)
    >>> factors = path.load_factors
    >>> figure = pd.figures.breaking_path(scene.body, path, factors, factors, factors, ("x", "y"))
    >>> [axes.get_xlabel() for axes in figure.axes][1:3]
    ['x', 'load factor λ  [-]']
    """
    if points.dim != 2:
        raise ValueError(f"breaking_path draws bodies of dim 2; got dim {points.dim}")
    figure, axes = _panels(points.positions, "curve", (1, 1.35))
    _damage(axes["field"], points, _with_pre_crack(path))
    axes["field"].set_title(title, fontsize=10)
    if theory is not None:
        axes["curve"].plot(x, theory, "--", color="#444444", label="theory")
    axes["curve"].plot(x, y, ".-", color=SERIES[0], markersize=4, label="computed")
    axes["curve"].set(xlabel=names[0], ylabel=names[1])
    axes["curve"].legend(fontsize=8, frameon=False)
    axes["curve"].locator_params(axis="x", nbins=6)
    names_of_energies = ("strain", "released", "dissipated")
    _energies(axes["energy"], path.load_factors, "load factor λ  [-]", path.energies, names_of_energies, "work")
    return figure
