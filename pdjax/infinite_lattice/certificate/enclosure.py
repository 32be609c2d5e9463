"""Upper bounds of a matrix cosine series on boxes of the Brillouin zone, valid in real arithmetic.

The statement "the margin is at most μ" means that the matrix function

    A(x) = Ĵ(x) − μ κ²(x) I = −Σ_o C_o 4 sin²(o·x/2),    x = h k,   C_o = B_o, and B_o + μ I at the unit offsets,

has no positive eigenvalue. Ĵ is in units of M/h², and κ² is the series of the unit offsets. Both A and κ² vanish at
x = 0 with their first derivatives. With x = t y and |y|_∞ = 1 the quotient

    P(t, y) = A(t y)/t² = −Σ_o C_o g(t, o·y),    g(t, p) = 4 sin²(tp/2)/t²

is an entire function of t and y, which includes the limit of long waves, t = 0. One component of y is ±1. The other
components are v. The coordinates of a box are (t, v).

**Bound.** Let c be the centre of a box, r its half widths, and P, P_a, P_ab the value and the derivatives of P at c.
For every point c + δ of the box, Taylor's theorem gives

    λ_max(P(c + δ)) ≤ λ_max(P + Σ δ_a P_a) + ½ Σ_a r_a² λ⁺(P_aa) + Σ_{a<b} r_a r_b ‖P_ab‖ + R + rounding.

The first term is convex in δ, so that its maximum is at a corner. λ⁺ is the largest eigenvalue, at least 0. R bounds
the third derivatives: with π = Σ |o_j| r_j, the largest change of p = o·y,

    6 R = Σ_o ‖C_o‖ sup (|g_ppp| π³ + 3 |g_ppt| π² r_t + 3 |g_ptt| π r_t² + |g_ttt| r_t³),

    |g_ppp| = 2t |sin z|,   |g_ppt| = 2|p| |sin z|,   |g_ptt| = 2|p|³ |sinc″ z|,   |g_ttt| = |p|⁵ |f‴(z)|,    z = t p,

with sinc z = sin z/z and f = sinc²(z/2). Because f(z) = 2∫(1 − τ) cos(zτ) dτ over 0 ≤ τ ≤ 1, |f‴| ≤ min(1/10, z/15),
and likewise |sinc″| ≤ 1/3. Leibniz' rule on 2(1 − cos z)/z² and sin z/z gives the bounds for large z.

**Derivatives.** g is homogeneous: p g_p − t g_t = 2 g. The derivatives in t therefore follow from those in y,

    P_t = (Σ y_j P_j − 2P)/t,   P_tj = (Σ y_k P_jk − P_j)/t,   P_tt = (Σ y_j P_tj − 3P_t)/t,

without cancellation that matters: each is multiplied by r_t ≤ t.

**Rounding.** u is the unit roundoff, n the number of offsets, S_k = Σ ‖C_o‖ |o|₁^k. NumPy's sine and cosine are
taken to be accurate to two units in the last place. An entry of P then has an error of at most (n + 64) u S₂, one of
P_j twice as much, one of P_jk (n + 64) u (2 S₂ + 4t S₃). `_rounding` adds these, propagated through the formulas above.
It doubles the sum for the rounding of the bound itself and of the factorisation that tests it.
"""

import itertools
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..._internal.checks import Numbers
from ..cosine_series import Series, packed, upper

UNIT = 2.0**-53
SAFE = 1 + 1e-9  # factor on sums of positive numbers, whose relative rounding error is below 1e-12


class Claims(NamedTuple):
    """The matrix functions A of several states, ready to be bounded.

    `series` holds the upper triangles of C, o C and o o C. `norm` (states, offsets) bounds ‖C_o‖₂. `moments`
    (states, 2) are S₂ and S₃. `slack` (states,) bounds what the average over the symmetries has changed in P.
    """

    series: Series
    norm: np.ndarray
    moments: np.ndarray
    slack: np.ndarray

    @staticmethod
    def of(blocks: np.ndarray, offsets: np.ndarray, level: np.ndarray, change: np.ndarray) -> "Claims":
        """From symmetric parts B (states, offsets, dim, dim), levels μ (states,), and norms of changes of B."""
        C = (blocks + blocks.transpose(0, 1, 3, 2)) / 2
        unit = np.abs(offsets).sum(axis=1) == 1
        C = C + np.where(unit, 1.0, 0.0)[None, :, None, None] * level[:, None, None, None] * np.eye(offsets.shape[1])
        norm = SAFE * np.abs(np.linalg.eigvalsh(C)).max(axis=-1)
        size = np.abs(offsets).sum(axis=1).astype(float)
        moments = np.stack([norm @ size**2, norm @ size**3], axis=1)
        return Claims(Series.of(packed(C), offsets), norm, moments, SAFE * (change @ size**2))


class Boxes(NamedTuple):
    """Boxes of the zone. The coordinates (t/π, v) of their centres are exact binary fractions.

    `state` and `chamber` (boxes,) are indices. `center` and `half` (boxes, dim) are the centres and the half widths.
    `bound` (boxes,) is an upper bound of the margin on the box, infinite if none is known.
    """

    state: np.ndarray
    chamber: np.ndarray
    center: np.ndarray
    half: np.ndarray
    bound: np.ndarray

    def at(self, index: np.ndarray | slice) -> "Boxes":
        """Some of the boxes."""
        return Boxes(*(part[index] for part in self))


def joined(parts: list[Boxes]) -> Boxes:
    """All boxes of a list in one."""
    return parts[0] if len(parts) == 1 else Boxes(*(np.concatenate(x) for x in zip(*parts, strict=True)))


class Taylor(NamedTuple):
    """P and its derivatives at the centres of boxes, half widths, and bounds of the remainder and of the rounding."""

    P: np.ndarray  # (boxes, dim, dim)
    P1: np.ndarray  # (boxes, dim of a, dim, dim)
    P2: np.ndarray  # (boxes, dim of a, dim of b, dim, dim)
    half: np.ndarray  # (boxes, dim) half widths in (t, v)
    remainder: np.ndarray  # (boxes,)
    rounding: np.ndarray  # (boxes,)

    def at(self, index: np.ndarray) -> "Taylor":
        """Those of some boxes."""
        return Taylor(*(part[index] for part in self))


def wave_vectors(boxes: Boxes, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """t (boxes,) and y (boxes, dim) of the centres: the wave vectors x = t y [1/spacing]."""
    t, v = np.pi * boxes.center[:, 0], boxes.center[:, 1:]
    ahead = np.concatenate([np.ones((len(t), 1)), v], axis=1)
    return t, np.einsum("nij,nj->ni", frames[boxes.chamber], ahead)


def taylor(claims: Claims, frames: np.ndarray, boxes: Boxes) -> Taylor:
    """Expand P about the centre of every box. `frames` (chambers, dim, dim) holds the matrices W of the chambers."""
    dim, o = boxes.center.shape[1], claims.series.offsets
    W = frames[boxes.chamber].astype(float)
    t, y = wave_vectors(boxes, frames)
    rt = np.pi * boxes.half[:, 0] * SAFE + 1e-15  # The last term covers the rounding of π times the centre.
    rv = boxes.half[:, 1:]
    ry = np.einsum("nij,nj->ni", np.abs(W[:, :, 1:]), rv)
    p, change = y @ o.T, ry @ np.abs(o).T
    g, gp, gpp = _chords(t[:, None], p)
    (rows, _), place = upper(dim)
    state = boxes.state if len(claims.norm) > 1 else None
    P = -_summed(g, claims.series.zeroth, state)[:, place]
    Pj = -_summed(gp, claims.series.first, state).reshape(len(t), dim, -1)[..., place]
    Pjk = -_summed(gpp, claims.series.second, state).reshape(len(t), len(rows), -1)[:, :, place][:, place]
    norm = claims.norm[0] if state is None else claims.norm[state]
    third = _third(t[:, None], p, rt[:, None], change)
    remainder = SAFE * (third @ norm if state is None else np.einsum("no,no->n", third, norm)) / 6

    over = 1 / t[:, None, None]
    Pt = (np.einsum("nj,njab->nab", y, Pj) - 2 * P) * over
    Ptj = (np.einsum("nk,njkab->njab", y, Pjk) - Pj) * over[..., None]
    Ptt = (np.einsum("nj,njab->nab", y, Ptj) - 3 * Pt) * over
    free = W[:, :, 1:]
    P1 = np.concatenate([Pt[:, None], np.einsum("nji,njab->niab", free, Pj)], axis=1)
    P2 = np.empty((len(t), dim, dim, dim, dim))
    P2[:, 0, 0] = Ptt
    P2[:, 0, 1:] = P2[:, 1:, 0] = np.einsum("nji,njab->niab", free, Ptj)
    P2[:, 1:, 1:] = np.einsum("nji,nkl,njkab->nilab", free, free, Pjk, optimize=True)
    index = 0 if state is None else state
    rounding = _rounding(claims.moments[index].reshape(-1, 2), len(o), dim, t, rt / t, rv.sum(axis=1))
    half = np.concatenate([rt[:, None], rv], axis=1)
    return Taylor(P, P1, P2, half, remainder, rounding + claims.slack[index])


def _chords(t: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """g, g_p and g_pp at (t, p)."""
    angle = (0.5 * t) * p
    sine = np.sin(angle)
    double = 2 * sine
    chord = double / t
    return chord**2, 2 * chord * np.cos(angle), 2 - double**2


def _summed(factor: np.ndarray, terms: Numbers, state: np.ndarray | None) -> np.ndarray:
    """Σ_o factor_o terms_o for every box: one state for all boxes, or the state of each box."""
    return factor @ terms[0] if state is None else np.einsum("no,noq->nq", factor, terms[state])


def _third(t: np.ndarray, p: np.ndarray, rt: np.ndarray, change: np.ndarray) -> np.ndarray:
    """The largest third differential of g on every box (boxes, offsets). `change` bounds the change of p."""
    size = np.abs(p)
    high, most = size + change, t + rt
    z = most * high
    wave = np.minimum(1.0, z)  # bounds |sin z|
    over = 1 / np.maximum((t - rt) * (size - change), 1e-3)  # bounds 1/z; below it the other bounds are smaller
    curve = np.minimum(1 / 3, over * (1 + over * (2 + 2 * over)))
    jerk = np.minimum(np.minimum(z / 15, 0.1), over**2 * (2 + over * (12 + over * (36 + 96 * over))))
    cube = high**3
    return change**2 * wave * (2 * most * change + 6 * high * rt) + rt**2 * cube * (
        6 * curve * change + cube / np.maximum(high, 1e-300) * jerk * rt
    )


def _rounding(moments: np.ndarray, n: int, dim: int, t: np.ndarray, qt: np.ndarray, qv: np.ndarray) -> np.ndarray:
    """Bound of all rounding errors in a bound. qt = r_t/t, and qv is the sum of the other half widths."""
    second, third = moments.T
    e0 = (n + 64) * UNIT * second
    e1 = 2 * e0
    e2 = (n + 64) * UNIT * (2 * second + 4 * t * third)
    first = qt * (dim * e1 + 2 * e0) + qv * e1
    mixed = qt * qv * (dim * e2 + e1)
    pure = qt**2 * (dim**2 * e2 + 4 * dim * e1 + 6 * e0) + qv**2 * e2
    return 2 * dim * (e0 + first + mixed + pure / 2)


@lru_cache(maxsize=4)
def _corners(dim: int) -> np.ndarray:
    return np.array(list(itertools.product((1.0, -1.0), repeat=dim)))


def excess(T: Taylor) -> tuple[np.ndarray, np.ndarray]:
    """The terms of the bound beyond the corners (boxes,), and ½ r_a r_b ‖P_ab‖ (boxes, dim, dim) of every pair."""
    size = np.sqrt((T.P2**2).sum(axis=(-2, -1)))
    pairs = 0.5 * T.half[:, :, None] * T.half[:, None, :] * size
    axes = np.arange(T.half.shape[1])
    own = 0.5 * T.half**2 * np.maximum(_top(T.P2[:, axes, axes]), 0.0)
    off = pairs.sum(axis=(1, 2)) - np.einsum("naa->n", pairs)
    return SAFE * (own.sum(axis=1) + off) + T.remainder + T.rounding, pairs


def _top(A: np.ndarray) -> np.ndarray:
    """An upper bound of λ_max of symmetric matrices, from trace and norm. It is exact in 1D and 2D."""
    dim = A.shape[-1]
    mean = np.einsum("...ii->...", A) / dim
    spread = np.maximum((A**2).sum(axis=(-2, -1)) - dim * mean**2, 0.0)
    return mean + np.sqrt((dim - 1) / dim * spread)


def corners_of(P: np.ndarray, P1: np.ndarray, half: np.ndarray) -> np.ndarray:
    """P + Σ δ_a P_a at the corners (boxes, corners, dim, dim) of boxes of half widths `half`."""
    return P[:, None] + np.einsum("ca,na,naij->ncij", _corners(half.shape[1]), half, P1, optimize=True)


def is_negative(A: np.ndarray, excess: np.ndarray) -> np.ndarray:
    """Whether A + diag(excess) has no positive eigenvalue, for matrices A (boxes, corners, dim, dim).

    The pivots of −A − diag(excess) are computed. They are positive only if a matrix that differs by rounding is
    positive definite. `excess` (boxes, dim) includes that rounding.
    """
    dim = A.shape[-1]
    M, positive = -A - excess[:, None, :, None] * np.eye(dim), np.ones(A.shape[:2], bool)
    for k in range(dim):
        pivot = M[..., k, k]
        positive &= pivot > 0
        if k + 1 < dim:
            factor = M[..., k + 1 :, k] / np.where(pivot > 0, pivot, 1.0)[..., None]
            M[..., k + 1 :, k + 1 :] -= factor[..., :, None] * M[..., k, None, k + 1 :]
    return np.all(positive, axis=1)


def largest(A: np.ndarray, excess: np.ndarray) -> np.ndarray:
    """An upper bound of λ_max(P) (boxes,) from the corners of every box."""
    return _top(A).max(axis=1) + excess
