"""The methods that evaluate the force density of a body: time over horizon and number of points, and their differences.

The body is a 3D lattice with random displacements of 1e-2 spacings. `error` is the largest difference from the slices
of the same body, relative to the largest force. The error of the slices themselves is rounding: the tests compare every
method with the general path. For the slices, `error` is the difference from the padded families, where these are small
enough to be stored.

The operator is prepared before the timing, and `prepare_seconds` is the time of the preparation. `plain_seconds` is
the time of the plain call `force_density(model, families, u)`, and `closure_seconds` that of the same call inside a
user's `jax.jit`. FFT also has `transform_seconds`, the time of its transforms alone, which is its lower bound.
"""

import resource
import time
from collections.abc import Iterator
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from ..force.backends import compiled
from ..force.backends.fft import Convolution
from ..force.operator import BACKENDS, ForceOperator, force_density, force_operator, ways_of
from ..geometry import neighbour_search
from ..geometry.bonds import Families
from ..geometry.points import lattice
from ..models import LPS, BondBased, Correspondence, SethHill
from ..models.laws import LinearElastic
from .harness import Case, Task, hosted, kernel

LAW = LinearElastic(lam=1.0, mu=1.0)  # type: ignore[call-arg, arg-type]
MODELS = {
    "bond-based": BondBased(1.0),  # type: ignore[arg-type]
    "LPS": LPS(1.0, 1.0),  # type: ignore[arg-type]
    "Silling": Correspondence(LAW),
    "Seth–Hill 1": SethHill(1.0, LAW),  # type: ignore[arg-type]
    "Seth–Hill ½": SethHill(0.5, LAW),  # type: ignore[arg-type]
}
BONDS = 5e7  # most bonds for padded arrays, which take 48 bytes a bond, and as many again for the reverse bonds


def _body(n: int, horizon: float) -> tuple[Families, jax.Array]:
    body = lattice((n, n, n))
    bonds = n**3 * 4.2 * horizon**3
    families = neighbour_search.families(body, horizon, arrays=bonds < BONDS)
    return families, jnp.asarray(1e-2 * np.random.default_rng(1).normal(size=(n**3, 3)))


def _call(operator: ForceOperator, u: jax.Array) -> jax.Array:
    return operator(u)


def _there_and_back(back: int, plan: Convolution, x: jax.Array) -> jax.Array:
    """Transform fields (fields, points) to Fourier space, and `back` of them back."""
    spectra = plan.forward(x.reshape(len(x), *plan.cells))
    return plan.inverse(jnp.concatenate([spectra] * -(-back // len(x)))[:back])


def evaluate(model: str, way: str, n: int, horizon: float) -> dict:
    """Measure one model by one method on one body."""
    families, u = _body(n, horizon)
    start = time.perf_counter()
    operator = force_operator(MODELS[model], families, way)
    jax.block_until_ready(jax.tree.leaves(operator.backend))
    prepared = time.perf_counter() - start
    f, row = kernel(_call, operator, u)
    closure = jax.jit(lambda u: force_density(MODELS[model], families, u, way=way))
    plain, closed = hosted(lambda: force_density(MODELS[model], families, u, way=way))[1], hosted(lambda: closure(u))[1]
    row |= {"plain_seconds": plain["seconds"], "closure_seconds": closed["seconds"]}
    other = "slices" if way != "slices" else "families"
    error = None
    if other in ways_of(MODELS[model], families):
        known = force_operator(MODELS[model], families, other)(u)
        error = float(jnp.max(jnp.abs(f - known)) / jnp.max(jnp.abs(known)))
    if isinstance(operator.backend, Convolution):
        forth, back = operator.backend.plan.transforms
        x = jnp.zeros((forth, n**3)).at[:, 0].set(1.0)
        _, floor = kernel(partial(_there_and_back, back), operator.backend, x)
        row["transform_seconds"] = floor["seconds"]
    bonds = float(families.count.sum())
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    more = {"prepare_seconds": prepared, "nanoseconds_a_bond": 1e9 * row["seconds"] / bonds, "peak_GiB_so_far": peak}
    return row | more | {"error": error, "points": n**3, "bonds": bonds}


def plan(quick: bool) -> Iterator[Task]:
    """Plan horizons 2 to 8 at one size, then sizes up to 10⁶ points at one horizon."""
    n, horizons = (12, (2.015, 3.015)) if quick else (32, (2.015, 3.015, 4.015, 5.015, 6.015, 8.015))
    sizes = (22,) if quick else (22, 46, 100)
    wanted = [(n, h) for h in horizons] + [(size, 3.015) for size in sizes]
    for model in MODELS:
        for size, horizon in wanted:
            for way in BACKENDS:
                if (way == "fft" and not MODELS[model].degree) or (way == "compiled" and compiled.unavailable()):
                    continue
                if way == "families" and size**3 * 4.2 * horizon**3 >= BONDS:
                    continue
                settings = {"model": model, "n": size, "horizon": horizon}
                yield Task(way, settings, partial(evaluate, model, way, size, horizon))


def draw(rows: list[dict]):
    """Draw the time of an evaluation over the horizon (left), and the time per point over the points (right)."""
    from matplotlib.figure import Figure

    from .chart import SHADES

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    sizes = sorted({row["n"] for row in rows})
    common = max(sizes, key=lambda n: len({row["horizon"] for row in rows if row["n"] == n}))
    styles = {"families": ":", "slices": "-", "fft": "--", "compiled": "-."}
    for k, model in enumerate(MODELS):
        for way, style in styles.items():
            mine = [row for row in rows if row["model"] == model and row["method"] == way]
            over = sorted((r["horizon"], 1e3 * r["seconds"]) for r in mine if r["n"] == common)
            if over:
                left.plot(*zip(*over, strict=True), style, marker="o", ms=3, color=SHADES[k], label=f"{model}, {way}")
            grown = sorted((r["points"], 1e9 * r["seconds"] / r["points"]) for r in mine if r["horizon"] == 3.015)
            if grown:
                right.plot(*zip(*grown, strict=True), style, marker="o", ms=3, color=SHADES[k])
    left.set(yscale="log", xlabel="horizon  [spacings]", ylabel="one force evaluation  [ms]")
    left.set_title(f"{common}³ points", fontsize=10)
    right.set(xscale="log", yscale="log", xlabel="points", ylabel="time per point  [ns]")
    right.set_title("horizon 3.015 spacings", fontsize=10)
    figure.legend(*left.get_legend_handles_labels(), loc="outside right center", frameon=False, fontsize=8)
    figure.suptitle("Methods to evaluate the force of a body", fontsize=11)
    return figure


CASE = Case("Force evaluation: families, slices, FFT, compiled loops, over the horizon and to 10⁶ points", plan, draw)
