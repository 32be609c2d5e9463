"""The default map of the command line, cold, in a process of its own; then float32 beside float64, and its convergence.

The cold run is what a user waits for: import, compilation, 40 000 states with five criteria, figure, table. The
convergence part shows what the default zone is good for: threshold orders and non-zero critical loads at once and
twice the resolution.
"""

import subprocess
import sys
import tempfile
import time

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd
from pdjax.bench.harness import timed, write


def cold(*arguments: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "pdjax", "map", *arguments], cwd=folder, check=True, capture_output=True)
        return time.perf_counter() - start


def bare() -> float:
    """The map alone, symbol only, compilation included, in this process."""
    start = time.perf_counter()
    pd.stability_map(
        np.linspace(-2, 2, 200), np.linspace(-0.3, 0.3, 200), law=pd.LinearElastic(1.0, 1.0), show_progress=False
    )
    return time.perf_counter() - start


def precision() -> dict:
    """Verdicts and margins of the same states in float32, and the time of a chunk in each."""
    m, a = np.linspace(-2, 2, 24), np.linspace(-0.3, 0.3, 25)
    out = {}
    maps = {}
    for name, wide in (("float64", True), ("float32", False)):
        with jax.enable_x64(wide):
            law = pd.LinearElastic(1.0, 1.0)
            out[name] = timed(lambda law=law: pd.stability_map(m, a, law=law, show_progress=False).margin, repeats=3)
            maps[name] = pd.stability_map(m, a, law=law, show_progress=False)
    exact, single = maps["float64"], maps["float32"]
    out["verdicts that differ"] = float(np.mean(exact.verdict != single.verdict))
    out["of these, marginal in float32"] = float(
        np.mean((exact.verdict != single.verdict) & (single.verdict == "marginal"))
    )
    out["largest difference of margins"] = float(np.abs(exact.margin - single.margin).max())
    out["largest tolerance in float32"] = float(single.tolerance.max())
    return out


def convergence() -> dict:
    """Non-zero critical loads by the symbol at 12, 24 (default) and 48 intervals."""
    family = pd.lattice_family(2, 3)
    law = pd.LinearElastic(3.0, 1.0)
    cases = {
        "m = -2, uniaxial strain, compression": (-2.0, pd.uniaxial_strain, "negative"),
        "m = 0.4, uniaxial strain, tension": (0.4, pd.uniaxial_strain, "positive"),
        "m = 2, uniaxial stress, tension": (2.0, pd.uniaxial_stress, "positive"),
    }
    loads = {
        name: {
            n: float(pd.critical_load(pd.SethHill(jnp.asarray(m), law), family, path, "symbol", side, resolution=n))
            for n in (12, 24, 48)
        }
        for name, (m, path, side) in cases.items()
    }
    orders = {
        f"{dim}D, lam = {lam:g}": {
            side: pd.stable_orders(pd.lattice_family(dim, 3), pd.LinearElastic(lam, 1.0), side=side)
            for side in ("negative", "positive")
        }
        for dim in (2, 3)
        for lam in (1.0, 3.0)
    }
    return {"critical loads by intervals": loads, "stable orders, hydrostatic": {k: str(v) for k, v in orders.items()}}


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    write(
        "default_map",
        {
            "pdjax map, cold, seconds": sorted(cold() for _ in range(2)),
            "pdjax map, 24 x 25, cold, seconds": cold("--m=-2:2:24", "--a=-0.3:0.3:25"),
            "stability_map alone (symbol, 200 x 200), first and second call, seconds": [bare(), bare()],
            "precision, 24 x 25": precision(),
            **convergence(),
        },
    )
