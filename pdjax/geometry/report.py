"""What the families of a set of points would be, before they are made: counts, ties, the next shell, lonely points."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.public import public_function
from .neighbour_search import checked_horizon, pairs_within
from .points import Points, check_body
from .ties import BAND, CLEAR, CutShell, cut_shell, tie_radius


@dataclass(frozen=True, repr=False)
class NeighbourReport:
    """The answer of `neighbour_report`; `print` it for words.

    count (points,) neighbours within the horizon; alone (points,) whether a point has none; nearest (points,) distance
    of the nearest neighbour [length], inf beyond 1.5 horizons; horizon [length]; tie [length]: how far beyond the
    horizon a bond may be and still count, for its length is known no better; at_horizon: bonds that are as long as the
    horizon to within `tie`; below, above [length]: the longest bond within the horizon, the shortest one beyond
    (0 and inf where there is none up to 1.5 horizons); cut: the shell that the horizon cuts, or None.
    """

    count: np.ndarray
    alone: np.ndarray
    nearest: np.ndarray
    horizon: float
    tie: float
    at_horizon: int
    below: float
    above: float
    cut: CutShell | None

    @property
    def spacing(self) -> float:
        """The median distance of nearest neighbours [length]."""
        return float(np.median(self.nearest))

    def __repr__(self) -> str:
        count, ratio = self.count, self.horizon / self.spacing
        lines = [
            f"{len(count)} points, {count.sum() // 2} bonds; horizon {self.horizon:.6g}, {ratio:.4g} spacings",
            f"neighbours of a point: {count.min()} to {count.max()}, median {np.median(count):g}",
            f"longest bond within {self.below:.6g}, shortest beyond {self.above:.6g}",
            f"bonds as long as the horizon, to within {self.tie:.2g}: {self.at_horizon}",
        ]
        if self.alone.any():
            lines.append(f"without a neighbour: {self.alone.sum()} points, the first is point {np.argmax(self.alone)}")
        if self.cut is not None:
            lines.append(f"the horizon cuts a shell: {self.cut}; {CLEAR * self.horizon:.6g} would not")
        return "\n".join(lines)


@public_function
def neighbour_report(points: Points, horizon: float) -> NeighbourReport:
    """Counts, ties and the next shell of the families that `families(points, horizon)` would make.

    Arguments: points of any dim; horizon δ [length].  Returns: `NeighbourReport`.
    Raises: ValueError for a horizon that is not finite and > 0, coinciding points, a periodic box not longer than two
        horizons.
    """
    check_body("points", points)
    horizon = checked_horizon(horizon)
    radius = tie_radius(points, horizon)
    wide: Any = 1.5 * horizon
    if points.period is not None and min(points.period) <= 2 * wide:
        wide = max(radius, min(horizon * (1 + BAND), 0.499 * min(points.period)))
    i, j, vectors = pairs_within(points, wide)
    lengths = np.linalg.norm(vectors, axis=1)
    nearest = np.full(len(points), np.inf)
    for end in (i, j):
        np.minimum.at(nearest, end, lengths)
    within = lengths <= radius
    count = np.bincount(np.concatenate([i[within], j[within]]), minlength=len(points))
    tie = radius - horizon
    return NeighbourReport(
        count,
        count == 0,
        nearest,
        horizon,
        tie,
        int((abs(lengths - horizon) <= tie).sum()),
        float(lengths[within].max(initial=0.0)),
        float(lengths[~within].min(initial=np.inf)),
        cut_shell(lengths, points, horizon),
    )
