"""Numba kernels of forces on a uniform 3D lattice, bond by bond: bond-based (PMB), LPS, Seth–Hill.

A row of points is combined with a row of neighbours at one offset, so that all loads are plain vector loads. Each bond
is computed once, and its result is added at both ends. `inside` is 0 where z + dz lies outside the body. Each thread
sums into its own grid; the grids are added at the end. The reference quantities are given. The influence function may
be any ω(|ξ|); the volumes are equal.
"""

import numpy as np
from numba import njit, prange

from .grid import ROWS
from .power import FAST, power_strain


def bond_sweep(bond, threads):
    """Make the loop over all bonds.

    `bond(fields, out, spare, a, b, n, row, inside)` treats n points from index a with their neighbours from index b.
    `row` holds the constants of the offset.
    """

    def sweep(fields, out, cells, offset, table, inside, nx, ny, stride):
        parts = out.shape[0]
        reach = inside.shape[0] // 2
        for part in prange(parts):
            mine = out[part]
            mine[:] = 0.0
            spare = np.empty((6, ROWS * stride))
            for x in range(part * nx // parts, (part + 1) * nx // parts):
                for y0 in range(0, ny, ROWS):
                    for h in range(len(offset)):
                        if x + cells[h, 0] >= nx:
                            continue
                        first = max(y0, -cells[h, 1])
                        last = min(y0 + ROWS, ny, ny - cells[h, 1])
                        if first < last:
                            a = (x * ny + first) * stride
                            n = (last - first) * stride
                            bond(fields, mine, spare, a, a + offset[h], n, table[h], inside[reach + cells[h, 2]])

    return njit(parallel=threads > 1, **FAST)(sweep)


@njit(**FAST)
def _bond_strain(fields, spare, a, b, n, row):
    """Write Y to rows 0 to 2 of spare and g = (2ξ·η + η·η)/|ξ|² to row 3; `row` starts with ξ, 1/|ξ|²."""
    x, y, z, inv = row[0], row[1], row[2], row[3]
    ax, ay, az = fields[0, a : a + n], fields[1, a : a + n], fields[2, a : a + n]
    bx, by, bz = fields[0, b : b + n], fields[1, b : b + n], fields[2, b : b + n]
    s0, s1, s2, s3 = spare[0, :n], spare[1, :n], spare[2, :n], spare[3, :n]
    for k in range(n):
        ex, ey, ez = bx[k] - ax[k], by[k] - ay[k], bz[k] - az[k]
        s3[k] = ((2 * x + ex) * ex + (2 * y + ey) * ey + (2 * z + ez) * ez) * inv
        s0[k], s1[k], s2[k] = x + ex, y + ey, z + ez


@njit(**FAST)
def _on_both_ends(out, spare, a, b, n):
    """Add f_i += t Y and f_j −= t Y, where t is row 3 of spare."""
    t = spare[3, :n]
    for c in range(3):
        Y, here, there = spare[c, :n], out[c, a : a + n], out[c, b : b + n]
        for k in range(n):
            here[k] += t[k] * Y[k]
        for k in range(n):
            there[k] -= t[k] * Y[k]


@njit(**FAST)
def pmb_bond(fields, out, spare, a, b, n, row, inside):
    """t = c w (s − 1)/(s |ξ|) = c w g/((1 + s) s |ξ|)."""
    _bond_strain(fields, spare, a, b, n, row)
    t, c = spare[3, :n], row[4]
    for k in range(n):
        s = np.sqrt(1 + t[k])
        t[k] = c * inside[k] * t[k] / (s + 1 + t[k])
    _on_both_ends(out, spare, a, b, n)


@njit(**FAST)
def dilatation_bond(fields, out, spare, a, b, n, row, inside):
    """Add w |ξ| e at both ends, with |ξ| e = |ξ|² g/(1 + s)."""
    _bond_strain(fields, spare, a, b, n, row)
    t, c = spare[3, :n], row[4]
    here, there = out[0, a : a + n], out[0, b : b + n]
    for k in range(n):
        t[k] = c * inside[k] * t[k] / (1 + np.sqrt(1 + t[k]))
    for k in range(n):
        here[k] += t[k]
    for k in range(n):
        there[k] += t[k]


@njit(**FAST)
def lps_bond(fields, out, spare, a, b, n, row, inside):
    """t = w [p_i + p_j + (α_i + α_j)(s − 1)]/s; fields 3 and 4 are p and α."""
    _bond_strain(fields, spare, a, b, n, row)
    t, w = spare[3, :n], row[5]
    p, q, alpha, beta = fields[3, a : a + n], fields[3, b : b + n], fields[4, a : a + n], fields[4, b : b + n]
    for k in range(n):
        s = np.sqrt(1 + t[k])
        t[k] = w * inside[k] * (p[k] + q[k] + (alpha[k] + beta[k]) * t[k] / (1 + s)) / s
    _on_both_ends(out, spare, a, b, n)


@njit(**FAST)
def moment_bond(fields, out, spare, a, b, n, row, inside):
    """Add w e_m n⊗n (6 Mandel components) at both ends; row[4]: m, row[6:12]: w n⊗n, row[18:]: series of e_m."""
    _bond_strain(fields, spare, a, b, n, row)
    g = spare[3, :n]
    power_strain(g, spare[0, :n], row[4], row[18:])
    for k in range(n):
        g[k] *= inside[k]
    for p in range(6):
        c = row[6 + p]
        if c != 0:
            here, there = out[p, a : a + n], out[p, b : b + n]
            for k in range(n):
                here[k] += c * g[k]
            for k in range(n):
                there[k] += c * g[k]


@njit(**FAST)
def seth_hill_bond(fields, out, spare, a, b, n, row, inside):
    """t = w n·(Z_i + Z_j) n s^{2m−2}/|ξ|²; fields 3 to 8: Z, row[5]: w/|ξ|², row[12:18]: n⊗n."""
    _bond_strain(fields, spare, a, b, n, row)
    t, m, w = spare[3, :n], row[4], row[5]
    v0, v1, v2, v3, v4, v5 = row[12], row[13], row[14], row[15], row[16], row[17]
    z0, z1, z2 = fields[3, a : a + n], fields[4, a : a + n], fields[5, a : a + n]
    z3, z4, z5 = fields[6, a : a + n], fields[7, a : a + n], fields[8, a : a + n]
    y0, y1, y2 = fields[3, b : b + n], fields[4, b : b + n], fields[5, b : b + n]
    y3, y4, y5 = fields[6, b : b + n], fields[7, b : b + n], fields[8, b : b + n]
    if m != 1:
        square, spare_row = spare[4, :n], spare[5, :n]
        for k in range(n):
            square[k] = 1 + t[k]
        power_strain(t, spare_row, m, row[18:])
        for k in range(n):
            t[k] = (1 + 2 * m * t[k]) / square[k]
    else:
        for k in range(n):
            t[k] = 1.0
    for k in range(n):
        q = v0 * (z0[k] + y0[k]) + v1 * (z1[k] + y1[k]) + v2 * (z2[k] + y2[k])
        q += v3 * (z3[k] + y3[k]) + v4 * (z4[k] + y4[k]) + v5 * (z5[k] + y5[k])
        t[k] *= w * inside[k] * q
    _on_both_ends(out, spare, a, b, n)


@njit(**FAST)
def point_product(moments, out, matrices, kind, shape, full):
    """Set out[:, i] = matrices[kind_i] Σ_threads moments[:, i] at every point of the body."""
    nx, ny, nz = shape
    size = moments.shape[1]
    for i in range(nx):
        for j in range(ny):
            a = (i * full[1] + j) * full[2]
            b = (i * ny + j) * nz
            for p in range(size):
                for t in range(1, moments.shape[0]):
                    for k in range(nz):
                        moments[0, p, a + k] += moments[t, p, a + k]
            for k in range(nz):
                A = matrices[kind[b + k]]
                for p in range(size):
                    total = 0.0
                    for q in range(size):
                        total += A[p, q] * moments[0, q, a + k]
                    out[p, a + k] = total
