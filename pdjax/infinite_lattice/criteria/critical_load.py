"""Critical loads: the edge of the unstable set along a path, on one side; and the orders m at which a side turns.

**Critical load.** The margin is sampled from |a| = 1e-6 to the limit (geometric near 0, then 2 % steps), the first
unstable sample is bracketed against the one before it, and the bracket is split again and again. The edge itself is the
root of the secant through the ends of the last bracket. Where derivatives are asked for it is one Newton step with the
exact derivative ∂margin/∂a, written so that its derivative in everything else is the implicit function theorem,
da/dθ = −(∂margin/∂θ)/(∂margin/∂a). 0: unstable at once; inf: not within the limit (or no
state there).

**Threshold order.** At rest every half-reciprocal wave costs a Seth–Hill lattice nothing, so under a small load the
sign of dλ/da at those points decides whether a side is unstable at once, for whatever law: `load_slope`. Its zero in
m is `stable_orders`, the m at which the side turns.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import as_array, choice, computed_in_double, frozen, is_concrete
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ...models.laws import Law
from ...models.seth_hill import SethHill
from ..bloch import homogeneous_tangent, modulus_at_rest, wave_phases
from ..brillouin import Zone, brillouin_zone, half_reciprocal_points
from ..paths import Path, hydrostatic, path_symmetry
from . import CRITERIA, check_at_rest, evaluate, family_zone, margin_tolerance
from .on_host import outcomes

SIDES = ("negative", "positive")
SMALLEST = 1e-6  # a side that is unstable at this load is called unstable at 0
BATCH = 16
NEAR, FAR = 16, 48  # samples up to 2 %, and from there to the limit
SPLITS = 5  # a 2 % bracket ends at 2e-8, which one Newton step takes to rounding
CLOSE = 2e-8  # a bracket of that relative width is left to the secant,
SPAN = 1e-6  # over about that relative width: its slope is good to 1e-6 by curvature, and to 1e-9 by rounding
LIMITS = {"negative": 0.9, "positive": 1.0}


def _samples(limit: float) -> np.ndarray:
    """Loads to look at first, (batches, BATCH + 1): each batch starts with the last load before it, the first at 0."""
    start = min(0.02, limit / 2)
    far = np.linspace(start, limit, FAR + 1)[1:]
    sizes = np.concatenate([np.geomspace(SMALLEST, start, NEAR), far]).reshape(-1, BATCH)
    return np.concatenate([np.concatenate([[0.0], sizes[:-1, -1]])[:, None], sizes], axis=1)


def _traced_edge(model, family, path: Path, criterion: str, sign: Array, samples: Array, zone: Zone) -> tuple:
    """(edge found, width of its bracket, where the criterion's search ended, state of the side) inside a program.

    One loop, one trace of the criterion: batches of loads, first the samples until one is unstable, then the bracket
    around its edge split into BATCH parts, `SPLITS` times.
    """
    real = family.xi.dtype

    def look(size):
        out = evaluate(criterion, model, family, path(sign * size, model, family), zone)
        return out.margin > margin_tolerance(real, out.scale), out.at  # NaN (no state there) is not unstable

    def batch(state):
        number, splits, sizes, _, _ = state
        unstable, at = jax.vmap(look)(sizes[1:])
        hit = unstable.any()
        i = jnp.argmax(unstable)
        low, high = sizes[i], sizes[i + 1]
        split = low + (high - low) * jnp.arange(BATCH + 1, dtype=real) / BATCH
        split = split.at[-1].set(high)  # verbatim: it is known to be unstable
        following = jnp.where(hit, split, samples[jnp.minimum(number + 1, len(samples) - 1)])
        at = jax.tree.map(lambda x: x[i], at)
        return number + 1, splits + hit, following, (low, high, hit & (high > SMALLEST)), at

    def go_on(state):
        number, splits, _, (_, high, _), _ = state
        searching = (splits == 0) & (number < len(samples))
        return searching | ((splits > 0) & (splits <= SPLITS) & (high > 0.5 * SMALLEST))

    _, shapes = jax.eval_shape(look, samples[0, 0])
    blank = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)
    nothing = (jnp.zeros((), real), jnp.ones((), real), jnp.zeros((), bool))
    start = (jnp.zeros((), int), jnp.zeros((), int), samples[0], nothing, blank)
    _, splits, _, (low, high, _), at = jax.lax.while_loop(go_on, batch, start)
    return low, high, splits > 0, at


def _polished(model, family, path: Path, criterion: str, sign, zone: Zone, found: tuple) -> Array:
    """One Newton step from the unstable end of the bracket, written so that its derivative in everything else is the
    implicit function theorem; 0 and ±inf where the side has no edge between."""
    low, high, exists, at = found
    real = family.xi.dtype
    root = sign * high

    def margin(a):
        return evaluate(criterion, model, family, path(a, model, family), zone, at).margin

    value, slope = jax.jvp(margin, (root,), (jnp.ones_like(root),))
    step = value / jax.lax.stop_gradient(slope)
    blur = 4 * margin_tolerance(real) / jnp.abs(jax.lax.stop_gradient(slope))
    near = jnp.abs(jax.lax.stop_gradient(step)) <= 100 * (high - low) + 1e-6 * high + blur
    edge = root - jnp.where(near, step, step - jax.lax.stop_gradient(step))
    at_once = (high <= SMALLEST) | (jnp.abs(jax.lax.stop_gradient(edge)) <= jnp.minimum(blur, 1e-3))
    return jnp.where(exists, jnp.where(at_once, jnp.zeros((), real), edge), sign * jnp.inf)


def _one_by_one(function: Any) -> Any:
    """`function` of a tree of arrays, which `vmap` maps one after the other: a batch costs what a loop costs."""
    single = jax.custom_batching.custom_vmap(function)

    @single.def_vmap
    def rule(size, batched, arrays):
        (batched,) = batched if isinstance(batched, list | tuple) and len(batched) == 1 else (batched,)

        def one(i):
            return single(jax.tree.map(lambda x, b: x[i] if b else x, arrays, batched))

        out = jax.lax.map(one, jnp.arange(size))
        return out, jax.tree.map(lambda _: True, out)

    return single


@eqx.filter_jit
def _traced(model, family, path, criterion: str, sign: Any, samples: Any, intervals: int, symmetry: str) -> Array:
    zone = brillouin_zone(family.dim, intervals, symmetry)
    arrays, rest = eqx.partition((model, family, path, sign, samples), eqx.is_array)

    def edge(arrays):
        model, family, path, sign, samples = eqx.combine(arrays, rest)
        return _traced_edge(model, family, path, criterion, sign, samples, zone)

    found = _one_by_one(edge)(jax.lax.stop_gradient(arrays))
    return _polished(model, family, path, criterion, sign, zone, found)


@eqx.filter_jit
def _with_derivative(model, family, path, criterion: str, sign, intervals: int, symmetry: str, found: tuple) -> Array:
    return _polished(model, family, path, criterion, sign, brillouin_zone(family.dim, intervals, symmetry), found)


@eqx.filter_jit
def deformations(path: Path, a: Float[Array, " loads"], model, family) -> Float[Array, "loads dim dim"]:
    """F along a path."""
    return jax.vmap(lambda x: path(x, model, family))(a)


def _split(low: float, high: float, f_low: float, f_high: float) -> np.ndarray:
    """Loads in (low, high], the last one `high` itself: close around the root of the secant, and spread between."""
    width = high - low
    even = low + width * np.arange(1, BATCH + 1) / BATCH
    if not f_low < 0 < f_high:
        return np.append(even[:-1], high)
    root = low - f_low * width / (f_high - f_low)
    close = width * 10.0 ** -np.arange(1, 7)
    points = np.concatenate([even[3:-1:4], root - close, root + close])
    return np.append(np.sort(np.clip(points, np.nextafter(low, high), high))[: BATCH - 1], high)


def _host_edge(setting: tuple, criterion: str, sign: float, samples: np.ndarray, zone: Zone) -> tuple:
    """`_traced_edge` on concrete values (`setting`: model, family, path), and the loads and margins of every state that
    was looked at."""
    model, family, path = setting
    real, samples = np.dtype(family.xi.dtype), np.asarray(samples, float)
    seen: list[np.ndarray] = []

    def look(sizes):
        F = computed_in_double(deformations, path, sign * sizes, model, family)
        out = outcomes(criterion, model, family, F, zone)
        seen.append(np.stack([sizes, out.margin]))
        return out.margin, np.asarray(out.margin > margin_tolerance(real, out.scale)), out.at

    for sizes in samples:
        margin, unstable, at = look(sizes[1:])
        if unstable.any():
            break
    else:
        return (0.0, np.inf, False, jax.tree.map(lambda x: x[0], at)), seen
    before = np.nan
    for _ in range(2 * SPLITS):
        i = int(np.argmax(unstable))
        low, high, before = sizes[i], sizes[i + 1], margin[i - 1] if i else before
        at_high = jax.tree.map(lambda x, i=i: x[i], at)
        if high <= SMALLEST or high - low <= CLOSE * high:
            break
        sizes = np.concatenate([[low], _split(low, high, before, margin[i])])
        margin, unstable, at = look(sizes[1:])
    return (low, high, True, at_high), seen


def _secant(low: float, high: float, seen: list[np.ndarray], real: Any) -> float:
    """|a| where the margin is zero, by the secant from `high` to a load seen about SPAN away; 0 where that can't be
    told from rest."""
    sizes, margins = np.concatenate(seen, axis=1)
    sizes, margins = sizes[np.isfinite(margins)], margins[np.isfinite(margins)]
    distance = np.abs(sizes - high)
    end, other = (int(np.argmin(x)) for x in (distance, np.abs(np.log(np.maximum(distance, 1e-300) / (SPAN * high)))))
    slope = (margins[end] - margins[other]) / (high - sizes[other]) if other != end else 0.0
    if not slope:
        return 0.0 if high <= SMALLEST else high
    step, blur = margins[end] / slope, 4 * float(margin_tolerance(real)) / abs(slope)
    edge = high - step if abs(step) <= 100 * (high - low) + 1e-6 * high + blur else high
    return 0.0 if high <= SMALLEST or abs(edge) <= min(blur, 1e-3) else float(edge)


@public_function
def critical_load(
    model: AbstractModel,
    family: LatticeFamily,
    path: Path | Any = hydrostatic,
    criterion: str = "symbol",
    side: str = "negative",
    limit: float | None = None,
    resolution: int | None = None,
) -> Float[Array, ""]:
    """Where the lattice first becomes unstable along a load path, starting from rest.

    Arguments: path (a, model, family) → F; criterion one of `CRITERIA`; side of a; limit: how far |a| is followed
        [-] (default 0.9 negative, 1.0 positive); resolution as in `stability`.
    Returns: a_cr [-], with exact first derivatives in model and family. 0 where the side is unstable at |a| = 1e-6 already
        (or nearer to 0 than its tolerance can tell), ±inf where it is not within the limit. Unstable windows
        narrower than limit/48, the sampling step, can be missed. A marginal state is not an unstable one: `stability`
        and `zero_energy_waves` tell of waves that cost nothing.
    Raises: ValueError for an unknown criterion or side, a limit not in (1e-6, 1) on the negative side.
    """
    choice("criterion", criterion, list(CRITERIA))
    if side in ("compression", "tension"):
        raise ValueError(f"side is the sign of a: 'negative' under compression, 'positive' under tension; got {side!r}")
    choice("side", side, SIDES)
    if not callable(path):
        raise ValueError(f"path must be a function (a, model, family) -> F, such as pd.hydrostatic; got {path!r}")
    limit = LIMITS[side] if limit is None else limit
    if not (2 * SMALLEST < limit < (1.0 if side == "negative" else np.inf)):
        raise ValueError(f"limit must lie between 2e-6 and 1 (negative side) or be finite (positive); got {limit}")
    check_model(model, family, LatticeFamily)
    real = np.dtype(family.xi.dtype)
    sign, samples = np.asarray(-1.0 if side == "negative" else 1.0, real), _samples(float(limit)).astype(real)
    zone = family_zone(family, path_symmetry(path, family, model.isotropic), resolution)
    quiet = frozen((model, family, path))
    if not is_concrete(quiet):
        check_at_rest(model, family)
        return _traced(model, family, path, criterion, sign, samples, zone.intervals, zone.symmetry)
    (low, high, exists, at), seen = _host_edge(quiet, criterion, float(sign), samples, zone)
    if is_concrete(model, family, path):
        return as_array(sign * (_secant(low, high, seen, real) if exists else np.inf), real)
    bracket = np.asarray(low, real), np.asarray(high, real), np.asarray(exists), at
    return _with_derivative(model, family, path, criterion, sign, zone.intervals, zone.symmetry, bracket)


@public_function
def load_slope(
    model: AbstractModel, family: LatticeFamily, path: Path = hydrostatic, side: str = "positive"
) -> Float[Array, ""]:
    """How fast a load destabilises the half-reciprocal waves that cost nothing at rest.

    Returns: max over those points of dλ_max/d|a| at a = 0, over M κ² [-]; positive: the side is unstable at once;
        −inf if no such wave is free of energy at rest.
    """
    choice("side", side, SIDES)
    check_model(model, family, LatticeFamily)
    sign = -1.0 if side == "negative" else 1.0
    M = modulus_at_rest(model, family)
    k = jnp.asarray(half_reciprocal_points(family.dim), dtype=family.xi.dtype) / family.spacing
    phases = wave_phases(family, k)

    def blocks(size):
        J = homogeneous_tangent(model, family, path(sign * size, model, family))(phases)
        return (J + J.mT) / 2 / (M * phases.kappa2)[:, None, None]

    rest, rate = jax.jvp(blocks, (jnp.zeros((), family.xi.dtype),), (jnp.ones((), family.xi.dtype),))
    values, vectors = jnp.linalg.eigh(jax.lax.stop_gradient(rest))
    free = jnp.abs(values) < margin_tolerance(rest.dtype)
    inner = vectors.mT @ rate @ vectors
    inner = jnp.where(free[:, :, None] & free[:, None, :], inner, 0.0)
    inner = inner - 1e9 * jnp.eye(family.dim) * jnp.where(free, 0.0, 1.0)[:, :, None]
    value, mode = jnp.linalg.eigh(jax.lax.stop_gradient(inner))
    worst = jnp.argmax(value[:, -1])
    v = mode[worst, :, -1]
    return jnp.where(free.any(), v @ inner[worst] @ v, -jnp.inf)


@eqx.filter_jit
def _slopes(orders, family, law, path, side: str) -> Array:
    return jax.lax.map(lambda m: load_slope(SethHill(m, law), family, path, side), orders)


@public_function
def stable_orders(
    family: LatticeFamily,
    law: Law,
    path: Path = hydrostatic,
    side: str = "positive",
    bound: float = 20.0,
) -> tuple[float, float]:
    """The interval (low, high) of orders m [-] for which a side of a path is not unstable at once, for Seth–Hill.

    At rest Z is linear in the load whatever m, and each bond's block is linear in m: `load_slope` is convex in m,
    so the orders where it is negative form one interval; ±inf where it has no end within ±bound, NaN if it is empty.
    Under hydrostatic load the ends do not depend on an isotropic law with μ > 0. (With μ = 0 every wave is free at
    rest, and the half-reciprocal points do not tell.) Raises: ValueError as `load_slope`.
    """
    choice("side", side, SIDES)
    if not (np.isfinite(bound) and bound > 0):
        raise ValueError(f"bound must be finite and > 0; got {bound}")
    batch = 33

    def slopes(orders):
        return np.asarray(_slopes(jnp.asarray(orders, dtype=family.xi.dtype), family, law, path, side))

    def edge(low, high):
        """The zero between orders of opposite slope, by splitting the bracket down to rounding."""
        while True:
            orders = np.linspace(low, high, batch)
            inside = slopes(orders) < 0
            i = int(np.argmax(inside != inside[0])) - 1
            if not orders[i] < orders[i + 1] or (orders[i], orders[i + 1]) == (low, high):
                return float((low + high) / 2)
            low, high = orders[i], orders[i + 1]
            if high - low <= 4 * np.finfo(np.dtype(family.xi.dtype)).eps * max(1.0, abs(low)):
                return float((low + high) / 2)

    orders = np.linspace(-bound, bound, batch)
    for _ in range(8):  # close in on the lowest point of a convex function, unless it is negative already
        found = slopes(orders)
        i = int(np.argmin(found))
        if found[i] < 0:
            break
        orders = np.linspace(orders[max(i - 1, 0)], orders[min(i + 1, batch - 1)], batch)
    else:
        return np.nan, np.nan
    inner, ends = orders[i], slopes(np.linspace(-bound, bound, batch))
    low = -np.inf if ends[0] < 0 else edge(-bound, inner)
    high = np.inf if ends[-1] < 0 else edge(inner, bound)
    return low, high
