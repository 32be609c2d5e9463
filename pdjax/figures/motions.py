"""Figures of motions: dispersion curves, force against strain, amplitude and energy error in time, animations."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, NotRequired, TypedDict

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure, SubFigure
from numpy.typing import ArrayLike

from .._internal.checks import moved_whole
from ..finite_body.dynamics.history import History
from ..finite_body.scene import Scene
from .charts import COLOURS, SERIES

# A component below this fraction of the largest displacement is rounding. Symmetric runs leave 1e-12.
ZERO = 1e-9


class Branch(NamedTuple):
    """One curve of `dispersion_curves`.

    Parameters
    ----------
    name : str
        Name in the legend. "classical", "symbol" and "continuum" have their fixed colours.
    k : array, shape (waves,)
        Wave numbers k h/π [-].
    omega : array, shape (waves,)
        Frequencies ω h/c [-].
    style : str
        Line style of matplotlib.
    zero : array, optional
        Zero-energy modes, which get a ring on the axis: a mask (waves,) or the indices of waves.

    Examples
    --------
    >>> k = np.linspace(0, 1, 5)
    >>> pd.figures.Branch("N = 1", k, np.sin(np.pi * k), zero=np.array([4])).name
    'N = 1'
    """

    name: str
    k: np.ndarray
    omega: np.ndarray
    style: str = "-"
    zero: np.ndarray | None = None


def dispersion_curves(
    panels: dict[str, Sequence[Branch]],
    title: str,
    highest: float | None = None,
    on: Figure | SubFigure | None = None,
) -> Figure | SubFigure:
    """Draw dispersion curves ω(k) of several models or branches, one panel for each entry.

    Zero-energy modes are marked by rings.

    Parameters
    ----------
    panels : dict of str to sequence of Branch
        Title of each panel and its curves.
    title : str
        Title of the figure.
    highest : float, optional
        Upper end of the vertical axis [-].
    on : Figure or SubFigure, optional
        Where to draw. The default is a new figure.

    Returns
    -------
    Figure or SubFigure
        The figure, or `on`.

    Examples
    --------
    >>> k = np.linspace(0, 1, 5)
    >>> branch = pd.figures.Branch("N = 1", k, np.sin(np.pi * k), zero=np.array([4]))
    >>> figure = pd.figures.dispersion_curves({"1D": [branch]}, "Dispersion")
    >>> [text.get_text() for text in figure.legends[0].get_texts()]
    ['N = 1', 'zero-energy mode']
    """
    figure = Figure(figsize=(4.6 * len(panels) + 0.4, 4.6), layout="constrained") if on is None else on
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    fixed = {"classical": "#888888", "symbol": COLOURS["symbol"], "continuum": COLOURS["continuum"]}
    rings = []
    for panel, (name, branches) in zip(axes, panels.items(), strict=True):
        colour = 0
        for branch in branches:
            shade = fixed.get(branch.name, SERIES[colour % len(SERIES)])
            colour += branch.name not in fixed
            panel.plot(branch.k, branch.omega, branch.style, color=shade, linewidth=1.4, label=branch.name)
            at = [] if branch.zero is None else np.asarray(branch.k)[np.asarray(branch.zero)]
            if len(at):
                ring: dict[str, Any] = {"mfc": "none", "mec": COLOURS["symbol"], "ms": 8, "clip_on": False, "zorder": 5}
                rings += panel.plot(at, np.zeros_like(at), "o", **ring)
        panel.set_title(name, fontsize=10)
        panel.set_xlabel("wave number  k h / π  [–]")
        panel.set_xlim(branches[0].k[0], branches[0].k[-1])
    axes[0].set_ylabel("frequency  Re ω h / c  [–]")
    axes[0].set_ylim(0, highest)
    handles, words = axes[0].get_legend_handles_labels()
    handles, words = handles + rings[:1], words + ["zero-energy mode"] * len(rings[:1])
    figure.legend(handles, words, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


class CuboidRun(TypedDict):
    """Strains and forces of one run, as `cuboid` draws them."""

    strain: ArrayLike
    force: ArrayLike
    style: NotRequired[str]


class CuboidField(TypedDict):
    """Displacements of one run, as `cuboid` draws them."""

    u: ArrayLike
    shape: tuple[int, int, int]
    spacing: float
    name: str


def cuboid(runs: dict[str, CuboidRun], title: str, field: CuboidField | None = None) -> Figure:
    """Draw force against strain of several runs of the cuboid, and the displacements of one run on its middle plane.

    Parameters
    ----------
    runs : dict of str to dict
        Name → {"strain": (saves,) [-], "force": (saves,) over E₀ A [-], "style": line style, optional}.
    title : str
        Title of the figure.
    field : dict, optional
        {"u": (points, 3), "shape": points along each axis, "spacing": h, "name": str} of the run whose displacements
        are drawn. All three components have the same colour scale.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> strain = np.linspace(0, 0.1, 5)
    >>> figure = pd.figures.cuboid({"m = 1": {"strain": strain, "force": strain}}, "A cuboid")
    >>> figure.axes[0].get_xlabel()
    'strain of the ends  [%]'
    """
    figure = Figure(figsize=(8.6, 8.4 if field else 4.6), layout="constrained")
    if field:
        upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.15, 1))[:, 0]
    else:
        upper, lower = figure, None
    axes = upper.subplots()
    for number, (name, run) in enumerate(runs.items()):
        colour = SERIES[number % len(SERIES)]
        strain, force = 100 * np.asarray(run["strain"]), np.asarray(run["force"])
        axes.plot(strain, force, run.get("style", "-"), color=colour, linewidth=1.3, label=name)
    strains = 100 * np.concatenate([run["strain"] for run in runs.values()])
    ends = np.array([strains.min(), strains.max()])
    axes.plot(ends, ends / 100, ":", color="#888888", linewidth=1.1, label="E₀ × strain: classical bar at small strain")
    axes.axhline(0, color="#888888", linewidth=0.6)
    axes.set_xlabel("strain of the ends  [%]")
    axes.set_ylabel("force through the middle / (E₀ A)  [–]")
    axes.legend(frameon=False, fontsize=8)
    axes.set_title(title, fontsize=10)
    if field:
        shape, h = field["shape"], field["spacing"]
        u = np.asarray(field["u"]).reshape(*shape, 3)
        columns = lower.subplots(3, 1, sharex=True)
        planes = np.moveaxis(u[:, :, shape[2] // 2], -1, 0) / h
        limit = (
            float(np.abs(planes).max()) or 1.0
        )  # one colour scale, so that rounding does not look like a displacement
        zero = [f"u_{axis}" for axis, plane in zip("xyz", planes, strict=True) if np.abs(plane).max() < ZERO * limit]
        said = f"; zero to rounding: {', '.join(zero)}" if zero else ""
        lower.suptitle(f"{field['name']}: displacement on the middle plane of z, same colour scale{said}", fontsize=9)
        for k, on in enumerate(columns):
            plane = planes[k].T
            image = on.imshow(
                plane,
                origin="lower",
                extent=(0, shape[0] * h, 0, shape[1] * h),
                cmap="RdBu_r",
                vmin=-limit,
                vmax=limit,
            )
            on.set_ylabel("y")
            lower.colorbar(image, ax=on, label=f"u_{'xyz'[k]} / h", shrink=0.9)
        columns[-1].set_xlabel("x  [length of a side]")
    return figure


def motion(history: History, amplitude: np.ndarray, law: dict[str, np.ndarray], title: str, unit: str = "") -> Figure:
    """Draw the amplitude of a mode in time next to predicted curves, and the error of the energy budget below.

    If the amplitude grows by more than a factor of a thousand, the axis is logarithmic.

    Parameters
    ----------
    history : History
        Result of `pd.simulate`.
    amplitude : array, shape (saves,)
        Amplitude of the mode over its initial value [-].
    law : dict of str to array, shape (saves,)
        Predicted curves by name [-].
    title : str
        Title of the figure.
    unit : str
        Label of the time unit.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> history = pd.simulate(motion, show_progress=False)
    >>> amplitude = np.asarray(pd.amplitude(history.u, motion.start))
    >>> pd.figures.motion(history, amplitude / amplitude[0], {}, "A wave").axes[1].get_ylabel()
    'energy error  [–]'
    """
    figure = Figure(figsize=(7.4, 5.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    grows = np.abs(amplitude).max() > 1e3 * np.abs(amplitude[0])
    shown = np.abs(amplitude) if grows else amplitude
    upper.plot(history.times, shown, "o", color=SERIES[0], markersize=3.5, label="motion")
    for name, values in law.items():
        upper.plot(history.times, np.abs(values) if grows else values, "-", color="#000000", linewidth=1.1, label=name)
    if grows:
        upper.set_yscale("log")
    upper.set_ylabel("amplitude of the mode / its start  [–]")
    upper.legend(frameon=False, fontsize=9)
    upper.set_title(title, fontsize=10)
    lower.plot(history.times, np.asarray(history.energies.error), color=SERIES[1], linewidth=1.1)
    lower.set_ylabel("energy error  [–]")
    lower.ticklabel_format(axis="y", style="sci", scilimits=(0, 0))
    lower.set_xlabel(f"time  {unit or '[unit of time]'}")
    return figure


def animation(
    scene: Scene, history: History, path: str | os.PathLike, component: int = 0, scale: float = 1.0, fps: int = 15
) -> Path:
    """Write an animation of a motion, coloured by one component of the displacement.

    The file is a GIF, or an MP4 where the program ffmpeg is installed.

    In 1D it shows u over x. In 3D the view is along z.

    Parameters
    ----------
    scene : Scene
        The scene of the motion.
    history : History
        Result of `pd.simulate` with `fields=True`.
    path : str or path
        File to write, ending in .gif or .mp4.
    component : int
        Component of the displacement that sets the colour, 0 to dim − 1.
    scale : float
        Factor by which the displacements are exaggerated [-].
    fps : int
        Frames per second.

    Returns
    -------
    Path
        The path of the file.

    Raises
    ------
    ValueError
        If the path has another ending, the history has no fields, or ffmpeg is missing for MP4.
    OSError
        If ffmpeg fails.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> motion = pd.scenes.wave(8, N=1, model=pd.BondBased(1.0))
    >>> history = pd.simulate(motion, 1.0, dt=0.5, show_progress=False)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     pd.figures.animation(motion.scene, history, pathlib.Path(folder) / "wave.gif").name
    'wave.gif'
    """
    path = Path(path)
    if path.suffix not in (".gif", ".mp4"):
        raise ValueError(f"path must end in .gif or .mp4; got {path.name!r}")
    if path.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError("an .mp4 needs the program ffmpeg, which is not installed; install it or name a .gif instead")
    if len(history.u) != len(history.times):
        raise ValueError(
            "an animation needs the displacements of every save, and this history kept no fields but the last; run"
            " `simulate` with fields=True"
        )
    X, u, dim = scene.body.positions, np.asarray(history.u), scene.body.dim
    colour = u[:, :, component]
    limit = float(np.abs(colour).max()) or 1.0
    figure = Figure(figsize=(7.2, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.set_xlabel("x")
    if dim == 1:
        (line,) = axes.plot(X[:, 0], colour[0], ".-", color=SERIES[0], linewidth=0.8, markersize=3)
        axes.set_ylim(-1.1 * limit, 1.1 * limit)
        axes.set_ylabel("u")
    else:
        place = X[:, :2] + scale * u[:, :, :2]
        x, y = place[0].T
        marks = axes.scatter(x, y, c=colour[0], s=9, cmap="RdBu_r", vmin=-limit, vmax=limit)
        low, high = place.reshape(-1, 2).min(0), place.reshape(-1, 2).max(0)
        axes.set_xlim(low[0] - 0.02 * np.ptp(X[:, 0]), high[0] + 0.02 * np.ptp(X[:, 0]))
        axes.set_ylim(low[1] - 0.02 * np.ptp(X[:, 0]), high[1] + 0.02 * np.ptp(X[:, 0]))
        axes.set_aspect("equal")
        axes.set_ylabel("y")
        figure.colorbar(marks, ax=axes, label=f"u_{'xyz'[component]}")

    def draw(frame: int):
        axes.set_title(f"t = {float(history.times[frame]):.4g}", fontsize=10)
        if dim == 1:
            line.set_ydata(colour[frame])
            return (line,)
        marks.set_offsets(place[frame])
        marks.set_array(colour[frame])
        return (marks,)

    film = FuncAnimation(figure, draw, frames=len(u), blit=False)
    part = path.with_name(f"{path.stem}.part{path.suffix}")
    with moved_whole(path, part):
        try:
            film.save(part, writer=PillowWriter(fps) if path.suffix == ".gif" else FFMpegWriter(fps), dpi=90)
        except subprocess.CalledProcessError as error:
            raise OSError(f"ffmpeg ended with status {error.returncode}") from error
    return path
