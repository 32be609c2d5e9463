"""Pareto fronts: how much of one objective a design has to give up for another.

A point is on the Pareto front if no other point is better in one objective and not worse in the other. `pareto_front`
minimises the second objective alone and the first one alone, and then the first one under a bound on the second, for
bounds between the two extremes (the ε-constraint method). Every search starts from its neighbour on the front.

Source: Haimes, Lasdon & Wismer 1971 (the method).
"""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.public import public_function
from ..infinite_lattice.brillouin import judging
from .design_search import Design, design
from .parameters import Parameters
from .problem import named


@dataclass(frozen=True)
class ParetoFront:
    """Designs that trade one objective for another, the result of `pareto_front`.

    Attributes
    ----------
    names : tuple of str
        Names of the two objectives.
    values : array, shape (points, 2)
        Both objectives of every design on the front, by increasing second objective. They are judged on the finer grid.
    designs : list of Design
        The designs, with their parameters and models.

    Examples
    --------
    >>> front = pd.pareto_front(
    ...     lambda x: x, 0.5, {"a": lambda x: x**2, "b": lambda x: (x - 1) ** 2}, points=3, bounds=(-1.0, 2.0))
    >>> front.values.round(2).tolist()
    [[1.0, 0.0], [0.09, 0.5], [0.0, 1.0]]
    """

    names: tuple[str, str]
    values: np.ndarray
    designs: list[Design]

    def __repr__(self) -> str:
        return f"ParetoFront({len(self.designs)} designs of {self.names[0]} against {self.names[1]})"


@public_function
def pareto_front(
    build: Callable,
    start: object,
    objectives: Sequence[Callable] | dict[str, Callable],
    points: int = 12,
    *,
    constraints: object = None,
    **options: Any,
) -> ParetoFront:
    """Trace the Pareto front of two objectives.

    Parameters
    ----------
    build : callable
        Parameters → model, or → (model, family), as for `design`.
    start : tree of float or array
        Parameters at which the first search starts.
    objectives : two callables, or a dict of two
        The objectives to minimise, with the arguments that `design` gives to its objective.
    points : int, optional
        Number of designs, at least 2. Designs that another one dominates are left out of the result.
    constraints : callable, sequence or dict of callables, optional
        Further constraints, as for `design`.
    **options
        Options of `design` other than `save`, such as `bounds`, `steps` or `optimiser`.

    Returns
    -------
    ParetoFront
        The front as data. `pdjax.figures.pareto_front` draws it.

    Raises
    ------
    ValueError
        If there are not two objectives, if `points` is less than 2, or for what `design` refuses.

    Examples
    --------
    >>> front = pd.pareto_front(
    ...     lambda x: x, 0.5, {"a": lambda x: x**2, "b": lambda x: (x - 1) ** 2}, points=3, bounds=(-1.0, 2.0))
    >>> front.names, front.values[0].round(3).tolist()
    (('a', 'b'), [1.0, 0.0])
    """
    table = named(objectives)
    if len(table) != 2:
        raise ValueError(f"pareto_front needs two objectives; got {len(table)}")
    if not (isinstance(points, int) and points >= 2):
        raise ValueError(f"points must be an integer >= 2; got {points!r}")
    (first_name, first), (second_name, second) = table.items()
    further = named(constraints)
    bounds = options.get("bounds")

    def run(begin: Any, objective: Callable, limits: dict[str, Callable]) -> Design:
        inside = begin if bounds is None else _within(begin, bounds)
        return design(build, inside, objective, further | limits, **options)

    if "save" in options:
        raise ValueError("save is an option of design, not of pareto_front, which runs several searches")

    def value(found: Design, function: Callable, judge: bool = False) -> float:
        made = (found.model,) if found.family is None else (found.model, found.family)
        with judging() if judge else nullcontext():
            return float(function(*made))

    low = run(start, second, {})
    high = run(low.parameters, first, {})
    bottom, top = value(low, second), value(high, second)
    designs, begin = [low], low.parameters
    for limit in np.linspace(bottom, top, points)[1:-1]:
        bound = {f"{second_name} ≤ {limit:.6g}": lambda *made, limit=limit: second(*made) - limit}
        found = run(begin, first, bound)
        designs.append(found)
        if found.feasible:
            begin = found.parameters
    designs.append(high)
    return _front(designs, (first_name, second_name), lambda d: (value(d, first, True), value(d, second, True)))


def _within(parameters: Any, bounds: Any) -> Any:
    """The parameters clipped to the bounds, which rounding may have left."""
    tree = Parameters(parameters)
    lower, upper = (tree.flat_of("a bound", side, np.nan) for side in bounds)
    return tree.tree(np.fmin(np.fmax(tree.flat, lower), upper))


def _front(designs: list[Design], names: tuple[str, str], values: Callable) -> ParetoFront:
    """The feasible designs that no other one dominates, by increasing second objective."""
    found = [(values(d), d) for d in designs if d.feasible]
    kept: list[tuple[tuple[float, float], Design]] = []
    for (a, b), d in found:
        dominated = any((x <= a and y <= b) and (x < a or y < b) for (x, y), _ in found)
        if not dominated and not any(np.allclose((a, b), v, rtol=1e-9, atol=1e-12) for v, _ in kept):
            kept.append(((a, b), d))
    kept.sort(key=lambda pair: pair[0][1])
    return ParetoFront(names, np.array([v for v, _ in kept]).reshape(-1, 2), [d for _, d in kept])
