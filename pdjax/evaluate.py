"""The force density of a body by the cheapest way that can: one result, three ways.

    families     padded neighbour arrays of any cloud; streamed slot by slot where the model is made of moments, so that
                 memory is points and not points × bonds; all bonds at once in small bodies, which compile sooner so
    slices       a lattice without index arrays: the neighbours of all points are one slice
    fft          a lattice by convolutions, where moments and bond force are polynomials of degree 1 or 2 in the
                 displacement: the cost does not grow with the horizon

What depends on the reference configuration alone (shape tensors, transforms of kernels) is computed once, by
`force_operator`.
"""

import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._checks import choice, deformation_gradient, is_concrete
from .force import check_model, point_field, split_model, whole_force
from .models.base import AbstractModel, PointStateModel
from .neighbours import Families
from .ways.convolution import Convolution
from .ways.promises import check_promises
from .ways.stream import reference_sums, streamed_force
from .ways.walks import GridWalk, SlotWalk

WAYS = ("auto", "families", "slices", "fft")
SMALL = 10_000  # bonds below which all go at once: a third of the time to compile, under a millisecond to run
MANY = 100  # offsets from which transforms of degree 1 beat slices (3D, N = 3 has 122; measured in `pdjax bench ways`)


def _refusal(model: AbstractModel, fams: Families, way: str) -> str | None:
    """Why this model and body can't go this way; None if they can."""
    moments = isinstance(model, PointStateModel) and model.by_moments
    if way == "families":
        return "they were made with arrays=False" if fams.xi is None else None
    if fams.grid is None or not _alike(fams):
        return "they do not come from a lattice (`pd.lattice`, `bar`, `plate`, `cuboid`, without weights of their own)"
    if not moments:
        return f"{type(model).__name__} has no point state made of sums over single bonds"
    if way == "fft":
        assert isinstance(model, PointStateModel)
        if not (model.degree and model.additive):
            return f"the force of {type(model).__name__} is no polynomial of the displacement (or its order is traced)"
        if jax.tree.leaves(split_model(model, len(fams))[0]):
            return "a constant of the model varies from point to point"
    return None


def _alike(fams: Families) -> bool:
    """Whether all points have the volume of a cell, as far as it is known."""
    if not is_concrete(fams.volumes):
        return True
    volumes = np.asarray(fams.volumes)
    return bool((np.abs(volumes - volumes[0]) <= 1e-6 * volumes[0]).all())


def ways_of(model: AbstractModel, fams: Families) -> tuple[str, ...]:
    """The ways that this model and these families can go, of "families", "slices", "fft"."""
    return tuple(way for way in WAYS[1:] if _refusal(model, fams, way) is None)


def _choose(model: AbstractModel, fams: Families, way: str, mean: bool) -> str:
    choice("way", way, WAYS)
    able = tuple(w for w in ways_of(model, fams) if not (mean and w == "fft"))
    if way != "auto":
        if way not in able:
            why = _refusal(model, fams, way) or "a mean deformation F is no field on the lattice"
            raise ValueError(
                f"way {way!r} does not apply here: {why}; ways that do: {', '.join(map(repr, able)) or 'none'}"
            )
        return way
    if not able:
        raise ValueError(f"{type(model).__name__} needs families with arrays; these were made with arrays=False")
    if fams.xi is not None and math.prod(fams.xi.shape[:2]) < SMALL:
        return "families"
    if "fft" in able and model.degree == 1 and fams.grid is not None and len(fams.grid.offsets) >= MANY:
        return "fft"
    return "slices" if "slices" in able else "families"


class ForceOperator(eqx.Module):
    """f(u) of one model on one body, with all that does not depend on u done: call it with u (points, dim) [length]."""

    model: AbstractModel
    families: Families
    plan: Any  # Convolution; (walk, reference sums); None: all bonds at once
    way: str = eqx.field(static=True)

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
        return _evaluate(self, u, None if F is None else deformation_gradient(F, self.families.dim))


def _symmetric(fams: Families) -> bool:
    """Whether every bond weighs the same from both ends; known only of concrete arrays."""
    if not is_concrete(fams):
        return fams.grid is not None
    omega = np.asarray(fams.influence) * np.asarray(fams.weight)
    return bool((omega == omega[np.asarray(fams.neighbours), np.asarray(fams.reverse)]).all())


@eqx.filter_jit
def _walked(model: PointStateModel, fams: Families, way: str, symmetric: bool) -> tuple[Any, Array]:
    walk = GridWalk.of(fams) if way == "slices" else SlotWalk.of(fams, symmetric)
    return walk, reference_sums(split_model(model, len(fams)), walk, fams.dim, fams.horizon)


def _plan(model: AbstractModel, fams: Families, way: str) -> Any:
    if not (isinstance(model, PointStateModel) and model.by_moments):
        return None
    if way == "families" and math.prod(fams.xi.shape[:2]) < SMALL:
        return None
    check_promises(model, fams.dim)
    if way == "fft":
        return Convolution.of(model, fams, model.degree)
    return _walked(model, fams, way, way == "families" and _symmetric(fams))


@eqx.filter_jit
def _evaluate(operator: ForceOperator, u: Array, F: Array | None) -> Float[Array, "points dim"]:
    model, fams = operator.model, operator.families
    if operator.plan is None:
        return whole_force(model, fams, fams.bonds(u, F))
    assert isinstance(model, PointStateModel)
    gradient = None if F is None else F - jnp.eye(fams.dim, dtype=fams.dtype)
    if isinstance(operator.plan, Convolution):
        return operator.plan.force(model, u, fams.horizon)
    walk, reference = operator.plan
    return streamed_force(split_model(model, len(fams)), walk, reference, u, gradient, fams.horizon)


def force_operator(model: AbstractModel, fams: Families, way: str = "auto", mean: bool = False) -> ForceOperator:
    """The force density of a body as a function of u, prepared: for many evaluations, under `jit` too.

    Arguments and errors: as `force_density`; mean: whether it will be called with a mean deformation, f(u, F).
    Example: `f = pd.force_operator(model, fams); f(u)`.
    """
    check_model(model, fams, Families)
    way = _choose(model, fams, way, mean)
    return ForceOperator(model, fams, _plan(model, fams, way), way)


def force_density(model: AbstractModel, fams: Families, u, F=None, way: str = "auto") -> Float[Array, "points dim"]:
    """Net internal force density f of every point.

    Arguments: u (points, dim) [length]; F (dim, dim) an optional mean deformation under it, for periodic
        bodies: η = (F − I) ξ + u_j − u_i; way "families", "slices", "fft", or "auto", the cheapest by measurement.
    Returns: (points, dim) [force/length^dim].
    Raises: ValueError for wrong shapes, NaN, a point whose family is too poor for the model (with its index), or a
        way that this model or body can't go (with those it can).
    """
    return force_operator(model, fams, way, F is not None)(u, F)
