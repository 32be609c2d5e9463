"""Finding the families of a body: by cKDTree, on a lattice by its stencil; packed into padded arrays.

A padded neighbour of a body's family is the point itself with weight 0 and any non-zero reference vector:
its strain is finite, its weight kills it, and every derivative is finite, without a `where`.
"""

import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from ._checks import is_concrete, namespace, on_device
from .influence import constant_influence
from .lattice_arrays import LatticeArrays
from .neighbours import TIE, Families, Grid, cells_within, checked_influence
from .points import Points


def _refuse_short_box(body: Points, radius: float) -> None:
    if body.period is not None and (np.array(body.period) <= 2 * radius).any():
        raise ValueError(
            f"a periodic box must be longer than two horizons ({2 * radius:g}), or a point meets a neighbour"
            f" twice; got box lengths {body.period}"
        )


def _directed_pairs(body: Points, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """All pairs i < j nearer than `radius`; refuses duplicates and boxes smaller than two horizons."""
    from scipy.spatial import cKDTree  # late: it takes a third of a second

    box = None
    X = body.positions
    _refuse_short_box(body, radius)
    if body.period is not None:
        period = np.array(body.period)
        box = np.where(np.isfinite(period), period, 0.0)  # cKDTree: 0 means not periodic
        X = np.where(box > 0, np.mod(X, np.where(box > 0, box, 1.0)), X)
    tree = cKDTree(X, boxsize=box)
    near = tree.query_pairs(1e-9 * radius, output_type="ndarray")
    if len(near):
        i, j = near[0]
        raise ValueError(f"positions must be distinct; points {i} and {j} coincide ({len(near)} such pairs)")
    pairs = tree.query_pairs(radius, output_type="ndarray")
    return pairs[:, 0], pairs[:, 1]


def families(body: Points, horizon: float, influence: Callable = constant_influence, arrays: bool = True) -> Families:
    """Find every family of a body and pad them into arrays: by cKDTree, on a lattice by its stencil.

    Arguments: body of any dim; horizon δ [length]; influence (r, δ) → ω ≥ 0. arrays=False (lattices only) keeps the
        stencil and no arrays over points and bonds: enough for forces and their derivatives; energies need bonds.
    Raises: ValueError for a horizon that is not finite or below the lattice spacing, duplicate points,
        a point without neighbours, a periodic box not longer than two horizons, a bad influence.
    """
    if not isinstance(body, Points):
        raise ValueError(f"body must be Points (lattice, bar, plate, cuboid, cloud); got {type(body).__name__}")
    if not is_concrete(horizon):
        raise ValueError("horizon decides who is whose neighbour, so it can't be traced; pass a plain number")
    horizon = float(horizon)
    least = 0.0 if body.spacing is None else body.spacing / (1 + TIE)
    if not (math.isfinite(horizon) and horizon > 0 and horizon >= least):
        raise ValueError(f"horizon must be finite, > 0 and at least one spacing ({body.spacing}); got {horizon}")
    if body.uniform:
        return _of_lattice(body, horizon, influence, arrays)
    if not arrays:
        raise ValueError(
            "arrays=False is for lattices, whose families have one stencil; this body is a cloud, or has positions or"
            " volumes of its own"
        )
    lower, upper = _directed_pairs(body, horizon * (1 + TIE))
    i, j = np.concatenate([lower, upper]), np.concatenate([upper, lower])
    vectors = body.positions[j] - body.positions[i]
    if body.period is not None:
        period = np.array(body.period)
        vectors -= np.where(np.isfinite(period), period, 0.0) * np.round(vectors / period)
    opposite = np.roll(np.arange(len(i)), len(lower))  # directed bond p runs back along p + pairs
    return pack(body, horizon, influence, (i, j, vectors, opposite))


def _refuse_lonely(count: np.ndarray, horizon: float) -> None:
    if (count == 0).any():
        raise ValueError(
            f"every point needs a neighbour within the horizon {horizon:g}; point {int(np.argmin(count))} has"
            f" none ({int((count == 0).sum())} such points)"
        )


def _of_lattice(body: Points, horizon: float, influence: Callable, arrays: bool) -> Families:
    """The families of a lattice by its stencil."""
    assert body.cells is not None and body.spacing is not None
    periodic = tuple(bool(np.isfinite(p)) for p in body.period) if body.period else (False,) * body.dim
    _refuse_short_box(body, horizon * (1 + TIE))
    offsets = cells_within(body.dim, horizon / body.spacing)
    reach = np.abs(offsets) < np.array(body.cells)
    offsets = offsets[reach.all(axis=1)]  # a bond longer than the body is nobody's
    real = jnp.result_type(float)
    delta = np.asarray(horizon, dtype=real)
    vectors = offsets * body.spacing
    made = LatticeArrays(body, offsets, periodic, arrays)
    _refuse_lonely(made.count, horizon)
    omega = checked_influence(influence, np.linalg.norm(vectors, axis=1).astype(real), delta)
    half = len(offsets) // 2
    order = np.concatenate([np.arange(half, len(offsets)), np.arange(half)[::-1]])
    grid = Grid(
        body.cells,
        periodic,
        tuple(tuple(int(x) for x in o) for o in offsets[order]),
        on_device(omega[order]),
        None if body.sites is None else on_device(body.sites.astype(np.int32)),
        horizon,
        None if arrays else (made.examples, made.patterns[:, order]),
    )
    volumes, count, delta = on_device((body.volumes.astype(real), made.count, delta))
    if not arrays:
        return Families(None, None, None, None, None, volumes, count, delta, body.spacing, body.shape, grid)
    away = np.zeros((1, body.dim))
    away[0, 0] = horizon
    xi = np.concatenate([vectors, away]).astype(real)[made.offset]  # −1, padding, is the last
    padded = namespace(omega).concatenate([omega, np.ones(1, real)])[made.offset]
    weight = (made.offset >= 0).astype(real)
    neighbours, reverse, xi, padded, weight = on_device((made.neighbours, made.reverse, xi, padded, weight))
    return Families(neighbours, reverse, xi, padded, weight, volumes, count, delta, body.spacing, body.shape, grid)


def pack(body: Points, horizon: float, influence: Callable, directed: tuple[np.ndarray, ...]) -> Families:
    """Directed bonds (i, j, vectors, index of the opposite bond) → padded arrays."""
    i, j, vectors, opposite = directed
    points = len(body)
    count = np.bincount(i, minlength=points)
    _refuse_lonely(count, horizon)
    order = np.lexsort((j, i))
    slot = np.empty(len(i), dtype=np.int64)
    slot[order] = np.arange(len(i)) - np.repeat(np.cumsum(count) - count, count)

    width = int(count.max())
    neighbours = np.broadcast_to(np.arange(points)[:, None], (points, width)).copy()
    reverse = np.broadcast_to(np.arange(width)[None, :], (points, width)).copy()
    xi = np.zeros((points, width, body.dim))
    xi[..., 0] = horizon
    weight = np.zeros((points, width))
    neighbours[i, slot], reverse[i, slot], xi[i, slot], weight[i, slot] = j, slot[opposite], vectors, 1.0

    real = jnp.result_type(float)
    delta = np.asarray(horizon, dtype=real)
    omega = checked_influence(influence, np.linalg.norm(xi, axis=-1).astype(real), delta)
    neighbours, reverse, count = on_device(tuple(x.astype(np.int32) for x in (neighbours, reverse, count)))
    xi, weight, volumes = on_device(tuple(x.astype(real) for x in (xi, weight, body.volumes)))
    omega, delta = on_device((omega, delta))
    return Families(neighbours, reverse, xi, omega, weight, volumes, count, delta, body.spacing, body.shape)
