"""`pdjax critical`: critical loads by every criterion."""

import argparse

from .common import Formatter, Job, Jobs, critical_rows, critical_table, lattice_arguments, number, setting


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
    job.add_argument(
        "--certify",
        action="store_true",
        help="prove stability up to 0.999 of each critical load of the symbol, and instability at 1.001 of it",
    )


def run(arguments: argparse.Namespace) -> Job:
    """Compute the critical loads and print them."""
    law, path, influence = setting(arguments)
    names = arguments.criterion or ["symbol", "block", "diagonal", "continuum"]
    rows = critical_rows(arguments.m, names, law, path, influence, arguments)
    proofs = _proofs(law, path, influence, arguments) if arguments.certify else None
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}: critical loads a [-]")
        print("(0: unstable for any load; none: no failure from -0.9 to 1; marginal states do not count as unstable)")
        print(critical_table(rows))
        for row in proofs or []:
            print(f"m = {row['m']:g}, {row['side']} loads, a = {number(row['a_cr'])}: {row['verdict']}")
    return {"critical_loads": rows} | ({} if proofs is None else {"proofs": proofs}), None


def _proofs(law, path, influence, arguments: argparse.Namespace) -> list[dict]:
    """The proofs on both sides of the critical load of the symbol, for every order and side."""
    import pdjax as pd

    family, rows = pd.lattice_family(arguments.dim, arguments.N, influence=influence), []
    for m in arguments.m:
        for side in ("negative", "positive"):
            found = pd.certify_critical_load(pd.SethHill(m, law), family, path, side)
            row = {"m": m, "side": side, "a_cr": found.load, "proved": found.proved, "verdict": found.verdict}
            rows.append(row)
    return rows
