"""Derivatives of an equilibrium by the implicit function theorem, forward and reverse.

    r(q(θ), θ) = 0   ⇒   dq/dθ = −A⁻¹ ∂r/∂θ

No iteration is differentiated: at the solution, one linear solve with A (forward) or Aᵀ (reverse), by the same sparse
factor, kept on the host. First derivatives; A itself is taken as a constant.
"""

import jax
import numpy as np
from jaxtyping import Array

from ..problem import Scene, still
from ..reduced import Factor, matrix, product, residual_of


def attach(scene: Scene, q: Array, factor) -> Array:
    """q with the derivative it has as the solution of the (traced) scene; its value is unchanged."""
    quiet = still(scene)
    q = jax.lax.stop_gradient(q)
    factors: list[Factor] = []  # made when first needed: a solution nobody differentiates costs nothing

    def solved(b: np.ndarray, transposed: bool) -> np.ndarray:
        if not factors:
            factors.append(Factor(A, scene.model.hyperelastic))
        return factors[0].solve(np.asarray(b).T, transposed).T.astype(b.dtype)

    A = matrix(quiet, quiet.displacement(q, factor), factor)

    def solve(_, b, transposed=False):
        like = jax.ShapeDtypeStruct(b.shape, b.dtype)
        return jax.pure_callback(lambda x: solved(x, transposed), like, b, vmap_method="expand_dims")

    r = residual_of(scene, q, factor)
    change = jax.lax.custom_linear_solve(
        lambda v: product(quiet, q, factor, v),
        jax.lax.stop_gradient(r) - r,
        solve,
        lambda matvec, b: solve(matvec, b, True),
        symmetric=scene.model.hyperelastic,
    )
    return q + change


def is_differentiated(scene: Scene) -> bool:
    """True if a derivative is flowing through the scene."""
    return any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(scene))
