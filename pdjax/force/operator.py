"""The force density of a body by the cheapest way that can: one result, three ways.

    families     padded neighbour arrays of any cloud; streamed slot by slot where the model is made of moments, so that
                 memory is points and not points × bonds; all bonds at once in small bodies, which compile sooner so
    slices       a lattice without index arrays: the neighbours of all points are one slice
    fft          a lattice by convolutions, where moments and bond force are polynomials of degree 1 or 2 in the
                 displacement: the cost does not grow with the horizon

What depends on the reference configuration alone (shape tensors, transforms of kernels) is computed once for each
families object and for those constants of the model that it reads, and remembered with the families: a plain
`force_density`, in a user's own `jit` too, costs what the operator of `force_operator` costs.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import (
    as_array,
    choice,
    deformation_gradient,
    in_host_memory,
    inside_jit,
    is_concrete,
    on_host,
)
from .._internal.dependence import known_part
from .._internal.memory import remember, value_key
from .._internal.public import public_function
from .._internal.xla import QUICK, compiled_with
from ..geometry.bonds import Families
from ..models.base import AbstractModel, PointStateModel
from ..models.pointwise import split_model
from ..models.promises import check_promises
from .backends.fft import Convolution, has_kernels
from .backends.streaming import reference_moments, reference_sums, streamed_force
from .backends.traversal import LatticeTraversal, SlotTraversal, Traversal
from .fields import check_model, point_field, whole_force

WAYS = ("auto", "families", "slices", "fft")
SMALL = 10_000  # bonds below which all go at once: a third of the time to compile, under a millisecond to run
MANY = 100  # offsets from which transforms of degree 1 beat slices (3D, N = 3 has 122; measured in `pdjax bench ways`)


def _refusal(model: AbstractModel, families: Families, way: str) -> str | None:
    """Why this model and body can't go this way; None if they can."""
    moments = isinstance(model, PointStateModel) and model.by_moments
    if way == "families":
        return "they were made with arrays=False" if families.xi is None else None
    if families.grid is None or not _alike(families):
        return "they do not come from a lattice (`pd.lattice`, `bar`, `plate`, `cuboid`, without weights of their own)"
    if not moments:
        return f"{type(model).__name__} has no point state made of sums over single bonds"
    if way == "fft":
        assert isinstance(model, PointStateModel)
        if not (model.degree and model.additive):
            return f"the force of {type(model).__name__} is no polynomial of the displacement (or its order is traced)"
        if jax.tree.leaves(split_model(model, len(families))[0]):
            return "a constant of the model varies from point to point"
        if not has_kernels(model, families):
            return "moments or bond force depend on a constant of the model that is traced"
    return None


def _alike(families: Families) -> bool:
    """Whether all points have the volume of a cell, as far as it is known."""
    if not is_concrete(families.volumes):
        return True

    def found() -> bool:
        volumes = np.asarray(families.volumes)
        return bool((np.abs(volumes - volumes[0]) <= 1e-6 * volumes[0]).all())

    return remember(families, "alike", found)


def ways_of(model: AbstractModel, families: Families) -> tuple[str, ...]:
    """The ways that this model and these families can go, of "families", "slices", "fft"."""
    return tuple(way for way in WAYS[1:] if _refusal(model, families, way) is None)


def _choose(model: AbstractModel, families: Families, way: str, mean: bool) -> str:
    able = tuple(w for w in ways_of(model, families) if not (mean and w == "fft"))
    if way != "auto":
        if way not in able:
            why = _refusal(model, families, way) or "a mean deformation F is no field on the lattice"
            raise ValueError(
                f"way {way!r} does not apply here: {why}; ways that do: {', '.join(map(repr, able)) or 'none'}"
            )
        return way
    if not able:
        raise ValueError(f"{type(model).__name__} needs families with arrays; these were made with arrays=False")
    if families.xi is not None and math.prod(families.xi.shape[:2]) < SMALL:
        return "families"
    if "fft" in able and model.degree == 1 and families.grid is not None and len(families.grid.offsets) >= MANY:
        return "fft"
    return "slices" if "slices" in able else "families"


class ForceOperator(eqx.Module):
    """f(u) of one model on one body, with all that does not depend on u done: call it with u (points, dim) [length].

    An operator is equal to itself alone, so that `jax.jit(operator)` and `jax.checkpoint(operator)` work.
    """

    model: AbstractModel
    families: Families
    plan: Any  # Convolution; (traversal, reference sums); None: all bonds at once
    way: str = eqx.field(static=True)

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __call__(self, u, F=None) -> Float[Array, "points dim"]:
        """f (points, dim) [force/length^dim]; arguments as `force_density`."""
        if F is not None and self.way == "fft":
            raise ValueError("way 'fft' takes no mean deformation F; prepare with way='slices' or 'families'")
        u = point_field(u, self.families)
        if self.plan is not None and jnp.issubdtype(u.dtype, jnp.complexfloating):
            raise ValueError(
                f"way {self.way!r} is for real u; got {u.dtype}: for derivatives use jax.jvp, or a body of fewer than"
                f" {SMALL} bonds, whose force is one function of all bonds"
            )
        F = None if F is None else deformation_gradient(F, self.families.dim)
        prepared = (self.plan, self.families.horizon) if self.plan is not None else self.families
        traced = inside_jit()
        if traced and is_concrete(prepared):
            prepared = _hidden(prepared)
        quick = self.way == "fft" and not traced and is_concrete(self.model, prepared, u)
        return (_evaluate_by_fft if quick else _evaluate)(self.model, prepared, u, F)


def _hidden(prepared: Any) -> Any:
    """Known arrays in a program of the user's, hidden from the compiler: it would compute with them while it compiles,
    for seconds."""
    arrays, rest = eqx.partition(prepared, eqx.is_array)
    return eqx.combine(jax.lax.optimization_barrier(arrays), rest)


def _force(model: AbstractModel, prepared: Any, u: Array, F: Array | None) -> Float[Array, "points dim"]:
    if isinstance(prepared, Families):
        return whole_force(model, prepared, prepared.bonds(u, F))
    plan, horizon = prepared
    assert isinstance(model, PointStateModel)
    if isinstance(plan, Convolution):
        return plan.force(model, u, horizon)
    traversal, reference = plan
    gradient = None if F is None else F - jnp.eye(u.shape[1], dtype=u.dtype)
    return streamed_force(split_model(model, len(u)), traversal, reference, u, gradient, horizon)


_evaluate = eqx.filter_jit(_force)
# transforms run as fast without fusion emitters (8.0 against 7.8 ms for 24³ points), slices take up to twice as long
_evaluate_by_fft = compiled_with(QUICK)(_force)


def _traversal(families: Families, way: str) -> Traversal:
    made = LatticeTraversal.of if way == "slices" else SlotTraversal.of
    return remember(families, ("traversal", way), lambda: made(families)) if is_concrete(families) else made(families)


@eqx.filter_jit
def _reference(model: PointStateModel, traversal: Traversal, horizon: Array, points: int, dim: int) -> Array:
    return reference_sums(split_model(model, points), traversal, dim, horizon)


def _streamed(model: PointStateModel, families: Families, way: str) -> tuple[Traversal, Array]:
    """The traversal of a way and the sums over the reference configuration, which depend on few constants of a model."""
    traversal, points = _traversal(families, way), len(families)

    def sums(model: PointStateModel) -> Array:
        return _reference(model, traversal, families.horizon, points, families.dim)

    known = None
    if is_concrete(families):
        known = known_part(families, "reference", lambda m: reference_moments(m, points, families.dim), model)
    if known is None:
        return traversal, sums(model)
    key, there = known
    return traversal, remember(families, ("reference sums", way, key), lambda: sums(there))


def _plan(model: AbstractModel, families: Families, way: str) -> Any:
    if not (isinstance(model, PointStateModel) and model.by_moments):
        return None
    if way == "families" and math.prod(families.xi.shape[:2]) < SMALL:
        return None
    check_promises(model, families.dim)
    return Convolution.of(model, families) if way == "fft" else _streamed(model, families, way)


def _prepared(model: AbstractModel, families: Families, way: str, mean: bool) -> tuple[Any, str]:
    """(plan, way), all checks made."""
    check_model(model, families, Families)
    way = _choose(model, families, way, mean)
    return _plan(model, families, way), way


@public_function
def force_operator(model: AbstractModel, families: Families, way: str = "auto", mean: bool = False) -> ForceOperator:
    """The force density of a body as a function of u, prepared: for many evaluations, under `jit` too.

    Arguments and errors: as `force_density`; mean: whether it will be called with a mean deformation, f(u, F).
    Example: `f = pd.force_operator(model, families); f(u)`.
    """
    choice("way", way, WAYS)
    key = value_key(model) if isinstance(families, Families) and is_concrete(families) else None
    if key is None:
        plan, way = _prepared(model, families, way, mean)
    else:
        plan, way = remember(families, ("force", way, mean, key), lambda: _prepared(model, families, way, mean))
    return ForceOperator(model, families, plan, way)


@public_function
def force_density(model: AbstractModel, families: Families, u, F=None, way: str = "auto") -> Float[Array, "points dim"]:
    """Net internal force density f of every point.

    Arguments: u (points, dim) [length]; F (dim, dim) an optional mean deformation under it, for periodic
        bodies: η = (F − I) ξ + u_j − u_i; way "families", "slices", "fft", or "auto", the cheapest by measurement.
    Returns: (points, dim) [force/length^dim].
    Raises: ValueError for wrong shapes, NaN, a point whose family is too poor for the model (with its index), or a
        way that this model or body can't go (with those it can), and outside of transformations for forces that are not
        finite, naming the bond that has collapsed. A body of points without bonds has none: see `models.pointwise`.
    """
    f = force_operator(model, families, way, F is not None)(u, F)
    if in_host_memory(f) and not np.isfinite(np.asarray(f)).all():
        raise ValueError(_not_finite(families, np.asarray(f), u, F))
    return f


def _not_finite(families: Families, f: np.ndarray, u: Any, F: Any) -> str:
    """What is wrong where forces are not finite: a bond that has collapsed, or numbers beyond their precision."""
    bad = np.flatnonzero(~np.isfinite(f).all(axis=1))
    where = f"the forces on {len(bad)} points are not finite, the first is point {bad[0]}"
    if families.xi is not None:
        bonds = on_host(families.bonds(as_array(u, families.dtype), F))
        length = np.linalg.norm(bonds.xi + bonds.eta, axis=-1) / np.linalg.norm(bonds.xi, axis=-1)
        gone = np.argwhere(np.asarray(families.is_bond) & ~(length > 1e-12))
        if len(gone):
            i, slot = gone[0]
            j = int(np.asarray(families.neighbours)[i, slot])
            return (
                f"{where}: the bond from point {i} to point {j} has collapsed, both are at one place ({len(gone)} such)"
            )
    if families.dtype == np.float32:
        return f"{where}; in numbers of 32 bits small lengths in large units overflow: take units near 1, or 64 bits"
    return f"{where}; does u [length] turn bonds over, or is a constant of the model out of range?"
