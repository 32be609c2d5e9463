"""Report on the families of a set of points before they are made: counts, ties, the next shell, isolated points."""

from dataclasses import dataclass

import numpy as np

from .._internal.public import public_function
from .neighbour_search import checked_horizon, pairs_within
from .points import Points, check_body
from .ties import BAND, CLEAR, CutShell, cut_shell, tie_radius


@dataclass(frozen=True, repr=False)
class NeighbourReport:
    """Result of `neighbour_report`: the neighbours within a horizon. `print` shows a summary.

    The report covers bonds up to 1.5 horizons, or less in a periodic box that is not longer than 3 horizons.

    Attributes
    ----------
    count : array of int, shape (points,)
        Number of neighbours of each point.
    alone : array of bool, shape (points,)
        Whether a point has no neighbour.
    nearest : array, shape (points,)
        Distance of the nearest neighbour [length], inf if the report finds none.
    horizon : float
        Horizon δ [length].
    tie : float
        Rounding error [length] by which a bond may exceed the horizon and still belong to the family.
    at_horizon : int
        Number of bonds that are as long as the horizon to within `tie`.
    below, above : float
        Length of the longest bond within the horizon, and of the shortest bond beyond it [length]; 0 and inf if there
        is none.
    cut : CutShell or None
        Shell of nearly equal bonds that the horizon cuts, if there is one. Then choose another horizon.

    Examples
    --------
    >>> report = pd.neighbour_report(pd.lattice((5, 4)), horizon=2.1)
    >>> int(report.count.min()), int(report.count.max()), report.spacing
    (5, 11, 1.0)
    >>> report.below, round(report.above, 3)
    (2.0, 2.236)
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
        """Median distance of nearest neighbours [length]."""
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
            lines.append(f"the horizon cuts a shell: {self.cut}; a horizon of {CLEAR * self.horizon:.6g} would not")
        return "\n".join(lines)


@public_function
def neighbour_report(points: Points, horizon: float) -> NeighbourReport:
    """Report counts, ties and the next shell of the families that `families(points, horizon)` would make.

    Use it to choose a horizon for points from a file.

    Parameters
    ----------
    points : Points
        The body, from `cloud`, `lattice` and so on.
    horizon : float
        Horizon δ [length].

    Returns
    -------
    NeighbourReport
        Numbers of neighbours, isolated points, lengths next to the horizon, and a shell that the horizon cuts.

    Raises
    ------
    ValueError
        If the horizon is not finite and > 0, points coincide, or a periodic box is not longer than two horizons.

    Examples
    --------
    >>> print(pd.neighbour_report(pd.lattice((5, 4)), horizon=2.1))
    20 points, 77 bonds; horizon 2.1, 2.1 spacings
    neighbours of a point: 5 to 11, median 7
    longest bond within 2, shortest beyond 2.23607
    bonds as long as the horizon, to within 2.1e-09: 0
    """
    check_body("points", points)
    horizon = checked_horizon(horizon)
    radius = tie_radius(points, horizon)
    wide = 1.5 * horizon
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
