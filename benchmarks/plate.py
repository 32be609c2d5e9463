"""The critical load of a clamped square plate of 10⁵ unknowns (2D, N = 3, m = 1, λ = μ = 1, hydrostatic compression).

The computation needs one linearised eigenproblem at rest and one or two Newton steps, each with one sparse
factorisation. Two more factorisations prove the crossing. `--side` sets the number of points along a side. The default
ends with 236: 224² free points, 100 352 unknowns, about 13 minutes and 6 GB on two cores (results/plate.json).
"""

import argparse
import resource
import time

import jax
import jax.numpy as jnp

import pdjax as pd
from pdjax.bench.harness import write

jax.config.update("jax_enable_x64", True)


def one(side: int) -> dict:
    """Critical load, factorisations, seconds and memory of one plate."""
    model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    scene = pd.scenes.clamped_plate((side, side), 3, (1 - 1e-3) * jnp.eye(2), model)
    start = time.perf_counter()
    found = pd.body_critical_load(scene, limit=100.0)
    return {
        "unknowns": len(scene.unknowns),
        "critical hydrostatic strain": -1e-3 * found.factor,
        "times free side squared": -1e-3 * found.factor * (side - 12) ** 2,
        "factorisations": found.factorisations,
        "positive eigenvalues at each": [list(pair) for pair in found.positive],
        "proved": found.proved,
        "seconds": time.perf_counter() - start,
        "peak memory of the process, GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--side", type=int, nargs="+", default=[30, 60, 120, 236], help="points along a side")
    write("plate", {"plates": [one(side) for side in parser.parse_args().side]})
