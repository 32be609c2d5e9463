"""Forces of any 3D cloud by the kernels of `list_kernels`, one class for each model.

f = Model(cloud, …, threads) makes a force, and f(u) evaluates it. `Cloud` finds the pairs of neighbours (cKDTree) and
stores each pair once, with the weight W = ω V_i V_j. The quantities that do not depend on u are computed here, once.
"""

from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from . import list_kernels as kernels
from .lattice_forces import isotropic, mandel
from .power import series

NONE = np.zeros(0)


class Cloud:
    """Points X (points, 3) with volumes, and their pairs sorted by the first point; `start` marks the rows."""

    def __init__(self, positions, volumes, horizon, influence=None):
        self.X = np.ascontiguousarray(positions, dtype=float)
        self.volumes = np.broadcast_to(np.asarray(volumes, dtype=float), len(self.X)).copy()
        pairs = cKDTree(self.X).query_pairs(horizon * (1 + 1e-9), output_type="ndarray")
        i, j = pairs.min(axis=1), pairs.max(axis=1)
        order = np.lexsort((j, i))
        self.i, self.j = i[order], j[order]
        self.xi = self.X[self.j] - self.X[self.i]
        r = np.linalg.norm(self.xi, axis=1)
        omega = np.ones_like(r) if influence is None else np.asarray(influence(r, horizon))
        self.weight = omega * self.volumes[self.i] * self.volumes[self.j]
        self.inverse_square = 1 / r**2
        count = np.bincount(self.i, minlength=len(self.X))
        self.start, self.near = np.concatenate([[0], np.cumsum(count)]), self.j.astype(np.uint32)
        self.width = int(count.max())

    def family_sums(self, values):
        """Sum values (pairs, c), even in ξ and with the weight W, over the families → (points, c) with w = ω V_j."""
        ends, both = np.concatenate([self.i, self.j]), np.concatenate([values, values])
        sums = [np.bincount(ends, column, len(self.X)) for column in both.T]
        return np.stack(sums, axis=1) / self.volumes[:, None]


@cache
def _sweep(bond, states, results, sign, threads):
    return kernels.list_sweep(bond, states, results, sign, threads)


class _Bondwise:
    """Base class: it holds the states A of the points and the sums of each thread. A subclass computes A."""

    states = 0

    def __init__(self, cloud, threads):
        self.cloud, self.threads = cloud, threads
        self.A = np.zeros((len(cloud.X), self.states))
        self.sums = np.zeros((threads, len(cloud.X), 3))
        self.weight, self.constants = cloud.weight, NONE

    def _over_bonds(self, bond, u, states, sign, out):
        c = self.cloud
        sweep = _sweep(bond, states, out.shape[2], sign, self.threads)
        bonds = (c.start, c.near, self.weight, c.inverse_square, self.constants, c.width)
        sweep(u, c.X, self.A, *bonds, out)

    def _force(self, bond, u):
        self._over_bonds(bond, u, self.states, -1.0, self.sums)
        out = np.empty((len(self.cloud.X), 3))
        kernels.collect(self.sums, self.cloud.volumes, out)
        return out


class PMB(_Bondwise):
    """`pd.BondBased(c)`."""

    def __init__(self, cloud, c, threads=1):
        super().__init__(cloud, threads)
        self.weight = c * cloud.weight * np.sqrt(cloud.inverse_square)

    def __call__(self, u):
        return self._force(kernels.pmb_row, np.asarray(u))


class LPS(_Bondwise):
    """`pd.LPS(bulk, shear)`; the state of a point is (p, α)."""

    states = 2

    def __init__(self, cloud, bulk, shear, threads=1):
        super().__init__(cloud, threads)
        m_w = cloud.family_sums((cloud.weight / cloud.inverse_square)[:, None])[:, 0]
        self.A[:, 1] = 15 * shear / m_w
        self.matrices = ((3 * bulk - 5 * shear) * 3 / m_w**2 / cloud.volumes)[:, None, None]
        self.theta = np.zeros((threads, len(m_w), 1))

    def __call__(self, u):
        u = np.asarray(u)
        self._over_bonds(kernels.dilatation_row, u, 0, 1.0, self.theta)
        kernels.point_product(self.theta, self.matrices, self.A)
        return self._force(kernels.lps_row, u)


class SethHill(_Bondwise):
    """`pd.SethHill(m, pd.LinearElastic(lam, mu))`; the state is Z, a Mandel vector."""

    states = 6

    def __init__(self, cloud, m, lam, mu, threads=1):
        super().__init__(cloud, threads)
        v = mandel(cloud.xi)
        L = np.stack([cloud.family_sums(cloud.weight[:, None] * v * v[:, q : q + 1]) for q in range(6)], axis=2)
        inverse = np.linalg.inv(L)
        self.matrices = inverse @ isotropic(lam, mu) @ inverse / cloud.volumes[:, None, None]
        self.constants = np.concatenate([[m], series(m)])
        self.moments = np.zeros((threads, len(L), 6))

    def __call__(self, u):
        u = np.asarray(u)
        self._over_bonds(kernels.moment_row, u, 0, 1.0, self.moments)
        kernels.point_product(self.moments, self.matrices, self.A)
        return self._force(kernels.seth_hill_row, u)


class Silling(_Bondwise):
    """`pd.Correspondence(pd.LinearElastic(lam, mu))`; the state is Z = P K⁻¹."""

    states = 9

    def __init__(self, cloud, lam, mu, threads=1):
        super().__init__(cloud, threads)
        xi = cloud.xi
        K = np.stack([cloud.family_sums(cloud.weight[:, None] * xi * xi[:, q : q + 1]) for q in range(3)], axis=2)
        self.inverse, self.moduli = np.linalg.inv(K), (float(lam), float(mu))
        self.moments = np.zeros((threads, len(K), 9))

    def __call__(self, u):
        u = np.asarray(u)
        self._over_bonds(kernels.gradient_row, u, 0, 1.0, self.moments)
        kernels.svk_states(self.moments, self.inverse, self.cloud.volumes, *self.moduli, self.A)
        return self._force(kernels.silling_row, u)
