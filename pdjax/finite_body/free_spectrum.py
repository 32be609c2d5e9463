"""The largest eigenvalue of the Jacobian of a body that may be free, with its rigid motions excluded.

A body of a file has no supports, or has them only as a mask. A free body can move rigidly. In a stressed state these
motions need not have the eigenvalue 0, because the forces turn with a rotation: J (Ω x) = Ω f. They are no instability
and are excluded: the spectrum is that of H = V^½ J V^-½ on the vectors orthogonal to the free rigid motions of the
deformed body.

Let R (unknowns, r) be an orthonormal basis of them. At rest all rigid motions have the eigenvalue 0, so A = H − σ is
nearly singular. The matrix P = A − s E Eᵀ is factorised in its place: springs of stiffness s = ‖H‖ hold r components,
the columns of E, such that no rigid motion is free. Let B = [E, R] and C = diag(I/s, 0) + Bᵀ P⁻¹ B, which is 2r × 2r.
Haynsworth's formula for the matrix [P, B; Bᵀ, diag(−I/s, 0)] gives the number of positive eigenvalues of A on the
complement of R:

    n₊(A on the complement) = n₊(P) + n₊(−C) − r

The same factorisation solves with A on the complement, x = P⁻¹ (b − B w) with C w = Bᵀ P⁻¹ b. Lanczos iteration then
gives the eigenvalue nearest to σ.

Reference
---------
E. V. Haynsworth, *Linear Algebra Appl.* 1 (1968) 73–81 (inertia of a partitioned matrix).
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool

from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..tangent.jacobian import jacobian
from .factorisation import Factor, Singular
from .inertia import shifted
from .rigid_motions import free_pieces
from .spectrum import DENSE, eigenpairs, nearest, norm_of, scaled_matrix, zero_tolerance

LARGEST = {1: 250_000, 2: 60_000, 3: 15_000}  # unknowns up to which a factorisation takes seconds, by dimension


class FreeSpectrum(NamedTuple):
    """The end of the spectrum of a body on its free components, without free rigid motions.

    `positive` is the number of eigenvalues above `tolerance`, and `eigenvalue` the largest one
    [force/length^(dim+1)], with its `mode` (points, dim) of unit length. They are None where `reason` says why. `rigid`
    is the number of motions that were excluded.
    """

    positive: int | None
    eigenvalue: float | None
    mode: np.ndarray | None
    tolerance: float
    rigid: int
    reason: str


def _unknown(reason: str) -> FreeSpectrum:
    return FreeSpectrum(None, None, None, 0.0, 0, reason)


def free_spectrum(
    model: AbstractModel,
    families: Families,
    u: np.ndarray,
    F: np.ndarray | None,
    held: Bool[np.ndarray, "points dim"],
    periodic: bool = False,
) -> FreeSpectrum:
    """The largest eigenvalue and the number of positive ones at u (points, dim), free rigid motions excluded."""
    # A point without bonds has no force. Its translations are excluded, like those of any piece, but cost nothing here.
    alone = ~(np.asarray(families.weight) * np.asarray(families.influence) > 0).any(axis=1)
    fragments = int((~held[alone]).sum())
    held = held | alone[:, None]
    dim, free = families.dim, np.flatnonzero(~held.reshape(-1))
    if not model.hyperelastic:
        return _unknown(f"{type(model).__name__} has no energy, so its eigenvalues are not counted")
    if len(free) == 0:
        return _unknown("every component is held or has no bonds")
    if len(free) > LARGEST[dim]:
        return _unknown(f"its {len(free)} unknowns are more than {LARGEST[dim]}, the limit in {dim}D")
    positions = np.asarray(families.positions, float) + u
    if F is not None:
        positions = positions + np.asarray(families.positions, float) @ (np.asarray(F) - np.eye(dim)).T
    root = np.sqrt(np.repeat(np.asarray(families.volumes, float), dim))
    J = jacobian(model, families, u, "sparse", F)
    A = (sp.diags_array(root**2) @ J).tocsr()[free][:, free].tocsc()
    H = scaled_matrix((0.5 * (A + A.T)).tocsc(), root[free])
    if not np.isfinite(H.data).all():
        return _unknown("the forces are not finite, because a bond has the length zero or u contains NaN")
    R = _basis(positions, families, held, periodic, root)[free]
    tolerance = zero_tolerance(norm_of(H), np.asarray(J.data).dtype)
    try:
        solve = _dense if len(free) <= DENSE else _sparse
        positive, value, w = solve(H, R, tolerance)
    except Singular as failure:
        return _unknown(str(failure))
    mode = np.zeros(u.size)
    mode[free] = w / root[free]
    mode /= np.linalg.norm(mode)
    return FreeSpectrum(positive, value, mode.reshape(u.shape), tolerance, R.shape[1] + fragments, "")


def _basis(positions: np.ndarray, families: Families, held: np.ndarray, periodic: bool, root: np.ndarray) -> np.ndarray:
    """An orthonormal basis (components, motions) of the free rigid motions, scaled like the eigenvectors of H."""
    columns = []
    for piece in free_pieces(positions, families, held, periodic):
        for motion in piece.motions:
            column = np.zeros(held.shape)
            column[piece.points] = motion
            columns.append(column.reshape(-1) * root)
    if not columns:
        return np.zeros((held.size, 0))
    return np.linalg.qr(np.stack(columns, axis=1))[0]


def _dense(H: sp.csc_array, R: np.ndarray, tolerance: float) -> tuple[int, float, np.ndarray]:
    """All eigenvalues on the complement of R. The rigid motions are moved far below all others."""
    full = H.toarray()
    full -= R @ (R.T @ full)
    full -= (full @ R) @ R.T
    full -= 2 * np.abs(full).sum(axis=1).max() * (R @ R.T)
    values, vectors = np.linalg.eigh((full + full.T) / 2)
    return int((values > tolerance).sum()), float(values[-1]), vectors[:, -1]


class _Complement:
    """A factorisation of A = H − shift on the complement of the rigid motions R. It counts and solves."""

    def __init__(self, H: sp.csc_array, R: np.ndarray, shift: float, norm: float):
        size, r = R.shape
        A = shifted(H, shift)
        self.r, self.B, self.C = r, np.zeros((size, 0)), np.zeros((0, 0))
        if r:
            from scipy.linalg import qr

            pins = qr(R.T, mode="economic", pivoting=True)[2][:r]
            E = np.zeros((size, r))
            E[pins, np.arange(r)] = 1
            A = (A - sp.csc_array((np.full(r, norm), (pins, pins)), A.shape)).tocsc()
            self.B = np.concatenate([E, R], axis=1)
        self.factor = Factor(A)
        if r:
            self.PB = np.stack([self.factor.solve(b) for b in self.B.T], axis=1)
            C = self.B.T @ self.PB
            self.C = (C + C.T) / 2
            self.C[np.arange(r), np.arange(r)] += 1 / norm
        self.positive = self.factor.positive + int((np.linalg.eigvalsh(-self.C) > 0).sum()) - r

    def solve(self, b: np.ndarray) -> np.ndarray:
        """The x of the complement with A x = b on the complement."""
        x = self.factor.solve(b)
        return x - self.PB @ np.linalg.solve(self.C, self.B.T @ x) if self.r else x


def _roughly_largest(H: sp.csc_array, R: np.ndarray, start: np.ndarray) -> float:
    """The largest eigenvalue on the complement to a few digits, by Lanczos iteration without a factorisation."""
    import scipy.sparse.linalg as sla

    def projected(v):
        v = v.reshape(-1)
        v = H @ (v - R @ (R.T @ v))
        return v - R @ (R.T @ v)

    try:
        operator = sla.LinearOperator(H.shape, matvec=projected, dtype=float)
        return float(eigenpairs(operator, 1, which="LA", v0=start, tol=1e-4, maxiter=300)[0][-1])
    except sla.ArpackNoConvergence:
        return 0.0


def _sparse(H: sp.csc_array, R: np.ndarray, tolerance: float) -> tuple[int, float, np.ndarray]:
    """The shift is moved until no eigenvalue lies above it. Then the nearest eigenvalue is the largest one."""
    norm, shift = norm_of(H), tolerance
    start = 1 + 0.5 * np.random.default_rng(1).normal(size=H.shape[0])
    start -= R @ (R.T @ start)
    solver = _Complement(H, R, shift, norm)
    positive = solver.positive
    if positive:
        shift = (1 + 1e-3) * max(_roughly_largest(H, R, start), 1e-6 * norm)
        solver = _Complement(H, R, shift, norm)
    while solver.positive:
        shift *= 2
        if shift > 4 * norm:
            raise Singular("no bound above the largest eigenvalue was found")
        solver = _Complement(H, R, shift, norm)
    _, vectors = nearest(H, solver.solve, shift, 1, start)
    w = vectors[:, 0] - R @ (R.T @ vectors[:, 0])
    w /= np.linalg.norm(w)
    return positive, float(w @ (H @ w)), w
