"""Elastic constants of plane problems: what a two-dimensional model is to be given for a solid of K and G.

    plane strain  k = K + G/3,     plane stress  k = 9KG/(3K + 4G)        (d-dimensional bulk modulus, d = 2)

The shear modulus G is the same in both. Lamé's first constant of the plane is k − G.
"""

import jax.numpy as jnp
from jaxtyping import Array

from .._checks import as_real, choice, require


def plane_bulk_modulus(bulk, shear, plane: str) -> Array:
    """k [pressure] of plane "strain" or "stress" from K and G of the solid [pressure], > 0."""
    choice("plane", plane, ("strain", "stress"))
    bulk, shear = as_real(bulk), as_real(shear)
    for name, value in (("bulk", bulk), ("shear", shear)):
        require(value, jnp.isfinite(value) & (value > 0), f"{name} must be finite and > 0; got {value}")
    return bulk + shear / 3 if plane == "strain" else 9 * bulk * shear / (3 * bulk + 4 * shear)
