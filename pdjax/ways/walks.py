"""Two walks over the bonds of a body: point by point in flat arrays, slot by slot.

A quantity of the points is an array (components, flat); a walk knows how to lay it out (`embed`), to read it at a
block of points (`here`) and at their neighbours of one slot (`far`), and to take it back (`collect`). Blocks are as
long as the caches like; a slot is one offset of a lattice (`GridWalk`) or one column of padded neighbour arrays
(`SlotWalk`).

**GridWalk**: cells in row-major order, with a gap of ⌊N⌋ empty cells at the end of every axis but the first, so that a
neighbour is always the same number of places ahead or behind, and never in the next row by mistake: no index arrays. A
periodic axis has ⌊N⌋ cells of the other end on both sides instead. What is not a point has volume 0.
"""

import math
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..neighbours import Families, Grid

BLOCK = 10**9
UNROLLED = (9, 8, 7, 6, 10)  # slots in one step of the loop, where bonds cost so little that sums are what is paid for


class Slot(NamedTuple):
    """One slot of a block: where the neighbours are, and what the bonds are, over the block or shared by it."""

    at: Any
    xi: list[Array]  # a component each
    omega: Array
    back: Array | None  # ω of the reverse bond; None: the same


def _steps(slots: int, unrolled: bool) -> np.ndarray:
    """0 … slots − 1 in steps of equal length, −1 where nothing is left; one slot a step unless `unrolled`."""
    group = min(UNROLLED, key=lambda g: (-(-slots // g) * g, -g)) if unrolled and slots > 10 else 1
    return np.append(np.arange(slots), np.full(-slots % group, -1)).reshape(-1, group).astype(np.int32)


class SlotWalk(eqx.Module):
    """Any cloud, by its padded neighbour arrays, turned round to (slots, points)."""

    neighbours: Int[Array, "slots flat"]
    xi: Float[Array, "dim slots flat"]
    omega: Float[Array, "slots flat"]
    back: Float[Array, "slots flat"] | None
    volumes: Float[Array, " flat"]
    one: Float[Array, ""]  # 1, not known to the compiler
    points: int = eqx.field(static=True)
    block: int = eqx.field(static=True)

    @staticmethod
    def of(fams: Families, symmetric: bool) -> "SlotWalk":
        """`symmetric`: ω_ij = ω_ji of every bond."""
        points = len(fams)
        blocks = -(-points // BLOCK)
        block = -(-points // blocks)
        more = blocks * block - points
        omega = fams.influence * fams.weight
        back = None if symmetric else omega[fams.neighbours, fams.reverse]

        def turned(x):
            return jnp.pad(jnp.moveaxis(x, 0, -1), [(0, 0)] * (x.ndim - 1) + [(0, more)], mode="edge")

        return SlotWalk(
            turned(fams.neighbours),
            jnp.moveaxis(turned(fams.xi), 1, 0),
            turned(omega),
            None if back is None else turned(back),
            jnp.pad(fams.volumes, (0, more), mode="edge"),
            jnp.ones((), fams.dtype),
            points,
            block,
        )

    @property
    def blocks(self) -> int:
        return self.volumes.shape[0] // self.block

    @property
    def filled(self) -> None:
        return None

    def embed(self, x: Array) -> Array:
        """(points, components) → (components, flat)."""
        return jnp.pad(x.T, ((0, 0), (0, self.volumes.shape[0] - self.points)), mode="edge")

    renew = staticmethod(lambda x: x)
    open = staticmethod(lambda x: x)

    def collect(self, x: Array) -> Array:
        """(components, flat) → (points, components)."""
        return x[:, : self.points].T

    def here(self, x: Array, c) -> Array:
        """(…, flat) → (…, block)."""
        return jax.lax.dynamic_slice_in_dim(x, c * self.block, self.block, axis=-1)

    @staticmethod
    def dear(*read: Array) -> list:
        """What is costly to read again: anything gathered."""
        return list(read)

    def far(self, x: Array, c, slot: Slot) -> Array:
        return x.at[slot.at].get(mode="promise_in_bounds")

    def numbers(self, pairs: bool) -> np.ndarray:
        """Numbers of the slots, (steps, group), −1 where nothing is left."""
        return _steps(self.omega.shape[0], False)

    def slot(self, number: Array, c) -> Slot:
        """One slot of a block."""

        def cut(x):
            start = [jnp.asarray(s, jnp.int32) for s in (*[0] * (x.ndim - 2), number, c * self.block)]
            row = jax.lax.dynamic_slice(x, start, (*x.shape[:-2], 1, self.block))
            return row.reshape(*x.shape[:-2], self.block)

        xi = [cut(self.xi[k]) for k in range(len(self.xi))]
        return Slot(cut(self.neighbours), xi, cut(self.omega), None if self.back is None else cut(self.back))


class GridWalk(eqx.Module):
    """A lattice by slices."""

    shifts: Int[Array, " slots"]
    xi: Float[Array, "slots dim"]
    omega: Float[Array, " slots"]
    filled: Float[Array, " flat"]  # 1 at points, 0 elsewhere
    sites: Int[Array, " points"] | None
    cell: Float[Array, ""]  # volume of a cell
    one: Float[Array, ""]  # 1, not known to the compiler
    cells: tuple[int, ...] = eqx.field(static=True)
    before: tuple[int, ...] = eqx.field(static=True)  # cells added in front of each axis and behind it
    behind: tuple[int, ...] = eqx.field(static=True)
    periodic: tuple[bool, ...] = eqx.field(static=True)
    margin: int = eqx.field(static=True)
    block: int = eqx.field(static=True)
    flat: int = eqx.field(static=True)

    @staticmethod
    def of(fams: Families) -> "GridWalk":
        grid: Any = fams.grid
        assert isinstance(grid, Grid)
        offsets = np.array(grid.offsets).reshape(-1, fams.dim)
        reach = np.abs(offsets).max(axis=0, initial=0)
        before = tuple(int(r) if p else 0 for r, p in zip(reach, grid.periodic, strict=True))
        behind = tuple(int(r) if p or axis else 0 for axis, (r, p) in enumerate(zip(reach, grid.periodic, strict=True)))
        padded = [n + b + e for n, b, e in zip(grid.cells, before, behind, strict=True)]
        stride = np.append(np.cumprod(padded[:0:-1])[::-1], 1)
        size = int(np.prod(padded))
        blocks = -(-size // BLOCK)
        block = -(-size // blocks)
        real = fams.dtype
        spacing = jnp.asarray(fams.spacing, real)
        walk = GridWalk(
            jnp.asarray(offsets @ stride, dtype=jnp.int32),
            jnp.asarray(offsets, real) * spacing,
            grid.influence,
            jnp.zeros(0, real),
            grid.sites,
            spacing**fams.dim,
            jnp.ones((), real),
            grid.cells,
            before,
            behind,
            grid.periodic,
            int(np.abs(offsets @ stride).max(initial=0)),
            block,
            blocks * block,
        )
        filled = walk.embed(jnp.ones((len(fams), 1), real))[0]
        return eqx.tree_at(lambda w: w.filled, walk, filled)

    back = None

    @property
    def volumes(self) -> Array:
        return self.cell * self.filled

    @property
    def blocks(self) -> int:
        return self.flat // self.block

    def embed(self, x: Array) -> Array:
        """(points, components) → (components, flat); 0 where there is no point."""
        x = x.T
        if self.sites is not None:
            x = jnp.zeros((x.shape[0], int(np.prod(self.cells))), x.dtype).at[:, self.sites].set(x)
        x = x.reshape(x.shape[0], *self.cells)
        for axis, (b, e, wraps) in enumerate(zip(self.before, self.behind, self.periodic, strict=True)):
            width = [(0, 0)] * x.ndim
            width[axis + 1] = (b, e)
            x = jnp.pad(x, width, mode="wrap" if wraps else "constant")
        x = x.reshape(x.shape[0], math.prod(x.shape[1:]))
        return jnp.pad(x, ((0, 0), (0, self.flat - x.shape[1])))

    def collect(self, x: Array) -> Array:
        """(components, flat) → (points, components)."""
        padded = [n + b + e for n, b, e in zip(self.cells, self.before, self.behind, strict=True)]
        x = x[:, : int(np.prod(padded))].reshape(x.shape[0], *padded)
        x = x[(slice(None), *(slice(b, b + n) for n, b in zip(self.cells, self.before, strict=True)))]
        x = x.reshape(x.shape[0], math.prod(self.cells)).T
        return x if self.sites is None else x[self.sites]

    def renew(self, x: Array) -> Array:
        """What was computed cell by cell, made right at the copies of a periodic edge and 0 where there is no point."""
        if any(self.periodic):
            return self.embed(self.collect(x))
        return jnp.where(self.filled > 0, x, 0.0)

    def open(self, x: Array) -> Array:
        """With a margin on both sides, to be read by `here` and `far`."""
        return jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(self.margin, self.margin)])

    def here(self, x: Array, c) -> Array:
        """(…, flat) → (…, block), of an array without margin or with it."""
        start = self.margin if x.shape[-1] > self.flat else 0
        return jax.lax.dynamic_slice_in_dim(x, start + c * self.block, self.block, axis=-1)

    @staticmethod
    def dear(*read: Array) -> list:
        """What is costly to read again: nothing."""
        return []

    def far(self, x: Array, c, slot: Slot) -> Array:
        return jax.lax.dynamic_slice_in_dim(x, self.margin + c * self.block + slot.at, self.block, axis=-1)

    def numbers(self, pairs: bool) -> np.ndarray:
        """Of every offset, or of one of each pair of opposite ones; as for `SlotWalk`."""
        return _steps(len(self.shifts) // 2, False) if pairs else _steps(len(self.shifts), self.flat > 4096)

    def slot(self, number: Array, c) -> Slot:
        return Slot(
            self.shifts[number], [self.xi[number, k] for k in range(self.xi.shape[1])], self.omega[number], None
        )

    def returned(self, x: Array, slot: Slot) -> Array:
        """What every point finds at the other end of the opposite bond: x at −offset, 0 beyond."""
        padded = jnp.pad(x, (self.margin, self.margin))
        return jax.lax.dynamic_slice_in_dim(padded, self.margin - slot.at, self.flat)


Walk = SlotWalk | GridWalk
