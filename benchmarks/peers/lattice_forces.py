"""Forces of a 3D lattice body by hand-written kernels, one class for each model.

f = Model(grid, …, threads) makes a force, and f(u) evaluates it. NumPy computes here, once, the quantities that do not
depend on u: ξ, w, |ξ|, m_w, L⁻¹ C L⁻¹, K⁻¹, Σwξ. Near a surface they are sums over the point's own, incomplete family,
as in pdjax.
"""

from functools import cache

import numpy as np

from . import lattice_kernels as kernels
from .grid import collect, spread
from .power import series
from .silling_kernel import silling_kernel


def mandel(xi):
    """The tensors n⊗n of bonds (bonds, 3) as Mandel vectors (bonds, 6): xx, yy, zz, √2 xy, √2 xz, √2 yz."""
    n = xi / np.linalg.norm(xi, axis=1)[:, None]
    i, j = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    return n[:, i] * n[:, j] * np.where(np.equal(i, j), 1.0, np.sqrt(2))


def isotropic(lam, mu):
    """The stiffness λ I⊗I + 2μ 𝟙 as a Mandel matrix."""
    trace = (np.arange(6) < 3).astype(float)
    return lam * np.outer(trace, trace) + 2 * mu * np.eye(6)


@cache
def _sweep(bond, threads):
    return kernels.bond_sweep(bond, threads)


class _Bondwise:
    """Base class of the bond-by-bond models: it holds u, the states of the points, and the sums of each thread."""

    def __init__(self, grid, threads, states=0):
        self.grid, self.threads = grid, threads
        self.fields = np.zeros((3 + states, grid.size))
        self.sums = np.zeros((threads, 3, grid.size))
        self.square = np.sum(grid.xi**2, axis=1)

    def _over_bonds(self, bond, out):
        g = self.grid
        sweep = _sweep(bond, self.threads)
        sweep(self.fields, out, g.cells, g.offset, self.table, g.inside, *g.full)

    def _start(self, u):
        spread(np.asarray(u), self.fields[:3], self.grid.shape, self.grid.full, 0)

    def _state(self, sums):
        """Compute the states of the points: a constant matrix times the sums."""
        states = self.fields[3 : 3 + sums.shape[1]]
        kernels.point_product(sums, states, self.matrices, self.kind, self.grid.shape, self.grid.full)

    def _end(self):
        out = np.empty((self.grid.points_count, 3))
        collect(self.sums, out, self.grid.shape, self.grid.full, 0)
        return out


class PMB(_Bondwise):
    """`pd.BondBased(c)`: f = Σ c w (s − 1) Y/|Y|."""

    def __init__(self, grid, c, threads=1):
        super().__init__(grid, threads)
        self.table = np.column_stack([grid.xi, 1 / self.square, c * grid.w / np.sqrt(self.square)])

    def __call__(self, u):
        self._start(u)
        self._over_bonds(kernels.pmb_bond, self.sums)
        return self._end()


class LPS(_Bondwise):
    """`pd.LPS(bulk, shear)`; the state of a point is (p, α)."""

    def __init__(self, grid, bulk, shear, threads=1):
        super().__init__(grid, threads, states=2)
        self.table = np.column_stack([grid.xi, 1 / self.square, grid.w * self.square, grid.w])
        m_w = grid.family_sums((grid.w * self.square)[:, None])[:, 0]
        kinds, self.kind = np.unique(m_w, return_inverse=True)
        self.matrices = ((3 * bulk - 5 * shear) * 3 / kinds**2)[:, None, None]  # p = (3k − 5G) θ/m_w, θ = 3 Σ/m_w
        self.fields[4] = grid.flat((15 * shear / m_w)[:, None])[0]
        self.theta = np.zeros((threads, 1, grid.size))

    def __call__(self, u):
        self._start(u)
        self._over_bonds(kernels.dilatation_bond, self.theta)
        self._state(self.theta)
        self._over_bonds(kernels.lps_bond, self.sums)
        return self._end()


class SethHill(_Bondwise):
    """`pd.SethHill(m, pd.LinearElastic(lam, mu))`; the state is Z = L⁻¹ C L⁻¹ Σ w e_m n⊗n, a Mandel vector."""

    def __init__(self, grid, m, lam, mu, threads=1):
        super().__init__(grid, threads, states=6)
        n, v = len(grid.w), mandel(grid.xi)
        order, terms = np.full(n, float(m)), np.broadcast_to(series(m), (n, len(series(m))))
        constants = [grid.xi, 1 / self.square, order, grid.w / self.square, grid.w[:, None] * v, v, terms]
        self.table = np.column_stack(constants)
        L = grid.family_sums(np.einsum("b,bp,bq->bpq", grid.w, v, v).reshape(n, 36))
        # Points with equally cut families share a matrix. There are at most (2r + 1)³ different matrices.
        _, first, self.kind = np.unique(np.round(L / L.max(), 12), axis=0, return_index=True, return_inverse=True)
        inverse = np.linalg.inv(L[first].reshape(-1, 6, 6))
        self.matrices = inverse @ isotropic(lam, mu) @ inverse
        self.moments = np.zeros((threads, 6, grid.size))

    def __call__(self, u):
        self._start(u)
        self._over_bonds(kernels.moment_bond, self.moments)
        self._state(self.moments)
        self._over_bonds(kernels.seth_hill_bond, self.sums)
        return self._end()


class Silling:
    """`pd.Correspondence(pd.LinearElastic(lam, mu))`; it needs a grid with a border, Grid(..., border=True)."""

    def __init__(self, grid, lam, mu, threads=1):
        wxi = grid.w[:, None] * grid.xi
        n = len(wxi)
        K = grid.family_sums(np.einsum("bi,bj->bij", wxi, grid.xi).reshape(n, 9)).reshape(-1, 3, 3)
        i, j = [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]
        self.inverse = grid.flat(np.linalg.inv(K)[:, i, j])
        self.first = grid.flat(grid.family_sums(wxi, odd=True))
        self.rows, self.weights = grid.rows()
        self.grid, self.kernel, self.moduli = grid, _silling(threads), (float(lam), float(mu))
        self.u, self.sums = np.zeros((3, grid.size)), np.zeros((1, 3, grid.size))
        self.M, self.Z = np.zeros((9, grid.size)), np.zeros((9, grid.size))

    def __call__(self, u):
        g = self.grid
        spread(np.asarray(u), self.u, g.shape, g.full, g.border)
        state = (self.u, self.M, self.Z, self.sums[0], self.first, self.inverse)
        self.kernel(*state, self.rows, self.weights, g.spacing, *self.moduli, *g.shape, g.full, g.border)
        out = np.empty((g.points_count, 3))
        collect(self.sums, out, g.shape, g.full, g.border)
        return out


@cache
def _silling(threads):
    return silling_kernel(threads)
