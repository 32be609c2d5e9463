# mypy: disable-error-code="attr-defined"
"""Correspondence models of order m by the Seth–Hill strains of the bonds: the generalised, and the extended one.

    W = Ψ(Ē_m),   Ē_m = L⁻¹ : Σ w e_m(s) n⊗n,   e_m = (s^{2m} − 1)/2m  (m = 0: log s)
    T = ω (n · Z n) s^{2m} Y/|Y|²,   Z = L⁻¹ : S,   S = ∂Ψ/∂E

The point state is Z (a Mandel vector). Ē_m is exact under affine maps for m = 1, and for similarities; otherwise to
first order. **Generalised** (`SethHill`): L = Σ w n⊗n⊗n⊗n is that of the family. **Extended** (`TupekRadovitzky`): L is
that of a full ball of the same ω₀ = Σ w, ω₀ (I⊗I + 2 𝟙)/(d(d+2)): equal in 1D, off by the lattice's anisotropy inside a
lattice, wrong at a surface.

Sources: Tupek & Radovitzky 2014; Foster & Xu 2018; Behzadinasab & Foster, Eq. (TC).
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._checks import as_real
from ..kinematics import (
    bond_strain_moment,
    direction_mandel,
    from_mandel,
    local_strain,
    log_stretch,
    mandel_basis,
    shape_tensor_L,
    solve_positive,
    to_mandel,
)
from ..laws import Law, law_stress
from ..neighbours import Bonds
from .control import Control
from .with_law import WithLaw


class BondStrainModel(WithLaw):
    """W = Ψ(Ē_m) of order `m` with any fourth-order shape tensor: subclasses define `fourth`."""

    def __check_init__(self):
        if not isinstance(self.law, Law) or self.law.takes != "E":
            raise ValueError(
                f"{type(self).__name__} needs a law in a strain tensor (takes = 'E', e.g. LinearElastic): it has no"
                f" deformation gradient to give; got {self.law!r}"
            )

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        """L as a Mandel matrix [length^dim]."""
        raise NotImplementedError

    def law_energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.law.energy(self.strain(bonds))

    def law_state(self, bonds: Bonds) -> Float[Array, " p"]:
        return solve_positive(self.fourth(bonds), to_mandel(self.stress(bonds)))

    def law_force(self, here: Float[Array, " p"], bond: Bonds) -> Float[Array, " dim"]:
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
        return from_mandel(solve_positive(self.fourth(bonds), bond_strain_moment(bonds, self.m)), bonds.xi.shape[-1])

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """S = ∂Ψ/∂E at Ē_m [pressure], the stress conjugate to Ē_m."""
        return law_stress(self.law, self.strain(bonds))


class SethHill(BondStrainModel):
    """Generalised finite-deformation correspondence of order m [-] with a law in E, and a control or none."""

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    control: Control | None = None

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        return shape_tensor_L(bonds)


class TupekRadovitzky(BondStrainModel):
    """Extended correspondence of order m [-]: the shape tensor of a full ball for every family."""

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    control: Control | None = None
    moduli_exact: ClassVar[bool] = False

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        dim = bonds.xi.shape[-1]
        trace = np.trace(mandel_basis(dim), axis1=1, axis2=2)
        ball = (np.outer(trace, trace) + 2 * np.eye(len(trace))) / (dim * (dim + 2))
        return jnp.sum(bonds.omega * bonds.volume) * jnp.asarray(ball, dtype=bonds.xi.dtype)
