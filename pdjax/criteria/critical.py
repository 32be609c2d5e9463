"""Critical loads: the edge of the unstable set along a path, on one side; and the orders m at which a side turns.

**Critical load.** The margin is sampled from |a| = 1e-6 to the limit (geometric near 0, then 2 % steps), the first
unstable sample is bracketed against the one before it, the bracket split again and again, and polished by one Newton
step with the exact derivative ∂margin/∂a. That last step is written so that its derivative in everything else is the
implicit function theorem, da/dθ = −(∂margin/∂θ)/(∂margin/∂a). 0: unstable at once; inf: not within the limit (or no
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

from .._checks import choice
from ..bloch import homogeneous_tangent, p_wave_modulus, wave_phases
from ..force import check_model
from ..laws import Law
from ..models.base import AbstractModel
from ..models.seth_hill import SethHill
from ..neighbours import Family
from ..paths import Path, hydrostatic, path_symmetry
from ..zone import Zone, half_reciprocal_points
from . import CRITERIA, check_at_rest, evaluate, family_zone, margin_tolerance

SIDES = ("negative", "positive")
SMALLEST = 1e-6  # a side that is unstable at this load is called unstable at 0
BATCH = 16
NEAR, FAR = 16, 48  # samples up to 2 %, and from there to the limit
SPLITS = 5  # a 2 % bracket ends at 2e-8, which one Newton step takes to rounding
LIMITS = {"negative": 0.9, "positive": 1.0}


def _samples(limit: float) -> np.ndarray:
    """Loads to look at first, (batches, BATCH + 1): each batch starts with the last load before it, the first at 0."""
    start = min(0.02, limit / 2)
    far = np.linspace(start, limit, FAR + 1)[1:]
    sizes = np.concatenate([np.geomspace(SMALLEST, start, NEAR), far]).reshape(-1, BATCH)
    return np.concatenate([np.concatenate([[0.0], sizes[:-1, -1]])[:, None], sizes], axis=1)


def _critical(model, fam, path: Path, criterion: str, sign: Array, samples: Array, zone: Zone) -> Array:
    """One loop, one trace of the criterion: batches of loads, first the samples until one is unstable, then the bracket
    around its edge split into BATCH parts, `SPLITS` times. The maximiser found last serves the polish."""
    real = fam.xi.dtype
    still_model, still_fam = jax.lax.stop_gradient((model, fam))

    def look(size):
        out = evaluate(criterion, still_model, still_fam, path(sign * size, still_model, still_fam), zone)
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
    _, splits, _, (low, high, _), at = jax.lax.stop_gradient(jax.lax.while_loop(go_on, batch, start))
    root = sign * high

    def margin(a):
        return evaluate(criterion, model, fam, path(a, model, fam), zone, at).margin

    value, slope = jax.jvp(margin, (root,), (jnp.ones_like(root),))
    step = value / jax.lax.stop_gradient(slope)
    blur = 4 * margin_tolerance(real) / jnp.abs(jax.lax.stop_gradient(slope))
    near = jnp.abs(jax.lax.stop_gradient(step)) <= 100 * (high - low) + 1e-6 * high + blur
    edge = root - jnp.where(near, step, step - jax.lax.stop_gradient(step))
    at_once = (high <= SMALLEST) | (jnp.abs(jax.lax.stop_gradient(edge)) <= jnp.minimum(blur, 1e-3))
    return jnp.where(splits > 0, jnp.where(at_once, jnp.zeros((), real), edge), sign * jnp.inf)


@eqx.filter_jit
def _critical_jit(model, fam, path, criterion: str, sign: Array, samples: Array, resolution: int | None):
    zone = family_zone(fam, path_symmetry(path, fam, model.isotropic), resolution)
    return _critical(model, fam, path, criterion, sign, samples, zone)


def critical_load(
    model: AbstractModel,
    fam: Family,
    path: Path | Any = hydrostatic,
    criterion: str = "symbol",
    side: str = "negative",
    limit: float | None = None,
    resolution: int | None = None,
) -> Float[Array, ""]:
    """Where the lattice first becomes unstable along a load path, starting from rest.

    Arguments: path (a, model, fam) → F; criterion one of `CRITERIA`; side of a; limit: how far |a| is followed
        [-] (default 0.9 negative, 1.0 positive); resolution as in `stability`.
    Returns: a_cr [-], with exact first derivatives in model and fam. 0 where the side is unstable at |a| = 1e-6 already
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
        raise ValueError(f"path must be a function (a, model, fam) -> F, such as pd.hydrostatic; got {path!r}")
    limit = LIMITS[side] if limit is None else limit
    if not (2 * SMALLEST < limit < (1.0 if side == "negative" else np.inf)):
        raise ValueError(f"limit must lie between 2e-6 and 1 (negative side) or be finite (positive); got {limit}")
    check_at_rest(model, fam)
    sign = jnp.asarray(-1.0 if side == "negative" else 1.0, fam.xi.dtype)
    samples = jnp.asarray(_samples(float(limit)), fam.xi.dtype)
    return _critical_jit(model, fam, path, criterion, sign, samples, resolution)


def load_slope(model: AbstractModel, fam: Family, path: Path = hydrostatic, side: str = "positive") -> Float[Array, ""]:
    """How fast a load destabilises the half-reciprocal waves that cost nothing at rest.

    Returns: max over those points of dλ_max/d|a| at a = 0, over M κ² [-]; positive: the side is unstable at once;
        −inf if no such wave is free of energy at rest.
    """
    choice("side", side, SIDES)
    check_model(model, fam, Family)
    sign = -1.0 if side == "negative" else 1.0
    M = p_wave_modulus(model, fam)
    k = jnp.asarray(half_reciprocal_points(fam.dim), dtype=fam.xi.dtype) / fam.spacing
    phases = wave_phases(fam, k)

    def blocks(size):
        J = homogeneous_tangent(model, fam, path(sign * size, model, fam))(phases)
        return (J + J.mT) / 2 / (M * phases.kappa2)[:, None, None]

    rest, rate = jax.jvp(blocks, (jnp.zeros((), fam.xi.dtype),), (jnp.ones((), fam.xi.dtype),))
    values, vectors = jnp.linalg.eigh(jax.lax.stop_gradient(rest))
    free = jnp.abs(values) < margin_tolerance(rest.dtype)
    inner = vectors.mT @ rate @ vectors
    inner = jnp.where(free[:, :, None] & free[:, None, :], inner, 0.0)
    inner = inner - 1e9 * jnp.eye(fam.dim) * jnp.where(free, 0.0, 1.0)[:, :, None]
    value, mode = jnp.linalg.eigh(jax.lax.stop_gradient(inner))
    worst = jnp.argmax(value[:, -1])
    v = mode[worst, :, -1]
    return jnp.where(free.any(), v @ inner[worst] @ v, -jnp.inf)


@eqx.filter_jit
def _slopes(orders, fam, law, path, side: str) -> Array:
    return jax.lax.map(lambda m: load_slope(SethHill(m, law), fam, path, side), orders)


def stable_orders(
    fam: Family,
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
        return np.asarray(_slopes(jnp.asarray(orders, dtype=fam.xi.dtype), fam, law, path, side))

    def edge(low, high):
        """The zero between orders of opposite slope, by splitting the bracket down to rounding."""
        while True:
            orders = np.linspace(low, high, batch)
            inside = slopes(orders) < 0
            i = int(np.argmax(inside != inside[0])) - 1
            if not orders[i] < orders[i + 1] or (orders[i], orders[i + 1]) == (low, high):
                return float((low + high) / 2)
            low, high = orders[i], orders[i + 1]
            if high - low <= 4 * np.finfo(np.dtype(fam.xi.dtype)).eps * max(1.0, abs(low)):
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
