"""What the device itself can do, measured in the same run, and what fraction of it each row achieves.

    bandwidth   a ← b + s a over arrays far beyond the caches: 3 arrays of bytes over the time (as STREAM's triad)
    flops       C = A B of large square matrices: 2 n³ over the time

No numbers of a data sheet. A row's fractions are bytes/seconds/bandwidth and flops/seconds/flops of its dtype, with the
bytes and flops that the compiler counts; bytes served by caches count too, so a fraction above 1 is no error: it says
that memory is not what limits.
"""

import math
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from .._internal.checks import written_whole
from .harness import Case, Task, flat, kernel, read

ROOFS = "roofs"
DTYPES = ("float64", "float32")
PASSES = 20  # in place, in one program: fresh memory for every result would measure the operating system's pages


def _triad(count: int, dtype: str) -> dict:
    a, b = (jnp.full(count, value, dtype) for value in (1.0, 2.0))
    _, row = kernel(lambda a, b: jax.lax.fori_loop(0, PASSES, lambda _, a: b + 0.5 * a, a), a, b, repeats=5)
    moved = PASSES * 3 * count * np.dtype(dtype).itemsize
    return row | {"bytes": moved, "rate": moved / row["seconds"], "error": None}


def _matmul(n: int, dtype: str) -> dict:
    A, B = (jnp.asarray(np.random.default_rng(i).normal(size=(n, n)), dtype) for i in (0, 1))
    product = lambda A, B: jnp.matmul(A, B, precision="highest")  # noqa: E731  # a float32 is one: no TF32 on GPUs
    C, row = kernel(product, A, B, repeats=5)
    some = np.asarray(A, "longdouble")[:4] @ np.asarray(B, "longdouble")
    error = float(np.abs(np.asarray(C)[:4] - some).max() / np.abs(some).max())
    return row | {"flops": 2 * n**3, "rate": 2 * n**3 / row["seconds"], "error": error}


def plan(quick: bool) -> Iterator[Task]:
    """Bandwidth at sizes beyond the caches, flops of matrices of two sizes."""
    for dtype in DTYPES:
        for count in (2**22,) if quick else (2**24, 2**26):
            yield Task("triad", {"size": count}, partial(_triad, count, dtype), dtype)
        for n in (512,) if quick else (2048, 4096):
            yield Task("matmul", {"size": n}, partial(_matmul, n, dtype), dtype)


def draw(rows: list[dict]):
    """Rates as bars."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    for axes, method, unit in zip(figure.subplots(1, 2), ("triad", "matmul"), ("GB/s", "Gflop/s"), strict=True):
        mine = [row for row in rows if row["method"] == method]
        axes.barh([f"{row['dtype']}, {row['size']}" for row in mine], [row["rate"] / 1e9 for row in mine])
        axes.set_xlabel(f"{method}  [{unit}]")
    return figure


def device_name() -> str:
    """The device's kind as a folder's name."""
    device = jax.devices()[0]
    return re.sub(r"[^a-z0-9]+", "-", f"{device.platform} {device.device_kind}".lower()).strip("-")


def roofs(rows: list[dict]) -> dict[str, dict[str, float]]:
    """Best rates by method and dtype."""

    def best(method: str, dtype: str) -> float:
        return max((r["rate"] for r in rows if (r["method"], r["dtype"]) == (method, dtype)), default=math.nan)

    return {method: {d: best(method, d) for d in DTYPES} for method in ("triad", "matmul")}


def report(folder: Path, quick: bool) -> str:
    """Write device-report.txt: for every counted row of every case in `folder` the fractions achieved; its name."""
    ending = "-quick" if quick else ""
    best = roofs(read(folder / f"{ROOFS}{ending}.json")["rows"])
    lines = [
        f"{m} {d}: {rate / 1e9:.1f} {'GB/s' if m == 'triad' else 'Gflop/s'}"
        for m in best
        for d, rate in best[m].items()
    ]
    lines += ["", "bandwidth    flops     seconds  row"]
    for file in sorted(folder.glob("*.json")):
        if file.stem.endswith("-quick") != quick or file.stem == f"{ROOFS}{ending}":
            continue
        for row in flat(read(file)["rows"]):
            if row.get("bytes") is None or row.get("flops") is None or row["dtype"] not in DTYPES:
                continue
            share = [
                row[k] / row["seconds"] / best[m][row["dtype"]] for k, m in (("bytes", "triad"), ("flops", "matmul"))
            ]
            name = ", ".join(str(v) for k, v in row.items() if k in ("method", "scene", "body", "n", "steps", "dtype"))
            lines.append(f"{share[0]:9.3f}{share[1]:9.4f}{row['seconds']:12.3g}  {file.stem}: {name}")
    out = folder / f"device-report{ending}.txt"
    with written_whole(out) as stream:
        stream.write(("\n".join(lines) + "\n").encode())
    return f"wrote {out}"


CASE = Case("Roofs: what the device's memory and arithmetic can do, measured", plan, draw)
