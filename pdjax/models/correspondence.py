"""Silling's original correspondence model.

    W = ψ(F̄),   F̄ = (Σ w Y⊗ξ) K⁻¹,   K = Σ w ξ⊗ξ;   T = ω P K⁻¹ ξ,   P = ∂ψ/∂F

The point state is Z = P K⁻¹. A law in F is taken as it is; a law in E is fed the Green–Lagrange strain of F̄
(LinearElastic is then St. Venant–Kirchhoff). F̄ is exact for every affine map, at surfaces too; non-affine fields
with the same F̄ cost nothing: the zero-energy modes, which a `control` opposes. Source: Silling et al. 2007.
"""

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.bonds import Bonds
from .base import Sums
from .control import Control
from .kinematics import displacement_gradient, gradient_moments, gradient_of_moments, shape_tensor_K, solve_positive
from .laws import Law, law_stress
from .with_law import WithLaw, check_law, energy_of_gradient, stress_of_gradient


class Correspondence(WithLaw):
    """Silling's correspondence model with a law in F, or in E (of F̄'s Green–Lagrange strain), and a control or none."""

    law: Law
    control: Control | None = None
    affine_exact: ClassVar[bool] = True
    by_gradient: ClassVar[bool] = True

    @property
    def degree(self) -> int:  # type: ignore[override]
        return 1 if self.control is None else self.control.degree

    def __check_init__(self):
        check_law("Correspondence", self.law)

    def law_energy(self, bonds: Bonds) -> Float[Array, ""]:
        return energy_of_gradient(self.law, displacement_gradient(bonds))

    def law_moments(self, bond: Bonds) -> tuple[Array, Array]:
        return gradient_moments(bond)

    def law_state(self, sums: Sums) -> Float[Array, "dim dim"]:
        P = stress_of_gradient(self.law, gradient_of_moments(sums.reference, sums.deformed))
        return solve_positive(sums.reference, P.T).T

    def law_force(self, here: Float[Array, "dim dim"], bond: Bonds) -> Float[Array, " dim"]:
        return bond.omega * (here @ bond.xi)

    shape_tensor = staticmethod(shape_tensor_K)

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """ψ(F)."""
        return energy_of_gradient(self.law, F - jnp.eye(F.shape[0], dtype=F.dtype))

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """The law's own stress [pressure]: P = ∂ψ/∂F for a law in F, S = ∂Ψ/∂E for a law in E."""
        if self.law.takes == "E":
            return law_stress(self.law, self.strain(bonds))
        H = displacement_gradient(bonds)
        return law_stress(self.law, jnp.eye(H.shape[0], dtype=H.dtype) + H)
