"""What a user waits for before anything runs: imports, and the first picture of the default map.

Every row is a process of its own. "jax and diffrax" is what `import pdjax` can't do without; "cold" has an empty
compilation cache, "cached" the one that the run before it left. The cold map is measured once a row in one process:
import, compilation, 40 000 states with six criteria, table, picture.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial

from .harness import Case, Task, summary

MAP = ("-m", "pdjax", "map")
SMALL = ("--m=-2:2:24", "--a=-0.3:0.3:25")


def _run(arguments: tuple[str, ...], folder: str, cache: str) -> float:
    """Seconds of one process."""
    start = time.perf_counter()
    subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        check=True,
        capture_output=True,
        env={**os.environ, "JAX_COMPILATION_CACHE_DIR": cache},
    )
    return time.perf_counter() - start


def imported(code: str) -> dict:
    """Seconds that a fresh interpreter takes to run `code`."""
    with tempfile.TemporaryDirectory() as folder:
        _run(("-c", code), folder, folder)  # the files are read from disk once
        return summary([_run(("-c", code), folder, folder) for _ in range(7)]) | UNKNOWN


def mapped(arguments: tuple[str, ...], cached: bool) -> dict:
    """Seconds of `pdjax map`."""
    spent = []
    for _ in range(3):
        with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as cache:
            if cached:
                _run((*MAP, *arguments), folder, cache)
            spent.append(_run((*MAP, *arguments), folder, cache))
    return summary(spent) | UNKNOWN


UNKNOWN = {"compile_seconds": None, "bytes": None, "flops": None, "temporary_bytes": None, "error": None}


def plan(quick: bool) -> Iterator[Task]:
    """Imports, then maps."""
    for name, code in (
        ("python alone", "pass"),
        ("import jax, diffrax", "import jax, diffrax"),
        ("import jax, diffrax, pdjax", "import jax, diffrax, pdjax"),
        ("import pdjax", "import pdjax"),
    ):
        yield Task(name, {}, partial(imported, code))
    yield Task("pdjax map, 24 × 25, cold", {}, partial(mapped, SMALL, False))
    yield Task("pdjax map, 24 × 25, cached", {}, partial(mapped, SMALL, True))
    if not quick:
        yield Task("pdjax map, cold", {}, partial(mapped, (), False))
        yield Task("pdjax map, cached", {}, partial(mapped, (), True))


def draw(rows: list[dict]):
    """Bars: there is no error here."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.2, 0.6 + 0.4 * len(rows)), layout="constrained")
    axes = figure.subplots()
    names, seconds = [row["method"] for row in rows][::-1], [row["seconds"] for row in rows][::-1]
    axes.bar_label(axes.barh(names, seconds, color="#0072B2"), fmt=" %.2f", fontsize=8)
    axes.margins(x=0.12)
    axes.set_xlabel("wall time of a fresh process  [s]")
    return figure


CASE = Case("Start: imports and the first picture, in fresh processes", plan, draw)
