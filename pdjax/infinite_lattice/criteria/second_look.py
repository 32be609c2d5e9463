"""A second search of the zone for states whose margin is nearly zero.

Next to rest many models have zero-energy waves. A small load turns them into narrow ridges with crests between the
points of the grid. The first search climbs from one start in each part of the zone, and can miss the crest that counts.
The proof of `certify` has found such states. In simple shear of −1e-5 the first search called the Seth–Hill model of
order 1 stable (−1e-11, 2D), but a wave has the margin 4e-9. In simple shear of −0.1 % it called the extended model
stable (−6e-8, 3D), but a wave has the margin 4e-6. The mirror images, +1e-5 and +0.1 %, were right.

Doubtful states therefore climb again, from the best local maxima of the grid and from waves around the half-reciprocal
points (components 0 or π/h) and around k = 0. In shear, crests lie off these points at a distance that falls with the
fourth root of the load.
"""

import itertools
from functools import lru_cache

import numpy as np

from ..bloch import laplacian, squared_chord
from ..brillouin import Zone, half_reciprocal_points, largest_eigenvalue
from ..certificate.enclosed import quotients
from ..climb import climb_series
from ..cosine_series import entries, packed, works
from .waves import Found, sampled

DOUBT = 1e-3  # Margins below it [-] are searched again. The false verdicts found had margins below 1e-5.
_DISTANCES = (0.02, 0.05, 0.12, 0.3)  # [1/spacing]
_CRESTS, _NEAR = 24, 8  # numbers of starts of both kinds
_STEP = 0.1  # longest step of the climb [1/spacing]


@lru_cache(maxsize=4)
def _near_corners(dim: int) -> np.ndarray:
    """Waves (waves, dim) around k = 0 and the half-reciprocal points, along the axes and all diagonals."""
    ways = np.array([w for w in itertools.product((-1.0, 0.0, 1.0), repeat=dim) if w > (0.0,) * dim])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    shifts = (np.array(_DISTANCES)[:, None, None] * ways).reshape(-1, dim)  # Inversion gives the opposite ones.
    return np.concatenate([shifts, *(corner + shifts for corner in half_reciprocal_points(dim))])


def _crests(blocks: np.ndarray, offsets: np.ndarray, zone: Zone) -> np.ndarray:
    """The waves (_CRESTS, dim) of the best local maxima of the quotient of one state on the grid."""
    values, _ = sampled(packed(blocks), offsets, zone)
    top = largest_eigenvalue(entries(values, offsets.shape[1])) / laplacian(zone.grid)
    shape = [len(axis) + 2 for axis in zone.axes]
    box = np.full(shape, -np.inf)
    inner = tuple(slice(1, -1) for _ in shape)
    whole = np.full([n - 2 for n in shape], -np.inf)
    whole.reshape(-1)[zone.places] = top
    box[inner] = whole
    is_crest = np.isfinite(whole)
    for shift in itertools.product((-1, 0, 1), repeat=len(shape)):
        if any(shift):
            around = tuple(slice(1 + s, n - 1 + s) for s, n in zip(shift, shape, strict=True))
            is_crest &= whole >= box[around]
    crests = np.flatnonzero(is_crest.reshape(-1)[zone.places])
    best = crests[np.argsort(-top[crests])][:_CRESTS]
    return zone.grid[np.resize(best, _CRESTS)]


def _best_near_corners(blocks: np.ndarray, chords: np.ndarray) -> np.ndarray:
    """The best (_NEAR, dim) of the waves `_near_corners` for one state. `chords` are 4 sin²(o·x/2) of all of them."""
    x = _near_corners(blocks.shape[-1])
    A = -np.tensordot(chords, blocks, axes=1)
    quotient = np.linalg.eigvalsh(A)[:, -1] / laplacian(x)
    return x[np.argsort(-quotient)[:_NEAR]]


def looked_again(blocks: np.ndarray, offsets: np.ndarray, zone: Zone, found: Found) -> Found:
    """The results of a search, improved where the margin is nearly zero.

    `blocks` (states, offsets, dim, dim) are in units of M/h².
    """
    arrays = Found(*(np.array(part) for part in found))
    value, _ = quotients(blocks, offsets, *(np.asarray(part) for part in arrays[:3]))
    doubtful = np.flatnonzero(np.abs(value) < DOUBT)
    if not len(doubtful):
        return found
    some = (blocks[doubtful] + blocks[doubtful].transpose(0, 1, 3, 2)) / 2
    chords = squared_chord(_near_corners(offsets.shape[1]) @ offsets.T)
    x = np.stack([np.concatenate([_crests(B, offsets, zone), _best_near_corners(B, chords)]) for B in some])
    x, mode, q = climb_series(some, offsets, x, _STEP)
    row, lane = np.arange(len(some)), np.argmax(q, axis=1)
    better = q[row, lane] > value[doubtful]
    at, x, mode = doubtful[better], x[row, lane][better], mode[row, lane][better]
    waves, never = ((x, mode), (arrays.fast_x[at], arrays.fast_mode[at])), np.zeros(len(at), bool)
    growth, fastest = (works(some[better], offsets, y, never, v)[0] for y, v in waves)
    faster = at[growth > fastest]
    arrays.fast_x[faster], arrays.fast_mode[faster] = x[growth > fastest], mode[growth > fastest]
    arrays.x[at], arrays.mode[at], arrays.is_long[at] = x, mode, False
    return arrays
