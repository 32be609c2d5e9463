"""`pdjax atlas`: the survey of models on the command line."""

import argparse
import math
from typing import Any

from .._internal.pictures import write_picture
from .common import Job


def add(jobs: Any, formatter: Any) -> None:
    """The arguments of the job."""
    job = jobs.add_parser(
        "atlas",
        formatter_class=formatter,
        help="every model of the table: critical strains, zero-energy waves, dispersion, cost",
        description="Survey the models on infinite lattices by the symbol. Writes OUT.json, kept up to date model by"
        "\nmodel and gone on with after a stop, and OUT.png; prints the table.",
    )
    job.add_argument("--dim", type=int, nargs="+", default=[1, 2], choices=(1, 2, 3), help="dimensions (default 1 2)")
    job.add_argument("--N", type=float, nargs="+", default=[3.0], help="horizons over lattice spacing (default 3)")
    job.add_argument("--models", nargs="+", help="names of models, in quotes (default: all; a wrong name lists them)")
    job.add_argument("--path", nargs="+", help="load paths (default: all)")
    job.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    job.add_argument("--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1)")
    job.add_argument("--quick", action="store_true", help="1D, N = 3, six models: about a minute")
    job.add_argument("--out", default="pdjax-atlas", help="name of the files without ending (default pdjax-atlas)")
    job.add_argument("--json", action="store_true", help="print one JSON object instead of text")


QUICK = ["bond-based", "Silling", "Silling + penalty", "Seth–Hill 1", "Seth–Hill 0", "Seth–Hill 0 + penalty"]


def _text(value: float, before: str) -> str:
    if value == 0:
        return "0"
    size = "inf" if math.isinf(value) else f"{100 * value:+.4g}"
    return size + (" o" if before == "marginal" else "")


def table(records: list[dict], dim: int, N: float) -> str:
    """Critical strains of one lattice: a line for each model."""
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
    """Do the job: what goes to --json, and what writes the picture."""
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
        print("critical strain [%] in compression and tension (0: at once, inf: not within -90 to +100, o: marginal)\n")
        for dim in arguments.dim:
            for n in arguments.N:
                print(table(found.records, dim, n) + "\n")
    out = {"figure": str(picture), "data": str(data), "records": found.records, "settings": found.settings}

    def draw() -> str:
        write_picture(pd.figures.model_atlas(found, arguments.N[-1]), picture)
        return f"wrote {picture} and {data}"

    return out, draw
