"""Silling's original correspondence model.

    W = ψ(F̄),   F̄ = (Σ w Y⊗ξ) K⁻¹,   K = Σ w ξ⊗ξ;   T = ω P K⁻¹ ξ,   P = ∂ψ/∂F

with w = ω V. The point state is Z = P K⁻¹. A law in F gets F̄. A law in E gets the Green–Lagrange strain of F̄, so that
LinearElastic becomes St. Venant–Kirchhoff.

F̄ is exact for every affine map, at surfaces too. Displacement fields that differ but have the same F̄ have the same
energy: these are the zero-energy modes, which a `control` opposes. Source: Silling et al. 2007.
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
    """Silling's original correspondence model, W = ψ(F̄).

    F̄ = (Σ w Y⊗ξ) K⁻¹ is the nonlocal deformation gradient, with w = ω V and K = Σ w ξ⊗ξ. The force state is
    T = ω P K⁻¹ ξ with P = ∂ψ/∂F. Every affine map gives exactly the law's energy and stress, at surfaces too. Without a
    control the model has zero-energy modes: at rest it is marginal, not stable.

    Parameters
    ----------
    law : Law
        Material law; a law in F gets F̄, a law in E its Green–Lagrange strain. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.
    control : control, optional
        `SillingControl`, `WanControl` or `LittlewoodControl`, which oppose zero-energy modes. None: no control.

    Raises
    ------
    ValueError
        If `law` is not a `Law`.

    References
    ----------
    Silling et al. 2007.

    Examples
    --------
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> pd.stability(model, pd.lattice_family(2, 2), np.eye(2)).verdict
    'marginal'
    """

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

    def law_energy_of_sums(self, sums: Sums) -> Float[Array, ""]:
        return energy_of_gradient(self.law, gradient_of_moments(sums.reference, sums.deformed))

    def law_state(self, sums: Sums) -> Float[Array, "dim dim"]:
        P = stress_of_gradient(self.law, gradient_of_moments(sums.reference, sums.deformed))
        return solve_positive(sums.reference, P.T).T

    def law_force(self, here: Float[Array, "dim dim"], bond: Bonds) -> Float[Array, " dim"]:
        return bond.omega * (here @ bond.xi)

    shape_tensor = staticmethod(shape_tensor_K)

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Energy density ψ(F) [pressure] of the law at the deformation gradient F (dim, dim)."""
        return energy_of_gradient(self.law, F - jnp.eye(F.shape[0], dtype=F.dtype))

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Stress of the law at F̄ [pressure], (dim, dim): P = ∂ψ/∂F for a law in F, S = ∂Ψ/∂E for a law in E."""
        if self.law.takes == "E":
            return law_stress(self.law, self.strain(bonds))
        H = displacement_gradient(bonds)
        return law_stress(self.law, jnp.eye(H.shape[0], dtype=H.dtype) + H)
