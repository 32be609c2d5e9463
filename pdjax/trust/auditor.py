"""What all audits of one body share, and how an audit comes to its verdict."""

import copy

import numpy as np

from ..finite_body.free_spectrum import FreeSpectrum, free_spectrum
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..models.control import micromodulus
from .checks import BODY_CHECKS, POINT_CHECKS, Evidence, Forces, PointCheck
from .own_lattice import Material, OwnLattice, materials, own_lattice, own_lattice_family
from .point_measures import PointMeasures, alternation, point_measures
from .verdict import Audit, Finding, Place

PLACES = 3


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
        self.clamped = _clamped(families, held)
        self.positions = np.asarray(families.positions, float)
        extent = np.ptp(self.positions, axis=0).max() if points > 1 else 0.0
        self.size = float(extent / np.asarray(self.family.spacing)) + 1

    def of_remaining(self, families: Families) -> "Auditor":
        """The auditor of the same body after bonds have broken. The lattice and the materials are those of before."""
        after = copy.copy(self)
        after.families, after.clamped = families, _clamped(families, self.held)
        return after

    def measures(self, u: np.ndarray, F: np.ndarray | None) -> PointMeasures:
        """The measures of all points that need no eigenvalue."""
        return point_measures(self.model, self.families, u, F, self.stiffness, self.modulus)

    def lattice(self, points: PointMeasures, path: bool) -> OwnLattice:
        """Margins and, if `path` is True, critical factors of all points."""
        G = points.stretch if self.model.objective else points.gradient
        # U of an inverted family would be that of its mirror image.
        G = np.where(points.det[:, None, None] > 0, G, np.nan)
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
        supported, dim = bool(self.held.any()), self.families.dim
        volumes, size, clamped = self.volumes, self.size, self.clamped
        return Evidence(points, lattice, body, roughness, forces, volumes, size, dim, clamped, supported)

    def scores(self, evidence: Evidence) -> dict[PointCheck, np.ndarray]:
        """The scores (points,) of all checks of points that had something to read."""
        found = {check: check.score(evidence) for check in POINT_CHECKS}
        return {check: score for check, score in found.items() if score is not None}

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
        findings, scores = [], self.scores(evidence)
        for check, score in scores.items():
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
                f"margins were computed for {lattice.bins} groups of similar stretches, not for each point; the largest"
                f" error found is {lattice.error:.1g}"
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
            _stretches(points),
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


def _stretches(points: PointMeasures) -> tuple[float, float]:
    """The smallest and the largest principal stretch of all points."""
    values = 1 + np.linalg.eigvalsh(np.where(np.isfinite(points.stretch), points.stretch, 0.0))
    return float(values.min()), float(values.max())


def _clamped(families: Families, held: np.ndarray) -> np.ndarray:
    """Which points (points,) are held in all directions, or have such a neighbour."""
    rigid: np.ndarray = np.atleast_1d(held.all(axis=1))
    real = np.asarray(families.weight) > 0
    return rigid | (rigid[np.asarray(families.neighbours)] & real).any(axis=1)


def _is_periodic(families: Families) -> bool:
    """Whether a bond crosses the edge of a periodic box: its vector is not the difference of its points."""
    positions, neighbours = np.asarray(families.positions, float), np.asarray(families.neighbours)
    limit = 1e-3 * float(np.min(np.asarray(families.horizon)))
    real = np.asarray(families.weight) > 0
    return any(
        bool((np.abs(positions[j] - positions - xi)[bond] > limit).any())
        for j, xi, bond in zip(neighbours.T, np.asarray(families.xi).transpose(1, 0, 2), real.T, strict=True)
    )
