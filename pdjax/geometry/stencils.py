"""The families of a lattice from one stencil, without a neighbour search.

A bond of a lattice is an offset o of whole cells. The point in cell c has this bond if cell c + o is filled, across
periodic edges too. The code fills the slots one offset after the other, in the order of the offsets. Beside the
result it therefore needs memory for only a few numbers a point.
"""

import itertools

import numpy as np

from .points import Points


def shifted(numbers: np.ndarray, offset: tuple[int, ...], periodic: tuple[bool, ...]) -> np.ndarray:
    """Return numbers[c + offset] for every cell c, and −1 beyond an edge that is not periodic."""
    out = np.full_like(numbers, -1)
    here, there = [], []
    for n, o, wraps in zip(numbers.shape, offset, periodic, strict=True):
        if wraps:
            cut = o % n
            here.append([slice(0, n - cut), slice(n - cut, n)])
            there.append([slice(cut, n), slice(0, cut)])
        else:
            here.append([slice(max(0, -o), n - max(0, o))])
            there.append([slice(max(0, o), n - max(0, -o))])
    for a, b in zip(itertools.product(*here), itertools.product(*there), strict=True):
        out[a] = numbers[b]
    return out


class LatticeArrays:
    """Neighbour arrays of a lattice, or only its kinds of families.

    `count` (points,) is the number of bonds of each point.

    With `arrays`: `neighbours` and `reverse` (points, slots) as in `Families`, and `offset` (points, slots), the index
    of the bond's offset, −1 for padding.

    Without: `patterns` (kinds, offsets) tells which bonds each kind of family has, and `examples` (kinds,) is one point
    of each kind.
    """

    def __init__(self, body: Points, offsets: np.ndarray, periodic: tuple[bool, ...], arrays: bool):
        points = len(body)
        assert body.cells is not None
        filled = np.full(int(np.prod(body.cells)), -1, dtype=np.int32)
        sites = np.arange(points) if body.sites is None else body.sites
        filled[sites] = np.arange(points, dtype=np.int32)
        grid = filled.reshape(body.cells)
        own = np.arange(points, dtype=np.int32)
        self.count = np.zeros(points, dtype=np.int32)
        small = np.int16 if len(offsets) < 2**15 else np.int32
        place = np.full((len(offsets) if arrays else 0, points), -1, dtype=small)  # slot of each offset at each point
        keys = np.zeros(points, dtype=np.uint64)
        weights = np.frombuffer(np.random.default_rng(0).bytes(8 * len(offsets)), dtype=np.uint64)
        for b, offset in enumerate(offsets.tolist()):
            found = shifted(grid, tuple(offset), periodic).reshape(-1)[sites] >= 0
            if arrays:
                place[b, found] = self.count[found]
            else:
                keys += np.where(found, weights[b], np.uint64(0))  # this random sum identifies the kind of family
            self.count += found
        if not arrays:
            self.examples = np.unique(keys, return_index=True)[1]
            at = sites[self.examples]
            chosen = [shifted(grid, tuple(o), periodic).reshape(-1)[at] >= 0 for o in offsets.tolist()]
            self.patterns = np.array(chosen).reshape(len(offsets), -1).T
            return
        width = int(self.count.max())
        self.neighbours = np.broadcast_to(own[:, None], (points, width)).copy()
        self.reverse = np.broadcast_to(np.arange(width, dtype=np.int32)[None, :], (points, width)).copy()
        self.offset = np.full((points, width), -1, dtype=small)
        for b, offset in enumerate(offsets.tolist()):
            j = shifted(grid, tuple(offset), periodic).reshape(-1)[sites]
            i = np.flatnonzero(j >= 0)
            slot = place[b, i]
            self.neighbours[i, slot] = j[i]
            self.reverse[i, slot] = place[len(offsets) - 1 - b, j[i]]  # −o mirrors o in lexicographic order
            self.offset[i, slot] = b
