"""Boxes of the Brillouin zone: the first ones, their halves, their corners.

There are two kinds. A **box of waves** is |x_a/π − center_a| ≤ half_a with x = h k. It lies in one orthant. A **cone of
long waves** holds the waves x = t y with 0 ≤ t ≤ T and |y_a − center_a| ≤ half_a. Its y lie on one face y_i = 1 of the
cube |y|_∞ ≤ 1, so that half_i = 0. Centres and half widths are exact binary fractions.
"""

from typing import NamedTuple

import numpy as np

from .chambers import meets

# Divisions of [0, π] for the first boxes of waves, and of [0, 1] for the first cones.
FIRST = 4


class Boxes(NamedTuple):
    """Boxes of waves or cones of long waves.

    `state` (boxes,) are indices. `center` and `half` (boxes, dim) are the centres and the half widths. `bound` (boxes,)
    is an upper bound of the margin on the box, infinite if none is known.
    """

    state: np.ndarray
    center: np.ndarray
    half: np.ndarray
    bound: np.ndarray

    def at(self, index: np.ndarray | slice) -> "Boxes":
        """Some of the boxes."""
        return Boxes(*(part[index] for part in self))


def joined(parts: list[Boxes]) -> Boxes:
    """All boxes of a list in one."""
    return parts[0] if len(parts) == 1 else Boxes(*(np.concatenate(x) for x in zip(*parts, strict=True)))


def _grid(dim: int) -> np.ndarray:
    axis = (np.arange(-FIRST, FIRST) + 0.5) / FIRST
    return np.stack([x.reshape(-1) for x in np.meshgrid(*[axis] * dim, indexing="ij")], axis=1)


def _of_states(states: int, center: np.ndarray, half: np.ndarray, chambers: np.ndarray) -> Boxes:
    """Those boxes that meet a chamber, once for every state."""
    inside = meets(chambers, center, half)
    center, half = center[inside], half[inside]
    state = np.repeat(np.arange(states), len(center))
    return Boxes(state, np.tile(center, (states, 1)), np.tile(half, (states, 1)), np.full(len(state), np.inf))


def first_boxes(states: int, chambers: np.ndarray) -> Boxes:
    """The boxes of waves with which the proof of several states starts."""
    center = _grid(chambers.shape[1])
    return _of_states(states, center, np.full(center.shape, 0.5 / FIRST), chambers)


def first_cones(states: int, chambers: np.ndarray) -> Boxes:
    """The cones of long waves with which the proof of several states starts."""
    dim = chambers.shape[1]
    face = _grid(dim - 1) if dim > 1 else np.zeros((1, 0))
    ends = [(axis, sign) for axis in range(dim) for sign in (1.0, -1.0)]
    center = np.concatenate([np.insert(face, axis, sign, axis=1) for axis, sign in ends])
    half = np.concatenate([np.insert(np.full(face.shape, 0.5 / FIRST), axis, 0.0, axis=1) for axis, _ in ends])
    return _of_states(states, center, half, chambers)


def halved(boxes: Boxes, axis: np.ndarray) -> Boxes:
    """Both halves of every box, cut across the coordinate `axis` (boxes,)."""
    each = np.arange(len(axis))
    half = boxes.half.copy()
    half[each, axis] /= 2
    low, high = boxes.center.copy(), boxes.center.copy()
    low[each, axis] -= half[each, axis]
    high[each, axis] += half[each, axis]
    return joined([Boxes(boxes.state, center, half, boxes.bound) for center in (low, high)])


def corners(boxes: Boxes, T: np.ndarray | None = None) -> np.ndarray:
    """The corners x = h k (boxes, 2^dim, dim) of boxes of waves, or of cones of long waves that end at T (boxes,)."""
    dim = boxes.center.shape[1]
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    every = boxes.center[:, None] + signs * boxes.half[:, None]
    if T is None:
        return np.pi * every
    face = np.argmax(boxes.half == 0, axis=1)
    return np.where(signs[:, face].T > 0, T[:, None], 0.0)[..., None] * every
