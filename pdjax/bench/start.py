"""What a user waits for: the first answer of each call, imports, and the picture of a map.

Every number comes from fresh processes. Of a call (`first_calls`) a row has

    seconds          of the first call with no disk cache: median over the processes
    in_units         the same, over the time that a trivial program takes to compile in the same process
    cached_seconds   of the first call in a process that reads the disk cache of an earlier one
    second_seconds   of later calls in the same process
    programs, lines  programs compiled in the first call, and their lines of StableHLO

Imports and preparation are not in these numbers; imports have rows of their own. "jax and diffrax" is what
`import pdjax` can't do without. A map is a whole process: import, compilation, states with six criteria, table,
picture; "cached" reads the disk cache that the cold one left.
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
PROCESSES = 5  # of the cold first call
READERS = 2  # of the cached one
UNKNOWN = {"compile_seconds": None, "bytes": None, "flops": None, "temporary_bytes": None, "error": None}


def _run(arguments: tuple[str, ...], kept: str | None, folder: str | None = None) -> tuple[float, str]:
    """(seconds, what it printed) of one process that keeps compiled programs in the folder `kept`, if there is one."""
    settings = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    if kept is not None:
        settings["JAX_COMPILATION_CACHE_DIR"] = kept
        settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    start = time.perf_counter()
    done = subprocess.run([sys.executable, *arguments], cwd=folder, check=True, capture_output=True, env=settings)
    return time.perf_counter() - start, done.stdout.decode()


def _told(names: tuple[str, ...], kept: str | None, *option: str) -> dict[str, dict]:
    """name → what `first_calls` says of it, in one fresh process."""
    _, printed = _run(("-m", "pdjax.bench.first_calls", *option, *names), kept)
    return {row["name"]: row for row in map(json.loads, printed.splitlines())}


def answered(names: tuple[str, ...], quick: bool) -> dict[str, dict]:
    """name → row of each call; the calls are made one after the other in the same processes."""
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
    """Seconds that a fresh interpreter takes to run `code`."""
    _run(("-c", code), None)  # the files are read from disk once
    return summary([_run(("-c", code), None)[0] for _ in range(PROCESSES)]) | UNKNOWN


def mapped(arguments: tuple[str, ...]) -> dict[str, dict]:
    """Seconds of `pdjax map` from nothing, and from the disk cache that this leaves."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as kept:
        return {name: summary([_run((*MAP, *arguments), kept, folder)[0]]) | UNKNOWN for name in ("cold", "cached")}


def _one(rows: Callable[[], dict[str, dict]], name: str) -> dict:
    return rows()[name]


def plan(quick: bool) -> Iterator[Task]:
    """First answers, imports, then maps. What is measured in one process is measured once for all its rows."""
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


BARS = {  # column of a row: (what it is, colour)
    "seconds": ("first call: seconds, multiple of a trivial program's, programs", "#D55E00"),
    "cached_seconds": ("from the disk cache", "#E69F00"),
    "second_seconds": ("later calls", "#0072B2"),
}


def draw(rows: list[dict]):
    """Bars on a logarithmic axis: the calls above, whole processes below."""
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
    upper.set_xlabel("wall time in a fresh process, imports apart  [s]")
    upper.tick_params(axis="x", labelbottom=True)
    lower.set_xlabel("wall time of a whole process  [s]")
    return figure


CASE = Case("Start: first answers of every call, imports and the first picture, in fresh processes", plan, draw)
