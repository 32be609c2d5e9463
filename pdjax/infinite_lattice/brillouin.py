"""Grid and search of the Brillouin zone.

The search looks for the wave vector k at which the largest eigenvalue of a symbol Ĵ(k), or its quotient by M κ², is
largest. M is the P-wave modulus, h the spacing and κ² = Σ_i ((2/h) sin(k_i h/2))². The search has four steps.

1. **Grid.** The grid has `intervals` steps from 0 to π/h along each axis. Every half-reciprocal point (a wave vector
   with components 0 or π/h) therefore lies on it exactly. The symmetry of the deformed lattice reduces the grid.
   Closed-form eigenvalues of the d × d blocks **screen** the grid: they only choose where to look, because they lose
   half of their digits at a double root.
2. **Starts.** The grid points are divided into classes. A class holds the points that are nearest to the same
   half-reciprocal point and whose components have the same signs. The best point of every class is a **start**, so
   that a narrow maximum near one half-reciprocal point is not hidden by a higher one elsewhere. The best point that is
   no neighbour of the best point of all is another start. Starts are moved a little off the grid, because
   half-reciprocal points are stationary by symmetry and may be saddle points.
3. **Climb.** Damped Newton steps with exact derivatives maximise eᵀA(k)e / eᵀe over k and e together, from all starts
   in one batch (`pdjax.infinite_lattice.climb`). This quotient is smooth even where eigenvalues cross.
4. **Decision.** `eigh` gives the eigenvalue at the best point found, whether it lies on the grid or not.

The limit k → 0 is searched in the same way over the directions of k.
"""

import contextlib
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._internal.checks import Numbers, Same, namespace

SYMMETRIES = ("cubic", "tetragonal", "orthorhombic", "inversion")


class Zone(NamedTuple):
    """The reduced grid of a Brillouin zone in units of 1/spacing and without k = 0. A trace sees constants."""

    grid: np.ndarray  # (waves, dim)
    members: np.ndarray  # (classes, most) indices of the grid points of each class, padded with its first
    axes: tuple[np.ndarray, ...]  # components along each axis of the rectangular box that contains the grid
    places: np.ndarray  # (waves,) indices of the grid points in the flattened box
    step: float
    intervals: int
    symmetry: str


_FINER: ContextVar[int] = ContextVar("finer grid", default=1)


@contextlib.contextmanager
def judging(factor: int = 2) -> Iterator[None]:
    """Judge a design anew: in the block, the default number of grid intervals is multiplied by `factor`.

    Smooth aggregates, which only guide a search, give way to the maxima that they bound (`is_judging`).
    """
    token = _FINER.set(factor)
    try:
        yield
    finally:
        _FINER.reset(token)


def is_judging() -> bool:
    """Whether a design is judged anew."""
    return _FINER.get() > 1


def default_intervals(N: float) -> int:
    """The default number of grid intervals over [0, π/h] for a horizon of N spacings: 8 for each spacing.

    The highest harmonic of a symbol of two rings is 2N, so that each of its half periods has 4 intervals.
    """
    return 8 * int(np.ceil(N - 1e-9)) * _FINER.get()


@lru_cache(maxsize=64)
def brillouin_zone(dim: int, intervals: int, symmetry: str = "inversion") -> Zone:
    """The grid, reduced by the part of the cubic symmetry that the deformed lattice has.

    `symmetry` is "cubic" if F is a multiple of I, "tetragonal" if F is diagonal and all stretches but the first are
    equal, "orthorhombic" if F is diagonal, and "inversion" for any other F, because Ĵ(−k) = Ĵ(k) always holds.
    """
    steps = np.arange(intervals + 1)
    whole = np.arange(-intervals + 1, intervals + 1) if symmetry == "inversion" else steps
    axes = [steps] + [whole] * (dim - 1)
    index = np.stack([g.reshape(-1) for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    kept = (index != 0).any(axis=1)
    ordered = {"cubic": index, "tetragonal": index[:, 1:]}.get(symmetry)
    if ordered is not None and ordered.shape[1] > 1:
        kept &= (np.diff(ordered, axis=1) <= 0).all(axis=1)
    places, index = np.flatnonzero(kept).astype(np.int32), index[kept]
    nearest = (2 * np.abs(index) > intervals).astype(int)
    sign = np.where(np.abs(index) % intervals == 0, 0, np.sign(index))
    _, labels = np.unique(np.concatenate([nearest, sign < 0], axis=1), axis=0, return_inverse=True)
    groups = [np.flatnonzero(labels == c) for c in range(labels.max() + 1)]
    most = max(len(g) for g in groups)
    members = np.stack([np.concatenate([g, np.full(most - len(g), g[0])]) for g in groups])
    # int32, because jax 0.10 keeps an int64 constant of a float64 run and a later float32 run fails on it.
    members = members.astype(np.int32)
    step = np.pi / intervals
    scaled = tuple(np.pi * (axis / intervals) for axis in axes)  # This order of operations gives exactly π.
    return Zone(np.pi * (index / intervals), members, scaled, places, step, intervals, symmetry)


def in_zone(x: Same) -> Same:
    """The wave x [1/spacing], moved by multiples of 2π into the zone, where it is the same wave."""
    return x - 2 * np.pi * namespace(x).round(x / (2 * np.pi))


def half_reciprocal_points(dim: int) -> np.ndarray:
    """List the wave vectors of the Brillouin zone whose components are 0 or π/h, without k = 0.

    Parameters
    ----------
    dim : int
        Dimension: 1, 2 or 3.

    Returns
    -------
    array, shape (2^dim − 1, dim)
        Wave vectors times the spacing h [-].

    Raises
    ------
    ValueError
        If `dim` is not 1, 2 or 3.

    Examples
    --------
    >>> (pd.closed_forms.half_reciprocal_points(2) / np.pi).tolist()
    [[0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    corners = np.stack(np.meshgrid(*[(0.0, np.pi)] * dim, indexing="ij"), axis=-1)
    return corners.reshape(-1, dim)[1:]


@lru_cache(maxsize=8)
def directions(dim: int) -> np.ndarray:
    """Unit directions over half a circle or half a sphere, with the coordinate axes. Inversion gives the other half."""
    if dim == 1:
        return np.ones((1, 1))
    if dim == 2:
        angle = np.arange(48) * np.pi / 48
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    near = np.stack(np.meshgrid(*[np.arange(-4, 5)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    near = near[(np.abs(near).max(axis=1) == 4) & [tuple(v) > (0, 0, 0) for v in near]]
    return near / np.linalg.norm(near, axis=1, keepdims=True)


def largest_eigenvalue(A: Sequence[Sequence[Numbers]]) -> Numbers:
    """Closed-form λ_max of symmetric 1×1, 2×2 or 3×3 blocks, whose entries are separate arrays.

    It is accurate enough to screen the grid but not to give a verdict.
    """
    xp = namespace(A)
    if len(A) == 1:
        return A[0][0]
    if len(A) == 2:
        mean, half = (A[0][0] + A[1][1]) / 2, (A[0][0] - A[1][1]) / 2
        return mean + xp.sqrt(half**2 + A[0][1] ** 2)
    mean = (A[0][0] + A[1][1] + A[2][2]) / 3
    a, b, c = A[0][0] - mean, A[1][1] - mean, A[2][2] - mean
    d, e, f = A[0][1], A[0][2], A[1][2]
    p = xp.sqrt((a**2 + b**2 + c**2 + 2 * (d**2 + e**2 + f**2)) / 6)
    det = a * (b * c - f**2) - d * (d * c - f * e) + e * (d * f - b * e)
    cosine = xp.clip(det / (2 * xp.maximum(p**3, np.finfo(p.dtype).tiny)), -1, 1)  # A multiple of I gives 0/tiny = 0.
    return mean + 2 * p * xp.cos(xp.arccos(cosine) / 3)


def top_pair(A: Float[Array, "dim dim"]) -> tuple[Array, Array]:
    """The largest eigenvalue of a symmetric matrix and its unit eigenvector, by `eigh`."""
    values, vectors = jnp.linalg.eigh((A + A.T) / 2)
    return values[-1], vectors[:, -1]


def class_best(zone: Zone, screen: Float[Numbers, " waves"]) -> Int[Numbers, " classes"]:
    """The index of the best grid point of every class."""
    xp = namespace(screen)
    best = xp.argmax(screen[zone.members], axis=1)
    return xp.take_along_axis(xp.asarray(zone.members), best[:, None], axis=1)[:, 0]


def second_best(zone: Zone, screen: Float[Numbers, " waves"]) -> Int[Array | np.integer, ""]:
    """The index of the best grid point that is more than 2½ steps away from the best point of all.

    On a ridge with two maxima it may belong to the other maximum. k, −k and k + 2π/h are the same wave.
    """
    xp, grid = namespace(screen), zone.grid.astype(screen.dtype)
    best = xp.asarray(grid)[xp.argmax(screen)]
    away = [in_zone(x) for x in (grid - best, grid + best)]
    apart = [xp.max(abs(x), axis=1) > 2.5 * zone.step for x in away]
    return xp.argmax(xp.where(apart[0] & apart[1], screen, -xp.inf))


def nudge(dim: int, step: float) -> np.ndarray:
    """A small shift in a direction without symmetry, which moves a start off the symmetry planes of the grid."""
    return step * np.array([0.29, 0.17, 0.11])[:dim]
