"""The search of `identify`: the trust-region reflective method of SciPy, with a record of its best point.

A trial point without a prediction has infinite residuals. SciPy then takes a step of a quarter of the length.
"""

import sys
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .identified import NULL, IdentifyEnding, spectrum
from .measured import Measured
from .parameters import Parameters
from .predictions import LeftDomain

# Largest change of the predictions, relative to the largest of them, that counts as rounding; measured below 1e-14.
ROUNDING = 1e-12
ENDINGS = {1: IdentifyEnding.GRADIENT, 2: IdentifyEnding.COST, 3: IdentifyEnding.STEP, 4: IdentifyEnding.COST}


@eqx.filter_jit
def _penalty(regularisation: tuple, tree: Any) -> Array:
    return jnp.concatenate([jnp.ravel(part(tree)) for part in regularisation])


@eqx.filter_jit
def _penalty_slope(regularisation: tuple, tree: Any) -> Any:
    return jax.jacfwd(lambda x: _penalty(regularisation, x))(tree)


class Search:
    """The cost of the least squares and its Jacobian at scaled parameters, with the best point of the search."""

    def __init__(self, problem, measured: Measured, parameters: Parameters, scale, regularisation, adjoint, show):
        self.problem, self.measured, self.parameters, self.scale = problem, measured, parameters, scale
        self.regularisation, self.adjoint = regularisation, adjoint
        self.forward, self.jacobians, self.failures = 1, 0, 0
        self.failure: str | None = None
        self.history: list[float] = []
        self.best: tuple | None = None
        self.at, self.data = np.array(parameters.flat), measured.first
        self.start, self.pins = parameters.flat / scale, np.zeros((0, scale.size))
        self.first: np.ndarray | None = None
        self.failed = False
        self.show = show and sys.stderr.isatty()

    def _penalty(self, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The residuals of the regularisation and their Jacobian."""
        if not self.regularisation:
            return np.zeros(0), np.zeros((0, flat.size))
        tree = self.parameters.tree(flat)
        rho = np.asarray(_penalty(self.regularisation, tree))
        slopes = jax.tree.leaves(_penalty_slope(self.regularisation, tree))
        return rho, np.concatenate([np.asarray(s).reshape(len(rho), -1) for s in slopes], axis=1)

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """The weighted residuals; infinite where there is no prediction."""
        flat = z * self.scale
        if not np.array_equal(flat, self.at):
            self.forward += 1
            data = self._predicted(flat)
            self.failed = data is None
            if data is None:
                self.failures += 1
                return np.full(self.data.size + self._penalty(self.at)[0].size + len(self.pins), np.inf)
            self.at, self.data = flat, data
        return np.concatenate([self.data, self._penalty(flat)[0], self.pins @ (z - self.start)])

    def _predicted(self, flat: np.ndarray) -> np.ndarray | None:
        try:
            data = self.measured.weighted(self.problem.predict(flat))
        except (LeftDomain, ArithmeticError, RuntimeError, ValueError) as error:
            self.failure = (str(error).strip().splitlines() or [type(error).__name__])[0]
            return None
        if not np.isfinite(data).all():
            self.failure = "a prediction is not finite"
            return None
        return data

    def pin(self) -> None:
        """Keep the start along the directions that change no residual there.

        Rounding errors would move the parameters far along them, because the trust region alone limits such steps.
        """
        self.first = self.jacobian(self.start)
        s, v = spectrum(self.first)
        self.pins = s[0] * v[s <= NULL * s[0]]
        self.first = np.concatenate([self.first, self.pins])

    def check_dependence(self, low: np.ndarray, high: np.ndarray) -> None:
        """Raise ValueError if the predictions have no derivative and no other value in the neighbourhood of the start.

        low, high: bounds of the scaled parameters.
        """
        assert self.best is not None
        _, _, first, J, _ = self.best
        rounding = ROUNDING * np.max(np.abs(first + self.measured.values / self.measured.sigma))
        if np.max(np.abs(J)) > rounding:
            return
        near = self.start + 0.05 * np.random.default_rng(1).standard_normal(len(self.start))
        self.forward += 1
        self.at = np.full(len(self.start), np.nan)  # The problem keeps its last point, which is no longer the start.
        data = self._predicted(np.clip(near, low, high) * self.scale)
        if data is not None and np.max(np.abs(data - first)) <= rounding:
            raise ValueError(
                "the predictions do not depend on the parameters: they are the same at the start and at a point near"
                " by, and their derivatives are zero. Check that scene_of uses the parameters and that no value becomes"
                " a Python number on the way. A common factor of all moduli changes no displacement under prescribed"
                " displacements; measure a force too"
            )

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """The Jacobian of the weighted residuals at an accepted point."""
        if self.first is not None:  # the search asks for the one at the start, which `pin` has computed
            first, self.first = self.first, None
            return first
        flat = z * self.scale
        residuals = self.residuals(z)
        slope = self.problem.jacobian(flat, self.measured.index, self.adjoint)
        self.jacobians += 1
        J = slope / self.measured.sigma[:, None] * self.scale
        if not np.isfinite(J).all():
            bad = [self.parameters.names[k] for k in np.flatnonzero(~np.isfinite(J).all(axis=0))]
            raise RuntimeError(f"the derivative of the predictions is not finite, with respect to {', '.join(bad[:4])}")
        R = self._penalty(flat)[1] * self.scale
        cost = 0.5 * float(residuals @ residuals)
        self.history.append(cost)
        if self.best is None or cost <= self.best[0]:
            self.best = (cost, flat, self.data, J, R)
        if self.show:
            words = f"identify: iteration {len(self.history) - 1}, {self.forward} forward solves, cost {cost:.6g}"
            print(f"\r{words:<79}", end="", file=sys.stderr, flush=True)
        return np.concatenate([J, R, self.pins])


def minimise(search: Search, z: np.ndarray, bounds, tolerance: float, most: int) -> IdentifyEnding:
    from scipy.optimize import least_squares

    try:
        search.pin()
        search.check_dependence(*bounds)
        assert search.best is not None
        if not any(slopes.any() for slopes in search.best[3:]):  # SciPy would take steps of NaN.
            return IdentifyEnding.GRADIENT
        with np.errstate(divide="ignore", invalid="ignore"):  # SciPy divides 0 by 0 where all residuals are zero
            found = least_squares(
                search.residuals,
                z,
                search.jacobian,
                bounds,
                method="trf",
                ftol=tolerance,
                xtol=tolerance,
                gtol=None,  # it would depend on the scales of data and parameters
                max_nfev=most,
            )
    except KeyboardInterrupt:
        if search.best is None:
            raise
        return IdentifyEnding.INTERRUPTED
    finally:
        if search.show:
            print(file=sys.stderr)
    if found.status == 3 and search.failed:
        return IdentifyEnding.BLOCKED
    return ENDINGS.get(found.status, IdentifyEnding.OUT_OF_SOLVES)
