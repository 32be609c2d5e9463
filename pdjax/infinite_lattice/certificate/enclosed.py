"""Enclosures of the margins of linearised states: a lower bound from the best wave known, an upper bound by proof.

The search of the Brillouin zone proposes the best wave. Its quotient vᵀĴv/(M κ²), less the bound of its rounding
error, is a lower bound of the margin, whatever the search has missed. The proof (`proof`) takes the level just above
it. A wave that refutes the proof is a wave that the search has missed. Then a climb starts there, and the proof starts
again.
"""

from typing import NamedTuple

import numpy as np

from ..brillouin import in_zone
from ..climb import climb_series
from ..cosine_series import works
from .enclosure import UNIT
from .proof import prove

FLOOR = 1e-9  # Smallest width of an enclosure [-]. Rounding takes up to 1e-10 for 3D lattices with N = 3.
_STEP = np.pi / 4  # longest step of the climb [1/spacing]
_ROUNDS = 8  # Every round climbs to a higher local maximum. More than two were never seen.


class Enclosed(NamedTuple):
    """Enclosures of the margins of several states. Every array has a leading axis of states.

    `lower` and `upper` enclose the margin. `x` [1/spacing] and `mode` are wave and polarisation of the lower bound, and
    `is_long` tells that x is the direction of the limit k → 0. `boxes` counts the boxes, `proved` tells that the width
    has been reached, and `missed` that the proof has found a higher wave than the one proposed. `regions` are those
    of a `Proof`.
    """

    lower: np.ndarray
    upper: np.ndarray
    x: np.ndarray
    is_long: np.ndarray
    mode: np.ndarray
    boxes: np.ndarray
    proved: np.ndarray
    missed: np.ndarray
    regions: np.ndarray | None


def quotients(blocks: np.ndarray, offsets: np.ndarray, x: np.ndarray, is_long: np.ndarray, mode: np.ndarray):
    """vᵀĴv/κ² of every state at one wave, and a bound of its rounding error, both (states,)."""
    # Any wave gives a lower bound. Near a multiple of 2π rounding would be large relative to κ².
    work, kappa2 = works(blocks, offsets, np.where(is_long[:, None], x, in_zone(x)), is_long, mode)
    value = work / ((mode**2).sum(axis=1) * kappa2)
    size = np.linalg.norm(blocks, axis=(2, 3)) @ np.abs(offsets).sum(axis=1) ** 2
    return value, 4 * (len(offsets) + 64) * UNIT * size


def enclose(
    blocks: np.ndarray,
    offsets: np.ndarray,
    x: np.ndarray,
    is_long: np.ndarray,
    mode: np.ndarray,
    tol: float,
    boxes: int,
    seconds: float = np.inf,
    show: bool = False,
    keep: bool = False,
) -> Enclosed:
    """Enclose the margins of states to a width of tol × |margin|, from the best waves known.

    `blocks` (states, offsets, dim, dim) are in units of M/h². `boxes` is the largest number of boxes for each state.
    """
    states = len(blocks)
    x, is_long, mode = (np.array(part) for part in (x, is_long, mode))
    lower, upper = np.full(states, -np.inf), np.full(states, np.inf)
    used, missed, done = np.zeros(states, int), np.zeros(states, bool), np.zeros(states, bool)
    regions = None
    open_ = np.arange(states)
    for _ in range(_ROUNDS):
        part = blocks[open_]
        value, rounding = quotients(part, offsets, x[open_], is_long[open_], mode[open_])
        lower[open_] = value - rounding
        width = np.maximum(tol * np.abs(value), FLOOR)
        level = value + np.maximum(width - 2 * rounding, 2 * rounding)
        proof = prove(part, offsets, level, boxes, seconds, show, keep)
        used[open_] += proof.boxes
        upper[open_], done[open_] = proof.upper, proof.done
        regions = proof.regions
        found = proof.value > level
        open_ = open_[found]
        if not len(open_):
            break
        missed[open_], is_long[open_] = True, False
        wave, softest, _ = climb_series(blocks[open_], offsets, proof.wave[found][:, None], _STEP)
        x[open_], mode[open_] = wave[:, 0], softest[:, 0]
    return Enclosed(lower, upper, x, is_long, mode, used, done, missed, regions)
