"""Report on a set of points and a horizon, before the families are made.

`neighbour_report` answers the questions that points from a file raise. Does every point have neighbours? Do the bonds
join all points to one body? Do the bonds of every point span all directions? Does the horizon cut a shell of bonds? Do
the volumes fit the distances?

**Thin places.** The ratio of the smallest to the largest eigenvalue of the shape tensor K = Σ V ξ⊗ξ is 1 for a full
ball and 0 if all bonds lie in a line or a plane. Models that invert K amplify errors by the inverse of this ratio. On a
lattice with horizon 3 spacings the ratio is 0.45 at a corner in 2D and 0.28 in 3D, 0.13 and 0.10 at the corners of a
body of two layers, and 0 in a single layer. The least ratio of 8000 random points is 0.10 for the same horizon.
`THIN` = 0.03 lies below all of these except the single layer.
"""

from dataclasses import dataclass

import numpy as np

from .._internal.public import public_function
from .neighbour_search import checked_horizon
from .neighbour_sums import joining_horizon, nearest_distances, neighbour_sums
from .points import Points, check_body
from .ties import CLEAR, CutShell, cut_shell, tie_radius

THIN = 0.03  # a point is thin if the eigenvalues of its shape tensor have a smaller ratio
FEW = 1.5  # least horizon over V^(1/dim) that a point should have: with less, its family is that of N = 1
TOO_LONG = 1.5  # horizon over the longest distance in a body from which the two seem to have different units
MISFIT = 3.0  # V^(1/dim) over the nearest distance, or its inverse, beyond which the volumes do not fit the points


@dataclass(frozen=True, repr=False)
class NeighbourReport:
    """Result of `neighbour_report`: the neighbours within a horizon. `print` shows it in sentences.

    Attributes
    ----------
    count : array of int, shape (points,)
        Number of neighbours of each point.
    alone : array of bool, shape (points,)
        Whether a point has no neighbour.
    nearest : array, shape (points,)
        Distance of the nearest other point [length], inf if there is only one point.
    horizon : float
        Horizon δ [length].
    tie : float
        Rounding error [length] by which a bond may exceed the horizon and still belong to the family.
    at_horizon : int
        Number of bonds that are as long as the horizon to within `tie`.
    below, above : float
        Length of the longest bond within the horizon, and of the shortest bond beyond it [length]; 0 and inf if there
        is none. Bonds beyond 1.5 horizons are not looked for.
    cut : CutShell or None
        Shell of nearly equal bonds that the horizon cuts, if there is one. Then choose another horizon.
    piece : array of int, shape (points,)
        Number of the connected piece to which a point belongs. Piece 0 is the largest one.
    shape_ratio : array, shape (points,)
        Smallest over largest eigenvalue of the shape tensor K = Σ V ξ⊗ξ of each point [-]: 1 in a full family, 0 if the
        bonds do not span space or there are none. It is 1 in 1D.
    volumes : array, shape (points,)
        Volumes of the points [length^dim].
    joining : float
        Horizon [length] that joins all pieces to the largest one; 0 if there is one piece.
    dim : int
        Number of space dimensions.

    Examples
    --------
    >>> report = pd.neighbour_report(pd.lattice((5, 4)), horizon=2.1)
    >>> int(report.count.min()), int(report.count.max()), report.spacing
    (5, 11, 1.0)
    >>> report.below, round(report.above, 3), report.pieces, report.ok
    (2.0, 2.236, 1, True)
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
    piece: np.ndarray
    shape_ratio: np.ndarray
    volumes: np.ndarray
    joining: float
    dim: int

    @property
    def spacing(self) -> float:
        """Median distance of nearest neighbours [length]."""
        return float(np.median(self.nearest))

    @property
    def pieces(self) -> int:
        """Number of connected pieces. Points without neighbours are pieces too."""
        return int(self.piece.max()) + 1

    @property
    def piece_sizes(self) -> np.ndarray:
        """Number of points of each piece, from the largest to the smallest, shape (pieces,)."""
        return np.bincount(self.piece)

    @property
    def thin(self) -> np.ndarray:
        """Whether the bonds of a point nearly lie in a line or a plane: `shape_ratio` < 0.03, shape (points,).

        A point without neighbours is `alone` and not thin.
        """
        return (self.shape_ratio < THIN) & ~self.alone

    @property
    def cells(self) -> np.ndarray:
        """Edge length V^(1/dim) of the cell of each point [length], shape (points,)."""
        return self.volumes ** (1 / self.dim)

    @property
    def fields(self) -> dict[str, np.ndarray]:
        """Numbers of every point by name, each of shape (points,), for files and pictures.

        The names are neighbours, alone, thin, piece, shape_ratio, nearest, horizon_over_cell = δ/V^(1/dim) and
        horizon_over_nearest.
        """
        return {
            "neighbours": self.count,
            "alone": self.alone,
            "thin": self.thin,
            "piece": self.piece,
            "shape_ratio": self.shape_ratio,
            "nearest": self.nearest,
            "horizon_over_cell": self.horizon / self.cells,
            "horizon_over_nearest": self.horizon / self.nearest,
        }

    @property
    def advice(self) -> tuple[str, ...]:
        """What to change, in sentences. It is empty if nothing needs to be changed."""
        found = []
        if self.alone.any():
            need = self.nearest[self.alone].max()
            remedy = f"or use a horizon of at least {need:.6g}" if np.isfinite(need) else "or add points"
            found.append(
                f"{self.alone.sum()} of {len(self.count)} points have no neighbour; the first is point"
                f" {np.argmax(self.alone)}. Remove them, {remedy}."
            )
        several = int((self.piece_sizes > 1).sum())
        if several > 1:
            sizes = ", ".join(str(n) for n in self.piece_sizes[:5]) + (", …" if self.pieces > 5 else "")
            first = int(np.argmax(self.piece == 1))
            found.append(
                f"The bonds join the points to {self.pieces} separate pieces of {sizes} points. Pieces exert no force"
                f" on each other; point {first} is the first of piece 1. If they are one body, use a horizon of at"
                f" least {self.joining:.6g}; else support each piece."
            )
        if self.cut is not None:
            found.append(
                f"The horizon cuts a shell of bonds of nearly one length: {self.cut}. Use a horizon of"
                f" {CLEAR * self.horizon:.6g}."
            )
        if self.thin.any():
            found.append(
                f"{self.thin.sum()} points have bonds that nearly lie in a line or a plane (the eigenvalues of the"
                f" shape tensor have a ratio below {THIN}); the first is point {np.argmax(self.thin)}. Models that"
                " invert the shape tensor, such as Correspondence and SethHill, are inaccurate or refuse the body."
                " Give the body more layers of points, use a larger horizon, or use BondBased or LPS."
            )
        if len(self.count) > 2 and self.horizon > TOO_LONG * self.below and (self.count == len(self.count) - 1).all():
            found.append(
                f"Every point is a neighbour of all others: the horizon is {self.horizon:.6g}, and the longest distance"
                f" in the body is {self.below:.6g}. Check that both have the same unit, or use a smaller horizon."
            )
        found += self._advice_on_volumes()
        return tuple(found)

    def _advice_on_volumes(self) -> list[str]:
        cells, nearest = np.median(self.cells), self.spacing
        if not 1 / MISFIT <= cells / nearest <= MISFIT:
            return [
                f"The volumes do not fit the positions: V^(1/{self.dim}) is {cells:.4g} in the median, and the nearest"
                f" point is {nearest:.4g} away. Check the volumes, their unit, and the number of dimensions."
            ]
        few = self.horizon / self.cells < FEW
        if few.any() and self.horizon / cells >= FEW:
            return [
                f"{few.sum()} points have cells that are too large for this horizon: δ/V^(1/{self.dim}) is down to"
                f" {(self.horizon / self.cells).min():.3g}, first at point {np.argmax(few)}. Refine the points there or"
                f" use a horizon of {2 * self.cells.max():.4g}, two of the largest cells."
            ]
        return []

    @property
    def ok(self) -> bool:
        """Whether nothing needs to be changed: `advice` is empty."""
        return not self.advice

    def __repr__(self) -> str:
        count, V, ratio = self.count, self.volumes, self.shape_ratio
        lines = [
            f"{len(count)} points in {self.dim}D have {count.sum() // 2} bonds. The horizon is {self.horizon:.6g},"
            f" which is {self.horizon / self.spacing:.4g} spacings.",
            f"A point has {count.min()} to {count.max()} neighbours, {np.median(count):g} in the median.",
            f"The longest bond within the horizon has the length {self.below:.6g}, the shortest beyond"
            f" {self.above:.6g}.",
            f"{self.at_horizon} bonds are as long as the horizon, to within {self.tie:.2g}.",
        ]
        if self.pieces == 1:
            lines.append("All points are connected.")
        if np.ptp(V) <= 1e-9 * V.max():
            lines.append(f"All volumes are {V[0]:.6g}.")
        else:
            lines.append(
                f"Volumes lie between {V.min():.4g} and {V.max():.4g}, a ratio of {V.max() / V.min():.4g}, with the"
                f" median {np.median(V):.4g}. The horizon is {self.horizon / self.cells.max():.3g} to"
                f" {self.horizon / self.cells.min():.3g} cells."
            )
        if self.dim > 1:
            lines.append(
                f"Shape tensors: the smallest ratio of eigenvalues is {ratio.min():.2g}, at point {np.argmin(ratio)}; 0"
                " is a family in a line or a plane."
            )
        advice = [f"To do: {sentence}" for sentence in self.advice]
        return "\n".join([*lines, *(advice or ["Nothing needs to be changed."])])


@public_function
def neighbour_report(points: Points, horizon: float) -> NeighbourReport:
    """Report what to know of points and a horizon before `families(points, horizon)` is called.

    Use it to check points from a file and to choose their horizon.

    Parameters
    ----------
    points : Points
        The body, from `cloud`, `lattice` and so on.
    horizon : float
        Horizon δ [length].

    Returns
    -------
    NeighbourReport
        Numbers of neighbours, isolated points, connected pieces, thin places, the spread of the volumes, lengths next
        to the horizon, a shell that the horizon cuts, and advice in sentences.

    Raises
    ------
    ValueError
        If the horizon is not finite and > 0, points coincide, or a periodic box is not longer than two horizons.

    Notes
    -----
    Memory grows with the number of points, not with the number of bonds.

    Examples
    --------
    >>> print(pd.neighbour_report(pd.lattice((5, 4)), horizon=2.1))
    20 points in 2D have 77 bonds. The horizon is 2.1, which is 2.1 spacings.
    A point has 5 to 11 neighbours, 7 in the median.
    The longest bond within the horizon has the length 2, the shortest beyond 2.23607.
    0 bonds are as long as the horizon, to within 2.1e-09.
    All points are connected.
    All volumes are 1.
    Shape tensors: the smallest ratio of eigenvalues is 0.58, at point 8; 0 is a family in a line or a plane.
    Nothing needs to be changed.
    """
    check_body("points", points)
    horizon = checked_horizon(horizon)
    sums = neighbour_sums(points, horizon)
    values = np.linalg.eigvalsh(sums.shape)
    ratio = np.divide(values[:, 0], values[:, -1], out=np.zeros(len(points)), where=values[:, -1] > 0)
    return NeighbourReport(
        sums.count,
        sums.count == 0,
        nearest_distances(points),
        horizon,
        tie_radius(points, horizon) - horizon,
        sums.at_horizon,
        sums.below,
        sums.above,
        cut_shell(sums.lengths, points, horizon),
        sums.piece,
        np.maximum(ratio, 0.0),
        points.volumes,
        joining_horizon(points, sums.piece) if sums.piece.max() > 0 else 0.0,
        points.dim,
    )
