"""`pdjax critical`: critical loads by every criterion."""

import argparse
from typing import Any

from .common import Job, critical_rows, critical_table, lattice_arguments, setting


def add(jobs: Any, formatter: Any) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "critical",
        parents=[lattice_arguments()],
        formatter_class=formatter,
        help="critical loads by every criterion",
        description="The load at which each criterion first fails, on both sides of the path: 0 means at once,"
        "\nnone that it does not within -90 % to +100 %.",
    )
    job.add_argument("--m", type=float, nargs="+", default=[0.0, 1.0], help="orders (default 0 1)")
    job.add_argument("--criterion", nargs="+", help="criteria (default: symbol and the cheap ones)")


def run(arguments: argparse.Namespace) -> Job:
    """Find the critical loads and print them."""
    law, path, influence = setting(arguments)
    names = arguments.criterion or ["symbol", "block", "diagonal", "continuum"]
    rows = critical_rows(arguments.m, names, law, path, influence, arguments)
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}: critical loads a [-]")
        print("(0: unstable at once; none: not within -0.9 to 1; states that are marginal count as not unstable)")
        print(critical_table(rows))
    return {"critical_loads": rows}, None
