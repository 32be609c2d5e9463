"""The backend "fft": forces on a lattice by convolutions, exact to rounding. The cost does not grow with the horizon.

It applies to models whose moments and bond force are polynomials in η = u_j − u_i (`degree`) and whose force is linear
in the point state A (`additive`). Moments and forces are then sums over the offsets o of the lattice of terms

    κ(o) · a(i) · b(i + o),     a, b: monomials of u, times an entry of A or 1.

Σ_o κ(o) b(i + o) is a correlation, which is one product in Fourier space.

* The body may have any shape: χ = 1 in cells that hold a point and 0 elsewhere. An axis that is not periodic is padded
  by the reach of the horizon, so that opposite ends do not interact.
* The kernels κ come from automatic differentiation at η = 0. Equal kernels are found once, on the host.
* Terms without a factor a are added up in Fourier space, before the inverse transform.
* Terms that do not depend on u (b = χ) are computed once.

In 3D Silling's correspondence model needs 12 forward and 12 inverse transforms, for every horizon.
"""

import math
from collections.abc import Callable, Hashable, Iterable
from types import ModuleType
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Complex, Float

from ..._internal.checks import computed, is_concrete, namespace, on_device, on_host
from ..._internal.dependence import known_part
from ..._internal.memory import remember
from ..._internal.threads import cores
from ..._internal.xla import ONCE, compiled_with
from ...geometry.bonds import EACH_BOND, Bonds, Families
from ...models.base import AbstractModel, PointStateModel, Sums
from ...models.pointwise import split_model
from .backend import Backend, lattice_refusal
from .compiled import states_of_lattice
from .point_states import state_rows
from .traversal import from_cells, to_cells

Monomial = tuple[int, ...]  # the components of u in a product; −1 − q stands for entry q of the point state


class Term(NamedTuple):
    """The term scale · a(i) Σ_o κ(o) b(i + o) of entry `out`; `here` is a and `there` is b."""

    out: int
    here: Monomial
    kernel: int
    there: Monomial
    scale: float


class Kernels:
    """The distinct rows κ over the offsets. Rows that differ by a factor are stored once."""

    def __init__(self) -> None:
        self.rows: list[np.ndarray] = []
        self.known: dict[bytes, int] = {}

    def number(self, row: np.ndarray) -> tuple[int, float]:
        """The number of a nonzero row, and its factor relative to the stored row."""
        scale = row[np.argmax(np.abs(row) > 0.5 * np.abs(row).max())]
        unit = row / scale
        key = (np.round(unit, 10) + 0.0).tobytes()  # + 0.0 turns −0 into 0
        if key not in self.known:
            self.known[key] = len(self.rows)
            self.rows.append(unit)
        return self.known[key], float(scale)


def _terms(
    kernels: Kernels, out: int, row: np.ndarray, pairs: Iterable[tuple[Monomial, Monomial, float]], floor: float
):
    if np.abs(row).max(initial=0.0) <= floor:
        return []
    number, scale = kernels.number(row)
    return [Term(out, tuple(sorted(a)), number, tuple(sorted(b)), scale * s) for a, b, s in pairs]


def _powers(indices: tuple[int, ...]) -> list[tuple[Monomial, Monomial, float]]:
    """The product Π (u_j − u_i)_a, expanded into terms (monomial at i, monomial at j, sign)."""
    out: list[tuple[Monomial, Monomial, float]] = [((), (), 1.0)]
    for a in indices:
        out = [x for p, q, s in out for x in ((p, (*q, a), s), ((*p, a), q, -s))]
    return out


def _derivatives(function: Callable[[Bonds], Array], degree: int, bonds: Bonds) -> list[Array]:
    """Derivatives of function(bond) with respect to η at 0, of orders 0 to degree: (offsets, entries, dim, …)."""
    out = []
    for _ in range(degree + 1):
        out.append(jax.vmap(function, (EACH_BOND,))(bonds))

        def function(bond, of=function):
            return jax.jacfwd(lambda eta: of(bond._replace(eta=eta)))(bond.eta)

    return out


class Tables(NamedTuple):
    """The contributions of the bonds at every offset, per unit of ω V.

    `reference` holds the reference moments (offsets, entries). `moments` holds the derivatives of the moments with
    respect to η at 0, order by order. `forces` holds those of ∂t/∂A, for each entry of the point state A.
    """

    reference: Array | np.ndarray
    moments: list
    forces: list


def _tables(model: PointStateModel, stencil: tuple[tuple[tuple[int, ...], ...], int, float, float], degree: int):
    """`Tables` of a model on a stencil (offsets, dim, spacing, horizon)."""
    offsets, dim, spacing, horizon = stencil
    xi = jnp.asarray(np.array(offsets, dtype=float).reshape(-1, dim) * spacing)
    ones = jnp.ones(len(xi), xi.dtype)
    bonds = Bonds(xi, jnp.zeros_like(xi), ones, ones, jnp.asarray(horizon, xi.dtype))
    one = jax.tree.map(lambda x: x[0] if x.ndim else x, bonds)
    shaped = jax.eval_shape(lambda b: model.state(Sums(*model.moments(b), b.horizon, dim)), one)
    zero, unravel = ravel_pytree(jax.tree.map(lambda x: jnp.zeros(x.shape, xi.dtype), shaped))

    def force(bond):
        if not zero.size:  # without a point state, both ends of a bond pull with the same t
            return 2 * model.bond_force(unravel(zero), unravel(zero), bond)[:, None]
        return jax.jacfwd(lambda a: model.bond_force(unravel(a), unravel(a), bond))(zero)

    def flat(bond, which):
        return ravel_pytree(model.moments(bond)[which])[0]

    reference = jax.vmap(lambda b: flat(b, 0), (EACH_BOND,))(bonds)
    return Tables(reference, _derivatives(lambda b: flat(b, 1), degree, bonds), _derivatives(force, 1, bonds)), zero


_compiled_tables = compiled_with(ONCE)(_tables)


class Plan(NamedTuple):
    """The correlations to compute and the terms to form from them. It is static."""

    moments: tuple[Term, ...]
    forces: tuple[Term, ...]
    entries: int
    state: int

    @property
    def transforms(self) -> tuple[int, int]:
        """Numbers of forward and inverse transforms in one evaluation."""
        passes = [_fields(terms) for terms in (self.moments, self.forces)]
        return sum(len(theres) for theres, _ in passes), sum(len(set(sums.values())) for _, sums in passes)


def _fields(terms: tuple[Term, ...]) -> tuple[list[Monomial], dict[tuple[int, Monomial], tuple]]:
    """The fields to transform, and for every (entry, factor at i) the products in Fourier space that sum to it."""
    sums: dict[tuple[int, Monomial], list] = {}
    for t in terms:
        if t.there:
            sums.setdefault((t.out, t.here), []).append((t.kernel, t.there, t.scale))
    return list(dict.fromkeys(t.there for t in terms if t.there)), {key: tuple(s) for key, s in sums.items()}


def _planned(tables: Tables, entries: int) -> tuple[Plan, np.ndarray]:
    """The terms of a model and the rows of its kernels, per unit of ω V, from its tables."""
    kernels = Kernels()
    first, second = [], []
    for table in (x / math.factorial(order) for order, x in enumerate(tables.moments)):
        floor = 1e-13 * np.abs(table).max(initial=0.0)
        for at in np.ndindex(*table.shape[1:]):
            first += _terms(kernels, at[0], table[(slice(None), *at)], _powers(at[1:]), floor)
    for table in tables.forces:
        floor = 1e-13 * np.abs(table).max(initial=0.0)
        for at in np.ndindex(*table.shape[1:]):
            k, q = at[:2]
            ends = (((-1 - q,), ()), ((), (-1 - q,))) if entries else (((), ()),)
            pairs = [((*p, *x), (*r, *y), s) for p, r, s in _powers(at[2:]) for x, y in ends]
            second += _terms(kernels, k, table[(slice(None), *at)], pairs, floor)
    size = tables.moments[0].shape[1]
    return Plan(tuple(first), tuple(second), size, entries), np.array(kernels.rows).reshape(-1, len(tables.reference))


def _known(model: PointStateModel, families: Families) -> tuple[Hashable, PointStateModel, tuple, int] | None:
    grid = families.grid
    assert grid is not None
    stencil = (grid.offsets, families.dim, float(families.spacing or 1.0), grid.horizon)
    degree = model.degree
    known = known_part(families, ("tables", degree), lambda m: _tables(m, stencil, degree), model)
    return None if known is None else (*known, stencil, degree)


def refusal(model: AbstractModel, families: Families) -> str | None:
    """Why this backend cannot evaluate this model and body, or None if it can."""
    if (why := lattice_refusal(model, families)) is not None:
        return why
    if not (isinstance(model, PointStateModel) and model.degree and model.additive):
        return f"the force of {type(model).__name__} is not a polynomial in the displacement (or its order is traced)"
    if jax.tree.leaves(split_model(model, len(families))[0]):
        return "a constant of the model varies from point to point"
    if _known(model, families) is None:
        return "the moments or the bond force depend on a constant of the model that is traced"
    return None


class Convolution(Backend):
    """The force density of one model on one lattice body by FFT."""

    takes_mean: ClassVar[bool] = False
    # Without the fusion emitters of XLA, transforms are as fast (8.0 against 7.8 ms for 24³ points). Slices would take
    # up to twice as long.
    quick: ClassVar[bool] = True

    transforms: Complex[Array, "kernels *frequencies"]
    at_rest: Array  # (kernels, *cells), Σ_o κ(o) χ(i + o)
    filled: Array  # (*cells)
    reference: Array  # (entries, *cells)
    sites: Array | None
    horizon: Array
    plan: Plan = eqx.field(static=True)
    cells: tuple[int, ...] = eqx.field(static=True)
    box: tuple[int, ...] = eqx.field(static=True)

    def forward(self, x: Array) -> Array:
        return jnp.fft.rfftn(x, s=self.box, axes=tuple(range(1, x.ndim)))

    def inverse(self, x: Array) -> Array:
        """(n, frequencies) → (n, cells)."""
        out = jnp.fft.irfftn(x, s=self.box, axes=tuple(range(1, x.ndim)))
        return out[(slice(None), *(slice(0, n) for n in self.cells))]

    def _sum(self, terms: tuple[Term, ...], count: int, u: Array, state: Array) -> list[Array]:
        """The sums of the terms, entry by entry.

        u (dim, cells) and the point state (entries, cells) are 0 in empty cells.
        """

        def value(monomial: Monomial) -> Array | None:
            factors = [u[a] if a >= 0 else state[-1 - a] for a in monomial]
            return math.prod(factors[1:], start=factors[0]) if factors else None

        theres, sums = _fields(terms)
        fields = [jnp.asarray(value(m)) for m in theres]
        forth = dict(zip(theres, self.forward(jnp.stack(fields)), strict=True)) if theres else {}
        specs = list(dict.fromkeys(sums.values()))
        spectra = [sum(scale * self.transforms[k] * forth[m] for k, m, scale in spec) for spec in specs]
        back = dict(zip(specs, self.inverse(jnp.stack(spectra)), strict=True)) if specs else {}
        out: list[Any] = [0.0] * count
        for (entry, here), spec in sums.items():
            factor = value(here)
            out[entry] = out[entry] + (back[spec] if factor is None else factor * back[spec])
        for t in terms:
            if not t.there:
                factor = value(t.here)
                share = t.scale * self.at_rest[t.kernel]
                out[t.out] = out[t.out] + (share if factor is None else factor * share)
        return [jnp.broadcast_to(x, self.cells) for x in out]

    def force(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point; see `Backend.force`."""
        assert isinstance(model, PointStateModel)
        real = self.filled.dtype
        U = to_cells(u.astype(real), self.cells, self.sites)
        dim = u.shape[1]
        sums = self._sum(self.plan.moments, self.plan.entries, U, U[:0])
        deformed = jnp.stack([U[0], *sums])[1:]  # U[0] is there because jnp.stack refuses an empty list
        deformed = jnp.where(self.filled > 0, deformed, 0.0)  # the sums in an empty cell may have no derivative
        reference, deformed = (x.reshape(x.shape[0], math.prod(self.cells)) for x in (self.reference, deformed))
        rows = states_of_lattice(model, dim, (reference, deformed), self.horizon)
        rows = state_rows(model, dim, real, (reference, deformed), self.horizon) if rows is None else rows
        state = jnp.stack([U[0].reshape(-1), *rows])[1:].reshape(-1, *self.cells)
        state = jnp.where(self.filled > 0, state, 0.0)
        return from_cells(jnp.stack(self._sum(self.plan.forces, dim, U, state)) * self.filled, self.sites)


def _distinct(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The distinct rows, of which no two are multiples of each other, and the number and factor of every row."""
    kernels = Kernels()
    found = [kernels.number(row) if row.any() else (0, 0.0) for row in rows]
    numbers, scales = np.array([n for n, _ in found], int), np.array([s for _, s in found])
    return np.array(kernels.rows).reshape(-1, rows.shape[1]), numbers, scales


def _transformed(families: Families, plan: Plan, rows: np.ndarray, reference: np.ndarray) -> Convolution:
    """The prepared transforms. SciPy computes them, or JAX if the families are traced."""
    import scipy.fft  # imported here because it would add a sixth to the time of `import pdjax`

    xp = namespace(families)
    fft: ModuleType = scipy.fft if xp is np else jnp.fft
    grid: Any = on_host(families.grid)
    real, dim = families.dtype, families.dim
    offsets = np.array(grid.offsets).reshape(-1, dim)
    reach = np.abs(offsets).max(axis=0, initial=0)
    box = tuple(
        n if wraps else scipy.fft.next_fast_len(int(n + r), real=True)
        for n, r, wraps in zip(grid.cells, reach, grid.periodic, strict=True)
    )
    axes, weight = tuple(range(1, dim + 1)), grid.influence * float(families.spacing or 1.0) ** dim

    def transforms(rows: np.ndarray) -> Array | np.ndarray:
        """Transforms of the mirrored kernels (kernels, offsets), which turn a correlation into a product."""
        kernels, at = xp.zeros((len(rows), *box), real), (slice(None), *np.mod(-offsets, box).T)
        if xp is np:
            kernels[at] = rows * weight
        else:
            kernels = kernels.at[at].set(jnp.asarray(rows, real) * weight)
        return fft.rfftn(kernels, axes=axes)

    def back(spectra: Array | np.ndarray) -> Array | np.ndarray:
        return fft.irfftn(spectra, s=box, axes=axes)[(slice(None), *(slice(0, n) for n in grid.cells))]

    filled = to_cells(xp.ones((len(families), 1), real), grid.cells, grid.sites)[0]
    with scipy.fft.set_workers(cores()):
        spectra, body = transforms(rows), fft.rfftn(filled, s=box)
        at_rest = back(spectra * body)
        distinct, number, scale = _distinct(reference.T)
        summed = back(transforms(distinct) * body)
    column = (slice(None), *(None,) * dim)
    full = (reference.T * weight).sum(axis=1)[column]  # the sums of a full family, for the empty cells
    sums = summed[number] * scale.astype(real)[column] if len(number) else xp.zeros((0, *grid.cells), real)
    sums = xp.where(filled > 0, sums, full).astype(real)
    spectra, at_rest, filled, sums, sites = on_device((spectra, at_rest, filled, sums, grid.sites))
    return Convolution(spectra, at_rest, filled, sums, sites, families.horizon, plan, grid.cells, box)


def prepare(model: AbstractModel, families: Families) -> Convolution:
    """The backend for these families, made on the host if they are not traced. `refusal` must have returned None."""
    assert isinstance(model, PointStateModel)
    known = _known(model, families)
    assert known is not None
    key, there, stencil, degree = known

    def planned() -> tuple[Plan, np.ndarray, np.ndarray]:
        tables, state = computed(_compiled_tables, there, stencil, degree)
        return (*_planned(tables, state.size), tables.reference)

    plan, rows, reference = remember(families, ("kernels", key), planned)
    if not is_concrete(families):
        return _transformed(families, plan, rows, reference)
    return remember(families, ("convolution", key), lambda: _transformed(families, plan, rows, reference))
