"""How fast a step is: bond updates per second and bytes per bond, from a body that fits the cache to one that doesn't.

A cube of n³ points, N = 3, float64, one evaluation of the force density: what a step of Verlet costs. Bytes per bond:
the arrays that an evaluation reads (families) and the temporaries that the compiler allots; their sum over the
bandwidth of a plain copy is the time that memory alone would take.
"""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.figures import COLOURS

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(lam=1.0, mu=1.0)
MODELS = {"Silling": pd.Correspondence(LAW), "Seth–Hill, m = 0": pd.SethHill(0.0, LAW)}
SIDES = (6, 8, 10, 14, 20, 28, 36)


def bandwidth() -> float:
    """Bytes per second of a copy that no cache holds (read and written bytes counted)."""
    a = np.ones(40_000_000)
    b = np.empty_like(a)
    spent = timed(lambda: np.copyto(b, a), repeats=5)
    return 2 * a.nbytes / spent["median"]


def caches() -> dict[str, float]:
    """Megabytes of the caches of data of the first core, where the system tells."""
    sizes = {}
    for place in sorted(Path("/sys/devices/system/cpu/cpu0/cache").glob("index*")):
        level, kind, size = ((place / name).read_text().strip() for name in ("level", "type", "size"))
        if kind != "Instruction":
            sizes[f"L{level}"] = int(size.rstrip("K")) * 1024 / 1e6
    return sizes


def one(model, n: int, rate: float) -> dict:
    """Seconds and bytes of one force evaluation."""
    fams = pd.families(pd.lattice((n,) * 3, 1.0), 3.0)
    u = 1e-3 * jnp.asarray(np.random.default_rng(0).normal(size=(n**3, 3)))
    work = jax.jit(lambda model, fams, u: pd.force_density(model, fams, u)).lower(model, fams, u).compile()
    memory = work.memory_analysis()
    bonds = int(fams.count.sum())
    spent = timed(lambda: work(model, fams, u), repeats=5)
    per_bond = (memory.argument_size_in_bytes + memory.temp_size_in_bytes) / bonds
    return {
        "points": n**3,
        "bonds": bonds,
        "slots": int(fams.weight.size),
        "seconds": spent["median"],
        "bonds per second": bonds / spent["median"],
        "argument bytes per bond": memory.argument_size_in_bytes / bonds,
        "temporary bytes per bond": memory.temp_size_in_bytes / bonds,
        "megabytes": per_bond * bonds / 1e6,
        "seconds by memory alone": (memory.argument_size_in_bytes + 2 * memory.temp_size_in_bytes) / rate,
        "spread": [spent["fastest"], spent["slowest"]],
    }


def main() -> None:
    rate = bandwidth()
    rows = {name: [one(model, n, rate) for n in SIDES] for name, model in MODELS.items()}
    figure = Figure(figsize=(6.8, 4.6), layout="constrained")
    axes = figure.subplots()
    for (name, line), shade in zip(rows.items(), (COLOURS["diagonal"], COLOURS["symbol"]), strict=True):
        size = [r["megabytes"] for r in line]
        axes.loglog(
            size, [r["bonds per second"] / 1e6 for r in line], "o-", color=shade, lw=1.3, label=f"{name}, measured"
        )
        floor = [r["bonds"] / r["seconds by memory alone"] / 1e6 for r in line]
        axes.loglog(size, floor, "--", color=shade, lw=1.0, label=f"{name}, if memory alone set the pace")
    known = caches()
    for name, size in known.items():
        if size > 0.5:  # the first level holds none of these bodies
            axes.axvline(size, color="#888888", linewidth=0.8)
            axes.annotate(
                name, (size, 1), xycoords=("data", "axes fraction"), xytext=(3, -11), textcoords="offset points"
            )
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("memory that one evaluation touches  [MB]")
    axes.set_ylabel("million bond updates per second")
    axes.set_title("Force density of a cube, N = 3, float64, padded families", fontsize=10)
    axes.legend(frameon=False, fontsize=8)
    ratio = {n: [r["seconds"] / r["seconds by memory alone"] for r in line] for n, line in rows.items()}
    numbers = {
        "copy bandwidth, GB/s": rate / 1e9,
        "caches, MB": known,
        "time over that by memory alone": ratio,
        "force density": rows,
    }
    write("bond_rate", numbers, figure)


if __name__ == "__main__":
    main()
