"""A glass plate whose crack runs and branches: the plate of Ha & Bobaru 2010.

A thin plate of soda-lime glass, 0.1 m × 0.04 m, has a notch along its middle line, from the left side to the centre.
At t = 0 a tensile stress σ acts on both long sides and stays. Its waves meet at the notch, and a crack starts, speeds
up, and branches.

    E = 72 GPa,  ρ = 2440 kg/m³,  G_c = 135 J/m²,  plane stress, ν = 1/3 (the ratio of bond-based models)

The stress is a body force on the outermost row of points, σ/h. The bonds of the points within a horizon of the long
sides do not break: otherwise the body force would tear the row off.

**What is expected.** These ranges were fixed before the first run, from figures and from quoted values:

    speed    below the Rayleigh speed c_R (Freund 1990); the largest between 0.45 and 0.7 c_R. Bowden et al. 1967
             measured at most 1580 m/s = 0.52 c_R in this glass. Phase fields stay below 0.6 c_R (Borden et al. 2012)
             and below 0.7 c_R (Bleyer et al. 2017).
    branches 8 to 24 mm ahead of the notch (figures of Ha & Bobaru 2010 at 12 MPa and of Borden et al. 2012 for a plate
             of this shape and nearly the same σ² H/(E G_c))
    angle    30 to 60° between the branches: 30 to 45° in glass under uniaxial tension (Quinn 2019), about 50° in the
             figures of Borden et al. 2012
"""

from typing import NamedTuple

import numpy as np

from ..finite_body.conditions import body_force
from ..finite_body.damage.critical_stretch import CriticalStretch
from ..finite_body.dynamics.system import Motion, motion
from ..finite_body.scene import scene
from ..geometry.bonds import lattice_family
from ..geometry.cuts import Segment, crossed
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..models.base import AbstractModel
from .bodies import checked_count, checked_ratio
from .rayleigh import rayleigh_speed
from .springs import springs

LENGTH, HEIGHT, NOTCH = 0.1, 0.04, 0.05  # m
YOUNG, POISSON, DENSITY, FRACTURE_ENERGY = 72e9, 1 / 3, 2440.0, 135.0
DURATION = 45e-6  # s; the branches come near the long sides


class GlassPlate(NamedTuple):
    """What `branching_plate` returns beside the motion: the breaking criterion, and what papers say of the crack.

    Attributes
    ----------
    breaking : CriticalStretch
        Criterion of G_c, for `simulate(motion, breaking=…)`.
    fracture_energy : float
        G_c [J/m²].
    rayleigh : float
        Rayleigh speed of the glass [m/s].
    tip : array, shape (2,)
        End of the notch [m].
    distance : tuple of two floats
        Range of the distance from the notch to the place of branching [m].
    angle : tuple of two floats
        Range of the angle between the branches [degree].

    Examples
    --------
    >>> expected = pd.scenes.branching_plate(30)[1]
    >>> isinstance(expected, pd.scenes.GlassPlate), expected.fracture_energy, round(expected.rayleigh)
    (True, 135.0, 3058)
    """

    breaking: CriticalStretch
    fracture_energy: float
    rayleigh: float
    tip: np.ndarray
    distance: tuple[float, float] = (0.008, 0.024)
    angle: tuple[float, float] = (30.0, 60.0)

    @property
    def speed(self) -> tuple[float, float]:
        """Range of the largest speed of the crack [m/s]: 0.45 to 0.7 of the Rayleigh speed."""
        return 0.45 * self.rayleigh, 0.7 * self.rayleigh


def branching_plate(
    n: int = 150, N: float = 3.015, stress: float = 12e6, model: AbstractModel | None = None
) -> tuple[Motion, GlassPlate]:
    """Make a notched glass plate under a sudden tension, whose crack branches, and what papers say of the crack.

    Parameters
    ----------
    n : int, optional
        Number of points along the plate, a multiple of 5, at least 30. The spacing is 0.1 m/n. Default 150.
    N : float, optional
        Horizon over spacing [-]. Default 3.015, so that no bond ties with the horizon.
    stress : float, optional
        Stress σ [Pa], > 0. Default 12 MPa. Ha & Bobaru 2010 also take larger ones.
    model : AbstractModel, optional
        `BondBased` or `LPS` for plane stress. Default: `BondBased` with the bulk modulus of the glass.

    Returns
    -------
    Motion
        The problem, in SI units. Its default duration is 45 µs.
    GlassPlate
        The breaking criterion and the expected values.

    Raises
    ------
    ValueError
        If an argument is out of range, or the fracture energy of the model has no closed form.

    Notes
    -----
    Take a time step of at most 0.2 of the critical one. A run looks once a step which bonds exceed the critical
    stretch. With larger steps they break late, and the fracture energy is too large, see
    `pdjax.studies.running_cracks`.

    References
    ----------
    Ha & Bobaru 2010; Borden et al. 2012; Bleyer et al. 2017; Bowden et al. 1967; Quinn 2019.

    Examples
    --------
    >>> motion, expected = pd.scenes.branching_plate(30)
    >>> motion.start.shape, round(1e4 * float(expected.breaking.stretch), 2), expected.tip.tolist()
    ((360, 2), 5.15, [0.05, 0.02])
    """
    n, N = checked_count("n", n, 30), checked_ratio(N)
    if n % 5:
        raise ValueError(f"n must be a multiple of 5, so that the plate of 0.1 m × 0.04 m has whole points; got {n}")
    if not (np.isfinite(stress) and stress > 0):
        raise ValueError(f"stress must be finite and > 0 [Pa]; got {stress}")
    h = LENGTH / n
    body = lattice((n, 2 * n // 5), h)
    own, one = families(body, N * h), lattice_family(2, N, h)
    y, middle = body.positions[:, 1], HEIGHT / 2
    notched = own.with_broken(crossed(own, Segment((0.0, middle), (NOTCH, middle))))
    if model is None:
        model = springs(YOUNG, POISSON, "stress", one)
    away = np.abs(y - middle)
    breaking = CriticalStretch.from_fracture_energy(
        FRACTURE_ENERGY, model, one, calibrate="lattice", no_fail=away > middle - N * h
    )
    loads = [body_force(side, [0.0, sign * stress / h]) for sign, side in ((1, y > HEIGHT - h), (-1, y < h))]
    expected = GlassPlate(
        breaking, FRACTURE_ENERGY, rayleigh_speed(YOUNG, POISSON, DENSITY, "stress"), np.array([NOTCH, middle])
    )
    fixed = scene(body, notched, model, *loads, moving=True, name="branching plate")
    return motion(fixed, DENSITY, duration=DURATION), expected
