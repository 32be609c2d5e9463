"""A plate with a crack across its middle, pulled at both ends: the handbook problem of mode I.

The plate has the width 2w, the height 4w and a straight crack of length 2a in its middle, across the direction of the
tension σ. Its stress intensity is

    K = σ √(πa) √(sec(πa/2w)) (1 − 0.025 (a/w)² + 0.06 (a/w)⁴)

with an error below 0.1 % for a long plate (Tada, Paris & Irwin 2000). The crack grows at K = √(E' G_c), with E' = E in
plane stress. Under a given tension K rises with a, so the crack then runs through the whole plate.

**The pre-crack** is made of broken bonds (`Families.with_broken`), not of bonds that never existed (`cut`). A model
that keeps the reference sums of the intact family, such as LPS, then has the same material at the faces of the
pre-crack as at the faces that grow from it. With `cut` the faces would be those of a specimen that was made with its
crack, and the body would not change in the same way as where the crack grows. BondBased has no such sums.
"""

from typing import NamedTuple

import numpy as np

from ..finite_body import conditions
from ..finite_body.scene import Scene, scene
from ..geometry.cuts import Segment, crossed
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..models.base import AbstractModel
from ..models.lps import LPS
from .bodies import checked_count, checked_ratio

POISSON = 1 / 3  # of BondBased in plane stress, so that both models describe the same material


class CrackedPlate(NamedTuple):
    """What the handbook says of a cracked plate.

    Attributes
    ----------
    half_width, half_crack : float
        w and a [length].
    stress : float
        Tension [pressure] at load factor 1: the one at which K = √(E' G_c).
    toughness : float
        Critical stress intensity √(E' G_c) [pressure · √length].
    fracture_energy : float
        G_c [energy/area].

    Examples
    --------
    >>> _, expected = pd.scenes.cracked_plate(20)
    >>> round(float(expected.stress_intensity(expected.stress) / expected.toughness), 12)
    1.0
    """

    half_width: float
    half_crack: float
    stress: float
    toughness: float
    fracture_energy: float

    def stress_intensity(self, stress):
        """Stress intensity K of a tension.

        Parameters
        ----------
        stress : float or array
            Tension [pressure].

        Returns
        -------
        float or array
            K [pressure · √length].

        Examples
        --------
        >>> _, expected = pd.scenes.cracked_plate(20)
        >>> round(float(expected.stress_intensity(1.0) / np.sqrt(np.pi * expected.half_crack)), 4)
        1.1862
        """
        return stress * np.sqrt(np.pi * self.half_crack) * shape_factor(self.half_crack / self.half_width)


def shape_factor(ratio: float) -> float:
    """K/(σ √(πa)) of a long plate with a crack in its middle, for a/w = `ratio` (Tada, Paris & Irwin 2000)."""
    return float(np.sqrt(1 / np.cos(np.pi * ratio / 2)) * (1 - 0.025 * ratio**2 + 0.06 * ratio**4))


def unit_plate(young: float = 1.0) -> AbstractModel:
    """The LPS of Young's modulus `young` and Poisson's ratio ⅓ in plane stress."""
    return LPS.from_young(young, POISSON, 2, "stress")


def checked_energy(fracture_energy: float) -> float:
    if not (np.isfinite(fracture_energy) and fracture_energy > 0):
        raise ValueError(f"fracture_energy must be finite and > 0; got {fracture_energy!r}")
    return float(fracture_energy)


def cracked_plate(
    n: int = 40,
    N: float = 3,
    crack: float = 0.5,
    fracture_energy: float = 1e-6,
    model: AbstractModel | None = None,
) -> tuple[Scene, CrackedPlate]:
    """Make a plate of width 1 and height 2 with a crack in its middle, under tension along y.

    An even body force in a layer of one horizon at each end carries the tension. At load factor 1 it is the tension at
    which the handbook expects the crack to grow. A bond breaks near that load if the criterion of `solve_breaking` is
    made from the same fracture energy.

    Parameters
    ----------
    n : int, optional
        Number of points across the width, even and at least 12. Default 40.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    crack : float, optional
        Length of the crack over the width, a/w [-], at most 0.8. Its ends lie midway between two points. Default 0.5.
    fracture_energy : float, optional
        Fracture energy G_c > 0 [energy/area]. Default 1e-6, so that strains stay small.
    model : AbstractModel, optional
        The material model, with Young's modulus 1 in plane stress. Default: `LPS` with Poisson's ratio ⅓.

    Returns
    -------
    Scene
        The problem, for `solve_breaking`. Its families hold the crack as broken bonds.
    CrackedPlate
        The stress intensity of the handbook.

    Raises
    ------
    ValueError
        If an argument is out of range, or the crack is shorter than two spacings.

    References
    ----------
    Tada, Paris & Irwin 2000.

    Examples
    --------
    >>> scene, expected = pd.scenes.cracked_plate(20, fracture_energy=1e-6)
    >>> family = pd.lattice_family(dim=2, N=3, spacing=1 / 20)
    >>> criterion = pd.CriticalStretch.from_fracture_energy(1e-6, scene.model, family)
    >>> path = pd.solve_breaking(scene, criterion, load_steps=[0.9, 1.0, 1.1, 1.2], show_progress=False)
    >>> bool(path.load_factors[path.settled][-1] < 1.2), round(float(path.broken_at.min()), 2)
    (True, 1.1)
    """
    n, N = checked_count("n", n, 12), checked_ratio(N)
    if n % 2:
        raise ValueError(f"n must be even, so that the crack lies in the middle; got {n}")
    if not 0 < crack <= 0.8:
        raise ValueError(f"crack must lie between 0 and 0.8 of the width; got {crack}")
    G, h = checked_energy(fracture_energy), 1.0 / n
    half = round(crack * n / 2) * h
    if half < h:
        raise ValueError(f"the crack is shorter than two spacings; take a larger n or crack; got n {n}, crack {crack}")
    body, rows = lattice((n, 2 * n), h), round(N)
    X = body.positions
    own = families(body, N * h)
    own = own.with_broken(crossed(own, Segment((0.5 - half, 1.0), (0.5 + half, 1.0))))
    toughness = float(np.sqrt(G))
    stress = toughness / (np.sqrt(np.pi * half) * shape_factor(2 * half))
    loaded = np.flatnonzero(np.abs(X[:, 1] - 1) > 1 - rows * h)
    pull = np.sign(X[loaded, 1:] - 1) * [0.0, stress / (rows * h)]
    left = np.ravel_multi_index((n // 2 - 1, rows), (n, 2 * n))  # two points that prevent rigid motions, without force
    right = np.ravel_multi_index((n // 2, rows), (n, 2 * n))
    fixed = scene(
        body,
        own,
        unit_plate() if model is None else model,
        conditions.prescribe([left], 0.0),
        conditions.prescribe([right], 0.0, components=1),
        conditions.body_force(loaded, pull),
        name="cracked plate",
    )
    return fixed, CrackedPlate(0.5, half, float(stress), toughness, G)
