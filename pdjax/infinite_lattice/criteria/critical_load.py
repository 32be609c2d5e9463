"""Critical loads along a path, and the orders m of Seth–Hill models that are stable under small loads.

A load a has two **sides**, negative and positive. On most paths the negative side is compression and the positive side
is tension.

**Critical load.** The critical load of a side is the first load at which the lattice becomes unstable. The margin is
sampled from |a| = 1e-6 to the limit, in geometric steps near 0 and then in steps of 2 %. The first unstable sample and
the sample before it form a bracket, which is split repeatedly. The secant through the ends of the last bracket gives
the critical load. If derivatives are needed, the last step is one Newton step with the exact ∂margin/∂a instead. It is
written so that its derivative in any parameter θ is that of the implicit function theorem,
da/dθ = −(∂margin/∂θ)/(∂margin/∂a). The result is 0 if the side is unstable at the smallest load, and infinite if no
instability is found up to the limit, or if no state exists there.

**Threshold order.** A Seth–Hill lattice at rest has zero-energy modes at all half-reciprocal points (wave vectors with
components 0 or π/h). Under a small load the sign of dλ/da at these points therefore decides whether a side is unstable
at once, for every law (`load_slope`). Its zeros in m bound the orders that are stable under small loads
(`stable_orders`).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree

from ..._internal.checks import Numbers, as_array, choice, computed_in_double, frozen, is_concrete, sign_of
from ..._internal.implicit_step import implicit_step
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ...models.laws import Law
from ...models.seth_hill import SethHill
from ..bloch import homogeneous_tangent, modulus_at_rest, wave_phases
from ..brillouin import Zone, brillouin_zone, half_reciprocal_points
from ..paths import Path, hydrostatic, named_path, path_symmetry
from . import CRITERIA, check_at_rest, evaluate, family_zone, margin_tolerance
from .on_host import outcomes

SMALLEST = 1e-6  # A side that is unstable at this load has the critical load 0.
BATCH = 16
NEAR, FAR = 16, 48  # numbers of samples up to 2 %, and from 2 % to the limit
SPLITS = 5  # They narrow a bracket of 2 % to 2e-8. One Newton step then reaches rounding.
CLOSE = 2e-8  # The secant replaces the splits once the bracket has this relative width.
SPAN = 1e-6  # Relative width of the secant. Its slope is accurate to 1e-6 (curvature) and 1e-9 (rounding).
LIMITS = {-1.0: 0.9, 1.0: 1.0}  # by the sign of the side


def _samples(limit: float) -> np.ndarray:
    """The samples of |a|, (batches, BATCH + 1). Each batch starts with the last load of the previous one, or with 0."""
    start = min(0.02, limit / 2)
    far = np.linspace(start, limit, FAR + 1)[1:]
    sizes = np.concatenate([np.geomspace(SMALLEST, start, NEAR), far]).reshape(-1, BATCH)
    return np.concatenate([np.concatenate([[0.0], sizes[:-1, -1]])[:, None], sizes], axis=1)


def _traced_edge(model, family, path: Path, criterion: str, sign: Array, samples: Array, zone: Zone) -> tuple:
    """The bracket of the critical load inside a traced program: (low, high, whether it exists, `Outcome.at` at high).

    A single loop, with one trace of the criterion, evaluates batches of loads. The first batches are the samples, until
    one of them is unstable. The following batches split the bracket into BATCH parts, `SPLITS` times.
    """
    real = family.xi.dtype

    def look(size):
        out = evaluate(criterion, model, family, path(sign * size, model, family), zone)
        # A NaN margin means that no state exists, which does not count as unstable.
        return out.margin > margin_tolerance(real, out.scale), out.at

    def batch(state):
        number, splits, sizes, _, _ = state
        unstable, at = jax.vmap(look)(sizes[1:])
        hit = unstable.any()
        i = jnp.argmax(unstable)
        low, high = sizes[i], sizes[i + 1]
        split = low + (high - low) * jnp.arange(BATCH + 1, dtype=real) / BATCH
        split = split.at[-1].set(high)  # Exactly `high`, which is known to be unstable.
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
    """One Newton step from the unstable end of the bracket, with the derivatives of the implicit function theorem.

    The result is 0 if the side is unstable at once, and ±inf if it has no critical load.
    """
    low, high, exists, at = found
    real = family.xi.dtype
    low, high = (jnp.where(exists, x, 0.5) for x in (low, high))  # Infinity would make derivatives NaN.
    root = sign * high

    def margin(a):
        return evaluate(criterion, model, family, path(a, model, family), zone, at).margin

    step, slope = implicit_step(margin, root)
    blur = 4 * margin_tolerance(real) / jnp.abs(slope)
    near = jnp.abs(jax.lax.stop_gradient(step)) <= 100 * (high - low) + 1e-6 * high + blur
    edge = root - jnp.where(near, step, step - jax.lax.stop_gradient(step))
    at_once = (high <= SMALLEST) | (jnp.abs(jax.lax.stop_gradient(edge)) <= jnp.minimum(blur, 1e-3))
    return jnp.where(exists, jnp.where(at_once, jnp.zeros((), real), edge), sign * jnp.inf)


def _one_by_one(function: Callable[[PyTree], PyTree]) -> Callable[[PyTree], PyTree]:
    """A function of a tree of arrays that `vmap` evaluates in a loop, so that a batch costs as much as a loop.

    A batched `while_loop` would run until its slowest element has finished.
    """
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
def _traced(
    model, family, path, criterion: str, sign: Numbers, samples: Numbers, intervals: int, symmetry: str
) -> Array:
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
    """The deformation gradients F at the loads `a` of a path."""
    return jax.vmap(lambda x: path(x, model, family))(a)


def _split(low: float, high: float, f_low: float, f_high: float) -> np.ndarray:
    """Loads in (low, high], the last one `high`. Most are close to the root of the secant, others are spread evenly."""
    width = high - low
    even = low + width * np.arange(1, BATCH + 1) / BATCH
    if not f_low < 0 < f_high:
        return np.append(even[:-1], high)
    root = low - f_low * width / (f_high - f_low)
    close = width * 10.0 ** -np.arange(1, 7)
    points = np.concatenate([even[3:-1:4], root - close, root + close])
    return np.append(np.sort(np.clip(points, np.nextafter(low, high), high))[: BATCH - 1], high)


def _host_edge(setting: tuple, criterion: str, sign: float, samples: np.ndarray, zone: Zone) -> tuple:
    """`_traced_edge` for concrete values, and the loads and margins of all evaluated states.

    `setting` is (model, family, path).
    """
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


def _secant(low: float, high: float, seen: list[np.ndarray], real: DTypeLike) -> float:
    """|a| at the zero of the margin, by the secant from `high` to an evaluated load at a distance of about SPAN.

    The result is 0 if the zero cannot be distinguished from the undeformed state.
    """
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
    path: Path | str = hydrostatic,
    criterion: str = "symbol",
    side: str = "negative",
    limit: float | None = None,
    resolution: int | None = None,
) -> Float[Array, ""]:
    """Find the first load of a path at which the infinite lattice becomes unstable.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    path : callable or str, optional
        Load path: a function (a, model, family) → F with F = I at a = 0, such as `hydrostatic`, or a name in `PATHS`.
    criterion : str, optional
        Criterion of stability, see `stability`.
    side : str, optional
        Sign of the loads: "negative" or "compression", "positive" or "tension".
    limit : float, optional
        Largest |a| of the search [-]. The default is 0.9 on the negative and 1.0 on the positive side.
    resolution : int, optional
        Grid intervals of the Brillouin zone, see `stability`.

    Returns
    -------
    array, shape ()
        Critical load a_cr [-], with the sign of its side. It is 0 if the lattice is unstable at |a| = 1e-6 already, or
        if the tolerance of the margin does not distinguish it from 0. It is infinite if the lattice is not unstable up
        to the limit.

    Raises
    ------
    ValueError
        If the criterion or the side is unknown, if `path` is no path, if `limit` is not larger than 2e-6 (and
        smaller than 1 on the negative side), or for what `stability` refuses.

    Notes
    -----
    First derivatives in `model`, `family` and `path` are exact. A range of unstable loads that is narrower than
    limit/48, the step of the samples, can be missed. Marginal states do not count as unstable. `stability` and
    `zero_energy_waves` report zero-energy modes.

    Examples
    --------
    In 1D, with m = 1 and N = 3, the diagonal gives the critical strain −0.074 of the paper. The exact symbol is
    unstable in compression at any load.

    >>> family = pd.lattice_family(1, 3)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> round(float(pd.critical_load(model, family, criterion="diagonal", side="negative")), 3)
    -0.074
    >>> abs(float(pd.critical_load(model, family, side="negative")))
    0.0
    """
    choice("criterion", criterion, list(CRITERIA))
    sign = sign_of(side)
    path = named_path(path)
    limit = LIMITS[sign] if limit is None else limit
    if not (2 * SMALLEST < limit < (1.0 if sign < 0 else np.inf)):
        raise ValueError(
            f"limit must lie between 2e-6 and 1 (negative side), or be finite and > 2e-6 (positive); got {limit}"
        )
    check_model(model, family, LatticeFamily)
    real = np.dtype(family.xi.dtype)
    samples = _samples(float(limit)).astype(real)
    zone = family_zone(family, path_symmetry(path, family, model.isotropic), resolution)
    quiet = frozen((model, family, path))
    if not is_concrete(quiet):
        check_at_rest(model, family)
        return _traced(model, family, path, criterion, np.asarray(sign, real), samples, zone.intervals, zone.symmetry)
    (low, high, exists, at), seen = _host_edge(quiet, criterion, sign, samples, zone)
    if is_concrete(model, family, path):
        return as_array(sign * (_secant(low, high, seen, real) if exists else np.inf) + 0.0, real)  # no −0
    bracket = np.asarray(low, real), np.asarray(high, real), np.asarray(exists), at
    return _with_derivative(
        model, family, path, criterion, np.asarray(sign, real), zone.intervals, zone.symmetry, bracket
    )


@public_function
def load_slope(
    model: AbstractModel, family: LatticeFamily, path: Path | str = hydrostatic, side: str = "positive"
) -> Float[Array, ""]:
    """Compute how fast a small load destabilises the zero-energy modes of the lattice at rest.

    max over the half-reciprocal k of dλ_max(k)/d|a| / (M κ²) at a = 0

    Only half-reciprocal points k ≠ 0 (components 0 or π/h) are considered, and there only modes with λ = 0 at rest.
    M is the P-wave modulus and κ² = Σ_i ((2/h) sin(k_i h/2))².

    Parameters
    ----------
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    path : callable or str, optional
        Load path: a function (a, model, family) → F, such as `hydrostatic`, or a name in `PATHS`.
    side : str, optional
        Sign of the loads: "negative" or "compression", "positive" or "tension".

    Returns
    -------
    array, shape ()
        Slope of the margin [-]. If it is positive, the side is unstable at any load. It is −inf if no half-reciprocal
        point has a zero-energy mode at rest.

    Raises
    ------
    ValueError
        If the side is unknown, or if the family is too small for the model.

    Examples
    --------
    In compression the Seth–Hill model of order 1 is unstable at once, and the one of order 0 is not.

    >>> family, law = pd.lattice_family(1, 2), pd.LinearElastic(1.0, 1.0)
    >>> slope = jax.jit(lambda m: pd.load_slope(pd.SethHill(m, law), family, side="negative"))
    >>> round(float(slope(1.0)), 6), round(float(slope(0.0)), 6)
    (0.5, -0.5)
    """
    sign, path = sign_of(side), named_path(path)
    check_model(model, family, LatticeFamily)
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
    path: Path | str = hydrostatic,
    side: str = "positive",
    bound: float = 20.0,
) -> tuple[float, float]:
    """Find the orders m of the Seth–Hill model that are not unstable at once on one side of a path.

    Parameters
    ----------
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    law : Law
        Law of the Seth–Hill model.
    path : callable or str, optional
        Load path: a function (a, model, family) → F, such as `hydrostatic`, or a name in `PATHS`.
    side : str, optional
        Sign of the loads: "negative" or "compression", "positive" or "tension".
    bound : float, optional
        Orders are searched between −bound and bound [-].

    Returns
    -------
    tuple of float
        The ends (low, high) of the interval of orders m [-]. An end is infinite if it lies beyond ±bound. Both are NaN
        if no order is stable.

    Raises
    ------
    ValueError
        If the side is unknown, if `bound` is not finite and > 0, or if the family is too small for the model.

    Notes
    -----
    The orders are those with a negative `load_slope`. To first order in the load, the strain does not depend on m, and
    the block of each bond is linear in m. Therefore `load_slope` is convex in m, and the orders form one interval.
    Under hydrostatic load the ends are the same for all isotropic laws with μ > 0. With μ = 0 every wave is a
    zero-energy mode at rest, so that the half-reciprocal points do not decide.

    Examples
    --------
    In 1D with N = 2, orders above ½ are stable under small tension.

    >>> low, high = pd.stable_orders(pd.lattice_family(1, 2), pd.LinearElastic(1.0, 1.0), side="positive")
    >>> round(low, 6), high
    (0.5, inf)
    """
    sign_of(side)
    path = named_path(path)
    if not (np.isfinite(bound) and bound > 0):
        raise ValueError(f"bound must be finite and > 0; got {bound}")
    batch = 33

    def slopes(orders):
        return np.asarray(_slopes(jnp.asarray(orders, dtype=family.xi.dtype), family, law, path, side))

    def edge(low, high):
        """The zero between two orders of opposite slope, by splitting the bracket down to rounding."""
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
    for _ in range(8):  # Approach the minimum of the convex function until a negative value is found.
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
