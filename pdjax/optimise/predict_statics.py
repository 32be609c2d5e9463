"""Displacements and forces of an equilibrium as functions of parameters, with exact Jacobians.

    r(q, θ) = 0,   y = measure(scene, u)      dy/dθ = ∂y/∂θ − ∂y/∂q A⁻¹ ∂r/∂θ

θ are the parameters, q the free components of the displacement, r the residual of the scene, A = ∂r/∂q and y the
predicted data. One matrix factorisation of A serves the whole Jacobian. The tangent form solves A x = ∂r/∂θ once for
each parameter. The adjoint form solves Aᵀ x = ∂y/∂q once for each datum.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._internal.checks import in_host_memory
from ..finite_body.direct_solver import factorised
from ..finite_body.factorisation import Singular, matrix, residual, residual_of
from ..finite_body.scene import Scene
from ..finite_body.statics.solve import solve
from .parameters import Parameters
from .predictions import LeftDomain, Rates, each, forward, joined, rates, reverse, values_of, with_values

# A trial point has no equilibrium if Newton's method fails with load steps of this size. Smaller steps and more
# iterations made searches with many such points ten times as long.
PATIENCE: dict[str, Any] = {"smallest_step": 1 / 8, "max_iterations": 25}
QUIET: dict[str, Any] = {"stability": False, "show_progress": False}


def displacements(scene: Scene, u: Array) -> Array:
    """The default measurement of statics: the displacements (points, dim)."""
    return u


@eqx.filter_jit
def _measured(measure: Callable, scene: Scene, q: Array) -> Any:
    return measure(scene, scene.displacement(q))


@eqx.filter_jit
def _residual_rate(scene: Scene, q: Array, where: tuple[int, ...], rate: list[Array]) -> Array:
    """∂r/∂θ, (unknowns, parameters)."""
    return forward(lambda s: residual_of(s, q, 1.0), scene, Rates(where, rate))


@eqx.filter_jit
def _measured_rate(
    measure: Callable, scene: Scene, q: Array, dq: Array | np.ndarray, where: tuple[int, ...], rate: list
) -> Array:
    """dy/dθ, (data, parameters), where q changes by dq (unknowns, parameters)."""
    values = values_of(scene, where)

    def predicted(values: list[Array], q: Array) -> Array:
        made = with_values(scene, where, values)
        return joined(measure(made, made.displacement(q)))

    return each(lambda x: jax.jvp(predicted, (values, q), (x[0], x[1]))[1], (rate, dq.T)).T


@eqx.filter_jit
def _measured_back(
    measure: Callable, scene: Scene, q: Array, index: Array | np.ndarray, where: tuple[int, ...], rate: list[Array]
) -> tuple[Array, Array]:
    """∂y/∂q (index, unknowns) and ∂y/∂θ (index, parameters) of the data `index`."""

    def predicted(s: Scene, q: Array) -> Array:
        return joined(measure(s, s.displacement(q)))[index]

    rows = jnp.eye(index.shape[0], dtype=q.dtype)
    _, back = jax.vjp(lambda x: predicted(scene, x), q)
    return each(lambda row: back(row)[0], rows), reverse(lambda s: predicted(s, q), scene, Rates(where, rate), rows)


@eqx.filter_jit
def _residual_back(
    scene: Scene, q: Array, rows: Array | np.ndarray, where: tuple[int, ...], rate: list[Array]
) -> Array:
    """rows (n, unknowns) times ∂r/∂θ, (n, parameters)."""
    return reverse(lambda s: residual_of(s, q, 1.0), scene, Rates(where, rate), rows)


class Statics:
    """Predictions of a scene that depends on parameters. A new point starts Newton's method at the last equilibrium."""

    what = "the displacements of the equilibrium, (points, dim)"

    def __init__(self, scene_of: Callable, parameters: Parameters, first: Scene, measure: Callable | None):
        self.scene_of, self.parameters, self.measure = scene_of, parameters, measure or displacements
        self.families = first.families
        self.u: Array | None = None

    def build(self, flat: Any) -> Scene:
        """The scene of the flat parameters, with the first families where the new ones are equal to them.

        What pdjax remembers about families, such as the sparsity of the Jacobian, is then computed once.
        """
        scene = self.scene_of(self.parameters.tree(flat))
        if not isinstance(scene, Scene):
            raise ValueError(f"scene_of must always return a Scene; at {flat} it returned {type(scene).__name__}")
        known = self.families
        same = scene.families is known or (
            in_host_memory(scene.families) and bool(eqx.tree_equal(scene.families, known))
        )
        # The closed form takes no part in the solution, so it needs no derivative.
        return dataclasses.replace(scene, families=known if same else scene.families, closed_form=None)

    def predict(self, flat: np.ndarray) -> Any:
        """The predicted data as a tree of arrays. Raises `LeftDomain` where there is no equilibrium."""
        scene = self.build(flat)
        found = None if self.u is None else solve(scene, start=self.u, smallest_step=1.0, max_iterations=25, **QUIET)
        if found is None or not found.converged:
            found = solve(scene, **PATIENCE, **QUIET)
        if not found.converged:
            raise LeftDomain(f"the scene has no equilibrium that `solve` finds: {found.reason}")
        q = np.asarray(found.u).reshape(-1)[np.asarray(scene.unknowns)]
        try:
            self.factor = factorised(matrix(scene, found.u), scene.model.hyperelastic)
        except Singular as error:
            raise LeftDomain(f"the equilibrium is at a limit point: {error}") from None
        # `solve` stops at a relative residual of 1e-10. One more step makes the prediction as smooth as its derivative.
        self.q = jax.device_put(q - self.factor.solve(np.asarray(residual(scene, q, 1.0))))
        self.scene, self.u = scene, found.u
        return _measured(self.measure, scene, self.q)

    def jacobian(self, flat: np.ndarray, index: np.ndarray, adjoint: bool) -> np.ndarray:
        """dy/dθ (index, parameters) of the data `index` at the last predicted point."""
        scene, q, found = self.scene, self.q, rates(self.build, flat)
        if not found.where:
            return np.zeros((len(index), len(flat)))
        if adjoint:
            rows, own = _measured_back(self.measure, scene, q, index, found.where, found.rates)
            solved = self.factor.solve(np.asarray(rows).T, transposed=True).T
            return np.asarray(own) - np.asarray(_residual_back(scene, q, solved, found.where, found.rates))
        dq = -self.factor.solve(np.asarray(_residual_rate(scene, q, found.where, found.rates)))
        return np.asarray(_measured_rate(self.measure, scene, q, dq, found.where, found.rates))[index]
