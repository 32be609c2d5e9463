"""The result of an audit: what was found, where, and the verdict."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

VERDICTS = ("trusted", "doubtful", "untrusted")


class Finding(NamedTuple):
    """What one check has found.

    Attributes
    ----------
    check : str
        Name of the check, such as "zero-energy mode".
    score : float
        1 to 2: doubtful; from 2 on: untrusted.
    points : int or None
        Number of points where the score is at least 1. None for a check of the whole body.
    point : int or None
        The worst point.
    words : str
        What was found there.

    Examples
    --------
    >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> checkerboard = 0.01 * (-1.0) ** np.indices((6, 5)).sum(axis=0).reshape(-1, 1) * np.ones(2)
    >>> pd.audit(model, families, checkerboard).findings[0].check
    'zero-energy mode'
    """

    check: str
    score: float
    points: int | None
    point: int | None
    words: str


class Place(NamedTuple):
    """One of the worst places of a body: a point, its position [length], its score, and what the worst check says."""

    point: int
    position: np.ndarray
    score: float
    check: str
    words: str


@dataclass(frozen=True, repr=False)
class Audit:
    """Result of `audit`. `print` shows the verdict, what was found, and the three worst places.

    Attributes
    ----------
    findings : tuple of Finding
        What the checks have found, the worst first.
    score : array, shape (points,)
        Largest score of all checks of points: from 1 on doubtful, from 2 on untrusted. The verdict also asks how many
        points have this score, see `pdjax.trust.checks`.
    zero_energy : array, shape (points,)
        Energy that a penalty of strength 1 on zero-energy modes would hold, divided by itself plus ψ(F̄) [-].
    non_affine : array, shape (points,)
        Non-affine part of the squared bond deformation [-], after Falk and Langer.
    alternation : array, shape (points,)
        1 where neighbours deviate in opposite directions, −1 where they deviate alike.
    det : array, shape (points,)
        Determinant of F̄ [-].
    shape_ratio : array, shape (points,)
        Smallest divided by largest eigenvalue of the shape tensor of the family [-].
    margin : array, shape (points,), or None
        Margin of the infinite lattice under the point's own stretch: positive is unstable.
    critical_factor : array, shape (points,), or None
        Factor of the point's own strain at which that lattice becomes unstable; inf beyond 4.
    binning_error : float
        Largest error of the margins from binning that was measured.
    positive : int or None
        Number of positive eigenvalues of the Jacobian of the body, free rigid motions excluded.
    eigenvalue : float or None
        Its largest eigenvalue [force/length^(dim+1)].
    mode : array, shape (points, dim), or None
        Mode of that eigenvalue, of unit length.
    force_error : float or None
        Largest difference from the given forces, divided by the largest given force.
    notes : tuple of str
        What was approximated or left out.
    displacement : array, shape (points, dim)
        The displacement that was judged [length].
    stretches : tuple of float
        Smallest and largest principal stretch of all points [-].
    time : float or None
        Time of the state, where it belongs to a run.

    Examples
    --------
    A plate that is stretched by 1 % can be trusted.

    >>> body = pd.lattice((6, 5))
    >>> families = pd.families(body, horizon=3.0)
    >>> stretched = body.positions * np.array([0.01, -0.0025])
    >>> state = pd.audit(pd.BondLevel(pd.LinearElastic(1.0, 1.0)), families, stretched)
    >>> state.verdict, state.positive, bool(state.margin.max() < 0)
    ('trusted', 0, True)
    """

    findings: tuple[Finding, ...]
    score: np.ndarray
    zero_energy: np.ndarray
    non_affine: np.ndarray
    alternation: np.ndarray
    det: np.ndarray
    shape_ratio: np.ndarray
    margin: np.ndarray | None
    critical_factor: np.ndarray | None
    binning_error: float
    positive: int | None
    eigenvalue: float | None
    mode: np.ndarray | None
    force_error: float | None
    places: tuple[Place, ...]
    notes: tuple[str, ...]
    displacement: np.ndarray = field(repr=False)
    stretches: tuple[float, float]
    time: float | None = None

    @property
    def verdict(self) -> str:
        """The verdict "trusted", "doubtful" or "untrusted"."""
        worst = max((found.score for found in self.findings), default=0.0)
        return VERDICTS[min(int(worst), 2)]

    @property
    def trusted(self) -> bool:
        """True unless the verdict is "untrusted"."""
        return self.verdict != "untrusted"

    @cached_property
    def fields(self) -> dict[str, np.ndarray]:
        """Arrays (points, …) by name, for `pdjax.export.write_vtk` and pictures."""
        named = {
            "displacement": self.displacement,
            "score": self.score,
            "zero_energy": self.zero_energy,
            "non_affine": self.non_affine,
            "alternation": self.alternation,
            "det_F": self.det,
            "shape_ratio": self.shape_ratio,
            "margin": self.margin,
            "critical_factor": self.critical_factor,
            "worst_mode": self.mode,
        }
        return {name: values for name, values in named.items() if values is not None}

    @property
    def summary(self) -> str:
        """The verdict, the findings, the three worst places and the notes, as text."""
        lines = [f"{self.verdict}: " + ("nothing was found" if not self.findings else _count(self.findings))]
        for found in self.findings:
            where = f" at {found.points} points" if found.points is not None else ""
            lines.append(f"  {found.check}{where}: {found.words}")
        if self.places:
            lines.append("worst places:" if self.findings else "places nearest to a limit:")
        for place in self.places:
            at = ", ".join(f"{x:.4g}" for x in place.position)
            lines.append(f"  point {place.point} at ({at}), score {place.score:.2f}: {place.words}")
        low, high = self.stretches
        largest = np.linalg.norm(self.displacement, axis=1).max()
        lines.append(f"largest displacement {largest:.4g}; principal stretches from {low:.6g} to {high:.6g}")
        if self.positive is not None:
            kind = "stable" if self.positive == 0 else "unstable"
            lines.append(
                f"body: {kind}, {self.positive or 'no'} positive eigenvalues of its Jacobian, the largest is"
                f" {self.eigenvalue:.4g}"
            )
        lines += [f"note: {note}" for note in self.notes]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary

    def as_dict(self) -> dict[str, Any]:
        """The numbers of the audit without the fields of points, for JSON.

        Returns
        -------
        dict
            The verdict, the findings, the worst places, extremes of the fields, the body and the notes.

        Examples
        --------
        >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
        >>> state = pd.audit(pd.BondLevel(pd.LinearElastic(1.0, 1.0)), families, np.zeros((30, 2)))
        >>> state.as_dict()["verdict"]
        'trusted'
        """
        extremes = {
            name: {"min": float(np.nanmin(values)), "max": float(np.nanmax(values))}
            for name, values in self.fields.items()
            if values.ndim == 1 and np.isfinite(values).any()
        }
        return {
            "verdict": self.verdict,
            "time": self.time,
            "findings": [found._asdict() for found in self.findings],
            "places": [place._asdict() | {"position": place.position.tolist()} for place in self.places],
            "fields": extremes,
            "stretches": list(self.stretches),
            "largest_displacement": float(np.linalg.norm(self.displacement, axis=1).max()),
            "positive": self.positive,
            "eigenvalue": self.eigenvalue,
            "binning_error": self.binning_error,
            "force_error": self.force_error,
            "notes": list(self.notes),
        }


def _count(findings: tuple[Finding, ...]) -> str:
    return f"{len(findings)} finding{'s' if len(findings) > 1 else ''}"
