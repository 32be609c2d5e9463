"""Traversals: the two orders in which a backend visits the bonds of a body, one slot at a time.

A slot holds one bond of every point: one offset of a lattice (`LatticeTraversal`), or one column of the padded
neighbour arrays (`SlotTraversal`). A quantity of the points is an array (components, flat). A traversal has four
methods for it:

    embed      converts (points, components) to this layout
    here       reads it at the points
    far        reads it at the neighbours in one slot
    collect    converts it back to (points, components)

A `LatticeTraversal` stores the cells in row-major order. Every axis except the first ends with a gap of ⌊N⌋ empty
cells. A neighbour at a given offset is then always the same number of places away, and never in the next row by
mistake, so no index arrays are needed. A periodic axis has ⌊N⌋ copied cells of the other end on both sides instead of a
gap. Cells that hold no point have volume 0.

Both traversals work on whole arrays. Blocks of points that fit the CPU caches were tried, and XLA evaluated them four
times slower.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._internal.checks import namespace, on_device, on_host
from ...geometry.bonds import Bonds, Families, Grid

# Allowed numbers of slots in one step of the loop. Several slots a step are faster on a large lattice, where adding to
# the sums takes most of the time.
UNROLLED = (9, 8, 7, 6, 10)


def to_cells(x: Array | np.ndarray, cells: tuple[int, ...], sites: Array | np.ndarray | None) -> Any:
    """(points, components) → (components, *cells), with 0 in empty cells. A NumPy array gives a NumPy array."""
    x = x.T
    if sites is not None and isinstance(x, np.ndarray):
        points, x = x, np.zeros((x.shape[0], math.prod(cells)), x.dtype)
        x[:, np.asarray(sites)] = points
    elif sites is not None:
        x = jnp.zeros((x.shape[0], math.prod(cells)), x.dtype).at[:, sites].set(x)
    return x.reshape(x.shape[0], *cells)


def from_cells(x: Array, sites: Array | None) -> Array:
    """(components, *cells) → (points, components)."""
    x = x.reshape(x.shape[0], math.prod(x.shape[1:])).T
    return x if sites is None else x[sites]


class Slot(NamedTuple):
    """One slot: the places of the neighbours and the data of the bonds, one value a point or one shared by all."""

    at: Array  # indices (flat,), or one shift of a lattice
    xi: list[Array]  # one array for each component
    omega: Array
    back: Array | None  # ω of the reverse bonds, or None if they equal `omega`


def _steps(slots: int, unrolled: bool) -> np.ndarray:
    """The numbers 0 … slots − 1 in rows of equal length, filled up with −1. Unless `unrolled`, a row is one slot."""
    group = min(UNROLLED, key=lambda g: (-(-slots // g) * g, -g)) if unrolled and slots > 10 else 1
    return np.append(np.arange(slots), np.full(-slots % group, -1)).reshape(-1, group).astype(np.int32)


class SlotTraversal(eqx.Module):
    """Any cloud, by its padded neighbour arrays, transposed to (slots, points)."""

    neighbours: Int[Array, "slots flat"]
    xi: Float[Array, "dim slots flat"]
    omega: Float[Array, "slots flat"]
    back: Float[Array, "slots flat"] | None
    volumes: Float[Array, " flat"]
    one: Float[Array, ""]  # 1, an input whose value the compiler does not see (see `components`)
    share: Bool[Array, "slots flat"] | Float[Array, "slots flat"] | None = None  # what is left of bonds that break

    @staticmethod
    def of(families: Families) -> "SlotTraversal":
        """The traversal of a body, made by NumPy if the families are not traced.

        `back` is None if ω_ij = ω_ji is known for every bond.
        """
        xp, families = namespace(families), on_host(families)
        omega = families.influence * families.weight
        back = omega[families.neighbours, families.reverse]
        symmetric = bool((omega == back).all()) if xp is np else families.grid is not None
        turned = (
            families.neighbours.T,
            xp.moveaxis(families.xi, (2, 1), (0, 1)),
            omega.T,
            None if symmetric else back.T,
        )
        share = None if families.intact is None else families.acting.T
        turned, share = jax.tree.map(np.ascontiguousarray, (turned, share)) if xp is np else (turned, share)
        return SlotTraversal(*on_device((*turned, families.volumes, np.ones((), families.dtype), share)))

    filled = None
    embed = staticmethod(lambda x: x.T)  # (points, components) → (components, flat)
    collect = staticmethod(lambda x: x.T)
    renew = staticmethod(lambda x: x)
    open = staticmethod(lambda x: x)
    here = staticmethod(lambda x: x)

    @staticmethod
    def dear(*read: Array) -> list:
        """The arrays that are expensive to read again: everything gathered by index."""
        return list(read)

    @staticmethod
    def far(x: Array, slot: Slot) -> Array:
        """x at the far ends of the bonds of one slot."""
        return x.at[slot.at].get(mode="promise_in_bounds")

    def numbers(self, pairs: bool) -> np.ndarray:
        """Numbers of the slots, (steps, group), filled up with −1."""
        return _steps(self.omega.shape[0], False)

    def slot(self, number: Array) -> Slot:
        """One slot of the traversal."""
        omega, back = self.omega[number], None if self.back is None else self.back[number]
        if self.share is not None:
            omega, back = omega * self.share[number], None if back is None else back * self.share[number]
        return Slot(self.neighbours[number], [x[number] for x in self.xi], omega, back)


class LatticeTraversal(eqx.Module):
    """A lattice, whose neighbours at one offset are one slice of an array."""

    shifts: Int[Array, " slots"]
    xi: Float[Array, "slots dim"]
    omega: Float[Array, " slots"]
    filled: Float[Array, " flat"]  # 1 in cells that hold a point, 0 elsewhere
    sites: Int[Array, " points"] | None
    cell: Float[Array, ""]  # volume of a cell
    one: Float[Array, ""]  # 1, an input whose value the compiler does not see (see `components`)
    cells: tuple[int, ...] = eqx.field(static=True)
    before: tuple[int, ...] = eqx.field(static=True)  # cells added before the first cell of each axis
    behind: tuple[int, ...] = eqx.field(static=True)  # cells added after the last cell of each axis
    periodic: tuple[bool, ...] = eqx.field(static=True)
    margin: int = eqx.field(static=True)
    flat: int = eqx.field(static=True)

    @staticmethod
    def of(families: Families) -> "LatticeTraversal":
        grid = families.grid
        assert isinstance(grid, Grid)
        offsets = np.array(grid.offsets).reshape(-1, families.dim)
        reach = np.abs(offsets).max(axis=0, initial=0)
        before = tuple(int(r) if p else 0 for r, p in zip(reach, grid.periodic, strict=True))
        behind = tuple(int(r) if p or axis else 0 for axis, (r, p) in enumerate(zip(reach, grid.periodic, strict=True)))
        padded = [n + b + e for n, b, e in zip(grid.cells, before, behind, strict=True)]
        stride = np.append(np.cumprod(padded[:0:-1])[::-1], 1)
        real = families.dtype
        spacing = np.asarray(families.spacing, real)
        traversal = LatticeTraversal(
            on_device((offsets @ stride).astype(np.int32)),
            on_device(offsets.astype(real) * spacing),
            on_device(grid.influence),
            on_device(np.zeros(0, real)),
            grid.sites,
            on_device(spacing**families.dim),
            on_device(np.ones((), real)),
            grid.cells,
            before,
            behind,
            grid.periodic,
            int(np.abs(offsets @ stride).max(initial=0)),
            math.prod(padded),
        )
        points = namespace(grid.sites).ones((len(families), 1), real)
        return eqx.tree_at(lambda w: w.filled, traversal, on_device(traversal.embed(points)[0]))

    back = None

    def full_family(self, horizon: Array) -> Bonds:
        """The bonds of an interior point at rest."""
        return Bonds(self.xi, jnp.zeros_like(self.xi), self.omega, jnp.full(len(self.xi), self.cell), horizon)

    @property
    def volumes(self) -> Array:
        return self.cell * self.filled

    def embed(self, x: Array | np.ndarray) -> Any:
        """(points, components) → (components, flat), with 0 in empty cells. A NumPy array gives a NumPy array."""
        x = to_cells(x, self.cells, self.sites)
        for axis, (b, e, wraps) in enumerate(zip(self.before, self.behind, self.periodic, strict=True)):
            width = [(0, 0)] * x.ndim
            width[axis + 1] = (b, e)
            xp = np if isinstance(x, np.ndarray) else jnp
            x = xp.pad(x, width, mode="wrap" if wraps else "constant")
        return x.reshape(x.shape[0], self.flat)

    def collect(self, x: Array) -> Array:
        """(components, flat) → (points, components)."""
        padded = [n + b + e for n, b, e in zip(self.cells, self.before, self.behind, strict=True)]
        x = x.reshape(x.shape[0], *padded)
        x = x[(slice(None), *(slice(b, b + n) for n, b in zip(self.cells, self.before, strict=True)))]
        return from_cells(x, self.sites)

    def renew(self, x: Array) -> Array:
        """x after a computation in all cells, with the copies at periodic edges renewed and 0 in empty cells."""
        if any(self.periodic):
            return self.embed(self.collect(x))
        return jnp.where(self.filled > 0, x, 0.0)

    def open(self, x: Array) -> Array:
        """A row (flat,) with a margin on both sides, which `here` and `far` can read."""
        return jnp.pad(x, self.margin)

    def here(self, x: Array) -> Array:
        """An opened array without its margins."""
        return x[self.margin : self.margin + self.flat]

    @staticmethod
    def dear(*read: Array) -> list:
        """The arrays that are expensive to read again: none, because slices are cheap."""
        return []

    def far(self, x: Array, slot: Slot) -> Array:
        """An opened array at the far ends of the bonds of one slot."""
        return jax.lax.dynamic_slice_in_dim(x, self.margin + slot.at, self.flat)

    def numbers(self, pairs: bool) -> np.ndarray:
        """Numbers of the slots, (steps, group), filled up with −1. With `pairs`, one of every two opposite offsets."""
        return _steps(len(self.shifts) // 2, False) if pairs else _steps(len(self.shifts), self.flat > 4096)

    def slot(self, number: Array) -> Slot:
        """One slot of the traversal."""
        xi = [self.xi[number, k] for k in range(self.xi.shape[1])]
        return Slot(self.shifts[number], xi, self.omega[number], None)

    def returned(self, x: Array, slot: Slot) -> Array:
        """x at the far ends of the opposite bonds, at −offset; 0 beyond the array."""
        return jax.lax.dynamic_slice_in_dim(self.open(x), self.margin - slot.at, self.flat)


Traversal = SlotTraversal | LatticeTraversal
