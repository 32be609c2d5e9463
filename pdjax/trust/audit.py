"""`audit`: whether a computed state of a body can be trusted, point by point and as a whole.

The state may come from pdjax or from another code. `audit` needs the points, the displacement and the model that the
code claims to use. It asks three questions:

* Do the points deform smoothly, or in zero-energy modes (`pdjax.trust.point_measures`)?
* Is the lattice stable under the stretch of every point (`pdjax.trust.own_lattice`)?
* Is the body itself stable, rigid motions excluded (`pdjax.finite_body.free_spectrum`)?

`pdjax.trust.checks` turns the answers into a verdict.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from .._internal.checks import finite
from .._internal.public import public_function
from ..finite_body.free_spectrum import FreeSpectrum, free_spectrum
from ..force.fields import body_state
from ..force.operator import force_density
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..models.control import micromodulus
from .checks import BODY_CHECKS, POINT_CHECKS, Evidence, Forces
from .own_lattice import Material, OwnLattice, materials, own_lattice, own_lattice_family
from .point_measures import PointMeasures, alternation, point_measures

VERDICTS = ("trusted", "doubtful", "untrusted")
PLACES = 3


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
    >>> [found.check for found in pd.audit(model, families, checkerboard).findings]
    ['zero-energy mode']
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
        if self.positive is not None:
            lines.append(f"body: {self.positive} positive eigenvalues, the largest eigenvalue is {self.eigenvalue:.4g}")
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
            "positive": self.positive,
            "eigenvalue": self.eigenvalue,
            "binning_error": self.binning_error,
            "force_error": self.force_error,
            "notes": list(self.notes),
        }


def _count(findings: tuple[Finding, ...]) -> str:
    return f"{len(findings)} finding{'s' if len(findings) > 1 else ''}"


class Auditor:
    """What all audits of one body share: its lattice, its materials and their moduli."""

    def __init__(self, model: AbstractModel, families: Families, held: np.ndarray):
        self.model, self.families, self.held = model, families, held
        self.family, words = own_lattice_family(families)
        self.materials: list[Material] = materials(model, families, self.family)
        self.notes = (words,) if words else ()
        points, dim = len(families), families.dim
        horizon = np.broadcast_to(np.asarray(families.horizon, float), (points,))
        bulk, self.modulus = np.empty(points), np.empty(points)
        for part in self.materials:
            bulk[part.mask], self.modulus[part.mask] = part.bulk, part.modulus
        self.stiffness = micromodulus(bulk, horizon, dim) / horizon
        self.volumes = np.asarray(families.volumes, float)
        self.periodic = _is_periodic(families)
        self.bonds = int(np.median(np.asarray(families.count)))
        self.positions = np.asarray(families.positions, float)
        extent = np.ptp(self.positions, axis=0).max() if points > 1 else 0.0
        self.size = float(extent / np.asarray(self.family.spacing)) + 1

    def measures(self, u: np.ndarray, F: np.ndarray | None) -> PointMeasures:
        """The measures of all points that need no eigenvalue."""
        return point_measures(self.model, self.families, u, F, self.stiffness, self.modulus)

    def lattice(self, points: PointMeasures, path: bool) -> OwnLattice:
        """Margins and, if `path` is True, critical factors of all points."""
        G = points.stretch if self.model.objective else points.gradient
        G = np.where(
            points.det[:, None, None] > 0, G, np.nan
        )  # U of an inverted family would be that of its mirror image
        return own_lattice(self.family, self.materials, G, path)

    def body(self, u: np.ndarray, F: np.ndarray | None) -> FreeSpectrum:
        """The end of the spectrum of the body."""
        return free_spectrum(self.model, self.families, u, F, self.held, self.periodic)

    def evidence(
        self,
        points: PointMeasures,
        lattice: OwnLattice | None = None,
        body: FreeSpectrum | None = None,
        forces: Forces | None = None,
    ) -> Evidence:
        """All that the checks read."""
        roughness = 0.0
        if body is not None and body.mode is not None:
            weight = (body.mode**2).sum(axis=1)
            roughness = float(weight @ alternation(self.families, body.mode) / weight.sum())
        return Evidence(points, lattice, body, roughness, forces, self.volumes, self.size, self.families.dim, self.held)

    def judged(
        self,
        u: np.ndarray,
        points: PointMeasures,
        lattice: OwnLattice | None = None,
        body: FreeSpectrum | None = None,
        forces: Forces | None = None,
        time: float | None = None,
    ) -> Audit:
        """The verdict on what was measured."""
        evidence = self.evidence(points, lattice, body, forces)
        findings, scores = [], {}
        for check in POINT_CHECKS:
            score = check.score(evidence)
            if score is None:
                continue
            scores[check] = score
            worst, total = int(np.argmax(score)), check.of_state(score, self.bonds)
            if total >= 1:
                words = f"point {worst}: {check.words(evidence, worst)}"
                if score[worst] >= 2 > total:
                    words += ". Too few points have a score of 2 for the verdict untrusted"
                findings.append(Finding(check.name, total, int((score >= 1).sum()), worst, words))
        for whole in BODY_CHECKS:
            found = whole.judge(evidence)
            if found is not None:
                findings.append(Finding(whole.name, found[0], None, None, found[1]))
        findings.sort(key=lambda found: -found.score)
        notes = list(self.notes)
        if body is not None and body.reason:
            notes.append(f"the spectrum of the body was not computed: {body.reason}")
        if lattice is not None and lattice.bins < len(u):
            notes.append(
                f"margins are those of {lattice.bins} bins of stretches; the error of binning is {lattice.error:.1g}"
                " where it was measured"
            )
        return Audit(
            tuple(findings),
            np.max(list(scores.values()), axis=0),
            points.zero_energy,
            points.non_affine,
            points.alternation,
            points.det,
            points.shape_ratio,
            lattice.margin if lattice is not None else None,
            lattice.critical_factor if lattice is not None else None,
            lattice.error if lattice is not None else 0.0,
            body.positive if body is not None else None,
            body.eigenvalue if body is not None else None,
            body.mode if body is not None else None,
            float(np.nanmax(forces.error)) if forces is not None else None,
            self._places(evidence, scores),
            tuple(notes),
            u,
            time,
        )

    def _places(self, evidence: Evidence, scores: dict) -> tuple[Place, ...]:
        """The points of the largest scores that are more than two horizons apart."""
        checks, table = list(scores), np.array(list(scores.values()))
        left = table.max(axis=0)
        places: list[Place] = []
        reach = 2 * float(np.max(np.asarray(self.families.horizon)))
        while len(places) < PLACES and np.isfinite(left).any() and left.max() > 0:
            at = int(np.argmax(left))
            check = checks[int(np.argmax(table[:, at]))]
            words = check.words(evidence, at)
            places.append(Place(at, self.positions[at], float(table[:, at].max()), check.name, words))
            left = np.where(np.linalg.norm(self.positions - self.positions[at], axis=1) <= reach, -np.inf, left)
        return tuple(places)


def _is_periodic(families: Families) -> bool:
    """Whether a bond crosses the edge of a periodic box: its vector is not the difference of its points."""
    positions, neighbours = np.asarray(families.positions, float), np.asarray(families.neighbours)
    limit = 1e-3 * float(np.min(np.asarray(families.horizon)))
    real = np.asarray(families.weight) > 0
    return any(
        bool((np.abs(positions[j] - positions - xi)[bond] > limit).any())
        for j, xi, bond in zip(neighbours.T, np.asarray(families.xi).transpose(1, 0, 2), real.T, strict=True)
    )


def held_components(held: Any, families: Families) -> np.ndarray:
    """`held` as a mask (points, dim). None holds nothing; a mask (points,) holds all components of its points."""
    shape = (len(families), families.dim)
    if held is None:
        return np.zeros(shape, bool)
    mask = np.asarray(held)
    if mask.dtype != bool or mask.shape not in (shape, shape[:1]):
        raise ValueError(
            f"held must be a bool mask of shape {shape[:1]} or {shape}, True where the body is supported; got"
            f" {mask.dtype} of shape {mask.shape}"
        )
    return np.broadcast_to(mask[:, None], shape) if mask.ndim == 1 else mask


# Forces below this part of modulus/spacing are rounding errors of a state at rest; LAMMPS has 1e-16 (measured).
ROUNDING = 1e-12
# Given forces that differ by less than this part from a multiple of the model's are called a multiple.
MULTIPLE = 1e-3


def _forces(auditor: Auditor, u: np.ndarray, F: np.ndarray | None, force: Any, density: Any) -> Forces | None:
    if force is None and density is None:
        return None
    if force is not None and density is not None:
        raise ValueError("give force or given_density, not both: force is density times volume")
    name, families = "force" if force is not None else "given_density", auditor.families
    given = finite(name, force if force is not None else density)
    if given.shape != (len(families), families.dim):
        raise ValueError(f"{name} must have shape ({len(families)}, {families.dim}); got {given.shape}")
    own = np.asarray(force_density(auditor.model, families, u, F), float)
    noise = ROUNDING * auditor.modulus.max() / float(np.asarray(auditor.family.spacing))
    if force is not None:
        own, noise = own * auditor.volumes[:, None], noise * auditor.volumes.max()
    largest = max(float(np.linalg.norm(given, axis=1).max(initial=0.0)), float(noise))
    return Forces(np.linalg.norm(own - given, axis=1) / largest, _hint(own, given, float(noise)))


def _hint(own: np.ndarray, given: np.ndarray, noise: float) -> str:
    """What explains that the given forces are not those of the model: they are zero or a multiple of them."""
    largest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    if largest <= noise or not np.isfinite(largest):
        return ""
    if not given.any():
        return ". The given forces are all zero"
    own = own / largest
    factor = float((own * given).sum() / (own * own).sum())
    rest = float(np.linalg.norm(given - factor * own) / np.linalg.norm(given))
    if rest > MULTIPLE or abs(factor / largest - 1) < MULTIPLE:
        return ""
    return (
        f". The given forces are {factor / largest:.4g} times those of the model: check their sign, their unit, the"
        " constants of the law, and whether they are forces or densities"
    )


@public_function
def audit(
    model: AbstractModel,
    families: Families,
    u: Float[Any, "points dim"],
    *,
    F=None,
    held=None,
    force=None,
    given_density=None,
    margins: bool = True,
    body: bool = True,
) -> Audit:
    """Decide whether a computed state of a body can be trusted.

    Parameters
    ----------
    model : AbstractModel
        The material model with which the state was computed.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
    held : array of bool, shape (points,) or (points, dim), optional
        Supported points or components, such as `~scene.free`. The default supports nothing, and rigid motions do not
        count as instabilities. Pass it if there are clamps: the strain jumps at their edges.
    force : array, shape (points, dim), optional
        Internal forces V f [force] that another code has computed for this state. They are compared with pdjax's.
    given_density : array, shape (points, dim), optional
        The same as a force density f [force/length^dim].
    margins : bool, optional
        Whether to judge the infinite lattice under the stretch of every point. Default True.
    body : bool, optional
        Whether to compute the largest eigenvalue of the Jacobian of the body. Default True. It is left out for bodies
        of more than 60 000 unknowns in 2D and 15 000 in 3D, with a note.

    Returns
    -------
    Audit
        The verdict, what was found and where, and the measures of all points.

    Raises
    ------
    ValueError
        If an array has a wrong shape or is not finite, if the model cannot invert a shape tensor, or if the constants
        of the model take more than 8 values over the points.

    Notes
    -----
    `pdjax.trust.checks` lists the checks and their limits. For a body that is no lattice, margins are those of the
    lattice of spacing V^{1/dim}, and a note says so. A state may be trusted and still be wrong: the audit does not know
    the loads, and it does not compare with a finer discretisation.

    References
    ----------
    Silling 2017 (zero-energy penalty); Falk & Langer 1998 (non-affine displacement); Haynsworth 1968 (inertia).

    Examples
    --------
    Silling's model does not feel a checkerboard. The audit does.

    >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> checkerboard = 0.01 * (-1.0) ** np.indices((6, 5)).sum(axis=0).reshape(-1, 1) * np.ones(2)
    >>> state = pd.audit(model, families, checkerboard)
    >>> state.verdict, state.findings[0].check, float(state.zero_energy.max().round(1))
    ('untrusted', 'zero-energy mode', 1.0)
    """
    displacement, gradient = body_state(model, families, u, F)
    u, mean = np.asarray(displacement), None if gradient is None else np.asarray(gradient, float)
    auditor = Auditor(model, families, held_components(held, families))
    points = auditor.measures(u, mean)
    lattice = auditor.lattice(points, path=True) if margins else None
    spectrum = auditor.body(u, mean) if body else None
    return auditor.judged(u, points, lattice, spectrum, _forces(auditor, u, mean, force, given_density))
