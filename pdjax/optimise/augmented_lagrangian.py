"""Minimise an objective under inequality constraints and bounds, by an augmented Lagrangian.

    minimise f(z)   with   c_i(z) ≤ 0,   lower ≤ z ≤ upper

Round by round, an inner search decreases the merit function of the multipliers λ ≥ 0 and the penalty ρ,

    L(z) = f + Σ [max(0, λ_i + ρ c_i)² − λ_i²]/(2ρ),

and after each round λ_i ← max(0, λ_i + ρ c_i). Where the violation did not fall to a quarter, ρ grows tenfold. f and
every c_i are divided by the norms of their gradients at the start, so that the violation of a constraint does not
depend on its unit.

The inner search is a gradient transformation of optax, projected onto the bounds. The default is Adam for the first
steps, which does not mind kinks of the functions, then L-BFGS. Every step of L-BFGS is halved until the merit function
decreases. A step of any method is halved while it leaves the domain of the functions.

Sources: Nocedal & Wright 2006, chapters 7 and 17; Kingma & Ba 2015 (Adam).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
import optax

from .._internal.checks import as_array
from .._internal.ending import Ending
from .problem import Evaluation, Problem

ADAM_STEPS, ADAM_RATE = 10, 0.05  # of the scaled vector
MEMORY = 10
ROUND = 30  # steps of one round
ROUNDS = 40
LONGEST = 0.5  # largest change of a component in one step
SHORTEST = 2.0**-20  # smallest part of a step
LEAST_DECREASE = 1e-4  # of the merit function, relative to the slope (Armijo)
STATIONARY = 1e-6  # norm of the projected gradient of the merit function
HIGHEST = 1e9  # penalty ρ


class DesignEnding(Ending):
    """How a search ended."""

    CONVERGED = 0, "the optimality conditions hold to the tolerance"
    STALLED = 1, "no shorter step decreases the merit function, as at a kink of the objective or a constraint"
    OUT_OF_STEPS = 2, "the steps ran out"
    NO_FEASIBLE_POINT = 3, "no feasible point was found; the result is the point of the smallest violation"
    INTERRUPTED = 4, "the search was interrupted; the result is its best point"


class Step(NamedTuple):
    """One accepted point of the search."""

    z: np.ndarray
    objective: float
    violation: float


class Search:
    """The state of one search. It can be stored after every round and continued."""

    def __init__(self, problem: Problem, z: np.ndarray, steps: int, optimiser: Any, tolerance: float):
        self.problem, self.steps, self.tolerance, self.optimiser = problem, steps, tolerance, optimiser
        self.z, self.round, self.previous = z, 0, np.inf
        self.history: list[Step] = []
        self.penalty = 10.0
        first = problem.evaluate(z)
        if first is None:
            raise ValueError(f"start must lie in the domain: {problem.last_error}") from problem.error
        self.here: Evaluation = first
        self.multipliers = np.zeros(len(first.constraints))
        self.slopes = first.slopes
        self.scale, *scales = (_unit(slope) for slope in self.slopes)
        self.scales = np.array(scales)
        self._keep(first)

    def violation(self, at: Evaluation) -> float:
        """The largest constraint relative to its gradient at the start, 0 at a feasible point."""
        return float(np.max(self.scales * at.constraints, initial=0.0))

    def _keep(self, at: Evaluation) -> None:
        self.here = at
        self.history.append(Step(at.z, at.objective, self.violation(at)))

    @property
    def best(self) -> Step:
        """The smallest objective of all feasible points, or the point of the smallest violation."""
        feasible = [s for s in self.history if s.violation <= self.tolerance]
        if feasible:
            return min(feasible, key=lambda s: s.objective)
        return min(self.history, key=lambda s: s.violation)

    def _raised(self, at: Evaluation) -> np.ndarray:
        return np.maximum(0.0, self.multipliers + self.penalty * self.scales * at.constraints)

    def merit(self, at: Evaluation) -> float:
        """The augmented Lagrangian."""
        return self.scale * at.objective + float(np.sum(self._raised(at) ** 2 - self.multipliers**2)) / (
            2 * self.penalty
        )

    def slope(self, at: Evaluation) -> np.ndarray:
        """The gradient of the augmented Lagrangian. Components that point out of the bounds are set to 0."""
        g = at.gradient(self.scale, self._raised(at) * self.scales)
        out = ((at.z <= self.problem.lower) & (g > 0)) | ((at.z >= self.problem.upper) & (g < 0))
        return np.where(out, 0.0, g)

    def _moved(self, direction: np.ndarray, descend: bool, slope: np.ndarray) -> Evaluation | None:
        """The first acceptable point along a direction: inside the domain and, if `descend`, of a smaller merit."""
        longest = np.max(np.abs(direction), initial=0.0)
        part = min(1.0, LONGEST / longest) if longest > 0 else 1.0
        merit = self.merit(self.here)
        while part > SHORTEST:
            z = np.clip(self.here.z + part * direction, self.problem.lower, self.problem.upper)
            at = self.problem.evaluate(z)
            if at is not None:
                wanted = merit + min(0.0, LEAST_DECREASE * float(slope @ (z - self.here.z)))
                if not descend or (self.merit(at) <= wanted and self.merit(at) < merit):
                    return at
            part /= 2
        return None

    def run_round(self, count: int, transform: Any, descend: bool, tick: Callable[[], None]) -> str:
        """Up to `count` steps of one transformation. Returns "stationary", "stalled" or "steps"."""
        update, state = jax.jit(transform.update), transform.init(as_array(self.here.z))
        last = np.inf
        slow = 0
        for _ in range(count):
            slope = self.slope(self.here)
            if np.linalg.norm(slope) <= STATIONARY:
                return "stationary"
            change, state = update(as_array(slope), state, as_array(self.here.z))
            direction = np.asarray(change, float) * (-1.0 if descend else 1.0)
            pinned = ((self.here.z <= self.problem.lower) & (direction < 0)) | (
                (self.here.z >= self.problem.upper) & (direction > 0)
            )
            direction = np.where(pinned, 0.0, direction)
            if descend and not slope @ direction < 0:
                direction = -slope
            at = self._moved(direction, descend, slope)
            if at is None:
                return "stalled"
            self._keep(at)
            tick()
            merit = self.merit(at)
            slow = slow + 1 if abs(last - merit) <= 1e-12 * max(1.0, abs(merit)) else 0
            if descend and slow >= 3:
                return "stationary"
            last = merit
        return "steps"

    def next_multipliers(self) -> None:
        """End a round: new multipliers, and a larger penalty where the violation fell too slowly."""
        at = self.here
        self.multipliers = self._raised(at)
        violation = self.violation(at)
        if violation > max(self.tolerance, 0.25 * self.previous):
            self.penalty = min(10 * self.penalty, HIGHEST)
        self.previous = violation
        self.round += 1

    def run(self, tick: Callable[[], None], save: Callable[["Search"], None]) -> DesignEnding:
        """Search until the conditions of optimality hold or the steps run out."""
        ended, settled = "steps", 0
        while len(self.history) <= self.steps and self.round < ROUNDS:
            left = self.steps + 1 - len(self.history)
            before = self.here.objective
            if self.optimiser is not None:
                ended = self.run_round(min(left, 4 * ROUND), self.optimiser, False, tick)
            else:
                if self.round == 0:
                    self.run_round(min(left, ADAM_STEPS), optax.adam(ADAM_RATE), False, tick)
                    left = self.steps + 1 - len(self.history)
                ended = self.run_round(min(left, ROUND), optax.scale_by_lbfgs(MEMORY), True, tick)
            self.next_multipliers()
            save(self)
            feasible = self.violation(self.here) <= self.tolerance
            still = abs(self.here.objective - before) <= 1e-6 * max(abs(before), 1e-9)
            settled = settled + 1 if feasible and (still or not len(self.multipliers)) and ended != "steps" else 0
            if settled >= (2 if len(self.multipliers) else 1):
                return DesignEnding.CONVERGED if ended == "stationary" else DesignEnding.STALLED
            if not feasible and self.penalty >= HIGHEST:
                break
        if self.best.violation > self.tolerance:
            return DesignEnding.NO_FEASIBLE_POINT
        return DesignEnding.OUT_OF_STEPS if len(self.history) > self.steps else DesignEnding.STALLED


def _unit(gradient: np.ndarray) -> float:
    size = float(np.linalg.norm(gradient))
    return 1.0 / size if size > 0 else 1.0
