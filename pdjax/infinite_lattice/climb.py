"""Local maxima of the quotient vᵀA(x)v / (vᵀv κ²(x)) over x and v together, from many starts at once.

A **start** is a pair (x, v) of a wave vector and a unit vector. To **climb** is to go from a start to a local maximum.
The largest eigenvalue of A(x)/κ²(x) has kinks where eigenvalues cross. The quotient over x and v is smooth and has the
same maxima. A and κ² are given with their first and second derivatives (`Forms` in
`pdjax.infinite_lattice.cosine_series`). Each step is therefore a Newton step with exact gradient g and Hessian H,
damped by the method of Levenberg and Marquardt:

    (σ − H) p = g,    σ large enough for a positive definite matrix, 10 times smaller after every step that climbs.

A term −vvᵀ in H fixes the length of v, on which the quotient does not depend. Near a maximum the steps converge
quadratically, and the error of the quotient is the square of the last step. Concrete arrays are treated in NumPy, which
compiles nothing. Traced arrays are treated in a JAX loop.
Source: Levenberg 1944; Marquardt 1963.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from .._internal.checks import namespace
from .bloch import squared_chord
from .cosine_series import Forms, Series, forms, packed, upper

# Largest number of steps. From a start next to a maximum 8 to 12 were measured. A start that needs more moves slowly
# along a ridge, towards a maximum that another start reaches.
STEPS = 24
SMALLEST, LARGEST = 1e-9, 1e9  # range of σ, relative to the norm of H
NOTHING = 1e-3  # A step whose expected gain is below this × eps × the norm of H is the last one.


def _gradient_and_hessian(f: Forms, v: Float[Any, "*lanes dim"]) -> tuple[Any, Any, Any]:
    """The quotient q and its first and second derivatives over (x, v), at a unit vector v."""
    xp = namespace(v)
    Av = xp.einsum("...ij,...j->...i", f.A, v)
    A1v = xp.einsum("...aij,...j->...ai", f.A1, v)
    n = xp.sum(v * Av, axis=-1)
    n1 = xp.einsum("...ai,...i->...a", A1v, v)
    n2 = xp.einsum("...abij,...i,...j->...ab", f.A2, v, v)
    q, over = n / f.scale, 1 / f.scale
    q_, over_ = q[..., None, None], over[..., None, None]
    gx = (n1 - q[..., None] * f.scale1) * over[..., None]
    gv = 2 * (Av - n[..., None] * v) * over[..., None]

    def outer(a, b):
        return a[..., :, None] * b[..., None, :]

    mixed = outer(f.scale1, gx)
    xx = (n2 - q_ * f.scale2 - mixed - mixed.mT) * over_
    xv = (2 * (A1v - outer(n1, v)) - outer(f.scale1, gv)) * over_
    eye = xp.eye(v.shape[-1], dtype=v.dtype)
    turn = outer(v, gv)
    vv = 2 * (f.A - n[..., None, None] * eye) * over_ - 2 * (turn + turn.mT)
    top, bottom = xp.concatenate([xx, xv], axis=-1), xp.concatenate([xv.mT, vv], axis=-1)
    return q, xp.concatenate([gx, gv], axis=-1), xp.concatenate([top, bottom], axis=-2)


def _solved(A: Float[Any, "*lanes n n"], b: Float[Any, "*lanes n"]) -> tuple[Any, Bool[Any, "*lanes"]]:
    """A⁻¹ b by elimination without pivoting, and whether A is positive definite. If it is not, ignore A⁻¹ b."""
    xp, n = namespace(A), A.shape[-1]
    M, unit, pivots = xp.concatenate([A, b[..., None]], axis=-1), np.eye(n), []
    for k in range(n):
        pivots.append(M[..., k, k])
        row = M[..., k, :] / M[..., k, k, None]
        M = M - (M[..., :, k] - unit[k].astype(A.dtype))[..., :, None] * row[..., None, :]
    return M[..., -1], xp.min(xp.stack(pivots), axis=0) > 0


def climb(
    evaluate: Callable[[Any], Forms], x: Float[Any, "*lanes dim"], v: Float[Any, "*lanes dim"], reach: float
) -> tuple[Float[Any, "*lanes dim"], Float[Any, "*lanes dim"], Float[Any, "*lanes"]]:
    """The local maxima (x, unit v, quotient) that are reached from the starts (x, unit v).

    No step moves x by more than `reach`. A start whose quotient is not finite does not move and gets the quotient −inf.
    """
    xp, dim, real = namespace(x, v), x.shape[-1], x.dtype
    eps = float(np.finfo(real).eps)

    def body(state):
        count, (x, v, q, g, H), sigma, p, usable, done = state
        first = count == 0
        w = v + p[..., dim:]
        trial = x + p[..., :dim], w / xp.sqrt(xp.sum(w**2, axis=-1, keepdims=True))
        new = (*trial, *_gradient_and_hessian(evaluate(trial[0]), trial[1]))
        better = usable & ~done & (new[2] >= q) & (new[2] < xp.inf)

        def taken(a, b):
            return xp.where(better.reshape(better.shape + (1,) * (a.ndim - better.ndim)), a, b)

        gain = xp.sum(g * p, axis=-1)  # twice the gain that the quadratic model predicts
        done |= xp.where(first, ~better, usable & (gain <= NOTHING * eps * xp.sqrt(xp.sum(H**2, axis=(-2, -1)))))
        x, v, q, g, H = here = tuple(taken(a, b) for a, b in zip(new, (x, v, q, g, H), strict=True))
        size = xp.sqrt(xp.sum(H**2, axis=(-2, -1)))
        sigma = xp.where(first, 0.1 * size, xp.where(better, sigma / 10, 5 * sigma))
        sigma = xp.maximum(sigma, SMALLEST * size)
        gauge = xp.concatenate([xp.zeros_like(v), v], axis=-1)
        damped = sigma[..., None, None] * np.eye(2 * dim).astype(real) - H
        p, usable = _solved(damped + size[..., None, None] * gauge[..., :, None] * gauge[..., None, :], g)
        p = p * xp.minimum(1.0, reach / xp.sqrt(xp.sum(p[..., :dim] ** 2, axis=-1, keepdims=True)))
        return count + 1, here, sigma, p, usable, done | (sigma > LARGEST * size)

    def go_on(state):
        return (state[0] < STEPS) & ~xp.all(state[-1])

    lanes, n = x.shape[:-1], 2 * dim
    blank = xp.full(lanes, -xp.inf, real), xp.zeros((*lanes, n), real), xp.zeros((*lanes, n, n), real)
    yes = xp.ones(lanes, bool)
    start = (0, (x, v, *blank), xp.ones(lanes, real), xp.zeros((*lanes, n), real), yes, ~yes)
    if xp is np:
        with np.errstate(all="ignore"):  # Finished starts and starts that are not finite raise warnings.
            while go_on(start):
                start = body(start)
    else:
        start = jax.lax.while_loop(go_on, body, start)
    x, v, q = start[1][:3]
    return x, v, q


def climb_series(
    blocks: np.ndarray, offsets: np.ndarray, x: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`climb` on the concrete series of several states, from waves x (states, lanes, dim) and their softest modes.

    Of the blocks (states, offsets, dim, dim) only the symmetric part counts.
    """
    terms, (_, place) = packed(blocks), upper(offsets.shape[1])
    A = -(squared_chord(x @ offsets.T) @ terms)[..., place]
    series, no = Series.of(terms, offsets), np.zeros(x.shape[1], bool)
    return climb(lambda x: forms(series, x, no, no), x, np.linalg.eigh(A)[1][..., -1], reach)
