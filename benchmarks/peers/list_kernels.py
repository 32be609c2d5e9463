"""Hand-written Numba kernels of forces on any 3D cloud, with a list of neighbours for each point (compressed rows).

Each pair is stored once. The fields of the neighbours are copied into short rows, the vector unit computes on these
rows, and the result is added at both ends. Two alternatives took twice as long: gather instructions of the vector unit,
and computing each bond once from each end. Each thread sums into its own arrays. The weights W = ω V_i V_j are
the same from both ends; a sum at point i is divided by V_i at the end. Volumes may therefore differ, but ω_ij = ω_ji
is required.

Layout of `rows`: 0 to 2 hold ξ, 3 to 5 hold η, 6 and following hold the state of the neighbour, then the results of the
bond. `here` is the state of the point itself.
"""

import numpy as np
from numba import njit, prange

from .power import FAST, power_strain


def list_sweep(bond, states, results, sign, threads):
    """Make the loop over all pairs. The near end receives the result, the far end `sign` times the result."""
    last = 6 + states

    def sweep(u, X, A, start, near, weight, inv, constants, width, out):
        parts = out.shape[0]
        points = len(u)
        for part in prange(parts):
            mine = out[part]
            mine[:] = 0.0
            rows = np.empty((last + results + 1, width))
            for i in range(part * points // parts, (part + 1) * points // parts):
                a, n = start[i], start[i + 1] - start[i]
                js = near[a : a + n]
                for b in range(n):
                    j = np.uint64(js[b])  # an unsigned index saves Numba's test for negative indices
                    for c in range(3):
                        rows[c, b] = X[j, c] - X[i, c]
                    for c in range(3):
                        rows[3 + c, b] = u[j, c] - u[i, c]
                    for c in range(states):
                        rows[6 + c, b] = A[j, c]
                bond(rows, A[i], n, weight[a : a + n], inv[a : a + n], constants)
                for c in range(results):
                    total = 0.0
                    for b in range(n):
                        total += rows[last + c, b]
                    mine[i, c] += total
                for b in range(n):
                    j = np.uint64(js[b])
                    for c in range(results):
                        mine[j, c] += sign * rows[last + c, b]

    return njit(parallel=threads > 1, **FAST)(sweep)


@njit(**FAST)
def _strain_row(rows, n, inv, g):
    """g = (2ξ·η + η·η)/|ξ|²."""
    x, y, z, ex, ey, ez = rows[0, :n], rows[1, :n], rows[2, :n], rows[3, :n], rows[4, :n], rows[5, :n]
    for b in range(n):
        g[b] = ((2 * x[b] + ex[b]) * ex[b] + (2 * y[b] + ey[b]) * ey[b] + (2 * z[b] + ez[b]) * ez[b]) * inv[b]


@njit(**FAST)
def _along_bond(rows, n, first, t):
    """Write t Y to the result rows."""
    for c in range(3):
        xi, eta, out = rows[c, :n], rows[3 + c, :n], rows[first + c, :n]
        for b in range(n):
            out[b] = t[b] * (xi[b] + eta[b])


@njit(**FAST)
def pmb_row(rows, here, n, weight, inv, constants):
    """t = W c (s − 1)/(s|ξ|)."""
    t = rows[9, :n]
    _strain_row(rows, n, inv, t)
    for b in range(n):
        t[b] = weight[b] * t[b] / (np.sqrt(1 + t[b]) + 1 + t[b])
    _along_bond(rows, n, 6, t)


@njit(**FAST)
def dilatation_row(rows, here, n, weight, inv, constants):
    """W |ξ| e = W |ξ|² g/(1 + s)."""
    t = rows[6, :n]
    _strain_row(rows, n, inv, t)
    for b in range(n):
        t[b] = weight[b] * t[b] / (inv[b] * (1 + np.sqrt(1 + t[b])))


@njit(**FAST)
def lps_row(rows, here, n, weight, inv, constants):
    """t = W [p_i + p_j + (α_i + α_j)(s − 1)]/s; the state is (p, α)."""
    t, p, alpha = rows[11, :n], rows[6, :n], rows[7, :n]
    _strain_row(rows, n, inv, t)
    for b in range(n):
        s = np.sqrt(1 + t[b])
        t[b] = weight[b] * (here[0] + p[b] + (here[1] + alpha[b]) * t[b] / (1 + s)) / s
    _along_bond(rows, n, 8, t)


@njit(**FAST)
def moment_row(rows, here, n, weight, inv, constants):
    """W e_m n⊗n as a Mandel vector; constants: m, then the series of e_m."""
    x, y, z, g = rows[0, :n], rows[1, :n], rows[2, :n], rows[12, :n]
    _strain_row(rows, n, inv, g)
    power_strain(g, rows[11, :n], constants[0], constants[1:])
    o0, o1, o2, o3, o4, o5 = rows[6, :n], rows[7, :n], rows[8, :n], rows[9, :n], rows[10, :n], rows[11, :n]
    for b in range(n):
        e = weight[b] * inv[b] * g[b]
        ex, ey, r = e * x[b], e * y[b], np.sqrt(2.0)
        o0[b], o1[b], o2[b] = ex * x[b], ey * y[b], e * z[b] * z[b]
        o3[b], o4[b], o5[b] = r * ex * y[b], r * ex * z[b], r * ey * z[b]


@njit(**FAST)
def seth_hill_row(rows, here, n, weight, inv, constants):
    """t = W n·(Z_i + Z_j) n s^{2m−2}/|ξ|²; the state is Z, a Mandel vector."""
    x, y, z, t, spare, square = rows[0, :n], rows[1, :n], rows[2, :n], rows[15, :n], rows[12, :n], rows[13, :n]
    z0, z1, z2, z3, z4, z5 = rows[6, :n], rows[7, :n], rows[8, :n], rows[9, :n], rows[10, :n], rows[11, :n]
    _strain_row(rows, n, inv, t)
    m = constants[0]
    if m != 1:
        for b in range(n):
            square[b] = 1 + t[b]
        power_strain(t, spare, m, constants[1:])
        for b in range(n):
            t[b] = (1 + 2 * m * t[b]) / square[b]
    else:
        for b in range(n):
            t[b] = 1.0
    h0, h1, h2, h3, h4, h5 = here[0], here[1], here[2], here[3], here[4], here[5]
    for b in range(n):
        q = (h0 + z0[b]) * x[b] * x[b] + (h1 + z1[b]) * y[b] * y[b] + (h2 + z2[b]) * z[b] * z[b]
        r = (h3 + z3[b]) * x[b] * y[b] + (h4 + z4[b]) * x[b] * z[b] + (h5 + z5[b]) * y[b] * z[b]
        t[b] *= weight[b] * inv[b] * inv[b] * (q + np.sqrt(2.0) * r)
    _along_bond(rows, n, 12, t)


@njit(**FAST)
def gradient_row(rows, here, n, weight, inv, constants):
    """W η⊗ξ."""
    for i in range(3):
        eta = rows[3 + i, :n]
        for j in range(3):
            xi, out = rows[j, :n], rows[6 + 3 * i + j, :n]
            for b in range(n):
                out[b] = weight[b] * eta[b] * xi[b]


@njit(**FAST)
def silling_row(rows, here, n, weight, inv, constants):
    """t = W (Z_i + Z_j) ξ."""
    x, y, z = rows[0, :n], rows[1, :n], rows[2, :n]
    for i in range(3):
        z0, z1, z2, out = rows[6 + 3 * i, :n], rows[7 + 3 * i, :n], rows[8 + 3 * i, :n], rows[15 + i, :n]
        h0, h1, h2 = here[3 * i], here[3 * i + 1], here[3 * i + 2]
        for b in range(n):
            out[b] = weight[b] * ((h0 + z0[b]) * x[b] + (h1 + z1[b]) * y[b] + (h2 + z2[b]) * z[b])


@njit(**FAST)
def point_product(parts, matrices, out):
    """Set out_i[:n] = matrices_i Σ_threads sums_i, where n is the length of a sum."""
    n = parts.shape[2]
    for i in range(len(out)):
        for part in range(1, parts.shape[0]):
            for q in range(n):
                parts[0, i, q] += parts[part, i, q]
        for p in range(n):
            total = 0.0
            for q in range(n):
                total += matrices[i, p, q] * parts[0, i, q]
            out[i, p] = total


@njit(**FAST)
def collect(parts, volumes, out):
    """Set f_i = Σ_threads sums_i / V_i."""
    for i in range(len(out)):
        for c in range(3):
            total = 0.0
            for part in range(parts.shape[0]):
                total += parts[part, i, c]
            out[i, c] = total / volumes[i]


@njit(**FAST)
def svk_states(parts, K, volumes, lam, mu, Z):
    """H = (Σ_threads sums / V) K⁻¹, E = sym H + ½HᵀH, P = (I + H)(λ tr E I + 2μE), Z = P K⁻¹ at every point."""
    M, H, S, P = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(len(K)):
        for i in range(3):
            for j in range(3):
                M[i, j] = 0.0
                for part in range(parts.shape[0]):
                    M[i, j] += parts[part, n, 3 * i + j] / volumes[n]
        for i in range(3):
            for j in range(3):
                H[i, j] = M[i, 0] * K[n, 0, j] + M[i, 1] * K[n, 1, j] + M[i, 2] * K[n, 2, j]
        trace = 0.0
        for i in range(3):
            for j in range(3):
                S[i, j] = H[i, j] + H[j, i] + H[0, i] * H[0, j] + H[1, i] * H[1, j] + H[2, i] * H[2, j]
            trace += 0.5 * S[i, i]
        for i in range(3):
            for j in range(3):
                S[i, j] *= mu
            S[i, i] += lam * trace
        for i in range(3):
            for j in range(3):
                P[i, j] = S[i, j] + H[i, 0] * S[0, j] + H[i, 1] * S[1, j] + H[i, 2] * S[2, j]
        for i in range(3):
            for j in range(3):
                Z[n, 3 * i + j] = P[i, 0] * K[n, 0, j] + P[i, 1] * K[n, 1, j] + P[i, 2] * K[n, 2, j]
