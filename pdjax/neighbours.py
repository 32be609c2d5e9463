"""Families: the bonds that end at a point, for one lattice point or for every point of a body.

A **bond** is the record (ξ, η, ω, V, δ): reference vector ξ = X_j − X_i, relative displacement
η = u_j − u_i (never positions: no cancellation at tiny strain), influence ω and volume V_j of the
neighbour, and the horizon δ, one for the family. Its deformed image is Y = ξ + η. The weight β ∈ [0, 1] of a
bond (partial volume, damage) is folded into ω, so every model honours it; with T = (1/V_j) ∂W/∂Y_j the force density
stays the exact gradient of the energy for any weights, even ones that differ between the two directions of a bond.

A family holds the points with |ξ| ≤ δ(1 + 1e-9): ties do not depend on rounding. On a lattice it is in
centro-symmetric order: bond b and bond b + bonds/2 are opposite.

A padded neighbour of a body's family is the point itself with weight 0 and any non-zero reference vector:
its strain is finite, its weight kills it, and every derivative is finite, without a `where`.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ._checks import is_concrete, require
from .influence import constant_influence
from .lattice_arrays import LatticeArrays
from .points import Points

TIE = 1e-9  # relative slack of the horizon


class Bonds(NamedTuple):
    """The bonds of one family (or, with leading axes, of many): what a model sees."""

    xi: Float[Array, "*points bonds dim"]
    eta: Float[Array, "*points bonds dim"]
    omega: Float[Array, "*points bonds"]
    volume: Float[Array, "*points bonds"]
    horizon: Float[Array, "*points"]


EACH_BOND = Bonds(0, 0, 0, 0, None)  # type: ignore[arg-type]  # vmap axes: over the bonds of one family, which share δ


def _influence(influence: Callable, r: Array, horizon) -> Array:
    omega = jnp.broadcast_to(jnp.asarray(influence(r, horizon), dtype=r.dtype), r.shape)
    ok = jnp.isfinite(omega).all() & (omega >= 0).all() & (omega > 0).any()
    name = getattr(influence, "__name__", type(influence).__name__)
    return require(omega, ok, f"influence {name} must be finite, nowhere negative and not zero everywhere")


def _weight(weight, shape) -> Array:
    weight = jnp.broadcast_to(jnp.asarray(weight, dtype=jnp.result_type(float)), shape)
    return require(weight, (weight >= 0).all() & (weight <= 1).all(), "bond weights must lie in [0, 1]")


class Family(eqx.Module):
    """One interior family of a uniform lattice. Lengths share the unit of `spacing`.

    xi (bonds, dim), influence ω (bonds,), weight β (bonds,), horizon, spacing: all traced.
    `cubic` is True while the weights have the full symmetry of the lattice.
    """

    xi: Float[Array, "bonds dim"]
    influence: Float[Array, " bonds"]
    weight: Float[Array, " bonds"]
    horizon: Float[Array, ""]
    spacing: Float[Array, ""]
    cubic: bool = eqx.field(static=True, default=True)

    @property
    def dim(self) -> int:
        return self.xi.shape[1]

    @property
    def reach(self) -> int:
        """⌊N⌋, told from the number of bonds (static), for N is traced."""
        reach = 1
        while len(cells_within(self.dim, reach + 1.0)) <= self.xi.shape[0]:
            reach += 1
        return reach

    def bonds(self, F: Float[Array, "dim dim"]) -> Bonds:
        """The bonds of the family under the homogeneous deformation x = F X: η = (F − I) ξ."""
        eta = self.xi @ (F - jnp.eye(self.dim, dtype=F.dtype)).T
        volume = jnp.broadcast_to(self.spacing**self.dim, self.influence.shape)
        return Bonds(self.xi, eta, self.influence * self.weight, volume, self.horizon)

    def with_weight(self, weight: Float[Array, " bonds"]) -> "Family":
        """The family with bond weights β ∈ [0, 1]; opposite bonds must weigh the same (one bond, two ends)."""
        weight = _weight(weight, self.influence.shape)
        half = weight.shape[0] // 2
        even = jnp.abs(weight[:half] - weight[half:]) <= 1e-12
        weight = require(weight, even, "weights of a lattice family must be even: weight[b] == weight[b + bonds/2]")
        return Family(self.xi, self.influence, weight, self.horizon, self.spacing, cubic=False)


def cells_within(dim: int, N: float) -> np.ndarray:
    """Integer offsets (bonds, dim) of the lattice points within N spacings, in lexicographic order."""
    reach = int(N * (1 + TIE))
    cells = np.array(list(itertools.product(range(-reach, reach + 1), repeat=dim)))
    square = (cells**2).sum(axis=1)
    return cells[(square > 0) & (square <= (N * (1 + TIE)) ** 2)]


def lattice_family(dim: int, N: float, spacing=1.0, influence: Callable = constant_influence) -> Family:
    """The family of an interior point of a uniform lattice, horizon δ = N · spacing.

    Arguments: dim 1, 2 or 3; N horizon over spacing [-], ≥ 1, not traced; spacing [length];
        influence a callable (r, δ) → ω ≥ 0 (see `pdjax.influence`).
    Returns: `Family` in centro-symmetric order.
    Raises: ValueError for dim, N, spacing or an influence that is negative or zero everywhere.
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    if not (math.isfinite(N) and N * (1 + TIE) >= 1):
        raise ValueError(f"N (horizon / spacing) must be finite and >= 1, or a family has no bonds; got {N}")
    spacing = jnp.asarray(spacing, dtype=jnp.result_type(float))
    spacing = require(spacing, jnp.isfinite(spacing) & (spacing > 0), f"spacing must be finite and > 0; got {spacing}")
    cells = cells_within(dim, N)
    first = cells[len(cells) // 2 :]  # lexicographic order: the second half is the mirror of the first
    first = first[np.lexsort((*first.T[::-1], (first**2).sum(axis=1)))]
    xi = jnp.asarray(np.concatenate([first, -first]), dtype=spacing.dtype) * spacing
    horizon = N * spacing
    omega = _influence(influence, jnp.linalg.norm(xi, axis=1), horizon)
    return Family(xi, omega, jnp.ones_like(omega), horizon, spacing)


class Grid(eqx.Module):
    """Where families came from a lattice: one stencil for all of them.

    `cells` and `periodic` (one entry an axis); `offsets` to the neighbours in cells, the second half the mirror of
    the first; `influence` (offsets,) ω of each; `sites` (points,) the cell of each point in row-major order, or None
    for all. `horizon` [length] is known to the host. `kinds` of families, where there are no arrays: a point of each,
    and which bonds it has.
    """

    cells: tuple[int, ...] = eqx.field(static=True)
    periodic: tuple[bool, ...] = eqx.field(static=True)
    offsets: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    influence: Float[Array, " offsets"]
    sites: Int[Array, " points"] | None
    horizon: float = eqx.field(static=True)
    kinds: tuple[Any, Any] | None


class Families(eqx.Module):
    """The families of every point of a body, as arrays padded to the largest family.

    neighbours (points, bonds): index j of the neighbour; reverse (points, bonds): the slot of i in j's family.
    xi (points, bonds, dim), influence and weight (points, bonds), volumes (points,), horizon.
    `count` (points,) is the number of true bonds. `shape`, `spacing` are kept from a lattice, and its stencil in `grid`
    (None for clouds and for bonds with weights of their own).
    """

    neighbours: Int[Array, "points bonds"] | Any  # these five: None for a lattice with arrays=False
    reverse: Int[Array, "points bonds"] | Any
    xi: Float[Array, "points bonds dim"] | Any
    influence: Float[Array, "points bonds"] | Any
    weight: Float[Array, "points bonds"] | Any
    volumes: Float[Array, " points"]
    count: Int[Array, " points"]
    horizon: Float[Array, ""]
    spacing: float | None = eqx.field(static=True, default=None)
    shape: tuple[int, ...] | None = eqx.field(static=True, default=None)
    grid: Grid | None = None

    @property
    def dim(self) -> int:
        return len(self.grid.cells) if self.grid is not None else self.xi.shape[2]

    def __len__(self) -> int:
        return self.volumes.shape[0]

    @property
    def dtype(self):
        """Of everything real here."""
        return self.volumes.dtype

    def bonds(self, u: Float[Array, "points dim"], F: Float[Array, "dim dim"] | None = None) -> Bonds:
        """All bonds under the displacement u [length] on top of the mean deformation F (None: identity)."""
        if self.xi is None:
            raise ValueError(
                "these families of a lattice were made with arrays=False and hold no bonds: that is enough for"
                " force_density, jvp and simulate; for anything else make them with arrays=True"
            )
        eta = u[self.neighbours] - u[:, None, :]
        if F is not None:
            eta = eta + self.xi @ (F - jnp.eye(self.dim, dtype=self.xi.dtype)).T
        horizon = jnp.broadcast_to(self.horizon, (len(self),))
        return Bonds(self.xi, eta, self.influence * self.weight, self.volumes[self.neighbours], horizon)

    def reversed(self, bonds: Bonds) -> Bonds:
        """Every bond as seen from its other end: (−ξ, −η, ω_ji, V_i)."""
        omega = bonds.omega[self.neighbours, self.reverse]
        volume = jnp.broadcast_to(self.volumes[:, None], omega.shape)
        return Bonds(-bonds.xi, -bonds.eta, omega, volume, bonds.horizon)

    def with_weight(self, weight: Float[Array, "points bonds"]) -> "Families":
        """The families with bond weights β ∈ [0, 1] times the present ones (padding stays 0)."""
        weight = _weight(weight, self.weight.shape)
        lost = eqx.tree_at(lambda f: f.grid, self, None, is_leaf=lambda x: x is None)
        return eqx.tree_at(lambda f: f.weight, lost, self.weight * weight)


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
        stencil and no arrays over points and bonds: enough for forces, their derivatives and explicit dynamics.
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
    if body.cells is not None:
        return _of_lattice(body, horizon, influence, arrays)
    if not arrays:
        raise ValueError("arrays=False is for lattices, whose families have one stencil; this body is a cloud")
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
    delta = jnp.asarray(horizon, dtype=real)
    vectors = offsets * body.spacing
    made = LatticeArrays(body, offsets, periodic, arrays)
    _refuse_lonely(made.count, horizon)
    omega = _influence(influence, jnp.asarray(np.linalg.norm(vectors, axis=1), dtype=real), delta)
    half = len(offsets) // 2
    order = np.concatenate([np.arange(half, len(offsets)), np.arange(half)[::-1]])
    grid = Grid(
        body.cells,
        periodic,
        tuple(tuple(int(x) for x in o) for o in offsets[order]),
        omega[order],
        None if body.sites is None else jnp.asarray(body.sites, dtype=jnp.int32),
        horizon,
        None if arrays else (made.examples, made.patterns[:, order]),
    )
    volumes, count = jnp.asarray(body.volumes, dtype=real), jnp.asarray(made.count)
    if not arrays:
        return Families(None, None, None, None, None, volumes, count, delta, body.spacing, body.shape, grid)
    away = np.zeros((1, body.dim))
    away[0, 0] = horizon
    xi = np.concatenate([vectors, away])[made.offset]  # −1, padding, is the last
    padded = jnp.concatenate([omega, jnp.ones(1, real)])
    return Families(
        jnp.asarray(made.neighbours),
        jnp.asarray(made.reverse),
        jnp.asarray(xi, dtype=real),
        padded[made.offset],
        jnp.asarray(made.offset >= 0, dtype=real),
        volumes,
        count,
        delta,
        body.spacing,
        body.shape,
        grid,
    )


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
    delta = jnp.asarray(horizon, dtype=real)
    omega = _influence(influence, jnp.asarray(np.linalg.norm(xi, axis=-1), dtype=real), delta)
    return Families(
        jnp.asarray(neighbours, dtype=jnp.int32),
        jnp.asarray(reverse, dtype=jnp.int32),
        jnp.asarray(xi, dtype=real),
        omega,
        jnp.asarray(weight, dtype=real),
        jnp.asarray(body.volumes, dtype=real),
        jnp.asarray(count, dtype=jnp.int32),
        delta,
        body.spacing,
        body.shape,
    )
