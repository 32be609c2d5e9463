"""Time of the default map of the command line, its accuracy in float32, and its convergence in the zone grid.

The cold run in a new process is the time that a user waits: import, compilation, 40 000 states with five criteria,
figure and table. The precision part compares verdicts and margins in float32 and float64. The convergence part
computes non-zero critical loads at half, once and twice the default resolution of the Brillouin zone, and the stable
orders in 2D and 3D.
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
    """Seconds of `pdjax map` in a new process and an empty folder."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "pdjax", "map", *arguments], cwd=folder, check=True, capture_output=True)
        return time.perf_counter() - start


def bare() -> float:
    """Seconds of `stability_map` in this process, with the symbol only; the first call includes the compilation."""
    start = time.perf_counter()
    pd.stability_map(
        np.linspace(-2, 2, 200), np.linspace(-0.3, 0.3, 200), law=pd.LinearElastic(1.0, 1.0), show_progress=False
    )
    return time.perf_counter() - start


def precision() -> dict:
    """Differences of verdicts and margins between float32 and float64, and the time of the map in each."""
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
    """Non-zero critical loads by the symbol at 12, 24 (default) and 48 zone intervals, and the stable orders."""
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
