"""Families: the bonds that end at a point, for one lattice point or for every point of a body.

A **bond** is the record (ξ, η, ω, V, δ): reference vector ξ = X_j − X_i, relative displacement
η = u_j − u_i (never positions: no cancellation at tiny strain), influence ω and volume V_j of the
neighbour, and the horizon δ, one for the family. Its deformed image is Y = ξ + η. The weight β ≥ 0 of a
bond (partial volume, damage) is folded into ω, so every model honours it; with T = (1/V_j) ∂W/∂Y_j the force density
stays the exact gradient of the energy for any weights, even ones that differ between the two directions of a bond.

A family holds the points with |ξ| ≤ δ(1 + 1e-9): ties do not depend on rounding. On a lattice it is in
centro-symmetric order: bond b and bond b + bonds/2 are opposite.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .._internal.checks import in_host_memory, namespace, native, on_device, on_host, require
from .._internal.public import public_function
from .influence import constant_influence, named_influence

TIE = 1e-9  # relative slack of the horizon


class Bonds(NamedTuple):
    """The bonds of one family (or, with leading axes, of many): what a model sees."""

    xi: Float[Array, "*points bonds dim"]
    eta: Float[Array, "*points bonds dim"]
    omega: Float[Array, "*points bonds"]
    volume: Float[Array, "*points bonds"]
    horizon: Float[Array, "*points"]


EACH_BOND = Bonds(0, 0, 0, 0, None)  # type: ignore[arg-type]  # vmap axes: over the bonds of one family, which share δ


def checked_influence(influence: Callable | str, r: np.ndarray | Array, horizon) -> np.ndarray | Array:
    """ω of bonds of length r, refused where it is no influence; a NumPy array if no value is traced."""
    influence = named_influence(influence)
    with np.errstate(all="ignore"):  # NaN and infinity are refused below
        omega = influence(r, horizon)
    xp = namespace(omega)
    omega = xp.broadcast_to(xp.asarray(omega, dtype=r.dtype), r.shape)
    ok = xp.isfinite(omega).all() & (omega >= 0).all() & (omega > 0).any()
    name = getattr(influence, "__name__", type(influence).__name__)
    return require(omega, ok, f"influence {name} must be finite, nowhere negative and not zero everywhere")


def _weight(weight, shape) -> np.ndarray | Array:
    xp = namespace(weight)
    weight = xp.array(native("weight", weight) if xp is np else weight, dtype=jnp.result_type(float))
    try:
        weight = xp.broadcast_to(weight, shape)
    except ValueError:
        axes = "bonds" if len(shape) == 1 else "points, bonds"
        raise ValueError(f"weight must have shape ({axes}) = {shape}, or broadcast to it; got {weight.shape}") from None
    ok = xp.isfinite(weight).all() & (weight >= 0).all()
    return require(weight, ok, "bond weights must be finite and >= 0")


class LatticeFamily(eqx.Module):
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

    def bonds(self, F: Float[Array | np.ndarray, "dim dim"]) -> Bonds:
        """The bonds of the family under the homogeneous deformation x = F X: η = (F − I) ξ."""
        xp = namespace(self, F)
        family, F = on_host((self, F)) if xp is np else (self, F)
        eta = family.xi @ (F - xp.eye(family.dim, dtype=F.dtype)).T
        volume = xp.broadcast_to(family.spacing**family.dim, family.influence.shape)
        eta, omega, volume = on_device((eta, family.influence * family.weight, volume))
        return Bonds(self.xi, eta, omega, volume, self.horizon)

    def with_weight(self, weight: Any) -> "LatticeFamily":
        """The family with bond weights β (bonds,) ≥ 0; opposite bonds must weigh the same (one bond, two ends)."""
        checked = _weight(weight, self.influence.shape)
        half = checked.shape[0] // 2
        even = abs(checked[:half] - checked[half:]) <= 1e-12
        checked = require(checked, even, "weights of a lattice family must be even: weight[b] == weight[b + bonds/2]")
        return LatticeFamily(self.xi, self.influence, on_device(checked), self.horizon, self.spacing, cubic=False)


def cells_within(dim: int, N: float) -> np.ndarray:
    """Integer offsets (bonds, dim) of the lattice points within N spacings, in lexicographic order."""
    reach = int(N * (1 + TIE))
    cells = np.array(list(itertools.product(range(-reach, reach + 1), repeat=dim)))
    square = (cells**2).sum(axis=1)
    return cells[(square > 0) & (square <= (N * (1 + TIE)) ** 2)]


@public_function
def lattice_family(dim: int, N: float, spacing=1.0, influence: Callable | str = constant_influence) -> LatticeFamily:
    """The family of an interior point of a uniform lattice, horizon δ = N · spacing.

    Arguments: dim 1, 2 or 3; N horizon over spacing [-], ≥ 1, not traced; spacing [length];
        influence a callable (r, δ) → ω ≥ 0 or the name of one (see `pdjax.geometry.influence`).
    Returns: `LatticeFamily` in centro-symmetric order.
    Raises: ValueError for dim, N, spacing or an influence that is negative or zero everywhere.
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    if not (math.isfinite(N) and float(N) * (1 + TIE) >= 1):
        raise ValueError(f"N (horizon / spacing) must be finite and >= 1, or a family has no bonds; got {N}")
    N = float(N)
    xp = namespace(spacing)
    spacing = xp.asarray(spacing, dtype=jnp.result_type(float))
    spacing = require(spacing, xp.isfinite(spacing) & (spacing > 0), f"spacing must be finite and > 0; got {spacing}")
    cells = cells_within(dim, N)
    first = cells[len(cells) // 2 :]  # lexicographic order: the second half is the mirror of the first
    first = first[np.lexsort((*first.T[::-1], (first**2).sum(axis=1)))]
    xi = np.concatenate([first, -first]).astype(spacing.dtype) * spacing
    horizon = N * spacing
    omega = checked_influence(influence, xp.linalg.norm(xi, axis=1), horizon)
    return LatticeFamily(*on_device((xi, omega, np.ones(omega.shape, omega.dtype), horizon, spacing)))


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
    (None for clouds and for bonds with weights of their own). `positions` (points, dim) [length] are the body's.
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
    positions: Float[Array | np.ndarray, "points dim"] | None = None

    @property
    def dim(self) -> int:
        return len(self.grid.cells) if self.grid is not None else self.xi.shape[2]

    def __len__(self) -> int:
        return self.volumes.shape[0]

    @property
    def dtype(self):
        """Of everything real here."""
        return self.volumes.dtype

    @property
    def is_bond(self) -> Bool[Array | np.ndarray, "points bonds"]:
        """Which slots (points, bonds) hold a bond. The others are padding: `influence` there is not 0, `weight` is."""
        self.need_arrays()
        xp = namespace(self.count)
        return xp.arange(self.xi.shape[1]) < xp.asarray(self.count)[:, None]

    def bonds(
        self, u: Float[Array | np.ndarray, "points dim"], F: Float[Array | np.ndarray, "dim dim"] | None = None
    ) -> Bonds:
        """All bonds under the displacement u [length] on top of the mean deformation F (None: identity)."""
        self.need_arrays()
        xp = np if in_host_memory(self, u, F) else jnp
        families, u, F = on_host((self, u, F)) if xp is np else (self, u, F)
        eta: Any = u[families.neighbours] - u[:, None, :]
        if F is not None:
            eta = eta + families.xi @ (F - xp.eye(families.dim, dtype=families.xi.dtype)).T
        horizon = xp.broadcast_to(families.horizon, (len(families),))
        omega, volume = families.influence * families.weight, families.volumes[families.neighbours]
        return Bonds(self.xi, *on_device((eta, omega, volume, horizon)))

    def need_arrays(self) -> None:
        """Refuse families without arrays."""
        if self.xi is None:
            raise ValueError(
                "these families of a lattice were made with arrays=False and hold no bonds: that is enough for"
                " force_density, force_operator, jvp and slab_force; energies, motions and matrices need arrays=True"
            )

    def reversed(self, bonds: Bonds) -> Bonds:
        """Every bond as seen from its other end: (−ξ, −η, ω_ji, V_i)."""
        omega = bonds.omega[self.neighbours, self.reverse]
        volume = jnp.broadcast_to(self.volumes[:, None], omega.shape)
        return Bonds(-bonds.xi, -bonds.eta, omega, volume, bonds.horizon)

    def with_weight(self, weight: Any) -> "Families":
        """The families with bond weights β (points, bonds) ≥ 0 times the present ones (padding stays 0)."""
        self.need_arrays()
        factor = _weight(weight, self.weight.shape)
        product = (on_host(self.weight) if in_host_memory(self.weight, factor) else self.weight) * factor
        lost = eqx.tree_at(lambda f: f.grid, self, None, is_leaf=lambda x: x is None)
        return eqx.tree_at(lambda f: f.weight, lost, on_device(product))
