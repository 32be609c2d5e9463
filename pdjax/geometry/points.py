"""Points: where the matter of a body is, and how much of it each point carries.

A meshfree body is a set of points X_i with volumes V_i. On a lattice of spacing h every point sits in
the middle of its cell, so a body of n cells along an axis fills [0, n h] and V_i = h^dim.
Positions stay NumPy arrays in double precision: they feed the neighbour search on the host; what is
traced and differentiated starts with the families.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import numpy as np

from .._internal.checks import finite
from .._internal.public import public_function


class Points(eqx.Module):
    """Reference positions (points, dim) [length] and volumes (points,) [length^dim] of a body.

    `spacing` and `shape` are set for lattices, `shape` only where every cell is filled; `period` holds the box
    lengths of the periodic directions (inf where not periodic), or is None. A body cut out of a lattice keeps the
    `cells` it was cut from and its `sites` (points,), their numbers in row-major order. `precision` [length] is how
    far the coordinates may be off, where they came as numbers of few digits (0: as double precision has them).
    """

    positions: np.ndarray
    volumes: np.ndarray
    spacing: float | None = eqx.field(static=True, default=None)
    shape: tuple[int, ...] | None = eqx.field(static=True, default=None)
    period: tuple[float, ...] | None = eqx.field(static=True, default=None)
    cells: tuple[int, ...] | None = eqx.field(static=True, default=None)
    sites: np.ndarray | None = None
    precision: float = eqx.field(static=True, default=0.0)

    @property
    def dim(self) -> int:
        return self.positions.shape[1]

    @property
    def uniform(self) -> bool:
        """Whether the points are still the cells of a lattice, all with the volume of a cell."""
        if self.cells is None or self.spacing is None:
            return False
        sites = np.arange(len(self)) if self.sites is None else self.sites
        centres = (np.stack(np.unravel_index(sites, self.cells), axis=1) + 0.5) * self.spacing
        return bool(
            np.allclose(self.positions, centres, rtol=0, atol=1e-9 * self.spacing)
            and np.allclose(self.volumes, self.spacing**self.dim, rtol=1e-9, atol=0)
        )

    def __len__(self) -> int:
        return self.positions.shape[0]


def check_body(name: str, body: object) -> None:
    """Refuse what is no set of points."""
    if not isinstance(body, Points):
        raise ValueError(f"{name} must be Points (lattice, bar, plate, cuboid, cloud); got {type(body).__name__}")


@public_function
def cloud(positions, volumes, period: Sequence[float] | None = None) -> Points:
    """Any set of points.

    Arguments: positions (points, dim) [length], dim 1 to 3, whose dtype tells how many digits are known; volumes
        (points,) or one number [length^dim]; period (dim,) box lengths of a periodic set [length], inf where it is not
        periodic.
    Raises: ValueError for a wrong shape, NaN, a volume or period ≤ 0. Duplicates are found by `families`.
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
    """A uniform lattice of `shape` cells (one number an axis, 1 to 3 axes) of side `spacing` [length].

    `periodic` (for all axes, or one flag each) joins opposite ends: the box is shape * spacing long.
    `mask` (bools of `shape`; None: all) keeps a part of the cells: a body of any shape on the lattice.
    Points are in row-major order: the last axis runs fastest.
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
    """A 1D bar of `n` points filling [0, length]; spacing length / n."""
    if n < 1:
        raise ValueError(f"n must be >= 1; got {n}")
    return lattice((n,), length / n)


@public_function
def plate(lengths: Sequence[float], spacing: float) -> Points:
    """A 2D rectangle of `lengths` (2,) [length] filled by a lattice of `spacing`."""
    if len(lengths) != 2:
        raise ValueError(f"lengths of a plate must be two numbers; got {tuple(lengths)}")
    return _box(lengths, spacing)


@public_function
def cuboid(lengths: Sequence[float], spacing: float) -> Points:
    """A 3D cuboid of `lengths` (3,) [length] filled by a lattice of `spacing`."""
    if len(lengths) != 3:
        raise ValueError(f"lengths of a cuboid must be three numbers; got {tuple(lengths)}")
    return _box(lengths, spacing)
