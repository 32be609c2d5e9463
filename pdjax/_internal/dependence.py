"""The constants of a model on which a result depends, found by tracing once the function that computes the result.

Reference sums, transforms of kernels and shape tensors are prepared once and kept (`pdjax._internal.memory`). Most of
them depend on the families alone, or on a few constants of the model. A result prepared for one model is therefore used
again for all models that differ only in other constants. These other constants may also be traced, as in a gradient.
"""

from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax.extend import core

from .memory import remember, value_key

Model = TypeVar("Model")


def _read(function: Callable, shapes: list, structure: jax.tree_util.PyTreeDef, rest: Any) -> tuple[bool, ...]:
    """For each leaf, whether the result of `function` depends on it."""

    def of(leaves: list) -> object:
        return function(eqx.combine(jax.tree.unflatten(structure, leaves), rest))

    made = jax.make_jaxpr(of)(shapes).jaxpr
    live = {v for v in made.outvars if not isinstance(v, core.Literal)}
    for eqn in reversed(made.eqns):
        if any(v in live for v in eqn.outvars):
            live.update(v for v in eqn.invars if not isinstance(v, core.Literal))
    return tuple(v in live for v in made.invars)


def known_part(
    owner: eqx.Module, name: Hashable, function: Callable[[Model], object], model: Model
) -> tuple[Hashable, Model] | None:
    """A key for `remember` made of what `function(model)` depends on, and the model with concrete values.

    `owner` is the equinox module that keeps the result. `name` identifies the function, which is traced once for each
    structure of the model. In the returned model, traced constants that the function does not read are 0. The result is
    None if the function reads a traced constant.
    """
    arrays, rest = eqx.partition(model, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    shapes = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in leaves]
    what = (name, structure, value_key(rest), tuple((s.shape, s.dtype) for s in shapes))
    read = remember(owner, ("read by", *what), lambda: _read(function, shapes, structure, rest))
    key = value_key([x for x, r in zip(leaves, read, strict=True) if r])
    if key is None:
        return None
    known = [np.zeros(x.shape, x.dtype) if isinstance(x, jax.core.Tracer) else x for x in leaves]
    return (what, key), eqx.combine(jax.tree.unflatten(structure, known), rest)
