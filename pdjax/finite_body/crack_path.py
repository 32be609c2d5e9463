"""Cracks as bonds that broke: their path, area, speed, angle and branches. These functions run on the host.

    path       the midpoints of the broken bonds, in the order in which they broke
    area       A = Σ_broken V_i V_j / P     P: bonds per area times V² of a plane, see `pdjax.geometry.plane_sums`
    speed      the slope of the straight line that fits the position of the tip within a window of time
    angle      the direction of the straight line that fits the path, by total least squares
    branches   the path is cut into sections along the direction of growth, one horizon long. Gaps in the positions
               across that are wider than half a horizon divide a section. The crack branches where the first two
               consecutive sections that are divided begin

A crack of N bonds on a lattice has a width of up to two horizons, so none of these numbers is more exact than a
fraction of the horizon. A has the exact value for a plane at right angles to an axis of a lattice. It counts all broken
bonds, also those of damage that does not separate the body. A is therefore an upper estimate for fast cracks, which
damage more than one plane.

Source for the tip and its speed: Ha & Bobaru 2010.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._internal.checks import finite, native
from .._internal.public import public_function
from ..geometry.bonds import Families
from .damage.fracture_energy import sums_of_plane


class CrackPath(NamedTuple):
    """The bonds that broke, in the order in which they broke. Made by `crack_path`.

    Parameters
    ----------
    positions : array, shape (broken, dim)
        Midpoints [length] of the undeformed bonds.
    times : array, shape (broken,)
        Times [time] at which they broke.

    Examples
    --------
    >>> path = pd.CrackPath(np.array([[0.5, 0.0], [1.5, 0.0]]), np.array([0.1, 0.2]))
    >>> path.times.tolist()
    [0.1, 0.2]
    """

    positions: np.ndarray
    times: np.ndarray

    def near(self, point, radius: float) -> "CrackPath":
        """The bonds whose midpoints lie within a distance of a point, such as the tip of a notch.

        Parameters
        ----------
        point : array, shape (dim,)
            The point [length].
        radius : float
            The distance [length].

        Returns
        -------
        CrackPath
            The bonds, in the order in which they broke.
        """
        kept = np.linalg.norm(self.positions - finite("point", point), axis=1) <= radius
        return CrackPath(self.positions[kept], self.times[kept])


class Branching(NamedTuple):
    """Where a crack branches, and the angle between its outermost branches. Made by `crack_branching`.

    Parameters
    ----------
    distance : float
        Distance [length] of the place of branching from the start, along the direction. Infinite if there is none.
    angle : float
        Angle between the outermost branches [degree]. NaN if there is none.
    sections : array, shape (sections,)
        Distances [length] of the middles of the sections from the start.
    counts : array of int, shape (sections,)
        Number of cracks in each section.

    Examples
    --------
    >>> pd.Branching(np.inf, np.nan, np.array([0.5]), np.array([1])).counts.tolist()
    [1]
    """

    distance: float
    angle: float
    sections: np.ndarray
    counts: np.ndarray


@public_function
def crack_path(families: Families, broken_at: ArrayLike) -> CrackPath:
    """List the bonds that broke, in the order in which they broke.

    Parameters
    ----------
    families : Families
        Families of the body before the run.
    broken_at : array, shape (points, bonds)
        `History.broken_at`: the time [time] at which each bond broke, infinite for the others.

    Returns
    -------
    CrackPath
        Midpoints and times. Every bond is listed once.

    Raises
    ------
    ValueError
        If `broken_at` has another shape than the bonds of the families, or the families have no positions.

    Examples
    --------
    The middle bond of a bar broke at the time 2, the bond to its right at 3:

    >>> families = pd.families(pd.lattice((4,)), horizon=1.0)
    >>> broken_at = np.full((4, 2), np.inf)
    >>> for i, slot in np.argwhere(np.asarray(families.is_bond)):
    ...     middle = float(families.positions[i, 0] + families.xi[i, slot, 0] / 2)
    ...     broken_at[i, slot] = {2.0: 2.0, 3.0: 3.0}.get(middle, np.inf)
    >>> path = pd.crack_path(families, broken_at)
    >>> path.positions[:, 0].tolist(), path.times.tolist()
    ([2.0, 3.0], [2.0, 3.0])
    """
    broken_at = native("broken_at", broken_at)
    if broken_at.shape != families.neighbours.shape:
        raise ValueError(
            f"broken_at must have shape (points, bonds) = {families.neighbours.shape}; got {broken_at.shape}"
        )
    if families.positions is None:
        raise ValueError("crack_path needs families with known positions; pass what `families` returns")
    i, slot = np.nonzero(np.isfinite(broken_at) & np.asarray(families.is_bond))
    once = i < np.asarray(families.neighbours)[i, slot]
    i, slot = i[once], slot[once]
    middle = np.asarray(families.positions, float)[i] + 0.5 * np.asarray(families.xi, float)[i, slot]
    order = np.argsort(broken_at[i, slot], kind="stable")
    return CrackPath(middle[order], broken_at[i, slot][order])


@public_function
def crack_area(families: Families, broken: ArrayLike) -> float:
    """Compute the area of the plane that cuts as many bonds as have broken.

    A = Σ_broken V_i V_j / P, with P of a plane at right angles to an axis of a lattice, or of a full ball for a cloud

    Parameters
    ----------
    families : Families
        Families of the body before the run.
    broken : array of bool, shape (points, bonds)
        The broken bonds, in the families of both ends.

    Returns
    -------
    float
        Area [length^(dim − 1)]. In 2D it is a length.

    Raises
    ------
    ValueError
        If `broken` has another shape than the bonds of the families, or every point has a horizon of its own.

    Examples
    --------
    A cut through a plate of height 9, periodic in y, has the area 9:

    >>> families = pd.families(pd.lattice((12, 9), periodic=(False, True)), horizon=2.0)
    >>> broken = np.asarray(pd.cut(families, pd.Plane((6.0, 0.0), (1.0, 0.0))).weight) < np.asarray(families.weight)
    >>> pd.crack_area(families, broken)
    9.0
    """
    broken = native("broken", broken)
    if broken.shape != families.neighbours.shape or broken.dtype != bool:
        raise ValueError(
            f"broken must be bool with shape (points, bonds) = {families.neighbours.shape}; got {broken.dtype} with"
            f" shape {broken.shape}"
        )
    pairs = sums_of_plane(families, "closed form" if families.spacing is None else "lattice", _one).pairs
    V, i = np.asarray(families.volumes, float), np.asarray(families.neighbours)
    lost = np.where(broken & np.asarray(families.is_bond), V[:, None] * V[i], 0.0)
    return float(0.5 * lost.sum() / pairs)


def _one(r: np.ndarray, delta: float) -> np.ndarray:
    return np.ones_like(r)


@public_function
def crack_speed(times: ArrayLike, tip: ArrayLike, window: float) -> Float[np.ndarray, " saves"]:
    """Compute the speed of a crack tip from its positions: the slope of a straight line within a window of time.

    Parameters
    ----------
    times : array, shape (saves,)
        Times [time], increasing.
    tip : array, shape (saves,)
        Distances [length] of the tip, such as the values of `observers.crack_tip`.
    window : float
        Width of the window [time], > 0. The tip moves in steps of the spacing h: a window of several h/speed smooths
        them.

    Returns
    -------
    array, shape (saves,)
        Slope [length/time] of the least-squares line through the saves within half a window of each save. NaN where
        the window holds fewer than two saves: take a window of three saves or more.

    Raises
    ------
    ValueError
        If the arrays differ in shape, the times do not increase, or the window is not finite and > 0.

    Examples
    --------
    >>> t = np.linspace(0.0, 1.0, 11)
    >>> np.round(pd.crack_speed(t, 2.0 * t, window=0.4), 9).tolist()[::5]
    [2.0, 2.0, 2.0]
    """
    times, tip = finite("times", times), finite("tip", tip)
    if times.ndim != 1 or times.shape != tip.shape or (np.diff(times) <= 0).any():
        raise ValueError(
            f"times and tip must be arrays of one shape (saves,), and times must increase; got shapes {times.shape} and"
            f" {tip.shape}"
        )
    if not (np.isfinite(window) and window > 0):
        raise ValueError(f"window must be finite and > 0 [time]; got {window}")
    near = np.abs(times[:, None] - times) <= 0.5 * window * (1 + 1e-9)
    count = near.sum(axis=1)
    t = np.where(near, times - (near @ times / count)[:, None], 0.0)
    spread = (t**2).sum(axis=1)
    return np.where(count > 1, t @ tip / np.where(spread > 0, spread, 1.0), np.nan)


@public_function
def crack_angle(positions: ArrayLike, direction: ArrayLike) -> float:
    """Compute the angle between a crack in 2D and a direction, from the line that fits the crack.

    Parameters
    ----------
    positions : array, shape (broken, 2)
        Points of the crack [length], the first to break first, such as `CrackPath.positions`.
    direction : array, shape (2,)
        Direction, of any length > 0, such as that of a notch.

    Returns
    -------
    float
        Angle [degree] between −180 and 180, positive counter-clockwise from the direction. The line is that of least
        squares of the distances at right angles to it. It points from the points that broke first to the last.

    Raises
    ------
    ValueError
        If there are fewer than two different points, or the shapes are wrong.

    Examples
    --------
    >>> round(pd.crack_angle([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], direction=[1.0, 0.0]), 9)
    45.0
    """
    X, along = finite("positions", positions), finite("direction", direction)
    if X.ndim != 2 or X.shape[1] != 2 or along.shape != (2,) or not along.any():
        raise ValueError(
            "positions must have shape (broken, 2) and direction shape (2,), not 0; got shapes"
            f" {X.shape} and {along.shape}"
        )
    if len(X) < 2 or not np.ptp(X, axis=0).any():
        raise ValueError(f"an angle needs two different points of a crack; got {len(X)}")
    line = np.linalg.svd(X - X.mean(axis=0), full_matrices=False)[2][0]
    half = len(X) // 2
    line = line * (1.0 if (X[half:].mean(axis=0) - X[:half].mean(axis=0)) @ line >= 0 else -1.0)
    turn = np.arctan2(along[0] * line[1] - along[1] * line[0], along @ line)
    return float(np.degrees(turn))


@public_function
def crack_branching(
    positions: ArrayLike, start: ArrayLike, direction: ArrayLike, width: float, reach: float = np.inf
) -> Branching:
    """Find where a crack in 2D branches, and the angle between its outermost branches.

    Parameters
    ----------
    positions : array, shape (broken, 2)
        Points of the crack [length], such as `CrackPath.positions`.
    start : array, shape (2,)
        Reference position [length] from which distances are measured, such as the end of a notch.
    direction : array, shape (2,)
        Direction of growth, of any length > 0.
    width : float
        Length of a section along the direction, and twice the gap across it that separates two cracks [length]. Take
        the horizon.
    reach : float, optional
        Length [length] beyond the place of branching within which straight lines are fitted to the outermost
        branches. Default: the whole branches.

    Returns
    -------
    Branching
        The place of branching, the angle, and the number of cracks of every section.

    Raises
    ------
    ValueError
        If the shapes are wrong, or the width or the reach is not > 0.

    Examples
    --------
    A crack along x with two branches of ±45° from x = 2 on:

    >>> x = np.linspace(0.0, 4.0, 401)
    >>> y = np.maximum(x - 2.0, 0.0)
    >>> crack = np.concatenate([np.stack([x, y], axis=1), np.stack([x, -y], axis=1)])
    >>> found = pd.crack_branching(crack, start=[0.0, 0.0], direction=[1.0, 0.0], width=0.1)
    >>> round(found.angle, 6), round(found.distance, 6)
    (90.0, 2.1)
    """
    X, start, along = finite("positions", positions), finite("start", start), finite("direction", direction)
    if X.ndim != 2 or X.shape[1] != 2 or start.shape != (2,) or along.shape != (2,) or not along.any():
        raise ValueError(
            "positions must have shape (broken, 2), start and direction shape (2,), and the direction must not be 0;"
            f" got shapes {X.shape}, {start.shape} and {along.shape}"
        )
    if not (np.isfinite(width) and width > 0 and reach > 0):
        raise ValueError(f"width must be finite and > 0, and reach > 0; got {width} and {reach}")
    along = along / np.linalg.norm(along)
    ahead, across = (X - start) @ along, (X - start) @ np.array([-along[1], along[0]])
    number = np.floor(ahead / width).astype(int)
    last = int(number.max(initial=-1))
    sections = width * (np.arange(last + 1) + 0.5)
    counts = np.array([_groups(across[number == k], width / 2) for k in range(last + 1)], dtype=int)
    divided = (counts[:-1] > 1) & (counts[1:] > 1)
    if not divided.any():
        return Branching(np.inf, np.nan, sections, counts)
    first = int(np.argmax(divided))
    distance = width * first
    middle = np.median(across[number == max(first - 1, 0)]) if first else 0.0
    inside = (ahead >= distance) & (ahead < distance + reach)
    slopes = []
    for side in (1.0, -1.0):
        mine = inside & (side * (across - middle) > 0)
        best = {k: side * np.max(side * across[mine & (number == k)]) for k in np.unique(number[mine])}
        outer = mine & (np.abs(across - np.array([best.get(k, np.inf) for k in number])) < width)
        slopes.append(np.polyfit(ahead[outer], across[outer], 1)[0] if len(np.unique(ahead[outer])) > 1 else np.nan)
    return Branching(distance, float(np.degrees(np.arctan(slopes[0]) - np.arctan(slopes[1]))), sections, counts)


def _groups(across: np.ndarray, gap: float) -> int:
    """Number of groups of positions that are separated by more than a gap."""
    return 0 if not across.size else 1 + int((np.diff(np.sort(across)) > gap).sum())
