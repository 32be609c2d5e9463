"""Cutting bonds: across a plane, a segment of the plane, or a flat polygon in space.

A bond is cut where the straight line between its ends crosses the surface. Its weight becomes 0 from both ends, and a
point that loses all its bonds is a fragment without force (`pdjax.models.pointwise`).
"""

from typing import Any, NamedTuple

import numpy as np

from .._internal.checks import finite, is_concrete
from .._internal.public import public_function
from .bonds import Families


class Plane(NamedTuple):
    """All of a plane (a line in 2D, a point in 1D) through `point` (dim,) [length], at right angles to `normal`
    (dim,)."""

    point: Any
    normal: Any


class Segment(NamedTuple):
    """The straight line from `start` to `end` (2,) [length] in 2D."""

    start: Any
    end: Any


class Polygon(NamedTuple):
    """A flat convex polygon in 3D by its `vertices` (3 or more, 3) [length], in order around it."""

    vertices: Any


Surface = Plane | Segment | Polygon
_DIMS = {Plane: (1, 2, 3), Segment: (2,), Polygon: (3,)}


def _plane(surface: Surface) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """(a point of the plane, its unit normal, the edges: a point and the unit direction inwards)."""
    if isinstance(surface, Plane):
        point, normal = (
            np.atleast_1d(finite(f"{name} of the plane", x))
            for name, x in zip(("point", "normal"), surface, strict=True)
        )
        edges: list = []
    elif isinstance(surface, Segment):
        point, end = (finite(f"{name} of the segment", x) for name, x in zip(("start", "end"), surface, strict=True))
        along = end - point
        normal, edges = np.array([-along[1], along[0]]), [(point, along), (end, -along)]
    else:
        corners = finite("vertices of the polygon", surface.vertices)
        if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3:
            raise ValueError(f"vertices of a polygon must have shape (3 or more, 3); got {corners.shape}")
        point, sides = corners[0], np.roll(corners, -1, axis=0) - corners
        normal = np.cross(sides, np.roll(sides, -1, axis=0)).sum(axis=0)
        edges = [(corner, np.cross(normal, side)) for corner, side in zip(corners, sides, strict=True)]
        size = np.linalg.norm(normal)
        if size > 0:
            flat = np.abs((corners - point) @ normal).max() / size
            turns = np.array(
                [np.dot(inwards, corners[k] - corner) for corner, inwards in edges for k in range(len(corners))]
            )
            if flat > 1e-9 * np.abs(sides).max() or (turns < -1e-9 * np.abs(turns).max()).any():
                raise ValueError("a polygon must be flat and convex, its vertices in order around it; cut by several")
    size = np.linalg.norm(normal)
    if not size > 0:
        raise ValueError(f"{type(surface).__name__} has no extent or no direction: {surface}")
    return point, normal / size, [(p, d / np.linalg.norm(d)) for p, d in edges]


def crossed(families: Families, surface: Surface) -> np.ndarray:
    """Which slots (points, bonds) hold a bond that crosses the surface; see `cut` for what is refused."""
    if not isinstance(surface, Surface):
        raise ValueError(f"surface must be a pdjax.Plane, Segment or Polygon; got {type(surface).__name__}")
    if families.dim not in _DIMS[type(surface)]:
        raise ValueError(
            f"a {type(surface).__name__} cuts bodies of dim {_DIMS[type(surface)]}; this one has dim {families.dim}"
        )
    families.need_arrays()
    if families.positions is None or not is_concrete(families):
        raise ValueError("cut needs families whose positions are known, as `families` makes them, outside of jit")
    point, normal, edges = _plane(surface)
    if point.shape != (families.dim,) or normal.shape != (families.dim,):
        raise ValueError(f"the surface must lie in the body's dim {families.dim}; got {surface}")
    X, xi = np.asarray(families.positions, float), np.asarray(families.xi, float)
    height = (X - point) @ normal
    tie = 1e-6 * float(families.horizon) if families.dtype == np.float32 else 1e-9 * float(families.horizon)
    inside = np.all([(X - p) @ d >= -tie for p, d in edges], axis=0) if edges else np.ones(len(X), bool)
    on = np.flatnonzero((np.abs(height) <= tie) & inside)
    if len(on):
        raise ValueError(
            f"the surface passes through {len(on)} points, the first is point {on[0]}: on which side are they?"
            " Move it by half a spacing"
        )
    beyond = height[:, None] + xi @ normal  # height of the far end, which in a periodic body may be an image
    with np.errstate(all="ignore"):
        share = height[:, None] / (height[:, None] - beyond)
    crosses = np.asarray(families.is_bond) & (height[:, None] * beyond < 0)
    at = X[:, None] + np.where(crosses, share, 0.0)[..., None] * xi
    for p, d in edges:
        crosses &= (at - p) @ d >= 0
    back = np.asarray(families.neighbours), np.asarray(families.reverse)
    return crosses | crosses[back]  # through the very edge, rounding may see it from one end alone


@public_function
def cut(families: Families, surface: Surface) -> Families:
    """The families with all bonds cut that cross a surface: a crack from the start.

    Arguments: families of a body; surface a `Plane`, in 2D also a `Segment`, in 3D also a `Polygon`.
    Returns: families whose cut bonds weigh 0 from both ends.
    Raises: ValueError for a surface of another dimension or without extent, one that passes through points, one that
        crosses no bond, families that are traced or have no arrays.
    Example: `pd.cut(families, pd.Segment((0.0, 0.5), (0.5, 0.5)))`.
    """
    crosses = crossed(families, surface)
    if not crosses.any():
        raise ValueError(f"no bond crosses the surface {surface}: is it inside the body?")
    return families.with_weight(np.where(crosses, 0.0, 1.0))
