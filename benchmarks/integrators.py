"""Which integrator: error against wall time, and what each does to the energy of a long run.

Left: four periods of a travelling wave of finite amplitude on a bar of 60 points (m = 1, N = 3, u0 = 2 % of a spacing,
stretched by 5 %), error of u and v against an eighth-order solution; every method at a series of steps or tolerances,
each run compiled whole, Verlet's and diffrax's alike: the clock sees steps and no host. Right: the largest error of the
energy up to a time, over 200 periods at one step for all, half the critical one.
"""

from functools import partial

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import timed, write

jax.config.update("jax_enable_x64", True)
MODEL = pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=0.0))
F = np.array([[1.05]])


def scene(periods: float):
    """The wave."""
    return pd.scenes.wave(60, 3, 2 * np.pi * 5 / 60, 0.02, MODEL, F=F, periods=periods, travelling=True)


def final(history) -> np.ndarray:
    return np.concatenate([np.asarray(history.u)[-1], np.asarray(history.v)[-1]])


def verlet(motion, steps: int):
    return pd.simulate(motion, dt=motion.duration / steps, save_every=steps, show_progress=False)


def compiled(motion, work):
    """The run `work` (motion → history) in one compiled piece, its start an argument; u and v of its end."""

    @jax.jit
    def run(start, velocity):
        history = work(pd.motion(motion.scene, start=start, velocity=velocity, duration=motion.duration))
        return history.u[-1], history.v[-1]

    return lambda: run(motion.start, motion.velocity)


SOLVERS = {
    "semi-implicit Euler (1)": (diffrax.SemiImplicitEuler(), (500, 1000, 2000, 4000)),
    "Heun (2)": (diffrax.Heun(), (100, 200, 400, 800, 1600)),
    "Bosh3 (3)": (diffrax.Bosh3(), (60, 120, 240, 480, 960)),
    "Tsit5 (5)": (diffrax.Tsit5(), (40, 80, 160, 320)),
    "Dopri8 (8)": (diffrax.Dopri8(), (16, 32, 64)),
    "implicit Euler (1)": (diffrax.ImplicitEuler(), (100, 200, 400)),
    "Kvaerno5 (5, implicit)": (diffrax.Kvaerno5(), (16, 32, 64)),
}


def precision() -> dict[str, list[dict]]:
    """Error and seconds of every method at every step."""
    motion = scene(4.0)
    exact = final(pd.simulate_diffrax(motion, solver=diffrax.Dopri8(), rtol=1e-13, dt=0.01, saves=1))
    scale = np.abs(exact).max()
    rows: dict[str, list[dict]] = {"velocity Verlet (2)": []}

    def measure(name: str, work, steps: int) -> None:
        """One point of one curve."""
        run = compiled(motion, work)
        error = float(np.abs(np.concatenate([np.asarray(x) for x in run()]) - exact).max() / scale)
        rows[name].append({"steps": steps, "error": error, **timed(run, repeats=9)})
        print(name, rows[name][-1], flush=True)

    for steps in (60, 120, 240, 480, 960, 1920):
        measure("velocity Verlet (2)", partial(verlet, steps=steps), steps)
    for name, (solver, counts) in SOLVERS.items():
        rows[name] = []
        for steps in counts:
            fixed = {"solver": solver, "dt": motion.duration / steps, "max_steps": 4 * steps}
            measure(name, partial(pd.simulate_diffrax, saves=1, **fixed), steps)
    rows["Tsit5, adaptive"] = []
    for rtol in (1e-3, 1e-5, 1e-7, 1e-9):
        # the first step can't be found inside jit
        adaptive = {"rtol": rtol, "dt": 0.5 * pd.critical_time_step(motion), "saves": 1}
        steps = int(pd.simulate_diffrax(motion, **adaptive).steps)
        measure("Tsit5, adaptive", partial(pd.simulate_diffrax, max_steps=4 * steps, **adaptive), steps)
    return rows


def long_runs() -> dict[str, dict]:
    """Energy error over 200 periods at half the critical step."""
    motion = scene(200.0)
    dt = 0.5 * pd.critical_time_step(motion)
    every = 20
    saves = int(motion.duration / dt / every)
    out = {}
    history = pd.simulate(motion, saves * every * dt, dt=dt, save_every=every, show_progress=False)
    out["velocity Verlet (2)"] = history
    for name in ("semi-implicit Euler (1)", "Heun (2)", "Bosh3 (3)", "Tsit5 (5)", "implicit Euler (1)"):
        out[name] = pd.simulate_diffrax(motion, saves * every * dt, solver=SOLVERS[name][0], dt=dt, saves=saves)
    rows = {}
    for name, history in out.items():
        budget = history.energies
        total = np.asarray(budget.kinetic + budget.strain)
        wave = total - float(pd.strain_energy(MODEL, motion.scene.families, jnp.zeros_like(motion.start), F))
        error = wave / wave[0] - 1  # of the wave's own energy, the stretched bar's apart
        rows[name] = {
            "times": np.asarray(history.times).tolist(),
            "error": error.tolist(),
            "largest": np.maximum.accumulate(np.abs(error)).tolist(),
            "finished": history.finished,
        }
    return rows


def main() -> None:
    rows, drift = precision(), long_runs()
    figure = Figure(figsize=(11.2, 5.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    palette = ["#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255", "#888888"]
    shades = dict(zip(rows, palette, strict=True))
    for name, line in rows.items():
        left.loglog(
            [r["median"] for r in line],
            [r["error"] for r in line],
            "o-",
            ms=3.5,
            lw=1.1,
            color=shades[name],
            label=name,
        )
    left.set_xlabel("time of the run, compiled  [s]")
    left.set_ylabel("largest error of u and v, relative  [–]")
    left.set_title("four periods of a wave on 60 points", fontsize=10)
    left.legend(frameon=False, fontsize=8)
    for name, line in drift.items():
        right.loglog(line["times"][1:], line["largest"][1:], lw=1.2, color=shades[name], label=name)
    right.set_ylim(1e-3, 30)
    right.axhline(1, color="#888888", lw=0.6)
    right.annotate("1: the wave is gone (Bosh3 and implicit Euler coincide)", (40, 1.15), fontsize=8)
    right.set_xlabel("time  [h √(ρ/E₀)]")
    right.set_ylabel("largest error of the wave's energy so far, relative  [–]")
    right.set_title("200 periods at half the critical step", fontsize=10)
    right.legend(frameon=False, fontsize=8)
    ends = {
        name: {"last": line["error"][-1], "largest": line["largest"][-1], "finished": line["finished"]}
        for name, line in drift.items()
    }
    write("integrators", {"error against time": rows, "energy error at the end of 200 periods": ends}, figure)


if __name__ == "__main__":
    main()
