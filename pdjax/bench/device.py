"""Memory bandwidth and arithmetic rate of the device, measured in the same run, and the fraction that each row reaches.

    bandwidth   a ← b + s a over arrays far larger than the caches: bytes of 3 arrays over the time (STREAM's triad)
    flops       C = A B of large square matrices: 2 n³ over the time

Both are measured and not taken from a data sheet. The fractions of a row are bytes/seconds/bandwidth and
flops/seconds/flops of its dtype, with the bytes and flops that the compiler counts. Bytes that come from a cache count
too. A fraction above 1 is therefore not an error: it means that the memory bandwidth does not limit the program.
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
PASSES = 20  # in place and in one program: new memory for every result would measure the operating system's paging


def _triad(count: int, dtype: str) -> dict:
    a, b = (jnp.full(count, value, dtype) for value in (1.0, 2.0))
    _, row = kernel(lambda a, b: jax.lax.fori_loop(0, PASSES, lambda _, a: b + 0.5 * a, a), a, b, repeats=5)
    moved = PASSES * 3 * count * np.dtype(dtype).itemsize
    return row | {"bytes": moved, "rate": moved / row["seconds"], "error": None}


def _matmul(n: int, dtype: str) -> dict:
    A, B = (jnp.asarray(np.random.default_rng(i).normal(size=(n, n)), dtype) for i in (0, 1))
    product = lambda A, B: jnp.matmul(A, B, precision="highest")  # noqa: E731  # no TF32 for float32 on GPUs
    C, row = kernel(product, A, B, repeats=5)
    some = np.asarray(A, "longdouble")[:4] @ np.asarray(B, "longdouble")
    error = float(np.abs(np.asarray(C)[:4] - some).max() / np.abs(some).max())
    return row | {"flops": 2 * n**3, "rate": 2 * n**3 / row["seconds"], "error": error}


def plan(quick: bool) -> Iterator[Task]:
    """Plan the bandwidth at two sizes larger than the caches, and the flops of matrices of two sizes."""
    for dtype in DTYPES:
        for count in (2**22,) if quick else (2**24, 2**26):
            yield Task("triad", {"size": count}, partial(_triad, count, dtype), dtype)
        for n in (512,) if quick else (2048, 4096):
            yield Task("matmul", {"size": n}, partial(_matmul, n, dtype), dtype)


def draw(rows: list[dict]):
    """Draw the rates as bars."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 3.4), layout="constrained")
    for axes, method, unit in zip(figure.subplots(1, 2), ("triad", "matmul"), ("GB/s", "Gflop/s"), strict=True):
        mine = [row for row in rows if row["method"] == method]
        axes.barh([f"{row['dtype']}, {row['size']}" for row in mine], [row["rate"] / 1e9 for row in mine])
        axes.set_xlabel(f"{method}  [{unit}]")
    return figure


def device_name() -> str:
    """Return the kind of the device as the name of a folder."""
    device = jax.devices()[0]
    return re.sub(r"[^a-z0-9]+", "-", f"{device.platform} {device.device_kind}".lower()).strip("-")


def roofs(rows: list[dict]) -> dict[str, dict[str, float]]:
    """Return the best rates by method and dtype."""

    def best(method: str, dtype: str) -> float:
        return max((r["rate"] for r in rows if (r["method"], r["dtype"]) == (method, dtype)), default=math.nan)

    return {method: {d: best(method, d) for d in DTYPES} for method in ("triad", "matmul")}


def report(folder: Path, quick: bool) -> str:
    """Write device-report.txt with the fractions of every counted row in `folder`; return a line with its name."""
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


CASE = Case("Roofs: measured memory bandwidth and arithmetic rate of the device", plan, draw)
