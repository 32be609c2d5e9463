"""Picture of a fracture: which damage is a crack, which an instability, and what was measured before each burst."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from .._internal.public import public_function
from ..geometry.points import Points
from ..trust.checks import VARYING
from ..trust.fracture_verdict import CRACK, INSTABILITY, UNDECIDED, FractureVerdict, count_of
from .fields import XYZ, drawn_layer, on_page, outlines

VERDICT_COLOURS = {CRACK: "#0072B2", INSTABILITY: "#D55E00", UNDECIDED: "#777777"}
WHOLE = "#ECECEC"  # cells of points that kept all bonds
FAINTEST = 0.25  # share of its colour that the least damaged cell has
NEAR = 1e-3  # margins up to this size are drawn on a linear scale
LOWEST, HIGHEST = -1.0, 1.0  # limits of the drawn margins; collapsed matter has an infinite one

TICKS = (-1.0, -0.1, -0.01, 0.0, 0.01, 0.1, 1.0)


def colours_of(found: FractureVerdict) -> np.ndarray:
    """RGB colours (points, 3): that of the verdict of the first burst at a point, paler where few bonds broke."""
    colours = np.tile(to_rgb(WHOLE), (len(found.damage), 1))
    for i in np.flatnonzero(found.burst_of >= 0):
        share = FAINTEST + (1 - FAINTEST) * found.damage[i]
        verdict = found.bursts[found.burst_of[i]].verdict
        colours[i] = (1 - share) * colours[i] + share * np.array(to_rgb(VERDICT_COLOURS[verdict]))
    return colours


def _scatter(axes: Axes, found: FractureVerdict, values: np.ndarray) -> None:
    """One mark for each burst over its time, with an area that grows with its bonds."""
    bonds = np.array([burst.bonds for burst in found.bursts], float)
    area = 12 + 120 * np.sqrt(bonds / bonds.max())
    colour = [VERDICT_COLOURS[burst.verdict] for burst in found.bursts]
    time = [burst.time for burst in found.bursts]
    axes.scatter(time, values, s=area, c=colour, alpha=0.7, edgecolors="white", linewidths=0.5, zorder=3)


def _level(axes: Axes, at: float, words: str) -> None:
    axes.axhline(at, color="#888888", linewidth=0.8, linestyle="--", zorder=0)
    where: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "ha": "left", "va": "bottom", "zorder": 4}
    axes.text(0.01, at, words, fontsize=7, color="#555555", **where)


@public_function
def crack_or_instability(points: Points, found: FractureVerdict, title: str = "", cut=None) -> Figure:
    """Draw the damage coloured by verdict, and the margin and zero-energy share before every burst.

    A point has the colour of the burst that broke its first bond. The colour is the stronger, the more bonds the point
    has lost. A 1D body is drawn as damage over the position. Margins are drawn on a linear scale up to ±0.001 and on a
    logarithmic one beyond.

    Parameters
    ----------
    points : Points
        The body.
    found : FractureVerdict
        Result of `crack_or_instability` for this body.
    title : str
        Title of the figure. Default: the verdict and the number of bursts.
    cut : tuple of (int, float), optional
        (axis, coordinate [length]) of the layer of a 3D body, as in `field`. Default: the layer of the first burst.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        If the verdict is that of another body, or cut does not pass through a 3D body.

    Examples
    --------
    >>> body = pd.lattice((3, 2))
    >>> burst = pd.Burst("crack", 0.5, 0.5, 5, 4, np.zeros(2), 1, -0.08, 0.1, None, "the lattice was stable")
    >>> found = pd.FractureVerdict((burst,), np.eye(6)[0] / 3, np.eye(6, dtype=int)[0] - 1, "t")
    >>> pd.figures.crack_or_instability(body, found).get_suptitle()
    'crack: 1 burst'
    """
    if not isinstance(found, FractureVerdict) or not isinstance(points, Points) or len(found.damage) != len(points):
        raise ValueError(
            "found must be the result of crack_or_instability for these points; got"
            f" {type(found).__name__} for {type(points).__name__}"
        )
    if points.dim == 3 and cut is None and found.bursts:
        cut = (2, float(found.bursts[0].place[2]))
    kept, across, layer = drawn_layer(points, cut)
    colours, size = colours_of(found), np.array([5.4, 3.4])
    if points.dim > 1:
        tiles = outlines(points, points.positions, kept, across)
        size = on_page(np.ptp(tiles.reshape(-1, 2), axis=0))[1]
    figure = Figure(figsize=(size[0] + 5.0, max(size[1], 3.8) + 1.2), layout="constrained")
    grid = figure.add_gridspec(2, 2, width_ratios=[size[0] + 0.8, 4.0])
    body, upper = figure.add_subplot(grid[:, 0]), figure.add_subplot(grid[0, 1])
    lower = figure.add_subplot(grid[1, 1], sharex=upper)
    if points.dim == 1:
        body.vlines(points.positions[:, 0], 0, found.damage, colors=[tuple(c) for c in colours.tolist()], linewidths=3)
        body.set(xlabel="x  [length]", ylabel="damage  [-]", ylim=(0, 1.02))
    else:
        body.add_collection(
            PolyCollection(list(tiles), facecolors=colours[kept], edgecolors="face", linewidths=0.5, rasterized=True)
        )
        body.autoscale_view()
        body.set_aspect("equal")
        body.set(xlabel=f"{XYZ[across[0]]}  [length]", ylabel=f"{XYZ[across[1]]}  [length]")
    body.set_title("damage, by the verdict on the first burst at each point", fontsize=9)
    if found.bursts:
        margins = np.array([burst.margin for burst in found.bursts])
        _scatter(upper, found, np.clip(margins, LOWEST, HIGHEST))
        _scatter(lower, found, np.array([burst.zero_energy for burst in found.bursts]))
    upper.set_yscale("symlog", linthresh=NEAR)
    upper.set(ylabel="margin before the burst  [-]", ylim=(LOWEST, HIGHEST))
    upper.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
    upper.tick_params(labelbottom=False)
    lower.set(ylabel="zero-energy share  [-]", xlabel=f"{found.abscissa} of the burst", ylim=(0, 1.02))
    _level(upper, 0.0, "unstable above")
    if found.soft < 0:
        _level(upper, found.soft, "soft above")
    _level(lower, VARYING, "limit of a soft lattice")
    counts = [(verdict, n) for verdict, n in found.counts.items() if n]
    marks = [
        Line2D(
            [],
            [],
            marker="o",
            linestyle="",
            color=VERDICT_COLOURS[v],
            label=f"{v}: {count_of(n, 'burst')}, {count_of(found.bonds[v], 'bond')}",
        )
        for v, n in counts
    ]
    if marks:
        figure.legend(handles=marks, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    if title == "":
        title = f"{found.verdict}: {count_of(len(found.bursts), 'burst')}" if found.bursts else found.verdict
    figure.suptitle("\n".join(word for word in (title, layer) if word), fontsize=10)
    return figure
