"""Silling's original correspondence model.

    W = ψ(F̄),   F̄ = (Σ w Y⊗ξ) K⁻¹,   K = Σ w ξ⊗ξ;   T = ω P K⁻¹ ξ,   P = ∂ψ/∂F

The point state is Z = P K⁻¹. A law in F is taken as it is; a law in E is fed the Green–Lagrange strain of F̄
(LinearElastic is then St. Venant–Kirchhoff). F̄ is exact for every affine map, at surfaces too; non-affine fields
with the same F̄ cost nothing: the zero-energy modes. Source: Silling et al. 2007.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..kinematics import displacement_gradient, shape_tensor_K, solve_positive
from ..laws import Law, law_stress
from ..neighbours import Bonds
from .base import PointStateModel


class Correspondence(PointStateModel):
    """Silling's correspondence model with a law in F, or in E (of F̄'s Green–Lagrange strain)."""

    law: Law
    affine_exact: ClassVar[bool] = True

    def __check_init__(self):
        if not isinstance(self.law, Law):
            raise ValueError(f"Correspondence needs a Law (LinearElastic, NeoHookean, EnergyLaw); got {self.law!r}")

    def _energy(self, H: Float[Array, "dim dim"]) -> Float[Array, ""]:
        if self.law.takes == "E":
            return self.law.energy((H + H.T + H.T @ H) / 2)
        return self.law.energy(jnp.eye(H.shape[0], dtype=H.dtype) + H)

    @property
    def isotropic(self) -> bool:
        return self.law.isotropic

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self._energy(displacement_gradient(bonds))

    def point_state(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        P = jax.grad(self._energy)(displacement_gradient(bonds))
        return solve_positive(shape_tensor_K(bonds), P.T).T

    def bond_force(self, here: Float[Array, "dim dim"], there, bond: Bonds) -> Float[Array, " dim"]:
        return bond.omega * (here @ bond.xi)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        return shape_tensor_K(bonds)

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """ψ(F)."""
        return self._energy(F - jnp.eye(F.shape[0], dtype=F.dtype))

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """The law's own stress [pressure]: P = ∂ψ/∂F for a law in F, S = ∂Ψ/∂E for a law in E."""
        if self.law.takes == "E":
            return law_stress(self.law, self.strain(bonds))
        H = displacement_gradient(bonds)
        return law_stress(self.law, jnp.eye(H.shape[0], dtype=H.dtype) + H)
