"""Motions: dispersion curves, force against strain, fields, the amplitude of a mode, the budget of energy,
animations."""

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.animation import FFMpegWriter, FuncAnimation, PillowWriter
from matplotlib.figure import Figure, SubFigure

from .._internal.checks import moved_whole
from ..finite_body.dynamics.history import History
from ..finite_body.scene import Scene
from .charts import COLOURS, SERIES

ZERO = 1e-9  # of the largest displacement: what rounding leaves of a component that symmetry forbids (seen: 1e-12)


class Branch(NamedTuple):
    """One curve of `dispersion_curves`: a name, k (waves,), ω (waves,), a line style, and what to mark on the axis or
    None: a mask (waves,) or the numbers of waves."""

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
    """ω(k) of several models or branches, one panel a name; zero-energy modes are ringed.

    Arguments: panels: title → branches, k h in units of π [-], ω h/c [-]; highest: top of the vertical axis; on: a
        part of a figure to draw in, a new one by default.
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
    handles, words = handles + rings[:1], words + ["costs no energy"] * len(rings[:1])
    figure.legend(handles, words, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    figure.suptitle(title, fontsize=11)
    return figure


def cuboid(runs: dict[str, dict[str, Any]], title: str, field: dict[str, Any] | None = None) -> Figure:
    """Force against strain of several runs, and below it the three displacements of one of them on its middle plane.

    Arguments: runs: name → {"strain", "force" (saves,) [-, force], "style", optional}; field: {"u" (points, 3),
        "shape", "spacing", "name"} of the run to be looked at, or None.
    """
    figure = Figure(figsize=(8.6, 8.4 if field else 4.6), layout="constrained")
    upper: Any
    lower: Any
    if field:
        parts: Any = figure.subfigures(2, 1, height_ratios=(1.15, 1))
        upper, lower = parts
    else:
        upper, lower = figure, None
    axes = upper.subplots()
    for number, (name, run) in enumerate(runs.items()):
        colour = SERIES[number % len(SERIES)]
        strain, force = 100 * np.asarray(run["strain"]), np.asarray(run["force"])
        axes.plot(strain, force, run.get("style", "-"), color=colour, linewidth=1.3, label=name)
    strains = 100 * np.concatenate([run["strain"] for run in runs.values()])
    ends = np.array([strains.min(), strains.max()])
    axes.plot(
        ends, ends / 100, ":", color="#888888", linewidth=1.1, label="E₀ × strain, the classical bar at small strain"
    )
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
        limit = float(np.abs(planes).max()) or 1.0  # one scale: rounding must not look like a displacement
        zero = [f"u_{axis}" for axis, plane in zip("xyz", planes, strict=True) if np.abs(plane).max() < ZERO * limit]
        said = f"; zero to rounding: {', '.join(zero)}" if zero else ""
        lower.suptitle(f"{field['name']}: displacement on the plane z = centre, one scale{said}", fontsize=9)
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
    """The amplitude of a mode in time beside what the symbol says of it, and the error of the budget of energy.

    Arguments: amplitude (saves,), over its start; law: name → (saves,) curves to compare with. A range of more than a
        thousand is drawn logarithmically.
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
    """A moving picture of the body, coloured by one displacement: a GIF (Pillow), or MP4 where ffmpeg is installed.

    Arguments: scene the motion's; history with its fields; path ending in .gif or .mp4; component 0 to dim − 1; scale:
        how much displacements are exaggerated. In 1D u is drawn over x; in 3D the body is seen along z.
    Returns: the path.  Raises: ValueError for another ending, a history without fields, or MP4 without ffmpeg.
    """
    path = Path(path)
    if path.suffix not in (".gif", ".mp4"):
        raise ValueError(f"an animation is a .gif or an .mp4; got {path.name!r}")
    if path.suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError("MP4 needs the program ffmpeg, which is not installed: name a .gif instead")
    if len(history.u) != len(history.times):
        raise ValueError("this history kept no fields but the last: run it with fields=True")
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
