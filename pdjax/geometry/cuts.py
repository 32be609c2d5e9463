"""Initial cracks: `cut` removes the bonds that cross a plane, a straight segment in 2D or a flat polygon in 3D.

A bond is cut if the straight line between its ends crosses the surface. Its weight becomes 0 in the families of both
ends. A point that loses all its bonds is a fragment without force (`pdjax.models.pointwise`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._internal.checks import finite, is_concrete
from .._internal.public import public_function
from .bonds import Families


class Plane(NamedTuple):
    """Unbounded plane for `cut`: a plane in 3D, a line in 2D, a point in 1D.

    Parameters
    ----------
    point : array, shape (dim,)
        A point of the plane [length].
    normal : array, shape (dim,)
        Vector at right angles to the plane, of any length > 0.

    Examples
    --------
    The line x = 2 separates a plate of 5 × 4 points into two parts. It cuts 4 bonds, each in the families of 2 points.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=1.0)
    >>> parts = pd.cut(families, pd.Plane(point=(2.0, 0.0), normal=(1.0, 0.0)))
    >>> float(families.weight.sum() - parts.weight.sum())
    8.0
    """

    point: ArrayLike
    normal: ArrayLike


class Segment(NamedTuple):
    """Straight segment for `cut` in 2D.

    Parameters
    ----------
    start, end : array, shape (2,)
        Ends of the segment [length].

    Examples
    --------
    A crack of length 2 cuts 2 bonds, each in the families of 2 points.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=1.0)
    >>> cracked = pd.cut(families, pd.Segment(start=(0.0, 2.0), end=(2.0, 2.0)))
    >>> float(families.weight.sum() - cracked.weight.sum())
    4.0
    """

    start: ArrayLike
    end: ArrayLike


class Polygon(NamedTuple):
    """Flat convex polygon for `cut` in 3D.

    Parameters
    ----------
    vertices : array, shape (3 or more, 3)
        Vertices [length], in order around the polygon.

    Examples
    --------
    A square of side 2 cuts 4 bonds, each in the families of 2 points.

    >>> families = pd.families(pd.lattice((3, 3, 2)), horizon=1.0)
    >>> cracked = pd.cut(families, pd.Polygon([(0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]))
    >>> float(families.weight.sum() - cracked.weight.sum())
    8.0
    """

    vertices: ArrayLike


Surface = Plane | Segment | Polygon
_DIMS = {Plane: (1, 2, 3), Segment: (2,), Polygon: (3,)}


def _plane(surface: Surface) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """A point of the plane, its unit normal and its edges. An edge is a point and the unit vector pointing inwards."""
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
                raise ValueError("a polygon must be flat and convex, with vertices in order; divide it into several")
    size = np.linalg.norm(normal)
    if not size > 0:
        raise ValueError(f"{type(surface).__name__} has no extent or no direction: {surface}")
    return point, normal / size, [(p, d / np.linalg.norm(d)) for p, d in edges]


def crossed(families: Families, surface: Surface) -> np.ndarray:
    """Whether each slot (points, bonds) holds a bond that crosses the surface. `cut` lists the errors."""
    if not isinstance(surface, Surface):
        raise ValueError(f"surface must be a pdjax.Plane, Segment or Polygon; got {type(surface).__name__}")
    if families.dim not in _DIMS[type(surface)]:
        raise ValueError(
            f"a {type(surface).__name__} cuts bodies of dim {_DIMS[type(surface)]}; this one has dim {families.dim}"
        )
    families.need_arrays()
    if families.positions is None or not is_concrete(families):
        raise ValueError("cut needs families with known positions; pass what `families` returns, outside of jit")
    point, normal, edges = _plane(surface)
    if point.shape != (families.dim,) or normal.shape != (families.dim,):
        raise ValueError(f"the surface must lie in the body's dim {families.dim}; got {surface}")
    X, xi = np.asarray(families.positions, float), np.asarray(families.xi, float)
    height = (X - point) @ normal
    tie = (1e-6 if families.dtype == np.float32 else 1e-9) * float(np.max(np.asarray(families.horizon)))
    inside = np.all([(X - p) @ d >= -tie for p, d in edges], axis=0) if edges else np.ones(len(X), bool)
    on = np.flatnonzero((np.abs(height) <= tie) & inside)
    if len(on):
        raise ValueError(
            f"the surface passes through {len(on)} points, the first is point {on[0]}, so their side is undecided;"
            " move the surface by half a spacing"
        )
    beyond = height[:, None] + xi @ normal  # height of the far end, which may be an image in a periodic body
    with np.errstate(all="ignore"):
        share = height[:, None] / (height[:, None] - beyond)
    crosses = np.asarray(families.is_bond) & (height[:, None] * beyond < 0)
    at = X[:, None] + np.where(crosses, share, 0.0)[..., None] * xi
    for p, d in edges:
        crosses &= (at - p) @ d >= -tie  # a bond through the edge itself is cut, whatever the rounding
    back = np.asarray(families.neighbours), np.asarray(families.reverse)
    return crosses | crosses[back]  # at the surface's edge, rounding may find a bond from one end only


@public_function
def cut(families: Families, surface: Surface) -> Families:
    """Cut all bonds that cross a surface, to make an initial crack.

    Parameters
    ----------
    families : Families
        Families of a body, from `families`.
    surface : Plane or Segment or Polygon
        The crack. A `Segment` needs a body in 2D, a `Polygon` one in 3D.

    Returns
    -------
    Families
        Copy of the families in which the cut bonds have weight 0 at both ends.

    Raises
    ------
    ValueError
        If the surface has another dimension than the body or no extent, passes through points, or crosses no bond.
        Also if the families are traced or were made with `arrays=False`.

    Notes
    -----
    A bond is cut if the straight line between its ends crosses the surface or touches its edge. Call `cut` again for a
    further crack.

    `cut` makes a body that was made with its crack: the bonds have never existed, and LPS takes its reference sums
    without them. For a crack that has grown, break the bonds: `families.with_broken(cracked.weight < families.weight)`.

    Examples
    --------
    A vertical crack in a bar of 2 × 4 points cuts one bond, in the families of both ends.

    >>> families = pd.families(pd.lattice((2, 4)), horizon=1.0)
    >>> cracked = pd.cut(families, pd.Segment((0.0, 2.0), (1.0, 2.0)))
    >>> i, slot = np.nonzero(np.asarray(cracked.weight) < np.asarray(families.weight))
    >>> list(zip(i.tolist(), np.asarray(families.neighbours)[i, slot].tolist()))
    [(1, 2), (2, 1)]
    """
    crosses = crossed(families, surface)
    if not crosses.any():
        raise ValueError(f"no bond crosses the surface {surface}; check that it lies inside the body")
    return families.with_weight(np.where(crosses, 0.0, 1.0))
