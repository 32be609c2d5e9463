"""What can an influence function do alone? Stability of Seth–Hill models, and springs whose waves follow ω = c k.

**A1. No influence function makes a Seth–Hill bar of order m = 1 stable in compression.** Take a chain of spacing 1.
The shells j = 1 … N have weights w_j of any sign, with L = 2 Σ w_j ≠ 0. The stretch is s, the stress S and the tangent
modulus M = dS/dE. Let γ(k) = (1/L) Σ (w_j/j²)(1 − cos jk). The symbol of the model of order m is exactly

    Ĵ(k) = −4 [(2m − 1) s^{2m−2} S γ(k) + M s^{4m−2} γ'(k)²].

1. γ(0) = 0 and γ''(0) = Σ w_j/L = ½, whatever the signs are. Hence γ has a positive maximum at some k* in (0, π].
   There γ'(k*) = 0, because k* is an interior maximum or because γ is even about π. The material term vanishes.
   What is left is Ĵ(k*) = −4 (2m − 1) s^{2m−2} S γ(k*). It is positive if (2m − 1) S < 0.
2. For m > ½ every influence function fails in compression, at any load and for any law with S < 0. For m < ½ every
   one fails in tension. At m = ½ the wave k* has no energy under any load.
3. Bernstein's inequality for γ, a cosine sum of degree N, gives ½ ≤ N² (max γ − min γ)/2. Stability on the other side
   needs γ ≥ 0. Then max γ ≥ 1/N², and the margin is at least |2m − 1| s^{2m−2} |S|/(M N²).
4. For a continuous horizon γ is an integral. If w/r² is integrable, γ' → 0 as k → ∞ and the same argument holds. For a
   constant ω it is not. Then γ grows like k, γ' stays bounded, and short waves fail.

**A2. Plane and solid, F = (1 + a) I, stress p I, dimension d.** At the half-reciprocal points (components 0 or π) all
sines vanish. With ω₀ = Σ w over the family,

    Ĵ = −(2 p d/ω₀) s^{2m−2} Σ (w/|ξ|²)(1 − cos k·ξ) [I + 2(m − 1) n⊗n].

For m = 1 let G = (1/ω₀) Σ (w/|ξ|²)(1 − cos k·ξ). Compression needs G ≤ 0 at all these points and tension needs
G ≥ 0. Both together need G = 0, which is a wave without energy. The worst margin over compression and tension is
therefore ≥ 0 for every influence function. The same holds at other orders, because Ĵ is proportional to p.

In compression alone, signed weights can have G < 0. On the square lattice with N = 2, G(π, 0) ∝ w₁ + w₂ and
G(π, π) ∝ w₁. If the shape tensor L is positive definite, then w₂ > 0 and w₁ + w₃ > 0, hence 0 < w₂ ≤ −w₁ < w₃. The
shear wave along the diagonal with cos k = −w₁/w₃ = x has no material term. With y = w₂/w₃ < 1 its G is proportional to
(1 + x)(1 + y) − 2x = 1 + y + xy − x > 0, because x < 1. So it grows. If L is indefinite this argument does not hold,
and some weights are stable in compression. pdjax refuses an indefinite L. They are judged here by the formula.

**B. Discrete micromoduli.** A chain of springs a_j = c ω_j/j has ω² = Σ 2 a_j (1 − cos jk). Its modulus is set to
Σ a_j j² = 1. `pd.design` minimises the largest error |ω/(ck) − 1| up to kh. Independently, a linear program decides for
every bound of the error whether there are such springs. Required is a margin at rest of at most −0.1: no wave grows,
none is without energy, and none is softer than a tenth of the springs of N = 1. In 2D (λ = μ, both branches, all
directions) the independent method is a sequence of linear programs.

The problem is that of R. A. Wildman, "Discrete micromodulus functions for reducing wave dispersion in linearized
peridynamics", 2019, doi 10.1007/s42102-018-0001-0. His coefficients are not reproduced. Compared are the usual
micromoduli, the Fourier series k² = Σ 4 (−1)^{j+1} (1 − cos jk)/j² cut off at N, and the central differences of order
2N (Fornberg 1988).
"""

import argparse
import json
import time
from functools import partial
from math import factorial

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq, differential_evolution, linprog, minimize

import pdjax as pd
from pdjax.bench.harness import results, with_null, write
from pdjax.figures import SERIES
from pdjax.infinite_lattice.bloch import homogeneous_tangent, wave_phases

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)
ALL = ("hydrostatic", "uniaxial-strain", "uniaxial-stress", "simple-shear")
LATTICES = ((2, 2), (2, 3), (3, 2))  # dimension and N of the margins
WAVES = (1.0, 2.0, 3.0)  # largest kh of the dispersion errors
FLOOR = 0.1  # least ω²/(M κ²) of a micromodulus at rest


def shell_family(dim: int, N: int, weights):
    """The family of a lattice of spacing 1 with one weight of any sign for each shell."""
    influence = pd.interpolated_influence(pd.shells(dim, N), weights)
    return pd.lattice_family(dim, N, influence=pd.signed_influence(influence))


# A. Stability of Seth–Hill models.


def chain_gamma(weights, k) -> tuple[np.ndarray, np.ndarray]:
    """γ(k) and γ'(k) of a chain."""
    j = np.arange(1, len(weights) + 1)
    share, x = np.asarray(weights) / (2 * np.sum(weights)), np.multiply.outer(k, j)
    return (1 - np.cos(x)) @ (share / j**2), np.sin(x) @ (share / j)


def least_margin(weights, m: float, a: float) -> float:
    """The quotient λ/(M κ²) of the theorem at the maximum of γ, for a linear law: a lower bound of the margin."""
    k = np.pi * np.arange(1, 4001) / 4000
    top = k[np.argmax(chain_gamma(weights, k)[0])]
    if top < np.pi:
        low, high = top - 1e-3, min(top + 1e-3, np.pi)
        slopes = [chain_gamma(weights, x)[1] for x in (low, high)]
        top = brentq(lambda x: chain_gamma(weights, x)[1], low, high) if slopes[0] * slopes[1] < 0 else top
    strain = np.log1p(a) if m == 0 else np.expm1(2 * m * np.log1p(a)) / (2 * m)
    gamma = chain_gamma(weights, top)[0]
    return float(-(2 * m - 1) * (1 + a) ** (2 * m - 2) * strain * gamma / np.sin(top / 2) ** 2)


def random_chains(count: int) -> dict:
    """Margins of chains with random signed weights on both sides, for several orders."""
    rng, rows = np.random.default_rng(5), []
    for m in (1.0, 0.75, 0.5, 0.0, -1.0):
        for n in range(count):
            N = 1 + n % 6
            family = shell_family(1, N, _signed(rng, N))
            weights, model = np.asarray(family.influence)[:N], pd.SethHill(m, LAW)
            for a in (-0.05, 0.05):
                found = float(pd.worst_margin(model, family, np.array([[[1 + a]]])))
                rows.append((m, N, a, found, least_margin(weights, m, a)))
    out = {}
    for m in sorted({row[0] for row in rows}):
        for a in (-0.05, 0.05):
            some = np.array([row[3:] for row in rows if row[0] == m and row[2] == a])
            out[f"m = {m:g}, a = {a:+g}"] = {
                "chains": len(some),
                "unstable": int((some[:, 0] > 1e-9).sum()),
                "least margin": float(some[:, 0].min()),
                "least excess over the bound": float((some[:, 0] - some[:, 1]).min()),
            }
    return out


def _signed(rng, N: int) -> np.ndarray:
    """Random weights of both signs, scaled to Σ w > 0 that is not tiny."""
    while True:
        w = rng.uniform(-1, 1, N)
        if abs(w.sum()) > 0.1:
            return w * np.sign(w.sum())


class Lattice:
    """The sums over the shells of a lattice of spacing 1, with NumPy alone: an independent evaluation of m = 1."""

    def __init__(self, dim: int, N: int, intervals: int):
        reach = np.arange(-N, N + 1)
        xi = np.stack(np.meshgrid(*[reach] * dim, indexing="ij"), -1).reshape(-1, dim)
        square = (xi**2).sum(1)
        xi, square = xi[(square > 0) & (square <= N * N)], square[(square > 0) & (square <= N * N)]
        n, self.dim = xi / np.sqrt(square)[:, None], dim
        grid = np.stack(np.meshgrid(*[np.pi * np.arange(intervals + 1) / intervals] * dim, indexing="ij"), -1)
        grid = grid.reshape(-1, dim)
        grid = grid[(np.diff(grid, axis=1) <= 0).all(1) & (grid[:, 0] > 0)]
        face = grid[grid[:, 0] == np.pi]  # Short wave vectors in all directions: a narrow maximum may be near 0.
        self.k = np.concatenate([grid] + [face * f for f in np.geomspace(0.008, 0.95, 24)])
        self.half = np.isin(self.k, (0, np.pi)).all(1)
        self.kappa2 = (4 * np.sin(self.k / 2) ** 2).sum(1)
        of = square[:, None] == np.unique(square)  # (bonds, shells)
        phase = self.k @ xi.T
        self.G = (1 - np.cos(phase)) / square @ of
        self.H = np.einsum("kb,bi,bj,bl,bs->kijls", np.sin(phase) / np.sqrt(square), n, n, n, of, optimize=True)
        self.L = np.einsum("bi,bj,bk,bl,bs->ijkls", n, n, n, n, of)
        self.count = of.sum(0)
        A, B, C = self.L[0, 0, 0, 0], self.L[0, 0, 1, 1], self.L[0, 1, 0, 1]
        self.tensor = np.stack([A + (dim - 1) * B, A - B, 2 * C])  # eigenvalues of L for each shell

    def material(self, weights) -> np.ndarray:
        """The material part of −Ĵ at rest at every wave for LinearElastic(1, 1)."""
        dim = self.dim
        inverse = np.linalg.pinv((self.L @ weights).reshape(dim * dim, -1), rcond=1e-12)
        strain = np.einsum("ab,kbl->kal", inverse, (self.H @ weights).reshape(len(self.k), -1, dim))
        trace = strain.reshape(-1, dim, dim, dim).trace(axis1=1, axis2=2)
        return np.einsum("ki,kj->kij", trace, trace) + 2 * np.einsum("kai,kaj->kij", strain, strain)

    def margins(self, weights, loads, material=None) -> np.ndarray:
        """The largest λ_max/(M κ²) over the waves of every hydrostatic load, m = 1, LinearElastic(1, 1)."""
        material = self.material(weights) if material is None else material
        G = self.dim * (self.G @ weights) / (self.count @ weights)
        out = []
        for a in loads:
            p = (self.dim + 2) * ((1 + a) ** 2 - 1) / 2
            J = -2 * p * G[:, None, None] * np.eye(self.dim) - (1 + a) ** 2 * material
            out.append((np.linalg.eigvalsh(J)[:, -1] / (3 * self.kappa2)).max())
        return np.array(out)

    def definite(self, weights) -> float:
        """The smallest eigenvalue of L over the largest in size, for weights with Σ w > 0."""
        values = self.tensor @ weights * np.sign(self.count @ weights)
        return float(values.min() / np.abs(values).max())


def half_reciprocal_program(dim: int, N: int) -> dict:
    """The largest t with G ≤ −t (compression) or G ≥ t (tension) at all half-reciprocal points, L definite, |w| ≤ 1.

    G is scaled by Σ w of the constant influence function. A linear program, with and without negative weights.
    """
    lattice = Lattice(dim, N, 2)
    rows = np.unique(lattice.G[lattice.half].round(12), axis=0)
    total, shells = lattice.count.sum(), len(lattice.count)
    out = {"G of each shell": rows.tolist()}
    for name, low in (("positive", 0), ("signed", -1)):
        for side, sign in (("compression", 1), ("tension", -1)):
            ahead = np.hstack([sign * rows / total, np.ones((len(rows), 1))])
            firm = np.hstack([-lattice.tensor / total, np.zeros((3, 1))])
            done = linprog(
                np.r_[np.zeros(shells), -1], np.vstack([ahead, firm]), np.r_[np.zeros(len(rows)), np.full(3, -0.01)],
                bounds=[(low, 1)] * shells + [(None, None)],
            )  # fmt: skip
            out[f"{name}, {side}"] = -float(done.fun)
    return out


def best_margin(dim: int, N: int, cases, low: float, starts: int, steps: int) -> dict:
    """The least worst margin that `pd.design` finds over the weights of the shells."""
    model, shells, begun = pd.SethHill(1.0, LAW), len(pd.shells(dim, N)), time.perf_counter()
    found = pd.design(
        lambda w: (model, shell_family(dim, N, w)), np.full(shells, 0.6), partial(_worst, cases=cases),
        bounds=(low, 1.0), starts=starts, steps=steps, show_progress=False,
    )  # fmt: skip
    weights = np.asarray(found.parameters)
    return {
        "weights": (weights / np.abs(weights).max()).tolist(),
        "margin": found.objective,
        "judged": float(found.judged["objective"]),
        "step": float(pd.lattice_time_step(found.model, found.family)),
        "evaluations": found.evaluations,
        "seconds": time.perf_counter() - begun,
        "ending": found.reason,
    }


def _worst(model, family, cases):
    return pd.worst_margin(model, family, cases)


def global_margin(dim: int, N: int, loads, low: float, intervals: int, rounds: int) -> dict:
    """The same without pdjax and without gradients: differential evolution of the formula, then Nelder–Mead."""
    lattice = Lattice(dim, N, intervals)

    def objective(w):
        firm = lattice.definite(w)
        return lattice.margins(w, loads).max() if firm > 1e-3 else 10 - firm

    bounds = [(low, 1.0)] * len(lattice.count)
    found = differential_evolution(objective, bounds, maxiter=rounds, popsize=10, seed=1, tol=1e-7, polish=False)
    found = minimize(objective, found.x, method="Nelder-Mead", bounds=bounds, options={"maxiter": 800})
    weights = found.x * np.sign(lattice.count @ found.x) / np.abs(found.x).max()
    family = shell_family(dim, N, weights)
    fine = pd.worst_margin(pd.SethHill(1.0, LAW), family, pd.load_cases("hydrostatic", loads), resolution=16 * N)
    return {"weights": weights.tolist(), "margin": float(found.fun), "judged": float(fine)}


def indefinite(dim: int, N: int, intervals: int, rounds: int) -> dict:
    """Signed weights with an indefinite L that are stable at −1 and −5 %: those of the largest time step."""
    lattice, loads = Lattice(dim, N, intervals), (-0.01, -0.05)
    plain = np.linalg.eigvalsh(lattice.material(np.ones(len(lattice.count)))).max()

    def objective(w):
        values = lattice.tensor @ w
        if np.abs(values).min() < 1e-3 * np.abs(values).max():
            return 1e3
        material = lattice.material(w)
        worst = (lattice.margins(w, loads, material) / np.abs(loads)).max()
        return np.sqrt(np.linalg.eigvalsh(material).max() / plain) if worst <= -0.05 else 1e2 + min(worst, 1e2)

    bounds = [(-1.0, 1.0)] * len(lattice.count)
    found = differential_evolution(objective, bounds, maxiter=rounds, popsize=15, seed=1, tol=1e-7, polish=False)
    weights = found.x * np.sign(lattice.count @ found.x) / np.abs(found.x).max()
    fine = Lattice(dim, N, 3 * intervals)
    material, sides = fine.material(weights), (-0.1, -0.05, -0.01, 0.01, 0.05)
    top = float(np.sqrt(np.linalg.eigvalsh(material).max() / np.linalg.eigvalsh(fine.material(weights**0)).max()))
    return {
        "weights": weights.tolist(),
        "eigenvalues of L": (fine.tensor @ weights).tolist(),
        "step of the constant influence over this step": top,
        "margins": {
            f"{100 * a:+g} %": float(x) for a, x in zip(sides, fine.margins(weights, sides, material), strict=True)
        },
        "margin at -5 % by pdjax": _unchecked_margin(weights, fine, N, -0.05),
    }


def _unchecked_margin(weights, lattice: Lattice, N: int, a: float) -> float:
    """The margin by the tangent of pdjax, which works for an indefinite L, without the check that refuses it."""
    dim = lattice.dim
    tangent = homogeneous_tangent(pd.SethHill(1.0, LAW), shell_family(dim, N, weights), (1 + a) * jnp.eye(dim))
    J = np.asarray(tangent(wave_phases(shell_family(dim, N, weights), jnp.asarray(lattice.k))))
    return float((np.linalg.eigvalsh((J + J.swapaxes(1, 2)) / 2)[:, -1] / (3 * lattice.kappa2)).max())


def margins(quick: bool) -> dict:
    """The least worst margins in 2D and 3D."""
    out: dict = {}
    for dim, N in ((2, 2),) if quick else LATTICES:
        row: dict = {"half-reciprocal points": half_reciprocal_program(dim, N)}
        both, press = [-0.05, -0.01, 0.01, 0.05], [-0.05, -0.01]
        plain = pd.SethHill(1.0, LAW), pd.lattice_family(dim, N)
        row["constant step"] = float(pd.lattice_time_step(*plain))
        every = pd.load_cases(ALL, both)
        row["all paths, constant"] = float(pd.worst_margin(*plain, every))
        for name, loads in (("hydrostatic, both sides", both), ("hydrostatic, compression", press)):
            cases = pd.load_cases("hydrostatic", loads)
            row[name] = {"constant": float(pd.worst_margin(*plain, cases))}
            for sign, low in (("positive", 0.0), ("signed", -1.0)):
                many = (10, 20) if quick else (12, 70) if dim == 2 else (5, 70)
                other = global_margin(dim, N, loads, low, *many)
                found = best_margin(dim, N, cases, low, 1, 15 if quick or dim == 3 else 40)
                best = min(found, other, key=lambda x: x["judged"])["weights"]
                found["all paths"] = float(pd.worst_margin(plain[0], shell_family(dim, N, np.array(best)), every))
                row[name][sign] = found | {"independent": other}
                print(dim, N, name, sign, row[name][sign], flush=True)
        if N == 2:
            row["indefinite L, compression"] = indefinite(dim, N, 12 if dim == 2 else 5, 30 if quick else 150)
            print(row["indefinite L, compression"], flush=True)
        out[f"{dim}D, N = {N}"] = row
    return out


# B. Discrete micromoduli.


class Springs:
    """The waves of springs a_s of the shells, ω² = eig Σ a_s (1 − cos k·ξ) n⊗n, with NumPy alone.

    The basic solution has the exact moduli of λ = μ = 1 in 2D and M = 1 in 1D, and so has base + basis·x for every x.
    """

    def __init__(self, dim: int, N: int, kh: float, samples: int):
        self.dim, self.N = dim, N
        reach = np.arange(-N, N + 1)
        xi = np.stack(np.meshgrid(*[reach] * dim, indexing="ij"), -1).reshape(-1, dim)
        square = (xi**2).sum(1)
        self.xi, square = xi[(square > 0) & (square <= N * N)], square[(square > 0) & (square <= N * N)]
        self.n = self.xi / np.sqrt(square)[:, None]
        self.of = (square[:, None] == np.unique(square)).astype(float)
        self.lengths = np.sqrt(np.unique(square))
        angles = np.arange(7) * np.pi / 24 if dim == 2 else np.zeros(1)
        radii = kh * np.sin(np.pi / 2 * np.arange(1, samples + 1) / samples)  # dense near kh, as the extrema are
        compass = np.stack([np.cos(angles), np.sin(angles)], 1)[:, :dim]
        self.k = (radii[:, None, None] * compass).reshape(-1, dim)
        self.speeds = np.array([1.0]) if dim == 1 else np.array([1.0, 3.0])  # squares, shear first
        moment = self.n**4 if dim == 1 else np.stack([self.n[:, 0] ** 4, (self.n[:, 0] * self.n[:, 1]) ** 2], 1)
        self.moduli = (moment * square[:, None] / 2).T @ self.of
        self.wanted = np.array([1.0]) if dim == 1 else np.array([3.0, 1.0])

    def tables(self, k) -> np.ndarray:
        """Σ (1 − cos k·ξ) n⊗n/k² of every shell, (waves, dim, dim, shells)."""
        c = (1 - np.cos(k @ self.xi.T)) / (k**2).sum(1)[:, None]
        return np.einsum("kb,bi,bj,bs->kijs", c, self.n, self.n, self.of, optimize=True)

    def errors(self, a, k=None) -> np.ndarray:
        """ω/(ck) − 1 of every wave and branch; −1 for a wave that grows."""
        values = np.linalg.eigvalsh(self.tables(self.k if k is None else k) @ a)
        return np.sqrt(np.maximum(values, 0) / self.speeds) - 1

    def coordinates(self) -> tuple[np.ndarray, np.ndarray, float]:
        """A first design and directions in which its errors change equally fast, and its largest error.

        In 1D the first design is the central difference of order 2N, in 2D the least squares of Σ (Ĵ − Q)².
        """
        table = self.tables(self.k).reshape(-1, self.of.shape[1])
        free = np.linalg.svd(self.moduli)[2][len(self.wanted) :].T
        left, size, right = np.linalg.svd(table @ free, full_matrices=False)
        del left
        if self.dim == 1:
            base = central_difference(self.N)
        else:
            base = np.linalg.lstsq(self.moduli, self.wanted, rcond=None)[0]
            n = self.k / np.linalg.norm(self.k, axis=1)[:, None]
            law = (np.eye(2) + 2 * n[:, :, None] * n[:, None, :]).reshape(-1)
            base = base + free @ np.linalg.lstsq(table @ free, law - table @ base, rcond=None)[0]
        worst = float(np.abs(self.errors(base)).max())
        return base, free @ right.T / size * worst * np.sqrt(len(table)), worst

    def build(self, a) -> tuple:
        """The model and the family of springs a."""
        return pd.BondBased(1.0), shell_family(self.dim, self.N, a * self.lengths)


def central_difference(N: int) -> np.ndarray:
    """Springs whose ω² is the central difference of order 2N for k²: the flattest error at k = 0."""
    j = range(1, N + 1)
    return np.array(
        [2 * (-1) ** (i + 1) * factorial(N) ** 2 / (i * i * factorial(N - i) * factorial(N + i)) for i in j]
    )


def published(N: int) -> dict:
    """The usual micromoduli of a chain: springs a_j = c ω_j/j with the exact modulus, and the cut Fourier series."""
    j = np.arange(1.0, N + 1)
    shapes = {"constant": 1 / j, "inverse distance": 1 / j**2, "linear": (1 - j / (N + 1e-9)) / j}
    out = {name: a / (a @ j**2) for name, a in shapes.items() if N > 1 or name != "linear"}
    out["Fourier, cut off"] = 2 * (-1) ** (j + 1) / j**2  # its modulus is 2 for odd N and 0 for even N
    if N % 2:
        out["Fourier, rescaled"] = (-1) ** (j + 1) / j**2
    return out | {"central difference": central_difference(N)}


def _zone(dim: int) -> np.ndarray:
    """Waves of the irreducible zone, at which a design must be stiffer than the floor."""
    x = np.pi * np.arange(1, 9) / 8
    return x[:, None] if dim == 1 else np.array([(p, q) for p in x for q in (0, *x) if q <= p])[::2]


def designed(springs: Springs, steps: int) -> tuple[np.ndarray, dict]:
    """The springs of the least largest error by `pd.design`: minimise t with ±error ≤ t and the floor."""
    base, basis, size = springs.coordinates()
    k, I, begun = jnp.asarray(springs.k), np.eye(springs.dim), time.perf_counter()
    square = (springs.k**2).sum(1)[:, None]

    zone = jnp.asarray(_zone(springs.dim))
    kappa2 = (4 * jnp.sin(zone / 2) ** 2).sum(1)

    @jax.jit  # Model and family are made inside the program: an evaluation then takes milliseconds.
    def errors(x, t):
        model, family = springs.build(base + basis @ x)
        squares = jnp.linalg.eigvalsh(-pd.symbol(model, family, I, jnp.concatenate([k, zone])))
        ratio = squares[: len(k)] / square / springs.speeds
        e = jnp.where(ratio > 0, jnp.sqrt(jnp.where(ratio > 0, ratio, 1.0)), ratio) - 1
        soft = FLOOR - squares[len(k) :, 0] / kappa2 / springs.speeds[-1]
        return jnp.concatenate([(jnp.stack([e, -e]) / size - t).ravel(), soft])

    found = pd.design(
        lambda p: (p["x"], p["t"]), {"x": np.zeros(basis.shape[1]), "t": 1.0}, lambda x, t: t,
        {"error": errors}, bounds=({"x": -5.0, "t": 0.0}, {"x": 5.0, "t": 2.0}), steps=steps, tolerance=1e-5,
        show_progress=False,
    )  # fmt: skip
    row = {"evaluations": found.evaluations, "seconds": time.perf_counter() - begun, "ending": found.reason}
    return base + basis @ np.asarray(found.parameters["x"]), row


def linear_program(springs: Springs) -> np.ndarray:
    """The least largest error of a chain: for a bound e, ω² in [(1 − e)², (1 + e)²] c²k² is a linear program."""
    j, rest = springs.lengths, np.pi * np.arange(1, 201)[:, None] / 200
    R = springs.tables(springs.k)[:, 0, 0]
    soft = springs.tables(rest)[:, 0, 0] * (rest / (2 * np.sin(rest / 2))) ** 2
    one = np.ones((len(R), 1))
    A = np.vstack([np.hstack([R, -one]), np.hstack([-R, -one]), np.hstack([-soft, 0 * rest])])

    def solved(e):
        b = np.r_[np.full(len(R), (1 + e) ** 2), np.full(len(R), -((1 - e) ** 2)), np.full(len(rest), -FLOOR)]
        tight = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
        return linprog(np.r_[0 * j, 1], A, b, [np.r_[j**2, 0]], [1], [(None, None)] * (len(j) + 1), options=tight)

    return np.ones(1) if len(j) == 1 else solved(brentq(lambda e: solved(e).fun, 0, 0.9, xtol=1e-13)).x[:-1]


def successive_programs(springs: Springs, start: np.ndarray, rounds: int = 60) -> np.ndarray:
    """The same in 2D by linear programs of the linearised errors in a shrinking trust region."""
    table, a, trust = springs.tables(springs.k), start, 0.1
    best = np.abs(springs.errors(a)).max()
    for _ in range(rounds):
        values, vectors = np.linalg.eigh(table @ a)
        slope = np.einsum("kib,kijs,kjb->kbs", vectors, table, vectors, optimize=True)
        e = np.sqrt(values / springs.speeds) - 1
        slope = (slope / (2 * np.sqrt(values * springs.speeds))[..., None]).reshape(-1, len(a))
        one, e = np.ones((e.size, 1)), e.ravel()
        A, b = np.vstack([np.hstack([slope, -one]), np.hstack([-slope, -one])]), np.r_[-e, e]
        free = np.hstack([springs.moduli, np.zeros((len(springs.wanted), 1))])
        done = linprog(np.r_[0 * a, 1], A, b, free, 0 * springs.wanted, [(-trust, trust)] * len(a) + [(0, None)])
        if done.x is None:
            break
        new = np.abs(springs.errors(a + done.x[:-1])).max()
        a, best, trust = (a + done.x[:-1], new, trust) if new < best else (a, best, trust / 2)
    return a


def judged(springs: Springs, a: np.ndarray, fine: Springs) -> dict:
    """Error on a fine grid of waves, margin at rest and time step of springs a."""
    out = {"springs": np.asarray(a).tolist(), "error": float(np.abs(fine.errors(a)).max())}
    if abs(springs.moduli[0] @ a) < 1e-9 or not (springs.moduli @ a > 0).all():
        return out | {"margin": None, "step": None}
    model, family = springs.build(jnp.asarray(a))
    out["margin"] = float(pd.worst_margin(model, family, np.eye(springs.dim)))
    return out | {"step": float(pd.lattice_time_step(model, family))}


def micromoduli(quick: bool) -> dict:
    """Errors of wave speed up to kh of the published, the designed and the best possible micromoduli."""
    rows = []
    for kh in (2.0,) if quick else WAVES:
        for N in (2, 3) if quick else (1, 2, 3, 4, 5, 6):
            springs, fine = Springs(1, N, kh, 40), Springs(1, N, kh, 1000)
            row = {"dim": 1, "N": N, "kh": kh}
            row |= {name: judged(springs, a, fine) for name, a in published(N).items()}
            row["best"] = judged(springs, linear_program(springs), fine)
            if N in (2, 3, 6):
                a, search = designed(springs, 200)
                row["designed"] = judged(springs, a, fine) | search
            rows.append(row)
            print({x: y["error"] if isinstance(y, dict) else y for x, y in row.items()}, flush=True)
        springs, fine = Springs(2, 3, kh, 8), Springs(2, 3, kh, 60)
        row = {"dim": 2, "N": 3, "kh": kh}
        for name in ("constant", "inverse distance", "linear"):
            family = pd.lattice_family(2, 3, influence=name)
            lengths = np.linalg.norm(np.asarray(family.xi), axis=1)
            omega = np.array([np.asarray(family.influence)[np.argmin(abs(lengths - r))] for r in springs.lengths])
            a = float(pd.BondBased.from_family(2.0, family).c) * omega / springs.lengths
            row[name] = judged(springs, a, fine)
        base = springs.coordinates()[0]
        row["least squares"] = judged(springs, base, fine)
        row["best"] = judged(springs, successive_programs(springs, base), fine)
        a, search = designed(springs, 200)
        row["designed"] = judged(springs, a, fine) | search
        rows.append(row)
        print({x: y["error"] if isinstance(y, dict) else y for x, y in row.items()}, search, flush=True)
    return {"rows": rows}


def draw(numbers: dict) -> Figure:
    """Draw ω/(ck) for N = 3, the error against N, and the least worst margins."""
    figure = Figure(figsize=(13.5, 4.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    rows = numbers["micromoduli"]["rows"]
    chains = [r for r in rows if r["dim"] == 1]
    k = np.linspace(0.01, np.pi, 300)[:, None]
    N = 3
    curves = {f"{name}": (a, "--") for name, a in published(N).items()}
    for row in chains:
        if row["N"] == N:
            curves[f"designed for kh ≤ {row['kh']:g}"] = np.array(row["designed"]["springs"]), "-"
    springs = Springs(1, N, 1.0, 8)
    for i, (name, (a, style)) in enumerate(curves.items()):
        colour = SERIES[(i + 1) % 3] if style == "-" else SERIES[i % len(SERIES)]
        left.plot(k[:, 0], springs.errors(a, k)[:, 0] + 1, style, color=colour, lw=1.7, label=name)
    left.axhline(1, color="black", lw=0.8)
    left.set(xlabel="kh  [–]", ylabel="ω/(ck)  [–]", ylim=(0, 1.5), title="chain of springs, N = 3")
    left.legend(fontsize=7, frameon=False, loc="lower left")
    for i, kh in enumerate(sorted({r["kh"] for r in chains})):
        some = [r for r in chains if r["kh"] == kh]
        colour = SERIES[i % len(SERIES)]
        middle.semilogy([r["N"] for r in some], [r["best"]["error"] for r in some], color=colour)
        found = [r for r in some if "designed" in r]
        middle.semilogy([r["N"] for r in found], [r["designed"]["error"] for r in found], "o", color=colour)
        middle.semilogy([r["N"] for r in some], [r["central difference"]["error"] for r in some], ":", color=colour)
        middle.semilogy([r["N"] for r in some], [r["constant"]["error"] for r in some], "--", color=colour)
        middle.plot([], [], color=colour, label=f"kh ≤ {kh:g}")
    for style, name in (("-", "linear program"), ("o", "designed by gradient"), (":", "central difference")):
        middle.plot([], [], style, color="gray", label=name)
    middle.plot([], [], "--", color="gray", label="constant")
    middle.set(xlabel="N = horizon/spacing  [–]", ylabel="max |ω/(ck) − 1|  [–]", title="error of wave speed, 1D")
    middle.legend(fontsize=7, frameon=False, loc="lower left")
    names, ticks = ("constant", "positive", "signed"), []
    plane = {where: row for where, row in numbers["margins"].items() if where != "seconds"}
    for group, (where, row) in enumerate(plane.items()):
        for block, name in enumerate(n for n in row if n.startswith("hydrostatic, ")):
            for i, sign in enumerate(names):
                if sign not in row[name]:
                    continue
                value = row[name][sign] if sign == "constant" else least(row[name][sign])
                at = 4.2 * group + 1.3 * block + 0.35 * i
                right.bar(at, value, 0.33, color=SERIES[i], label=sign if not group + block else None)
            side = "±" if "both" in name else "−"
            ticks.append((4.2 * group + 1.3 * block + 0.35, f"{where.replace(', ', chr(10))}\n{side}"))
    right.set_xticks([t[0] for t in ticks], [t[1] for t in ticks], fontsize=7)
    right.set(ylabel="least worst margin found  [–]", title="Seth–Hill m = 1: positive is unstable")
    right.set_xlabel("hydrostatic loads of 1 and 5 %, ± or − alone")
    right.legend(fontsize=8, frameon=False)
    return figure


def least(row: dict) -> float:
    """The smaller of the margins that the design and the independent search found, both judged on the finer grid."""
    return min(row["judged"], row["independent"]["judged"])


PARTS = {"theorem": lambda quick: random_chains(12 if quick else 120), "margins": margins, "micromoduli": micromoduli}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("parts", nargs="*", help=f"some of {', '.join(PARTS)}; the kept numbers of the others stay")
    parser.add_argument("--quick", action="store_true", help="few chains, 2D with N = 2, and one wave number")
    args = parser.parse_args()
    name = "influence_design-quick" if args.quick else "influence_design"
    file = results() / f"{name}.json"
    made: dict = {}
    for part in args.parts or PARTS:
        begun = time.perf_counter()
        made[part] = {**PARTS[part](args.quick), "seconds": 0.0}
        made[part]["seconds"] = time.perf_counter() - begun
    kept = json.loads(file.read_text()) if args.parts and file.exists() else {}
    numbers = {part: {**kept, **made}[part] for part in PARTS if part in {**kept, **made}}
    write(name, with_null(numbers), draw(numbers) if len(numbers) == len(PARTS) else None)


if __name__ == "__main__":
    main()
