"""Bonds as long as the horizon: whose family they belong to must not depend on rounding.

On a lattice with a horizon of whole spacings many bonds are exactly as long as the horizon. Their computed lengths are
off by what the coordinates were rounded by: a coordinate of size |X| in floating point is known to eps |X|, so a length
is known to √dim eps |X|, however short it is. Lengths up to `tie_radius` count as within the horizon.

Coordinates with fewer digits than their dtype, read from a text file, are off by more than that. Then the bonds of one
shell scatter to both sides of the horizon, and points that look alike get different families. `cut_shell` finds it.
"""

import math
from typing import NamedTuple

import numpy as np

from .bonds import TIE
from .points import Points

BAND = 0.02  # of the horizon, to either side: where a cut shell is looked for
CLEAR = 1.005  # horizons: beyond a shell that it cuts, and short of the next (3 spacings become 3.015)
GAP = 4e-3  # of the horizon: lengths nearer to each other than this are of one shell


def coordinate_precision(body: Points) -> float:
    """To how much the coordinates are known [length]: by their size and dtype."""
    return max(body.precision, float(np.finfo(float).eps * np.abs(body.positions).max()))


def tie_radius(body: Points, horizon: float) -> float:
    """The length up to which a bond is within the horizon [length]: the horizon and what rounding may have added."""
    return horizon * (1 + TIE) + 2 * math.sqrt(body.dim) * coordinate_precision(body)


class CutShell(NamedTuple):
    """Bonds of nearly one length, some within the horizon and some beyond."""

    shortest: float
    longest: float
    within: int
    beyond: int

    def __str__(self) -> str:
        return (
            f"{self.within + self.beyond} bonds have lengths from {self.shortest:.6g} to {self.longest:.6g}, and the"
            f" horizon takes {self.within} of them and leaves {self.beyond}"
        )


def cut_shell(lengths: np.ndarray, body: Points, horizon: float) -> CutShell | None:
    """The shell that the horizon cuts, if there is one, from all lengths up to (1 + BAND) horizons.

    A shell stands alone: nothing else is within GAP of it. Points at random have no shells.
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
