"""Memory layout of a lattice body for kernels without an index list: a neighbour lies at a constant offset in memory.

A point (x, y, z) has the index (x n_y + y) s + z, where s is the stride of a row. There are two layouts, with r the
reach of the family in cells:

* r empty places follow each row, s = n_z + r. A neighbour z + dz outside the body falls into them; the loops limit x
  and y.
* A border of r empty places surrounds the body on every side.

Several rows form one long loop, which the vector unit processes.
"""

import numpy as np
from numba import njit

from .power import FAST

ROWS = 8  # rows of one block: 13 arrays of 8 rows of 35 numbers fit into a first-level cache of 32 KiB


class Grid:
    """A lattice body of `shape` points, its half family (offsets, ξ, w = ω V), and the layout of flat arrays.

    influence is a function (r, δ) → ω; None means ω = 1. With border=True, r empty places surround the body on every
    side; otherwise r empty places follow each row.
    """

    def __init__(self, shape, spacing, horizon, influence=None, border=False):
        reach = int(horizon / spacing * (1 + 1e-9))
        axis = np.arange(-reach, reach + 1)
        cells = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        square = (cells**2).sum(axis=1)
        cells = cells[(square > 0) & (square <= (horizon / spacing * (1 + 1e-9)) ** 2)]
        self.cells = cells[len(cells) // 2 :]  # lexicographic order: keeps x > 0, or x = 0 and y > 0, or ...
        self.shape, self.points_count, self.reach = tuple(shape), int(np.prod(shape)), reach
        self.border = reach if border else 0
        self.spacing = float(spacing)
        self.xi = self.cells * self.spacing
        r = np.linalg.norm(self.xi, axis=1)
        omega = np.ones_like(r) if influence is None else np.asarray(influence(r, horizon))
        self.w = omega * self.spacing**3
        nx, ny, nz = (n + 2 * self.border for n in shape)
        stride = nz if border else nz + reach
        self.full = (nx, ny, stride)
        self.size = nx * ny * stride + (ROWS + 2) * stride  # reads beyond the last row find zeros
        self.offset = (self.cells[:, 0] * ny + self.cells[:, 1]) * stride + self.cells[:, 2]
        z = np.tile(np.arange(stride), ROWS)
        steps = axis[:, None]
        self.inside = ((z < nz) & (z + steps >= 0) & (z + steps < nz)).astype(float)

    def flat(self, x):
        """Copy (points, components) to (components, size), with zeros in the empty places."""
        out = np.zeros((x.shape[1], self.size))
        spread(np.ascontiguousarray(x), out, self.shape, self.full, self.border)
        return out

    def rows(self):
        """The half family sorted by rows of neighbours (dx, dy); (0, 0) is the point's own row.

        Returns an array (rows, 4) of offset, dx h, dy h and the largest |dz|, and the weights (rows, |dz|) with spare
        zeros at the end.
        """
        weights, size = {}, self.reach + 5
        for (x, y, z), w in zip(self.cells, self.w, strict=True):
            weights.setdefault((x, y), np.zeros(size))[abs(z)] = w
        ny, stride = self.full[1:]
        shape = [((x * ny + y) * stride, x * self.spacing, y * self.spacing, np.flatnonzero(w)[-1])
                 for (x, y), w in weights.items()]  # fmt: skip
        return np.array(shape, dtype=float), np.array(list(weights.values()))

    def family_sums(self, values, odd=False):
        """Sum values of the half family (half, c) over the existing neighbours of every point → (points, c).

        Opposite neighbours have the same value; with odd=True they have opposite values.
        """
        r, shape = self.reach, self.shape
        present = np.zeros([n + 2 * r for n in shape])
        present[tuple(slice(r, r + n) for n in shape)] = 1
        out = np.zeros((*shape, values.shape[1]))
        for cell, value in zip(self.cells, values, strict=True):
            for side in (1, -1):
                there = present[tuple(slice(r + side * d, r + side * d + n) for d, n in zip(cell, shape, strict=True))]
                out += there[..., None] * (value * (side if odd else 1))
        return out.reshape(-1, values.shape[1])


@njit(**FAST)
def spread(x, out, shape, full, border):
    """Copy x (points, components) into the flat arrays out (components, size)."""
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            a = ((i + border) * full[1] + j + border) * full[2] + border
            b = (i * ny + j) * nz
            for c in range(x.shape[1]):
                for k in range(nz):
                    out[c, a + k] = x[b + k, c]


@njit(**FAST)
def collect(x, out, shape, full, border):
    """Sum the grids x (threads, components, size) of all threads into out (points, components)."""
    nx, ny, nz = shape
    for i in range(nx):
        for j in range(ny):
            a = ((i + border) * full[1] + j + border) * full[2] + border
            b = (i * ny + j) * nz
            for c in range(x.shape[1]):
                for k in range(nz):
                    out[b + k, c] = x[0, c, a + k]
                for t in range(1, x.shape[0]):
                    for k in range(nz):
                        out[b + k, c] += x[t, c, a + k]
