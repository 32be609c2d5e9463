"""Numba kernel of Silling's correspondence on a bordered 3D lattice: two passes of sums over rows of neighbours.

Opposite neighbours are combined: M = Σ w ξ⊗(u(+o) − u(−o)) over half the family. The offsets of one row (dx, dy) are
combined as well. Let D = u(row) − u(−row) and P = u(row) + u(−row), and let W_t be the weight at dz = t. One component
of u then gives

    s = W_0 D + Σ_t W_t (D(+t) + D(−t)),   q = Σ_t W_t t h (P(+t) − P(−t)),   M_x += dx h s,  M_y += dy h s,  M_z += q

The force f = Σ w ξ·(Z(+o) − Z(−o)) follows likewise, with G = dx h ΔZ_x + dy h ΔZ_y in place of D. This takes about a
third of the operations of a bond-by-bond sum, for any ω(|ξ|). At a surface, where the family is incomplete, the terms
−u⊗Σwξ in M and Z Σwξ in f remain; Σwξ is computed beforehand.
"""

import numpy as np
from numba import njit, prange

from .grid import ROWS
from .power import FAST


@njit(**FAST)
def _moments(u, m0, m1, m2, a, n, rows, weights, D, P):
    """Add Σ wξ_c (u(+o) − u(−o)) of one u component to m_c; rows (offset, dx h, dy h, largest t), weights (rows, t)."""
    m0, m1, m2 = m0[a : a + n], m1[a : a + n], m2[a : a + n]
    for r in range(len(rows)):
        o, x, y, w = int(rows[r, 0]), rows[r, 1], rows[r, 2], int(rows[r, 3])
        reach = w + w % 2
        size, low = n + 2 * reach, a - reach
        if o == 0:  # the point's own row
            plus, d, p = u[low : low + size], D[:size], P[:size]
            for k in range(size):
                d[k] = 0.0
                p[k] = plus[k]
        else:
            plus, minus, d, p = u[low + o : low + o + size], u[low - o : low - o + size], D[:size], P[:size]
            for k in range(size):
                d[k] = plus[k] - minus[k]
                p[k] = plus[k] + minus[k]
        middle, c = D[reach : reach + n], weights[r, 0]
        for k in range(n):
            m0[k] += x * c * middle[k]
            m1[k] += y * c * middle[k]
        for t in range(1, w + 1, 2):
            c, e, ct, et = weights[r, t], weights[r, t + 1], weights[r, t] * t, weights[r, t + 1] * (t + 1)
            f, b = reach + t, reach - t
            d1, d2, d3, d4 = D[f : f + n], D[b : b + n], D[f + 1 : f + 1 + n], D[b - 1 : b - 1 + n]
            p1, p2, p3, p4 = P[f : f + n], P[b : b + n], P[f + 1 : f + 1 + n], P[b - 1 : b - 1 + n]
            for k in range(n):
                s = c * (d1[k] + d2[k]) + e * (d3[k] + d4[k])
                m0[k] += x * s
                m1[k] += y * s
                m2[k] += ct * (p1[k] - p2[k]) + et * (p3[k] - p4[k])


@njit(**FAST)
def _divergence(z0, z1, z2, out, a, n, rows, weights, h, D, P):
    """Add Σ wξ·(Z(+o) − Z(−o)) of one row of Z to out."""
    out = out[a : a + n]
    for r in range(len(rows)):
        o, x, y, w = int(rows[r, 0]), rows[r, 1], rows[r, 2], int(rows[r, 3])
        reach = w + w % 2
        size, low = n + 2 * reach, a - reach
        d, p, p2 = D[:size], P[:size], z2[low + o : low + o + size]
        if o == 0:
            for k in range(size):
                d[k] = 0.0
                p[k] = h * p2[k]
        else:
            p0, p1 = z0[low + o : low + o + size], z1[low + o : low + o + size]
            q0, q1, q2 = z0[low - o : low - o + size], z1[low - o : low - o + size], z2[low - o : low - o + size]
            for k in range(size):
                d[k] = x * (p0[k] - q0[k]) + y * (p1[k] - q1[k])
                p[k] = h * (p2[k] + q2[k])
        middle, c = D[reach : reach + n], weights[r, 0]
        for k in range(n):
            out[k] += c * middle[k]
        for t in range(1, w + 1, 2):
            c, e, ct, et = weights[r, t], weights[r, t + 1], weights[r, t] * t, weights[r, t + 1] * (t + 1)
            f, b = reach + t, reach - t
            d1, d2, d3, d4 = D[f : f + n], D[b : b + n], D[f + 1 : f + 1 + n], D[b - 1 : b - 1 + n]
            p1, p2, p3, p4 = P[f : f + n], P[b : b + n], P[f + 1 : f + 1 + n], P[b - 1 : b - 1 + n]
            for k in range(n):
                s = c * (d1[k] + d2[k]) + e * (d3[k] + d4[k])
                out[k] += s + ct * (p1[k] - p2[k]) + et * (p3[k] - p4[k])


@njit(**FAST)
def _svk_row(M, u, first, K, Z, a, n, lam, mu):
    """H = (M − u⊗Σwξ) K⁻¹, P = F (λ tr E I + 2μE), Z = P K⁻¹ at n points from index a."""
    H = np.empty((3, 3))
    P = np.empty((3, 3))
    for k in range(a, a + n):
        k00, k01, k02, k11, k12, k22 = K[0, k], K[1, k], K[2, k], K[3, k], K[4, k], K[5, k]
        for i in range(3):
            x = M[3 * i, k] - u[i, k] * first[0, k]
            y = M[3 * i + 1, k] - u[i, k] * first[1, k]
            z = M[3 * i + 2, k] - u[i, k] * first[2, k]
            H[i, 0] = x * k00 + y * k01 + z * k02
            H[i, 1] = x * k01 + y * k11 + z * k12
            H[i, 2] = x * k02 + y * k12 + z * k22
        e00 = H[0, 0] + 0.5 * (H[0, 0] ** 2 + H[1, 0] ** 2 + H[2, 0] ** 2)
        e11 = H[1, 1] + 0.5 * (H[0, 1] ** 2 + H[1, 1] ** 2 + H[2, 1] ** 2)
        e22 = H[2, 2] + 0.5 * (H[0, 2] ** 2 + H[1, 2] ** 2 + H[2, 2] ** 2)
        e01 = mu * (H[0, 1] + H[1, 0] + H[0, 0] * H[0, 1] + H[1, 0] * H[1, 1] + H[2, 0] * H[2, 1])
        e02 = mu * (H[0, 2] + H[2, 0] + H[0, 0] * H[0, 2] + H[1, 0] * H[1, 2] + H[2, 0] * H[2, 2])
        e12 = mu * (H[1, 2] + H[2, 1] + H[0, 1] * H[0, 2] + H[1, 1] * H[1, 2] + H[2, 1] * H[2, 2])
        trace = lam * (e00 + e11 + e22)
        e00, e11, e22 = trace + 2 * mu * e00, trace + 2 * mu * e11, trace + 2 * mu * e22
        for i in range(3):
            P[i, 0] = H[i, 0] * e00 + H[i, 1] * e01 + H[i, 2] * e02
            P[i, 1] = H[i, 0] * e01 + H[i, 1] * e11 + H[i, 2] * e12
            P[i, 2] = H[i, 0] * e02 + H[i, 1] * e12 + H[i, 2] * e22
        P[0, 0] += e00
        P[0, 1] += e01
        P[0, 2] += e02
        P[1, 0] += e01
        P[1, 1] += e11
        P[1, 2] += e12
        P[2, 0] += e02
        P[2, 1] += e12
        P[2, 2] += e22
        for i in range(3):
            x, y, z = P[i, 0], P[i, 1], P[i, 2]
            Z[3 * i, k] = x * k00 + y * k01 + z * k02
            Z[3 * i + 1, k] = x * k01 + y * k11 + z * k12
            Z[3 * i + 2, k] = x * k02 + y * k12 + z * k22


def silling_kernel(threads):
    """Make the kernel of f with the St. Venant–Kirchhoff law. P and D of a block stay in the first-level cache."""

    def kernel(u, M, Z, f, first, K, rows, weights, h, lam, mu, nx, ny, nz, full, border):
        for i in prange(nx):
            D = np.empty(ROWS * full[2] + 4 * border + 8)
            P = np.empty(ROWS * full[2] + 4 * border + 8)
            for j in range(0, ny, ROWS):
                a = ((i + border) * full[1] + j + border) * full[2] + border
                n = (min(ROWS, ny - j) - 1) * full[2] + nz
                M[:, a : a + n] = 0.0
                for c in range(3):
                    _moments(u[c], M[3 * c], M[3 * c + 1], M[3 * c + 2], a, n, rows, weights, D, P)
                for row in range(min(ROWS, ny - j)):  # row by row, so that Z stays 0 in the border
                    b = a + row * full[2]
                    for c in range(3):
                        for k in range(b, b + nz):
                            M[3 * c + 2, k] *= h
                    _svk_row(M, u, first, K, Z, b, nz, lam, mu)
        for i in prange(nx):
            D = np.empty(ROWS * full[2] + 4 * border + 8)
            P = np.empty(ROWS * full[2] + 4 * border + 8)
            for j in range(0, ny, ROWS):
                a = ((i + border) * full[1] + j + border) * full[2] + border
                n = (min(ROWS, ny - j) - 1) * full[2] + nz
                for c in range(3):
                    x, y, z, g = Z[3 * c], Z[3 * c + 1], Z[3 * c + 2], f[c]
                    for k in range(a, a + n):
                        g[k] = x[k] * first[0, k] + y[k] * first[1, k] + z[k] * first[2, k]
                    _divergence(x, y, z, g, a, n, rows, weights, h, D, P)

    return njit(parallel=threads > 1, **FAST)(kernel)
