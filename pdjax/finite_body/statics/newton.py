"""Newton's method on the host: A δq = −r, sparse direct or matrix-free, with a backtracking line search.

r is the residual of the scene and A = ∂r/∂q its reduced Jacobian. The line search halves the step until ‖r‖ falls by
Armijo's rule (1e-4). The method converges to any stationary point of the potential energy, to a saddle as well as to a
minimum. The largest eigenvalue at the end tells which of them was found.

The loop is written out here because a line search of optimistix cannot use a sparse matrix factorisation of A. The
trust-region method is that of optimistix (`pdjax.finite_body.statics.trust_region`).

The matrix-free variant uses Jacobian-vector products. For a model with an energy A is symmetric and may be indefinite,
so the linear solver is MINRES (SciPy). Without an energy it is GMRES (lineax). On a lattice both have a preconditioner
(`pdjax.finite_body.statics.lattice_response`). Each linear system is solved as far as the present residual needs, and
at most to LINEAR_TOLERANCE: an inexact Newton method.

Tried and not kept: the body's own diagonal Jacobian blocks as the preconditioner. All interior points of a body have
nearly the same block, so MINRES takes as many products with them as without (LPS, bond-based and controlled Silling
bodies: 1.0 ± 0.1 of the number; Seth–Hill bodies: 0.7).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import lineax as lx
import numpy as np
from jaxtyping import Array

from ..direct_solver import factorised
from ..factorisation import Singular, as_operator, matrix, product, relative, residual_and_scale
from ..scene import Scene
from .lattice_response import LatticeResponse, lattice_response
from .result import SolveEnding

# (scene, q, load factor, enough) ↦ (b ↦ A⁻¹ b); ‖A x − b‖ ≤ enough · ‖b‖ is as good as exact for the caller
LinearSolver = Callable[[Scene, np.ndarray, float, float], Callable[[np.ndarray], np.ndarray]]

HALVINGS = 25
RESTART = 120  # Krylov vectors that GMRES keeps and makes before it looks at the residual: 120 × unknowns numbers
PRECONDITIONED = 40  # the same with a preconditioner, which needs fewer
LINEAR_TOLERANCE = 1e-5  # inexact Newton: an iteration can still reduce the residual by a factor of 10⁵


def direct(scene: Scene, q: np.ndarray, factor: float, enough: float = 0.0) -> Callable[[np.ndarray], np.ndarray]:
    """b ↦ A⁻¹ b by a sparse matrix factorisation of the exact A."""
    A = matrix(scene, scene.displacement(q, factor), factor)
    return factorised(A, scene.model.hyperelastic).solve


@eqx.filter_jit
def _gmres(scene: Scene, q, factor, b, tolerance, nearly: LatticeResponse | None) -> Array:
    """A x = b by GMRES. The preconditioner is on the right, A M⁻¹ y = b and x = M⁻¹ y, which keeps the residual."""

    def moved(y):
        return y if nearly is None else nearly(y)

    operator = lx.FunctionLinearOperator(lambda y: product(scene, q, factor, moved(y)), jax.eval_shape(lambda: b))
    restart = min(RESTART if nearly is None else PRECONDITIONED, b.shape[0])
    solver = lx.GMRES(rtol=tolerance, atol=0.0, restart=restart, stagnation_iters=restart, max_steps=60 * restart)
    return moved(lx.linear_solve(operator, b, solver, throw=False).value)


class _Close(Exception):
    """Raised out of the loop of MINRES when the residual is small enough."""


def _minres(A, b: np.ndarray, inverse, tolerance: float) -> np.ndarray:
    """A x = b by MINRES until ‖A x − b‖ ≤ tolerance ‖b‖.

    SciPy stops at ‖A x − b‖ ≤ rtol ‖A‖ ‖x‖ in the norm of the preconditioner, which says little about ‖A x − b‖. The
    residual itself is therefore computed now and then, after every seventh part of all iterations so far.
    """
    import scipy.sparse.linalg as sla

    iteration, look, close = 0, 3, tolerance * np.linalg.norm(b)
    latest = np.zeros_like(b)

    def watch(x):
        nonlocal iteration, look, latest
        iteration, latest = iteration + 1, x
        if iteration == look:
            look += 2 + iteration // 7
            if np.linalg.norm(A @ x - b) <= close:
                raise _Close

    try:
        return sla.minres(A, b, M=inverse, rtol=1e-14, maxiter=20 * len(b), callback=watch)[0]
    except _Close:
        return latest


class Krylov:
    """b ↦ A⁻¹ b from products A v: MINRES if A is symmetric, otherwise GMRES. `newton` takes it as its `solver`.

    The preconditioner is made once, from the first A, and serves for all loads.
    """

    def __init__(self) -> None:
        self.products = 0  # products of MINRES, its checks and the preconditioner, for tests and benchmarks
        self._nearly: list[LatticeResponse | None] = []

    def __call__(
        self, scene: Scene, q: np.ndarray, factor: float, enough: float = LINEAR_TOLERANCE
    ) -> Callable[[np.ndarray], np.ndarray]:
        """The solver for A at q."""
        ready, tolerance = scene.prepared(), float(np.clip(enough, LINEAR_TOLERANCE, 0.1))

        def along(v):
            self.products += 1
            return product(ready, q, factor, v)

        if not self._nearly:
            self._nearly.append(lattice_response(scene, along))
        nearly, apply = self._nearly[0], as_operator(along, q.shape[0])

        def solve(b):
            size = np.linalg.norm(b)
            if scene.model.hyperelastic:
                inverse = None if nearly is None else as_operator(lambda r: nearly(r), q.shape[0])
                x = _minres(apply, np.asarray(b / size, float), inverse, tolerance)
            else:
                load_factor, least = (np.asarray(x, q.dtype) for x in (factor, tolerance))
                x = np.asarray(_gmres(ready, q, load_factor, np.asarray(b / size, q.dtype), least, nearly))
            left = float(np.linalg.norm(apply @ x - b / size))
            if not left < 0.5:
                raise Singular(f"the Krylov solver left {left:.1e} of the right-hand side")
            return x * size

        return solve


def newton(
    scene: Scene,
    q: np.ndarray,
    factor: float,
    tolerance: float,
    max_iterations: int,
    solver: LinearSolver,
    history: list[float] | None = None,
    least_scale: float = 0.0,
) -> tuple[np.ndarray, int, list[float]]:
    """Newton's method from q at a fixed load factor. Returns (q, code, relative residuals of all iterations).

    The residuals are appended to `history`. They are relative to the scale of the present forces, or to `least_scale`
    [force] if that is larger: a body that has lost its load has no forces of its own to compare with.
    """
    history = [] if history is None else history

    def measure(q):
        r, scale = map(np.asarray, residual_and_scale(scene, q, factor))
        with np.errstate(all="ignore"):  # The loop below tests whether the residual is finite.
            size = np.linalg.norm(r)
        return r, float(size), float(relative(size, np.maximum(scale, least_scale)))  # NaN stays NaN

    def moved(q, by):
        with np.errstate(all="ignore"):
            return (q + by).astype(q.dtype)

    r, size, left = measure(q)
    for _ in range(max_iterations):
        history.append(left)
        if not np.isfinite(history[-1]):
            return q, SolveEnding.NOT_FINITE, history
        if history[-1] <= tolerance:
            return q, SolveEnding.CONVERGED, history
        try:
            step = -solver(scene, q, factor, 0.3 * tolerance / left)(r)
        except Singular:
            return q, SolveEnding.SINGULAR, history
        length = 1.0
        for _ in range(HALVINGS):
            r_new, size_new, left = measure(moved(q, length * step))
            if size_new <= (1 - 1e-4 * length) * size:
                break
            length *= 0.5
        else:
            return q, SolveEnding.NO_DECREASE, history
        q, r, size = moved(q, length * step), r_new, size_new
    history.append(left)
    return q, SolveEnding.CONVERGED if history[-1] <= tolerance else SolveEnding.OUT_OF_STEPS, history
