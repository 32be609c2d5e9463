"""The bond-level gradient: F̄ corrected on each bond so that it maps ξ to Y exactly.

    F_ξ = F̄ + (Y − F̄ξ)⊗ξ/|ξ|² = F̄ (I − n⊗n) + Y⊗ξ/|ξ|²,     W = (1/ω₀) Σ w ψ(F_ξ),  ω₀ = Σ w
    T = ω [P_ξ ξ/(|ξ|² ω₀) + S K⁻¹ ξ],     S = (1/ω₀) Σ w P_ξ (I − n⊗n),     P_ξ = ∂ψ/∂F at F_ξ

with w = ω V and n = ξ/|ξ|.

**One-sided** (`BondLevel`): F̄ belongs to the point whose energy is computed, so one family is enough. The point state
is (F̄, S K⁻¹, 1/ω₀).

**Two-sided** (`BondLevelAverage`): F̄ is replaced by the mean ½(F̄_i + F̄_j) of both ends, as in most public codes. The
force here is the exact gradient of the energy, and it reaches three rings of neighbours.

Both are exact for affine maps. In both, the deviation z = Y − F̄ξ of a single bond has an energy, so the models need no
control of zero-energy modes.

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
    """F_ξ − I on one bond, from H = F̄ − I; F_ξ maps ξ to Y exactly.

    A bond without weight (padded or broken) gets 0. Its force is zero anyway, but its det F_ξ may be negative under a
    large rotation or after fracture, and a law in F would return NaN.
    """
    z = bond.eta - H @ bond.xi
    return jnp.where(bond.omega != 0, H + jnp.outer(z, bond.xi) / jnp.dot(bond.xi, bond.xi), 0.0)


class GradientModel(AbstractModel):
    """Base of models that evaluate one law at deformation gradients of bonds."""

    law: Law
    affine_exact: ClassVar[bool] = True

    def __check_init__(self):
        check_law(type(self).__name__, self.law)

    @property
    def isotropic(self) -> bool:
        return self.law.isotropic

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Energy density ψ(F) [pressure] of the law at the deformation gradient F (dim, dim)."""
        return energy_of_gradient(self.law, F - jnp.eye(F.shape[0], dtype=F.dtype))

    shape_tensor = staticmethod(shape_tensor_K)


class BondLevel(GradientModel, PointStateModel):
    """Bond-level model, one-sided: W = (1/ω₀) Σ w ψ(F_ξ) with ω₀ = Σ w.

    F_ξ = F̄ + (Y − F̄ξ)⊗ξ/|ξ|² is the nonlocal deformation gradient F̄ of the point, corrected on each bond so that it
    maps ξ to Y exactly. The model is exact for affine maps.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F_ξ. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.

    Raises
    ------
    ValueError
        If `law` is not a `Law`.

    References
    ----------
    Breitzman & Dayal 2018.

    Examples
    --------
    A uniform stretch of 1.1 has the energy of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.BondLevel(pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

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
    """Base of the two-sided models: W_i = (1/ω₀) Σ w ψ(F_ξ).

    F_ξ is the mean of the gradients of both ends, corrected on the bond. A point's state is (F̄ − I, 1/ω₀).
    """

    def bond_energy(self, here: tuple[Array, Array], there: tuple[Array, Array], bond: Bonds) -> Float[Array, ""]:
        (H, share), (other, _) = here, there
        return bond.omega * bond.volume * share * energy_of_gradient(self.law, mended((H + other) / 2, bond))


class BondLevelAverage(TwoSidedModel):
    """Bond-level model, two-sided: W = (1/ω₀) Σ w ψ(F_ξ) with the mean gradient of both ends of each bond.

    F_ξ = F̄ + (Y − F̄ξ)⊗ξ/|ξ|² with F̄ = ½(F̄_i + F̄_j). The model is exact for affine maps. Its force is the exact
    gradient of the energy Σ V_i W_i and reaches three rings of neighbours.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F_ξ. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.

    Raises
    ------
    ValueError
        If `law` is not a `Law`.

    References
    ----------
    Breitzman & Dayal 2018.

    Examples
    --------
    A uniform stretch of 1.1 has the energy of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.BondLevelAverage(pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

    def point_state(self, bonds: Bonds) -> tuple[Array, Array]:
        return displacement_gradient(bonds), 1 / jnp.sum(bonds.omega * bonds.volume)
