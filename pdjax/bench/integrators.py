"""Time and accuracy of the integrators: error of a travelling wave against wall time.

The motion is four periods of a travelling wave of finite amplitude on a bar of 60 points (m = 1, N = 3, u₀ = 2 % of the
spacing, stretched by 5 %). Every method runs with several numbers of steps or tolerances. Each run is compiled as one
program, for velocity Verlet and for diffrax, so that the time contains no work of the host. The error is the largest
error of u and v at the end, relative to the largest entry. The reference is an eighth-order solution with a tolerance
of 1e-13.
"""

from collections.abc import Callable, Iterator
from functools import cache, partial

import diffrax
import numpy as np

from ..finite_body.dynamics import History, Motion, critical_time_step, motion, simulate, simulate_diffrax
from ..models import SethHill
from ..models.laws import LinearElastic
from ..scenes import wave
from .chart import error_against_time
from .harness import Case, Task, enable_x64, kernel

SCENE = "wave"
POINTS, STRETCH, U0, WAVES = 60, 0.05, 0.02, 5
PERIODS = 4.0
VERLET = "velocity Verlet (2)"
VERLET_STEPS = (60, 120, 240, 480, 960, 1920)
SOLVERS: dict[str, tuple[Callable, tuple[int, ...]]] = {
    "semi-implicit Euler (1)": (diffrax.SemiImplicitEuler, (500, 1000, 2000, 4000)),
    "Heun (2)": (diffrax.Heun, (100, 200, 400, 800, 1600)),
    "Bosh3 (3)": (diffrax.Bosh3, (60, 120, 240, 480, 960)),
    "Tsit5 (5)": (diffrax.Tsit5, (40, 80, 160, 320)),
    "Dopri8 (8)": (diffrax.Dopri8, (16, 32, 64)),
    "implicit Euler (1)": (diffrax.ImplicitEuler, (100, 200, 400)),
    "Kvaerno5 (5, implicit)": (diffrax.Kvaerno5, (16, 32, 64)),
}
ADAPTIVE = "Tsit5, adaptive"
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9)


def scene(periods: float) -> Motion:
    """Return the wave."""
    model = SethHill(1.0, LinearElastic(lam=1.0, mu=0.0))  # type: ignore[call-arg, arg-type]
    k, F = 2 * np.pi * WAVES / POINTS, np.array([[1 + STRETCH]])
    return wave(POINTS, 3, k, U0, model, F=F, periods=periods, travelling=True)


def end(history) -> np.ndarray:
    """Return u and v at the end of a motion."""
    return np.concatenate([np.asarray(history.u)[-1], np.asarray(history.v)[-1]])


@cache
def exact() -> np.ndarray:
    """Return u and v at the end of the wave, more accurately than any row."""
    with enable_x64(True):
        return end(simulate_diffrax(scene(PERIODS), solver=diffrax.Dopri8(), rtol=1e-13, dt=0.01, saves=1))


def _measured(work: Callable[[Motion], History]) -> dict:
    """Measure `work` (motion → history), compiled as one program with the initial state as its argument."""
    moving = scene(PERIODS)

    def run(start, velocity):
        history = work(motion(moving.scene, start=start, velocity=velocity, duration=moving.duration))
        return history.u[-1], history.v[-1]

    found, row = kernel(run, moving.start, moving.velocity, repeats=9)
    error = np.abs(np.concatenate([np.asarray(x) for x in found]) - exact()).max() / np.abs(exact()).max()
    return row | {"error": float(error)}


def _step(moving: Motion, steps: int) -> float:
    assert moving.duration is not None
    return moving.duration / steps


def verlet(steps: int) -> dict:
    """Measure `simulate` with a number of steps."""
    return _measured(lambda m: simulate(m, dt=_step(m, steps), save_every=steps, show_progress=False))


def fixed(name: str, steps: int) -> dict:
    """Measure a diffrax solver with a number of equal steps."""
    solver = SOLVERS[name][0]()
    return _measured(lambda m: simulate_diffrax(m, dt=_step(m, steps), solver=solver, max_steps=4 * steps, saves=1))


def adaptive(rtol: float) -> dict:
    """Measure Tsit5 with a tolerance. The first step is given, because it cannot be found inside jit."""
    moving = scene(PERIODS)
    run = partial(simulate_diffrax, rtol=rtol, dt=0.5 * critical_time_step(moving), saves=1)
    steps = int(run(moving).steps)
    return _measured(lambda m: run(m, max_steps=4 * steps)) | {"steps": steps}


def task(name: str, steps: int, dtype: str = "float64") -> Task:
    """Plan one row with equal steps."""
    work = partial(verlet, steps) if name == VERLET else partial(fixed, name, steps)
    return Task(name, {"scene": SCENE, "n": POINTS, "N": 3, "steps": steps}, work, dtype)


def plan(quick: bool) -> Iterator[Task]:
    """Plan every method with its numbers of steps or tolerances."""
    most = 1 if quick else None
    methods = {VERLET: VERLET_STEPS, **{name: counts for name, (_, counts) in SOLVERS.items()}}
    for name, counts in methods.items():
        for steps in counts[:most]:
            yield task(name, steps)
    for rtol in TOLERANCES[:most]:
        yield Task(ADAPTIVE, {"scene": SCENE, "n": POINTS, "N": 3, "rtol": rtol}, partial(adaptive, rtol))


def draw(rows: list[dict]):
    """Draw a line for each method. The numbers are steps or tolerances."""
    return error_against_time(
        rows,
        "Four periods of a travelling wave on 60 points",
        "largest error of u and v, relative  [–]",
        note=lambda row: f"{row['rtol']:.0e}" if "rtol" in row else str(row["steps"]),
    )


CASE = Case("Integrators: velocity Verlet and diffrax on a travelling wave", plan, draw, {"u0": U0, "stretch": STRETCH})
