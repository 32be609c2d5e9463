"""Elastic constants: K and G from E and ν, and what a two-dimensional model is to be given for a solid of K and G.

    K = E/(3(1 − 2ν)),   G = E/(2(1 + ν))
    plane strain  k = K + G/3,     plane stress  k = 9KG/(3K + 4G)        (d-dimensional bulk modulus, d = 2)

The shear modulus G is the same in both. Lamé's first constant of the plane is k − G.
"""

from jaxtyping import Array

from .._internal.checks import as_real, check_positive, choice, on_device, on_host, require
from .._internal.public import public_function


@public_function
def plane_bulk_modulus(bulk, shear, plane: str) -> Array:
    """k [pressure] of plane "strain" or "stress" from K and G of the solid [pressure], > 0."""
    choice("plane", plane, ("strain", "stress"))
    bulk, shear = as_real(bulk), as_real(shear)
    check_positive("bulk", bulk)
    check_positive("shear", shear)
    bulk, shear = on_host((bulk, shear))
    return on_device(bulk + shear / 3 if plane == "strain" else 9 * bulk * shear / (3 * bulk + 4 * shear))


def bulk_and_shear(young, poisson) -> tuple[Array, Array]:
    """K and G [pressure] of a solid of Young's modulus E > 0 [pressure] and Poisson's ratio −1 < ν < ½ [-]."""
    young, poisson = as_real(young), as_real(poisson)
    check_positive("young", young)
    E, nu = on_host((young, poisson))
    require(poisson, (nu > -1) & (nu < 0.5), f"poisson must lie between -1 and 1/2; got {poisson}")
    return on_device((E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))))
