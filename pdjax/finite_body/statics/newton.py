"""Newton's method on the host: A δq = −r, sparse direct or matrix-free, with a backtracking line search.

r is the residual of the scene and A = ∂r/∂q its reduced Jacobian. The line search halves the step until ‖r‖ falls by
Armijo's rule (1e-4). The method converges to any stationary point of the potential energy, to a saddle as well as to a
minimum. The largest eigenvalue at the end tells which of them was found.

The loop is written out here because a line search of optimistix cannot use a sparse matrix factorisation of A. The
trust-region method is that of optimistix (`pdjax.finite_body.statics.trust_region`).

The matrix-free variant uses Jacobian-vector products. For a model with an energy A is symmetric and may be indefinite,
so the linear solver is MINRES (SciPy). Without an energy it is GMRES (lineax). On the singular bar of 800 points GMRES
restarted at 120 vectors took 49 s and MINRES 3.5 s, because the condition number grows as the square of the number of
points.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import lineax as lx
import numpy as np
from jaxtyping import Array

from ..factorisation import Factor, Singular, as_operator, matrix, product, relative, residual_and_scale
from ..scene import Scene
from .result import SolveEnding

HALVINGS = 25
RESTART = 120  # Krylov vectors that GMRES keeps: 120 × unknowns numbers
LINEAR_TOLERANCE = 1e-5  # inexact Newton: an iteration can still reduce the residual by a factor of 10⁵


def direct(scene: Scene, q: np.ndarray, factor: float) -> Callable[[np.ndarray], np.ndarray]:
    """b ↦ A⁻¹ b by a sparse matrix factorisation of the exact A."""
    A = matrix(scene, scene.displacement(q, factor), factor)
    return Factor(A, symmetric=scene.model.hyperelastic).solve


@eqx.filter_jit
def _gmres(scene: Scene, q, factor, b, tolerance) -> Array:
    operator = lx.FunctionLinearOperator(lambda v: product(scene, q, factor, v), jax.eval_shape(lambda: b))
    restart = min(RESTART, b.shape[0])
    solver = lx.GMRES(rtol=tolerance, atol=0.0, restart=restart, stagnation_iters=restart, max_steps=60 * restart)
    return lx.linear_solve(operator, b, solver, throw=False).value


def krylov(scene: Scene, q: np.ndarray, factor: float) -> Callable[[np.ndarray], np.ndarray]:
    """b ↦ A⁻¹ b from Jacobian-vector products: MINRES if A is symmetric, otherwise GMRES."""
    ready = scene.prepared()
    apply = as_operator(lambda v: product(ready, q, factor, v), q.shape[0])

    def solve(b):
        size = np.linalg.norm(b)
        if scene.model.hyperelastic:
            import scipy.sparse.linalg as sla

            # SciPy stops at ‖Ax − b‖ ≤ rtol ‖A‖ ‖x‖, so rtol must be small enough for a condition number of 10⁷.
            x, _ = sla.minres(apply, b / size, rtol=1e-12, maxiter=20 * q.shape[0])
        else:
            load_factor, tolerance = (np.asarray(x, q.dtype) for x in (factor, LINEAR_TOLERANCE))
            x = np.asarray(_gmres(ready, q, load_factor, np.asarray(b / size, q.dtype), tolerance))
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
    solver: Callable[[Scene, np.ndarray, float], Callable[[np.ndarray], np.ndarray]],
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
            step = -solver(scene, q, factor)(r)
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
