"""Scene `wave` of the command `pdjax run`: a plane wave on a periodic lattice, compared with the symbol.

This module is not a command. `run` adds its scene to `pdjax run wave`.
"""

import argparse

import numpy as np
from numpy.typing import ArrayLike

from .common import Job, Jobs, write_out
from .motions import check_outputs, extras, moving_arguments, write_extras
from .motions import model as named_model


def add(scenes: Jobs) -> None:
    """Add `wave` to the scenes of `run`."""
    job = scenes.add_parser(
        "wave", parents=[moving_arguments()], help="plane wave on a periodic lattice: its frequency or growth rate"
    )
    job.add_argument("--dim", type=int, default=1, choices=(1, 2, 3), help="number of space dimensions (default 1)")
    job.add_argument("--n", type=int, default=40, help="number of points along each side (default 40)")
    job.add_argument("--j", type=int, nargs="+", default=[4], help="number of wavelengths along each side (default 4)")
    job.add_argument("--m", type=float, default=1.0, help="order m of the Seth–Hill strain (default 1)")
    job.add_argument("--model", default="seth-hill", help="model: seth-hill or correspondence (default seth-hill)")
    job.add_argument(
        "--a",
        type=float,
        default=0.0,
        help="hydrostatic strain of the lattice [-], to which the wave is added (default 0)",
    )
    job.add_argument("--u0", type=float, default=1e-6, help="initial amplitude over spacing [-] (default 1e-6)")
    job.add_argument(
        "--branch",
        type=int,
        default=-1,
        help="branch of the symbol: 0 is the slowest or growing, -1 the fastest (default -1)",
    )
    job.add_argument(
        "--periods",
        type=float,
        default=4.0,
        help="length of the run in periods (default 4); a growing mode runs until it reaches 1 %% of the spacing",
    )
    job.add_argument("--out", default="wave", help="name of the output files, without extension (default wave)")


def run(arguments: argparse.Namespace) -> Job:
    """Simulate a wave and compare its frequency or growth rate with the symbol's.

    Return the results with a function that writes the files.
    """
    import pdjax as pd

    picture, data = check_outputs(arguments)
    dim, n = arguments.dim, arguments.n
    if len(arguments.j) > dim:
        raise ValueError(f"--j takes at most {dim} numbers in {dim}D; got {arguments.j}")
    model = named_model(arguments, dim)
    k = 2 * np.pi * np.array([*arguments.j, *[0] * (dim - len(arguments.j))]) / n
    F = (1 + arguments.a) * np.eye(dim) if arguments.a else None
    how = {"F": F, "branch": arguments.branch, "periods": arguments.periods}
    motion = pd.scenes.wave(n, arguments.N, k, arguments.u0, model, dim, **how)
    family = pd.lattice_family(dim, arguments.N)
    found = pd.dispersion(model, family, np.eye(dim) if F is None else F, k[None])
    omega, growth = (float(x[0, arguments.branch]) for x in (found.frequency, found.growth))
    zero_energy = bool(found.zero_energy[0, arguments.branch])
    dt = arguments.dt
    if dt is None:  # with 300 steps a period the error of Verlet's frequency is 2e-5
        dt = min(0.8 * pd.critical_time_step(motion), 0.02 / (omega or growth or 1.0))
    history = pd.simulate(motion, dt=dt, show_progress=not arguments.json)
    size = np.asarray(pd.amplitude(history.u, motion.start))
    # A run that diverged has no rate to measure.
    measured = pd.measured_rate(history.times, size) if history.finished and len(size) > 2 else pd.Rate(np.nan, np.nan)
    own = pd.verlet_rate(pd.Rate(growth, omega), history.dt)
    law = {"symbol": np.cosh(growth * history.times) if growth else np.cos(omega * history.times)}
    kind = "zero-energy mode" if zero_energy else "growing mode" if growth else "wave"
    waves = ", ".join(f"{x:.4g}" for x in k / np.pi)
    title = f"{kind} k = ({waves}) π/h, {dim}D, m = {arguments.m:g}, a = {arguments.a:g}, u₀ = {arguments.u0:g} h"
    arrays: dict[str, ArrayLike] = {
        "times": history.times,
        "amplitude": size,
        "u": history.u,
        "X": motion.scene.body.positions,
    }
    beside = extras(arguments, "")
    out = {
        "k": k.tolist(),
        "kind": kind,
        "symbol": {"frequency": omega, "growth": growth},
        "measured": {"frequency": float(measured.frequency), "growth": float(measured.growth)},
        "verlet": {"frequency": float(own.frequency), "growth": float(own.growth)},
        "dt": float(history.dt),
        "steps": history.steps,
        "finished": history.finished,
        "reason": history.reason,
        "energy_error": float(np.abs(history.energies.error).max()),
        "figure": str(picture),
        "data": str(data),
        **beside,
    }
    if not arguments.json:
        print(f"{kind}, k = ({waves}) π/h")
        print(f"  symbol:   frequency {omega:.8g}, growth {growth:.8g}")
        if np.isfinite(measured.growth):
            print(f"  measured: frequency {measured.frequency:.8g}, growth {measured.growth:.8g}")
        if np.isfinite(own.frequency):
            exact = f"(exact for the step {history.dt:.4g})"
            print(f"  Verlet:   frequency {own.frequency:.8g}, growth {own.growth:.8g} {exact}")
        else:
            print(f"  Verlet:   unstable, the step {history.dt:.4g} is above the wave's limit 2/ω = {2 / omega:.4g}")
        print(history)

    def files() -> str:
        wrote = write_out(lambda: pd.figures.motion(history, size, law, title, "[h √(ρ/E₀)]"), picture, arrays, data)
        return wrote + write_extras(beside, motion.scene, history)

    return out, files
