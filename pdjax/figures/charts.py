"""Stability maps, spectra and static bars: functions that take arrays and return a matplotlib Figure.

A colour of COLOURS means the same criterion in every figure (the colour-blind-safe set of Okabe & Ito). Orders,
horizons, models and measured quantities have colours of SERIES (the muted set of Tol), which contains none of COLOURS.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import matplotlib.patches
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure, SubFigure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from ..infinite_lattice.criteria import verdicts
from ..infinite_lattice.maps import StabilityMap
from ..studies import closed_forms

COLOURS = {
    "symbol": "#000000",
    "diagonal": "#D55E00",
    "block": "#E69F00",
    "material": "#CC79A7",
    "material_center": "#CC79A7",
    "material_neighbour": "#882255",
    "affine": "#009E73",
    "local": "#0072B2",
    "continuum": "#56B4E9",
    "printed": "#444444",
}
SERIES = ("#332288", "#44AA99", "#CC6677", "#999933", "#AA4499", "#117733", "#661100")
STYLES = {
    "symbol": "-",
    "diagonal": "-",
    "affine": "-.",
    "local": ":",
    "continuum": (0, (5, 1)),
    "material_center": ":",
}
LABELS = {
    "symbol": "symbol (exact)",
    "material": "material, worst case",
    "material_center": "material, moved centre",
    "material_neighbour": "material, moved neighbour",
    "affine": "affine (long waves)",
    "local": "local (classical law)",
    "continuum": "continuum, aΓ(m) = 0",
}
_REGIONS = {"stable": "#DCE9F5", "marginal": "#FFFFFF", "unstable": "#F3C9B5", "undefined": "#BBBBBB"}
_WORDS = list(_REGIONS)
_PROVED = ("stable", "undefined", "unstable")  # colours of the proofs −1, 0 and 1


def _percent(axis) -> None:
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{100 * x:g}"))


def _regions(axes: Axes, m, a, words) -> None:
    """Draw cells coloured by verdict."""
    codes = np.vectorize(_WORDS.index)(words)
    axes.pcolormesh(
        m,
        a,
        codes.T,
        cmap=ListedColormap(list(_REGIONS.values())),
        vmin=-0.5,
        vmax=3.5,
        shading="nearest",
        rasterized=True,
    )


def _zero(axes: Axes, m, a, values, colour: str, style) -> bool:
    """Draw the line on which `values` changes sign. Return False if there is none."""
    values = np.where(np.isfinite(values), values, np.nan)
    if not ((np.nanmin(values) < 0) & (np.nanmax(values) > 0)):
        return False
    axes.contour(m, a, values.T, levels=[0.0], colors=[colour], linestyles=[style], linewidths=1.6)
    return True


def _printed(grid: StabilityMap, N: float) -> np.ndarray | None:
    """The bracket of the paper over the map, where the paper has one: hydrostatic load, linear law, 1D and 2D."""
    settings = grid.settings
    if settings.get("model", "SethHill by order") != "SethHill by order":
        return None
    if settings.get("path") != "hydrostatic" or N != int(N) or settings["influence"] != "constant_influence":
        return None
    bracket = {
        1: lambda a, m: closed_forms.bracket_1d(a, m, int(N)),
        2: lambda a, m: closed_forms.bracket_2d(a, m, int(N), form="printed"),
    }.get(settings["dim"])
    if bracket is None:
        return None
    # The paper's branch at m = 0 is not the limit of the other branch. One column of it would draw a false spike.
    orders = np.where(grid.m == 0, 1e-9, grid.m)
    return np.array([np.asarray(bracket(grid.a, m)) for m in orders])


def _one_row(grid: StabilityMap, horizon: int) -> Figure:
    """Draw the margins of every criterion along the axis of the map that has more than one value."""
    pick = (lambda x: x[horizon]) if grid.margin.ndim == 3 else (lambda x: x)
    settings, N = grid.settings, float(grid.N[horizon])
    by_load = len(grid.m) == 1
    figure = Figure(figsize=(6.4, 4.4), layout="constrained")
    axes = figure.subplots()
    curves = {settings["criterion"]: (grid.m, grid.a, pick(grid.margin))}
    curves |= {name: (grid.line_m, grid.line_a, pick(values)) for name, values in grid.lines.items()}
    for name, (m, a, values) in curves.items():
        along, style = (a if by_load else m), STYLES.get(name, "-")
        marker = "o" if len(along) == 1 else None
        look: Any = {"linestyle": style, "marker": marker, "color": COLOURS[name], "label": LABELS.get(name, name)}
        axes.plot(along, values.reshape(-1), **look)
    axes.axhline(0, color="#888888", linewidth=0.8)
    load = f"{settings['path'].replace('_', ' ')} load a"
    axes.set_xlabel(f"{load}  [%]" if by_load else f"{settings.get('parameter', 'm')}  [–]")
    axes.set_ylabel("margin  [–]   (above 0: unstable)")
    if by_load:
        _percent(axes.xaxis)
    axes.legend(fontsize=9, frameon=False)
    held = f"m = {grid.m[0]:g}" if by_load else f"a = {100 * grid.a[0]:g} %"
    figure.suptitle(f"{settings['dim']}D, N = {N:g}, {settings['law']}, {held}", fontsize=11)
    return figure


def stability_map(grid: StabilityMap, horizon: int = 0) -> Figure:
    """Draw the stable and unstable regions of a stability map over the order and the load.

    The left panel shows the verdict of the map's own criterion. If the map also holds the criterion "diagonal", a right
    panel shows the verdict of the diagonal. If the signs of the margins were proved, a last panel shows what is proved;
    open states are grey. A line marks where the margin of a criterion is zero. A dashed line marks
    the criterion that the paper prints. A map with one order or one load is drawn as curves of the margin along the
    other axis.

    Parameters
    ----------
    grid : StabilityMap
        Result of `pd.stability_map`.
    horizon : int
        Index of the horizon to draw, if the map has several.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    In 1D with m = 1, compression is unstable: half of this map.

    >>> law = pd.LinearElastic(1.0, 0.0)
    >>> grid = pd.stability_map([0.9, 1.0, 1.1], [-0.1, -0.05, 0.05, 0.1], N=2, dim=1, law=law, show_progress=False)
    >>> pd.figures.stability_map(grid).axes[0].get_title()
    'symbol (exact): 50% of this map unstable'
    """
    if min(len(grid.m), len(grid.a)) < 2:
        return _one_row(grid, horizon)
    pick = (lambda x: x[horizon]) if grid.margin.ndim == 3 else (lambda x: x)
    settings, N = grid.settings, float(grid.N[horizon])
    main = settings["criterion"]
    lines = {name: pick(values) for name, values in grid.lines.items()}
    beside = "diagonal" in lines and main != "diagonal"
    panels = 1 + beside + (grid.proof is not None)
    figure = Figure(figsize=(5.4 * panels + 0.4, 5.6), layout="constrained")
    axes = np.atleast_1d(figure.subplots(1, panels, sharey=True))
    drawn: dict[str, Line2D] = {}

    def line(on: Axes, name: str, m, a, values, style, label: str | None = None) -> None:
        if _zero(on, m, a, values, COLOURS[name], style):
            label = label or LABELS.get(name, name)
            drawn[name] = Line2D([], [], color=COLOURS[name], linestyle=style, linewidth=1.6, label=label)

    def unstable_share(words) -> str:
        return f"{np.mean(words == 'unstable'):.0%} of this map unstable"

    words = verdicts(pick(grid.margin), pick(grid.tolerance))
    _regions(axes[0], grid.m, grid.a, words)
    axes[0].set_title(f"{LABELS.get(main, main)}: {unstable_share(words)}", fontsize=10)
    for name, values in lines.items():
        line(axes[0], name, grid.line_m, grid.line_a, values, STYLES.get(name, "-"))
    line(axes[0], main, grid.m, grid.a, pick(grid.margin), "-")
    if beside:
        values = lines["diagonal"]
        colours = [_REGIONS["stable"], _REGIONS["unstable"]]
        axes[1].contourf(grid.line_m, grid.line_a, values.T, levels=[-np.inf, 0, np.inf], colors=colours)
        axes[1].set_title(f"diagonal: {unstable_share(verdicts(values, 0.0))}", fontsize=10)
        line(axes[1], "diagonal", grid.line_m, grid.line_a, values, "-")
    if beside or main == "diagonal":
        printed = _printed(grid, N)
        if printed is not None:
            line(axes[int(beside)], "printed", grid.m, grid.a, printed, "--", "diagonal, as printed in the paper")
    if grid.proof is not None:
        proof = pick(grid.proof)
        _regions(axes[-1], grid.m, grid.a, np.array(_PROVED)[proof + 1])
        shares = " ".join(f"{np.mean(proof == sign):.1%} {word}," for sign, word in ((-1, "stable"), (1, "unstable")))
        axes[-1].set_title(f"proved: {shares} {np.mean(proof == 0):.1%} open", fontsize=10)
    for on in axes:
        mine = settings.get("model", "SethHill by order")
        own = f"{settings.get('parameter', 'parameter')} of {mine}"
        on.set_xlabel("order m of the Seth–Hill strain  [–]" if mine == "SethHill by order" else own)
        on.set_xlim(grid.m.min(), grid.m.max())
        on.set_ylim(grid.a.min(), grid.a.max())
    axes[0].set_ylabel(f"{settings['path'].replace('_', ' ')} load a  [%]")
    _percent(axes[0].yaxis)
    # Every map has a line of marginal states at a = 0. The legend leaves it out.
    seen = [word for word in _WORDS if np.mean(words == word) > (2 / len(grid.a) if word == "marginal" else 0)]
    patches = [matplotlib.patches.Patch(facecolor=_REGIONS[w], edgecolor="#888888", label=w) for w in seen]
    if grid.proof is not None and (pick(grid.proof) == 0).any():
        patches.append(matplotlib.patches.Patch(facecolor=_REGIONS["undefined"], edgecolor="#888888", label="open"))
    handles = patches + list(drawn.values())
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(f"Stability of an infinite lattice, {settings['dim']}D, N = {N:g}, {settings['law']}", fontsize=11)
    return figure


class BarCase(NamedTuple):
    """One bar for `bars`: its displacement and, if known, exact solutions and a mode.

    Parameters
    ----------
    title : str
        Title of the column.
    x : array, shape (points,)
        Positions over the length of the bar [-].
    u : array, shape (points,)
        Displacements [length].
    known : dict of str to array, shape (points,)
        Known solutions by name [length]; at most two are drawn.
    unit : float
        Unit of the displacement axis [length].
    strain_unit : float
        Unit of the strain axis [-].
    mode : array, shape (points,), optional
        Eigenvector of the largest eigenvalue of the bar's Jacobian, drawn below.
    verdict : str
        Title of the panel that shows the mode.

    Examples
    --------
    >>> x = np.linspace(0, 1, 5)
    >>> case = pd.figures.BarCase("1 % strain", x, 0.01 * x, {"exact": 0.01 * x}, unit=0.01, strain_unit=0.01)
    >>> case.title
    '1 % strain'
    """

    title: str
    x: np.ndarray
    u: np.ndarray
    known: dict[str, np.ndarray]
    unit: float
    strain_unit: float
    mode: np.ndarray | None = None
    verdict: str = ""


def bars(
    cases: Sequence[BarCase], title: str, names: tuple[str, str], on: Figure | SubFigure | None = None
) -> Figure | SubFigure:
    """Draw displacement and strain of 1D bars, one column for each bar.

    The upper panel shows the displacement, the lower one the strain between neighbouring points. The difference of
    neighbouring displacements shows an alternation between points that an average over the family hides. If a bar has a
    mode, a third panel shows it.

    Parameters
    ----------
    cases : sequence of BarCase
        The bars.
    title : str
        Title of the figure.
    names : tuple of two str
        Labels of the displacement axis and of the strain axis, with their units.
    on : Figure or SubFigure, optional
        Where to draw. The default is a new figure.

    Returns
    -------
    Figure or SubFigure
        The figure, or `on`.

    Examples
    --------
    >>> x = np.linspace(0, 1, 5)
    >>> case = pd.figures.BarCase("1 % strain", x, 0.01 * x, {}, unit=0.01, strain_unit=0.01)
    >>> figure = pd.figures.bars([case], "A bar", ("u / (0.01 L)  [–]", "strain / 0.01  [–]"))
    >>> len(figure.axes), figure.axes[1].lines[0].get_ydata().round(6).tolist()
    (2, [1.0, 1.0, 1.0, 1.0])
    """
    columns, with_modes = len(cases), any(case.mode is not None for case in cases)
    if on is None:
        on = Figure(figsize=(3.3 * columns + 0.6, 7.2 if with_modes else 5.4), layout="constrained")
    figure = on
    ratios = (3, 3, 1.6) if with_modes else (1, 1)
    axes = figure.subplots(len(ratios), columns, sharex="col", squeeze=False, height_ratios=ratios)
    for column, case in enumerate(cases):
        h = np.diff(case.x)
        middle = case.x[:-1] + h / 2
        upper, lower = axes[:2, column]
        upper.plot(case.x, case.u / case.unit, color=SERIES[0], linewidth=1.2, label="pdjax")
        strains = [np.diff(case.u) / h / case.strain_unit]
        lower.plot(middle, strains[0], color=SERIES[0], linewidth=1.0)
        for (name, values), style in zip(case.known.items(), ("--", ":"), strict=False):
            upper.plot(case.x, values / case.unit, color="#000000", linestyle=style, linewidth=1.2, label=name)
            strains.append(np.diff(values) / h / case.strain_unit)
            lower.plot(middle, strains[-1], color="#000000", linestyle=style, linewidth=1.0)
        low, high = min(map(np.min, strains)), max(map(np.max, strains))
        if high - low < 0.2:  # do not magnify rounding
            lower.set_ylim(low - 0.1, high + 0.1)
        upper.set_title(case.title, fontsize=9)
        if case.mode is not None:
            size = np.abs(case.mode).max()
            axes[2, column].plot(case.x, case.mode / size, color=SERIES[1], linewidth=0.8)
            axes[2, column].set_title(case.verdict, fontsize=9)
        axes[-1, column].set_xlabel("position x / L  [–]")
    for on_left, name in zip(axes[:, 0], (*names, "mode of the largest\neigenvalue  [–]"), strict=False):
        on_left.set_ylabel(name)
    handles, words = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


def dispersion(k, eigenvalues, ticks, labels, title: str, line: str = "the line") -> Figure:
    """Draw the eigenvalues of the symbol along a line of wave vectors.

    A wave with an eigenvalue above zero is unstable. This region is shaded.

    Parameters
    ----------
    k : array, shape (waves,)
        Arc length along the line.
    eigenvalues : array, shape (waves, dim)
        Eigenvalues over M/h² [-], with the P-wave modulus M and the spacing h.
    ticks : array, shape (corners,)
        Arc lengths of the corners of the line.
    labels : sequence of str
        Names of the corners.
    title : str
        Title of the figure.
    line : str
        Name of the line, for the label of the horizontal axis.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> k = np.linspace(0, np.pi, 5)
    >>> figure = pd.figures.dispersion(k, -np.sin(k)[:, None] ** 2, [0, np.pi], ["0", "π/h"], "N = 1", "the x axis")
    >>> figure.axes[0].get_xlabel()
    'wave vector k along the x axis'
    """
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axes = figure.subplots()
    low, high = float(np.min(eigenvalues)), max(float(np.max(eigenvalues)), 0.0)
    top = high + 0.12 * (high - low)
    axes.axhspan(0, top, color=_REGIONS["unstable"], zorder=0)
    axes.text(k[-1] * 0.99, top - 0.02 * (top - low), "unstable", ha="right", va="top", fontsize=9)
    axes.set_ylim(low - 0.05 * (top - low), top)
    for branch in range(eigenvalues.shape[1]):
        axes.plot(k, eigenvalues[:, branch], color=COLOURS["symbol"], linewidth=1.4)
    axes.axhline(0, color="#888888", linewidth=0.8)
    axes.set_xticks(ticks, labels)
    axes.set_xlim(k[0], k[-1])
    axes.set_xlabel(f"wave vector k along {line}")
    axes.set_ylabel("eigenvalue of the symbol, λ h² / M  [–]")
    axes.set_title(title, fontsize=10)
    return figure
