"""What is done to a body: prescribed displacements, body forces, tractions.

Each is a plain record that `pdjax.scene` reads; values are those at load factor 1 and grow in proportion to it.

A nonlocal body has no surface to pull on, so a traction is a body force over a boundary layer:

    total     b_i = f / Σ_layer V          the force f [force] evenly over the layer
    exact     b_i = −f_i(F)                the layer's own internal force under x = F X

The second keeps the homogeneous state F an exact equilibrium where the layer is two horizons deep (two rings of
neighbours feel a surface); its sum over the layer is P N A, the classical traction times the area of the face (where
the layer ends at free sides, it also holds those in place). The first has the same sum and disturbs the strain near
it. Source of the idea of layers: Silling & Askari 2005.
"""

from typing import Any, NamedTuple

import numpy as np

from .._internal.checks import as_array, native
from .._internal.public import public_function
from ..models.base import AbstractModel


class Prescribed(NamedTuple):
    """Displacements `u` [length] of `points`; `components` None means all of them; `mask` as in `point_numbers`."""

    points: np.ndarray
    mask: int | None
    u: Any
    components: tuple[int, ...] | None


class BodyForce(NamedTuple):
    """Body force density `b` [force/length^dim] on `points`."""

    points: np.ndarray
    mask: int | None
    b: Any


class TotalForce(NamedTuple):
    """A force [force] spread evenly over the volume of `points`."""

    points: np.ndarray
    mask: int | None
    force: Any


class HomogeneousTraction(NamedTuple):
    """The body force on `points` that balances the homogeneous deformation F there, its origin at rest."""

    points: np.ndarray
    mask: int | None
    F: Any
    model: Any


Condition = Prescribed | BodyForce | TotalForce | HomogeneousTraction


def point_numbers(points) -> tuple[np.ndarray, int | None]:
    """Point numbers from numbers or from a boolean mask, and the length of the mask, which must be the body's."""
    if isinstance(points, np.ma.MaskedArray):
        points = native("points", points)
    points, mask = np.atleast_1d(np.asarray(points)), None
    if points.dtype == bool and points.ndim == 1:
        points, mask = np.flatnonzero(points), len(points)
    if not points.dtype.isnative:
        points = points.astype(points.dtype.newbyteorder("="))
    if points.ndim != 1 or points.size == 0 or not np.issubdtype(points.dtype, np.integer):
        raise ValueError(f"points must be a mask or a list of point numbers, not empty; got {points!r}")
    if len(np.unique(points)) != len(points):
        raise ValueError("points must not name a point twice")
    return points, mask


def check_points(what: str, points: np.ndarray, mask: int | None, count: int) -> np.ndarray:
    """`points` if a body of `count` points has them; ValueError for a mask of another length, a point it has not."""
    if mask is not None and mask != count:
        raise ValueError(f"{what} has a mask of {mask} points; the body has {count}")
    if points.min() < 0 or points.max() >= count:
        bad = int(points[(points < 0) | (points >= count)][0])
        raise ValueError(f"{what} names point {bad}; the body has points 0 to {count - 1}")
    return points


@public_function
def prescribe(points, u=0.0, components=None) -> Prescribed:
    """Hold points at a displacement.

    Arguments: points a boolean mask (points,) or point numbers; u [length] a number, one value for each component
        held, or (points named, components held); components: which of them are held, e.g. 0 or (0, 2); all if None.
    """
    chosen = None if components is None else tuple(int(c) for c in np.atleast_1d(components))
    if chosen is not None and (len(set(chosen)) != len(chosen) or not chosen):
        raise ValueError(f"components must be different numbers such as (0, 1); got {components!r}")
    return Prescribed(*point_numbers(points), as_array(u, name="u"), chosen)


@public_function
def body_force(points, b) -> BodyForce:
    """A body force density b [force/length^dim]: a number in 1D, (dim,), or (points named, dim)."""
    return BodyForce(*point_numbers(points), as_array(b, name="b"))


@public_function
def total_force(points, force) -> TotalForce:
    """A force (dim,) [force] spread evenly over the points named: the crude traction of the module's head."""
    return TotalForce(*point_numbers(points), as_array(force, name="force"))


@public_function
def homogeneous_traction(points, F, model: AbstractModel | None = None) -> HomogeneousTraction:
    """The exact traction of the module's head over the layer of points named, for the homogeneous deformation F.

    `model`: whose internal force is meant, if not the body's own (a graded body's material at the surface).
    """
    return HomogeneousTraction(*point_numbers(points), as_array(F, name="F"), model)
