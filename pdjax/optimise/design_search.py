"""Design a model or a family by gradient: the parameters that minimise an objective under constraints.

`design` searches with the augmented Lagrangian of `pdjax.optimise.augmented_lagrangian`. The functions are evaluated
one point at a time, outside any compiled program. They may therefore use every function of pdjax, those that run on the
host included: margins, critical loads, equilibria. Their own programs are compiled once.

The search sees the margins on the default grid of the Brillouin zone, or a smooth aggregate of them. At the end,
objective and constraints are judged anew: on a grid that is twice as fine, and without aggregates.
"""

import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from .._internal.checks import written_whole
from .._internal.json_values import plain
from .._internal.progress import Counter
from .._internal.public import public_function
from ..infinite_lattice.brillouin import judging
from .augmented_lagrangian import DesignEnding, Search, Step
from .problem import Problem

TOLERANCE = 1e-6


@dataclass(frozen=True)
class Design:
    """A designed model, the result of `design`.

    Attributes
    ----------
    parameters : tree
        The parameters found, a tree like the start.
    model : AbstractModel
        The model that `build` makes from them.
    family : LatticeFamily or None
        The family, if `build` returns one.
    objective : float
        Objective at the parameters.
    constraints : dict of str to array
        Constraints at the parameters by name. A feasible point has none > 0.
    judged : dict of str to array
        Objective and constraints computed anew, on a grid that is twice as fine and without aggregates (`sharpness`).
    feasible : bool
        Whether no judged constraint exceeds the tolerance.
    binding : list of str
        Names of the constraints that are zero to the tolerance or violated.
    ending : DesignEnding
        How the search ended.
    history : dict of str to array
        "objective", "violation" and "parameters" of every accepted step, of the best start. The violation is relative
        as the tolerance is.
    evaluations : int
        Number of evaluations of all functions together, of all starts.
    notes : list of str
        What a user should know: steps that left the domain of the model, parameters without influence.

    Examples
    --------
    >>> family, law = pd.lattice_family(1, 2), pd.LinearElastic(1.0, 1.0)
    >>> found = pd.design(
    ...     lambda g: pd.SethHill(1.0, law, pd.SillingControl(g)), 0.5, lambda model: model.control.g,
    ...     lambda model: pd.worst_margin(model, family, pd.load_cases("hydrostatic", [-0.05])), bounds=(0.0, 2.0))
    >>> found.feasible, round(float(found.parameters), 3)
    (True, 0.049)
    """

    parameters: Any
    model: Any
    family: Any
    objective: float
    constraints: dict[str, np.ndarray]
    judged: dict[str, np.ndarray]
    feasible: bool
    binding: list[str]
    ending: DesignEnding
    history: dict[str, np.ndarray] = field(repr=False)
    evaluations: int
    notes: list[str]

    @property
    def reason(self) -> str:
        """Why the search ended, in words."""
        return self.ending.reason

    def __str__(self) -> str:
        state = "feasible" if self.feasible else "not feasible"
        lines = [f"{state}, objective {self.objective:.6g} after {self.evaluations} evaluations: {self.reason}"]
        lines += [f"  parameters {self.parameters}"]
        for name, value in self.constraints.items():
            anew = np.max(self.judged[name])
            lines.append(f"  {name}: {np.max(value):.3g} in the search, {anew:.3g} judged on a finer grid")
        return "\n".join(lines + [f"  {note}" for note in self.notes])

    __repr__ = __str__


@public_function
def design(
    build: Callable,
    start: object,
    objective: Callable,
    constraints: object = None,
    optimiser: object = None,
    steps: int = 200,
    *,
    bounds: object = None,
    starts: int = 1,
    seed: int = 0,
    tolerance: float = TOLERANCE,
    save: str | os.PathLike | None = None,
    show_progress: bool = True,
) -> Design:
    """Search the parameters of a model or a family that minimise an objective under constraints.

    minimise objective(build(θ))   with   constraint(build(θ)) ≤ 0

    Parameters
    ----------
    build : callable
        Parameters → model, or → (model, family). JAX must be able to differentiate it.
    start : tree of float or array
        Parameters at which the search starts, such as a number, an array or a dictionary of these.
    objective : callable
        model → number, or (model, family) → number if `build` returns both.
    constraints : callable, sequence or dict of callables, optional
        Functions with the arguments of `objective` that return a number or an array. A feasible point has no entry > 0.
        The names of a dictionary appear in the result.
    optimiser : optax.GradientTransformation, optional
        Method of the inner search, one that needs gradients only. The default is 10 steps of Adam followed by L-BFGS
        with halved steps.
    steps : int, optional
        Largest number of steps of one start.
    bounds : pair, optional
        (lower, upper), each one number or a tree like `start`. Infinite entries leave a side open.
    starts : int, optional
        Number of starts. All but the first are drawn at random within the bounds, which must then be finite.
    seed : int, optional
        Seed of the random starts.
    tolerance : float, optional
        Largest value of a constraint that counts as 0, relative to the norm of its gradient at the start. The gradient
        is that in parameters divided by the width of their bounds or by their start.
    save : path, optional
        File in which the search keeps its state after every round and at Ctrl-C. If the file exists, the search
        continues from it.
    show_progress : bool, optional
        Show the number of steps on a terminal.

    Returns
    -------
    Design
        The best feasible point. If there is none, the point of the smallest violation, with `feasible` False and the
        violated constraints in `binding`.

    Raises
    ------
    ValueError
        If the start does not lie in the domain of the functions, if the objective does not depend on the parameters, if
        the bounds do not contain the start, if random starts lack bounds, or if the file belongs to another problem.

    Notes
    -----
    A step that leaves the domain (an error or NaN in a function) is halved, and `notes` counts such steps. Ctrl-C ends
    the search with its best point. Where margins of several waves or loads share the maximum, the functions have kinks.
    The search can then stall; a `sharpness` of `worst_margin` makes them smooth.

    References
    ----------
    Nocedal & Wright 2006, chapter 17 (augmented Lagrangian).

    Examples
    --------
    The least penalty that makes a Seth–Hill bar of m = 1 stable at 5 % of compression equals the Green–Lagrange strain,
    (1 − 0.95²)/2 = 0.049.

    >>> family, law = pd.lattice_family(1, 2), pd.LinearElastic(1.0, 1.0)
    >>> cases = pd.load_cases("hydrostatic", [-0.05])
    >>> found = pd.design(
    ...     build=lambda g: pd.SethHill(1.0, law, pd.SillingControl(g)),
    ...     start=0.5, objective=lambda model: model.control.g,
    ...     constraints={"margin": lambda model: pd.worst_margin(model, family, cases)}, bounds=(0.0, 2.0))
    >>> found.feasible, found.binding, round(float(found.parameters), 3)
    (True, ['margin'], 0.049)

    The same with one constraint for each sign of the load, and with smooth bounds of both margins. The bounds lie above
    the margins, and the penalty is therefore a little larger. Only compression binds.

    >>> def smooth(a):
    ...     cases = pd.load_cases("hydrostatic", [a])
    ...     return lambda model: pd.worst_margin(model, family, cases, sharpness=300.0)
    >>> found = pd.design(
    ...     build=lambda g: pd.SethHill(1.0, law, pd.SillingControl(g)), start=0.1,
    ...     objective=lambda model: model.control.g,
    ...     constraints={"compression": smooth(-0.05), "tension": smooth(0.05)}, bounds=(0.0, 1.0))
    >>> found.feasible, found.binding, round(float(found.parameters), 3)
    (True, ['compression'], 0.055)
    """
    if optimiser is not None and not (hasattr(optimiser, "init") and hasattr(optimiser, "update")):
        raise ValueError(f"optimiser must be a method of optax, such as optax.adam(0.01); got {optimiser!r:.80}")
    problem = Problem(build, start, objective, constraints, bounds)
    _check(steps, starts, tolerance, problem)
    rng = np.random.default_rng(seed)
    points = [np.zeros(len(problem.origin))]
    points += [rng.uniform(problem.lower, problem.upper) for _ in range(starts - 1)]
    store = _Store(save, problem)
    best: tuple[Search, DesignEnding] | None = None
    counter = Counter(steps * starts, "design", show_progress)
    for number, z in enumerate(points):
        search = _started(problem, z, steps, optimiser, tolerance, number)
        if search is None:
            continue
        if number == 0:
            _check_dependence(problem, search)
        store.restore(search, number)
        try:
            ending = search.run(counter.tick, partial(store.keep, number))
        except KeyboardInterrupt:
            ending = DesignEnding.INTERRUPTED
            store.keep(number, search)
        if best is None or _rank(search) < _rank(best[0]):
            best = search, ending
        if ending is DesignEnding.INTERRUPTED:
            best = best[0], ending
            break
    counter.end()
    assert best is not None
    return _result(problem, *best)


def _started(
    problem: Problem, z: np.ndarray, steps: int, optimiser: Any, tolerance: float, number: int
) -> Search | None:
    """The search from a start, or None if a random start lies outside the domain."""
    try:
        return Search(problem, z, steps, optimiser, tolerance)
    except ValueError:
        if number == 0:
            raise
        return None


def _rank(search: Search) -> tuple[float, float]:
    best = search.best
    return (0.0, best.objective) if best.violation <= search.tolerance else (best.violation, best.objective)


def _check(steps: int, starts: int, tolerance: float, problem: Problem) -> None:
    for name, value in (("steps", steps), ("starts", starts)):
        if not (isinstance(value, int | np.integer) and value >= 1):
            raise ValueError(f"{name} must be an integer >= 1; got {value!r}")
    if not (np.isfinite(tolerance) and tolerance > 0):
        raise ValueError(f"tolerance must be finite and > 0; got {tolerance}")
    if starts > 1 and not np.isfinite([problem.lower, problem.upper]).all():
        raise ValueError("random starts need finite bounds for every parameter; pass bounds=(lower, upper) or starts=1")


def _check_dependence(problem: Problem, search: Search) -> None:
    """Raise ValueError if the objective has no derivative and no other value in the neighbourhood of the start."""
    here = search.here
    if np.any(here.gradient(1.0, np.zeros(len(here.constraints)))):
        return
    z = np.clip(here.z + 0.05 * np.random.default_rng(1).standard_normal(len(here.z)), problem.lower, problem.upper)
    away = problem.evaluate(z)
    if away is not None and away.objective == here.objective:
        raise ValueError(
            f"objective does not depend on the parameters: it is {here.objective:g} at the start and at a point near"
            " by, and its derivatives are zero. Check that build uses the parameters and that no value becomes a Python"
            " number on the way"
        )


def _without_influence(problem: Problem, search: Search) -> list[str]:
    """Names of the parameters on which nothing depends, neither at the start nor at the last point."""
    if len(search.history) == 1:
        return []  # The search has not moved: a stationary start looks the same as an idle parameter.
    slopes = np.transpose([*search.slopes, *search.here.slopes])
    return [name for name, column in zip(problem.names, slopes, strict=True) if not column.any()]


def _result(problem: Problem, search: Search, ending: DesignEnding) -> Design:
    best = search.best
    parameters = problem.parameters(best.z)
    made = problem.built(parameters)
    names = ["objective", *problem.constraint_names]
    values = dict(zip(names, problem.values(best.z), strict=True))
    with judging():
        judged = dict(zip(names, problem.values(best.z), strict=True))
    del values["objective"]
    parts = np.split(search.scales, np.cumsum([v.size for v in values.values()])[:-1]) if values else []
    units = {n: part.reshape(v.shape) for (n, v), part in zip(values.items(), parts, strict=True)}
    excess = {n: float(np.max(units[n] * judged[n])) for n in values}
    binding = [n for n, v in values.items() if max(excess[n], float(np.max(units[n] * v))) > -search.tolerance]
    feasible = all(x <= search.tolerance for x in excess.values())
    notes = []
    if problem.outside:
        notes.append(
            f"{problem.outside} steps left the domain of the functions and were halved; the last one because"
            f" {problem.last_error}"
        )
    idle = _without_influence(problem, search)
    if idle:
        notes.append(f"neither the objective nor a constraint depends on {', '.join(idle)}")
    if best.violation <= search.tolerance and not feasible:
        worst = max(excess, key=lambda n: excess[n])
        notes.append(f"judged anew, {worst} is {np.max(judged[worst]):.3g}: the search missed a wave")
    history = {
        "objective": np.array([s.objective for s in search.history]),
        "violation": np.array([s.violation for s in search.history]),
        "parameters": problem.origin + problem.size * np.array([s.z for s in search.history]),
    }
    family = made[1] if len(made) > 1 else None
    return Design(
        parameters, made[0], family, best.objective, values, judged, feasible, binding, ending, history,
        problem.evaluations, notes,
    )  # fmt: skip


class _Store:
    """The file in which a search keeps its state."""

    def __init__(self, path: str | os.PathLike | None, problem: Problem):
        self.path = None if path is None else Path(path)
        self.key = {
            "start": problem.origin.tolist(),
            "size": problem.size.tolist(),
            "lower": [str(x) for x in problem.lower],
            "upper": [str(x) for x in problem.upper],
            "names": problem.names,
            "constraints": problem.constraint_names,
        }
        self.known: dict[str, Any] = {}
        if self.path is not None and self.path.exists():
            try:
                stored = json.loads(self.path.read_text(encoding="utf-8"))
                key, self.known = stored["problem"], stored["searches"]
            except (ValueError, KeyError, TypeError) as error:
                raise ValueError(f"{path} is not a file that design wrote, or is damaged: {error}") from None
            if key != self.key:
                raise ValueError(f"{path} belongs to another problem; delete it or name another file")

    def keep(self, number: int, search: Search) -> None:
        """Write the state of a search."""
        if self.path is None:
            return
        self.known[str(number)] = {
            "z": search.here.z.tolist(),
            "multipliers": search.multipliers.tolist(),
            "penalty": search.penalty,
            "previous": search.previous,
            "round": search.round,
            "history": [[s.z.tolist(), s.objective, s.violation] for s in search.history],
        }
        text = json.dumps(plain({"problem": self.key, "searches": self.known}), indent=1)
        with written_whole(self.path) as stream:
            stream.write(text.encode())

    def restore(self, search: Search, number: int) -> None:
        """Bring a search to its stored state, if there is one."""
        state = self.known.get(str(number))
        if state is None:
            return
        at = search.problem.evaluate(np.array(state["z"]))
        if at is None:
            return
        last = state["history"][-1]
        if not np.allclose([at.objective, search.violation(at)], last[1:], rtol=1e-6, atol=1e-9 * abs(last[1])):
            raise ValueError(
                f"{self.path} belongs to another problem: its last point has the objective {last[1]:.6g}, and this"
                f" problem gives {at.objective:.6g} there; delete it or name another file"
            )
        search.here = at
        search.multipliers, search.penalty = np.array(state["multipliers"]), float(state["penalty"])
        search.previous, search.round = float(state["previous"]), int(state["round"])
        search.history = [Step(np.array(z), f, v) for z, f, v in state["history"]]
