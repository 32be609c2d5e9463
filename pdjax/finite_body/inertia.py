"""A proof of the number of positive eigenvalues of a symmetric sparse matrix H, or the reason why there is none.

Notation: N(x) is the number of eigenvalues of H above x, τ the tolerance within which an eigenvalue counts as zero, and
u = 2⁻⁵³ the unit roundoff. Bars denote absolute values entry by entry.

**Backward error of one factorisation.** SuperLU computes P (H − σ I) Pᵀ + R = L U with |R| ≤ γ |L| |U|. Here
γ = k u/(1 − k u) and k is the number of terms of an entry. Let D be the diagonal of U, L' = Uᵀ D⁻¹ and L̂ = ½ (L + L').
Both L and L' have a unit diagonal, and

    L̂ D L̂ᵀ = P (H − σ I) Pᵀ + E,     E = sym(R) + ¼ (L − L') D (L − L')ᵀ

The second term is of second order in rounding. With Δ = L D − Uᵀ it is at most ¼ |Δ| |D|⁻¹ |Δ|ᵀ, and Δ is computed. For
a symmetric H, √(‖R‖₁ ‖R‖_∞) bounds ‖sym(R)‖₂. `backward_bound` gives the bound ε ≥ ‖E‖₂.

**The proof.** By Sylvester's law the number n(σ) of positive pivots is the number of positive eigenvalues of
H − σ I + E. By Weyl's inequality each of them differs from one of H − σ I by at most ε. For a shift s > ε + τ,

    n(s) ≤ N(s − ε) ≤ N(τ) ≤ N(−τ) ≤ N(−s + ε) ≤ n(−s)

If the two numbers of pivots are equal, they equal N(τ), and no eigenvalue lies in [−τ, τ]. If n(−s) = 0, one
factorisation is enough. The smallest pivot proves nothing, because it is not the smallest absolute eigenvalue.

**What is assumed.** The arithmetic is that of IEEE 754 without underflow, and the sums of the factorisation are
conventional, in any order. The proof holds for the float64 matrix H, not for the exact values of its entries.

References
----------
N. J. Higham, *Accuracy and Stability of Numerical Algorithms*, 2nd ed., SIAM 2002, Theorem 9.3.
S. M. Rump, Verification methods, *Acta Numerica* 19 (2010), section 10.8.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from .factorisation import Factor, Singular

UNIT = 2.0**-53
MARGIN = 16.0  # The first shift is τ + MARGIN (size + 64) u ‖H‖; measured at rest in 2D: ε ≤ 4 (size + 64) u ‖H‖.
SLACK = 1.001  # It covers the rounding of the bound itself, whose sums have fewer than 10¹¹ terms, none negative.


class Inertia(NamedTuple):
    """The number of positive eigenvalues of a matrix and its proof.

    Attributes
    ----------
    positive : int or None
        Number of positive pivots at the last shift. None if there was no factorisation.
    proved : bool
        Whether H has exactly `positive` eigenvalues above the tolerance, and all others below minus the tolerance.
    error : float
        Bound ε of the backward errors, in units of H. It is inf if no bound is known.
    reason : str
        Why the count is not proved; empty if it is.
    shift : float
        Shift s: the factorised matrices are H + s I and, if that has positive eigenvalues, H − s I.
    factorisations : int
        Number of factorisations.
    """

    positive: int | None
    proved: bool
    error: float
    reason: str
    shift: float
    factorisations: int


def shifted(H: sp.csc_array, shift: float) -> sp.csc_array:
    """H − shift · I. If `shift` is the tolerance, eigenvalues that count as zero become negative."""
    return (H - shift * sp.eye_array(H.shape[0], format="csc")).tocsc()


def backward_bound(factor: Factor) -> float:
    """The bound ε of the module docstring for a factorisation of H − σ I, the rounding of the shift included."""
    L, U = factor.triangles()
    D = U.diagonal()
    rows = L.tocsr()  # sorted within rows, as the difference of two matrices needs it
    columns = U.T.copy()  # Uᵀ, by rows
    columns.sort_indices()
    gap = abs(sp.csr_array((rows.data * D[rows.indices], rows.indices, rows.indptr), rows.shape) - columns)
    np.abs(rows.data, out=rows.data)
    np.abs(columns.data, out=columns.data)
    one, size = np.ones(len(D)), np.abs(D)
    # k: one term for each entry of the row of L or of the column of U, and two roundings of the division by the pivot.
    by_row, by_column = (UNIT * (np.diff(m.indptr) + 2.0) for m in (rows, columns))
    by_row, by_column = by_row / (1 - by_row), by_column / (1 - by_column)
    first = np.sqrt((by_row * (rows @ (columns.T @ one))).max() * (by_column * (columns @ (rows.T @ one))).max())
    # Δ is known to the rounding of its two operations, at most 2 u |L| |D| and a relative error that SLACK covers.
    inner = (gap.T @ one + 2 * UNIT * size * (rows.T @ one)) / size
    second = 0.25 * (gap @ inner + 2 * UNIT * (rows @ (size * inner))).max()
    bound = float(SLACK * (first + second + UNIT * np.abs(factor.matrix.diagonal()).max()))
    return bound if np.isfinite(bound) else np.inf


def prove(H: sp.csc_array, norm: float, tolerance: float) -> tuple[Inertia, Factor | None]:
    """Count the positive eigenvalues of H and prove the count.

    Parameters
    ----------
    H : sparse array, shape (unknowns, unknowns)
        A symmetric matrix in float64.
    norm : float
        ‖H‖, at least roughly. It sets the first shift and does not enter the proof.
    tolerance : float
        Absolute eigenvalues up to this one count as zero.

    Returns
    -------
    found : Inertia
        The count and its proof.
    factor : Factor or None
        The factorisation of H + s I if it has no positive pivot, to be used again. Otherwise None.
    """
    shift, done, error = tolerance + MARGIN * (H.shape[0] + 64) * UNIT * norm, 0, np.inf

    def found(positive: int | None, reason: str) -> Inertia:
        return Inertia(positive, not reason, error, reason, shift, done)

    def inaccurate() -> str:
        """The reason why ε does not fit the shift; empty if it does."""
        return "" if error + tolerance < shift else f"the factors are exact only to {error / norm:.1e} of the norm"

    try:
        factor = Factor(shifted(H, -shift))
        done, most = 1, factor.positive
        if not factor.cheap:
            return found(most, "the factors are too large to bound their error"), None if most else factor
        error = backward_bound(factor)
        if inaccurate() and np.isfinite(error):
            shift = 4 * (error + tolerance)
            del factor  # A matrix factorisation takes most of the memory, so only one is kept at a time.
            factor = Factor(shifted(H, -shift))
            done, most, error = 2, factor.positive, backward_bound(factor)
        if most == 0 or inaccurate():
            return found(most, inaccurate()), None if most else factor
        del factor
        factor = Factor(shifted(H, shift))
        done, least, error = done + 1, factor.positive, max(error, backward_bound(factor))
    except Singular as failure:
        return found(None, str(failure)), None
    if inaccurate() or least == most:
        return found(least, inaccurate()), None
    near = f"{most - least} eigenvalues lie" if most - least != 1 else "an eigenvalue lies"
    return found(least, f"{near} within {(shift + error) / norm:.1e} of the norm from zero"), None
