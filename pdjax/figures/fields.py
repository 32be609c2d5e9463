"""Pictures of bodies: a field on the points, and a scene with its supports and loads.

A point of a lattice is drawn as its cell. In a deformed body the cell is a parallelogram that follows the neighbours of
the point. A point of a cloud is drawn as a disc of the same area (2D), or with the radius of a ball of the same volume
(3D). The sizes are in the units of the axes.
"""

from collections.abc import Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy.spatial import cKDTree

from .._internal.public import public_function
from ..finite_body.scene import Scene
from ..geometry.points import Points
from .charts import SERIES

XYZ = "xyz"
GREY, POINT = "#9A9A9A", "#D9D9D9"
AROUND = "#F0F0F0"  # of a field: the middle of the diverging colours is nearly white
ROUNDING = 1e-9  # relative to the largest value: smaller values and differences count as rounding
ROOM = (5.4, 4.6)  # largest size of a body on the page [inch]
ARROWS = 16  # most arrows along the longest side of a body
WIDE = 2.2  # width over height from which the colour bar lies below the body


def _component(values: np.ndarray, component: Any, dim: int) -> tuple[np.ndarray, str]:
    """The number of each point that is drawn (points,), and its name as a component."""
    if values.ndim == 1:
        if component is not None:
            raise ValueError(
                f"component is for vectors and tensors, and these values of shape {values.shape} are scalars: leave"
                " component out"
            )
        return values, ""
    rank = values.ndim - 1
    if component is None and dim == 1:
        component = (0,) * rank
    if component is None and rank == 1:
        return np.linalg.norm(values, axis=1), "magnitude"
    chosen = () if component is None else tuple(np.atleast_1d(component).tolist())
    if len(chosen) != rank or any(c not in range(dim) for c in chosen):
        what = f"a number 0 to {dim - 1}" if rank == 1 else f"a pair of numbers 0 to {dim - 1}, such as (0, {dim - 1})"
        raise ValueError(f"component must be {what} for values of shape {values.shape}; got {component!r}")
    name = f"component {''.join(XYZ[c] for c in chosen)}" if dim > 1 else ""  # a bar has one component only
    return values[(slice(None), *chosen)], name


def _checked(points: Points, values: object, u: object) -> tuple[np.ndarray, np.ndarray]:
    """The values as floats, and the positions at which the points are drawn (points, dim)."""
    values, X = np.asarray(values), points.positions
    count, dim = X.shape
    if values.dtype.kind not in "biuf":
        raise ValueError(f"values must be real numbers; got the dtype {values.dtype}")
    if values.shape not in ((count,), (count, dim), (count, dim, dim)):
        raise ValueError(
            f"values must have shape ({count},), ({count}, {dim}) or ({count}, {dim}, {dim}): a number, a vector or a"
            f" tensor for each of the {count} points of this {dim}D body; got {values.shape}"
        )
    if u is None:
        return values.astype(float), X
    u = np.asarray(u)
    if u.shape != X.shape:
        raise ValueError(f"u must have shape (points, dim) = {X.shape}, one displacement for each point; got {u.shape}")
    if not np.isfinite(u).all():
        bad = int(np.argmin(np.isfinite(u).all(axis=1)))
        raise ValueError(f"u must be finite, to place the points; point {bad} has {u[bad]}. Leave u out to see values")
    return values.astype(float), X + u


def _sides(points: Points) -> np.ndarray:
    """Edge lengths (points,) of cells of the points' volumes."""
    return np.broadcast_to(points.spacing or points.volumes ** (1 / points.dim), (len(points),))


def drawn_layer(points: Points, cut: Any) -> tuple[np.ndarray, tuple[int, ...], str]:
    """Which points are drawn (points,), the axes of the picture, and the layer in words."""
    dim = points.dim
    if dim < 3:
        if cut is not None:
            raise ValueError(f"cut is for 3D bodies, and this body is {dim}D: leave cut out")
        return np.ones(len(points), bool), tuple(range(dim)), ""
    X = points.positions
    middle = (X.min(axis=0) + X.max(axis=0)) / 2
    given = (2, middle[2]) if cut is None else cut
    fits = isinstance(given, Sequence) and len(given) == 2 and given[0] in range(3)
    if not fits or not isinstance(given[1], int | float | np.number):
        raise ValueError(f"cut must be (axis, coordinate) with axis 0, 1 or 2, such as (2, {middle[2]:g}); got {cut!r}")
    axis, coordinate = int(given[0]), float(given[1])
    along, half = X[:, axis], _sides(points) / 2
    low, high = (along - half).min(), (along + half).max()
    if not low <= coordinate <= high:
        raise ValueError(
            f"cut must pass through the body, which reaches from {low:g} to {high:g} along {XYZ[axis]}; got the"
            f" coordinate {coordinate:g}"
        )
    nearest = along[np.argmin(np.abs(along - coordinate))]
    kept = np.abs(along - nearest) < 0.999 * half  # the next layer of a lattice is two half cells away
    return kept, tuple(k for k in range(3) if k != axis), f"layer {XYZ[axis]} = {nearest:.4g}"


def _limits(shown: np.ndarray) -> tuple[float, float, str]:
    """Limits of the finite values, and whether they are "signed" (of both signs), of "one sign" or "uniform".

    Limits of signed values are symmetric about 0.
    """
    finite = shown[np.isfinite(shown)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    size = max(-low, high)
    if low < -ROUNDING * size and high > ROUNDING * size:
        return -size, size, "signed"
    if high - low > ROUNDING * size:
        return low, high, "one sign"
    return (low - 0.05 * size, high + 0.05 * size, "uniform") if size > 0 else (-1.0, 1.0, "uniform")


def _edges(X: np.ndarray, place: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Edge vectors (points, 2, 2) of the deformed cells of a lattice, from the neighbours along both axes.

    An edge that is stretched by more than half, as between the faces of a crack, keeps its reference length.
    """
    rest = side[:, None, None] * np.eye(2)
    if place is X:
        return rest
    tree, total, count = cKDTree(X), np.zeros_like(rest), np.zeros((*rest.shape[:2], 1))
    for axis in range(2):
        for sign in (-1.0, 1.0):
            away, near = tree.query(X + sign * rest[:, axis])
            edge = sign * (place[near] - place)
            good = (away < 0.1 * side) & (np.linalg.norm(edge, axis=1) < 1.5 * side)
            total[good, axis] += edge[good]
            count[good, axis] += 1
    return np.where(count > 0, total / np.maximum(count, 1), rest)


def _tiles(points: Points, X: np.ndarray, place: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Outlines (points, corners, 2) of the cells or discs, for positions (points, 2) before and after deformation."""
    if points.spacing is not None:
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
        return place[:, None, :] + np.einsum("ck,pkx->pcx", corners, _edges(X, place, side))
    angle = 2 * np.pi * np.arange(20) / 20
    radius = side * (np.pi ** (-1 / 2) if points.dim == 2 else (0.75 / np.pi) ** (1 / 3))
    return place[:, None, :] + radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def on_page(extent: np.ndarray) -> tuple[float, np.ndarray]:
    """Inches for a unit of length, and the size (2,) of the drawn body on the page [inch]."""
    extent = np.maximum(extent, 1e-3 * extent.max())
    scale = float(min(ROOM[0] / extent[0], ROOM[1] / extent[1]))
    return scale, scale * extent


def _curve(place: np.ndarray, shown: np.ndarray, deformed: bool, title: str, label: str) -> Figure:
    """A field on a bar, drawn as a curve over the position."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.subplots()
    order = np.argsort(place)
    x, y = place[order], shown[order]
    axes.plot(x, y, ".-", color=SERIES[0], linewidth=1.0, markersize=4)
    low, high, kind = _limits(y)
    if kind == "uniform":
        axes.set_ylim(low, high)  # do not magnify rounding
    if kind == "signed":
        axes.axhline(0, color="#888888", linewidth=0.6, zorder=0)
    missing = x[~np.isfinite(y)]
    if len(missing):
        grey: dict[str, Any] = {"color": GREY, "markersize": 6, "clip_on": False, "label": "no value"}
        axes.plot(missing, np.zeros_like(missing), "s", transform=axes.get_xaxis_transform(), **grey)
        figure.legend(loc="outside lower center", fontsize=9, frameon=False)
    axes.set_xlabel(f"{'deformed position' if deformed else 'position'} x  [length]")
    axes.set_ylabel(label or "value")
    axes.set_title(title, fontsize=10)
    return figure


@public_function
def field(points: Points, values, u=None, title: str = "", label: str = "", component=None, cut=None) -> Figure:
    """Draw a field on the points of a body, at the reference or the deformed positions.

    Values of both signs have diverging colours about 0. Values of one sign have sequential colours. Points without a
    finite value are grey. A 1D body is drawn as a curve over x, whose vertical axis takes the place of the colour bar.
    Of a 3D body one layer of points is drawn.

    Parameters
    ----------
    points : Points
        The body.
    values : array, shape (points,), (points, dim) or (points, dim, dim)
        A scalar, a vector or a tensor of every point.
    u : array, shape (points, dim), optional
        Displacements [length]. With u the points are drawn at their deformed positions.
    title : str
        Title of the figure.
    label : str
        Name and unit of the field, for the colour bar, such as "stress σ  [MPa]".
    component : int or pair of int, optional
        Component to draw: a number for a vector, a pair for a tensor. Without it a vector is drawn by its magnitude. In
        1D the only component is drawn.
    cut : tuple of (int, float), optional
        (axis, coordinate [length]) of the layer of a 3D body. The layer of points nearest to the coordinate is drawn.
        The default is the middle of the last axis.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    ValueError
        If values or u have another shape, component does not fit values, or cut does not pass through a 3D body.

    Examples
    --------
    >>> body = pd.lattice((5, 4))
    >>> u = 0.1 * body.positions * [1.0, -1.0]
    >>> figure = pd.figures.field(body, u, u, label="displacement u  [mm]", component=1)
    >>> figure.axes[1].get_ylabel(), round(figure.axes[0].collections[0].get_clim()[0], 3)
    ('displacement u  [mm], component y', -0.35)
    """
    values, place = _checked(points, values, u)
    shown, name = _component(values, component, points.dim)
    kept, across, layer = drawn_layer(points, cut)
    label = ", ".join(word for word in (label, name) if word)
    if points.dim == 1:
        return _curve(place[:, 0], shown, u is not None, title, label)
    tiles, shown = outlines(points, place, kept, across), shown[kept]
    missing = bool((~np.isfinite(shown)).any())
    _, (width, height) = on_page(np.ptp(tiles.reshape(-1, 2), axis=0))
    below = bool(width > WIDE * height)
    width += 1.0 if below else 2.0  # room for the colour bar, the labels and the legend
    height += (2.2 if below else 1.2) + 0.3 * missing
    figure = Figure(figsize=(max(width, 3.8), max(height, 2.6)), layout="constrained")
    axes = figure.subplots()
    paint(axes, tiles, shown, label, across, below)
    if missing:
        grey = Patch(facecolor=GREY, edgecolor="#888888", label="no value")
        figure.legend(handles=[grey], loc="outside lower center", fontsize=9, frameon=False)
    axes.set_title("\n".join(word for word in (title, layer) if word), fontsize=10)
    return figure


def outlines(points: Points, place: np.ndarray, kept: np.ndarray, across: tuple[int, ...]) -> np.ndarray:
    """Outlines (kept, corners, 2) of the cells or discs of the points that are drawn, at `place` (points, dim)."""
    X = points.positions[kept][:, across]
    moved = X if place is points.positions else place[kept][:, across]
    return _tiles(points, X, moved, _sides(points)[kept])


def paint(
    axes: Axes,
    tiles: np.ndarray,
    shown: np.ndarray,
    label: str,
    across: tuple[int, ...],
    below: bool,
    signed: bool = False,
    limits: tuple[float, float] | None = None,
) -> None:
    """Draw values (kept,) on the outlines, with a colour bar on the right or below.

    If `signed` is True, the colours are symmetric about 0 also for values of one sign. `limits` are those of the
    colours; by default they are those of the values.
    """
    low, high, kind = _limits(np.concatenate([shown, -shown]) if signed else shown)
    low, high = limits or (low, high)
    cmap = matplotlib.colormaps["RdBu_r" if kind == "signed" else "cividis"].with_extremes(bad=GREY)
    masked = np.ma.masked_invalid(shown)
    drawn = PolyCollection(list(tiles), array=masked, cmap=cmap, edgecolors="face", linewidths=0.5, rasterized=True)
    drawn.set_clim(low, high)
    axes.add_collection(drawn)
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_facecolor(AROUND)
    figure: Any = axes.figure
    beyond = "max" if limits is not None and shown.max(initial=high) > high else "neither"
    figure.colorbar(drawn, ax=axes, label=label, location="bottom" if below else "right", shrink=0.9, extend=beyond)
    axes.set(xlabel=f"{XYZ[across[0]]}  [length]", ylabel=f"{XYZ[across[1]]}  [length]")


def _thinned(X: np.ndarray, cell: float, side: float) -> np.ndarray:
    """Numbers of points, one in every cube of side `cell`: the point nearest to the middle of the cube."""
    at = (X - X.min(axis=0) + 0.25 * side) / cell  # the shift keeps lattice points away from the faces of the cubes
    order = np.argsort(np.linalg.norm(at - np.floor(at) - 0.5, axis=1).round(6), kind="stable")
    first = np.unique(np.floor(at[order]), axis=0, return_index=True)[1]
    return np.sort(order[first])


def _arrows(axes: Axes, X: np.ndarray, vectors: np.ndarray, cell: float, side: float, lift: float, colour: str) -> None:
    """Arrows at the points with a vector, one in every cube of side `cell`; the longest nearly fills its cube."""
    size = np.linalg.norm(vectors, axis=1)
    some = np.flatnonzero(size > ROUNDING * size.max())
    some = some[_thinned(X[some], cell, side)]
    X, arrows = X[some], vectors[some] * (0.9 * cell / size.max())
    if X.shape[1] == 3:
        axes.quiver(*X.T, *arrows.T, color=colour, arrow_length_ratio=0.35, linewidth=1.3)
        return
    if X.shape[1] == 1:
        X, arrows = np.pad(X, ((0, 0), (0, 1)), constant_values=lift), np.pad(arrows, ((0, 0), (0, 1)))
    look: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.005, "zorder": 4}
    axes.quiver(*X.T, *arrows.T, color=colour, **look)


def _loads(scene: Scene) -> list[tuple[str, np.ndarray, str, float]]:
    """(label, vectors (points, dim), colour, height above a bar) of prescribed displacements and of body forces."""
    dim = scene.body.dim
    unit = "[force/length]" if dim == 1 else f"[force/length{'²³'[dim - 2]}]"
    kinds = (
        ("prescribed displacement, largest {:.3g} [length]", scene.prescribed, SERIES[2], 0.4),
        ("body force, largest {:.3g} " + unit, scene.load, SERIES[5], -0.4),
    )
    found = []
    for words, given, colour, lift in kinds:
        vectors = np.asarray(given, dtype=float)
        largest = np.linalg.norm(vectors, axis=1).max()
        if largest > 0:
            found.append((words.format(largest), vectors, colour, lift))
    return found


def _supports(scene: Scene) -> list[tuple[str, np.ndarray, str]]:
    """(label, points, marker) for every set of components that is held at some points."""
    held, dim = ~scene.free, scene.body.dim
    kinds = sorted(
        map(tuple, np.unique(held[held.any(axis=1)], axis=0)), key=lambda kind: (sum(kind), *~np.array(kind))
    )
    found = []
    for kind in kinds:
        components = np.flatnonzero(kind)
        names = "u" if dim == 1 else ", ".join(f"u_{XYZ[c]}" for c in components)
        marker = "s" if len(components) > 1 or dim == 1 else ">^D"[components[0]]
        found.append((f"{names} held", np.flatnonzero((held == kind).all(axis=1)), marker))
    return found


def _words(scene: Scene) -> str:
    """The scene's period and mean deformation in words."""
    period = scene.body.period
    words = []
    if period is not None:
        words.append("periodic along " + ", ".join(XYZ[k] for k, p in enumerate(period) if np.isfinite(p)))
    if scene.mean is not None:
        rows = ", ".join("[" + ", ".join(f"{x:.4g}" for x in row) + "]" for row in np.asarray(scene.mean))
        words.append(f"mean deformation [{rows}]".replace("-", "−"))
    return "; ".join(words)


@public_function
def scene(scene: Scene, title: str = "") -> Figure:
    """Draw the points, the supports and the loads of a scene.

    A marker shows a point with held components. Arrows show prescribed displacements and body forces. The legend
    gives the largest value of each kind. Where arrows would be dense, only some of the points have one.

    Parameters
    ----------
    scene : Scene
        The scene, from `pd.scene` or `pd.scenes`.
    title : str
        Title of the figure. The default is the name of the scene.

    Returns
    -------
    Figure
        The figure. A 3D body is drawn in perspective.

    Examples
    --------
    >>> figure = pd.figures.scene(pd.scenes.step_size_bar(21, strain=-0.001))
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['21 points', 'u held', 'prescribed displacement, largest 0.000476 [length]']
    """
    body = scene.body
    X, dim, sides = body.positions, body.dim, _sides(body)
    low, high = (X - sides[:, None] / 2).min(axis=0), (X + sides[:, None] / 2).max(axis=0)
    side, longest = float(np.median(sides)), float((high - low).max())
    cell = side * max(1, round(longest / (ARROWS * side)))  # side of the cubes that hold one arrow each
    supports, loads = _supports(scene), _loads(scene)
    room = cell if loads else 0.02 * longest
    low, high = low - room, high + room
    extent = (high - low)[:2] if dim == 2 else np.full(2, longest)
    inches, drawn = on_page(extent)
    lines = (2 + len(supports) + len(loads)) // 2
    width, height = (7.0, 1.0) if dim == 1 else (max(drawn[0] + 0.8, 5.4), drawn[1])
    if dim == 3:
        height *= np.clip(0.35 + (high - low)[1:].sum() / (2 * longest), 0.65, 1.0)  # a long body needs less room
    below = 0.1 + 0.22 * lines  # room for the legend [inch]
    height += 1.1 + below
    # The constrained layout cannot place 3D axes: their labels count as larger than the figure.
    figure = Figure(figsize=(width, height), layout=None if dim == 3 else "constrained")
    axes: Any = (
        figure.add_axes((0.0, below / height, 0.95, 1 - (below + 0.5) / height), projection="3d")
        if dim == 3
        else figure.subplots()
    )
    pitch = 72 * inches * side  # distance of neighbours on the page [point]
    look: dict[str, Any] = {"linestyle": "", "clip_on": False}
    at = np.pad(X, ((0, 0), (0, 1))).T if dim == 1 else X.T
    axes.plot(*at, "o", color=POINT, markersize=np.clip(0.8 * pitch, 1, 8), **look, label=f"{len(body)} points")
    for number, (label, some, marker) in enumerate(supports):
        look |= {"markersize": np.clip(0.55 * pitch, 2, 6), "color": SERIES[(0, 1, 4, 3, 6)[number % 5]], "zorder": 3}
        axes.plot(*at[:, some], marker, **look, label=label)
    handles, _ = axes.get_legend_handles_labels()
    for label, vectors, colour, lift in loads:
        _arrows(axes, X, vectors, cell, side, lift, colour)
        handles.append(Line2D([], [], linestyle="", marker=r"$\rightarrow$", markersize=13, color=colour, label=label))
    for name, bottom, top in zip(XYZ, low, high, strict=False):
        axes.set(**{f"{name}lim": (bottom, top), f"{name}label": f"{name}  [length]"})
    if dim == 1:
        axes.set_ylim(-1, 1)
        axes.set_yticks([])
    elif dim == 2:
        axes.set_aspect("equal")
    else:
        axes.set_box_aspect(high - low, zoom=0.85)
        for axis, part in zip((axes.xaxis, axes.yaxis, axes.zaxis), (high - low) / (high - low).max(), strict=True):
            axis.set_major_locator(MaxNLocator(max(2, round(5 * part))))  # the labels of a short side would overlap
            axis.labelpad = 12 * part
    figure.legend(
        handles=handles, loc="lower center" if dim == 3 else "outside lower center", ncols=2, fontsize=9, frameon=False
    )
    words = (title or scene.name, _words(scene))
    axes.set_title("\n".join(word for word in words if word), fontsize=10)
    return figure
