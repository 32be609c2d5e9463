"""The generalised finite-deformation correspondence model of order m (Seth–Hill strains of the bonds).

    W = Ψ(Ē_m),   Ē_m = L⁻¹ : Σ w e_m(s) n⊗n,   e_m = (s^{2m} − 1)/2m  (m = 0: log s)
    T = ω (n · Z n) s^{2m} Y/|Y|²,   Z = L⁻¹ : S,   S = ∂Ψ/∂E

The point state is Z (a Mandel vector). Sources: Tupek & Radovitzky 2014; Foster & Xu 2018; Behzadinasab & Foster,
Eq. (TC). Ē_m is exact under affine maps for m = 1, and for similarities; otherwise to first order.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import as_real
from ..kinematics import (
    bond_average_strain,
    direction_mandel,
    from_mandel,
    local_strain,
    log_stretch,
    shape_tensor_L,
    solve_positive,
    to_mandel,
)
from ..laws import Law, law_stress
from ..neighbours import Bonds
from .base import PointStateModel


class SethHill(PointStateModel):
    """Generalised finite-deformation correspondence of order m [-] with a law in E."""

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    affine_exact: ClassVar[bool] = False

    def __check_init__(self):
        if not isinstance(self.law, Law) or self.law.takes != "E":
            raise ValueError(
                "SethHill needs a law in a strain tensor (takes = 'E', e.g. LinearElastic): it has no deformation"
                f" gradient to give; got {self.law!r}"
            )

    @property
    def isotropic(self) -> bool:
        return self.law.isotropic

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.law.energy(self.strain(bonds))

    def point_state(self, bonds: Bonds) -> Float[Array, " p"]:
        return solve_positive(shape_tensor_L(bonds), to_mandel(self.stress(bonds)))

    def bond_force(self, here: Float[Array, " p"], there, bond: Bonds) -> Float[Array, " dim"]:
        growth = jnp.exp(2 * (self.m - 1) * log_stretch(bond.xi, bond.eta))  # s^{2m} / s²
        square = jnp.sum(bond.xi * bond.xi, axis=-1)
        return bond.omega * (direction_mandel(bond.xi) @ here) * growth / square * (bond.xi + bond.eta)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "p p"]:
        return shape_tensor_L(bonds)

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Ψ(E_m(F)) with the classical Seth–Hill strain of F."""
        return self.law.energy(local_strain(F, self.m))

    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Ē_m [-]."""
        return from_mandel(bond_average_strain(bonds, self.m), bonds.xi.shape[-1])

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """S = ∂Ψ/∂E at Ē_m [pressure], the stress conjugate to Ē_m."""
        return law_stress(self.law, self.strain(bonds))
