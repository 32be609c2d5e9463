"""How the points and the bonds of a body lie in memory for the loops of `kernels`.

LatticePairs   the cells of a `LatticeTraversal`, with empty cells behind the last one, into which the loops may read
CloudBonds     the points along a space-filling curve, so that neighbours in space are close in memory
"""

import math
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..._internal.checks import on_device, on_host
from ...geometry.bonds import Families
from ..backends.traversal import LatticeTraversal
from .machine import target

PARTS = 64  # parts of a lattice; more would not balance the work of the threads any better
STRIP = 1024  # cells of a plane that are treated before the same cells of the next plane
POINTS = 512  # points of one part of a cloud


def _up(x: int, step: int) -> int:
    return -(-x // step) * step


def _each(flat: int) -> np.ndarray:
    """The operand of the loop over points."""
    part = POINTS * target()[1]
    return np.array([flat, part, -(-flat // part)], np.int64)


class LatticePairs(eqx.Module):
    """A lattice, whose pairs are listed once: an offset and its opposite are one."""

    kind: ClassVar[str] = "lattice"
    symmetric: ClassVar[bool] = True  # every bond has the same ω and V seen from both ends

    traversal: LatticeTraversal
    filled: Float[Array, " flat"]
    xi: Float[Array, "offsets dim"]
    omega: Float[Array, " offsets"]
    shifts: Int[Array, " offsets"]
    sizes: Int[
        Array, "7"
    ]  # cells, cells of a part, parts of a phase, offsets, numbers of a row, cells of a plane and of a strip
    each: Int[Array, "3"]  # numbers of a row, numbers of a part, parts

    @staticmethod
    def of(families: Families) -> "LatticePairs":
        """The layout of a body that is not traced."""
        traversal = LatticeTraversal.of(families)
        known, (_, width) = on_host(traversal), target()
        half = known.shifts > 0
        reach = int(known.shifts.max(initial=0))
        cells, plane = known.flat, known.flat // (known.cells[0] + known.before[0] + known.behind[0])
        plane = plane if plane > STRIP else cells  # small planes stay in the cache as they are
        # A part adds to the sums of the next part, but never to those of the one after it.
        least = reach + width
        part = _up(least, plane) if plane < cells else least
        parts = max(2, min(PARTS, cells // part))
        parts -= parts % 4 if parts > 4 else parts % 2
        part = _up(-(-cells // parts), plane if plane < cells else width)
        part = max(part, least)
        row = _up(cells + reach + width, width)
        sizes = np.array([cells, part, parts // 2, half.sum(), row, plane, STRIP if plane < cells else plane], np.int64)
        arrays = np.pad(known.filled, (0, row - known.flat)), known.xi[half], known.omega[half]
        return LatticePairs(traversal, *on_device((*arrays, known.shifts[half].astype(np.int64), sizes, _each(row))))

    @property
    def volumes(self) -> Array:
        return self.traversal.cell * self.filled

    @property
    def geometry(self) -> tuple[Array, ...]:
        """The operands of the loop."""
        return self.filled, self.xi, self.omega, self.shifts, self.sizes

    def embed(self, x: Array) -> Array:
        """(points, components) → (components, flat), with 0 in empty cells."""
        x = self.traversal.embed(x)
        return jnp.pad(x, ((0, 0), (0, self.filled.shape[0] - x.shape[1])))

    def collect(self, rows: list[Array]) -> Array:
        """Rows (flat,) → (points, components)."""
        return self.traversal.collect(jnp.stack([row[: self.traversal.flat] for row in rows]))

    def renew(self, rows: list[Array]) -> list[Array]:
        """Rows after a computation in all cells, with the copies at periodic edges renewed."""
        return list(self.embed(self.collect(rows))) if rows and any(self.traversal.periodic) else rows


def _curve(positions: np.ndarray) -> np.ndarray:
    """The order of points along Morton's space-filling curve, with 2^10 steps along the longest axis."""
    low = positions.min(axis=0)
    scale = max(float(np.ptp(positions, axis=0).max()), 1e-300)
    cells = np.minimum((positions - low) * (1024 / scale), 1023).astype(np.int64)
    key = np.zeros(len(positions), np.int64)
    for bit in range(10):
        for axis in range(positions.shape[1]):
            key |= ((cells[:, axis] >> bit) & 1) << (bit * positions.shape[1] + axis)
    return np.argsort(key, kind="stable")


class CloudBonds(eqx.Module):
    """Any body, whose bonds are listed from both ends.

    The bonds of the points of one vector lie together, and begin at the entries `firsts` of the lists.
    """

    kind: ClassVar[str] = "cloud"
    filled: ClassVar[None] = None

    order: Int[Array, " flat"]  # the point at every place; the last places repeat the first point
    place: Int[Array, " points"]  # the place of every point
    volumes: Float[Array, " flat"]
    neighbours: Int[Array, " bonds"]
    xi: Float[Array, "dim bonds"]
    omega: Float[Array, " bonds"]
    back: Float[Array, " bonds"]  # ω of the reverse bonds
    firsts: Int[Array, " groups"]
    sizes: Int[Array, "4"]  # vectors of points, vectors of a part, parts, bonds
    each: Int[Array, "3"]  # places, places of a part, parts
    symmetric: bool = eqx.field(static=True)  # whether every bond has the same ω seen from both ends

    @staticmethod
    def of(families: Families) -> "CloudBonds":
        """The layout of a body that is not traced. Slots without a bond are left out where all points of a vector
        have none."""
        f, (_, width) = on_host(families), target()
        points, slots = f.influence.shape
        omega = f.influence * f.weight
        back = omega[f.neighbours, f.reverse]
        real = (omega != 0) | (back != 0)
        order = np.arange(points) if f.positions is None else _curve(np.asarray(f.positions))
        place = np.empty(points, np.int32)
        place[order] = np.arange(points, dtype=np.int32)
        groups = -(-points // width)
        padded = np.append(order, np.full(groups * width - points, order[0]))
        # Real bonds first: (places, slots) → the slot that comes at each position.
        slot = np.argsort(~real, axis=1, kind="stable")[padded]
        count = real.sum(axis=1)[padded]
        count[points:] = 0
        longest = count.reshape(groups, width).max(axis=1)
        firsts = np.append(0, np.cumsum(longest)) * width
        # Entry e of the lists: position `at` of the bonds of the point at place `who`.
        at, lane = np.divmod(np.arange(firsts[-1]) - np.repeat(firsts[:-1], longest * width), width)
        who = np.repeat(np.arange(groups) * width, longest * width) + lane
        there = at < count[who]
        point, s = padded[who], slot[who, at]
        neighbours = np.where(there, place[f.neighbours[point, s]], who).astype(np.int32)
        lists = f.xi[point, s].T, np.where(there, omega[point, s], 0), np.where(there, back[point, s], 0)
        part = max(1, POINTS // width)
        sizes = np.array([groups, part, -(-groups // part), firsts[-1]], np.int64)
        arrays = (
            padded.astype(np.int32),
            place,
            f.volumes[padded],
            neighbours,
            *lists,
            firsts.astype(np.int64),
            sizes,
            _each(len(padded)),
        )
        return CloudBonds(*on_device(tuple(map(np.ascontiguousarray, arrays))), symmetric=bool((omega == back).all()))

    @property
    def geometry(self) -> tuple[Array, ...]:
        """The operands of the loop."""
        return self.neighbours, self.xi, self.omega, self.back, self.firsts, self.sizes

    def embed(self, x: Array) -> Array:
        """(points, components) → (components, flat)."""
        return x[self.order].T

    def collect(self, rows: list[Array]) -> Array:
        """Rows (flat,) → (points, components)."""
        return jnp.stack(rows, axis=1)[self.place]

    def renew(self, rows: list[Array]) -> list[Array]:
        """Rows after a computation at all places."""
        return rows


def bytes_of(families: Families) -> int:
    """Memory that the lists of `CloudBonds` take."""
    return math.prod(families.xi.shape[:2]) * (4 + 8 * (families.dim + 2))
