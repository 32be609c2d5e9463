"""Scenes of fracture whose answer is known beforehand.

**Spall.** A flyer of length a hits a bar of length b > a of the same material at the speed v. Both are one straight
bar, from x = −a to b, whose points −a < x < 0 have the velocity v at the start. Plane waves of speed c = √(E/ρ) give:

    0 < t < (a + b)/c    compression only, with the strain −v/2c between the wave fronts
    t = (a + b)/c        the releases from both free ends meet at x = b − a, and the strain there becomes +v/2c

A bar whose critical stretch is a small part of v/2c therefore breaks at x = b − a, at the time (a + b)/c. The waves of
a nonlocal bar disperse. The scene therefore starts with a front of the velocity that is six horizons wide, and the bar
breaks up to two horizons/c later than a sharp front would break it.

Source: any text on stress waves, such as K. F. Graff, *Wave Motion in Elastic Solids*, 1975, section 2.
"""

from typing import NamedTuple

import numpy as np

from ..finite_body.dynamics.system import Motion, motion
from ..finite_body.scene import scene
from ..geometry.bonds import lattice_family
from ..geometry.neighbour_search import families
from ..geometry.points import bar
from ..models.bond_based import BondBased
from .bodies import checked_count, checked_ratio

FRONT = 3.0  # half width of the wave fronts over the horizon; behind sharper fronts the bar oscillates


class Spall(NamedTuple):
    """What wave theory says of a spall bar: the place [length] and time [time] of the first tension, and its strain.

    Examples
    --------
    >>> pd.scenes.Spall(place=0.6, time=1.0, strain=0.01).time
    1.0
    """

    place: float
    time: float
    strain: float


def spall_bar(n: int = 300, N: float = 3, flyer: float = 1 / 3, strain: float = 0.01) -> tuple[Motion, Spall]:
    """Make a bar that is hit by a flyer, and what wave theory says of the place and time at which it breaks.

    Flyer and bar have the length 1 together, unit density and unit Young's modulus, so that c = 1.

    Parameters
    ----------
    n : int, optional
        Number of points, at least 20. Default 300.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    flyer : float, optional
        Length of the flyer over the whole length [-], below ½. Default ⅓.
    strain : float, optional
        Strain v/2c > 0 [-] of the waves, which sets the speed of the flyer. Default 0.01.

    Returns
    -------
    Motion
        The problem of a bond-based bar with the right modulus inside. Pass it to `simulate` with
        `breaking=CriticalStretch(...)`. Its default duration is 1.2 times the predicted time.
    Spall
        The predicted place, time and tensile strain.

    Raises
    ------
    ValueError
        If an argument is out of range.

    Examples
    --------
    >>> motion, expected = pd.scenes.spall_bar(60)
    >>> round(expected.place, 3), round(expected.time, 3), motion.start.shape
    (0.667, 1.0, (60, 1))
    """
    n, N = checked_count("n", n, 20), checked_ratio(N)
    if not 0 < flyer < 0.5:
        raise ValueError(f"flyer must lie between 0 and 0.5, so that the bar is longer than the flyer; got {flyer}")
    if not (np.isfinite(strain) and strain > 0):
        raise ValueError(f"strain must be finite and > 0; got {strain}")
    h = 1.0 / n
    body = bar(n, 1.0)
    own = families(body, N * h)
    model = BondBased.from_family(1.0, lattice_family(1, N, h))
    x = body.positions[:, 0]
    velocity = strain * (1 - np.tanh((x - flyer) / (FRONT * N * h)))[:, None]
    expected = Spall(1 - flyer, 1.0, strain)
    fixed = scene(body, own, model, moving=True, name="spall bar")
    return motion(fixed, 1.0, velocity=velocity, duration=1.2 * expected.time), expected
