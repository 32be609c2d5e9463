"""A design problem: an objective and constraints as functions of one scaled vector.

The parameters θ are a tree of arrays. The search sees a vector z with θ = θ₀ + s z, where θ₀ is the start and s a size
for each parameter: the width of its bounds if both are finite, otherwise |θ₀|, and 1 where θ₀ = 0. One call evaluates
the objective and all constraints together, so that the model is built once. Their derivatives come from one reverse
pass for each gradient that is asked for.

A point lies outside the domain if a function raises ValueError there or returns NaN: a negative penalty, a load path
without a state, a modulus that is not positive. `evaluate` then returns None, and the search takes a shorter step.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from .._internal.checks import as_array
from .parameters import Parameters


class Evaluation(NamedTuple):
    """The values at one point, and the gradient of any combination of them."""

    z: np.ndarray  # (parameters,)
    objective: float
    constraints: np.ndarray  # (constraints,), a feasible point has none > 0
    gradient: Callable[[float, np.ndarray], np.ndarray]  # of a · objective + b · constraints, in z

    @property
    def slopes(self) -> list[np.ndarray]:
        """The gradients of the objective and of every constraint."""
        count = len(self.constraints)
        return [self.gradient(1.0, np.zeros(count)), *(self.gradient(0.0, row) for row in np.eye(count))]


def named(constraints: Any) -> dict[str, Callable]:
    """Constraints given as a function, a sequence or a mapping, by name."""
    if constraints is None:
        return {}
    if isinstance(constraints, Mapping):
        table = dict(constraints)
    else:
        several = [constraints] if callable(constraints) else list(constraints)
        table = {}
        for i, function in enumerate(several):
            name = getattr(function, "__name__", "<lambda>")
            table[f"constraint {i}" if name == "<lambda>" or name in table else name] = function
    for name, function in table.items():
        if not callable(function):
            raise ValueError(f"constraint {name!r} must be a function of what build returns; got {function!r}")
    return table


class Problem:
    """Objective and constraints of a scaled vector; see the module."""

    def __init__(self, build: Callable, start: Any, objective: Callable, constraints: Any, bounds: Any):
        if not callable(build) or not callable(objective):
            raise ValueError("build and objective must be functions: build(parameters) -> model or (model, family)")
        self.build, self.objective, self.functions = build, objective, named(constraints)
        self.tree = Parameters(start)
        self.origin, self.names = self.tree.flat, self.tree.names
        lower, upper = self._bounds(bounds)
        self.size = np.where(self.origin != 0, np.abs(self.origin), 1.0)
        both = np.isfinite(lower) & np.isfinite(upper)
        self.size[both] = (upper - lower)[both]
        self.lower, self.upper = ((x - self.origin) / self.size for x in (lower, upper))
        self.evaluations, self.outside, self.last_error = 0, 0, ""
        self.error: Exception | None = None

    def _bounds(self, bounds: Any) -> tuple[np.ndarray, np.ndarray]:
        if bounds is not None and not (isinstance(bounds, Sequence) and len(bounds) == 2):
            raise ValueError("bounds must be a pair (lower, upper) of numbers or of trees like start")
        low, high = (None, None) if bounds is None else bounds
        lower = self.tree.flat_of("the lower bounds", low, -np.inf)
        upper = self.tree.flat_of("the upper bounds", high, np.inf)
        bad = ~((lower < upper) & (lower <= self.origin) & (self.origin <= upper))
        if bad.any():
            i = int(np.argmax(bad))
            raise ValueError(
                f"bounds must hold lower < upper and contain the start; {self.names[i]} has [{lower[i]:g},"
                f" {upper[i]:g}] and starts at {self.origin[i]:g}"
            )
        return lower, upper

    def parameters(self, z: np.ndarray) -> Any:
        """The tree of parameters of a scaled vector."""
        return self.tree.tree(self.origin + self.size * z)

    def built(self, parameters: Any) -> tuple:
        """What `build` returns, as the arguments of objective and constraints."""
        made = self.build(parameters)
        return made if isinstance(made, tuple) else (made,)

    def _values(self, parameters: Any) -> tuple:
        made = self.built(parameters)
        return tuple(as_array(function(*made)) for function in (self.objective, *self.functions.values()))

    def values(self, z: np.ndarray) -> list[np.ndarray]:
        """The objective and each constraint at z, without derivatives."""
        return [np.asarray(x, float) for x in self._values(self.parameters(z))]

    def evaluate(self, z: np.ndarray) -> Evaluation | None:
        """The values at z with their derivatives, or None if z lies outside the domain."""
        self.evaluations += 1
        try:
            out, pull = jax.vjp(self._values, self.parameters(z))
        except (ValueError, FloatingPointError, eqx.EquinoxRuntimeError) as error:
            self.outside, self.last_error, self.error = self.outside + 1, str(error).split("\n")[0], error
            return None
        values = [np.asarray(x, float) for x in out]
        if values[0].shape != ():
            raise ValueError(f"objective must return one number; it returned an array of shape {values[0].shape}")
        flat = [x.ravel() for x in values[1:]]
        if not all(x.size for x in flat):
            name = next(n for n, x in zip(self.functions, flat, strict=True) if not x.size)
            raise ValueError(f"constraint {name!r} must return at least one number; it returned an empty array")
        if not all(np.isfinite(x).all() for x in (values[0], *flat)):
            bad = [n for n, x in zip(("objective", *self.functions), values, strict=True) if not np.isfinite(x).all()]
            self.outside, self.last_error = self.outside + 1, f"{', '.join(bad)} was not finite"
            return None

        def gradient(a: float, b: np.ndarray) -> np.ndarray:
            parts = np.split(np.asarray(b, float), np.cumsum([x.size for x in flat])[:-1]) if flat else []
            weights = [np.asarray(a), *(p.reshape(v.shape) for p, v in zip(parts, values[1:], strict=True))]
            (tree,) = pull(tuple(as_array(w, o.dtype) for w, o in zip(weights, out, strict=True)))
            return self.size * np.concatenate([np.asarray(leaf, float).ravel() for leaf in jax.tree.leaves(tree)])

        return Evaluation(z, float(values[0]), np.concatenate([np.zeros(0), *flat]), gradient)

    @property
    def constraint_names(self) -> list[str]:
        return list(self.functions)
