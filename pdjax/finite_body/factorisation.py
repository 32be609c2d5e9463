"""The reduced system of a scene: its residual, its Jacobian A = S V J Sᵀ, and a matrix factorisation of A.

The module gives products A v without a matrix, the sparse matrix A, and the number of positive eigenvalues of A. The
symbols S, V, J and λ are those of `pdjax.finite_body.scene`. Units: residual [force], A [force/length].

**Inertia from the pivots.** The inertia of a symmetric matrix is the number of its positive, zero and negative
eigenvalues. SciPy has no LDLᵀ factorisation, so SuperLU takes its place: in symmetric mode with pivot threshold 0 it
keeps the diagonal entries as pivots. It then computes Pᵀ A P = L U with one permutation P for rows and columns, and
U = D Lᵀ. By Sylvester's law of inertia the diagonal of U has the same signs as the eigenvalues of A. Without pivoting
the factorisation can be inaccurate, so each one is checked. The permutations of rows and columns must agree. A solve
with a random right-hand side must have a backward error below BACKWARD.

**Inertia from blocks.** Reading the diagonal of U copies U, which takes 12 bytes an entry. For a large factorisation
another method needs less memory. Ordered for small bandwidth, A is block-tridiagonal. Its inertia is the sum of the
inertias of the Schur complements S_k = A_kk − A_{k,k−1} S_{k−1}⁻¹ A_{k−1,k} (Haynsworth). A dense Cholesky
factorisation gives the inertia of a definite S_k, and a Bunch–Kaufman factorisation that of an indefinite one.
"""

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float

from .._internal.checks import Numbers, Result, is_concrete, namespace
from ..force.fields import force_states, plain_exchange
from ..tangent.jacobian import jacobian
from .scene import Scene

if TYPE_CHECKING:
    import scipy.sparse.linalg

BACKWARD = 1e-9  # measured: below 1e-12 for 10⁵ unknowns in 2D, both at rest and where A is indefinite


def residual_of(scene: Scene, q: Float[Array, " unknowns"], factor) -> Float[Array, " unknowns"]:
    """The residual r(q, λ) = S V (f + λ b). It is not jitted, so that jitted functions can trace it."""
    return scene.unbalanced(scene.displacement(q, factor), factor).reshape(-1)[scene.unknowns]


def _kernel(function: Callable[..., Result]) -> Callable[..., Result]:
    """The function, jitted. Its third argument, the load factor, becomes an array, so a new load does not recompile."""
    jitted = eqx.filter_jit(function)

    @functools.wraps(function)
    def call(scene, q, factor, *more):
        return jitted(scene, q, namespace(factor).asarray(factor, q.dtype), *more)

    return call


residual = _kernel(residual_of)


@_kernel
def residual_and_scale(scene: Scene, q, factor) -> tuple[Array, Array]:
    """The residual r and the force by which it is divided to make it relative.

    That force is the largest of three: ‖V f‖ over all points, reactions included; ‖λ V b‖; and the root mean square
    over the points of V_i Σ_j V_j |T_ij|. The third is not zero in a stretched periodic body without reactions.
    """
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


def relative(size, scale) -> Numbers:
    """The size of a residual divided by its scale.

    It is 0 if both are 0, and infinite if only the scale is 0, so that such a state does not count as converged. It is
    NaN if the scale is not finite, for example after an overflow.
    """
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
    """The sparse A (unknowns, unknowns) at the displacement u; exactly symmetric for a model with an energy."""
    J = jacobian(scene.model, scene.families, u, "sparse", scene.mean_deformation(factor))
    keep = np.asarray(scene.unknowns)
    A = (sp.diags_array(unknown_volumes(scene)) @ J[keep][:, keep]).tocsc()
    return (0.5 * (A + A.T)).tocsc() if scene.model.hyperelastic else A


def unknown_volumes(scene: Scene) -> np.ndarray:
    """V of every unknown."""
    return np.repeat(np.asarray(scene.families.volumes), scene.families.dim)[np.asarray(scene.unknowns)]


CHEAP = 50_000_000  # entries of L and U up to which U is copied to count eigenvalues: 0.6 GB


class Singular(Exception):
    """The matrix could not be factorised, or its factorisation is too inaccurate."""


def checked_backward_error(A: sp.csc_array, solve: Callable[[np.ndarray], np.ndarray]) -> float:
    """The normwise backward error of the solution for a random right-hand side; Singular if it is too large."""
    import scipy.sparse.linalg as sla

    b = np.random.default_rng(0).normal(size=A.shape[0])
    x = solve(b)
    with np.errstate(all="ignore"):
        size = sla.norm(A, np.inf) * np.linalg.norm(x, np.inf) + np.linalg.norm(b, np.inf)
        backward = float(np.linalg.norm(A @ x - b, np.inf) / size)
    if not backward < BACKWARD:
        raise Singular(
            f"the matrix factorisation is too inaccurate: its backward error is {backward:.1e}, allowed is"
            f" {BACKWARD:.0e}; the matrix is singular or nearly so"
        )
    return backward


class Factor:
    """The matrix factorisation P A Pᵀ = L D Lᵀ of a symmetric sparse matrix.

    For a general matrix it is an LU factorisation with pivoting, which does not count eigenvalues.
    """

    def __init__(self, A: sp.csc_array, symmetric: bool = True):
        # Imported here, as in other functions, because this import and scipy.linalg take a quarter of a second.
        import scipy.sparse.linalg as sla

        self.matrix, self.symmetric = A, symmetric
        try:
            if symmetric:
                keep = {"SymmetricMode": True}
                self._lu = sla.splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=keep)
            else:
                self._lu = sla.splu(A)
        except RuntimeError as error:
            raise Singular(str(error)) from error
        self.backward = checked_backward_error(A, self._lu.solve)

    def solve(self, b: np.ndarray, transposed: bool = False) -> np.ndarray:
        """A⁻¹ b with one step of iterative refinement."""
        how = "T" if transposed and not self.symmetric else "N"
        A = self.matrix.T if how == "T" else self.matrix
        x = self._lu.solve(np.asarray(b), trans=how)
        return x + self._lu.solve(np.asarray(b) - A @ x, trans=how)

    @property
    def cheap(self) -> bool:
        """Whether the pivots can be read in little memory, so that `positive` takes little time."""
        return self._lu.nnz <= CHEAP

    @property
    def positive(self) -> int:
        """Number of positive eigenvalues of A, from the signs of the pivots; from blocks for a large matrix."""
        if self.symmetric and not self.cheap:
            return count_by_blocks(self.matrix)
        return int((self.triangles()[1].diagonal() > 0).sum())

    def triangles(self) -> tuple[sp.csc_array, sp.csc_array]:
        """L and U with P A Pᵀ = L U for one permutation P. SuperLU keeps both copies, which the caller must not change.

        Raises Singular if rows and columns were permuted differently.
        """
        if not self.symmetric or not np.array_equal(self._lu.perm_r, self._lu.perm_c):
            raise Singular(
                "rows and columns were permuted differently, so the signs of the pivots do not count eigenvalues"
            )
        return self._lu.L, self._lu.U


def count_by_blocks(A: sp.csc_array) -> int:
    """Number of positive eigenvalues of a symmetric sparse A, by the block recursion of the module docstring.

    For the bandwidth b it takes 3.3 b² operations a row and the memory of a few b × b arrays.
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
    """Number of positive eigenvalues of a symmetric sparse A, by the method that takes less memory for its size."""
    return Factor(A).positive if A.shape[0] <= 40_000 else count_by_blocks(A)


def as_operator(apply: Callable[[np.ndarray], Numbers], size: int) -> "scipy.sparse.linalg.LinearOperator":
    """The jitted function v ↦ A v as a SciPy linear operator."""
    import scipy.sparse.linalg as sla

    return sla.LinearOperator((size, size), matvec=lambda v: np.asarray(apply(v.reshape(-1))), dtype=float)
