"""The pair programs of a model made of moments, and its forces by two sums over pairs.

    first sum     A_i = state(Σ_b moments(bond b))
    second sum    f_i = Σ_b V_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)]

The rows of a point are, in this order: u, the entries of A in the second sum, the constants of the model that vary, V
in a cloud, and the horizon if it varies. The vectors of shared numbers are the constants of the model, (V, δ) as far as
they are shared, and F − I of a mean deformation.
"""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from ...geometry.bonds import Bonds
from ...models.base import AbstractModel, Sums
from ...models.pointwise import split_model
from ..backends.components import by_components, entries, one_entry, trees
from ..backends.point_states import Varying, bonds_of_rest, sizes_of_moments, states, with_rest
from .emit import unserved
from .layouts import CloudBonds, LatticePairs
from .pair_sum import pair_sum
from .pairs import PairProgram, Scalars


def _vector(values: list[Array], dtype: DTypeLike) -> Array:
    """Numbers in one vector."""
    return jnp.concatenate([jnp.zeros(0, dtype), *(jnp.ravel(x).astype(dtype) for x in values)])


class ModelPairs:
    """The sums over pairs of one model on one body.

    `horizon` is one number or one for each point (flat,). `gradient` is F − I of a mean deformation, or None.
    """

    def __init__(
        self,
        model: AbstractModel,
        points: int,
        layout: LatticePairs | CloudBonds,
        horizon: Array,
        gradient: Array | None,
    ):
        self.layout, self.dtype = layout, layout.volumes.dtype
        self.dim = layout.xi.shape[1 if layout.kind == "lattice" else 0]
        varying, shared = split_model(model, points)
        self.varying = Varying((varying, shared), layout)
        self.single = self.varying.single()
        floats, self.rest = eqx.partition(shared, eqx.is_inexact_array)
        constants, self.structure = jax.tree.flatten(floats)
        self.shapes = [jnp.shape(x) for x in constants]
        self.horizon = horizon
        body = [layout.traversal.cell] if isinstance(layout, LatticePairs) else []
        body += [horizon] if horizon.ndim == 0 else []
        mean = [] if gradient is None else [gradient]
        self.numbers = [
            _vector(constants, self.dtype),
            _vector(body, self.dtype),
            *(_vector([x], self.dtype) for x in mean),
        ]
        self.rows = [row for constant in self.varying.rows for row in constant]
        self.rows += [layout.volumes] if isinstance(layout, CloudBonds) else []
        self.rows += [horizon] if horizon.ndim else []
        self.alike = layout.symmetric and horizon.ndim == 0 and not self.varying

    def _model(self, constants: list, leaves: list) -> Any:
        """The model of a point from its own constants and those of all points."""
        shared = eqx.combine(jax.tree.unflatten(self.structure, constants), self.rest)
        return eqx.combine(jax.tree.unflatten(self.varying.structure, leaves), shared)

    def _constants(self, shared: list, own: list) -> tuple[list, list]:
        """The constants of the model as components: those of all points, and those of one point."""
        common = [trees(None, [s], x) for s, x in zip(self.shapes, _parts(shared, self.shapes), strict=True)]
        shapes = self.varying.shapes
        return common, [trees(None, [s], x) for s, x in zip(shapes, _parts(own, shapes), strict=True)]

    def _ends(self, near: Scalars, far: Scalars, xi: Scalars, omega, back, shared: list[Scalars]) -> tuple:
        """For both ends: the constants of the model and the bond. `near` and `far` begin with u."""
        dim, body = self.dim, list(shared[1])
        eta = [b - a for a, b in zip(near[:dim], far[:dim], strict=True)]
        if len(shared) == 3:
            eta = [e + sum(shared[2][k * dim + l] * xi[l] for l in range(dim)) for k, e in enumerate(eta)]
        ends = []
        for here, there, turned, w in ((near, far, False, omega), (far, near, True, back)):
            own, other = (x[len(x) - len(self.rows) :] for x in (here, there))
            count = sum(len(x) for x in self.varying.rows)
            volume = other[count] if isinstance(self.layout, CloudBonds) else body[0]
            horizon = own[-1] if self.horizon.ndim else body[-1]
            vectors = (trees(None, [(dim,)], [-x for x in v] if turned else v) for v in (xi, eta))
            ends.append(
                (self._constants(shared[0], own[:count]), Bonds(*vectors, *map(one_entry, (w, volume, horizon))))
            )
        return tuple(ends)

    def _sum(self, function: Callable, rows: list[Array]) -> list[Array]:
        """Σ of function(near, far, xi, omega, back, shared) over all pairs; `rows` come before those of the body."""
        rows, lengths = [*rows, *self.rows], [x.shape[0] for x in self.numbers]
        program = PairProgram(function, len(rows), lengths, self.dim)
        return pair_sum(program, self.layout.kind, self.layout.geometry, rows, self.numbers)

    def moments(self, which: int, u: list[Array]) -> list[Array]:
        """The sums of the reference moments (`which` = 0) or the deformed moments (1) over every family."""
        if not any(np.prod(s, dtype=int) for s in sizes_of_moments(self.single, which, self.dim, self.dtype)[1]):
            return []

        def of(constants, bond):
            return self._model(*constants).moments(bond)[which]

        def function(*pair):
            near, far = self._ends(*pair)
            mine = entries(by_components(of, self.dtype)(*near))
            return mine, mine if self.single.even and self.alike and self.layout.kind == "lattice" else entries(
                by_components(of, self.dtype)(*far)
            )

        return self._sum(function, u)

    def reference(self) -> list[Array]:
        """The sums of the reference moments. Points without bonds have those of some family, so that no model divides
        by 0 or inverts a singular tensor."""
        layout = self.layout
        sums = self.moments(0, list(jnp.zeros((self.dim, layout.volumes.shape[0]), self.dtype)))
        if not sums:
            return []
        if isinstance(layout, CloudBonds):
            rest, empty = bonds_of_rest(self.dim, self.horizon, self.dtype), jnp.all(jnp.stack(sums) == 0, axis=0)
        else:
            t, empty = layout.traversal, layout.filled <= 0
            rest = Bonds(t.xi, jnp.zeros_like(t.xi), t.omega, jnp.full(len(t.xi), t.cell), self.horizon)
        return list(with_rest(self.single, jnp.stack(sums), empty, rest))

    def states(self, reference: list[Array], deformed: list[Array]) -> tuple:
        """The point states from both sums: structure, shapes, and one row for each entry."""
        dim, layout = self.dim, self.layout
        kinds = [sizes_of_moments(self.single, k, dim, self.dtype) for k in (0, 1)]
        constants = [row for x in self.varying.rows for row in x]
        own = [*reference, *deformed, *constants, *([self.horizon] if self.horizon.ndim else [])]
        a, b = len(reference), len(reference) + len(deformed)
        kind: list = []

        def of(model, reference, deformed, horizon):
            return self._model(*model).state(Sums(reference, deformed, horizon, dim))

        def function(here, there, xi, omega, back, shared):
            model = self._constants(shared[0], here[b : b + len(constants)])
            horizon = one_entry(here[-1] if self.horizon.ndim else shared[1][-1])
            sums = (trees(*k, x) for k, x in zip(kinds, (here[:a], here[a:b]), strict=True))
            state = by_components(of, self.dtype)(model, *sums, horizon)
            kind[:] = jax.tree.structure(state), [x.shape for x in jax.tree.leaves(state)]
            found = [jnp.asarray(x, self.dtype) for x in entries(state)]
            return found, [jnp.zeros((), self.dtype)] * len(found)

        program = PairProgram(function, len(own), [x.shape[0] for x in self.numbers], dim)
        if unserved(program.jaxpr):  # XLA has all operations, but needs longer to compile and to compute
            empty = jnp.zeros((0, layout.volumes.shape[0]), self.dtype)
            sums = tuple(jnp.stack(x) if x else empty for x in (reference, deformed))
            own = self.varying.components()
            return states(self.single, self.varying.model, own, dim, self.dtype, sums, self.horizon)
        return *kind, pair_sum(program, "points", (layout.each,), own, self.numbers) if program.outs else []

    def force(self, reference: list[Array], u: Float[Array, "points dim"]) -> Float[Array, "points dim"]:
        """f of every point."""
        layout, dim = self.layout, self.dim
        U = list(layout.embed(u.astype(self.dtype)))
        deformed = self.moments(1, U)
        structure, shapes, rows = self.states(reference, deformed)
        rows = layout.renew(rows)

        def of(constants, here, there, bond):
            return self._model(*constants).bond_force(here, there, bond)

        pull = by_components(of, self.dtype)

        def function(near, far, *pair):
            ends = self._ends(near, far, *pair)
            (mine, bond), (yours, reverse) = ends
            a, b = (x[dim : dim + len(rows)] for x in (near, far))
            if self.single.additive and self.alike:
                both = trees(structure, shapes, [x + y for x, y in zip(a, b, strict=True)])
                t = [x if shapes else 2 * x for x in pull(mine, both, both, bond)]
            else:
                here, there = (trees(structure, shapes, x) for x in (a, b))
                t = [
                    x - y for x, y in zip(pull(mine, here, there, bond), pull(yours, there, here, reverse), strict=True)
                ]
            out = [bond.volume[()] * x for x in t]
            same = layout.kind == "lattice"
            return out, [-x for x in out] if same else [-reverse.volume[()] * x for x in t]

        return layout.collect(self._sum(function, [*U, *rows]))


def _parts(flat: list, shapes: list[tuple[int, ...]]) -> list[list]:
    """A flat list as one list for each shape."""
    ends = np.cumsum([0, *(int(np.prod(s)) for s in shapes)])
    return [list(flat[a:b]) for a, b in zip(ends[:-1], ends[1:], strict=True)]
