"""`pdjax design`: three standard questions of design, answered by gradient.

penalty      how strong must the zero-energy penalty be?
stabiliser   which strengths by shell keep the lattice stable and its wave speeds right?
influence    can an influence function alone make the model stable?
"""

import argparse
import json
import time

import numpy as np

from .._internal.checks import writable, written_whole
from .._internal.json_values import plain
from .common import Formatter, Job, Jobs, number

QUESTIONS = ("penalty", "stabiliser", "influence")


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "design",
        formatter_class=formatter,
        help="the least penalty, a stabiliser or an influence function, by gradient",
        description="Design a model by gradient. Load cases are all load paths at plus and minus the strain."
        "\n  penalty      the least strength g of Silling's zero-energy penalty, for each order m"
        "\n  stabiliser   strengths by shell with the smallest error of wave speeds whose margin is at most --margin"
        "\n  influence    influence function by shells with the smallest worst margin"
        "\nThe first search compiles for 10 to 60 s.",
    )
    job.add_argument("question", choices=QUESTIONS, help="what to design")
    job.add_argument("--dim", type=int, default=2, choices=(1, 2, 3), help="number of space dimensions (default 2)")
    job.add_argument("--N", type=float, default=3.0, help="horizon over lattice spacing [-] (default 3)")
    job.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    job.add_argument("--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1)")
    job.add_argument(
        "--m",
        type=float,
        nargs="+",
        default=[1.0],
        help="order m of the Seth–Hill model (default 1). penalty takes several orders",
    )
    job.add_argument("--silling", action="store_true", help="Silling's correspondence model instead of Seth–Hill")
    job.add_argument("--strain", type=float, default=0.05, help="size of the loads [-] (default 0.05)")
    job.add_argument("--path", nargs="+", help="load paths (default: all)")
    job.add_argument(
        "--margin", type=float, default=None, help="largest margin allowed [-] (default 0, for stabiliser -0.02)"
    )
    job.add_argument("--signed", action="store_true", help="influence: weights may be negative")
    job.add_argument("--steps", type=int, default=100, help="largest number of steps of a search (default 100)")
    job.add_argument("--out", help="file for the designed parameters, as JSON")
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")


def run(arguments: argparse.Namespace) -> Job:
    """Answer one question. Return the results with a function that writes the file."""
    import pdjax as pd

    if len(arguments.m) > 1 and arguments.question != "penalty":
        orders = " ".join(f"{m:g}" for m in arguments.m)
        raise ValueError(
            f"--m must be one order for {arguments.question}; got {orders}. Run the command once for each order"
        )
    path = writable(arguments.out) if arguments.out else None
    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu)  # type: ignore[call-arg]
    family = pd.lattice_family(arguments.dim, arguments.N)
    names = arguments.path or [name for name in pd.PATHS if arguments.dim > 1 or name == "hydrostatic"]
    cases = pd.load_cases(names, [-abs(arguments.strain), abs(arguments.strain)])

    def model(m, control):
        return pd.Correspondence(law, control) if arguments.silling else pd.SethHill(m, law, control)

    begin = time.perf_counter()
    answer = {"penalty": _penalty, "stabiliser": _stabiliser, "influence": _influence}[arguments.question]
    rows, text = answer(arguments, family, cases, model)
    out = {"question": arguments.question, "seconds": time.perf_counter() - begin, "rows": rows}
    if not arguments.json:
        print(text)

    def write() -> str:
        if path is None:
            return ""
        with written_whole(path) as stream:
            stream.write(json.dumps(plain(out), indent=1).encode())
        return f"wrote {path}"

    return out, write


def _measures(model, family, cases) -> dict:
    import pdjax as pd

    return {
        "margin": float(pd.worst_margin(model, family, cases)),
        "phase error": float(pd.dispersion_error(model, family)),
        "time step": float(pd.lattice_time_step(model, family)),
    }


def _penalty(arguments, family, cases, model) -> tuple[list[dict], str]:
    """The least penalty of every order, and what it costs."""
    import pdjax as pd

    target = 0.0 if arguments.margin is None else arguments.margin
    rows = []
    for m in [0.0] if arguments.silling else arguments.m:
        g = pd.least_penalty(lambda g, m=m: model(m, pd.SillingControl(g)), family, cases, target)
        row: dict = {"m": None if arguments.silling else m, "g": g}
        if np.isfinite(g):
            row |= _measures(model(m, pd.SillingControl(g)), family, cases)  # type: ignore[arg-type]
        rows.append(row)
    lines = [
        f"least penalty g for a margin of at most {target:g} at ±{100 * abs(arguments.strain):g} %",
        f"{'m':>8}{'g':>12}{'error of speeds, kh = 1':>26}{'time step':>12}",
    ]
    for row in rows:
        name = "Silling" if row["m"] is None else f"{row['m']:g}"
        rest = f"{100 * row['phase error']:>24.1f} %{row['time step']:>12.4f}" if "time step" in row else ""
        lines.append(f"{name:>8}{row['g']:>12.5f}{rest or '   no penalty suffices: a long wave grows'}")
    return rows, "\n".join(lines)


def _stabiliser(arguments, family, cases, model) -> tuple[list[dict], str]:
    """Strengths by shell, beside the published penalty."""
    import jax.numpy as jnp

    import pdjax as pd

    target = -0.02 if arguments.margin is None else arguments.margin
    q, m = pd.shells(arguments.dim, arguments.N), arguments.m[0]
    found = pd.design(
        lambda strengths: model(m, pd.ShellControl(tuple(q), strengths)),
        jnp.full(len(q), 0.3),
        lambda model: pd.dispersion_error(model, family, sharpness=300.0),
        {"margin": lambda model: pd.worst_margin(model, family, cases, sharpness=300.0) - target},
        bounds=(-4.0, 4.0),
        steps=arguments.steps,
    )
    rows = [
        {"model": "designed", "q": q.tolist(), "strengths": np.asarray(found.parameters).tolist()}
        | {"feasible": found.feasible, "reason": found.reason}
        | _measures(found.model, family, cases)
    ]
    for g in np.array([0.5, 0.1]):
        rows.append({"model": f"penalty g = {g}"} | _measures(model(m, pd.SillingControl(g)), family, cases))
    rows.append({"model": "Wan"} | _measures(model(m, pd.WanControl()), family, cases))
    lines = [f"{'':>16}{'margin':>10}{'error of speeds, kh = 1':>26}{'time step':>12}"]
    lines += [
        f"{r['model']:>16}{r['margin']:>10.4f}{100 * r['phase error']:>24.1f} %{r['time step']:>12.4f}" for r in rows
    ]
    lines += [
        "",
        "q = |ξ|/δ  " + "  ".join(f"{x:8.4f}" for x in q),
        "strength   " + "  ".join(f"{x:8.4f}" for x in np.asarray(found.parameters)),
        f"{'feasible' if found.feasible else 'not feasible'}: {found.reason}",
    ]
    return rows, "\n".join(lines)


def _influence(arguments, family, cases, model) -> tuple[list[dict], str]:
    """The influence function by shells with the smallest worst margin."""
    import jax.numpy as jnp

    import pdjax as pd

    q, m = pd.shells(arguments.dim, arguments.N), arguments.m[0]

    def build(weights):
        influence = pd.interpolated_influence(q, jnp.concatenate([jnp.ones(1), weights]))
        influence = pd.signed_influence(influence) if arguments.signed else influence
        return model(m, None), pd.lattice_family(arguments.dim, arguments.N, influence=influence)

    if len(q) < 2:
        raise ValueError(f"influence needs at least two shells of bonds; N = {arguments.N:g} has one")
    found = pd.design(
        build,
        jnp.linspace(0.9, 0.4, len(q) - 1),
        lambda model, family: pd.worst_margin(model, family, cases),
        bounds=(-1.0 if arguments.signed else 0.0, 2.0),
        steps=arguments.steps,
    )
    margin = float(found.judged["objective"])
    weights = [1.0, *np.asarray(found.parameters).tolist()]
    verdict = "stable" if margin < -1e-9 else "marginal" if margin <= 1e-9 else "unstable"
    lines = [
        f"smallest worst margin found: {number(margin)} ({verdict}), after {found.evaluations} evaluations",
        "q = |ξ|/δ  " + "  ".join(f"{x:8.4f}" for x in q),
        "weight ω   " + "  ".join(f"{x:8.4f}" for x in weights),
    ]
    if arguments.dim == 1 and m == 1 and not arguments.silling:
        lines.append("In 1D with m = 1 no influence function, of either sign, is stable in compression.")
    return [{"q": q.tolist(), "weights": weights, "margin": margin, "verdict": verdict}], "\n".join(lines)
