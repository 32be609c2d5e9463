"""The reduced system of a scene: residual, matrix-free and sparse A = S V J Sᵀ, and a factor of it that counts.

SciPy has no LDLᵀ. SuperLU told to keep the diagonal as pivots (symmetric mode, threshold 0) factors Pᵀ A P = L U
with one permutation for rows and columns, and then U = D Lᵀ: by Sylvester's law of inertia the signs of U's diagonal
are those of A's eigenvalues. Without pivoting nothing guards the accuracy, so every factor is checked: the permutations
must agree, and a solve with a random right-hand side must come back to BACKWARD.

Looking at U copies the factor, 12 bytes an entry. Large ones are counted another way, in little memory: in an order of
small bandwidth A is block-tridiagonal, and its inertia is the sum of those of the Schur complements S_k = A_kk −
A_{k,k−1} S_{k−1}⁻¹ A_{k−1,k} (Haynsworth), each by dense Cholesky, or Bunch–Kaufman where it is not definite.

Units: residual [force], A [force/length].
"""

import functools
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float

from .._internal.checks import is_concrete, namespace
from ..force.fields import force_states, plain_exchange
from ..tangent.jacobian import jacobian
from .scene import Scene

BACKWARD = 1e-9  # measured: below 1e-12 for 10⁵ unknowns in 2D, at rest and indefinite


def residual_of(scene: Scene, q: Float[Array, " unknowns"], factor) -> Float[Array, " unknowns"]:
    """r(q, λ) = S V (f + λ b), untransformed: for kernels to trace."""
    return scene.unbalanced(scene.displacement(q, factor), factor).reshape(-1)[scene.unknowns]


def _kernel(function: Any) -> Any:
    """Jitted, its third argument, the load factor, always an array: a new load never compiles anew."""
    jitted = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(scene, q, factor, *more):
        return jitted(scene, q, namespace(factor).asarray(factor, q.dtype), *more)

    return call


residual = _kernel(residual_of)


@_kernel
def residual_and_scale(scene: Scene, q, factor) -> tuple[Array, Array]:
    """r, and the force it is measured by: the largest of ‖V f‖ over all points (reactions too), ‖λ V b‖ and the root
    mean square over points of V_i Σ_j V_j |T_ij|, which a periodic body keeps where nothing reacts."""
    families, V = scene.families, scene.families.volumes[:, None]
    bonds = families.bonds(scene.displacement(q, factor), scene.mean_deformation(factor))
    # Both numbers come from the force states of all bonds, so that the program holds the model's force only once.
    exchange = plain_exchange(families)
    T = force_states(scene.model, families.volumes, bonds, exchange)
    internal = V * jnp.einsum("pb,pbi->pi", bonds.volume, T - exchange.back(T))
    applied = factor * V * scene.load
    pull = V[:, 0] * jnp.einsum("pb,pb->p", bonds.volume, jnp.linalg.norm(T, axis=-1))
    scale = jnp.maximum(jnp.linalg.norm(internal), jnp.linalg.norm(applied))
    r = (internal + applied).reshape(-1)[scene.unknowns]
    return r, jnp.maximum(scale, jnp.sqrt(jnp.mean(pull**2)))


def relative(size, scale) -> Any:
    """A residual's size by its scale; 0 where both are 0, and a size by no scale is infinite: it never converged. NaN
    where the scale is beyond all numbers of its precision."""
    if not is_concrete(size, scale):
        left = size / jnp.where((size == 0) & (scale == 0), 1.0, scale)
        return jnp.where(jnp.isfinite(scale), left, jnp.nan)
    size, scale = np.asarray(size), np.asarray(scale)
    with np.errstate(all="ignore"):
        left = size / np.where((size == 0) & (scale == 0), 1.0, scale)
    return np.where(np.isfinite(scale), left, np.nan)


@_kernel
def product(scene: Scene, q, factor, v) -> Float[Array, " unknowns"]:
    """A v by JVP."""
    return jax.jvp(lambda p: residual_of(scene, p, factor), (q,), (v.astype(q.dtype),))[1]


@_kernel
def load_rate(scene: Scene, q, factor) -> Float[Array, " unknowns"]:
    """∂r/∂λ at fixed q."""
    return jax.jvp(lambda x: residual_of(scene, q, x), (factor,), (jnp.ones_like(factor),))[1]


@_kernel
def product_rate(scene: Scene, u, factor, du, v) -> Float[Array, " unknowns"]:
    """(dA/dλ) v along a path of displacements with rate du = du/dλ (points, dim)."""

    def along(s):
        def force(w):
            at = u + s * du + w
            return scene.unbalanced(at, factor + s).reshape(-1)[scene.unknowns]

        direction = jnp.zeros(u.size, u.dtype).at[scene.unknowns].set(v.astype(u.dtype)).reshape(u.shape)
        return jax.jvp(force, (jnp.zeros_like(u),), (direction,))[1]

    return jax.jvp(along, (jnp.zeros((), u.dtype),), (jnp.ones((), u.dtype),))[1]


def matrix(scene: Scene, u, factor=1.0) -> sp.csc_array:
    """A (unknowns, unknowns) at the displacement u, sparse; made exactly symmetric for a model with an energy."""
    J = jacobian(scene.model, scene.families, u, "sparse", scene.mean_deformation(factor))
    keep = np.asarray(scene.unknowns)
    A = (sp.diags_array(unknown_volumes(scene)) @ J[keep][:, keep]).tocsc()
    return (0.5 * (A + A.T)).tocsc() if scene.model.hyperelastic else A


def unknown_volumes(scene: Scene) -> np.ndarray:
    """V of every unknown."""
    return np.repeat(np.asarray(scene.families.volumes), scene.families.dim)[np.asarray(scene.unknowns)]


CHEAP = 50_000_000  # entries of a factor up to which U is copied: 0.6 GB


class Singular(Exception):
    """The matrix could not be factorised, or its factor does not solve."""


class Factor:
    """P A Pᵀ = L D Lᵀ of a symmetric sparse matrix (of a general one: LU with pivoting, and no counts)."""

    def __init__(self, A: sp.csc_array, symmetric: bool = True):
        import scipy.sparse.linalg as sla  # here and elsewhere late: with scipy.linalg it takes a quarter of a second

        self.matrix, self.symmetric = A, symmetric
        try:
            if symmetric:
                keep = {"SymmetricMode": True}
                self._lu = sla.splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=keep)
            else:
                self._lu = sla.splu(A)
        except RuntimeError as error:
            raise Singular(str(error)) from error
        b = np.random.default_rng(0).normal(size=A.shape[0])
        x = self._lu.solve(b)
        with np.errstate(all="ignore"):
            size = sla.norm(A, np.inf) * np.linalg.norm(x, np.inf) + np.linalg.norm(b, np.inf)
            self.backward = float(np.linalg.norm(A @ x - b, np.inf) / size)
        if not self.backward < BACKWARD:
            raise Singular(f"its factor does not solve: backward error {self.backward:.1e}")

    def solve(self, b: np.ndarray, transposed: bool = False) -> np.ndarray:
        """A⁻¹ b, refined once."""
        how = "T" if transposed and not self.symmetric else "N"
        A = self.matrix.T if how == "T" else self.matrix
        x = self._lu.solve(np.asarray(b), trans=how)
        return x + self._lu.solve(np.asarray(b) - A @ x, trans=how)

    @property
    def cheap(self) -> bool:
        """Whether `positive` costs nothing much."""
        return self._lu.nnz <= CHEAP

    @property
    def positive(self) -> int:
        """How many eigenvalues of A are positive: the signs of the pivots, or by blocks where they are many."""
        if self.symmetric and not self.cheap:
            return count_by_blocks(self.matrix)
        if not self.symmetric or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            raise Singular("rows and columns were permuted differently: the pivots do not count eigenvalues")
        return int((self._lu.U.diagonal() > 0).sum())


def count_by_blocks(A: sp.csc_array) -> int:
    """How many eigenvalues of a symmetric sparse A are positive, by the block recursion of the module's head.

    Costs 3.3 b² per row for bandwidth b, and a few b × b arrays.
    """
    from scipy.linalg import LinAlgError, cholesky, eigvalsh_tridiagonal, ldl, solve, solve_triangular
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    size = A.shape[0]
    entries = A.tocoo()
    width = int(np.abs(entries.row - entries.col).max(initial=0)) + 1
    order = reverse_cuthill_mckee(A.tocsr(), symmetric_mode=True)
    place = np.empty(size, dtype=int)
    place[order] = np.arange(size)
    folded = int(np.abs(place[entries.row] - place[entries.col]).max(initial=0)) + 1
    if folded < width:
        A, width = A[order][:, order], folded
    A, width = A.tocsr(), max(width, 32)
    positive, gained = 0, None
    for start in range(0, size, width):
        end = min(start + width, size)
        block = A[start:end, start:end].toarray()
        if gained is not None:
            block += gained
        coupling = A[end : min(end + width, size), start:end].toarray().T
        try:
            root = cholesky(-block, lower=True, overwrite_a=False, check_finite=False)
            half = solve_triangular(root, coupling, lower=True, check_finite=False)
            gained = half.T @ half
        except LinAlgError:
            _, D, _ = ldl(block, check_finite=False)
            positive += int((eigvalsh_tridiagonal(np.diag(D), np.diag(D, 1)) > 0).sum())
            gained = -coupling.T @ solve(block, coupling, assume_a="sym", check_finite=False)
    return positive


def count_positive(A: sp.csc_array) -> int:
    """How many eigenvalues of a symmetric sparse A are positive, by whichever way costs less memory."""
    return Factor(A).positive if A.shape[0] <= 40_000 else count_by_blocks(A)


def as_operator(apply: Any, size: int) -> Any:
    """A jitted v ↦ A v as a SciPy operator."""
    import scipy.sparse.linalg as sla

    return sla.LinearOperator((size, size), matvec=lambda v: np.asarray(apply(v.reshape(-1))), dtype=float)  # type: ignore
