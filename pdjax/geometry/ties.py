"""Ties: bonds as long as the horizon, whose family must not depend on rounding.

If the horizon of a lattice is a whole number of spacings, many bonds are exactly as long as the horizon. Their computed
lengths have rounding errors: a floating-point coordinate of size |X| has the error eps |X|, so a length has the error
√dim eps |X|, however short it is. Lengths up to `tie_radius` therefore count as within the horizon.

Coordinates from a text file may have fewer digits than their dtype, and so larger errors. The lengths of one shell of
neighbours then scatter to both sides of the horizon, and points with the same surroundings get different families.
`cut_shell` detects this.
"""

import math
from typing import NamedTuple

import numpy as np

from .bonds import TIE
from .points import Points

BAND = 0.02  # `cut_shell` looks at lengths that differ from the horizon by at most this fraction of it
CLEAR = 1.005  # advised horizon over a horizon that cuts a shell: beyond this shell, short of the next (3.015 for 3)
GAP = 4e-3  # lengths that differ by less than this fraction of the horizon belong to one shell


def coordinate_precision(body: Points) -> float:
    """Error of the coordinates [length], from their size and dtype."""
    return max(body.precision, float(np.finfo(float).eps * np.abs(body.positions).max()))


def tie_radius(body: Points, horizon: float) -> float:
    """Largest length of a bond within the horizon [length]: the horizon plus possible rounding errors."""
    return horizon * (1 + TIE) + 2 * math.sqrt(body.dim) * coordinate_precision(body)


class CutShell(NamedTuple):
    """A shell of bonds of nearly equal length, some within the horizon and some beyond.

    `shortest` and `longest` are lengths [length]; `within` and `beyond` count the bonds.
    """

    shortest: float
    longest: float
    within: int
    beyond: int

    def __str__(self) -> str:
        return (
            f"{self.within + self.beyond} bonds have lengths from {self.shortest:.6g} to {self.longest:.6g};"
            f" {self.within} of them are within the horizon and {self.beyond} beyond"
        )


def cut_shell(lengths: np.ndarray, body: Points, horizon: float) -> CutShell | None:
    """Find the shell that the horizon cuts, or None, from all lengths up to (1 + BAND) horizons.

    A shell is a group of lengths that is separated from all others by more than GAP. Random points have no shells.
    """
    radius = tie_radius(body, horizon)
    near = np.sort(lengths[abs(lengths - horizon) <= BAND * horizon])
    within = int(np.searchsorted(near, radius, side="right"))
    if within in (0, len(near)) or len(near) < len(body) // 2:
        return None
    apart = np.flatnonzero(np.diff(near) > GAP * horizon) + 1
    begin = max((int(a) for a in apart if a <= within), default=0)
    end = min((int(a) for a in apart if a >= within), default=len(near))
    low, high = near[begin], near[end - 1]
    at_edge = low < horizon * (1 - BAND + GAP) or high > horizon * (1 + BAND - GAP)
    if begin == within or end == within or at_edge or end - begin < len(body) // 2:
        return None
    return CutShell(float(low), float(high), within - begin, end - within)
