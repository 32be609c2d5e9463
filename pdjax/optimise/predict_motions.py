"""Records of a run as functions of parameters, with exact Jacobians through all of its steps.

    y = measure(motion, history)

Forward mode runs the motion once with all tangents, one for each parameter, in the memory of a few states. Reverse mode
runs it backwards for each datum. It keeps checkpoints, about 2 √steps states between two saves (see
`pdjax.finite_body.dynamics.verlet`).
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from ..finite_body.dynamics.run import run_length, simulate
from ..finite_body.dynamics.system import Motion
from .parameters import Parameters
from .predictions import Rates, forward, joined, rates, reverse


def saved_displacements(motion: Motion, history: Any) -> Array:
    """The default measurement of dynamics: the displacements of all saves (saves, points, dim)."""
    return history.u


def _record(motion: Motion, measure: Callable, run: tuple) -> Any:
    duration, dt, save_every = run
    return measure(motion, simulate(motion, duration, dt=dt, save_every=save_every, show_progress=False))


_run = eqx.filter_jit(_record)


@eqx.filter_jit
def _run_forward(motion: Motion, measure: Callable, run: tuple, where: tuple[int, ...], rate: list[Array]) -> Array:
    return forward(lambda m: joined(_record(m, measure, run)), motion, Rates(where, rate))


@eqx.filter_jit
def _run_back(
    motion: Motion, measure: Callable, run: tuple, index: Array | np.ndarray, where: tuple[int, ...], rate: list[Array]
) -> Array:
    rows = jnp.eye(index.shape[0])
    return reverse(lambda m: joined(_record(m, measure, run))[index], motion, Rates(where, rate), rows)


class Dynamics:
    """Predictions of a motion that depends on parameters. All runs have the same times."""

    what = "the saved displacements of the run, (saves, points, dim)"

    def __init__(self, scene_of, parameters: Parameters, first: Motion, measure, duration, dt, save_every):
        if dt is None:
            raise ValueError(
                "dt must be given where scene_of returns a Motion: the saves must keep their times while the parameters"
                " change. Choose one below the critical time step of all parameters, with `critical_time_step`"
            )
        self.scene_of, self.parameters, self.measure = scene_of, parameters, measure or saved_displacements
        self.run = (run_length(first, duration), float(dt), save_every)

    def build(self, flat: Any) -> Motion:
        """The motion of the flat parameters."""
        motion = self.scene_of(self.parameters.tree(flat))
        if not isinstance(motion, Motion):
            raise ValueError(f"scene_of must always return a Motion; at {flat} it returned {type(motion).__name__}")
        # The closed form and the default duration take no part in the run.
        scene = dataclasses.replace(motion.scene, closed_form=None)
        return dataclasses.replace(motion, scene=scene, duration=None)

    def predict(self, flat: np.ndarray) -> Any:
        """The predicted data as a tree of arrays."""
        self.motion = self.build(flat)
        return _run(self.motion, self.measure, self.run)

    def jacobian(self, flat: np.ndarray, index: np.ndarray, adjoint: bool) -> np.ndarray:
        """dy/dθ (index, parameters) of the data `index` at the last predicted point."""
        found = rates(self.build, flat)
        if not found.where:
            return np.zeros((len(index), len(flat)))
        if adjoint:
            return np.asarray(_run_back(self.motion, self.measure, self.run, index, found.where, found.rates))
        return np.asarray(_run_forward(self.motion, self.measure, self.run, found.where, found.rates))[index]
