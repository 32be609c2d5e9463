"""Bonds and families: `LatticeFamily` for one interior point of a lattice, `Families` for all points of a body.

A **bond** joins a point i to a neighbour j. It is the record (ξ, η, ω, V, δ):

    ξ = X_j − X_i    reference vector [length]
    η = u_j − u_i    relative displacement [length]; the deformed bond is Y = ξ + η
    ω                influence [-] times the bond weight β [-]
    V = V_j          volume of the neighbour [length^dim]
    δ                horizon [length], the same for all bonds of a family

Models receive η and never the deformed positions, so that no digits cancel at tiny strains.

The **weight** β ≥ 0 of a bond describes partial volumes and damage. It multiplies ω, so every model takes it into
account. With T = (1/V_j) ∂W/∂Y_j the force density is the exact gradient of the energy for any weights, even if the
two directions of a bond have different weights.

A bond **breaks** when its weight becomes 0 during a run (`Families.with_broken`). The families then remember their
weights before the first break, β₀. Models that keep their reference sums (`keeps_reference`, such as LPS) divide by
the sums of the intact family, ω₀ = influence times β₀. All other models see the remaining family alone. A bond that
`cut` or `with_weight` removes is absent from the intact family too.

The **family** of a point holds all points with |ξ| ≤ δ(1 + 1e-9). The slack of 1e-9 keeps rounding errors from
deciding which bonds of length δ belong to the family. On a lattice the bonds are in centro-symmetric order: bond b and
bond b + bonds/2 are opposite.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike

from .._internal.checks import in_host_memory, namespace, native, on_device, on_host, require
from .._internal.public import public_function
from .influence import SignedInfluence, constant_influence, named_influence

TIE = 1e-9  # relative slack of the horizon


class Bonds(NamedTuple):
    """The bonds of one family or, with leading axes, of many families: the input of a material model.

    `LatticeFamily.bonds` and `Families.bonds` make this record.

    Attributes
    ----------
    xi : array, shape (..., bonds, dim)
        Reference vectors ξ = X_j − X_i [length].
    eta : array, shape (..., bonds, dim)
        Relative displacements η = u_j − u_i [length].
    omega : array, shape (..., bonds)
        Influence times bond weight [-]. It is 0 for padding.
    volume : array, shape (..., bonds)
        Volumes of the neighbours [length^dim].
    horizon : array, shape (...)
        Horizon δ of each family [length].
    intact : array, shape (..., bonds), or None
        Influence times weight before bonds broke [-]. None: no bond has broken, and it equals `omega`.

    Examples
    --------
    A bar is stretched by 10 %. Its bonds of length 1 and 2 become longer by 0.1 and 0.2.

    >>> bonds = pd.lattice_family(dim=1, N=2).bonds(np.array([[1.1]]))
    >>> np.asarray(bonds.eta)[:, 0].round(3).tolist()
    [0.1, 0.2, -0.1, -0.2]
    """

    xi: Float[Array, "*points bonds dim"]
    eta: Float[Array, "*points bonds dim"]
    omega: Float[Array, "*points bonds"]
    volume: Float[Array, "*points bonds"]
    horizon: Float[Array, "*points"]
    intact: Float[Array, "*points bonds"] | None = None

    @property
    def reference(self) -> Float[Array, "..."]:
        """ω of the intact family [-], for reference sums that do not change when bonds break."""
        return self.omega if self.intact is None else self.intact


def without_collapse(xi: Any, eta: Any, omega: Any) -> Any:
    """η (…, dim), but 0 for a broken bond whose ends meet. It has no direction, and its force 0 · ∞ would be NaN."""
    xp = namespace(xi, eta, omega)
    meets = (omega == 0) & (xp.abs(xi + eta) == 0).all(axis=-1)
    return xp.where(meets[..., None], 0, eta)


EACH_BOND = Bonds(0, 0, 0, 0, None, 0)  # type: ignore[arg-type]  # vmap over the bonds of a family: they share δ


def checked_influence(influence: Callable | str, r: np.ndarray | Array, horizon) -> np.ndarray | Array:
    """Compute ω of bonds of length r and check that it is finite, non-negative and not zero everywhere.

    A `SignedInfluence` may be negative. The result is a NumPy array if no value is traced.
    """
    influence = named_influence(influence)
    with np.errstate(all="ignore"):  # the check below reports NaN and infinity, so NumPy need not warn
        omega = influence(r, horizon)
    xp = namespace(omega)
    omega = xp.broadcast_to(xp.asarray(omega, dtype=r.dtype), r.shape)
    signed = isinstance(influence, SignedInfluence)
    ok = xp.isfinite(omega).all() & ((omega >= 0).all() | signed) & (omega != 0).any()
    name = getattr(influence, "__name__", type(influence).__name__)
    rule = "finite" if signed else "finite, nowhere negative (see signed_influence)"
    return require(omega, ok, f"influence {name} must be {rule} and not zero everywhere")


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


def _readable(*arrays: object) -> bool:
    """Whether the host can read the values now. It can't read tracers, donated arrays and arrays of other hosts."""
    return all(
        isinstance(x, np.ndarray | np.generic)
        or (
            isinstance(x, jax.Array)
            and not isinstance(x, jax.core.Tracer)
            and not x.is_deleted()
            and x.is_fully_addressable
        )
        for x in arrays
    )


def _length(name: str, value: Any) -> str:
    """Part of a `__repr__`: a comma, the name and the value or its range, or nothing if it is not readable."""
    if not _readable(value) or value.ndim > 1:
        return ""
    low, high = float(np.min(value)), float(np.max(value))
    return f", {name} {low:.6g}" + (f" to {high:.6g}" if high > low else "")


class LatticeFamily(eqx.Module):
    """The family of one interior point of a uniform lattice.

    `lattice_family` makes it. `print` shows its sizes. All arrays may be traced and differentiated, and all lengths
    share the unit of `spacing`.

    Attributes
    ----------
    xi : array, shape (bonds, dim)
        Reference vectors of the bonds [length]. Bonds b and b + bonds/2 are opposite.
    influence : array, shape (bonds,)
        Influence ω of each bond [-].
    weight : array, shape (bonds,)
        Weight β of each bond [-], 1 by default.
    horizon : array, shape ()
        Horizon δ = N · spacing [length].
    spacing : array, shape ()
        Distance h of neighbouring lattice points [length]. Every point has the volume h^dim.
    cubic : bool
        True if the family has all symmetries of the lattice; `with_weight` sets it to False.

    Examples
    --------
    >>> family = pd.lattice_family(dim=2, N=2)
    >>> print(family)
    LatticeFamily(12 bonds, 2D, horizon 2, spacing 1)
    >>> family.xi.shape
    (12, 2)
    """

    xi: Float[Array, "bonds dim"]
    influence: Float[Array, " bonds"]
    weight: Float[Array, " bonds"]
    horizon: Float[Array, ""]
    spacing: Float[Array, ""]
    cubic: bool = eqx.field(static=True, default=True)

    def __repr__(self) -> str:
        if getattr(self.xi, "ndim", 0) != 2:  # a batch of families, or a tree of the same structure
            return super().__repr__()
        bonds, dim = self.xi.shape
        lengths = _length("horizon", self.horizon) + _length("spacing", self.spacing)
        return f"{type(self).__name__}({bonds} bonds, {dim}D{lengths}{'' if self.cubic else ', weighted bonds'})"

    @property
    def dim(self) -> int:
        """Number of space dimensions: 1, 2 or 3."""
        return self.xi.shape[1]

    @property
    def reach(self) -> int:
        """⌊N⌋, the largest number of spacings that a bond spans along an axis.

        It follows from the number of bonds, which is static, because the horizon and the spacing may be traced.
        """
        reach = 1
        while len(cells_within(self.dim, reach + 1.0)) <= self.xi.shape[0]:
            reach += 1
        return reach

    def bonds(self, F: Float[Array | np.ndarray, "dim dim"]) -> Bonds:
        """Bonds of the family under the homogeneous deformation x = F X, with η = (F − I) ξ.

        Parameters
        ----------
        F : array, shape (dim, dim)
            Deformation gradient [-].

        Returns
        -------
        Bonds
            One record for the whole family.
        """
        xp = namespace(self, F)
        family, F = on_host((self, F)) if xp is np else (self, F)
        eta = family.xi @ (F - xp.eye(family.dim, dtype=F.dtype)).T
        volume = xp.broadcast_to(family.spacing**family.dim, family.influence.shape)
        eta, omega, volume = on_device((eta, family.influence * family.weight, volume))
        return Bonds(self.xi, eta, omega, volume, self.horizon)

    def with_weight(self, weight: ArrayLike) -> "LatticeFamily":
        """Copy of the family with other bond weights β.

        Parameters
        ----------
        weight : array, shape (bonds,)
            Weights ≥ 0 [-]. They replace the present weights. Opposite bonds must have equal weights, because both
            are one and the same bond of the lattice.

        Returns
        -------
        LatticeFamily
            The family with these weights and `cubic` False.

        Raises
        ------
        ValueError
            If the shape is wrong, a weight is negative or not finite, or opposite weights differ. Where the weights
            are traced, the values are checked at run time and raise RuntimeError.

        Examples
        --------
        >>> family = pd.lattice_family(dim=1, N=2)
        >>> family.with_weight([1.0, 0.5, 1.0, 0.5]).weight.tolist()
        [1.0, 0.5, 1.0, 0.5]
        """
        checked = _weight(weight, self.influence.shape)
        half = checked.shape[0] // 2
        even = abs(checked[:half] - checked[half:]) <= 1e-12
        checked = require(checked, even, "weights of a lattice family must be even: weight[b] == weight[b + bonds/2]")
        return LatticeFamily(self.xi, self.influence, on_device(checked), self.horizon, self.spacing, cubic=False)


def cells_within(dim: int, N: float) -> np.ndarray:
    """Integer offsets (bonds, dim) to the lattice points within N spacings, in lexicographic order."""
    reach = int(N * (1 + TIE))
    cells = np.array(list(itertools.product(range(-reach, reach + 1), repeat=dim)))
    square = (cells**2).sum(axis=1)
    return cells[(square > 0) & (square <= (N * (1 + TIE)) ** 2)]


@public_function
def lattice_family(dim: int, N: float, spacing=1.0, influence: Callable | str = constant_influence) -> LatticeFamily:
    """Make the family of an interior point of a uniform lattice.

    δ = N · spacing

    Parameters
    ----------
    dim : int
        Number of space dimensions: 1, 2 or 3.
    N : float
        Horizon over spacing [-], at least 1. It decides which bonds exist, so it can't be traced.
    spacing : float
        Distance of neighbouring points [length]. It may be traced.
    influence : callable or str, optional
        Influence function (r, δ) → ω ≥ 0, or its name, such as "gaussian" (see `pdjax.geometry.influence`).

    Returns
    -------
    LatticeFamily
        The bonds in centro-symmetric order: bonds b and b + bonds/2 are opposite.

    Raises
    ------
    ValueError
        If dim, N or spacing is out of range, or ω is negative, not finite or zero for all bonds.

    Notes
    -----
    A lattice takes `N`, a number of spacings. A body takes `horizon`, a length: `families(body, horizon)` with
    horizon = N · spacing gives every interior point this family.

    For whole N, bonds along the axes are exactly as long as the horizon: they tie. Here and in `families` of a
    `lattice` such bonds belong to the family, whatever the rounding. For the points of a `cloud` whose coordinates
    have few digits, take a horizon of 3.015 spacings instead of 3. In every dimension it holds the same bonds, since
    no lattice bond is between 3 and √10 spacings long, and no bond ties. Use N = 3.015 here too if you compare with
    such a body, because ω and some constants depend on δ.

    Examples
    --------
    >>> pd.lattice_family(dim=2, N=3, spacing=0.1)
    LatticeFamily(28 bonds, 2D, horizon 0.3, spacing 0.1)
    >>> pd.lattice_family(dim=2, N=3.015, spacing=0.1)
    LatticeFamily(28 bonds, 2D, horizon 0.3015, spacing 0.1)
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    if not (math.isfinite(N) and float(N) * (1 + TIE) >= 1):
        raise ValueError(f"N (horizon / spacing) must be finite and >= 1, so that a family has bonds; got {N}")
    N = float(N)
    xp = namespace(spacing)
    spacing = xp.asarray(spacing, dtype=jnp.result_type(float))
    spacing = require(spacing, xp.isfinite(spacing) & (spacing > 0), f"spacing must be finite and > 0; got {spacing}")
    cells = cells_within(dim, N)
    first = cells[len(cells) // 2 :]  # in lexicographic order the second half mirrors the first
    first = first[np.lexsort((*first.T[::-1], (first**2).sum(axis=1)))]
    xi = np.concatenate([first, -first]).astype(spacing.dtype) * spacing
    horizon = N * spacing
    omega = checked_influence(named_influence(influence, spacing), xp.linalg.norm(xi, axis=1), horizon)
    return LatticeFamily(*on_device((xi, omega, np.ones(omega.shape, omega.dtype), horizon, spacing)))


class Grid(eqx.Module):
    """The stencil that all families of a lattice share.

    `cells` and `periodic` have one entry for each axis. `offsets` lead to the neighbours, in cells; their second half
    mirrors the first. `influence` (offsets,) is ω of each offset. `sites` (points,) is the cell of each point in
    row-major order, or None if every cell is filled. `horizon` [length] is a plain number. `kinds` is set only for
    families without arrays: it lists one point of each kind of family, and which bonds that kind has.
    """

    cells: tuple[int, ...] = eqx.field(static=True)
    periodic: tuple[bool, ...] = eqx.field(static=True)
    offsets: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    influence: Float[Array, " offsets"]
    sites: Int[Array, " points"] | None
    horizon: float = eqx.field(static=True)
    kinds: tuple[Int[Array | np.ndarray, " kinds"], Bool[Array | np.ndarray, "kinds offsets"]] | None


class Families(eqx.Module):
    """The families of all points of a body, as arrays padded to the size of the largest family.

    `families` makes them. `print` shows their sizes. A slot that holds no bond is padding: its neighbour is the point
    itself, its weight is 0, its ξ is any vector except 0, and its ω is any number.

    Attributes
    ----------
    neighbours : array of int, shape (points, bonds)
        Index j of the neighbour in each slot. With `arrays=False` this and the next four are None.
    reverse : array of int, shape (points, bonds)
        Slot of point i in the family of its neighbour j.
    xi : array, shape (points, bonds, dim)
        Reference vectors X_j − X_i [length].
    influence : array, shape (points, bonds)
        Influence ω [-].
    weight : array, shape (points, bonds)
        Bond weight β [-]: 1 by default, 0 for cut bonds and padding.
    volumes : array, shape (points,)
        Volumes of the points [length^dim].
    count : array of int, shape (points,)
        Number of bonds of each point, cut bonds included, padding excluded.
    horizon : array, shape () or (points,)
        Horizon δ [length], one for all points or one for each. With one for each, a bond that only one of its ends
        reaches is in the families of both, with the weight 0 at the other end.
    spacing : float or None
        Spacing [length] of the lattice, None for a cloud.
    shape : tuple of int or None
        Cells of a full lattice along each axis, else None.
    grid : Grid or None
        Stencil of a lattice. It is None for clouds and after `with_weight`.
    positions : array, shape (points, dim)
        Reference positions of the points [length].
    intact : array, shape (points, bonds), or None
        Bond weights before bonds broke [-], see `with_broken`. None: no bond has broken.

    Examples
    --------
    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> print(families)
    Families(20 points, 2D, 5 to 11 bonds a point, horizon 2.1)
    >>> families.neighbours.shape, int(families.is_bond.sum())
    ((20, 11), 154)
    """

    neighbours: Int[Array, "points bonds"] | Any  # these five are None for a lattice with arrays=False
    reverse: Int[Array, "points bonds"] | Any
    xi: Float[Array, "points bonds dim"] | Any
    influence: Float[Array, "points bonds"] | Any
    weight: Float[Array, "points bonds"] | Any
    volumes: Float[Array, " points"]
    count: Int[Array, " points"]
    horizon: Float[Array, "*points"]
    spacing: float | None = eqx.field(static=True, default=None)
    shape: tuple[int, ...] | None = eqx.field(static=True, default=None)
    grid: Grid | None = None
    positions: Float[Array | np.ndarray, "points dim"] | None = None
    intact: Float[Array, "points bonds"] | None = None

    def __repr__(self) -> str:
        stencil_only = self.xi is None and self.grid is not None
        if getattr(self.volumes, "ndim", 0) != 1 or not (stencil_only or getattr(self.xi, "ndim", 0) == 3):
            return super().__repr__()  # a batch of families, or a tree of the same structure
        if _readable(self.count):
            least, most = int(np.min(self.count)), int(np.max(self.count))
            size = f", {least} bonds a point" if least == most else f", {least} to {most} bonds a point"
        else:
            size = "" if stencil_only else f", at most {self.xi.shape[1]} bonds a point"
        arrays = ", arrays=False" if stencil_only else ""
        horizon = _length("horizon", self.horizon)
        return f"{type(self).__name__}({len(self)} points, {self.dim}D{size}{horizon}{arrays})"

    @property
    def dim(self) -> int:
        """Number of space dimensions: 1, 2 or 3."""
        return len(self.grid.cells) if self.grid is not None else self.xi.shape[2]

    def __len__(self) -> int:
        return self.volumes.shape[0]

    @property
    def dtype(self):
        """dtype of the floating-point arrays."""
        return self.volumes.dtype

    @property
    def is_bond(self) -> Bool[Array | np.ndarray, "points bonds"]:
        """Whether each slot holds a bond, shape (points, bonds).

        The other slots are padding, where `weight` is 0 and `influence` has no meaning.
        """
        self.need_arrays()
        xp = namespace(self.count)
        return xp.arange(self.xi.shape[1]) < xp.asarray(self.count)[:, None]

    @property
    def acting(self) -> Bool[Array | np.ndarray, "points bonds"]:
        """Whether each slot holds a bond with a weight > 0 at one end or both, shape (points, bonds).

        With a horizon for each point, a bond may have a weight at one end only.
        """
        self.need_arrays()
        xp = namespace(self.weight, self.neighbours, self.reverse, self.count)
        families = on_host(self) if xp is np else self
        here = families.weight > 0
        return (here | here[families.neighbours, families.reverse]) & families.is_bond

    def bonds(
        self, u: Float[Array | np.ndarray, "points dim"], F: Float[Array | np.ndarray, "dim dim"] | None = None
    ) -> Bonds:
        """Bonds of all points under the displacement u and a mean deformation F: η = u_j − u_i + (F − I) ξ.

        Parameters
        ----------
        u : array, shape (points, dim)
            Displacements [length].
        F : array, shape (dim, dim), optional
            Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
            A periodic body can be strained in no other way.

        Returns
        -------
        Bonds
            One record with leading axis `points`.

        Raises
        ------
        ValueError
            If the families were made with `arrays=False`.
        """
        self.need_arrays()
        xp = np if in_host_memory(self, u, F) else jnp
        families, u, F = on_host((self, u, F)) if xp is np else (self, u, F)
        eta = u[families.neighbours] - u[:, None, :]
        if F is not None:
            eta = eta + families.xi @ (F - xp.eye(families.dim, dtype=families.xi.dtype)).T
        horizon = xp.broadcast_to(families.horizon, (len(families),))
        omega, volume = families.influence * families.weight, families.volumes[families.neighbours]
        intact = None if families.intact is None else families.influence * families.intact
        if intact is not None:
            eta = without_collapse(families.xi, eta, omega)
        return Bonds(self.xi, *on_device((eta, omega, volume, horizon, intact)))

    def need_arrays(self) -> None:
        """Raise ValueError if the families were made with `arrays=False`."""
        if self.xi is None:
            raise ValueError(
                "this needs families with arrays, but these were made with arrays=False, which is enough only for"
                " force_density, force_operator, jvp and slab_force; make them with arrays=True"
            )

    def reversed(self, bonds: Bonds) -> Bonds:
        """Bonds seen from their other ends: (−ξ, −η, ω_ji, V_i).

        Parameters
        ----------
        bonds : Bonds
            Bonds of all points, from `Families.bonds`.

        Returns
        -------
        Bonds
            In each slot (i, j), the bond from j to i.
        """
        omega = bonds.omega[self.neighbours, self.reverse]
        volume = jnp.broadcast_to(self.volumes[:, None], omega.shape)
        intact = None if bonds.intact is None else bonds.intact[self.neighbours, self.reverse]
        return Bonds(-bonds.xi, -bonds.eta, omega, volume, bonds.horizon, intact)

    def with_weight(self, weight: ArrayLike) -> "Families":
        """Copy of the families whose bond weights are multiplied by `weight`.

        Parameters
        ----------
        weight : array, shape (points, bonds)
            Factors ≥ 0 [-], or an array that broadcasts to this shape. Padding keeps the weight 0.

        Returns
        -------
        Families
            Families with the new weights. Their `grid` is None, so forces use the padded arrays. The weights of the
            intact family, if bonds have broken, are multiplied too.

        Raises
        ------
        ValueError
            If the shape is wrong, a factor is negative or not finite, or the families were made with `arrays=False`.
            Where the factors are traced, their values are checked at run time and raise RuntimeError.

        Examples
        --------
        >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
        >>> half = families.with_weight(0.5)
        >>> float(half.weight.max())
        0.5
        """
        self.need_arrays()
        factor = _weight(weight, self.weight.shape)
        known = in_host_memory(self.weight, self.intact, factor)
        weight, intact = on_host((self.weight, self.intact)) if known else (self.weight, self.intact)
        return self._weighted(weight * factor, None if intact is None else intact * factor)

    def _weighted(self, weight: np.ndarray | Array, intact: np.ndarray | Array | None) -> "Families":
        """Copy of the families with these weights and without `grid`."""
        return eqx.tree_at(
            lambda f: (f.grid, f.weight, f.intact), self, on_device((None, weight, intact)), is_leaf=lambda x: x is None
        )

    def with_broken(self, broken: ArrayLike) -> "Families":
        """Copy of the families in which these bonds are broken: their weight is 0, and `intact` keeps the old weights.

        Parameters
        ----------
        broken : array of bool, shape (points, bonds)
            True where a bond breaks. Both ends of a bond must agree. Padding has no effect.

        Returns
        -------
        Families
            Families with the new weights. `intact` holds the weights before the first break. Their `grid` is None, so
            forces use the padded arrays.

        Raises
        ------
        ValueError
            If the shape or the dtype is wrong, the two ends of a bond disagree, or the families were made with
            `arrays=False`. Traced values are not checked.

        Notes
        -----
        `cut` and `with_weight` remove a bond as if it had never existed. The difference matters for models whose
        reference sums are those of the intact family (`keeps_reference`), such as LPS: only a broken bond makes such a
        model softer under affine maps.

        Examples
        --------
        >>> families = pd.families(pd.lattice((2, 4)), horizon=1.0)
        >>> cracked = pd.cut(families, pd.Segment((0.0, 2.0), (1.0, 2.0)))
        >>> broken = families.with_broken(cracked.weight < families.weight)
        >>> int((broken.weight == 0).sum()) - int((broken.intact == 0).sum())
        2
        """
        self.need_arrays()
        broken = broken if isinstance(broken, jax.Array) else native("broken", broken)
        if broken.shape != self.weight.shape or broken.dtype != bool:
            got = f"{broken.shape} of {broken.dtype}"
            raise ValueError(f"broken must have shape (points, bonds) = {self.weight.shape} of bool; got {got}")
        known = in_host_memory(self, broken)
        old, broken = on_host((self, broken)) if known else (self, broken)
        if known:
            back = old.neighbours, old.reverse
            apart = np.argwhere(broken & (old.weight > 0) & ~broken[back] & (old.weight[back] > 0))
            if len(apart):
                i, j = int(apart[0, 0]), int(old.neighbours[tuple(apart[0])])
                raise ValueError(
                    f"broken must hold for both ends of a bond; {len(apart)} bonds are broken at one end only, the"
                    f" first from point {i} to point {j}. Take broken | broken[families.neighbours, families.reverse]"
                )
        weight = (np if known else jnp).where(broken, 0, old.weight)
        return self._weighted(weight, old.weight if old.intact is None else old.intact)

    def with_share(self, share: Bool[Array, "points bonds"] | Float[Array, "points bonds"]) -> "Families":
        """Copy of the families in which every bond keeps a share of its weight, and `intact` keeps the old weights.

        Parameters
        ----------
        share : array of bool or float, shape (points, bonds)
            Share 0 to 1 that is left of each bond [-]: 0 is a broken bond. It may be traced. Both ends of a bond must
            agree. The values are not checked.

        Returns
        -------
        Families
            Families with the new weights, as from `with_broken`.

        Examples
        --------
        The energy of a bond-based bar is linear in the shares. Its derivative is the energy of each bond, ½ c s²/2 at
        each of its two ends:

        >>> families, u = pd.families(pd.lattice((3,)), horizon=1.0), jnp.array([[0.0], [0.0], [0.1]])
        >>> energy = lambda share: pd.strain_energy(pd.BondBased(1.0), families.with_share(share), u)
        >>> jax.grad(energy)(jnp.ones(families.weight.shape)).round(5).tolist()
        [[0.0, 0.0], [0.0, 0.0025], [0.0025, 0.0]]
        """
        self.need_arrays()
        return self._weighted(self.weight * share, self.weight if self.intact is None else self.intact)
