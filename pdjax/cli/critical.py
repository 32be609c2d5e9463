"""`pdjax critical`: critical loads by every criterion."""

import argparse

from .common import Formatter, Job, Jobs, critical_rows, critical_table, lattice_arguments, setting


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "critical",
        parents=[lattice_arguments()],
        formatter_class=formatter,
        help="critical loads by several stability criteria",
        description="Compute the load at which each stability criterion of a Seth–Hill model first fails, in"
        "\ncompression and in tension. The criterion symbol is exact. The other criteria are cheaper tests. The table"
        "\nshows 0 where a criterion fails at any load, however small, and none where it does not fail from -90 % to"
        "\n+100 %.",
    )
    job.add_argument(
        "--m", type=float, nargs="+", default=[0.0, 1.0], help="orders m of the Seth–Hill strain (default 0 1)"
    )
    job.add_argument("--criterion", nargs="+", help="criteria (default symbol block diagonal continuum)")


def run(arguments: argparse.Namespace) -> Job:
    """Compute the critical loads and print them."""
    law, path, influence = setting(arguments)
    names = arguments.criterion or ["symbol", "block", "diagonal", "continuum"]
    rows = critical_rows(arguments.m, names, law, path, influence, arguments)
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}: critical loads a [-]")
        print("(0: unstable for any load; none: no failure from -0.9 to 1; marginal states do not count as unstable)")
        print(critical_table(rows))
    return {"critical_loads": rows}, None
