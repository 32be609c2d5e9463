"""Scenes of `pdjax run` in which bonds break under a slow load: `cracked-plate` and `double-cantilever`.

This module is not a command. `run` adds its scenes to `pdjax run`. A further scene is one more function and one line in
`CASES`.
"""

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .._internal.checks import writable
from .common import Job, Jobs, Size, add_scene, points_of, write_out

MODELS = ("lps", "bond-based")
ENERGY = 1e-6  # fracture energy of the scenes, for a Young's modulus of 1 and lengths near 1


class Curve(NamedTuple):
    """What is drawn beside the damage: two axes with their names, and the value of theory for each state."""

    x: np.ndarray
    y: np.ndarray
    theory: np.ndarray
    names: tuple[str, str]


class Case(NamedTuple):
    """One scene: what it shows, its sizes, and how to run it."""

    shows: str
    size: Size
    run: Callable[[argparse.Namespace, int], tuple[Any, Any, dict, Curve]]  # Scene, BreakingPath, numbers, curve


def _model(name: str, delta: float):
    import pdjax as pd

    if name == "lps":
        return pd.LPS.from_young(1.0, 1 / 3, 2, "stress")
    return pd.BondBased.from_young(1.0, 1 / 3, delta, 2, "stress")


def _criterion(model, n: int, N: float, no_fail=None):
    import pdjax as pd

    family = pd.lattice_family(2, N, 1 / n)
    return pd.CriticalStretch.from_fracture_energy(ENERGY, model, family, calibrate="lattice", no_fail=no_fail)


def _plate(arguments: argparse.Namespace, n: int):
    import pdjax as pd

    model = _model(arguments.model, arguments.N / n)
    scene, expected = pd.scenes.cracked_plate(n, arguments.N, model=model, fracture_energy=ENERGY)
    steps = np.arange(0.7, 1.6, 0.02)
    path = pd.solve_breaking(
        scene, _criterion(model, n, arguments.N), load_steps=steps, show_progress=not arguments.json
    )
    settled = path.load_factors[path.settled]
    out = {"largest_load": float(settled[-1]), "expected": {"load": 1.0, "stress": expected.stress}}
    high = scene.body.positions[:, 1] > 1.0
    opening = path.u[:, high, 1].mean(axis=1) - path.u[:, ~high, 1].mean(axis=1)
    names = "mean opening of the plate  [length]", "K/√(E'G_c)  [-]"
    return scene, path, out, Curve(opening, path.load_factors, np.ones(len(opening)), names)


def _cantilever(arguments: argparse.Namespace, n: int):
    import pdjax as pd

    model = _model(arguments.model, arguments.N / n)
    scene, expected = pd.scenes.double_cantilever(n, arguments.N, 2.5, 6.5, ENERGY, model)
    steps = np.concatenate([np.arange(0.2, 0.36, 0.01), np.arange(0.38, 0.57, 0.03)])
    path = pd.solve_breaking(
        scene,
        _criterion(model, n, arguments.N, expected.arms),
        load_steps=steps,
        show_progress=not arguments.json,
    )
    opening, force = path.load_factors * expected.opening, path.reactions[:, expected.upper, 1].sum(axis=1)
    theory = expected.force(opening)
    growing = path.load_factors > 0.4
    share = float((force[growing] / theory[growing]).mean()) if growing.any() else float("nan")
    out = {"force_over_theory": share, "expected": {"force_over_theory": 1.0}}
    return scene, path, out, Curve(opening, force, theory, ("opening Δ  [length]", "force P  [force/thickness]"))


CASES = {
    "cracked-plate": Case(
        "plate with a crack in its middle, under slow tension (mode I)", Size(40, "across the plate", 20, 3.0), _plate
    ),
    "double-cantilever": Case(
        "two arms that are pulled apart slowly, with a crack between them",
        Size(12, "across one arm", 8, 3.0),
        _cantilever,
    ),
}


def add(scenes: Jobs) -> None:
    """Add the scenes to those of `run`."""
    for name, case in CASES.items():
        job = add_scene(scenes, name, case.shows, case.size)
        job.add_argument("--model", default=MODELS[0], choices=MODELS, help=f"material model (default {MODELS[0]})")


def run(arguments: argparse.Namespace) -> Job:
    """Run the scene and print what broke. Return the results with a function that writes the files."""
    import pdjax as pd

    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    case = CASES[arguments.scene]
    scene, path, found, curve = case.run(arguments, points_of(arguments, case.size))
    first = float(path.broken_at.min())
    out = {
        "scene": arguments.scene,
        "points": len(scene.body),
        "horizon": float(scene.families.horizon),
        "ending": path.ending.name,
        "reason": path.reason,
        "broken_bonds": path.broken_bonds,
        "first_break": first,
        "energy": {name: float(values[-1]) for name, values in path.energies._asdict().items()}
        | {"error": float(np.abs(path.energies.error).max())},
        **found,
    }
    if not arguments.json:
        print(f"{arguments.scene}: {out['points']} points, horizon {out['horizon']:.4g}")
        print(path)
        if "largest_load" in found:
            print(f"  first break at K = {first:.3f} √(E'G_c), last equilibrium at {found['largest_load']:.3f}")
            print("  the handbook expects 1")
        else:
            print(f"  force while the crack grows: {found['force_over_theory']:.3f} of beam theory")
            print("  a coarse lattice traps the crack: the excess falls with N, see benchmarks/README.md")
    arrays = {
        "X": scene.body.positions,
        "load_factors": path.load_factors,
        "u": path.u[-1],
        "alive": path.alive,
        "broken_at": path.broken_at,
        "neighbours": scene.families.neighbours,
        "x": curve.x,
        "y": curve.y,
        "theory": curve.theory,
        **{f"energy {name}": values for name, values in path.energies._asdict().items()},
    }
    title = f"{arguments.scene}, {out['points']} points, δ = {out['horizon']:.3g}"

    def files() -> str:
        return write_out(lambda: pd.figures.breaking_path(scene.body, path, *curve, title=title), picture, arrays, data)

    return out | {"figure": str(picture), "data": str(data)}, files
