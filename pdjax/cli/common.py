"""Parts that the commands share: the parser, arguments of a lattice, tables of critical loads, output files."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._internal.checks import written_whole
from .._internal.pictures import write_picture
from ..geometry.influence import INFLUENCES
from ..infinite_lattice.paths import PATHS
from ..models.laws import Law

if TYPE_CHECKING:
    import matplotlib.figure

Job = tuple[dict, Callable[[], str] | None]  # the results, and a function that writes the files and returns a message

Jobs = argparse._SubParsersAction  # what `add_subparsers` returns
Formatter = type[argparse.HelpFormatter]


class Parser(argparse.ArgumentParser):
    """Parser whose error message explains how to pass a value that starts with a minus sign."""

    def error(self, message: str):
        """Print the usage and the message, and exit with status 2."""
        hint = "" if "expected one argument" not in message else " (before a minus sign write =, as in --a=-0.1:0.1:81)"
        super().error(message + hint)


def lattice_arguments() -> Parser:
    """Make the arguments of the commands about a Seth–Hill model on a lattice."""
    common = Parser(add_help=False)
    common.add_argument("--dim", type=int, default=2, choices=(1, 2, 3), help="number of space dimensions (default 2)")
    common.add_argument("--N", type=float, default=3.0, help="horizon over lattice spacing [-] (default 3)")
    common.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    common.add_argument("--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1)")
    add_influence(common)
    common.add_argument(
        "--path",
        default="hydrostatic",
        choices=list(PATHS),
        help="load path: the deformation gradient F as a function of the load a (default hydrostatic)",
    )
    common.add_argument("--resolution", type=int, help="intervals of the search grid from 0 to π/spacing (default 8 N)")
    common.add_argument("--json", action="store_true", help="print the results as one JSON object")
    return common


def add_influence(job: argparse.ArgumentParser) -> None:
    """Add the argument that names an influence function."""
    job.add_argument(
        "--influence",
        default="constant",
        choices=[name.replace(" ", "_") for name in INFLUENCES],
        help="influence function of the bonds; linear is 1 - r/horizon (default constant)",
    )


def setting(arguments: argparse.Namespace) -> tuple[Law, Callable, Callable]:
    """Return the law, the load path and the influence function that the arguments name."""
    import pdjax as pd

    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu)  # type: ignore[call-arg]
    influence = getattr(pd, f"{arguments.influence}_influence")
    return law, pd.PATHS[arguments.path], influence


def number(x: float) -> str:
    """Format a critical load for the table."""
    return f"{x:+.4f}" if math.isfinite(x) and x != 0 else {0.0: "0"}.get(x, "none" if math.isinf(x) else "undefined")


def critical_table(rows: list[dict]) -> str:
    """Format critical loads: a line for each order, two columns for each criterion."""
    criteria = list(dict.fromkeys(row["criterion"] for row in rows))
    orders = list(dict.fromkeys(row["m"] for row in rows))
    at = {(r["m"], r["criterion"], r["side"]): number(r["a_cr"]) for r in rows}
    lines = [
        "     m" + "".join(f"{c:>24}" for c in criteria),
        "      " + f"{'compression':>14}{'tension':>10}" * len(criteria),
    ]
    for m in orders:
        cells = (f"{at[m, c, 'negative']:>14}{at[m, c, 'positive']:>10}" for c in criteria)
        lines.append(f"{m:>6g}" + "".join(cells))
    return "\n".join(lines)


def critical_rows(orders, names, law, path, influence, arguments) -> list[dict]:
    """Compute critical loads of Seth–Hill models on both sides of the path, by every named criterion."""
    import pdjax as pd

    family = pd.lattice_family(arguments.dim, arguments.N, influence=influence)
    return [
        {
            "m": float(m),
            "criterion": name,
            "side": side,
            "a_cr": float(
                pd.critical_load(pd.SethHill(m, law), family, path, name, side, resolution=arguments.resolution)
            ),
        }
        for name in names
        for side in ("negative", "positive")
        for m in orders
    ]


def write_out(draw: Callable[[], "matplotlib.figure.Figure"], picture: Path, arrays: dict[str, Any], data: Path) -> str:
    """Write the arrays and then the figure, and return a message. Each file is written completely or not at all."""
    with written_whole(data) as stream:
        np.savez(stream, **arrays)
    write_picture(draw(), picture)
    return f"wrote {data} and {picture}"


class Size(NamedTuple):
    """Sizes of a scene of `run`: points and where they are counted, those of --quick, and horizon over spacing."""

    n: int
    where: str
    quick: int
    N: float


def add_scene(scenes: Jobs, name: str, shows: str, size: Size) -> argparse.ArgumentParser:
    """Add a scene of fracture to `run`, with the arguments that all of them share."""
    job = scenes.add_parser(name, help=shows, description=f"{shows[0].upper()}{shows[1:]}.")
    job.add_argument("--n", type=int, help=f"number of points {size.where} (default {size.n})")
    job.add_argument("--N", type=float, default=size.N, help=f"horizon over spacing [-] (default {size.N:g})")
    job.add_argument("--quick", action="store_true", help=f"a small body of {size.quick} points {size.where}")
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")
    job.add_argument("--out", default=name, help=f"name of the output files, without extension (default {name})")
    return job


def points_of(arguments: argparse.Namespace, size: Size) -> int:
    """The number of points that the arguments of a scene ask for."""
    if arguments.n is not None:
        return arguments.n
    return size.quick if arguments.quick else size.n
