"""The result of `certify`: the margin of a homogeneous state between two proved bounds."""

import equinox as eqx
import numpy as np

from ..brillouin import in_zone
from ..lattice_states import States
from .enclosed import FLOOR, Enclosed


class Certificate(eqx.Module):
    """The margin of a homogeneous state between two proved bounds, the result of `certify`.

    Attributes
    ----------
    lower, upper : float
        Bounds of the margin [-], positive is unstable. For a model without an energy they enclose the largest
        eigenvalue of the symmetric part of the symbol, divided by M κ².
    proved : bool
        Whether the width upper − lower has reached the tolerance.
    verdict : str
        What is proved: "stable", "unstable", "marginal within tol" if both bounds are within 2e-9 of zero (for any
        tolerance), "undecided within tol" otherwise. For a model without an energy "no divergence" or "undecided".
    boxes : int
        Number of boxes of the Brillouin zone that were bounded.
    wave_vector : array, shape (dim,)
        Wave vector k [1/length] of the lower bound. The zero vector stands for the limit k → 0 along `direction`.
    direction : array, shape (dim,)
        Unit vector along k.
    mode : array, shape (dim,)
        Polarisation of the lower bound, a unit vector.
    missed : bool
        Whether the proof has found a larger margin than the search of `stability`.
    tol : float
        Relative tolerance that was asked for.
    hyperelastic : bool
        Whether the model has an energy.
    regions : array, shape (boxes, corners, dim), or None
        Corners x = h k [-] of the boxes that are done, if they were asked for. In 2D the corners 0, 1, 3, 2 go around a
        box. Half of the corners of a cone of long waves are at x = 0. `boxes` also counts those that were divided.

    Examples
    --------
    A zero-energy wave has the margin 0, which no proof can tell from a tiny one.

    >>> model, family = pd.Correspondence(pd.LinearElastic(1.0, 1.0)), pd.lattice_family(1, 2)
    >>> proof = pd.certify(model, family, np.eye(1))
    >>> proof.verdict, proof.upper < 1e-8
    ('marginal within tol', True)
    """

    lower: float
    upper: float
    proved: bool
    boxes: int
    wave_vector: np.ndarray
    direction: np.ndarray
    mode: np.ndarray
    missed: bool
    tol: float
    hyperelastic: bool
    regions: np.ndarray | None = None

    @property
    def verdict(self) -> str:
        """What is proved, in words."""
        if not self.hyperelastic:
            return "no divergence" if self.upper < 0 else "undecided"
        if self.upper < 0:
            return "stable"
        if self.lower > 0:
            return "unstable"
        near = max(-self.lower, self.upper) <= 2 * FLOOR
        return "marginal within tol" if near else "undecided within tol"

    def __str__(self) -> str:
        lines = [f"{self.verdict}: {self.lower:.6g} <= margin <= {self.upper:.6g}"]
        if not self.hyperelastic:
            lines.append("  of the symmetric part of the symbol; flutter is not excluded")
        lines.append(f"  {'proved' if self.proved else 'not proved to the tolerance'} with {self.boxes} boxes")
        if not self.proved:
            lines.append("  the budget ended; allow more boxes or seconds, or a larger tol")
        if self.missed:
            lines.append("  the proof has found a worse wave than the search of the zone")
        return "\n".join(lines)

    __repr__ = __str__


def certificate_of(found: Enclosed, states: States, tol: float, hyperelastic: bool) -> Certificate:
    """The certificate of the only state of `states`."""
    x, mode = found.x[0], found.mode[0]
    k = np.zeros_like(x) if found.is_long[0] else in_zone(x) / states.spacing
    return Certificate(
        lower=float(found.lower[0]),
        upper=float(found.upper[0]),
        proved=bool(found.proved[0]),
        boxes=int(found.boxes[0]),
        wave_vector=k,
        direction=x / np.linalg.norm(x),
        mode=mode / np.linalg.norm(mode),
        missed=bool(found.missed[0]),
        tol=tol,
        hyperelastic=hyperelastic,
        regions=found.regions,
    )
