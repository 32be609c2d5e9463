"""The body of a file: its dimension, the checks of its points, and its volumes, the same for all formats."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from .._internal.checks import choice, finite
from ..geometry.points import Points, cloud
from ..geometry.recognise import Recognised, recognised, rounding
from ..geometry.voronoi import voronoi_volumes
from .contents import Contents

FLAT = 1e-9  # a coordinate is constant if it varies by less than this fraction of the largest extent
LARGEST = 1e100  # of a coordinate; the cube of a larger one overflows
WAYS = (
    'pass volume= a number or an array, volume="voronoi" with outline=, or volume="lattice" for points of a uniform'
    " lattice"
)


def body_from(
    path: Path, contents: Contents, volume: object, outline: object, spacing: float | None, dim: int | None
) -> tuple[Points, tuple[int, ...], tuple[str, ...]]:
    """Make the body of a file. Returns it with the components of the coordinates that it has, and notes.

    Raises ValueError that names the place in the file if a point or a volume is wrong.
    """
    if outline is not None and not (isinstance(volume, str) and volume == "voronoi"):
        raise ValueError('outline is for Voronoi cells; pass volume="voronoi" too, or leave outline out')
    if volume is not None and contents.uncertain:
        raise ValueError(f"{path}: with volume= it must be certain what the columns are, but {contents.uncertain}")
    notes = list(contents.notes)
    if volume is not None and contents.volumes is not None:
        notes.append("The volumes of the file are not used.")
    positions = _checked_positions(path, contents)
    axes = _axes(path, positions, dim)
    if len(axes) < positions.shape[1]:
        names = " and ".join("xyz"[k] for k in range(positions.shape[1]) if k not in axes)
        verb = "are" if " and " in names else "is"
        notes.append(f"{names} {verb} the same for all points and left out: the body is {len(axes)}D.")
    positions = np.ascontiguousarray(positions[:, axes])
    _refuse_coinciding(path, positions, contents.where)
    if isinstance(volume, str):
        choice("volume", volume, ("voronoi", "lattice"))
    lattice: Recognised | None = None
    try:
        lattice = recognised(positions, spacing)
    except ValueError as error:
        if isinstance(volume, str) and volume == "lattice":
            raise ValueError(f'{path}: volume="lattice" needs a uniform lattice, but {error}; {WAYS}') from None
        if spacing is not None:
            raise ValueError(f"{path}: spacing= is for a uniform lattice, but {error}; leave spacing out") from None
    volumes = _volumes(path, contents, positions, volume, outline, lattice, notes)
    if lattice is not None:
        body = lattice.body(volumes, rounding(volumes) if volume is None else 0.0)
        if body is not None:
            cells = " × ".join(map(str, lattice.cells))
            empty = int(np.prod(lattice.cells)) - len(body)
            notes.append(
                f"The points are a uniform lattice of {cells} cells"
                + (f", {empty} of them empty," if empty else "")
                + f" with spacing {lattice.spacing:.6g}."
            )
            if lattice.moved > 1e-12 * lattice.spacing:
                notes.append(
                    "Their positions are those of the exact lattice, up to"
                    f" {lattice.moved / lattice.spacing:.1e} spacings from those in the file, whose digits are rounded."
                )
            return body, axes, tuple(notes)
        notes.append(
            f"The points are those of a lattice with spacing {lattice.spacing:.6g}, but their volumes are not"
            f' spacing^{len(axes)}, so the body is a cloud. volume="lattice" makes it a lattice.'
        )
    return cloud(positions, volumes), axes, tuple(notes)


def _checked_positions(path: Path, contents: Contents) -> np.ndarray:
    positions = np.asarray(contents.positions, dtype=float)
    if positions.ndim != 2 or positions.shape[1] not in (1, 2, 3) or len(positions) == 0:
        raise ValueError(f"{path}: expected at least one point in 1 to 3 dimensions; got positions {positions.shape}")
    bad = np.flatnonzero(~(np.abs(positions) < LARGEST).all(axis=1))  # NaN is not smaller
    if bad.size:
        k = int(bad[0])
        raise ValueError(
            f"{path}, {contents.where(k)}: expected finite coordinates below {LARGEST:g}; got {positions[k].tolist()}"
            f" ({bad.size} such points); correct or remove them"
        )
    return positions


def _axes(path: Path, positions: np.ndarray, dim: int | None) -> tuple[int, ...]:
    """The components of the coordinates that the body has."""
    components = positions.shape[1]
    extents = np.ptp(positions, axis=0)
    varying = [k for k in range(components) if extents[k] > FLAT * extents.max()]
    if not varying:  # a single point
        varying = list(range(components))
    if dim is None:
        return tuple(varying)
    if dim not in (1, 2, 3) or dim > components:
        raise ValueError(f"dim must be from 1 to {components}, the number of coordinates in {path}; got {dim}")
    if dim < len(varying) and extents.max() > 0:
        told = ", ".join(f"{'xyz'[k]} by {extents[k]:g}" for k in varying)
        raise ValueError(f"dim must be at least {len(varying)} for {path}, whose coordinates vary: {told}; got {dim}")
    constant = [k for k in range(components) if k not in varying]
    return tuple(sorted((varying + constant)[:dim]))


def _refuse_coinciding(path: Path, positions: np.ndarray, where: Callable[[int], str]) -> None:
    with np.errstate(over="ignore", invalid="ignore"):
        keys = np.sort(
            sum(x * weight for x, weight in zip(positions.T, (1.0, 0.7548776662, 0.5698402910), strict=False))
        )
        if (keys[1:] > keys[:-1]).all():  # points that coincide have the same sum
            return
    order = np.lexsort(positions.T)
    same = np.flatnonzero((positions[order[1:]] == positions[order[:-1]]).all(axis=1))
    if same.size:
        i, j = sorted((int(order[same[0]]), int(order[same[0] + 1])))
        raise ValueError(
            f"{path}: points must be distinct; {where(i)} and {where(j)} have the same position"
            f" {positions[i].tolist()} ({same.size} such pairs); remove one of each pair"
        )


def _volumes(
    path: Path,
    contents: Contents,
    positions: np.ndarray,
    volume: object,
    outline: object,
    lattice: Recognised | None,
    notes: list[str],
) -> np.ndarray:
    points, dim = positions.shape
    if isinstance(volume, str):
        if volume == "voronoi":
            notes.append("The volumes are those of the Voronoi cells within the outline.")
            return voronoi_volumes(positions, outline)
        assert lattice is not None
        notes.append(f"The volumes are spacing^{dim}.")
        return np.full(points, lattice.spacing**dim)
    if volume is not None:
        given = finite("volume", volume)
        if given.shape not in ((), (points,)):
            raise ValueError(f"volume must be one number or {points} of them; got shape {given.shape}")
        if (given <= 0).any():
            raise ValueError(f"volume must be > 0; got {given.min()}")
        return np.broadcast_to(given, (points,)).copy()
    if contents.volumes is None:
        raise ValueError(f"{path} has no volumes; {WAYS}")
    volumes = np.array(contents.volumes, dtype=float)
    bad = np.flatnonzero(~(np.isfinite(volumes) & (volumes > 0)))
    if bad.size:
        k = int(bad[0])
        told = " ".join(contents.notes)
        raise ValueError(
            f"{path}, {contents.where(k)}: expected a volume that is finite and > 0; got {volumes[k]} ({bad.size} such"
            f" points); correct it, or pass volume=. {told}".rstrip()
        )
    return volumes
