"""How the points and the bonds of a body lie in memory for the loops of `kernels`.

LatticePairs   the cells of a `LatticeTraversal`, with empty cells behind the last one that the loops may read
CloudBonds     the points along a space-filling curve, so that neighbours in space are close in memory
Blank          no body: a layout for tracing the programs of a model
"""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...._internal.checks import on_device, on_host
from ....geometry.bonds import Bonds, Families
from ..point_states import bonds_of_rest
from ..traversal import LatticeTraversal
from .machine import target

PARTS = 64  # parts of a lattice; more would not balance the work of the threads any better
STRIP = 1024  # cells of a plane that are treated before the same cells of the next plane
POINTS = 512  # points of one part of a cloud


class Layout(eqx.Module):
    """Where the points of a body lie in a row (flat,), and the operands of the loop over their bonds."""

    kind: ClassVar[str]  # of loop, `kernels.KERNELS`

    dim: int = eqx.field(static=True)
    symmetric: bool = eqx.field(static=True)  # whether every bond has the same ω seen from both ends
    volumes: Float[Array, " flat"]
    volume: Float[Array, ""] | None  # that all points share, or None
    filled: Float[Array, " flat"] | None  # 1 in cells that hold a point and 0 elsewhere; None if all hold one
    each: Int[Array, "3"]  # the operand of the loop over points

    @property
    @abstractmethod
    def geometry(self) -> tuple[Array, ...]:
        """The operands of the loop over bonds."""

    @abstractmethod
    def embed(self, x: Array) -> Array:
        """(points, components) → (components, flat), with 0 in empty cells."""

    @abstractmethod
    def collect(self, rows: list[Array]) -> Array:
        """Rows (flat,) → (points, components)."""

    def rest(self, sums: Float[Array, "entries flat"], horizon: Array) -> tuple[Bool[Array, " flat"], Bonds]:
        """Which points have no bonds, and bonds for them to have instead."""
        return jnp.all(sums == 0, axis=0), bonds_of_rest(self.dim, horizon, sums.dtype)

    def renew(self, rows: list[Array]) -> list[Array]:
        """Rows after a computation at all places, ready to be read by neighbours."""
        return rows


def _up(x: int, step: int) -> int:
    return -(-x // step) * step


def _each(flat: int) -> np.ndarray:
    """Numbers of a row, numbers of a part, parts."""
    part = POINTS * target()[1]
    return np.array([flat, part, -(-flat // part)], np.int64)


def _parts(cells: int, plane: int, reach: int, width: int) -> tuple[int, int, int, int]:
    """Cells of a part, parts of a phase, and the cells of a plane and of a strip, for a lattice.

    A part adds to the sums of the next part, but never to those of the one after it. A large plane is treated in
    strips: the same strip of all planes of a part, then the next strip. Its neighbours then stay in the cache. A small
    plane stays there as a whole, and all cells count as one plane.
    """
    step, strip = (plane, STRIP) if STRIP < plane < cells else (width, cells)
    least = _up(reach + width, step)
    parts = max(2, min(PARTS, cells // least))
    parts -= parts % (4 if parts > 4 else 2)
    part = max(_up(-(-cells // parts), step), least)
    return part, parts // 2, step if strip < cells else cells, strip


class LatticePairs(Layout):
    """A lattice, whose pairs are listed once: an offset and its opposite are one."""

    kind: ClassVar[str] = "lattice"

    traversal: LatticeTraversal
    xi: Float[Array, "offsets dim"]
    omega: Float[Array, " offsets"]
    shifts: Int[Array, " offsets"]
    sizes: Int[Array, "8"]  # see `of`

    @staticmethod
    def of(families: Families) -> "LatticePairs":
        """The layout of a body that is not traced."""
        traversal = LatticeTraversal.of(families)
        t, (_, width) = on_host(traversal), target()
        half, reach = t.shifts > 0, int(t.shifts.max(initial=0))
        part, items, plane, strip = _parts(t.flat, t.flat // (t.cells[0] + t.before[0] + t.behind[0]), reach, width)
        row = _up(t.flat + reach + width, width)
        # Cells, cells of a part, parts of a phase, offsets, numbers of a row, cells of a plane and of a strip, and how
        # many numbers of a row an item of the first phase sets to 0.
        cleared = _up(-(-row // items), width)
        sizes = np.array([t.flat, part, items, half.sum(), row, plane, strip, cleared], np.int64)
        filled = np.pad(t.filled, (0, row - t.flat))
        volumes, filled, each, pairs = on_device(
            (t.cell * filled, filled, _each(row), (t.xi[half], t.omega[half], t.shifts[half].astype(np.int64), sizes))
        )
        return LatticePairs(families.dim, True, volumes, traversal.cell, filled, each, traversal, *pairs)

    @property
    def geometry(self) -> tuple[Array, ...]:
        assert self.filled is not None
        return self.filled, self.xi, self.omega, self.shifts, self.sizes

    def embed(self, x: Array) -> Array:
        x = self.traversal.embed(x)
        return jnp.pad(x, ((0, 0), (0, self.volumes.shape[0] - x.shape[1])))

    def collect(self, rows: list[Array]) -> Array:
        return self.traversal.collect(jnp.stack([row[: self.traversal.flat] for row in rows]))

    def renew(self, rows: list[Array]) -> list[Array]:
        return list(self.embed(self.collect(rows))) if rows and any(self.traversal.periodic) else rows

    def rest(self, sums: Float[Array, "entries flat"], horizon: Array) -> tuple[Bool[Array, " flat"], Bonds]:
        return self.volumes <= 0, self.traversal.full_family(horizon)


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


class CloudBonds(Layout):
    """Any body, whose bonds are listed from both ends.

    The bonds of the points of one vector lie together, and begin at the entries `firsts` of the lists. Slots without a
    bond are left out where all points of a vector have none.
    """

    kind: ClassVar[str] = "cloud"

    order: Int[Array, " flat"]  # the point at every place; the last places repeat a point, without its bonds
    place: Int[Array, " points"]  # the place of every point
    neighbours: Int[Array, " bonds"]
    xi: Float[Array, "dim bonds"]
    omega: Float[Array, " bonds"]
    back: Float[Array, " bonds"]  # ω of the reverse bonds
    firsts: Int[Array, " groups"]
    sizes: Int[Array, "4"]  # vectors of points, vectors of a part, parts, bonds

    @staticmethod
    def of(families: Families) -> "CloudBonds":
        """The layout of a body that is not traced."""
        f, (_, width) = on_host(families), target()
        omega = f.influence * f.weight
        back = omega[f.neighbours, f.reverse]
        real = (omega != 0) | (back != 0)
        points = len(real)
        order = np.arange(points) if f.positions is None else _curve(np.asarray(f.positions))
        place = np.empty(points, np.int32)
        place[order] = np.arange(points, dtype=np.int32)
        groups = -(-points // width)
        padded = np.append(order, np.full(groups * width - points, order[0]))
        slot = np.argsort(~real, axis=1, kind="stable")[padded]  # (places, bonds): real bonds first
        count = real.sum(axis=1)[padded]
        count[points:] = 0
        longest = count.reshape(groups, width).max(axis=1)
        firsts = np.append(0, np.cumsum(longest)) * width
        # Entry e of the lists is bond `at` of the point at place `who`.
        at, lane = np.divmod(np.arange(firsts[-1]) - np.repeat(firsts[:-1], longest * width), width)
        who = np.repeat(np.arange(groups) * width, longest * width) + lane
        there, point = at < count[who], padded[who]
        s = slot[who, at]
        neighbours = np.where(there, place[f.neighbours[point, s]], who).astype(np.int32)
        lists = f.xi[point, s].T, np.where(there, omega[point, s], 0), np.where(there, back[point, s], 0)
        part = max(1, POINTS // width)
        sizes = np.array([groups, part, -(-groups // part), firsts[-1]], np.int64)
        bonds = padded.astype(np.int32), place, neighbours, *lists, firsts.astype(np.int64), sizes
        volumes, each, bonds = on_device(
            (f.volumes[padded], _each(len(padded)), tuple(map(np.ascontiguousarray, bonds)))
        )
        return CloudBonds(families.dim, bool((omega == back).all()), volumes, None, None, each, *bonds)

    @property
    def geometry(self) -> tuple[Array, ...]:
        return self.neighbours, self.xi, self.omega, self.back, self.firsts, self.sizes

    def embed(self, x: Array) -> Array:
        return x[self.order].T

    def collect(self, rows: list[Array]) -> Array:
        return jnp.stack(rows, axis=1)[self.place]


class Blank(Layout):
    """Points without bonds. It has what tracing the programs of a model needs, and what the loop over points needs."""

    kind: ClassVar[str] = "none"

    geometry: tuple = ()

    @staticmethod
    def of(dim: int, flat: int, lattice: bool) -> "Blank":
        """The layout of this number of points, with one volume for all or one for each."""
        ones = jnp.ones(flat)
        return Blank(dim, True, ones, ones[0] if lattice else None, None, jnp.asarray(_each(flat)))

    def embed(self, x: Array) -> Array:
        return x[:1].T

    def collect(self, rows: list[Array]) -> Array:
        return jnp.stack(rows, axis=1)
