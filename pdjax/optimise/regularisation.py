"""Regularisation of inverse problems, as residuals that join the least squares.

An inverse problem with many parameters amplifies the noise of its data. Regularisation adds a penalty ‖ρ(θ)‖² to the
misfit, where θ are the parameters:

    Tikhonov          ρ = √w Dᵏ (θ − θ₀)                           ‖ρ‖² = w Σ |Dᵏ (θ − θ₀)|²
    total variation   ρ = √w Δ / √(√(Δ² + ε²) + ε),  Δ = D θ        ‖ρ‖² = w Σ (√(Δ² + ε²) − ε)

D takes differences of neighbouring entries of an array, along every axis of it. ε is the smoothing. The second form is
the smoothed total variation without its constant w ε for each difference. The residual (Δ² + ε²)^¼ has nearly the same
sum of squares, but its slope vanishes at Δ = 0, where a Gauss–Newton method would then see no curvature. The form above
has there the exact curvature of the penalty, w/ε.

At w = 0 the residuals have no derivative with respect to w, because that of √w is infinite.

Sources: Tikhonov & Arsenin 1977; Rudin, Osher & Fatemi 1992; Acar & Vogel 1994 (smoothing).
"""

import math
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._internal.checks import as_real, is_concrete, require
from .._internal.public import public_function


@jax.custom_jvp
def _root(weight: Array) -> Array:
    """√w. Its derivative at w = 0 raises an error."""
    return jnp.sqrt(weight)


@_root.defjvp
def _(primals, tangents):
    (weight,), (change,) = primals, tangents
    root = require(
        jnp.sqrt(weight),
        weight > 0,
        "weight must be > 0 where the residuals are differentiated with respect to it, because the derivative of √w is"
        " infinite at w = 0; got 0. Take a small weight > 0",
    )
    return root, change / (2 * root)


def _differences(tree: Any, order: int) -> list[Array]:
    """The differences of an order of all arrays of a tree, along every axis, each as a flat array."""
    arrays = [jnp.asarray(leaf) for leaf in jax.tree.leaves(tree)]
    if order == 0:
        return [array.reshape(-1) for array in arrays]
    found = [jnp.diff(a, order, axis).reshape(-1) for a in arrays for axis in range(a.ndim)]
    if not sum(part.size for part in found):
        raise ValueError(
            f"the regularisation takes differences of order {order}, and the parameters have no array of more than"
            f" {order} entries along an axis; got shapes {[a.shape for a in arrays]}"
        )
    return found


class Tikhonov(eqx.Module):
    """The residuals of `tikhonov`. Call it with the parameters."""

    weight: Float[Array, ""] = eqx.field(converter=as_real)
    reference: Any
    difference: int = eqx.field(static=True)
    part: Callable | None = eqx.field(static=True)

    def __call__(self, parameters: Any) -> Float[Array, " residuals"]:
        tree = parameters if self.part is None else self.part(parameters)
        if self.reference is not None:
            tree = jax.tree.map(lambda x, x0: x - x0, tree, self.reference)
        return _root(self.weight) * jnp.concatenate([jnp.zeros(0), *_differences(tree, self.difference)])


class TotalVariation(eqx.Module):
    """The residuals of `total_variation`. Call it with the parameters."""

    weight: Float[Array, ""] = eqx.field(converter=as_real)
    smoothing: Float[Array, ""] = eqx.field(converter=as_real)
    part: Callable | None = eqx.field(static=True)

    def __call__(self, parameters: Any) -> Float[Array, " residuals"]:
        tree = parameters if self.part is None else self.part(parameters)
        d = jnp.concatenate([jnp.zeros(0), *_differences(tree, 1)])
        return _root(self.weight) * d / jnp.sqrt(jnp.sqrt(d**2 + self.smoothing**2) + self.smoothing)


def _check(name: str, value: Any, least: float) -> None:
    if is_concrete(value) and not (math.isfinite(float(value)) and float(value) >= least):
        raise ValueError(f"{name} must be finite and >= {least:g}; got {value}")


@public_function
def tikhonov(weight, reference=None, *, difference: int = 0, part: Callable | None = None) -> Tikhonov:
    """Make a Tikhonov regularisation for `identify`.

    ‖ρ‖² = w Σ |Dᵏ (θ − θ₀)|²

    Parameters
    ----------
    weight : float
        Weight w, ≥ 0. Its unit is 1/unit of the parameters squared.
    reference : tree, optional
        Expected parameters θ₀, a tree like the parameters or like `part` of them. Default: zero.
    difference : int, optional
        Order k of the differences: 0 for the values (default), 1 for slopes, 2 for curvatures.
    part : function, optional
        Selects what is penalised, for example `lambda p: p["modulus"]`. Default: all parameters.

    Returns
    -------
    Tikhonov
        A function of the parameters that returns the residuals ρ.

    Raises
    ------
    ValueError
        If the weight is negative or not finite, or `difference` is not 0, 1 or 2. If the residuals are differentiated
        with respect to a weight of 0.

    References
    ----------
    Tikhonov & Arsenin 1977

    Examples
    --------
    >>> slopes = pd.tikhonov(4.0, difference=1)
    >>> print(slopes(np.array([1.0, 1.5, 3.0])))
    [1. 3.]
    """
    _check("weight", weight, 0)
    if difference not in (0, 1, 2):
        raise ValueError(f"difference must be 0, 1 or 2; got {difference!r}")
    return Tikhonov(weight, reference, int(difference), part)


@public_function
def total_variation(weight, smoothing, *, part: Callable | None = None) -> TotalVariation:
    """Make a total variation regularisation for `identify`, which keeps jumps of a field and flattens its noise.

    ‖ρ‖² = w Σ (√(Δ² + ε²) − ε),   Δ = differences of neighbouring entries

    Parameters
    ----------
    weight : float
        Weight w, ≥ 0. Its unit is 1/unit of the parameters.
    smoothing : float
        Smoothing ε [unit of the parameters], at least 1.5e-154, or 1.1e-19 in float32. Differences far below it are
        penalised as squares.
    part : function, optional
        Selects what is penalised, for example `lambda p: p["modulus"]`. Default: all parameters.

    Returns
    -------
    TotalVariation
        A function of the parameters that returns the residuals ρ.

    Raises
    ------
    ValueError
        If the weight is negative, the smoothing is not positive or too small, or one of them is not finite.
        If the residuals are differentiated with respect to a weight of 0.

    References
    ----------
    Rudin, Osher & Fatemi 1992; Acar & Vogel 1994

    Examples
    --------
    A jump of 3 costs √(3² + 4²) − 4 = 1 for a smoothing of 4:

    >>> jump = pd.total_variation(1.0, smoothing=4.0)(np.array([0.0, 3.0, 3.0]))
    >>> round(float(np.sum(jump**2)), 6)
    1.0
    """
    _check("weight", weight, 0)
    # The square of a smaller number underflows, and the derivative at Δ = 0 is then NaN.
    _check("smoothing", smoothing, math.sqrt(jnp.finfo(jnp.result_type(float)).tiny))
    return TotalVariation(weight, smoothing, part)
