"""The largest eigenvalue of the Jacobian of a body that may be free, with its rigid motions excluded.

A body of a file has no supports, or has them only as a mask. A free body can move rigidly. In a stressed state these
motions need not have the eigenvalue 0, because the forces turn with a rotation: J (Ω x) = Ω f. They are no instability
and are excluded: the spectrum is that of H = V^½ J V^-½ on the vectors orthogonal to the free rigid motions of the
deformed body.

Let R (unknowns, r) be an orthonormal basis of them. The number of positive eigenvalues on its complement follows from
one factorisation of A = H − τ and r solves, by Haynsworth's formula for the bordered matrix [A, R; Rᵀ, 0]:

    n₊(A on the complement) = n₊(A) + n₊(−Rᵀ A⁻¹ R) − r

The same factorisation solves with A on the complement, which gives the largest eigenvalue by Lanczos iteration.

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
from .spectrum import DENSE, norm_of, scaled_matrix, zero_tolerance

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
    dim, free = families.dim, np.flatnonzero(~held.reshape(-1))
    if not model.hyperelastic:
        return _unknown(f"{type(model).__name__} has no energy, so its eigenvalues are not counted")
    if len(free) == 0:
        return _unknown("every component is held")
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
    return FreeSpectrum(positive, value, mode.reshape(u.shape), tolerance, R.shape[1], "")


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


def _sparse(H: sp.csc_array, R: np.ndarray, tolerance: float) -> tuple[int, float, np.ndarray]:
    import scipy.sparse.linalg as sla

    size, r = H.shape[0], R.shape[1]
    factor = Factor(shifted(H, tolerance))
    AR = np.stack([factor.solve(R[:, k]) for k in range(r)], axis=1) if r else np.zeros((size, 0))
    S = R.T @ AR
    positive = factor.positive + int((np.linalg.eigvalsh(-(S + S.T) / 2) > 0).sum()) - r
    start = 1 + 0.5 * np.random.default_rng(1).normal(size=size)
    start -= R @ (R.T @ start)
    if positive == 0:

        def inverse(b):
            x = factor.solve(b)
            return x - AR @ np.linalg.solve(S, R.T @ x) if r else x

        operator = sla.LinearOperator(H.shape, matvec=inverse, dtype=float)
        values, vectors = sla.eigsh(H, k=1, sigma=tolerance, OPinv=operator, v0=start, tol=1e-6)
    else:

        def projected(v):
            v = v.reshape(-1)
            v = v - R @ (R.T @ v)
            v = H @ v
            return v - R @ (R.T @ v)

        values, vectors = sla.eigsh(
            sla.LinearOperator(H.shape, matvec=projected, dtype=float), k=1, which="LA", v0=start, tol=1e-6
        )
    return positive, float(values[-1]), vectors[:, -1]
