"""`pdjax map`: regions of stability over order and load."""

import argparse
import sys
import time
from typing import Any

import numpy as np

from .._internal.checks import writable
from .._internal.pictures import write_picture
from .common import Job, critical_rows, critical_table, lattice_arguments, setting

FIRST = 1024  # states that a first picture of a map needs


def number_range(text: str) -> np.ndarray:
    """lo:hi:count → an even grid."""
    try:
        low, high, count = text.split(":")
        values = np.linspace(float(low), float(high), int(count))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected lo:hi:count such as -2:2:200, got {text!r}") from None
    if len(values) == 0:
        raise argparse.ArgumentTypeError(f"count must be at least 1, got {text!r}")
    return values


def add(jobs: Any, formatter: Any) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "map",
        parents=[lattice_arguments()],
        formatter_class=formatter,
        help="regions of stability over order m and load a: PNG, npz, table of critical loads",
        description="Draw where the Seth–Hill model of order m is stable under the load a: exactly, by the symbol,"
        "\nwith the lines of the cheaper criteria. Writes OUT.png and OUT.npz and prints critical loads.",
    )
    job.add_argument(
        "--m",
        type=number_range,
        default="-2:2:200",
        help="orders lo:hi:count, = before a minus sign (default --m=-2:2:200)",
    )
    job.add_argument("--a", type=number_range, default="-0.3:0.3:200", help="loads lo:hi:count (default -0.3:0.3:200)")
    job.add_argument("--out", default="pdjax-map", help="name of the files without ending (default pdjax-map)")


def run(arguments: argparse.Namespace) -> Job:
    """Compute the map; say what was found, and what writes the files."""
    import pdjax as pd

    law, path, influence = setting(arguments)
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    start = time.perf_counter()
    rest = {"N": arguments.N, "dim": arguments.dim, "law": law, "path": path}
    rest |= {"influence": influence, "resolution": arguments.resolution}
    if arguments.m.size * arguments.a.size >= 16 * FIRST:  # a picture soon, of every fourth m and a; then the map
        first = pd.stability_map(arguments.m[::4], arguments.a[::4], **rest)
        drawn = pd.figures.stability_map(first)
        drawn.suptitle("Coarse preview: every fourth order and load; the whole map follows", color="#B00020")
        write_picture(drawn, picture)
        seconds = time.perf_counter() - start
        print(f"coarse preview, {first.margin.size} states, in {picture} after {seconds:.1f} s", file=sys.stderr)
    lines = ["diagonal", "affine", "local", "continuum"]
    grid = pd.stability_map(arguments.m, arguments.a, lines=lines, save=data, **rest)
    seconds = time.perf_counter() - start
    orders = np.array([-1.0, 0.0, 0.5, 1.0, 2.0])
    rows = critical_rows(orders, ["symbol", "diagonal"], law, path, influence, arguments)
    words, counts = np.unique(grid.verdict, return_counts=True)
    shares = {str(w): float(c / grid.verdict.size) for w, c in zip(words, counts, strict=True)}
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}, {grid.margin.size} states in {seconds:.1f} s")
        print("by the symbol: " + ", ".join(f"{share:.1%} {word}" for word, share in shares.items()) + "\n")
        print("critical loads a [-] (0: unstable at once; none: not within -0.9 to 1)")
        print(critical_table(rows) + "\n")
    out = {
        "figure": str(picture),
        "data": str(data),
        "seconds": seconds,
        "shares": shares,
        "critical_loads": rows,
        "settings": grid.settings,
    }

    def files() -> str:
        write_picture(pd.figures.stability_map(grid), picture)
        return f"wrote {picture} and {data}"

    return out, files
