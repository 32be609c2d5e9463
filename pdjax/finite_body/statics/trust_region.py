"""Powell's dogleg method on ‖r‖² from optimistix, with a dense Jacobian.

r is the residual of the scene. The method runs wholly in JAX, so `jit` and `vmap` can transform it, and many small
problems can be solved in one batch. It is meant for bodies of up to a few thousand unknowns.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array

from ..factorisation import relative, residual_and_scale, residual_of
from ..scene import Scene
from .result import SolveEnding

LARGEST = 4000  # unknowns: a dense matrix of 128 MB


@eqx.filter_jit
def trust_region(
    scene: Scene, q: Array | np.ndarray, factor, tolerance, max_iterations: int
) -> tuple[Array, Array, Array]:
    """Dogleg method from q at a fixed load factor.

    Returns (q, code, relative residuals (max_iterations + 1,)); residuals that were not used are NaN.
    """
    if q.shape[0] > LARGEST:
        raise ValueError(
            f"method 'trust_region' is dense and takes at most {LARGEST} unknowns; this scene has {q.shape[0]}:"
            " use 'newton' or 'newton_krylov'"
        )
    q, factor = jnp.asarray(q), jnp.asarray(factor, q.dtype)

    def fn(p, _):
        return residual_of(scene, p, factor), None

    def measure(p):
        r, scale = residual_and_scale(scene, p, factor)
        return relative(jnp.linalg.norm(r), scale)

    solver: optx.Dogleg = optx.Dogleg(rtol=1e-14, atol=1e-300, linear_solver=lx.AutoLinearSolver(well_posed=None))
    tags: frozenset[object] = frozenset()
    struct = jax.eval_shape(fn, q, None)
    start = solver.init(fn, q, None, {}, struct[0], struct[1], tags)
    dynamic, static = eqx.partition(start, eqx.is_array)
    history = jnp.full(max_iterations + 1, jnp.nan, q.dtype).at[0].set(measure(q))

    def go_on(carry):
        _, _, history, n = carry
        return (n < max_iterations) & (history[n] > tolerance) & jnp.isfinite(history[n])

    def step(carry):
        q, dynamic, history, n = carry
        q, state, _ = solver.step(fn, q, None, {}, eqx.combine(dynamic, static), tags)
        return q, eqx.filter(state, eqx.is_array), history.at[n + 1].set(measure(q)), n + 1

    q, _, history, n = jax.lax.while_loop(go_on, step, (q, dynamic, history, jnp.zeros((), int)))
    ended, ran_out, bad = (int(SolveEnding[name]) for name in ("CONVERGED", "OUT_OF_STEPS", "NOT_FINITE"))
    code = jnp.where(history[n] <= tolerance, ended, jnp.where(jnp.isfinite(history[n]), ran_out, bad))
    return q, code, history
