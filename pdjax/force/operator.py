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
from .._internal.memory import remember, value_key
from .._internal.public import public_function
from .._internal.xla import QUICK, compiled_with
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..models.promises import check_promises
from .backends import fft, padded, slices
from .backends.backend import Backend
from .fields import check_model, point_field

BACKENDS: dict[str, Any] = {"families": padded, "slices": slices, "fft": fft}
WAYS = ("auto", *BACKENDS)
MANY = 100  # offsets from which transforms of degree 1 beat slices (3D, N = 3 has 122; measured in `pdjax bench ways`)


def ways_of(model: AbstractModel, families: Families) -> tuple[str, ...]:
    """The ways that this model and these families can go, of "families", "slices", "fft"."""
    return tuple(way for way, backend in BACKENDS.items() if backend.refusal(model, families) is None)


def _choose(model: AbstractModel, families: Families, way: str, mean: bool) -> str:
    able = tuple(w for w in ways_of(model, families) if not (mean and w == "fft"))
    if way != "auto":
        if way not in able:
            why = BACKENDS[way].refusal(model, families) or "a mean deformation F is no field on the lattice"
            raise ValueError(
                f"way {way!r} does not apply here: {why}; ways that do: {', '.join(map(repr, able)) or 'none'}"
            )
        return way
    if not able:
        raise ValueError(f"{type(model).__name__} needs families with arrays; these were made with arrays=False")
    if padded.is_small(families):
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
    backend: Backend
    way: str = eqx.field(static=True)

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __call__(self, u, F=None) -> Float[Array, "points dim"]:
        """f (points, dim) [force/length^dim]; arguments as `force_density`."""
        backend = self.backend
        if F is not None and not backend.takes_mean:
            raise ValueError(
                f"way {self.way!r} takes no mean deformation F; prepare with way='slices' or way='families'"
            )
        u = point_field(u, self.families)
        if jnp.issubdtype(u.dtype, jnp.complexfloating) and not backend.takes_complex:
            raise ValueError(
                f"way {self.way!r} is for real u; got {u.dtype}: for derivatives use jax.jvp, or a body of fewer than"
                f" {padded.SMALL} bonds, whose force is one function of all bonds"
            )
        F = None if F is None else deformation_gradient(F, self.families.dim)
        traced = inside_jit()
        if traced and is_concrete(backend):
            backend = _hidden(backend)
        if backend.compiler_options and not traced and is_concrete(self.model, backend, u):
            return _evaluate_quickly(backend, self.model, u, F)
        return _evaluate(backend, self.model, u, F)


def _hidden(backend: Backend) -> Backend:
    """Known arrays in a program of the user's, hidden from the compiler: it would compute with them while it compiles,
    for seconds."""
    arrays, rest = eqx.partition(backend, eqx.is_array)
    return eqx.combine(jax.lax.optimization_barrier(arrays), rest)


def _force(backend: Backend, model: AbstractModel, u: Array, F: Array | None) -> Float[Array, "points dim"]:
    return backend.force(model, u, F)


_evaluate = eqx.filter_jit(_force)
_evaluate_quickly = compiled_with(QUICK)(_force)


def _backend(model: AbstractModel, families: Families, way: str) -> Backend:
    """The prepared backend. What a model made of moments promises is tried first where streaming relies on it."""
    if model.by_moments and not (way == "families" and padded.is_small(families)):
        check_promises(model, families.dim)
    return BACKENDS[way].prepare(model, families)


def _prepared(model: AbstractModel, families: Families, way: str, mean: bool) -> tuple[Backend, str]:
    """(backend, way), all checks made."""
    check_model(model, families, Families)
    way = _choose(model, families, way, mean)
    return _backend(model, families, way), way


@public_function
def force_operator(model: AbstractModel, families: Families, way: str = "auto", mean: bool = False) -> ForceOperator:
    """The force density of a body as a function of u, prepared: for many evaluations, under `jit` too.

    Arguments and errors: as `force_density`; mean: whether it will be called with a mean deformation, f(u, F).
    Example: `f = pd.force_operator(model, families); f(u)`.
    """
    choice("way", way, WAYS)
    key = value_key(model) if isinstance(families, Families) and is_concrete(families) else None
    if key is None:
        backend, way = _prepared(model, families, way, mean)
    else:
        backend, way = remember(families, ("force", way, mean, key), lambda: _prepared(model, families, way, mean))
    return ForceOperator(model, families, backend, way)


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
