"""Scenes of `pdjax run` in which bonds break: `spall-bar`, `branching-plate` and `kalthoff`.

This module is not a command. `run` adds its scenes to `pdjax run`. A further scene of fracture is one more function
that runs it, one that describes it in words, and one line in `CASES`.
"""

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .._internal.checks import writable
from .common import Job, Jobs, Size, add_scene, points_of, write_out

MODELS = ("bond-based", "lps")
Result = tuple[Any, Any, dict]  # the Motion of the scene, the History of its run, and the numbers


class Case(NamedTuple):
    """One scene: what it shows, its sizes, how to run it and to describe it."""

    shows: str
    size: Size
    run: Callable[[argparse.Namespace, int], Result]
    words: Callable[[dict], list[str]]


def _spall(arguments: argparse.Namespace, n: int) -> Result:
    import pdjax as pd
    from pdjax.studies import running_cracks

    scene = pd.scenes.spall_bar(n, arguments.N)
    breaking = pd.CriticalStretch(0.1 * scene[1].strain)  # type: ignore[arg-type]
    history, out = running_cracks.spall(scene, breaking, arguments.dt, not arguments.json)
    return scene[0], history, out


def _spall_words(out: dict) -> list[str]:
    expected = out["expected"]
    return [f"  wave theory: x = {expected['place'][0]:.4g} at t = {expected['time']:.4g}, for sharp fronts"]


def _branching(arguments: argparse.Namespace, n: int) -> Result:
    import pdjax as pd
    from pdjax.studies import running_cracks

    model = pd.LPS.from_young(72e9, 1 / 3, 2, "stress") if arguments.model == "lps" else None
    scene = pd.scenes.branching_plate(n, arguments.N, 1e6 * arguments.stress, model)
    history, out = running_cracks.branching(scene, arguments.dt, not arguments.json)
    return scene[0], history, out


def _branching_words(out: dict) -> list[str]:
    found, expected = out["branching"], out["expected"]
    low, high = expected["speed"]
    lines = [f"  largest speed {out['largest_speed']:.0f} m/s; Rayleigh speed {out['rayleigh']:.0f} m/s, papers"]
    lines[0] += f" {low:.0f} to {high:.0f} m/s"
    if not np.isfinite(found["distance"]):
        return [*lines, f"  no branches; the crack has grown by {1e3 * out['length']:.1f} mm"]
    near, far = (1e3 * x for x in expected["distance"])
    small, large = expected["angle"]
    return [
        *lines,
        f"  branches {1e3 * found['distance']:.1f} mm from the notch (papers {near:.0f} to {far:.0f} mm) at"
        f" {1e6 * found['time']:.1f} µs, angle {found['angle']:.0f}° (papers {small:.0f} to {large:.0f}°)",
    ]


def _kalthoff(arguments: argparse.Namespace, n: int) -> Result:
    import pdjax as pd
    from pdjax.studies import running_cracks

    model = pd.LPS.from_young(190e9, 0.3, 2, "strain") if arguments.model == "lps" else None
    scene = pd.scenes.kalthoff(n, arguments.N, arguments.speed, model)
    history, out = running_cracks.impact(scene, arguments.dt, not arguments.json)
    return scene[0], history, out


def _kalthoff_words(out: dict) -> list[str]:
    small, large = out["expected"]["angle"]
    lines = [f"  angle to the notches in papers: {small:.0f} to {large:.0f}°; Rayleigh speed {out['rayleigh']:.0f} m/s"]
    for side, crack in zip(("lower", "upper"), out["cracks"], strict=True):
        if not np.isfinite(crack["start"]):
            lines.append(f"  {side} notch: no crack")
            continue
        lines.append(
            f"  {side} crack: starts at {1e6 * crack['start']:.1f} µs, angle {crack['angle']:.1f}°, largest speed"
            f" {crack['speed']:.0f} m/s"
        )
    return lines


CASES = {
    "spall-bar": Case(
        "a bar breaks where two release waves meet", Size(300, "along x", 100, 3.0), _spall, _spall_words
    ),
    "branching-plate": Case(
        "glass plate of Ha & Bobaru (2010): a crack runs and branches",
        Size(150, "along x", 100, 3.015),
        _branching,
        _branching_words,
    ),
    "kalthoff": Case(
        "steel plate with two notches, hit between them", Size(100, "along x", 40, 3.015), _kalthoff, _kalthoff_words
    ),
}


def add(scenes: Jobs) -> None:
    """Add the scenes to those of `run`."""
    for name, case in CASES.items():
        job = add_scene(scenes, name, case.shows, case.size)
        if name != "spall-bar":
            job.add_argument("--model", default=MODELS[0], choices=MODELS, help=f"material model (default {MODELS[0]})")
        if name == "branching-plate":
            job.add_argument("--stress", type=float, default=12.0, help="tensile stress [MPa] (default 12)")
        if name == "kalthoff":
            job.add_argument(
                "--speed", type=float, default=16.5, help="speed of the side that is hit [m/s] (default 16.5)"
            )
        job.add_argument(
            "--dt",
            type=float,
            help="time step [time] (default 0.2 of the critical step; a larger one breaks the bonds too late)",
        )


def run(arguments: argparse.Namespace) -> Job:
    """Run the scene and print what broke. Return the results with a function that writes the files."""
    import pdjax as pd

    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    case = CASES[arguments.scene]
    motion, history, out = case.run(arguments, points_of(arguments, case.size))
    body = motion.scene.body
    if not arguments.json:
        print(f"{arguments.scene}: {out['points']} points, horizon {out['horizon']:.4g}")
        print(history)
        for line in _breaks(out) + case.words(out) + _energy(out):
            print(line)
    tips = {"along the notch": history.observed["tip"]} if "tip" in history.observed else None
    title = f"{arguments.scene}, {out['points']} points, δ = {out['horizon']:.3g}"
    arrays = {
        "X": body.positions,
        "times": history.times,
        "u": history.u[-1],
        "damage": history.observed["damage"],
        "broken_at": history.broken_at,
        "neighbours": motion.scene.families.neighbours,
        **{f"energy {name}": values for name, values in history.energies._asdict().items()},
        **({"tip": history.observed["tip"]} if tips else {}),
    }

    def files() -> str:
        return write_out(lambda: pd.figures.crack(body, history, tips=tips, title=title), picture, arrays, data)

    return out | {"scene": arguments.scene, "figure": str(picture), "data": str(data)}, files


def _breaks(out: dict) -> list[str]:
    if not out["broken_bonds"]:
        return []
    first = out["first_break"]
    where = ", ".join(f"{x:.4g}" for x in first["place"])
    return [f"  first break at ({where}), t = {first['time']:.4g}"]


def _energy(out: dict) -> list[str]:
    energy = out["energy"]
    lines = [
        f"  energy: kinetic {energy['kinetic']:.4g} + strain {energy['strain']:.4g} + released"
        f" {energy['released']:.4g} - work {energy['work']:.4g}, error {energy['error']:.1e} of the largest"
    ]
    if "area" in out:
        lines.append(f"  G_c times the area of a plane of as many bonds: {out['energy_of_area']:.4g}")
    if "energy_at_critical_stretch" in out:
        lines.append(f"  energy of the broken bonds at the critical stretch: {out['energy_at_critical_stretch']:.4g}")
    return lines
