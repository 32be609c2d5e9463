"""Upper bounds of a matrix cosine series on boxes of the Brillouin zone, valid in real arithmetic.

The statement "the margin is at most μ" means that the matrix function

    A(x) = Ĵ(x) − μ κ²(x) I = −Σ_o C_o 2(1 − cos o·x),    x = h k,   C_o = B_o, and B_o + μ I at the unit offsets,

has no positive eigenvalue. Ĵ is in units of M/h², and κ² is the series of the unit offsets.

**Boxes of waves.** Let c be the centre of a box and r its half widths. With T_α = −2 Σ_o C_o o^α/α! in multi-index
notation, Taylor's theorem gives

    A(c + δ) = Σ_{|α| ≤ 6} δ^α Σ_o T_{α,o} g_|α|(o·c) + R,    g = 1 − cos, sin, cos, −sin, −cos, sin, cos,

    ‖R‖ ≤ Σ_{|α| = 7} r^α Σ_o 2 ‖C_o‖ |o^α|/α!.

`polynomials` bounds the largest eigenvalue of the polynomial. The bound of R depends on the half widths alone. With the
orders 4, 5 and 7, the proof of a controlled correspondence model in 3D with N = 3 takes 3, 1.5 and 0.9 times as long.
For N = 2 and in 2D the times differ by less than a third.

**Cones of long waves.** A vanishes at x = 0 with its first derivatives, so that no box around x = 0 can be done. There
x = t y with |y|_∞ = 1, 0 ≤ t ≤ T, and with p = o·y

    A(ty)/t² = −Σ_o C_o (p² − t² p⁴/12 + ρ_o),    0 ≤ ρ_o ≤ t⁴ p⁶/360,

from the alternating series of the cosine. The largest eigenvalue of the sum of the first two terms is a convex function
of t², and so is the bound of ρ. The largest value is at t = 0, the limit of long waves, or at t = T. At both ends, the
first two terms are polynomials of degree 4 in y, which `polynomials` bounds exactly like those of boxes of waves:

    g = p²/2 − T² p⁴/24,  p − T² p³/6,  1 − T² p²/2,  −T² p,  −T²,  0,  0    for the orders 0 … 6.

**Rounding.** u is the unit roundoff, n the number of offsets. The components of x are exact numbers: half widths are
enlarged by the rounding of π times the centre. Sine and cosine of a component m x_a have an error of at most
π m u for the product, and 4u for NumPy's functions, which are taken to be accurate to two units in the last place. One
or two complex products add 4u each, so that sine and cosine of o·x have an error below 24 |o|₁ u. A sum over offsets
adds n u, and the products with o^α, 1/α! and r^α, the sum over at most 84 monomials and the pivots add less than 128 u.
All errors are relative to Σ_o 2 ‖C_o‖ |o^α| r^α/α!, at most doubled by 1 − cos, and a matrix has at most dim times the
norm of its largest entry. `Claims.error` doubles the product of these factors for the rounding of the error bounds
themselves. For cones, |g_k| r^α summed over all orders is at most |o|₁²/2 + T² |o|₁⁴/24, because |p| and its change
together are at most |o|₁.
"""

import itertools
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..cosine_series import packed
from .boxes import Boxes
from .polynomials import SAFE, inverse_factorials, monomials, powers, replaced

UNIT = 2.0**-53
_SIGNS = (1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0)  # of g for the orders 0 … 6


class Claims(NamedTuple):
    """The matrix functions A of several states, ready to be bounded.

    Attributes
    ----------
    offsets : array, shape (offsets, dim)
        One half of the integer offsets.
    terms : array, shape (states, terms × entries, offsets)
        The upper triangles of ±T_α for every monomial, with the sign of g.
    norm : array, shape (states, offsets)
        Bounds of 2 ‖C_o‖.
    error : array, shape (states, terms + last terms)
        The error of a box is the product with r^α: rounding up to |α| = 6, and the remainder R for |α| = 7.
    long_error : array, shape (states, 2)
        The rounding error of a cone is the product with (1, T²).
    """

    offsets: np.ndarray
    terms: np.ndarray
    norm: np.ndarray
    error: np.ndarray
    long_error: np.ndarray

    @staticmethod
    def of(blocks: np.ndarray, offsets: np.ndarray, level: np.ndarray, change: np.ndarray) -> "Claims":
        """From symmetric parts B (states, offsets, dim, dim), levels μ (states,), and norms of changes of B."""
        (n, dim), states = offsets.shape, len(blocks)
        size = np.abs(offsets).sum(axis=1).astype(float)
        C = (blocks + blocks.transpose(0, 1, 3, 2)) / 2
        C = C + (size == 1)[:, None, None] * level[:, None, None, None] * np.eye(dim)
        norm = 2 * SAFE * np.abs(np.linalg.eigvalsh(C)).max(axis=-1)
        m = monomials(dim)
        moment = _moments(offsets, m.exponents)
        signed = moment * np.array(_SIGNS)[m.exponents.sum(axis=1)][:, None]
        twice = -2 * packed(C).transpose(0, 2, 1)
        terms = (signed[:, None] * twice[:, None]).reshape(states, -1, n)
        rounding = norm * (4 * dim * UNIT * (n + 128 + 24 * size))
        last = _moments(offsets, m.last)
        error = np.concatenate([rounding @ np.abs(moment).T, norm @ np.abs(last).T], axis=1)
        error[:, 0] += 4 * change.sum(axis=1)
        long_error = np.stack([(rounding / 2 + change) @ size**2, (rounding / 24 + change / 12) @ size**4], axis=1)
        return Claims(offsets, terms, norm, SAFE * error, SAFE * long_error)


def _moments(offsets: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """o^α/α! (terms, offsets)."""
    values = np.prod(offsets.astype(float)[None] ** exponents[:, None], axis=2)
    return values * inverse_factorials(exponents)[:, None]


class Taylor(NamedTuple):
    """Polynomials on boxes, and bounds of what they leave out.

    `c` (terms, entries, boxes) are the coefficients with the factors r^α. `error` (boxes,) bounds remainder, rounding
    and the errors of `polynomials.replaced`. `share` (dim, boxes) tells how much of the remainder belongs to an axis.
    """

    c: np.ndarray
    error: np.ndarray
    share: np.ndarray

    def at(self, index: np.ndarray) -> "Taylor":
        """Those of some boxes."""
        return Taylor(self.c[..., index], self.error[index], self.share[:, index])


class Work:
    """Memory for the large arrays of up to `size` boxes.

    Memory that is allocated anew for every chunk of boxes would take as long as the arithmetic, because the system
    fills it with zeros first.
    """

    def __init__(self, offsets: np.ndarray, size: int):
        n, dim = offsets.shape
        entries = dim * (dim + 1) // 2
        self.waves = np.empty(6 * n * size)
        self.terms = np.empty(len(monomials(dim).exponents) * entries * size)
        self.vertices = np.empty(4**dim * entries * size)


def on_boxes(claims: Claims, boxes: Boxes, work: Work) -> Taylor:
    """Expand A about the centres of boxes of waves. Boxes of one state follow each other."""
    dim = boxes.center.shape[1]
    m = monomials(dim)
    r = np.pi * boxes.half * SAFE + 1e-15  # The last term covers the rounding of π times the centre.
    versine, cos, sin = _waves(claims.offsets, np.pi * boxes.center, work)
    parts = [(0, 1, versine), (1, m.even, cos), (m.even, len(m.exponents), sin)]
    c = _summed(claims, boxes.state, parts, work)
    scale = powers(r, np.concatenate([m.exponents, m.last]))
    c *= scale[: len(c), None]
    error = claims.error[boxes.state].T * scale
    return Taylor(c, error.sum(axis=0) + replaced(c, dim), m.last.T @ error[len(c) :])


def on_cones(claims: Claims, boxes: Boxes, T: np.ndarray, work: Work) -> Taylor:
    """Expand A(ty)/t² at t = T (boxes,) about the centres of cones, for T = 0 in the limit."""
    dim = boxes.center.shape[1]
    m = monomials(dim)
    square = (T * SAFE) ** 2
    p = claims.offsets @ boxes.center.T
    pp, longest = p * p, (np.abs(p) + np.abs(claims.offsets) @ boxes.half.T) ** 2
    g = (pp / 2 * (1 - square / 12 * pp), p * (1 - square / 6 * pp), 1 - square / 2 * pp, square * p, square + 0 * p)
    c = _summed(claims, boxes.state, [(*ends, part) for ends, part in zip(m.ranges, g, strict=False)], work)
    c[m.exponents.sum(axis=1) >= len(g)] = 0
    c *= powers(boxes.half, m.exponents)[:, None]
    left = square**2 / 720 * np.einsum("on,no->n", longest * longest * longest, claims.norm[boxes.state])
    rounding = claims.long_error[boxes.state]
    error = SAFE * left + rounding[:, 0] + square * rounding[:, 1] + replaced(c, dim)
    return Taylor(c, error, np.broadcast_to(left, (dim, len(left))))


def _summed(claims: Claims, state: np.ndarray, parts: list[tuple[int, int, np.ndarray]], work: Work) -> np.ndarray:
    """Σ_o of the terms times factors (offsets, boxes). `parts` are ranges of monomials with the same factor."""
    n, size = len(state), claims.terms.shape[1]
    out = work.terms[: size * n].reshape(size, n)
    dim = claims.offsets.shape[1]
    entries = dim * (dim + 1) // 2
    cuts = [0, *(np.flatnonzero(np.diff(state)) + 1).tolist(), n]
    for first, last in itertools.pairwise(cuts):
        terms = claims.terms[state[first]]
        for start, end, factor in parts:
            rows = slice(start * entries, end * entries)
            np.matmul(terms[rows], factor[:, first:last], out=out[rows, first:last])
    return out.reshape(-1, entries, n)


@lru_cache(maxsize=8)
def _rows(offsets: bytes, dim: int) -> tuple[int, list[np.ndarray]]:
    """The largest component of the offsets, and for every axis the row of an offset in a table of multiples."""
    o = np.frombuffer(offsets, int).reshape(-1, dim)
    reach = int(np.abs(o).max())
    return reach, [np.ascontiguousarray(o[:, j] + reach) for j in range(dim)]


def _waves(offsets: np.ndarray, x: np.ndarray, work: Work) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1 − cos, cos and sin of o·x (offsets, boxes), as products of the waves of the components of x (boxes, dim)."""
    reach, rows = _rows(np.ascontiguousarray(offsets, int).tobytes(), x.shape[1])
    angle = np.arange(reach + 1)[:, None] * x.T[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    cos, sin = np.concatenate([cos[:, :0:-1], cos], axis=1), np.concatenate([-sin[:, :0:-1], sin], axis=1)
    shape = (6, len(offsets), len(x))
    # The mode "clip" lets `take` write to `out` without a copy. All rows are valid.
    c, s, d, t, ct, st = work.waves[: np.prod(shape)].reshape(shape)
    np.take(cos[0], rows[0], axis=0, out=c, mode="clip")
    np.take(sin[0], rows[0], axis=0, out=s, mode="clip")
    for j in range(1, len(rows)):
        np.take(cos[j], rows[j], axis=0, out=d, mode="clip")
        np.take(sin[j], rows[j], axis=0, out=t, mode="clip")
        np.multiply(c, t, out=ct)
        np.multiply(s, t, out=st)
        c *= d
        c -= st
        s *= d
        s += ct
    return np.subtract(1, c, out=d), c, s
