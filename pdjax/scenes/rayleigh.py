"""The speed of Rayleigh waves, which no crack that opens can exceed.

With c_s and c_p the speeds of shear and pressure waves, the Rayleigh wave of speed c satisfies

    (2 − c²/c_s²)² = 4 √(1 − c²/c_p²) √(1 − c²/c_s²)

In plane stress c_p is that of a thin plate. Source: Freund, *Dynamic Fracture Mechanics*, 1990, section 2.2.
"""

import math

from scipy.optimize import brentq

from ..models.plane import check_young_and_poisson


def rayleigh_speed(young: float, poisson: float, density: float, plane: str) -> float:
    """Compute the speed [length/time] of Rayleigh waves in plane "stress" or "strain".

    Parameters
    ----------
    young, poisson : float
        Young's modulus [pressure] and Poisson's ratio [-] of the 3D solid.
    density : float
        Density [mass/length³].
    plane : "stress" or "strain"
        The state of the plane.

    Returns
    -------
    float
        The speed.
    """
    check_young_and_poisson(young, poisson)
    shear = math.sqrt(young / (2 * (1 + poisson)) / density)
    ratio = (1 - poisson) / 2 if plane == "stress" else (1 - 2 * poisson) / (2 * (1 - poisson))  # c_s²/c_p²

    def residual(q: float) -> float:  # q = c²/c_s²
        return (2 - q) ** 2 - 4 * math.sqrt((1 - ratio * q) * (1 - q))

    return shear * math.sqrt(brentq(residual, 0.1, 1 - 1e-12))
