"""Statics at scale: time, products and memory of `pdjax.solve` against the unknowns, by four linear solvers.

A lattice is held in a layer at one end and pulled by 2 % of a spacing at the other, in one load step, to a relative
residual of 1e-10. Bars in 1D (bond-based, N = 3), plates in 2D (LPS, N = 3) and blocks in 3D (LPS, N = 2); N is the
horizon over the spacing. A few more blocks of 10⁵ unknowns have other models and horizons.

    Krylov, lattice response   method "newton_krylov": MINRES with the preconditioner of lattices
    Krylov, plain              the same without it
    SuperLU, PARDISO           method "newton" with either direct solver (`pdjax.use_direct_solver`)

Every row runs in a fresh process. Its time holds everything after the import: families, compilation, solution.
PARDISO needs pypardiso. Rows that did not end within the limit say so.
"""

import argparse
import importlib.util
import json
import resource
import subprocess
import sys
import time

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES
from pdjax.finite_body.statics import newton

jax.config.update("jax_enable_x64", True)
KRYLOV, PLAIN, SUPERLU, PARDISO = SOLVERS = ("Krylov, lattice response", "Krylov, plain", "SuperLU", "PARDISO")
BODIES = {
    "bars": ("bond-based", 3, [(100,), (400,), (1600,), (6400,)]),
    "plates": ("LPS", 3, [(40, 20), (80, 40), (160, 80), (320, 160)]),
    "blocks": ("LPS", 2, [(9, 8, 8), (13, 12, 12), (17, 16, 16), (25, 24, 24), (33, 32, 32)]),
}
LARGE = [("bond-based", 3), ("LPS", 3), ("Silling + Wan", 2), ("Seth–Hill, m = 0", 2)]
BLOCK = (35, 32, 32)
MOST = {("blocks", SUPERLU): 14_000, ("blocks", PARDISO): 100_000, ("plates", SUPERLU): 110_000}  # larger: minutes


def model_of(name: str) -> pd.AbstractModel:
    """The models, with λ = 1 and μ = 0.8 where there is a law."""
    law = pd.LinearElastic(1.0, 0.8)
    return {
        "bond-based": lambda: pd.BondBased(1.0),
        "LPS": lambda: pd.LPS(1.0, 1.0),
        "Silling + Wan": lambda: pd.Correspondence(law, pd.WanControl()),
        "Seth–Hill, m = 0": lambda: pd.SethHill(0.0, law),
    }[name]()


def pulled(name: str, N: int, shape: tuple[int, ...]) -> pd.Scene:
    """The lattice, held at one end and pulled at the other, where its sides may slide."""
    body = pd.lattice(shape)
    x, layer = body.positions[:, 0], N - 0.5
    left, right = x < x.min() + layer, x > x.max() - layer
    families = pd.families(body, 1.005 * N)
    return pd.scene(
        body, families, model_of(name), pd.prescribe(left), pd.prescribe(right, 0.02, components=0), name=name
    )


def one(name: str, N: int, shape: tuple[int, ...], solver: str) -> dict:
    """Solve one body in this process."""
    start = time.perf_counter()
    made: list[newton.Krylov] = []
    begin = newton.Krylov.__init__

    def watched(self) -> None:
        begin(self)
        made.append(self)
        if solver == PLAIN:
            self._nearly.append(None)

    newton.Krylov.__init__ = watched  # type: ignore[method-assign]
    scene = pulled(name, N, tuple(shape))
    if solver in (SUPERLU, PARDISO):
        pd.use_direct_solver(solver.lower())
    method = "newton" if solver in (SUPERLU, PARDISO) else "newton_krylov"
    found = pd.solve(scene, method, stability=False, show_progress=False)
    return {
        "unknowns": int(scene.unknowns.size),
        "seconds": time.perf_counter() - start,
        "peak GB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6,
        "Newton iterations": int(found.iterations),
        "products": sum(k.products for k in made) or None,
        "residual": found.residual,
        "converged": bool(found.converged),
        "end": float(np.abs(np.asarray(found.u)[:, 0]).sum()),
    }


def row(body: str, name: str, N: int, shape: tuple[int, ...], solver: str, limit: float) -> dict:
    """One body and solver in a fresh process."""
    head = {"body": body, "model": name, "N": N, "shape": list(shape), "solver": solver}
    task = json.dumps([name, N, shape, solver])
    try:
        done = subprocess.run(
            [sys.executable, __file__, "--row", task], capture_output=True, text=True, timeout=limit, check=True
        )
        result = json.loads(done.stdout.splitlines()[-1])
    except subprocess.TimeoutExpired:
        result = {"unknowns": int(np.prod(shape) * len(shape)), "reason": f"more than {limit:g} s"}
    except subprocess.CalledProcessError as error:
        result = {"unknowns": int(np.prod(shape) * len(shape)), "reason": error.stderr.splitlines()[-1][:200]}
    print({**head, **result}, flush=True)
    return {**head, **result}


def draw(numbers: dict) -> Figure:
    """Time, products of a solution and peak memory against the unknowns, for bars, plates and blocks."""
    rows = [r for r in numbers["rows"] if r.get("converged")]
    shown = {
        "seconds": "time, compilation included  [s]",
        "products": "products A v of a solution",
        "peak GB": "peak memory of the process  [GB]",
    }
    figure = Figure(figsize=(10.5, 8.6), layout="constrained")
    axes = figure.subplots(3, 3, sharex="col", sharey="row")
    for column, (body, (name, N, shapes)) in enumerate(BODIES.items()):
        axes[0, column].set_title(f"{body} in {len(shapes[0])}D, {name}, N = {N}", fontsize=10)
        axes[-1, column].set_xlabel("unknowns")
        for line, quantity in enumerate(shown):
            for k, solver in enumerate(SOLVERS):
                mine = [r for r in rows if r["body"] == body and r["solver"] == solver and r[quantity]]
                at = [r["unknowns"] for r in mine], [r[quantity] for r in mine]
                axes[line, column].loglog(*at, "o-", color=SERIES[k], label=solver)
    for line, words in enumerate(shown.values()):
        axes[line, 0].set_ylabel(words)
    handles, labels = axes[0, 2].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, fontsize=9, frameon=False)
    return figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--row", help="one row, as JSON; used by this script itself")
    parser.add_argument("--limit", type=float, default=240.0, help="most seconds of a row")
    arguments = parser.parse_args()
    if arguments.row:
        print(json.dumps(one(*json.loads(arguments.row))))
        sys.exit()
    able = [s for s in SOLVERS if s != PARDISO or importlib.util.find_spec("pypardiso")]
    rows = []
    for model, horizon in LARGE:
        rows.append(row("large block", model, horizon, BLOCK, KRYLOV, arguments.limit))
    for body, (model, horizon, shapes) in BODIES.items():
        for shape in shapes:
            for solver in able:
                if np.prod(shape) * len(shape) <= MOST.get((body, solver), np.inf):
                    rows.append(row(body, model, horizon, shape, solver, arguments.limit))
    numbers = {"rows": rows}
    write("statics_at_scale", numbers, draw(numbers))
