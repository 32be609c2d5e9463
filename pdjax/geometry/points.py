"""Points of a body: reference positions X_i and volumes V_i.

A meshfree body is a set of points X_i, each with a volume V_i. On a lattice of spacing h every point sits in the middle
of a cell. A body of n cells along an axis therefore fills [0, n h], and V_i = h^dim.

Positions are NumPy arrays in double precision, because the neighbour search runs on the host. Only the arrays of the
families, which are made from the points, can be traced and differentiated.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .._internal.checks import finite
from .._internal.public import public_function


class Points(eqx.Module):
    """Reference positions and volumes of the points of a body.

    `lattice`, `bar`, `plate`, `cuboid` and `cloud` make them.

    Attributes
    ----------
    positions : array, shape (points, dim)
        Reference positions X_i [length].
    volumes : array, shape (points,)
        Volumes V_i [length^dim].
    spacing : float or None
        Spacing [length] of a lattice, None for a cloud.
    shape : tuple of int or None
        Number of cells along each axis of a lattice whose cells are all filled, else None.
    period : tuple of float or None
        Box lengths [length] along each axis, inf along an axis that is not periodic. None if no axis is periodic.
    cells : tuple of int or None
        Number of cells along each axis of the lattice, filled or not.
    sites : array of int, shape (points,), or None
        Number of the cell of each point, counted in row-major order, if a mask left cells empty or the points have
        another order.
    precision : float
        Error of the coordinates [length] if their dtype had fewer digits than double precision, else 0.
    origin : tuple of float or None
        Corner [length] of the first cell of a lattice that does not start at the origin of the coordinates.

    Examples
    --------
    >>> body = pd.lattice((5, 4), spacing=0.5)
    >>> len(body), body.dim, float(body.volumes.sum())
    (20, 2, 5.0)
    """

    positions: np.ndarray
    volumes: np.ndarray
    spacing: float | None = eqx.field(static=True, default=None)
    shape: tuple[int, ...] | None = eqx.field(static=True, default=None)
    period: tuple[float, ...] | None = eqx.field(static=True, default=None)
    cells: tuple[int, ...] | None = eqx.field(static=True, default=None)
    sites: np.ndarray | None = None
    precision: float = eqx.field(static=True, default=0.0)
    origin: tuple[float, ...] | None = eqx.field(static=True, default=None)

    def __repr__(self) -> str:
        spacing = "" if self.spacing is None else f", spacing {self.spacing:g}"
        return f"Points({len(self)} points, {self.dim}D{spacing})"

    @property
    def dim(self) -> int:
        """Number of space dimensions: 1, 2 or 3."""
        return self.positions.shape[1]

    @property
    def uniform(self) -> bool:
        """Whether all points are centres of lattice cells and have the volume of a cell."""
        if self.cells is None or self.spacing is None:
            return False
        sites = np.arange(len(self)) if self.sites is None else self.sites
        centres = (np.stack(np.unravel_index(sites, self.cells), axis=1) + 0.5) * self.spacing
        if self.origin is not None:
            centres += np.array(self.origin)
        return bool(
            np.allclose(self.positions, centres, rtol=0, atol=1e-9 * self.spacing)
            and np.allclose(self.volumes, self.spacing**self.dim, rtol=1e-9, atol=0)
        )

    def __len__(self) -> int:
        return self.positions.shape[0]


def check_body(name: str, body: object) -> None:
    """Raise ValueError if `body` is no `Points`."""
    if not isinstance(body, Points):
        raise ValueError(f"{name} must be Points (lattice, bar, plate, cuboid, cloud); got {type(body).__name__}")


@public_function
def cloud(positions, volumes, period: Sequence[float] | None = None) -> Points:
    """Make a body from any set of points.

    Parameters
    ----------
    positions : array, shape (points, dim)
        Reference positions [length] in 1, 2 or 3 dimensions.
    volumes : array, shape (points,), or float
        Volumes [length^dim], or one volume for all points.
    period : sequence of float, length dim, optional
        Box lengths of a periodic body [length], inf along an axis that is not periodic.

    Returns
    -------
    Points
        The body. The arrays are copied.

    Raises
    ------
    ValueError
        If a shape is wrong, a number is not finite, or a volume or period is not positive.

    Notes
    -----
    The dtype of `positions` tells how many digits are known. With float32, `families` allows for larger rounding
    errors when it compares lengths with the horizon. `families` also finds coinciding points.

    Examples
    --------
    >>> body = pd.cloud([[0.0, 0.0], [1.0, 0.0], [0.4, 0.9]], volumes=0.5)
    >>> len(body), body.volumes.tolist()
    (3, [0.5, 0.5, 0.5])
    """
    given = np.asarray(positions).dtype
    positions = finite("positions", positions)
    if positions.ndim != 2 or positions.shape[1] not in (1, 2, 3) or positions.shape[0] == 0:
        raise ValueError(f"positions must have shape (points, dim) with dim 1, 2 or 3; got {positions.shape}")
    volumes = finite("volumes", volumes)
    if volumes.shape not in ((), (len(positions),)):
        raise ValueError(f"volumes must be one number or {len(positions)} of them; got shape {volumes.shape}")
    volumes = np.broadcast_to(volumes, (len(positions),)).copy()
    if (volumes <= 0).any():
        raise ValueError(f"volumes must be > 0; point {int(np.argmin(volumes))} has {volumes.min()}")
    eps = np.finfo(given).eps if given.kind == "f" else 0.0
    precision = float(eps * np.abs(positions).max())
    if period is None:
        return Points(positions, volumes, precision=precision)
    period = tuple(float(p) for p in np.atleast_1d(period))
    if len(period) != positions.shape[1] or not all(p > 0 for p in period):
        raise ValueError(f"period must hold {positions.shape[1]} lengths > 0 (inf: not periodic); got {period}")
    return Points(positions, volumes, period=period, precision=precision)


@public_function
def lattice(shape: Sequence[int], spacing: float = 1.0, periodic: bool | Sequence[bool] = False, mask=None) -> Points:
    """Make a body whose points are the cells of a uniform lattice.

    Parameters
    ----------
    shape : sequence of int, length dim
        Number of cells along each of 1 to 3 axes.
    spacing : float, optional
        Side h of a cell [length]. The body fills [0, shape · h], and its points are the cell centres.
    periodic : bool or sequence of bool, optional
        Whether opposite ends of the body are joined, for all axes or for each axis.
    mask : array of bool, shape `shape`, optional
        Cells to keep; all by default. It makes bodies of any outline.

    Returns
    -------
    Points
        The points in row-major order: the last axis runs fastest.

    Raises
    ------
    ValueError
        If shape, spacing, periodic or mask is out of range or has the wrong size.

    Examples
    --------
    >>> body = pd.lattice((5, 4), spacing=0.5)
    >>> body.positions[:3].tolist()
    [[0.25, 0.25], [0.25, 0.75], [0.25, 1.25]]

    A mask leaves one cell empty.

    >>> len(pd.lattice((5, 4), mask=np.arange(20).reshape(5, 4) != 7))
    19
    """
    shape = tuple(int(n) for n in shape)
    if len(shape) not in (1, 2, 3) or min(shape) < 1:
        raise ValueError(f"shape must hold 1, 2 or 3 counts >= 1; got {shape}")
    if not (math.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing must be finite and > 0; got {spacing}")
    flags = (periodic,) * len(shape) if isinstance(periodic, bool) else tuple(periodic)
    if len(flags) != len(shape):
        raise ValueError(f"periodic must be one flag or {len(shape)} of them; got {flags}")
    axes = np.meshgrid(*[(np.arange(n) + 0.5) * spacing for n in shape], indexing="ij")
    positions = np.stack([axis.reshape(-1) for axis in axes], axis=1)
    volumes = np.full(len(positions), spacing ** len(shape))
    period = tuple(n * spacing if flag else math.inf for n, flag in zip(shape, flags, strict=True))
    box = period if any(flags) else None
    if mask is None:
        return Points(positions, volumes, float(spacing), shape, box, shape)
    mask = np.asarray(mask)
    if mask.shape != shape or mask.dtype != bool or not mask.any():
        raise ValueError(
            f"mask must hold one bool for each of the {shape} cells, not all False; got {mask.dtype} {mask.shape}"
        )
    sites = np.flatnonzero(mask.reshape(-1))
    return Points(positions[sites], volumes[sites], float(spacing), None, box, shape, sites)


def _box(lengths: Sequence[float], spacing: float) -> Points:
    lengths = finite("lengths", lengths).tolist()
    if not spacing > 0:
        raise ValueError(f"spacing must be finite and > 0; got {spacing}")
    counts = [length / spacing for length in lengths]
    shape = [round(c) for c in counts]
    for length, count, n in zip(lengths, counts, shape, strict=True):
        if n < 1 or abs(count - n) > 1e-6 * n:
            raise ValueError(f"every length must be a whole number of spacings; {length} / {spacing} = {count}")
    return lattice(shape, spacing)


@public_function
def bar(n: int, length: float = 1.0) -> Points:
    """Make a 1D bar of `n` equally spaced points that fills [0, length].

    Parameters
    ----------
    n : int
        Number of points. The spacing is length / n.
    length : float, optional
        Length of the bar [length].

    Returns
    -------
    Points
        A lattice in 1D.

    Raises
    ------
    ValueError
        If n < 1, or the length is not finite and > 0.

    Examples
    --------
    >>> pd.bar(4).positions.ravel().tolist()
    [0.125, 0.375, 0.625, 0.875]
    """
    if n < 1:
        raise ValueError(f"n must be >= 1; got {n}")
    return lattice((n,), length / n)


@public_function
def plate(lengths: Sequence[float], spacing: float) -> Points:
    """Make a 2D rectangle filled by a uniform lattice.

    Parameters
    ----------
    lengths : sequence of float, length 2
        Sides of the rectangle [length]. Each must be a whole number of spacings.
    spacing : float
        Spacing of the lattice [length].

    Returns
    -------
    Points
        A lattice in 2D, with a corner at the origin.

    Raises
    ------
    ValueError
        If a length is no whole number of spacings, or a number is not finite and > 0.

    Examples
    --------
    >>> pd.plate((2.5, 2.0), spacing=0.5).shape
    (5, 4)
    """
    if len(lengths) != 2:
        raise ValueError(f"lengths of a plate must be two numbers; got {tuple(lengths)}")
    return _box(lengths, spacing)


@public_function
def cuboid(lengths: Sequence[float], spacing: float) -> Points:
    """Make a 3D cuboid filled by a uniform lattice.

    Parameters
    ----------
    lengths : sequence of float, length 3
        Sides of the cuboid [length]. Each must be a whole number of spacings.
    spacing : float
        Spacing of the lattice [length].

    Returns
    -------
    Points
        A lattice in 3D, with a corner at the origin.

    Raises
    ------
    ValueError
        If a length is no whole number of spacings, or a number is not finite and > 0.

    Examples
    --------
    >>> pd.cuboid((1.0, 1.5, 2.0), spacing=0.5).shape
    (2, 3, 4)
    """
    if len(lengths) != 3:
        raise ValueError(f"lengths of a cuboid must be three numbers; got {tuple(lengths)}")
    return _box(lengths, spacing)
