"""Derivatives of a root by the implicit function theorem, from Newton steps at the converged root.

    r(x, θ) = 0   ⇒   dx/dθ = −(∂r/∂θ)/(∂r/∂x),        step  x ← x − r(x, θ)/s,   s = ∂r/∂x at the root

The search that found the root x, one number, is not differentiated. A step at the root hardly changes the value of x.
Its derivative in a parameter θ is dx/dθ. The slope s is a constant of the differentiation. Each further step with the
same s makes the derivatives of one more order exact, because it leaves out only terms that the step before has made
exact.

An equilibrium of a body has many unknowns, and its matrix factorisation stays on the host. It has a rule of its own
(`pdjax.finite_body.statics.implicit`).
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def implicit_step(residual: Callable[[Array], Array], root: Float[Array, ""]) -> tuple[Array, Array]:
    """(r/s, s) at a root that has no derivatives. `root` − r/s has first derivatives, the slope s has none."""
    value, slope = jax.jvp(residual, (root,), (jnp.ones_like(root),))
    slope = jax.lax.stop_gradient(slope)
    return value / slope, slope


def implicit_root(residual: Callable[[Array], Array], root: Float[Array, ""], order: int = 1) -> Float[Array, ""]:
    """A converged root of `residual` with its derivatives, exact up to `order`."""
    root = jax.lax.stop_gradient(root)
    step, slope = implicit_step(residual, root)
    root = root - step
    for _ in range(order - 1):
        root = root - residual(root) / slope
    return root
