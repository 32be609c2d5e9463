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

from .._internal.checks import as_real, is_concrete
from ..geometry.bonds import Bonds
from .base import Sums
from .control import Control
from .kinematics import (
    bond_strain_moment,
    direction_mandel,
    from_mandel,
    local_strain,
    log_stretch,
    mandel_basis,
    seth_hill,
    shape_tensor_L,
    solve_positive,
    to_mandel,
)
from .laws import Law, law_stress
from .with_law import WithLaw


class BondStrainModel(WithLaw):
    """W = Ψ(Ē_m) of order `m` with any fourth-order shape tensor: subclasses define `fourth`."""

    def __check_init__(self):
        if not isinstance(self.law, Law) or self.law.takes != "E":
            raise ValueError(
                f"{type(self).__name__} needs a law in a strain tensor (takes = 'E', e.g. LinearElastic): it has no"
                f" deformation gradient to give; got {self.law!r}"
            )

    @property
    def degree(self) -> int:  # type: ignore[override]
        """2 for m = 1 where that is known (not traced), without a control that is of none."""
        quadratic = is_concrete(self.m) and bool(np.all(np.asarray(self.m) == 1))
        return 2 if quadratic and (self.control is None or self.control.degree) else 0

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        """L as a Mandel matrix [length^dim]."""
        raise NotImplementedError

    def law_energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.law.energy(self.strain(bonds))

    def fourth_moment(self, bond: Bonds) -> Array:
        """What one bond adds to the sum that `fourth_of` makes L from."""
        raise NotImplementedError

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        raise NotImplementedError

    def law_moments(self, bond: Bonds) -> tuple[Array, Array]:
        w = bond.omega * bond.volume
        e = seth_hill(log_stretch(bond.xi, bond.eta), self.m)
        return self.fourth_moment(bond), w * e * direction_mandel(bond.xi)

    def law_state(self, sums: Sums) -> Float[Array, " p"]:
        L = self.fourth_of(sums.reference, sums.dim)
        E = from_mandel(solve_positive(L, sums.deformed), sums.dim)
        return solve_positive(L, to_mandel(law_stress(self.law, E)))

    def law_force(self, here: Float[Array, " p"], bond: Bonds) -> Float[Array, " dim"]:
        growth = jnp.exp(2 * (self.m - 1) * log_stretch(bond.xi, bond.eta))  # s^{2m} / s²
        scale = bond.omega / jnp.sum(bond.xi * bond.xi, axis=-1)
        return scale * (direction_mandel(bond.xi) @ here) * growth * (bond.xi + bond.eta)

    shape_tensor = staticmethod(shape_tensor_L)

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

    def fourth_moment(self, bond: Bonds) -> Array:
        v = direction_mandel(bond.xi)
        return bond.omega * bond.volume * jnp.outer(v, v)

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        return total


class TupekRadovitzky(BondStrainModel):
    """Extended correspondence of order m [-]: the shape tensor of a full ball for every family."""

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    control: Control | None = None
    moduli_exact: ClassVar[bool] = False

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        return self.fourth_of(jnp.sum(bonds.omega * bonds.volume), bonds.xi.shape[-1])

    def fourth_moment(self, bond: Bonds) -> Array:
        return bond.omega * bond.volume

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        trace = np.trace(mandel_basis(dim), axis1=1, axis2=2)
        ball = (np.outer(trace, trace) + 2 * np.eye(len(trace))) / (dim * (dim + 2))
        return total * jnp.asarray(ball, dtype=total.dtype)
