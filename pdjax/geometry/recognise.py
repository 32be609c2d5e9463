"""The uniform lattice that positions are taken from, found from the positions.

Along each axis the distinct coordinates must be whole multiples of one spacing apart, up to the rounding of their
digits. Every point must have a neighbour at the distance of the spacing along an axis, so that scattered points whose
coordinates have few digits are not taken for a lattice.
"""

from typing import NamedTuple

import numpy as np

from .points import Points

LARGEST_SHIFT = 1e-3  # spacings; larger distances from the lattice are not rounding
EXACT = 1e-10  # spacings; positions this close to the lattice stay as they are
MOST_CELLS = 64  # cells for each point; a sparser set of points is no lattice
SINGLE = 2.0**-22  # rounding of single precision, with some reserve; closer coordinates are the same
SAMPLE = 1000  # numbers whose digits are counted


class Recognised(NamedTuple):
    """A lattice found from positions.

    spacing: h [length]. cells: number along each axis. sites: cell of each point in row-major order. origin: corner of
    the first cell [length]. centres: the positions, moved to the exact lattice if they are off by more than EXACT.
    moved: largest distance of a coordinate from the exact lattice [length].
    """

    spacing: float
    cells: tuple[int, ...]
    sites: np.ndarray
    origin: tuple[float, ...]
    centres: np.ndarray
    moved: float

    def body(self, volumes: np.ndarray, rounding: float = 0.0) -> Points | None:
        """The lattice as a body in the order of the points, or None if a volume is not that of a cell.

        `rounding` is the error of the volumes. That of the coordinates, and so of the volume of a cell, comes on top.
        """
        dim = len(self.cells)
        cell = self.spacing**dim
        near = max(1e-9, rounding / cell, 2 * dim * self.moved / self.spacing)
        if not np.allclose(volumes, cell, rtol=min(near, LARGEST_SHIFT / 10), atol=0):
            return None
        full = len(self.sites) == np.prod(self.cells) and bool((np.diff(self.sites) == 1).all())
        return Points(
            self.centres,
            volumes if np.allclose(volumes, cell, rtol=EXACT, atol=0) else np.full(len(volumes), cell),
            self.spacing,
            self.cells if full else None,
            None,
            self.cells,
            None if full else self.sites,
            origin=self.origin if any(self.origin) else None,
        )


def rounding(values: np.ndarray) -> float:
    """Half a unit in the last decimal digit of the largest of the values, by the digits that they are written with."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0:
        return 0.0
    flat = np.abs(values.reshape(-1)[:: max(1, values.size // SAMPLE)])
    flat = np.append(flat, largest)
    flat = flat[flat > np.finfo(float).tiny / np.finfo(float).eps]  # smaller numbers have no digits to count
    exponents = np.floor(np.log10(flat))
    for digits in range(1, 16):
        unit = 10.0 ** (exponents - digits + 1)
        if np.allclose(np.round(flat / unit) * unit, flat, rtol=1e-15 * 4, atol=0):
            return 0.5 * 10.0 ** (np.floor(np.log10(largest)) - digits + 1)
    return 4 * float(np.finfo(float).eps) * largest


def recognised(positions: np.ndarray, spacing: float | None = None) -> Recognised:
    """Find the uniform lattice of positions (points, dim). Raises ValueError with the reason if there is none."""
    with np.errstate(all="ignore"):  # what overflows is not finite and is refused
        return _recognised(positions, spacing)


def _recognised(positions: np.ndarray, spacing: float | None) -> Recognised:
    low = positions.min(axis=0)
    reach = positions - low
    noise = SINGLE * float(np.abs(positions).max())
    if spacing is not None and not (np.isfinite(spacing) and spacing > 0):
        raise ValueError(f"spacing must be finite and > 0; got {spacing}")
    layers = [_layers(x, noise) for x in reach.T]
    gaps = np.concatenate([np.diff(at) for at, _ in layers])
    if not gaps.size and spacing is None:
        raise ValueError("the points do not differ by more than the rounding of their coordinates")
    h = float(gaps.min()) if spacing is None else float(spacing)
    if gaps.size and not gaps.max() / h <= 2**31:
        raise ValueError(f"the points lie {gaps.max() / h:.3g} spacings of {h:g} apart")
    steps = [np.concatenate([[0.0], np.cumsum(np.round(np.diff(at) / h))]) for at, _ in layers]
    cells = tuple(int(step[-1]) + 1 for step in steps)
    if np.prod(np.array(cells, dtype=float)) > MOST_CELLS * len(positions):
        raise ValueError(
            f"coordinates differ by as little as {h:.9g}, and a lattice of this spacing has"
            f" {' × '.join(map(str, cells))} cells for {len(positions)} points"
        )
    index = np.stack([step[layer] for step, (_, layer) in zip(steps, layers, strict=True)], axis=1)
    if spacing is None:
        h = _fitted(reach, index, h)
    error = min(max(2 * rounding(positions), noise), LARGEST_SHIFT * h)
    shift = low + _mean_shift(reach, index, h)  # centre of the first cell
    shift = _simple(shift, h, error)
    centres = shift + index * h
    away = np.abs(positions - centres)
    if not away.max() <= error:
        k, axis = np.unravel_index(int(np.argmax(away)), away.shape)
        raise ValueError(
            f"the {'xyz'[axis]} coordinate of point {k}, {positions[k, axis]:.9g}, is {away.max() / h:.2g} spacings of"
            f" {h:.9g} from the lattice"
        )
    index = index.astype(np.int64)
    sites = np.ravel_multi_index(tuple(index.T), cells)
    _refuse_scattered(sites, cells, h)
    origin = tuple(0.0 if abs(x) < 1e-9 * h else float(x) for x in shift - h / 2)
    if away.max() <= EXACT * h:
        centres = positions
    return Recognised(h, cells, sites, origin, centres, float(away.max()))


def _layers(x: np.ndarray, noise: float) -> tuple[np.ndarray, np.ndarray]:
    """The different coordinates along an axis, in ascending order, and which of them each point has."""
    order = np.argsort(x)
    new = np.concatenate([[False], np.diff(x[order]) > noise])
    layer = np.empty(len(x), dtype=np.int64)
    layer[order] = np.cumsum(new)
    return x[order][np.concatenate([[0], np.flatnonzero(new)])], layer


def _fitted(reach: np.ndarray, index: np.ndarray, h: float) -> float:
    """The spacing from the longest axis, in as few decimal digits as rounding allows."""
    axis = int(np.argmax(index.max(axis=0)))
    count = float(index[:, axis].max())
    if count == 0:
        return h
    fitted = float(reach[:, axis].max()) / count
    for digits in range(1, 17):
        short = float(f"{fitted:.{digits}g}")
        if abs(short - fitted) <= 1e-15 * fitted:
            return short
    return fitted


def _mean_shift(reach: np.ndarray, index: np.ndarray, h: float) -> np.ndarray:
    left = reach - index * h
    return (left.max(axis=0) + left.min(axis=0)) / 2


def _simple(shift: np.ndarray, h: float, error: float) -> np.ndarray:
    """The centre of the first cell, moved within the error to a whole multiple of half the spacing if there is one."""
    half = np.round(2 * shift / h) * h / 2
    return np.where(np.abs(half - shift) <= error, half, shift)


def _refuse_scattered(sites: np.ndarray, cells: tuple[int, ...], h: float) -> None:
    """Raise ValueError if a point has no neighbour along an axis."""
    if len(sites) == 1:
        raise ValueError("a single point has no spacing")
    filled = np.zeros(cells, dtype=bool)
    filled.reshape(-1)[sites] = True
    if int(filled.sum()) < len(sites):
        raise ValueError(f"two points lie in the same cell of a lattice of spacing {h:.9g}")
    beside = np.zeros(cells, dtype=bool)
    for axis in range(len(cells)):
        ahead = tuple(slice(1, None) if k == axis else slice(None) for k in range(len(cells)))
        behind = tuple(slice(None, -1) if k == axis else slice(None) for k in range(len(cells)))
        beside[behind] |= filled[ahead]
        beside[ahead] |= filled[behind]
    alone = np.flatnonzero(~beside.reshape(-1)[sites])
    if alone.size:
        raise ValueError(
            f"point {alone[0]} has no neighbour at the spacing {h:.9g} along an axis ({alone.size} such points)"
        )
