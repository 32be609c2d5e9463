"""Derivatives of an equilibrium by the implicit function theorem, forward and reverse.

    r(q(θ), θ) = 0   ⇒   dq/dθ = −A⁻¹ ∂r/∂θ

q are the free components of the displacement, θ is any parameter of the scene, r the residual and A = ∂r/∂q.

The iterations of the solver are not differentiated. At the solution, forward mode solves one linear system with A and
reverse mode one with Aᵀ. Both use the same sparse matrix factorisation, which stays on the host. The rule itself is
differentiable, so derivatives of every order are exact.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..._internal.checks import Numbers
from ..direct_solver import factorised
from ..factorisation import matrix, product, residual
from ..scene import Scene, frozen


def attach(scene: Scene, q: np.ndarray, factor: float) -> Array:
    """q with its derivatives as the solution of the (traced) scene; the value of q does not change."""
    quiet, root = frozen(scene), jax.device_put(q)
    lu = factorised(matrix(quiet, quiet.displacement(q, factor), factor), scene.model.hyperelastic)

    def solved(b: Numbers, transposed: bool) -> np.ndarray:
        columns = np.asarray(b).reshape(-1, b.shape[-1]).T
        return lu.solve(columns, transposed).T.reshape(b.shape).astype(b.dtype)

    def solve(_, b, transposed=False):
        like = jax.ShapeDtypeStruct(b.shape, b.dtype)
        return jax.pure_callback(lambda x: solved(x, transposed), like, b, vmap_method="expand_dims")

    @eqx.filter_custom_jvp
    def solution(scene: Scene) -> Array:
        return root

    @solution.def_jvp
    def rate(primals, tangents):
        (scene,), (change,) = primals, tangents
        at = solution(scene)  # This value is itself differentiable, which makes second derivatives exact.
        _, dr = eqx.filter_jvp(lambda s: residual(s, at, factor), (scene,), (change,))
        dq = jax.lax.custom_linear_solve(
            lambda v: product(scene, at, factor, v),
            dr,
            solve,
            lambda matvec, b: solve(matvec, b, True),
            symmetric=scene.model.hyperelastic,
        )
        return at, -dq

    return solution(scene)


@jax.custom_jvp
def without_derivative(u: Array, by: Array, bad: Array) -> Array:
    """u, with derivative NaN with respect to `by` if `bad`, because an unconverged solution has no derivative."""
    return u


@without_derivative.defjvp
def _(primals, tangents):
    u, _, bad = primals
    du, dby, _ = tangents
    return u, du + jnp.where(bad, jnp.nan, 0.0) * dby


def leaves_sum(scene: Scene) -> Array:
    """A number that depends on every floating-point array of the scene."""
    leaves = [x for x in jax.tree.leaves(scene) if eqx.is_inexact_array(x)]
    return sum((jnp.sum(x) for x in leaves), jnp.zeros(()))
