"""`pdjax atlas`: a survey of all material models of the catalogue."""

import argparse
import math

from .._internal.pictures import write_picture
from .common import Formatter, Job, Jobs


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "atlas",
        formatter_class=formatter,
        help="all models: critical strains, zero-energy waves, dispersion, cost",
        description="Compare the material models on infinite lattices: critical strains by the symbol, zero-energy"
        "\nwaves, dispersion and cost. The command prints a table and writes OUT.png and OUT.json. It updates OUT.json"
        "\nafter each model, so that an interrupted run continues with the missing models.",
    )
    job.add_argument(
        "--dim",
        type=int,
        nargs="+",
        default=[1, 2],
        choices=(1, 2, 3),
        help="numbers of space dimensions (default 1 2)",
    )
    job.add_argument("--N", type=float, nargs="+", default=[3.0], help="horizons over lattice spacing [-] (default 3)")
    job.add_argument(
        "--models", nargs="+", help="names of models, in quotes (default: all; a wrong name prints the list)"
    )
    job.add_argument("--path", nargs="+", help="load paths (default: all)")
    job.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    job.add_argument("--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1)")
    job.add_argument("--quick", action="store_true", help="1D, N = 3 and six models only; takes about a minute")
    job.add_argument(
        "--out", default="pdjax-atlas", help="name of the output files, without extension (default pdjax-atlas)"
    )
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")


QUICK = ["bond-based", "Silling", "Silling + penalty", "Seth–Hill 1", "Seth–Hill 0", "Seth–Hill 0 + penalty"]


def _text(value: float, before: str) -> str:
    if value == 0:
        return "0"
    size = "inf" if math.isinf(value) else f"{100 * value:+.4g}"
    return size + (" o" if before == "marginal" else "")


def table(records: list[dict], dim: int, N: float) -> str:
    """Format the critical strains of one lattice: a line for each model."""
    mine = [r for r in records if r["dim"] == dim and r["N"] == N]
    paths = next((list(r["critical"]) for r in mine if "critical" in r), [])
    head = "".join(f"{path:>22}" for path in paths)
    lines = [f"{dim}D, N = {N:g}", f"{'model':<26}{head}   zero waves  ω error kh=1     cost"]
    for r in mine:
        if "refused" in r:
            lines.append(f"{r['model']:<26}  {r['refused']}"[:118])
            continue
        cells = "".join(
            f"{_text(*r['critical'][p]['compression']):>12}{_text(*r['critical'][p]['tension']):>10}" for p in paths
        )
        rest = ""
        if "dispersion" in r:
            error = " ".join(f"{100 * e:+.0f}%" for e in r["dispersion"])
            cost = f"{1e9 * r['cost']:.0f} ns" if "cost" in r else ""
            rest = f"{r['zero_count']:>13}  {error:>14} {cost:>8}"
        lines.append(f"{r['model']:<26}{cells}{rest}")
    return "\n".join(lines)


def run(arguments: argparse.Namespace) -> Job:
    """Survey the models and print the tables. Return the results with a function that writes the picture."""
    import pdjax as pd
    from pdjax._internal.checks import writable

    if arguments.quick:
        arguments.dim, arguments.N, arguments.models = [1], [3.0], arguments.models or QUICK
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "json"))
    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu)  # type: ignore[call-arg]
    found = pd.model_atlas(
        arguments.models, arguments.dim, arguments.N, law, arguments.path or list(pd.PATHS), save=data
    )
    if not arguments.json:
        print(
            "critical strain [%] in compression and tension\n"
            "(0: unstable for any load; inf: not unstable from -90 to +100 %; o: marginal at smaller loads)\n"
        )
        for dim in arguments.dim:
            for n in arguments.N:
                print(table(found.records, dim, n) + "\n")
    out = {"figure": str(picture), "data": str(data), "records": found.records, "settings": found.settings}

    def draw() -> str:
        write_picture(pd.figures.model_atlas(found, arguments.N[-1]), picture)
        return f"wrote {picture} and {data}"

    return out, draw
