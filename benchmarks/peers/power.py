"""The Seth–Hill strain of a row of bonds, vectorised; both sets of Numba kernels use it.

    e = ((1 + g)^m − 1)/2m = ½ g Σ_k c_k g^k,   c_0 = 1,  c_k = c_{k−1} (m − k)/(k + 1)

With 24 terms the binomial series is exact to rounding for |g| ≤ 0.2, also for m = 0. It needs a few multiply-adds for
each bond, while calls of log and exp take tens of nanoseconds. For larger |g| the functions of libm are called.
"""

import numpy as np
from numba import njit

FAST = {"fastmath": True, "error_model": "numpy"}
TERMS = 24


def series(m):
    """Coefficients ½ c_k of the series, for k < TERMS."""
    c = [0.5]
    for k in range(1, TERMS):
        c.append(c[-1] * (m - k) / (k + 1))
    return np.array(c)


@njit(**FAST)
def power_strain(g, x, m, series):
    """Replace g by e in place; x is a spare row."""
    n = len(g)
    if m == 1:
        for k in range(n):
            g[k] *= 0.5
        return
    top = 0.0
    for k in range(n):
        top = max(top, abs(g[k]))
    if top > 0.2:
        for k in range(n):
            ell = np.log1p(g[k])
            g[k] = 0.5 * ell if m == 0 else np.expm1(m * ell) / (2 * m)
        return
    blocks = 1 + int(-38 / np.log(max(top, 1e-17))) // 6  # the omitted terms are below 10^-16.5 of the sum
    last = 6 * min(blocks, len(series) // 6) - 6
    for k in range(n):
        x[k] = g[k]
        g[k] = 0.0
    for start in range(last, -1, -6):  # Horner's rule, six terms for each pass over the row
        c0, c1, c2 = series[start], series[start + 1], series[start + 2]
        c3, c4, c5 = series[start + 3], series[start + 4], series[start + 5]
        for k in range(n):
            y = x[k]
            g[k] = (((((g[k] * y + c5) * y + c4) * y + c3) * y + c2) * y + c1) * y + c0
    for k in range(n):
        g[k] *= x[k]
