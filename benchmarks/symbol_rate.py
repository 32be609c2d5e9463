"""Symbols per second: pdjax, a hand-written Numba kernel, and a direct computation by `jax.jacrev`.

One symbol is Ĵ(k) of one state (m, F) at one wave vector, with its largest eigenvalue. For each state the maximum over
the Brillouin zone is kept, as in a stability map. F is general: of the symmetries only inversion is used.

* pdjax linearises once for each state. Two matrix products with shared tables and closed-form eigenvalues follow.
* Numba computes the same for LinearElastic alone, in the shorter form −(Σ b c + r̂ᵀ D r̂), where D = ℂ is a constant
  p × p matrix. The kernel works on blocks of waves, so that the accumulators stay in the cache. It uses threads over
  the states and fastmath. NumPy computes its linearisation, which is not timed.
* naive takes one row of the Jacobian of a patch by `jax.jacrev` and sums it over the points with e^{ik·η}, all in one
  compiled program.

Operations per symbol: in 2D (N = 3, 14 bonds in half a family) there are 3 + 2·6 rows, hence 15·14 multiply-adds, and
about 60 operations for the product and the eigenvalue: 0.5 kflop. In 3D (61 bonds) there are 6 + 2·18 rows, hence
42·61 multiply-adds: 5.4 kflop.
"""

import jax
import jax.numpy as jnp
import numba
import numpy as np

import pdjax as pd
from pdjax.bench.harness import timed, write
from pdjax.infinite_lattice import bloch
from pdjax.infinite_lattice import brillouin as zone
from pdjax.models.kinematics import direction_mandel

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)


@jax.jit
def structured(m, F, family, waves):
    """Maximum of λ_max over all waves, for every state."""
    phases = bloch.wave_phases(family, waves)

    def one(m, F):
        tangent = bloch.homogeneous_tangent(pd.SethHill(m, LAW), family, F)
        return jnp.max(zone.largest_eigenvalue(tangent.components(phases)))

    return jax.vmap(one)(m, F)


@numba.njit(parallel=True, fastmath=True, cache=False)
def by_hand(b, r, D, c, s, dim):
    """The same by Numba: b (states, pairs, half), r (states, p·dim, half), D (p, p), tables c, s (half, waves)."""
    states, pairs, half = b.shape
    rows, waves, p = r.shape[1], c.shape[1], D.shape[0]
    out = np.full(states, -np.inf)
    block = 128
    for n in numba.prange(states):
        direct = np.empty((pairs, block))
        odd = np.empty((rows, block))
        best = -np.inf
        for start in range(0, waves, block):
            size = min(block, waves - start)
            direct[:] = 0.0
            odd[:] = 0.0
            for h in range(half):
                for i in range(pairs):
                    x = b[n, i, h]
                    for k in range(size):
                        direct[i, k] += x * c[h, start + k]
                for i in range(rows):
                    x = r[n, i, h]
                    for k in range(size):
                        odd[i, k] += x * s[h, start + k]
            for i in range(dim):
                for j in range(i, dim):
                    pair = i * dim - i * (i - 1) // 2 + j - i
                    for q in range(p):
                        for l in range(p):
                            if D[q, l] != 0.0:
                                x = D[q, l]
                                for k in range(size):
                                    direct[pair, k] += odd[q * dim + i, k] * x * odd[l * dim + j, k]
            if dim == 2:
                for k in range(size):
                    mean, gap = -(direct[0, k] + direct[2, k]) / 2, (direct[0, k] - direct[2, k]) / 2
                    best = max(best, mean + np.sqrt(gap * gap + direct[1, k] ** 2))
            else:
                for k in range(size):
                    xx, xy, xz = -direct[0, k], -direct[1, k], -direct[2, k]
                    yy, yz, zz = -direct[3, k], -direct[4, k], -direct[5, k]
                    mean = (xx + yy + zz) / 3
                    xx, yy, zz = xx - mean, yy - mean, zz - mean
                    size2 = (xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 6
                    root = np.sqrt(size2)
                    det = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
                    cosine = min(1.0, max(-1.0, det / (2 * size2 * root + 1e-300)))
                    best = max(best, mean + 2 * root * np.cos(np.arccos(cosine) / 3))
        out[n] = best
    return out


def hand_coefficients(m, F, family):
    """Coefficients b, r, D of the Numba kernel, computed by NumPy for all states."""
    dim, half = family.dim, family.xi.shape[0] // 2
    xi = np.asarray(family.xi)[:half]
    square = (xi**2).sum(axis=1)
    v = np.asarray(direction_mandel(jnp.asarray(xi)))
    L = 2 * v.T @ v
    Y = np.einsum("nij,hj->nhi", F, xi)
    stretch2 = (Y**2).sum(axis=2) / square
    strain = np.where(
        m[:, None] == 0, np.log(stretch2) / 2, (stretch2 ** m[:, None] - 1) / (2 * m[:, None] + (m[:, None] == 0))
    )
    p = v.shape[1]
    trace = (np.arange(p) < dim).astype(float)
    D = np.outer(trace, trace) + 2 * np.eye(p)
    E = np.linalg.solve(L, 2 * v.T @ strain.T).T
    Z = np.linalg.solve(L, D @ E.T).T
    growth = stretch2 ** (m[:, None] - 1)
    y = Y / np.sqrt(square * stretch2)[:, :, None]
    inner = 2 * (m[:, None, None, None] - 1) * y[..., :, None] * y[..., None, :] + np.eye(dim)
    B = 2 * (Z @ v.T * growth / square)[:, :, None, None] * inner
    upper = [(i, j) for i in range(dim) for j in range(i, dim)]
    b = np.stack([B[:, :, i, j] for i, j in upper], axis=1)
    r = 2 * np.linalg.solve(L, v.T)[None, :, :, None] * (growth / square)[:, None, :, None] * Y[:, None]
    return b, np.ascontiguousarray(r.transpose(0, 1, 3, 2).reshape(len(m), p * dim, half)), D


def naive(dim, N):
    """Compiled function (m, F, k) → λ_max of Ĵ(k), from the Jacobian row (`jax.jacrev`) of a two-horizon patch."""
    cells = 4 * N + 1
    body = pd.lattice((cells,) * dim)
    families = pd.families(body, float(N))
    centre = len(body) // 2
    X = jnp.asarray(body.positions)

    @jax.jit
    def top(m, F, k):
        u = X @ (F - jnp.eye(dim)).T
        model = pd.SethHill(m, LAW)
        row = jax.jacrev(lambda u: pd.force_density(model, families, u)[centre])(u)
        wave = jnp.cos((X - X[centre]) @ k)
        return jnp.linalg.eigvalsh(jnp.einsum("inj,n->ij", row, wave))[-1]

    return top


def case(dim: int, states: int, chunk: int, intervals: int, naive_symbols: int) -> dict:
    family = pd.lattice_family(dim, 3)
    waves = np.asarray(zone.brillouin_zone(dim, intervals, "inversion").grid)
    rng = np.random.default_rng(0)
    m = rng.uniform(-2, 2, states)
    F = np.eye(dim) + rng.uniform(-0.1, 0.1, (states, dim, dim))
    symbols = states * len(waves)

    def ours():
        return [
            structured(jnp.asarray(m[i : i + chunk]), jnp.asarray(F[i : i + chunk]), family, jnp.asarray(waves))
            for i in range(0, states, chunk)
        ]

    b, r, D = hand_coefficients(m, F, family)
    phases = bloch.wave_phases(family, jnp.asarray(waves))
    c, s = (np.ascontiguousarray(np.asarray(x).T) for x in (phases.c, phases.s))
    one = timed(ours)
    two = timed(lambda: by_hand(b, r, D, c, s, dim))
    difference = np.abs(np.concatenate(ours()) - by_hand(b, r, D, c, s, dim)).max()
    slow = naive(dim, 3)
    three = timed(lambda: [slow(m[i], F[i], jnp.asarray(waves[i])) for i in range(naive_symbols)], repeats=3)
    exact = np.asarray(structured(jnp.asarray(m[:3]), jnp.asarray(F[:3]), family, jnp.asarray(waves[:1])))
    off = max(abs(float(slow(m[i], F[i], jnp.asarray(waves[0]))) - exact[i]) for i in range(3))
    rate = {
        "pdjax": symbols / one["median"],
        "numba": symbols / two["median"],
        "naive": naive_symbols / three["median"],
    }
    return {
        "states": states,
        "waves": len(waves),
        "symbols per second": rate,
        "pdjax over numba": rate["pdjax"] / rate["numba"],
        "pdjax over naive": rate["pdjax"] / rate["naive"],
        "largest difference pdjax - numba (of |λ| about 0.1)": float(difference),
        "largest difference pdjax - naive": float(off),
        "seconds": {"pdjax": one, "numba": two, "naive": three},
    }


if __name__ == "__main__":
    write(
        "symbol_rate",
        {
            "2D, N = 3": case(2, states=4096, chunk=64, intervals=24, naive_symbols=20),
            "3D, N = 3": case(3, states=256, chunk=4, intervals=10, naive_symbols=2),
        },
    )
