"""The families of a body in padded arrays, found by a k-d tree or, on a lattice, from its stencil.

The slots that a family does not fill are padding. The neighbour in such a slot is the point itself, with weight 0 and
any non-zero reference vector. Its strain and all derivatives are finite and its weight removes it from every sum, so
the models need no `where`.
"""

import math
import warnings
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._internal.checks import is_concrete, namespace, on_device
from .._internal.public import public_function
from .bonds import TIE, Families, Grid, cells_within, checked_influence
from .influence import constant_influence, named_influence
from .points import Points, check_body
from .stencils import LatticeArrays
from .ties import BAND, CLEAR, CutShell, cut_shell, tie_radius


def _refuse_short_box(body: Points, radius: float) -> None:
    if body.period is not None and (np.array(body.period) <= 2 * radius).any():
        raise ValueError(
            f"a periodic box must be longer than two horizons ({2 * radius:g}), or a point would have a neighbour"
            f" twice; got box lengths {body.period}; use a longer box or a smaller horizon"
        )


def checked_horizon(horizon: Any) -> float:
    """Return the horizon as a float; raise ValueError if it is not one number, finite and > 0."""
    if not is_concrete(horizon):
        raise ValueError("horizon decides which points are neighbours, so it can't be traced; pass a plain number")
    if np.ndim(horizon) != 0 or isinstance(horizon, str) or horizon is None:
        raise ValueError(f"horizon must be one number [length], the same for all points; got {horizon!r:.60}")
    horizon = float(horizon)
    if not (math.isfinite(horizon) and horizon > 0):
        raise ValueError(f"horizon must be finite and > 0; got {horizon}")
    return horizon


def in_box(body: Points) -> tuple[np.ndarray, np.ndarray | None]:
    """Positions moved into the periodic box and the box lengths, 0 along axes that are not periodic.

    The lengths are None if no axis is periodic.
    """
    if body.period is None:
        return body.positions, None
    box = np.where(np.isfinite(body.period), body.period, 0.0)
    X = np.where(box > 0, np.mod(body.positions, np.where(box > 0, box, 1.0)), body.positions)
    return np.where((box > 0) & (X >= box), 0.0, X), box  # np.mod(-1e-17, 1.0) is 1.0


def search_tree(body: Points, radius: float) -> tuple[Any, np.ndarray, np.ndarray | None]:
    """The search tree of the points for this radius, with the positions and the lengths of the box by `in_box`.

    Raises ValueError if points coincide, or if a periodic box is not longer than twice the radius.
    """
    from scipy.spatial import cKDTree  # imported here because the import takes a third of a second

    _refuse_short_box(body, radius)
    X, box = in_box(body)
    tree = cKDTree(X, boxsize=box)
    near = tree.query_pairs(1e-9 * radius, output_type="ndarray")
    if len(near):
        i, j = near[0]
        raise ValueError(f"positions must be distinct; points {i} and {j} coincide ({len(near)} such pairs)")
    return tree, X, box


def bond_vectors(body: Points, box: np.ndarray | None, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """X_j − X_i [length], the shortest in a periodic box."""
    vectors = body.positions[j] - body.positions[i]
    if box is not None:
        vectors -= box * np.round(vectors / np.where(box > 0, box, np.inf))
    return vectors


def pairs_within(body: Points, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """All pairs i < j of points within `radius`: i, j and the vectors X_j − X_i, the shortest in a periodic box.

    Raises ValueError if points coincide, or if a periodic box is not longer than twice the radius.
    """
    tree, _, box = search_tree(body, radius)
    i, j = tree.query_pairs(radius, output_type="ndarray").T
    return i, j, bond_vectors(body, box, i, j)


def _warn_of_cut_shell(cut: CutShell, body: Points, horizon: float) -> None:
    far = np.abs(body.positions).max(initial=0.0) > 100 * np.ptp(body.positions, axis=0).max()
    shift = ", or move the origin nearer to the points" if far else ""
    warnings.warn(
        f"the horizon {horizon:.6g} cuts through one shell of neighbours: {cut}. Points with the same surroundings may"
        f" get different families. Use a horizon between two shells, such as {CLEAR * horizon:.6g} (3.015 spacings"
        f" instead of 3){shift}. pdjax.neighbour_report shows the counts",
        stacklevel=3,
    )


@public_function
def families(
    body: Points, horizon: float, influence: Callable | str = constant_influence, arrays: bool = True
) -> Families:
    """Find the families of all points of a body, as padded arrays.

    Parameters
    ----------
    body : Points
        The body, from `lattice`, `bar`, `plate`, `cuboid` or `cloud`.
    horizon : float
        Horizon δ [length]. It decides which points are neighbours, so it can't be traced.
    influence : callable or str, optional
        Influence function (r, δ) → ω ≥ 0, or its name, such as "gaussian" or "partial volume" (see
        `pdjax.geometry.influence`).
    arrays : bool, optional
        False, for lattices only, keeps the stencil and makes no arrays over points and bonds. This is enough for
        `force_density`, `force_operator`, `jvp` and `slab_force`; energies, motions and matrices need the arrays.

    Returns
    -------
    Families
        The families, padded to the size of the largest one.

    Raises
    ------
    ValueError
        If the horizon is not finite and > 0 or is below the lattice spacing, points coincide, a point has no neighbour,
        a periodic box is not longer than two horizons, or ω is negative, not finite or zero for all bonds.

    Warns
    -----
    UserWarning
        If the horizon cuts through bonds of nearly one length, as happens with coordinates of few digits.

    Notes
    -----
    A body takes `horizon`, a length. A lattice family takes `N`, a number of spacings: `lattice_family(dim, N)` is the
    family of the interior points for horizon = N · spacing.

    If the horizon is a whole number of spacings, bonds along the axes are exactly as long as the horizon: they tie.
    Bonds up to δ (1 + 1e-9) plus the rounding error of the coordinates belong to the family, so ties are safe for a
    `lattice` and for coordinates with all digits of their dtype. For a `cloud` whose coordinates were rounded further,
    as in a text file, use 3.015 spacings instead of 3. The families of a lattice are the same for both, and no bond
    ties at 3.015.

    Examples
    --------
    >>> body = pd.lattice((5, 4), spacing=0.5)
    >>> pd.families(body, horizon=1.0)
    Families(20 points, 2D, 5 to 11 bonds a point, horizon 1)
    >>> pd.families(pd.cloud(body.positions, body.volumes), horizon=1.005)
    Families(20 points, 2D, 5 to 11 bonds a point, horizon 1.005)
    """
    check_body("body", body)
    horizon = checked_horizon(horizon)
    if body.spacing is not None and horizon < body.spacing / (1 + TIE):
        raise ValueError(f"horizon must be finite, > 0 and at least one spacing ({body.spacing}); got {horizon}")
    if body.uniform:
        return _of_lattice(body, horizon, influence, arrays)
    if not arrays:
        raise ValueError(
            "arrays=False is for lattices, whose families share one stencil; this body is a cloud, or a lattice with"
            " changed positions or volumes; use arrays=True"
        )
    radius = tie_radius(body, horizon)
    _refuse_short_box(body, radius)
    wide = max(radius, horizon * (1 + BAND))  # a cut shell has bonds on both sides of the horizon
    fits = body.period is None or min(body.period) > 2 * wide
    lower, upper, vectors = pairs_within(body, wide if fits else radius)
    lengths = np.linalg.norm(vectors, axis=1)
    cut = cut_shell(lengths, body, horizon)
    if cut is not None:
        _warn_of_cut_shell(cut, body, horizon)
    lower, upper, vectors = (x[lengths <= radius] for x in (lower, upper, vectors))
    i, j = np.concatenate([lower, upper]), np.concatenate([upper, lower])
    opposite = np.roll(np.arange(len(i)), len(lower))  # bond p + pairs is opposite to bond p
    return pack(body, horizon, influence, (i, j, np.concatenate([vectors, -vectors]), opposite))


def _refuse_lonely(count: np.ndarray, horizon: float) -> None:
    if (count == 0).any():
        raise ValueError(
            f"every point needs a neighbour within the horizon {horizon:g}; point {int(np.argmin(count))} has"
            f" none ({int((count == 0).sum())} such points); use a larger horizon or remove these points"
        )


def _of_lattice(body: Points, horizon: float, influence: Callable | str, arrays: bool) -> Families:
    """Make the families of a lattice from its stencil."""
    assert body.cells is not None and body.spacing is not None
    periodic = tuple(bool(np.isfinite(p)) for p in body.period) if body.period else (False,) * body.dim
    _refuse_short_box(body, horizon * (1 + TIE))
    offsets = cells_within(body.dim, horizon / body.spacing)
    reach = np.abs(offsets) < np.array(body.cells)
    offsets = offsets[reach.all(axis=1)]  # no point has a bond longer than the body
    real = jnp.result_type(float)
    delta = np.asarray(horizon, dtype=real)
    vectors = offsets * body.spacing
    made = LatticeArrays(body, offsets, periodic, arrays)
    _refuse_lonely(made.count, horizon)
    function = named_influence(influence, body.spacing)
    omega = checked_influence(function, np.linalg.norm(vectors, axis=1).astype(real), delta)
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
    volumes, count, delta, at = on_device((body.volumes.astype(real), made.count, delta, body.positions.astype(real)))
    if not arrays:
        return Families(None, None, None, None, None, volumes, count, delta, body.spacing, body.shape, grid, at)
    away = np.zeros((1, body.dim))
    away[0, 0] = horizon
    xi = np.concatenate([vectors, away]).astype(real)[made.offset]  # padding has offset −1, so it takes the last row
    padded = namespace(omega).concatenate([omega, np.ones(1, real)])[made.offset]
    weight = (made.offset >= 0).astype(real)
    neighbours, reverse, xi, padded, weight = on_device((made.neighbours, made.reverse, xi, padded, weight))
    return Families(neighbours, reverse, xi, padded, weight, volumes, count, delta, body.spacing, body.shape, grid, at)


def pack(body: Points, horizon: float, influence: Callable | str, directed: tuple[np.ndarray, ...]) -> Families:
    """Pack directed bonds (i, j, vectors, index of the opposite bond) into padded arrays."""
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
    function = named_influence(influence, body.spacing or float(np.median(body.volumes)) ** (1 / body.dim))
    omega = checked_influence(function, np.linalg.norm(xi, axis=-1).astype(real), delta)
    neighbours, reverse, count = on_device(tuple(x.astype(np.int32) for x in (neighbours, reverse, count)))
    xi, weight, volumes = on_device(tuple(x.astype(real) for x in (xi, weight, body.volumes)))
    omega, delta, at = on_device((omega, delta, body.positions.astype(real)))
    return Families(neighbours, reverse, xi, omega, weight, volumes, count, delta, body.spacing, body.shape, None, at)
