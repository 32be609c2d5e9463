"""`pdjax run`: the scenes on the command line; here the bars at rest, `_run_motions` has those that move."""

import argparse
from typing import Any

import numpy as np

from .motions import Job, add_motions, run_cuboid, run_wave, write_out


def add_run(jobs, formatter) -> None:
    """Add the job `run` to the parser's jobs."""
    parser = jobs.add_parser(
        "run",
        formatter_class=formatter,
        help="a scene: singular-bar, step-bar, cuboid or wave",
        description="Solve or run a scene, judge what was found, draw it. Writes OUT.png and OUT.npz.",
    )
    scenes = parser.add_subparsers(dest="scene", required=True, metavar="scene")
    bar = argparse.ArgumentParser(add_help=False)
    bar.add_argument("--N", type=float, default=3.0, help="horizon over spacing (default 3)")
    bar.add_argument("--m", type=float, default=1.0, help="order of the Seth–Hill strain (default 1)")
    bar.add_argument("--method", default="newton", help="newton, newton_krylov, trust_region, relaxation")
    bar.add_argument("--json", action="store_true", help="print one JSON object instead of text")
    job = scenes.add_parser("singular-bar", parents=[bar], help="bar of vanishing modulus under a stress")
    job.add_argument("--n", type=int, default=400, help="points (default 400)")
    job.add_argument("--stress", type=float, nargs="+", default=[1e-3, -1e-5], help="σ/E₀ (default 1e-3 -1e-5)")
    job.add_argument("--alpha", type=float, default=10.0, help="strength of the singularity (default 10)")
    job.add_argument("--model", nargs="+", default=["seth-hill", "correspondence"], help="seth-hill, correspondence")
    job.add_argument("--out", default="singular-bar", help="name of the files without ending (default singular-bar)")
    job = scenes.add_parser("step-bar", parents=[bar], help="bar whose ends are displaced at once")
    job.add_argument("--n", type=int, default=100, help="points (default 100)")
    job.add_argument("--strain", type=float, nargs="+", default=[1.0, -1e-4, -1e-3], help="default 1 -0.0001 -0.001")
    job.add_argument("--model", nargs="+", default=["seth-hill"], help="seth-hill, correspondence")
    job.add_argument("--out", default="step-bar", help="name of the files without ending (default step-bar)")
    add_motions(scenes)


def _bar_model(name: str, m: float):
    import pdjax as pd
    from pdjax._internal.checks import choice

    law = pd.LinearElastic(lam=1.0, mu=0.0)  # type: ignore[call-arg, arg-type]
    choice("model", name, ("seth-hill", "correspondence"))
    return pd.SethHill(m, law) if name == "seth-hill" else pd.Correspondence(law)  # type: ignore[arg-type]


def _say(what: str, result, error: float) -> str:
    """A verdict on one solution in a few lines."""
    state = f"converged in {result.iterations} iterations" if result.converged else f"NOT converged: {result.reason}"
    lines = [f"{what}: {state}; relative residual {result.residual:.1e}"]
    if result.stability is not None:
        count = result.stability.positive
        kind = (
            f"a {result.kind}" if result.converged else "no equilibrium; there the Jacobian is " + (result.kind or "")
        )
        lines.append(f"  {kind}: largest eigenvalue {result.stability.eigenvalue:+.4g}, {count} positive")
    lines.append(f"  distance from the known solution {error:.2%} (relative, root mean square)")
    if int(result.turned):
        lines.append(f"  {int(result.turned)} bonds turned backwards: matter passed through itself")
    return "\n".join(lines)


def singular_curves(scene, stress: float, alpha: float = 10.0) -> dict[str, np.ndarray]:
    """The two closed forms of the singular bar by name, u (points,)."""
    import pdjax as pd

    x = scene.body.positions[:, 0]
    printed = pd.closed_forms.singular_bar_displacement(x, 1.0, stress, alpha)
    return {
        "nonlinear local solution": np.asarray(scene.closed_form)[:, 0],
        "printed, small strain": np.asarray(printed),
    }


def bar_case(scene, result, what: str, value: float, curves: dict[str, np.ndarray]):
    """One solved bar: its column of the figure, and what was found as a dictionary."""
    import pdjax as pd

    x, u, known = scene.body.positions[:, 0], np.asarray(result.u)[:, 0], np.asarray(scene.closed_form)[:, 0]
    own = result.stability
    row = {
        "load": value,
        "converged": result.converged,
        "reason": result.reason,
        "iterations": int(result.iterations),
        "residual": result.residual,
        "kind": result.kind,
        "eigenvalue": None if own is None else own.eigenvalue,
        "positive": None if own is None else own.positive,
        "turned": int(result.turned),
        "distance": float(np.linalg.norm(u - known) / np.linalg.norm(known)),
    }
    short = result.kind if result.converged else "not converged"
    mode = None if own is None else np.asarray(own.mode)[:, 0]
    verdict = "" if own is None else f"λ = {own.eigenvalue:+.3g}, {own.positive} positive".replace("-", "−")
    case = pd.figures.BarCase(f"{what}: {short}", x, u, curves or {"homogeneous": known}, value, value, mode, verdict)
    return case, row


def run(arguments) -> Job:
    """Solve or run the scene asked for, judge it; what was found as a dictionary, and what writes the files."""
    return {"cuboid": run_cuboid, "wave": run_wave}.get(arguments.scene, _bars)(arguments)


def _bars(arguments) -> Job:
    """The bars at rest."""
    import pdjax as pd
    from pdjax._internal.checks import writable

    singular = arguments.scene == "singular-bar"
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    cases: list[Any] = []
    rows: list[dict] = []
    arrays: dict[str, Any] = {}
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
