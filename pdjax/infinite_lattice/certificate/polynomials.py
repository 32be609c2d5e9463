"""Upper bounds of matrix polynomials on boxes, from finitely many matrices.

A matrix polynomial on a box |δ_a| ≤ r_a is Σ_α c_α u^α with u_a = δ_a/r_a in [−1, 1] and symmetric matrices c_α, which
hold the factors r^α. Its order is ORDER.

**Vertices.** The pairs (u, u²) lie on an arc of a parabola. The arc lies in the convex hull of its end points and of
the points where its tangents at −1, 0 and 1 meet:

    (u, u²):  (−1, 1), (−1/2, 0), (1/2, 0), (1, 1).

Higher powers are replaced by affine functions of u and u², the best ones on [−1, 1] except for a rounded coefficient:

    u³ = 3/4 u ± 1/4,    u⁴ = u² − 1/8 ± 1/8,    u⁵ = 2/3 u ± 1/3,    u⁶ = u² − 1/5 ± 1/5.

For a vector w, the number wᵀ(Σ c_α u^α)w then is an affine function of the pair (u_a, u_a²) of every single coordinate.
It therefore takes its maximum over the box at one of the 4^dim combinations of vertices. The largest eigenvalue of the
polynomial is at most that of the matrices at these combinations, plus the errors: ‖c_α‖ times the sum of the errors of
the powers in u^α, because all powers and their replacements are at most 1.

Symmetric matrices are packed: (..., entries, boxes) with the upper triangle of dim (dim + 1)/2 entries.
"""

import itertools
from functools import lru_cache
from math import factorial
from typing import NamedTuple

import numpy as np

from ..cosine_series import upper

ORDER = 6
SAFE = 1 + 1e-9  # factor on sums of positive numbers, whose relative rounding error is below 1e-12

_VERTICES = np.array([-1.0, -0.5, 0.5, 1.0]), np.array([1.0, 0.0, 0.0, 1.0])
_ERRORS = np.array([0, 0, 0, 1 / 4, 1 / 8, 1 / 3, 1 / 5])


class Monomials(NamedTuple):
    """The monomials of a polynomial: those of even degree first, by degree, then those of odd degree.

    Attributes
    ----------
    exponents : array, shape (terms, dim)
        The exponents α.
    ranges : list of pairs
        The positions of the monomials of every degree, as first and last + 1.
    even : int
        Number of monomials of even degree.
    inverse_factorial : array, shape (terms,)
        1/α!.
    vertices : array, shape (4^dim, terms)
        Values at the combinations of vertices.
    error : array, shape (terms,)
        Largest difference between a monomial and its replacement.
    last : array, shape (terms of degree ORDER + 1, dim)
        The exponents of the monomials of the first degree that is left out.
    """

    exponents: np.ndarray
    ranges: list[tuple[int, int]]
    even: int
    inverse_factorial: np.ndarray
    vertices: np.ndarray
    error: np.ndarray
    last: np.ndarray


def _of_degree(dim: int, degree: int) -> np.ndarray:
    every = itertools.product(range(degree, -1, -1), repeat=dim)
    return np.array([a for a in every if sum(a) == degree])


def inverse_factorials(exponents: np.ndarray) -> np.ndarray:
    """1/α! of exponents (terms, dim)."""
    return np.array([1.0 / np.prod([float(factorial(k)) for k in a]) for a in exponents.tolist()])


@lru_cache(maxsize=4)
def monomials(dim: int) -> Monomials:
    """The monomials of polynomials in `dim` coordinates."""
    degrees = sorted(range(ORDER + 1), key=lambda k: (k % 2, k))
    parts = {k: _of_degree(dim, k) for k in degrees}
    exponents = np.concatenate(list(parts.values()))
    degree = exponents.sum(axis=1)
    u, square = _VERTICES
    powers = np.stack([np.ones(4), u, square, 0.75 * u, square - 0.125, 2 / 3 * u, square - 0.2])
    where = np.array(list(itertools.product(range(4), repeat=dim)))
    return Monomials(
        exponents,
        [(int(np.argmax(degree == k)), int(np.argmax(degree == k)) + len(parts[k])) for k in range(ORDER + 1)],
        int((degree % 2 == 0).sum()),
        inverse_factorials(exponents),
        np.prod(powers[exponents[None], where[:, None]], axis=2),
        _ERRORS[exponents].sum(axis=1),
        _of_degree(dim, ORDER + 1),
    )


def powers(r: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """r^α (terms, boxes) of half widths r (boxes, dim)."""
    table = np.cumprod(np.stack([np.ones_like(r.T)] + [r.T] * int(exponents.max())), axis=0)
    result = table[exponents[:, 0], 0]
    for j in range(1, r.shape[1]):
        result *= table[exponents[:, j], j]
    return result


def norms(A: np.ndarray, dim: int) -> np.ndarray:
    """Frobenius norms (..., boxes) of packed matrices."""
    (rows, columns), _ = upper(dim)
    weight = np.where(rows == columns, 1.0, 2.0)
    return np.sqrt(np.einsum("...qn,...qn,q->...n", A, A, weight))


def replaced(c: np.ndarray, dim: int) -> np.ndarray:
    """A bound (boxes,) of the errors of all replaced monomials of the polynomial c (terms, entries, boxes)."""
    error = monomials(dim).error
    some = error > 0
    return SAFE * (error[some] @ norms(c[some], dim))


def at_vertices(c: np.ndarray, room: np.ndarray) -> np.ndarray:
    """The matrices (4^dim, entries, boxes) at the combinations of vertices, written to the memory `room`."""
    dim = round(np.sqrt(2 * c.shape[1]))  # dim (dim + 1)/2 entries
    values = monomials(dim).vertices
    out = room[: len(values) * c[0].size].reshape(len(values), -1)
    return np.matmul(values, c.reshape(len(c), -1), out=out).reshape(len(values), *c.shape[1:])


def is_negative(A: np.ndarray, excess: np.ndarray | float, dim: int) -> np.ndarray:
    """Whether A + excess I has no positive eigenvalue for every matrix of A (matrices, entries, boxes).

    The pivots of −A − excess I are computed. They are positive only if a matrix that differs by rounding is positive
    definite. `excess` includes that rounding.
    """
    a = A[:, 0] + excess
    if dim == 1:
        return np.all(a < 0, axis=0)
    negative = a < 0
    if dim == 2:
        b, d = A[:, 1], A[:, 2] + excess
        return (negative & (d < 0) & (a * d > b * b)).all(axis=0)
    over = 1 / np.where(negative, a, -1.0)
    b, c = A[:, 1] * over, A[:, 2] * over
    d = A[:, 3] + excess - b * A[:, 1]
    e = A[:, 4] - b * A[:, 2]
    f = A[:, 5] + excess - c * A[:, 2]
    return (negative & (d < 0) & (d * f > e * e)).all(axis=0)


def top(A: np.ndarray, dim: int) -> np.ndarray:
    """An upper bound (..., boxes) of λ_max of packed matrices, from trace and norm. It is exact in 1D and 2D."""
    (rows, columns), _ = upper(dim)
    own = rows == columns
    mean = A[..., own, :].sum(axis=-2) / dim
    deviator = A - np.where(own, 1.0, 0.0)[:, None] * mean[..., None, :]
    return mean + np.sqrt((dim - 1) / dim) * norms(deviator, dim)
