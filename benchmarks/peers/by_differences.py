"""NumPy and SciPy as peers: Jacobians, symbols and spectra by finite differences of a force, and ARPACK.

This is the approach of a user without automatic differentiation: a force written in NumPy, its central differences, and
`eigsh`.
"""

import numpy as np
import scipy.sparse.linalg as sla


def jacobian(force, u, step):
    """Dense ∂f/∂u by central differences, with two force evaluations for each column."""
    u = np.asarray(u, dtype=float)
    J = np.empty((u.size, u.size))
    for k in range(u.size):
        e = np.zeros(u.size)
        e[k] = step
        e = e.reshape(u.shape)
        J[:, k] = (np.asarray(force(u + e)) - np.asarray(force(u - e))).reshape(-1) / (2 * step)
    return J


def largest_eigenvalues(force, u, step, count):
    """The `count` largest eigenvalues of ∂f/∂u by ARPACK, with products J v by central differences along v.

    ∂f/∂u must be symmetric, that is, the volumes are equal and the model has an energy. The function returns the
    eigenvalues, largest first, and the number of force evaluations.
    """
    u = np.asarray(u, dtype=float)
    calls = 0

    def product(v):
        nonlocal calls
        calls += 2
        v = v.reshape(u.shape)
        size = step / np.max(np.abs(v))
        return (np.asarray(force(u + size * v)) - np.asarray(force(u - size * v))).reshape(-1) / (2 * size)

    operator = sla.LinearOperator((u.size, u.size), matvec=product, dtype=float)
    start = np.random.default_rng(0).normal(size=u.size)
    values = sla.eigsh(operator, k=count, which="LA", v0=start, tol=1e-10, return_eigenvectors=False)
    return np.sort(values)[::-1], calls


class SethHillLattice:
    """Seth–Hill correspondence with a linear law on an infinite lattice, in NumPy, for the stability map."""

    def __init__(self, xi, weight, lam, mu):
        self.xi, self.w, self.lam, self.mu = np.asarray(xi), np.asarray(weight), lam, mu
        self.square = np.sum(self.xi**2, axis=1)
        n = self.xi / np.sqrt(self.square)[:, None]
        self.nn = n[:, :, None] * n[:, None, :]
        dim = self.xi.shape[1]
        L = np.einsum("b,bij,bkl->ijkl", self.w, self.nn, self.nn).reshape(dim * dim, dim * dim)
        self.L_inverse = np.linalg.pinv(L)  # pseudo-inverse: L acts on symmetric tensors only

    def force_state(self, eta, m):
        """Force states T (bonds, dim) of one family with relative displacements η (bonds, dim)."""
        g = np.sum((2 * self.xi + eta) * eta, axis=1) / self.square
        e = np.log1p(g) / 2 if m == 0 else ((1 + g) ** m - 1) / (2 * m)
        dim = self.xi.shape[1]
        moment = np.einsum("b,bij->ij", self.w * e, self.nn)
        E = (self.L_inverse @ moment.reshape(-1)).reshape(dim, dim)
        S = self.lam * np.trace(E) * np.eye(dim) + 2 * self.mu * E
        Z = (self.L_inverse @ S.reshape(-1)).reshape(dim, dim)
        pull = np.einsum("bij,ij->b", self.nn, Z) * (1 + g) ** (m - 1) / self.square
        return pull[:, None] * (self.xi + eta)

    def largest(self, m, F, waves, step=1e-6):
        """Largest eigenvalue of the symbol over all waves (waves, dim), with C = ∂T/∂η by central differences."""
        bonds, dim = self.xi.shape
        eta = self.xi @ (F - np.eye(dim)).T
        C = np.empty((bonds, dim, bonds, dim))
        for c in range(bonds):
            for i in range(dim):
                e = np.zeros_like(eta)
                e[c, i] = step
                C[:, :, c, i] = (self.force_state(eta + e, m) - self.force_state(eta - e, m)) / (2 * step)
        # From f = Σ_j (T_ij − T_ji) V_j with u = v exp(ik·x): Ĵ = Σ_bc w_b (1 − e^{−ik·ξ_b}) C_bc (e^{ik·ξ_c} − 1)
        phase = np.exp(1j * waves @ self.xi.T)
        volume = self.w
        symbols = np.einsum("kb,bicj,kc->kij", volume * (1 - phase.conj()), C, phase - 1, optimize=True)
        return np.linalg.eigvalsh((symbols + np.conj(np.swapaxes(symbols, 1, 2))) / 2)[:, -1].max()
