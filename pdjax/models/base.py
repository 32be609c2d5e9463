"""What a material model is: an energy of one family, or two small functions of it.

    T_j = (1/V_j) ∂W/∂Y_j            force state [force/length^(2 dim)]

A model with a **point state** gives `point_state(bonds) -> A` (sums over the family turned into what one bond needs)
and `bond_force(A_here, A_there, bond) -> t`; only A travels between points. Such a force state has a cheap exact
derivative, ∂T_b/∂Y_c = δ_bc B_b + G_b R_c, with B = ∂t/∂η, G = ∂t/∂A, R = ∂A/∂η: a block for each bond plus a
product of rank dim A. Models that give the energy alone take both from autodiff.

A model declares its promises as class attributes; the tests, the sparsity and the choice of method read them.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..kinematics import displacement_gradient
from ..neighbours import Bonds


class AbstractModel(eqx.Module):
    """A model by its energy: subclass it, define `energy(bonds) -> W`, and everything else follows.

    Promises (class attributes): `hyperelastic` the force is the gradient of an energy; `objective` a rigid
    rotation changes nothing; `affine_exact` every affine map gives the law's exact stress; `rings` how many rings of
    neighbours the force on a point reaches; `needs_other_end` a bond's force needs the state of its far end.
    """

    hyperelastic: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    affine_exact: ClassVar[bool] = False
    rings: ClassVar[int] = 2
    needs_other_end: ClassVar[bool] = False

    @property
    def isotropic(self) -> bool:
        """Promise: no direction of the material is preferred (the lattice's own apart). False unless known."""
        return False

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        """W [energy/length^dim], the energy density of one family."""
        raise NotImplementedError

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        """T [force/length^(2 dim)] on every bond of the family: (1/V) ∂W/∂η."""
        gradient = jax.grad(lambda eta: self.energy(bonds._replace(eta=eta)))(bonds.eta)
        return gradient / bonds.volume[:, None]

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "n n"] | None:
        """The matrix that must be invertible for this model to make sense, or None."""
        return None

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """The classical energy density this model stands for, ψ(F); models without one refuse."""
        raise ValueError(f"{type(self).__name__} has no classical law behind it: criterion 'local' does not apply")

    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Green–Lagrange strain of F̄ [-], unless the model has its own measure."""
        H = displacement_gradient(bonds)
        return (H + H.T + H.T @ H) / 2

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Σ V T⊗ξ [pressure], the first Piola–Kirchhoff stress, unless the model has its law's own stress."""
        return jnp.einsum("b,bi,bj->ij", bonds.volume, self.force_state(bonds), bonds.xi)


class PointStateModel(AbstractModel):
    """A model by its two small functions; the force state is their composition."""

    def point_state(self, bonds: Bonds) -> Any:
        """A: an array or a tree of arrays, from sums over the family."""
        raise NotImplementedError

    def bond_force(self, here: Any, there: Any, bond: Bonds) -> Float[Array, " dim"]:
        """t [force/length^(2 dim)] on one bond (ξ (dim,), η (dim,), ω, V scalars)."""
        raise NotImplementedError

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        """T on every bond, every point of the family being in this point's own state (homogeneous deformation)."""
        state = self.point_state(bonds)
        return jax.vmap(self.bond_force, (None, None, 0))(state, state, bonds)
