"""Scenes `singular-bar` and `step-bar` of the command `pdjax run`: the static bars of the paper.

This module is not a command. `run` adds its scenes to `pdjax run singular-bar` and `pdjax run step-bar`.
"""

import argparse

import numpy as np
from numpy.typing import ArrayLike

from .common import Job, Jobs, write_out


def add(scenes: Jobs) -> None:
    """Add the bars to the scenes of `run`."""
    bar = argparse.ArgumentParser(add_help=False)
    bar.add_argument("--N", type=float, default=3.0, help="horizon over spacing [-] (default 3)")
    bar.add_argument("--m", type=float, default=1.0, help="order of the Seth–Hill strain (default 1)")
    bar.add_argument(
        "--method", default="newton", help="solver: newton, newton_krylov, trust_region or relaxation (default newton)"
    )
    bar.add_argument("--json", action="store_true", help="print the results as one JSON object")
    job = scenes.add_parser(
        "singular-bar", parents=[bar], help="bar under stress whose modulus drops to zero at mid-length"
    )
    job.add_argument("--n", type=int, default=400, help="number of points (default 400)")
    job.add_argument(
        "--stress", type=float, nargs="+", default=[1e-3, -1e-5], help="stresses σ/E₀ [-] (default 1e-3 -1e-5)"
    )
    job.add_argument("--alpha", type=float, default=10.0, help="strength α of the singularity [-] (default 10)")
    job.add_argument(
        "--model",
        nargs="+",
        default=["seth-hill", "correspondence"],
        help="models: seth-hill, correspondence (default both)",
    )
    job.add_argument(
        "--out", default="singular-bar", help="name of the output files, without extension (default singular-bar)"
    )
    job = scenes.add_parser("step-bar", parents=[bar], help="bar whose ends are displaced in a single step")
    job.add_argument("--n", type=int, default=100, help="number of points (default 100)")
    job.add_argument(
        "--strain",
        type=float,
        nargs="+",
        default=[1.0, -1e-4, -1e-3],
        help="strains of the bar [-] (default 1 -0.0001 -0.001)",
    )
    job.add_argument(
        "--model", nargs="+", default=["seth-hill"], help="models: seth-hill, correspondence (default seth-hill)"
    )
    job.add_argument("--out", default="step-bar", help="name of the output files, without extension (default step-bar)")


def _bar_model(name: str, m: float):
    import pdjax as pd
    from pdjax._internal.checks import choice

    law = pd.LinearElastic(lam=1.0, mu=0.0)  # type: ignore[call-arg, arg-type]
    choice("model", name, ("seth-hill", "correspondence"))
    return pd.SethHill(m, law) if name == "seth-hill" else pd.Correspondence(law)  # type: ignore[arg-type]


def _say(what: str, result, error: float) -> str:
    """Describe one solution in a few lines."""
    state = f"converged in {result.iterations} iterations" if result.converged else f"NOT converged: {result.reason}"
    lines = [f"{what}: {state}; relative residual {result.residual:.1e}"]
    if result.stability is not None:
        count = result.stability.positive
        kind = (
            f"a {result.kind}" if result.converged else f"no equilibrium; the Jacobian is that of a {result.kind or ''}"
        )
        lines.append(f"  {kind}: largest eigenvalue {result.stability.eigenvalue:+.4g}, {count} positive")
    lines.append(f"  relative difference from the closed-form solution, root mean square: {error:.2%}")
    if int(result.turned):
        lines.append(f"  {int(result.turned)} bonds point backwards: matter has passed through itself")
    return "\n".join(lines)


def run(arguments: argparse.Namespace) -> Job:
    """Solve the bar for every model and load, and print the verdicts. Return them with a function that draws."""
    import pdjax as pd
    from pdjax._internal.checks import writable
    from pdjax.studies.bars import bar_case, singular_curves

    singular = arguments.scene == "singular-bar"
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    cases: list = []
    rows: list[dict] = []
    arrays: dict[str, ArrayLike] = {}
    for name in arguments.model:
        model = _bar_model(name, arguments.m)
        for value in arguments.stress if singular else arguments.strain:
            if singular:
                scene = pd.scenes.singular_bar(arguments.n, arguments.N, value, arguments.alpha, model)
            else:
                scene = pd.scenes.step_size_bar(arguments.n, arguments.N, value, model=model)
            result = pd.solve(scene, arguments.method, smallest_step=1.0)
            what = f"{name}, {'σ/E₀' if singular else 'strain'} = {value:g}"
            case, row = bar_case(
                scene, result, what, value, singular_curves(scene, value, arguments.alpha) if singular else {}
            )
            cases.append(case)
            key = f"{name} {value:g}"
            arrays |= {f"{key} u": case.u, f"{key} known": np.asarray(scene.closed_form)[:, 0], f"{key} x": case.x}
            arrays[f"{key} residuals"] = result.residuals
            if case.mode is not None:
                arrays[f"{key} mode"] = case.mode
            rows.append({"model": name, **row})
            if not arguments.json:
                print(_say(what, result, row["distance"]))
    names = ("E₀ u / (σ L)  [–]", "E₀ ε / σ  [–]") if singular else ("u / (strain · L)  [–]", "ε / strain  [–]")
    title = f"{arguments.scene}, {arguments.n} points, N = {arguments.N:g}, m = {arguments.m:g}, {arguments.method}"

    def files() -> str:
        return write_out(lambda: pd.figures.bars(cases, title, names), picture, arrays, data)

    return {"figure": str(picture), "data": str(data), "cases": rows}, files
