"""Elastic constants: K and G from E and ν, and the bulk modulus of a two-dimensional model from K and G.

    K = E/(3(1 − 2ν)),   G = E/(2(1 + ν))
    plane strain  k = K + G/3,     plane stress  k = 9KG/(3K + 4G)        (d-dimensional bulk modulus, d = 2)

K, G, E and ν belong to the 3D solid; with its Lamé constants K = λ + 2μ/3 and G = μ. The shear modulus is G in both
cases. The first Lamé constant of the plane is k − G: it equals λ in plane strain.
"""

import numpy as np
from jaxtyping import Array

from .._internal.checks import as_real, check_positive, choice, is_concrete, on_device, on_host, require
from .._internal.public import public_function


@public_function
def plane_bulk_modulus(bulk, shear, plane: str) -> Array:
    """Compute the two-dimensional bulk modulus k of a solid in plane strain or plane stress.

    k = K + G/3 in plane strain, 9KG/(3K + 4G) in plane stress.

    Parameters
    ----------
    bulk : float or array, shape (points,)
        Bulk modulus K of the 3D solid [pressure], > 0.
    shear : float or array, shape (points,)
        Shear modulus G [pressure], > 0.
    plane : "strain" or "stress"
        The state of the plane.

    Returns
    -------
    array, shape () or (points,)
        k [pressure], for `LPS` and `BondBased` in 2D.

    Raises
    ------
    ValueError
        If a modulus is not > 0 or `plane` is another word.

    Examples
    --------
    >>> k = pd.plane_bulk_modulus(1.0, 0.6, "strain")
    >>> round(float(k), 6)
    1.2
    """
    choice("plane", plane, ("strain", "stress"))
    bulk, shear = as_real(bulk), as_real(shear)
    check_positive("bulk", bulk)
    check_positive("shear", shear)
    bulk, shear = on_host((bulk, shear))
    return on_device(bulk + shear / 3 if plane == "strain" else 9 * bulk * shear / (3 * bulk + 4 * shear))


def check_young_and_poisson(young, poisson, names: tuple[str, str] = ("young", "poisson")) -> None:
    """Raise ValueError for concrete constants that are not E > 0 and −1 < ν < ½. `names` are those of the arguments."""
    check_positive(names[0], young)
    if is_concrete(poisson):
        nu = np.asarray(poisson)
        wrong = f"{names[1]} must lie between -1 and 1/2, because other solids are unstable; got {poisson}"
        require(poisson, (nu > -1) & (nu < 0.5), wrong)


def bulk_and_shear(young, poisson) -> tuple[Array, Array]:
    """K and G [pressure] of a solid of Young's modulus E > 0 [pressure] and Poisson's ratio −1 < ν < ½ [-]."""
    young, poisson = as_real(young), as_real(poisson)
    check_young_and_poisson(young, poisson)
    E, nu = on_host((young, poisson))
    return on_device((E / (3 * (1 - 2 * nu)), E / (2 * (1 + nu))))
