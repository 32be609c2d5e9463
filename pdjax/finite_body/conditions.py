"""Conditions of a body: prescribed displacements, body forces and tractions.

Each function here returns a small record, and `pdjax.scene` reads these records. The values are those at load factor
λ = 1. At another load factor `scene` multiplies them by λ.

A nonlocal body has no surface on which a traction could act. A traction is therefore a body force b over a boundary
layer of points. There are two versions:

    total     b_i = f / Σ_layer V          the force f [force], spread evenly over the layer (total_force)
    exact     b_i = −f_i(F)                minus the internal force of the layer under x = F X (homogeneous_traction)

With the exact version the homogeneous state F is an exact equilibrium, if the layer is two horizons deep. (The force on
a point depends on its neighbours and on the neighbours of these, so a surface acts over two horizons.) The sum of V b
over the layer is P N A: the classical traction P N times the area A of the face. Where the layer ends at free sides,
this body force also balances the internal forces of those sides. The total version can have the same sum, but it
disturbs the strain near the layer.

The idea of boundary layers is that of Silling & Askari 2005.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array

from .._internal.checks import as_array, native
from .._internal.public import public_function
from ..models.base import AbstractModel


class Prescribed(NamedTuple):
    """Displacements `u` [length] of `points`. `components` None holds all of them; `mask` as in `point_numbers`."""

    points: np.ndarray
    mask: int | None
    u: Array
    components: tuple[int, ...] | None


class BodyForce(NamedTuple):
    """Body force density `b` [force/length^dim] on `points`."""

    points: np.ndarray
    mask: int | None
    b: Array


class TotalForce(NamedTuple):
    """A total force [force] that is spread evenly over the volume of `points`."""

    points: np.ndarray
    mask: int | None
    force: Array


class HomogeneousTraction(NamedTuple):
    """The body force on `points` that balances their internal force under the homogeneous deformation x = F X."""

    points: np.ndarray
    mask: int | None
    F: Array
    model: AbstractModel | None


Condition = Prescribed | BodyForce | TotalForce | HomogeneousTraction


def point_numbers(points) -> tuple[np.ndarray, int | None]:
    """Return point numbers, given as numbers or as a boolean mask, and the length of the mask (None without a mask).

    `check_points` compares that length with the number of points of the body.
    """
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
    """Return `points` if a body of `count` points has all of them.

    Raises ValueError if the mask has another length than the body, or if a point number lies outside the body.
    """
    if mask is not None and mask != count:
        raise ValueError(f"{what} has a mask of {mask} points; the body has {count}")
    if points.min() < 0 or points.max() >= count:
        bad = int(points[(points < 0) | (points >= count)][0])
        raise ValueError(f"{what} names point {bad}; the body has points 0 to {count - 1}")
    return points


@public_function
def prescribe(points, u=0.0, components=None) -> Prescribed:
    """Hold points at given displacements.

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The points to hold: a mask over all points of the body, or their numbers.
    u : float or array, optional
        Displacements [length] at load factor 1: one number, one value for each held component, or an array of shape
        (selected, held components). Default 0.
    components : int or tuple of int, optional
        Which components are held, for example 0 or (0, 2). Default: all components.

    Returns
    -------
    Prescribed
        A condition for `scene`.

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers, or if `components` names a
        component twice.

    Examples
    --------
    Hold the left column of a lattice of 5 × 4 points in the direction x, at u_x = 0:

    >>> body = pd.lattice((5, 4))
    >>> left = body.positions[:, 0] < 1
    >>> pd.prescribe(left, 0.0, components=0).points
    array([0, 1, 2, 3])
    """
    chosen = None if components is None else tuple(int(c) for c in np.atleast_1d(components))
    if chosen is not None and (len(set(chosen)) != len(chosen) or not chosen):
        raise ValueError(f"components must be different numbers such as (0, 1); got {components!r}")
    return Prescribed(*point_numbers(points), as_array(u, name="u"), chosen)


@public_function
def body_force(points, b) -> BodyForce:
    """Load points with a body force density.

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The loaded points: a mask over all points of the body, or their numbers.
    b : float or array, shape (dim,) or (selected, dim)
        Body force density [force/length^dim] at load factor 1. One number is accepted in 1D only.

    Returns
    -------
    BodyForce
        A condition for `scene`.

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers.

    Examples
    --------
    >>> body = pd.bar(5, 5.0)
    >>> held, loaded = pd.prescribe([0], 0.0), pd.body_force([3, 4], 0.1)
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held, loaded)
    >>> print(scene.load[:, 0])
    [0.  0.  0.  0.1 0.1]
    """
    return BodyForce(*point_numbers(points), as_array(b, name="b"))


@public_function
def total_force(points, force) -> TotalForce:
    """Spread a total force evenly over points.

    b_i = f / Σ V, with the sum over the loaded points

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The loaded points: a mask over all points of the body, or their numbers.
    force : array, shape (dim,)
        The total force f [force] at load factor 1.

    Returns
    -------
    TotalForce
        A condition for `scene`.

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers.

    Notes
    -----
    This body force disturbs the strain near the loaded layer. `homogeneous_traction` does not.

    References
    ----------
    Silling & Askari 2005 (boundary layers)

    Examples
    --------
    A force of 0.1 on two points of volume 1 is a body force density of 0.05:

    >>> body = pd.bar(5, 5.0)
    >>> held, pulled = pd.prescribe([0], 0.0), pd.total_force([3, 4], [0.1])
    >>> scene = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held, pulled)
    >>> print(scene.load[:, 0])
    [0.   0.   0.   0.05 0.05]
    """
    return TotalForce(*point_numbers(points), as_array(force, name="force"))


@public_function
def homogeneous_traction(points, F, model: AbstractModel | None = None) -> HomogeneousTraction:
    """Load a boundary layer so that a homogeneous deformation is an exact equilibrium.

    b_i = −f_i(F), with f_i the internal force density of point i under x = F X

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The points of the layer: a mask over all points of the body, or their numbers.
    F : array, shape (dim, dim)
        Homogeneous deformation gradient [-] at load factor 1.
    model : AbstractModel, optional
        The model of f_i. Default: the model of the scene. Give one for a graded body: its material at the surface.

    Returns
    -------
    HomogeneousTraction
        A condition for `scene`.

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers.

    Notes
    -----
    The layer must be two horizons deep, because the surface changes the force on points up to that depth. The sum of
    V b over the layer is the classical traction P N times the area of the face.

    References
    ----------
    Silling & Askari 2005 (boundary layers)

    Examples
    --------
    A stretch of 1.1 gives P = F S = 1.1 · ½ (1.1² − 1) = 0.1155. The volumes are 1:

    >>> body = pd.bar(11, 11.0)
    >>> held = pd.prescribe(np.arange(4), 0.1 * body.positions[:4])
    >>> pulled = pd.homogeneous_traction(np.arange(7, 11), [[1.1]])
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
    >>> scene = pd.scene(body, pd.families(body, 2.0), model, held, pulled)
    >>> round(float(np.sum(scene.load)), 4)
    0.1155
    """
    return HomogeneousTraction(*point_numbers(points), as_array(F, name="F"), model)
