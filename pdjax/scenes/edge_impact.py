"""A steel plate with two notches that is hit between them: the experiment of Kalthoff & Winkler.

A plate of maraging steel, 0.1 m × 0.2 m, has two parallel notches, 50 mm long and 50 mm apart, that begin at its left
side. A projectile hits the left side between them. Pressure runs into the strip between the notches and shears their
ends. At low speeds the cracks are brittle: both run outwards, at about 70° to the notches.

    E = 190 GPa,  ρ = 8000 kg/m³,  G_c = 22.17 kJ/m²,  plane strain, ν = 1/4 (that of bond-based models; steel has 0.3)

**The impact.** A projectile of the same steel and the speed 2v would give the side the speed v, because both have the
same impedance. The scene prescribes u_x = v t from t = 0 on, on all points between the notches that lie within a
horizon of the side. u_y stays free. The projectile does not rebound. It stops after 90 µs. The bonds of these points do
not break.

The whole plate is modelled, not a half of it: a nonlocal body has no plane on which u_y = 0 alone would be symmetry.

**What is expected.** Kalthoff 2000 measured about 70°. Silling 2003 computed 68° (peridynamics), Borden et al. 2012
about 65° (phase field), all as later papers quote them. The band of 65 to 72° was fixed before the first run.
"""

from typing import NamedTuple

import numpy as np

from ..finite_body.conditions import prescribe
from ..finite_body.damage.critical_stretch import CriticalStretch
from ..finite_body.dynamics.system import Motion, Ramp, motion
from ..finite_body.scene import scene
from ..geometry.bonds import lattice_family
from ..geometry.cuts import Segment, crossed
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..models.base import AbstractModel
from .bodies import checked_count, checked_ratio
from .rayleigh import rayleigh_speed
from .springs import springs

LENGTH, NOTCH, HEIGHTS = 0.1, 0.05, (0.075, 0.125)  # m; the plate is 0.2 m high
YOUNG, POISSON, DENSITY, FRACTURE_ENERGY = 190e9, 0.25, 8000.0, 22170.0
DURATION = 90e-6  # s; the cracks come near the sides


class EdgeImpact(NamedTuple):
    """What `kalthoff` returns beside the motion: the breaking criterion, and what papers say of the cracks.

    Attributes
    ----------
    breaking : CriticalStretch
        Criterion of G_c, for `simulate(motion, breaking=…)`.
    fracture_energy : float
        G_c [J/m²].
    rayleigh : float
        Rayleigh speed of the steel [m/s].
    tips : array, shape (2, 2)
        Ends of the lower and of the upper notch [m].
    angle : tuple of two floats
        Range of the angle between crack and notch [degree].

    Examples
    --------
    >>> expected = pd.scenes.kalthoff(24)[1]
    >>> isinstance(expected, pd.scenes.EdgeImpact), expected.angle, round(expected.rayleigh)
    (True, (65.0, 72.0), 2834)
    """

    breaking: CriticalStretch
    fracture_energy: float
    rayleigh: float
    tips: np.ndarray
    angle: tuple[float, float] = (65.0, 72.0)


def kalthoff(
    n: int = 100, N: float = 3.015, speed: float = 16.5, model: AbstractModel | None = None
) -> tuple[Motion, EdgeImpact]:
    """Make a steel plate with two notches that is hit between them, and what papers say of its cracks.

    Parameters
    ----------
    n : int, optional
        Number of points along the notches, a multiple of 4, at least 24. The plate has n × 2n points, the spacing is
        0.1 m/n. Default 100.
    N : float, optional
        Horizon over spacing [-]. Default 3.015, so that no bond ties with the horizon.
    speed : float, optional
        Speed v of the side that is hit [m/s], > 0: half of the speed of a projectile of the same steel. Default 16.5.
    model : AbstractModel, optional
        `BondBased` or `LPS` for plane strain. Default: `BondBased` with the bulk modulus of the steel.

    Returns
    -------
    Motion
        The problem, in SI units. Its default duration is 90 µs.
    EdgeImpact
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
    Kalthoff & Winkler 1987; Kalthoff 2000; Silling 2003; Borden et al. 2012.

    Examples
    --------
    >>> motion, expected = pd.scenes.kalthoff(24)
    >>> motion.start.shape, round(1e3 * float(expected.breaking.stretch), 2), expected.tips.tolist()
    ((1152, 2), 3.52, [[0.05, 0.075], [0.05, 0.125]])
    """
    n, N = checked_count("n", n, 24), checked_ratio(N)
    if n % 4:
        raise ValueError(f"n must be a multiple of 4, so that the notches lie between two rows of points; got {n}")
    if not (np.isfinite(speed) and speed > 0):
        raise ValueError(f"speed must be finite and > 0 [m/s]; got {speed}")
    h = LENGTH / n
    body = lattice((n, 2 * n), h)
    own, one = families(body, N * h), lattice_family(2, N, h)
    notched = own
    for height in HEIGHTS:
        notched = notched.with_broken(crossed(own, Segment((0.0, height), (NOTCH, height))))
    if model is None:
        model = springs(YOUNG, POISSON, "strain", one)
    x, y = body.positions.T
    hit = (x < N * h) & (HEIGHTS[0] < y) & (y < HEIGHTS[1])
    breaking = CriticalStretch.from_fracture_energy(FRACTURE_ENERGY, model, one, calibrate="lattice", no_fail=hit)
    expected = EdgeImpact(
        breaking,
        FRACTURE_ENERGY,
        rayleigh_speed(YOUNG, POISSON, DENSITY, "strain"),
        np.array([(NOTCH, height) for height in HEIGHTS]),
    )
    pushed = prescribe(hit, speed * DURATION, components=0)
    fixed = scene(body, notched, model, pushed, moving=True, name="plate of Kalthoff and Winkler")
    return motion(
        fixed,
        DENSITY,
        schedule=Ramp(DURATION),  # type: ignore[arg-type]
        duration=DURATION,
    ), expected
