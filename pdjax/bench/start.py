"""The time that a user waits for: the first result of each function, the imports, and the figure of a map.

Every number comes from new processes. The row of a function (`first_calls`) has

    seconds          of the first call without a disk cache, median over the processes
    in_units         the same, divided by the time that a trivial program takes to compile in the same process
    cached_seconds   of the first call in a process that reads the disk cache of an earlier one
    second_seconds   of later calls in the same process
    programs, lines  programs that the first call compiles, and their lines of StableHLO

These numbers contain neither the imports nor the preparation of the arguments. The imports have separate rows. The row
"import jax, diffrax" is the least time of `import pdjax`, because pdjax needs both packages. A map is a whole process:
import, compilation, states with six criteria, table and figure. "cached" reads the disk cache that the cold process
has written.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np

from .first_calls import MAIN, SMALL
from .harness import Case, Task, summary

MAP = ("-m", "pdjax", "map")
FEW = ("--m=-2:2:24", "--a=-0.3:0.3:25")
PROCESSES = 5  # for the first call without a cache
READERS = 2  # for the first call with a cache
UNKNOWN = {"compile_seconds": None, "bytes": None, "flops": None, "temporary_bytes": None, "error": None}


def _run(arguments: tuple[str, ...], kept: str | None, folder: str | None = None) -> tuple[float, str]:
    """Run one process, with the folder `kept` as its disk cache if there is one; return its seconds and its output."""
    settings = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    if kept is not None:
        settings["JAX_COMPILATION_CACHE_DIR"] = kept
        settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    start = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True, env=settings)
    return time.perf_counter() - start, done.stdout.decode()


def _told(names: tuple[str, ...], kept: str | None, *option: str) -> dict[str, dict]:
    """Return the output of `first_calls` by name, from one new process."""
    _, printed = _run(("-m", "pdjax.bench.first_calls", *option, *names), kept)
    return {row["name"]: row for row in map(json.loads, printed.splitlines())}


def answered(names: tuple[str, ...], quick: bool) -> dict[str, dict]:
    """Measure the named calls, one after the other in the same processes; return a row for each name."""
    with tempfile.TemporaryDirectory() as kept:
        counts = _told(names, kept, "--count")
        cached = [_told(names, kept) for _ in range(1 if quick else READERS)]
    cold = [_told(names, None) for _ in range(1 if quick else PROCESSES)]
    rows = {}
    for name in names:
        mine = [process[name] for process in cold]
        row = summary([process["first"] for process in mine])
        second = float(np.median([process["second"] for process in mine]))
        rows[name] = {
            **row,
            **UNKNOWN,
            "compile_seconds": max(row["seconds"] - second, 0.0),
            "in_units": float(np.median([process["first"] / process["unit"] for process in mine])),
            "cached_seconds": float(np.median([process[name]["first"] for process in cached])),
            "second_seconds": second,
            "programs": counts[name]["programs"],
            "lines": counts[name]["lines"],
        }
    return rows


def imported(code: str) -> dict:
    """Measure the seconds that a new interpreter takes to run `code`."""
    _run(("-c", code), None)  # the first run reads the files from disk
    return summary([_run(("-c", code), None)[0] for _ in range(PROCESSES)]) | UNKNOWN


def mapped(arguments: tuple[str, ...]) -> dict[str, dict]:
    """Measure `pdjax map` without a disk cache, and again with the disk cache that the first run has written."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as kept:
        return {name: summary([_run((*MAP, *arguments), kept, folder)[0]]) | UNKNOWN for name in ("cold", "cached")}


def _one(rows: Callable[[], dict[str, dict]], name: str) -> dict:
    return rows()[name]


def plan(quick: bool) -> Iterator[Task]:
    """Plan the first calls, the imports, then the maps. Rows that share a process share one measurement."""
    for names in (*((name,) for name in MAIN), tuple(SMALL)):
        rows = cache(partial(answered, names, quick))
        for name in names:
            yield Task(name, {}, partial(_one, rows, name))
    for name, code in (
        ("python alone", "pass"),
        ("import jax, diffrax", "import jax, diffrax"),
        ("import jax, diffrax, pdjax", "import jax, diffrax, pdjax"),
        ("import pdjax", "import pdjax"),
    ):
        yield Task(name, {}, partial(imported, code))
    for name, arguments in {"pdjax map, 24 × 25": FEW, **({} if quick else {"pdjax map": ()})}.items():
        rows = cache(partial(mapped, arguments))
        for kind in ("cold", "cached"):
            yield Task(f"{name}, {kind}", {}, partial(_one, rows, kind))


BARS = {  # column of a row: (label, colour)
    "seconds": ("first call: seconds, multiple of a trivial program's time, number of programs", "#CC6677"),
    "cached_seconds": ("from the disk cache", "#999933"),
    "second_seconds": ("later calls", "#332288"),
}


def draw(rows: list[dict]):
    """Draw bars on a logarithmic axis: the calls above, the whole processes below."""
    from matplotlib.figure import Figure

    calls = [row for row in rows if "programs" in row][::-1]
    wholes = [row for row in rows if "programs" not in row][::-1]
    heights = [len(calls) or 0.1, 0.6 * len(wholes) or 0.1]
    figure = Figure(figsize=(9, 1.6 + 0.42 * sum(heights)), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=heights)
    places = range(len(calls))
    for shift, (column, (label, shade)) in zip((0.27, 0.0, -0.27), BARS.items(), strict=True):
        upper.barh([place + shift for place in places], [row[column] for row in calls], 0.25, color=shade, label=label)
    for place, row in zip(places, calls, strict=True):
        times = f"{row['in_units']:.{0 if row['in_units'] > 9.95 else 1}f}"
        text = f" {row['seconds']:.2g} s, {times} ×, {row['programs']}"
        upper.text(row["seconds"], place + 0.27, text, va="center", fontsize=7)
    upper.set_ylim(-0.6, len(calls) - 0.4)
    upper.set_yticks(places, [row["method"] for row in calls], fontsize=8)
    upper.legend(frameon=False, fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    bars = lower.barh([row["method"] for row in wholes], [row["seconds"] for row in wholes], color="#888888")
    lower.bar_label(bars, fmt=" %.2f s", fontsize=7)
    lower.tick_params(axis="y", labelsize=8)
    lower.set_xscale("log")
    lower.set_xlim(1e-4, 10 * max(row["seconds"] for row in rows))
    upper.set_xlabel("wall time in a new process, without imports  [s]")
    upper.tick_params(axis="x", labelbottom=True)
    lower.set_xlabel("wall time of a whole process  [s]")
    return figure


CASE = Case("Start: first call of every function, imports and the first map, in new processes", plan, draw)
