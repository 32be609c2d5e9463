"""Scene `cuboid` of the command `pdjax run`: the paper's cuboid, pulled and pushed at its ends.

This module is not a command. `run` adds its scene to `pdjax run cuboid`.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .common import Job, Jobs, write_out
from .motions import check_outputs, extras, moving_arguments, write_extras
from .motions import model as named_model


def add(scenes: Jobs) -> None:
    """Add `cuboid` to the scenes of `run`."""
    job = scenes.add_parser(
        "cuboid", parents=[moving_arguments()], help="3D body pulled or pushed at its ends, with explicit dynamics"
    )
    job.add_argument(
        "--shape", type=int, nargs=3, default=[28, 7, 7], help="numbers of points along x, y, z (default 28 7 7)"
    )
    job.add_argument(
        "--m", type=float, default=0.0, help="order m of the Seth–Hill strain (default 0, as in the paper)"
    )
    job.add_argument("--model", default="seth-hill", help="model: seth-hill or correspondence (default seth-hill)")
    job.add_argument(
        "--strain",
        type=float,
        nargs="+",
        default=[0.1, -0.1],
        help="final strains of the cuboid [-] (default 0.1 -0.1)",
    )
    job.add_argument("--rate", type=float, default=0.005, help="strain rate [1/time], > 0 (default 0.005)")
    job.add_argument(
        "--checkpoint", metavar="FILE", help="save the state to FILE-STRAIN.npz, and continue from it if it exists"
    )
    job.add_argument("--out", default="cuboid", help="name of the output files, without extension (default cuboid)")


def run(arguments: argparse.Namespace) -> Job:
    """Pull and push the cuboid and print the results. Return them with a function that writes the files."""
    import pdjax as pd
    from pdjax.scenes.alternation import roughness

    picture, data = check_outputs(arguments)
    model = named_model(arguments, 3)
    modulus = arguments.mu * (3 * arguments.lam + 2 * arguments.mu) / (arguments.lam + arguments.mu)
    runs: dict[str, dict[str, np.ndarray]] = {}
    rows: list[dict] = []
    arrays: dict[str, ArrayLike] = {}
    field: dict[str, object] | None = None
    films: list[tuple] = []
    for strain in arguments.strain:
        motion = pd.scenes.cuboid(arguments.shape, arguments.N, strain, arguments.rate, model)
        scene = motion.scene
        shape = tuple(arguments.shape)
        h = 1.0 / shape[-1]
        watch = {"section": pd.observers.section_force(scene.body, 0.5 * h * shape[0])}
        keep = Path(f"{arguments.checkpoint}-{strain:g}.npz") if arguments.checkpoint else None
        history = pd.simulate(
            motion,
            dt=arguments.dt,
            observers=watch,
            checkpoint=keep,
            resume=keep is not None and keep.exists(),
            show_progress=not arguments.json,
        )
        area = h**2 * shape[1] * shape[2]
        reached = strain * np.minimum(history.times * arguments.rate / abs(strain), 1)
        force = history.observed["section"][:, 0] / (modulus * area)
        rough = {axis: roughness(np.asarray(history.u), shape, k) / h for k, axis in enumerate("xyz")}
        name = f"strain {strain:g}"
        runs[name] = {"strain": reached, "force": force}
        field = {"u": history.u[-1], "shape": shape, "spacing": h, "name": name}
        arrays |= {
            f"{name} strain": reached,
            f"{name} force": force,
            f"{name} u": history.u[-1],
            "X": scene.body.positions,
        }
        arrays |= {f"{name} roughness {axis}": values for axis, values in rough.items()}
        row = {
            "strain": strain,
            "finished": history.finished,
            "reason": history.reason,
            "steps": history.steps,
            "dt": float(history.dt),
            "energy_error": float(np.abs(history.energies.error).max()),
            "force": float(force[-1]),
            "roughness": {axis: float(values[-1]) for axis, values in rough.items()},
            **extras(arguments, f"-{strain:g}"),
        }
        rows.append(row)
        if arguments.animate or arguments.vtk:
            films.append((extras(arguments, f"-{strain:g}"), scene, history))
        if not arguments.json:
            print(f"{name}: {history}")
            print(f"  force through the middle {force[-1]:+.4f} E₀ A, classical bar {reached[-1]:+.4f} E₀ A")
            print("  alternation between neighbours / h: " + ", ".join(f"u_{a} {v[-1]:.1e}" for a, v in rough.items()))
    which = f"m = {arguments.m:g}" if arguments.model == "seth-hill" else "Silling's correspondence"
    title = f"cuboid of {' × '.join(map(str, arguments.shape))} points, N = {arguments.N:g}, {which}"

    def files() -> str:
        wrote = write_out(lambda: pd.figures.cuboid(runs, title, field), picture, arrays, data)
        return wrote + "".join(write_extras(*film) for film in films)

    return {"figure": str(picture), "data": str(data), "cases": rows}, files
