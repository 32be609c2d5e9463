"""The forces of a model made of moments on a whole body, by sums over pairs.

    first sum     A_i = state(Σ_b moments(bond b))
    second sum    f_i = Σ_b V_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)]

The rows of a point are, in this order: u, the entries of A in the second sum, the constants of the model that vary, V
unless all points share it, and δ unless all points share it. The vectors of shared numbers are the constants of the
model, V and δ as far as they are shared, and F − I of a mean deformation.
"""

import itertools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.tree_util import PyTreeDef
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from ...._internal.memory import value_key
from ....geometry.bonds import Bonds
from ....models.base import AbstractModel, Sums
from ....models.pointwise import split_model
from ..components import by_components, entries, one_entry, trees
from ..point_states import Varying, sizes_of_moments, states, with_rest
from .layouts import Layout
from .pair_sum import pair_sum
from .pairs import PairProgram, Scalars

Made = TypeVar("Made")
MOST = 512  # programs that are kept
_PROGRAMS: dict[Hashable, Any] = {}  # traced programs by the structure of model and body


def _vector(values: list[Array], dtype: DTypeLike) -> Array:
    """Numbers in one vector."""
    return jnp.concatenate([jnp.zeros(0, dtype), *(jnp.ravel(x).astype(dtype) for x in values)])


def _parts(flat: list, shapes: list[tuple[int, ...]]) -> list[np.ndarray]:
    """A flat list of scalars as components of these shapes."""
    ends = np.cumsum([0, *(int(np.prod(s)) for s in shapes)])
    return [trees(None, [s], flat[a:b]) for s, (a, b) in zip(shapes, itertools.pairwise(ends), strict=True)]


class ModelPairs:
    """One model on one body of a layout.

    `horizon` is one number or one for each point (flat,). `gradient` is F − I of a mean deformation, or None.
    """

    def __init__(self, model: AbstractModel, points: int, layout: Layout, horizon: Array, gradient: Array | None):
        self.layout, self.horizon = layout, horizon
        self.dim, self.dtype = layout.dim, layout.volumes.dtype
        varying, shared = split_model(model, points)
        self.varying = Varying((varying, shared), layout)
        self.single = self.varying.single()
        floats, self.rest = eqx.partition(shared, eqx.is_inexact_array)
        constants, self.structure = jax.tree.flatten(floats)
        self.shapes = [jnp.shape(x) for x in constants]
        body = [*([layout.volume] if layout.volume is not None else []), *([] if horizon.ndim else [horizon])]
        numbers = [constants, body, *([] if gradient is None else [[gradient]])]
        self.numbers = [_vector(x, self.dtype) for x in numbers]
        self.constants = [row for constant in self.varying.rows for row in constant]
        self.rows = [*self.constants, *([layout.volumes] if layout.volume is None else [])]
        self.horizons = [horizon] if horizon.ndim else []  # a row, if it varies
        self.rows += self.horizons
        # Whether a bond is the same seen from its other end, and whether sums of the two ends differ in sign at most.
        self.alike = layout.symmetric and horizon.ndim == 0 and not self.varying
        self.mirrored = self.alike and layout.volume is not None
        rest = value_key(self.rest)
        kind = layout.symmetric, layout.volume is None, horizon.ndim, len(self.numbers), self.dim, self.dtype.name
        own = self.varying.structure, tuple(self.varying.shapes)
        self.key = rest and (rest, self.structure, tuple(self.shapes), own, kind)

    def _model(self, constants: list, leaves: list) -> Any:
        """The model of a point from the constants of all points and its own."""
        shared = eqx.combine(jax.tree.unflatten(self.structure, constants), self.rest)
        return eqx.combine(jax.tree.unflatten(self.varying.structure, leaves), shared)

    def _constants(self, shared: Scalars, own: Scalars) -> tuple[list, list]:
        """The constants of the model as components, for `_model`."""
        return _parts(shared, self.shapes), _parts(own, self.varying.shapes)

    def _ends(self, near: Scalars, far: Scalars, xi: Scalars, omega, back, shared: list[Scalars]) -> list[tuple]:
        """The constants of the model and the bond, seen from the near and from the far end."""
        dim, body = self.dim, shared[1]
        eta = [b - a for a, b in zip(near[:dim], far[:dim], strict=True)]
        if len(shared) == 3:
            eta = [e + sum(shared[2][k * dim + l] * xi[l] for l in range(dim)) for k, e in enumerate(eta)]
        ends, count = [], len(self.constants)
        turned = [-x for x in xi], [-x for x in eta]
        for here, there, vectors, w in ((near, far, (xi, eta), omega), (far, near, turned, back)):
            own, other = (x[len(x) - len(self.rows) :] for x in (here, there))
            volume = other[count] if self.layout.volume is None else body[0]
            horizon = own[-1] if self.horizon.ndim else body[-1]
            bond = Bonds(*(trees(None, [(dim,)], v) for v in vectors), *map(one_entry, (w, volume, horizon)))
            ends.append((self._constants(shared[0], own[:count]), bond))
        return ends

    def _known(self, name: Hashable, make: Callable[[], Made]) -> Made:
        """make(), traced once for all models and bodies that differ only in their numbers."""
        if self.key is None:
            return make()
        if (name, self.key) not in _PROGRAMS:
            if len(_PROGRAMS) >= MOST:
                _PROGRAMS.clear()
            _PROGRAMS[name, self.key] = make()
        return _PROGRAMS[name, self.key]

    def _program(self, function: Callable, rows: int) -> PairProgram:
        """Trace function(near, far, xi, omega, back, shared) with this count of rows."""
        return PairProgram(function, rows, [len(x) for x in self.numbers], self.dim)

    def _sum(self, program: PairProgram, rows: list[Array]) -> list[Array]:
        return pair_sum(program, self.layout.kind, self.layout.geometry, [*rows, *self.rows], self.numbers)

    def moment_program(self, which: int) -> PairProgram:
        """The reference moments (`which` = 0) or the deformed moments (1)."""

        def of(constants, bond):
            return self._model(*constants).moments(bond)[which]

        def function(*pair):
            near, far = self._ends(*pair)
            mine = entries(by_components(of, self.dtype)(*near))
            if self.single.even and self.mirrored:
                return mine, mine
            return mine, entries(by_components(of, self.dtype)(*far))

        return self._known(which, lambda: self._program(function, self.dim + len(self.rows)))

    def _sums(self) -> tuple[int, Callable[[Scalars], tuple]]:
        """The number of scalars in both sums of a point, and a function that makes both sums from a list of them."""
        kinds = [sizes_of_moments(self.single, k, self.dim, self.dtype) for k in (0, 1)]
        a, b = (sum(int(np.prod(s)) for s in shapes) for _, shapes in kinds)
        return a + b, lambda x: (trees(*kinds[0], x[:a]), trees(*kinds[1], x[a : a + b]))

    def _of_sums(self, method: str) -> tuple[PairProgram, PyTreeDef, list[tuple[int, ...]]]:
        """A method of the model that takes the sums, as a program of one point; structure and shapes of its result."""
        count, sums_of = self._sums()
        found: list = []

        def of(constants, reference, deformed, horizon):
            return getattr(self._model(*constants), method)(Sums(reference, deformed, horizon, self.dim))

        def function(here, there, xi, omega, back, shared):
            constants = self._constants(shared[0], here[count : count + len(self.constants)])
            horizon = one_entry(here[-1] if self.horizons else shared[1][-1])
            result = by_components(of, self.dtype)(constants, *sums_of(here), horizon)
            found[:] = jax.tree.structure(result), [x.shape for x in jax.tree.leaves(result)]
            mine = [jnp.asarray(x, self.dtype) for x in entries(result)]
            return mine, [jnp.zeros((), self.dtype)] * len(mine)

        rows = count + len(self.constants) + len(self.horizons)
        return self._known(method, lambda: (self._program(function, rows), *found))

    def _at_points(self, program: PairProgram, reference: list[Array], deformed: list[Array]) -> list[Array]:
        """The results of a program of `_of_sums`, one row for each entry."""
        rows = [*reference, *deformed, *self.constants, *self.horizons]
        return pair_sum(program, "points", (self.layout.each,), rows, self.numbers) if program.outs else []

    def force_program(self, structure: PyTreeDef, shapes: list[tuple[int, ...]]) -> PairProgram:
        """V_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)] for both ends, with states A of this structure and shapes."""
        dim, count = self.dim, sum(int(np.prod(s)) for s in shapes)

        def of(constants, here, there, bond):
            return self._model(*constants).bond_force(here, there, bond)

        pull = by_components(of, self.dtype)

        def function(near, far, *pair):
            (mine, bond), (yours, reverse) = self._ends(near, far, *pair)
            a, b = (x[dim : dim + count] for x in (near, far))
            if self.single.additive and self.alike:
                both = trees(structure, shapes, [x + y for x, y in zip(a, b, strict=True)])
                t = [x if count else 2 * x for x in pull(mine, both, both, bond)]
            else:
                here, there = (trees(structure, shapes, x) for x in (a, b))
                out, back = pull(mine, here, there, bond), pull(yours, there, here, reverse)
                t = [x - y for x, y in zip(out, back, strict=True)]
            force = [bond.volume[()] * x for x in t]
            opposite = [-x for x in force] if self.layout.volume is not None else [-reverse.volume[()] * x for x in t]
            return force, opposite

        name = structure, tuple(shapes)
        return self._known(name, lambda: self._program(function, dim + count + len(self.rows)))

    def unserved(self) -> str | None:
        """An operation of the moments or of the bond force that has no vector instruction, or None."""
        _, structure, shapes = self._of_sums("state")
        programs = self.moment_program(0), self.moment_program(1), self.force_program(structure, shapes)
        return next(filter(None, (program.unserved for program in programs)), None)

    def moments(self, which: int, u: list[Array]) -> list[Array]:
        """The sums of the reference moments (`which` = 0) or the deformed moments (1) over every family."""
        program = self.moment_program(which)
        return self._sum(program, u) if program.outs else []

    def reference(self) -> list[Array]:
        """The sums of the reference moments. Points without bonds have those of some family, so that no model divides
        by 0 or inverts a singular tensor."""
        sums = self.moments(0, [jnp.zeros_like(self.layout.volumes)] * self.dim)
        if not sums:
            return []
        stacked = jnp.stack(sums)
        return list(with_rest(self.single, stacked, *self.layout.rest(stacked, self.horizon)))

    def states(self, reference: list[Array], deformed: list[Array]) -> tuple:
        """The point states from both sums: structure, shapes, and one row for each entry."""
        program, structure, shapes = self._of_sums("state")
        if program.unserved:  # XLA has all operations, but needs longer to compile and to compute
            empty = jnp.zeros((0, self.layout.volumes.shape[0]), self.dtype)
            sums = tuple(jnp.stack(x) if x else empty for x in (reference, deformed))
            own = self.varying.components()
            return states(self.single, self.varying.model, own, self.dim, self.dtype, sums, self.horizon)
        return structure, shapes, self._at_points(program, reference, deformed)

    def bond_energy_program(self) -> PairProgram:
        """The part of W that belongs to a bond, from the sums of its end, which come behind u."""
        count, sums_of = self._sums()

        def of(constants, reference, deformed, bond):
            sums = Sums(reference, deformed, bond.horizon, self.dim)
            return self._model(*constants).energy_of_bond(sums, bond)

        def function(near, far, *pair):
            out = []
            for end, (constants, bond) in zip((near, far), self._ends(near, far, *pair), strict=True):
                sums = sums_of(end[self.dim :])
                out.append(entries(by_components(of, self.dtype)(constants, *sums, bond)))
            return tuple(out)

        return self._known("bond energy", lambda: self._program(function, self.dim + count + len(self.rows)))

    def energies(self, reference: list[Array], u: Float[Array, "points dim"]) -> Float[Array, " points"] | None:
        """W of every point, or None if the model defines no `energy_of_sums` and no `energy_of_bond`."""
        of_sums, of_bond = self._of_sums("energy_of_sums")[0], self.bond_energy_program()
        if not (of_sums.outs or of_bond.outs) or of_sums.unserved or of_bond.unserved:
            return None
        U = list(self.layout.embed(u.astype(self.dtype)))
        deformed, found = self.moments(1, U), []
        if of_sums.outs:
            found += self._at_points(of_sums, reference, deformed)
        if of_bond.outs:
            found += self._sum(of_bond, [*U, *reference, *deformed])
        return jnp.sum(self.layout.collect(found), axis=1)

    def force(self, reference: list[Array], u: Float[Array, "points dim"]) -> Float[Array, "points dim"]:
        """f of every point."""
        U = list(self.layout.embed(u.astype(self.dtype)))
        structure, shapes, rows = self.states(reference, self.moments(1, U))
        program = self.force_program(structure, shapes)
        return self.layout.collect(self._sum(program, [*U, *self.layout.renew(rows)]))
