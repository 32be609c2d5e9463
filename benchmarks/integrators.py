"""Accuracy of the time integrators against wall time, and their energy error in a long run.

Left panel: the case `integrators` of `pdjax bench`; `pdjax/bench/integrators.py` describes the wave and how the time is
measured. Right panel: the largest error of the energy up to a given time. The run lasts 200 periods, and all methods
use the same step, half the critical one.
"""

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.bench.integrators import SOLVERS, VERLET, plan, scene
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)


def precision() -> dict[str, list[dict]]:
    """Error and seconds of every method at every step."""
    rows: dict[str, list[dict]] = {}
    for task in plan(False):
        row = task.settings | task.measure()
        rows.setdefault(task.method, []).append(row)
        print(task.method, row, flush=True)
    return rows


def long_runs() -> dict[str, dict]:
    """Energy error of each method over 200 periods at half the critical step."""
    motion = scene(200.0)
    dt = 0.5 * pd.critical_time_step(motion)
    at_rest = jnp.zeros_like(motion.start)
    stretched = float(pd.strain_energy(motion.scene.model, motion.scene.families, at_rest, motion.scene.mean))
    every = 20
    saves = int(motion.duration / dt / every)
    out = {}
    history = pd.simulate(motion, saves * every * dt, dt=dt, save_every=every, show_progress=False)
    out[VERLET] = history
    for name in ("semi-implicit Euler (1)", "Heun (2)", "Bosh3 (3)", "Tsit5 (5)", "implicit Euler (1)"):
        out[name] = pd.simulate_diffrax(motion, saves * every * dt, solver=SOLVERS[name][0](), dt=dt, saves=saves)
    rows = {}
    for name, history in out.items():
        budget = history.energies
        total = np.asarray(budget.kinetic + budget.strain)
        wave = total - stretched
        error = wave / wave[0] - 1  # relative to the energy of the wave, without the energy of the stretched bar
        rows[name] = {
            "times": np.asarray(history.times).tolist(),
            "error": error.tolist(),
            "largest": np.maximum.accumulate(np.abs(error)).tolist(),
            "finished": history.finished,
        }
    return rows


def draw(numbers: dict, drift: dict[str, dict] | None = None) -> Figure:
    """Draw both panels. The file keeps only the ends of the long runs: without `drift` they run again.

    Files written before the case `integrators` existed name the seconds "median".
    """
    rows, drift = numbers["error against time"], drift or long_runs()
    figure = Figure(figsize=(11.2, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    shades = dict(zip(rows, (*SERIES, "#888888", "#DDCC77"), strict=True))
    for name, line in rows.items():
        x, y = [r["seconds" if "seconds" in r else "median"] for r in line], [r["error"] for r in line]
        left.loglog(x, y, "o-", ms=3.5, lw=1.1, color=shades[name], label=name)
    left.set_xlabel("time of the run without compilation  [s]")
    left.set_ylabel("largest error of u and v, relative  [–]")
    left.set_title("four periods of a wave on 60 points", fontsize=10)
    left.legend(frameon=False, fontsize=8, title="method (order)", title_fontsize=8)
    for name, line in drift.items():
        right.loglog(line["times"][1:], line["largest"][1:], lw=1.2, color=shades[name], label=name)
    right.set_ylim(1e-3, 30)
    right.axhline(1, color="#888888", lw=0.6)
    right.annotate("1: no wave energy is left (Bosh3 and implicit Euler coincide)", (40, 1.15), fontsize=8)
    right.set_xlabel("time  [h √(ρ/E₀)]")
    right.set_ylabel("largest error of the wave's energy so far, relative  [–]")
    right.set_title("200 periods at half the critical step", fontsize=10)
    right.legend(frameon=False, fontsize=8)
    return figure


def main() -> None:
    rows, drift = precision(), long_runs()
    ends = {
        name: {"last": line["error"][-1], "largest": line["largest"][-1], "finished": line["finished"]}
        for name, line in drift.items()
    }
    numbers = {"error against time": rows, "energy error at the end of 200 periods": ends}
    write("integrators", numbers, draw(numbers, drift))


if __name__ == "__main__":
    main()
