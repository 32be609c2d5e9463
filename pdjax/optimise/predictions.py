"""Predictions of measured data from parameters, and the derivatives of what a function of the user makes of them.

θ are the parameters, y(θ) the predicted data. Three kinds of problem give predictions:

    statics    r(q, θ) = 0,  y = measure(scene, u)      `pdjax.optimise.predict_statics`
    dynamics   y = measure(motion, history)             `pdjax.optimise.predict_motions`
    any        y = function(θ)                          `Function`, differentiated by JAX

A scene or a motion is a function of the parameters, but only some of its arrays depend on them. `Rates` holds these
arrays and their derivatives. The compiled programs therefore see arrays and no function that makes scenes, and they
compile once.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .parameters import Parameters

BATCH = 16  # derivatives that one batch of a compiled program computes at the same time; its memory grows with it
TRACING = (
    jax.errors.ConcretizationTypeError,
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerBoolConversionError,
)


class LeftDomain(Exception):
    """The parameters have no prediction, for example because the scene has no equilibrium."""


@dataclass(frozen=True)
class Rates:
    """The leaves of a scene or motion that depend on the parameters, and their derivatives.

    where: numbers of these leaves. rates: the derivatives, one array (parameters, *shape of the leaf) for each.
    """

    where: tuple[int, ...]
    rates: list[Array]


def rates(build: Callable[[Any], Any], at: np.ndarray) -> Rates:
    """Differentiate the object that `build` makes of the flat parameters, with respect to all of them."""
    where: list[int] = []

    def leaves(flat: Array) -> list[Array]:
        made = jax.tree.leaves(build(flat))
        where[:] = [k for k, leaf in enumerate(made) if isinstance(leaf, jax.core.Tracer)]
        return [made[k] for k in where]

    def along(direction: Array | np.ndarray) -> list[Array]:
        return jax.jvp(leaves, (jax.device_put(at),), (direction,))[1]

    try:
        found = jax.vmap(along)(np.eye(len(at)))
    except TRACING as error:
        raise ValueError(
            "scene_of must be a function that JAX can differentiate, but it reads the value of a parameter. Use"
            " jax.numpy instead of numpy and float() for what depends on the parameters. JAX says:"
            f" {str(error).splitlines()[0]}"
        ) from None
    return Rates(tuple(where), found)


def values_of(module: Any, where: tuple[int, ...]) -> list[Array]:
    """The leaves `where` of a module."""
    leaves = jax.tree.leaves(module)
    return [jnp.asarray(leaves[k]) for k in where]


def with_values(module: Any, where: tuple[int, ...], values: list[Array]) -> Any:
    """The module with the leaves `where` replaced."""
    leaves, form = jax.tree.flatten(module)
    for k, value in zip(where, values, strict=True):
        leaves[k] = value
    return jax.tree.unflatten(form, leaves)


def each(function: Callable, rows: Any) -> Any:
    """`function` of every row, in batches."""
    count = jax.tree.leaves(rows)[0].shape[0]
    return jax.vmap(function)(rows) if count <= BATCH else jax.lax.map(function, rows, batch_size=BATCH)


def joined(tree: Any) -> Array:
    """All entries of the arrays of a tree as one flat array."""
    return jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(tree)])


def forward(function: Callable, module: Any, rates: Rates) -> Array:
    """The derivative of `function(module)` with respect to the parameters, (values, parameters), by forward mode."""
    values = values_of(module, rates.where)

    def along(rate: list[Array]) -> Array:
        return jax.jvp(lambda x: function(with_values(module, rates.where, x)), (values,), (rate,))[1]

    return each(along, rates.rates).T


def reverse(function: Callable, module: Any, rates: Rates, rows: Array | np.ndarray) -> Array:
    """rows (n, values) times the derivative of `function(module)`, (n, parameters), by reverse mode."""
    _, back = jax.vjp(lambda x: function(with_values(module, rates.where, x)), values_of(module, rates.where))
    slopes = each(lambda row: back(row)[0], rows)
    count = rates.rates[0].shape[0]
    flat = [(slope.reshape(len(slope), -1), r.reshape(count, -1)) for slope, r in zip(slopes, rates.rates, strict=True)]
    return sum((slope @ r.T for slope, r in flat), jnp.zeros((len(rows), count)))


class Function:
    """Predictions by a function of the user, which JAX differentiates."""

    what = "what scene_of returns"

    def __init__(self, predict: Callable, parameters: Parameters):
        self.function, self.parameters = predict, parameters

    def predict(self, flat: np.ndarray) -> Any:
        """The predicted data as a tree of arrays."""
        return self.function(self.parameters.tree(flat))

    def jacobian(self, flat: np.ndarray, index: np.ndarray, adjoint: bool) -> np.ndarray:
        """dy/dθ (index, parameters) of the data `index`."""

        def predicted(x: Array) -> Array:
            return joined(self.function(self.parameters.tree(x)))[index]

        return np.asarray((jax.jacrev if adjoint else jax.jacfwd)(predicted)(jax.device_put(flat)))
