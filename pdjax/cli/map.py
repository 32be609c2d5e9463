"""`pdjax map`: a stability map over the order of the Seth–Hill strain and the load."""

import argparse
import sys
import time

import numpy as np

from .._internal.checks import writable
from .._internal.pictures import write_picture
from .common import Formatter, Job, Jobs, critical_rows, critical_table, lattice_arguments, setting

FIRST = 1024  # a map of at least 16 times this number of states starts with a coarse preview


def number_range(text: str) -> np.ndarray:
    """Parse lo:hi:count into an evenly spaced grid."""
    try:
        low, high, count = text.split(":")
        values = np.linspace(float(low), float(high), int(count))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected lo:hi:count such as -2:2:200, got {text!r}") from None
    if len(values) == 0:
        raise argparse.ArgumentTypeError(f"count must be at least 1, got {text!r}")
    return values


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "map",
        parents=[lattice_arguments()],
        formatter_class=formatter,
        help="stability map over the order m and the load a, with a table of critical loads",
        description="Draw a map of where the Seth–Hill model of order m is stable under the load a. The verdicts come"
        "\nfrom the symbol, searched over all waves. Lines show where cheaper criteria fail. The command writes OUT.png"
        "\nand OUT.npz and prints critical loads.",
    )
    job.add_argument(
        "--m",
        type=number_range,
        default="-2:2:200",
        help="orders m as lo:hi:count; write = before a minus sign (default --m=-2:2:200)",
    )
    job.add_argument(
        "--a", type=number_range, default="-0.3:0.3:200", help="loads a [-] as lo:hi:count (default -0.3:0.3:200)"
    )
    job.add_argument(
        "--out", default="pdjax-map", help="name of the output files, without extension (default pdjax-map)"
    )
    job.add_argument(
        "--certify",
        type=float,
        nargs="?",
        const=1.0,
        metavar="TOL",
        help="prove the sign of every margin; a third panel shows what is proved. With TOL below 1, a stable state must"
        " be proved to have at most (1 - TOL) times its margin",
    )


def run(arguments: argparse.Namespace) -> Job:
    """Compute the map and print the results. Return them with a function that writes the picture."""
    import pdjax as pd

    law, path, influence = setting(arguments)
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    start = time.perf_counter()
    rest = {"N": arguments.N, "dim": arguments.dim, "law": law, "path": path}
    rest |= {"influence": influence, "resolution": arguments.resolution}
    if arguments.m.size * arguments.a.size >= 16 * FIRST:  # show every fourth m and a first
        first = pd.stability_map(arguments.m[::4], arguments.a[::4], **rest)
        drawn = pd.figures.stability_map(first)
        drawn.suptitle("Coarse preview: every fourth order and load; the whole map follows", color="#B00020")
        write_picture(drawn, picture)
        seconds = time.perf_counter() - start
        print(f"coarse preview, {first.margin.size} states, in {picture} after {seconds:.1f} s", file=sys.stderr)
    lines = ["diagonal", "affine", "local", "continuum"]
    grid = pd.stability_map(arguments.m, arguments.a, lines=lines, save=data, certify=arguments.certify, **rest)
    seconds = time.perf_counter() - start
    orders = np.array([-1.0, 0.0, 0.5, 1.0, 2.0])
    rows = critical_rows(orders, ["symbol", "diagonal"], law, path, influence, arguments)
    words, counts = np.unique(grid.verdict, return_counts=True)
    shares = {str(w): float(c / grid.verdict.size) for w, c in zip(words, counts, strict=True)}
    proved = None
    if grid.proof is not None:
        parts = {"stable": -1, "unstable": 1, "open": 0}
        proved = {word: float(np.mean(grid.proof == sign)) for word, sign in parts.items()}
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}, {grid.margin.size} states in {seconds:.1f} s")
        print("by the symbol: " + ", ".join(f"{share:.1%} {word}" for word, share in shares.items()))
        if proved is not None:
            print("proved: " + ", ".join(f"{share:.1%} {word}" for word, share in proved.items()))
        print()
        print("critical loads a [-] (0: unstable for any load; none: no failure from -0.9 to 1)")
        print(critical_table(rows) + "\n")
    out = {
        "figure": str(picture),
        "data": str(data),
        "seconds": seconds,
        "shares": shares,
        "proved": proved,
        "critical_loads": rows,
        "settings": grid.settings,
    }

    def files() -> str:
        write_picture(pd.figures.stability_map(grid), picture)
        return f"wrote {picture} and {data}"

    return out, files
