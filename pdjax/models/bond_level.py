"""The bond-level gradient: F̄ mended on each bond so that it maps ξ to Y exactly.

    F_ξ = F̄ + (Y − F̄ξ)⊗ξ/|ξ|² = F̄ (I − n⊗n) + Y⊗ξ/|ξ|²,     W = (1/ω₀) Σ w ψ(F_ξ),  ω₀ = Σ w
    T = ω [P_ξ ξ/(|ξ|² ω₀) + S K⁻¹ ξ],     S = (1/ω₀) Σ w P_ξ (I − n⊗n),     P_ξ = ∂ψ/∂F at F_ξ

**One-sided** (`BondLevel`): F̄ of the point whose energy it is: one family is enough; the point state is (F̄, S K⁻¹,
1/ω₀).
**Two-sided** (`BondLevelAverage`): F̄ → ½(F̄_i + F̄_j), the form of most public codes, here with the exact gradient of its
energy; it reaches three rings. Both are exact for affine maps, and a bond's own z costs energy in both.
Source: Breitzman & Dayal 2018.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.bonds import EACH_BOND, Bonds
from .base import AbstractModel, PointStateModel, TwoStageModel
from .kinematics import displacement_gradient, shape_tensor_K, solve_positive
from .laws import Law
from .with_law import check_law, energy_of_gradient, stress_of_gradient


def mended(H: Float[Array, "dim dim"], bond: Bonds) -> Float[Array, "dim dim"]:
    """F_ξ − I on one bond, from H = F̄ − I: maps ξ to Y exactly.

    0 on a bond of no weight (padding, damage): it carries nothing, but under a large rotation or once broken
    det F_ξ may be negative, and a law in F has no number for that.
    """
    z = bond.eta - H @ bond.xi
    return jnp.where(bond.omega > 0, H + jnp.outer(z, bond.xi) / jnp.dot(bond.xi, bond.xi), 0.0)


class GradientModel(AbstractModel):
    """What models of one law by gradients on bonds share."""

    law: Law
    affine_exact: ClassVar[bool] = True

    def __check_init__(self):
        check_law(type(self).__name__, self.law)

    @property
    def isotropic(self) -> bool:
        return self.law.isotropic

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """ψ(F)."""
        return energy_of_gradient(self.law, F - jnp.eye(F.shape[0], dtype=F.dtype))

    shape_tensor = staticmethod(shape_tensor_K)


class BondLevel(GradientModel, PointStateModel):
    """One-sided bond-level gradient of a law in F, or in E (of F_ξ's Green–Lagrange strain)."""

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        H, w = displacement_gradient(bonds), bonds.omega * bonds.volume
        each = jax.vmap(lambda bond: energy_of_gradient(self.law, mended(H, bond)), (EACH_BOND,))(bonds)
        return jnp.sum(w * each) / jnp.sum(w)

    def point_state(self, bonds: Bonds) -> tuple[Array, Array, Array]:
        H, w = displacement_gradient(bonds), bonds.omega * bonds.volume
        P = jax.vmap(lambda bond: stress_of_gradient(self.law, mended(H, bond)), (EACH_BOND,))(bonds)
        n2 = jnp.sum(bonds.xi**2, axis=1)
        along = jnp.einsum("b,bij,bj,bk->ik", w / n2, P, bonds.xi, bonds.xi)
        S = (jnp.einsum("b,bij->ij", w, P) - along) / jnp.sum(w)
        return H, solve_positive(shape_tensor_K(bonds), S.T).T, 1 / jnp.sum(w)

    def bond_force(self, here: tuple[Array, Array, Array], there, bond: Bonds) -> Float[Array, " dim"]:
        H, Z, share = here
        P = stress_of_gradient(self.law, mended(H, bond))
        return bond.omega * ((share / jnp.dot(bond.xi, bond.xi)) * P + Z) @ bond.xi


class TwoSidedModel(GradientModel, TwoStageModel):
    """W_i = (1/ω₀) Σ w ψ of the mean of both ends' gradients, mended; a point's state is (F̄ − I, 1/ω₀)."""

    def bond_energy(self, here: tuple[Array, Array], there: tuple[Array, Array], bond: Bonds) -> Float[Array, ""]:
        (H, share), (other, _) = here, there
        return bond.omega * bond.volume * share * energy_of_gradient(self.law, mended((H + other) / 2, bond))


class BondLevelAverage(TwoSidedModel):
    """Two-sided bond-level gradient: the mean of both ends' F̄."""

    def point_state(self, bonds: Bonds) -> tuple[Array, Array]:
        return displacement_gradient(bonds), 1 / jnp.sum(bonds.omega * bonds.volume)
