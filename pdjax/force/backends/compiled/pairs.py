"""What a pair of points contributes to the sums of both: programs of scalars, and their derivatives.

A program maps (here, there, ξ, ω, ω of the reverse bond, numbers) to (near, far): the contributions to the sums of the
near end and of the far end. `here` and `there` are numbers of the two points, `numbers` are shared by all points.

    tangent      d(near, far) for changes of some of the points' and shared numbers
    transposed   for a program linear in some of its inputs: the contributions to the gradient of Σ w·sum in these
                 inputs, where w are further numbers of the points

A pair seen from its other end, (there, here, −ξ, …), must give (far, near). Both derivatives keep this property.
"""

import functools
import itertools
import re
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from .emit import NotVectorised, unserved

Scalars = list[Any]


def _literals(jaxpr: core.Jaxpr) -> list[str]:
    """All literals and the constants of inner programs, which the printed program abbreviates."""
    found = []
    for eqn in jaxpr.eqns:
        found += [repr(np.asarray(v.val).tolist()) for v in eqn.invars if isinstance(v, core.Literal)]
        for inner in eqn.params.values():
            if isinstance(inner, core.ClosedJaxpr):
                found += [repr(np.asarray(c).tolist()) for c in inner.consts] + _literals(inner.jaxpr)
            elif isinstance(inner, core.Jaxpr):
                found += _literals(inner)
    return found


class PairProgram:
    """A traced program. Two programs are equal if they compute the same.

    Attributes
    ----------
    jaxpr : ClosedJaxpr
        The scalar program.
    rows : int
        Count of the numbers of one point.
    numbers : tuple of int
        Lengths of the vectors of shared numbers.
    dim, outs : int
        Dimension, and count of the sums of one point.
    """

    def __init__(self, function: Callable, rows: int, numbers: Sequence[int], dim: int):
        """Trace function(here, there, xi, omega, back, numbers) -> (near, far), all of them lists of scalars."""
        self.rows, self.numbers, self.dim = rows, tuple(numbers), dim
        sizes = (rows, rows, dim, 1, 1, *numbers)

        def flat(*given):
            here, there, xi, (omega,), (back,), *shared = _cut(given, sizes)
            near, far = function(here, there, xi, omega, back, shared)
            return [*near, *far]

        one = jax.ShapeDtypeStruct((), np.dtype(np.float64))
        self.jaxpr = jax.make_jaxpr(flat)(*[one] * sum(sizes))
        self.outs = len(self.jaxpr.jaxpr.outvars) // 2
        if any(isinstance(c, jax.core.Tracer) for c in self.jaxpr.consts):
            raise NotVectorised("a traced value that is no field of it")
        consts = [repr(np.asarray(c).tolist()) for c in self.jaxpr.consts]
        printed = re.sub(r" at 0x[0-9a-f]+", "", str(self.jaxpr.jaxpr))  # addresses of functions
        self._key = (printed, *consts, *_literals(self.jaxpr.jaxpr), rows, self.numbers, dim)

    @functools.cached_property
    def unserved(self) -> str | None:
        """An operation of the program that has no vector instruction, or None."""
        return unserved(self.jaxpr)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, PairProgram) and self._key == other._key

    def __repr__(self) -> str:
        return f"PairProgram({self.rows} rows, {self.numbers} numbers, {self.outs} sums)"

    def __call__(self, here: Scalars, there: Scalars, xi: Scalars, omega, back, numbers: list[Scalars]):
        flat = core.jaxpr_as_fun(self.jaxpr)(*here, *there, *xi, omega, back, *(x for v in numbers for x in v))
        return flat[: self.outs], flat[self.outs :]


def _cut(given: Sequence, sizes: Sequence[int]) -> list[Scalars]:
    """A flat list as lists of these lengths."""
    return [list(given[a:b]) for a, b in itertools.pairwise(np.cumsum([0, *sizes]))]


def _merged(count: int, places: Sequence[int], some: Sequence, rest: Sequence) -> list:
    """A list of `count` entries with those of `some` at these places, and those of `rest` in order at the others."""
    chosen, others = iter(some), iter(rest)
    return [next(chosen) if k in places else next(others) for k in range(count)]


def _others(values: Sequence, places: Sequence[int]) -> list:
    """The entries that are not at these places."""
    return [x for k, x in enumerate(values) if k not in places]


def tangent(program: PairProgram, rows: tuple[int, ...], numbers: tuple[int, ...]) -> PairProgram:
    """The change of the contributions when these rows and vectors of shared numbers change.

    The new program has the same inputs, followed by the changes of these rows and of these vectors.
    """
    count, vectors = program.rows, len(program.numbers)

    def function(here, there, xi, omega, back, shared):
        ends, at = (here[:count], there[:count]), shared[:vectors]

        def of(mine, theirs, some):
            near, far = (
                _merged(count, rows, x, _others(end, rows)) for x, end in zip((mine, theirs), ends, strict=True)
            )
            return program(near, far, xi, omega, back, _merged(vectors, numbers, some, _others(at, numbers)))

        where = *([end[k] for k in rows] for end in ends), [at[k] for k in numbers]
        return jax.jvp(of, where, (here[count:], there[count:], shared[vectors:]))[1]

    lengths = (*program.numbers, *(program.numbers[k] for k in numbers))
    return PairProgram(function, count + len(rows), lengths, program.dim)


def transposed(program: PairProgram, rows: tuple[int, ...], numbers: tuple[int, ...]) -> PairProgram:
    """The gradient of Σ w·sum in these rows and vectors of shared numbers, in which the program is linear.

    The new program has the other inputs, and the rows w behind the other rows. Its sums are first one for each of
    `rows`, then one for each entry of each of `numbers`. Each end of a pair gets half of the latter.
    """
    count, fixed, vectors = program.rows, program.rows - len(rows), len(program.numbers)

    def function(here, there, xi, omega, back, shared):
        def of(mine, theirs, some):
            near, far = (_merged(count, rows, x, end[:fixed]) for x, end in ((mine, here), (theirs, there)))
            return program(near, far, xi, omega, back, _merged(vectors, numbers, some, shared))

        zero = np.zeros(())
        like = [zero] * len(rows), [zero] * len(rows), [[zero] * program.numbers[k] for k in numbers]
        mine, theirs, some = jax.linear_transpose(of, *like)((here[fixed:], there[fixed:]))
        # Where no point is, w is 0, and the model may divide by a sum that is 0. Without this 0 · ∞ would be NaN.
        used = functools.reduce(jax.numpy.logical_or, [w != 0 for w in (*here[fixed:], *there[fixed:])])
        halves = [jax.lax.select(used, 0.5 * x, zero) for v in some for x in v]
        return [*mine, *halves], [*theirs, *halves]

    return PairProgram(function, fixed + program.outs, _others(program.numbers, numbers), program.dim)
