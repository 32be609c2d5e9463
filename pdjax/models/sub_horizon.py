"""Sub-horizon correspondence: the family split into sectors, each with a deformation gradient of its own.

    F̄_s = (Σ χ_s w Y⊗ξ) K_s⁻¹,   K_s = Σ χ_s w ξ⊗ξ,   W = Σ_s p_s ψ(F̄_s),   p_s = ω₀ₛ/Σ ω₀ₛ,   ω₀ₛ = Σ χ_s w
    T = ω Σ_s χ_s p_s P_s K_s⁻¹ ξ

The sectors are the 2^d halves, quadrants or octants of the axes; a bond on a border (ξ_i = 0) belongs to its
neighbours in equal parts, so χ_s = ∏_i of 1, ½ or 0. A sector that is empty, or whose bonds do not span space (at a
surface), is dropped and the weights are those of the rest; a family with no sector left is refused. The point state is
p_s P_s K_s⁻¹ of every sector.

No public code of it was found; the sharing of borders and the dropping are choices made here, checked by invariants.
The axes are preferred directions: the lattice's symmetry is kept, isotropy is not. Source: Chowdhury et al. 2019.
"""

import itertools
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.bonds import EACH_BOND, Bonds
from .base import PointStateModel, Sums
from .bond_level import GradientModel
from .kinematics import solve_positive
from .with_law import energy_of_gradient, stress_of_gradient

TIE = 1e-9  # of the bond's length: components nearer to 0 lie on a border
SPAN = 1e-2  # det K_s over (tr K_s/d)^d below which bonds do not span; a full quadrant has 0.59, an octant 0.30


def sectors(xi: Float[Array, " dim"]) -> Float[Array, " sectors"]:
    """χ_s of one bond: the share of it that each sector has; they add up to 1."""
    dim = xi.shape[0]
    signs = jnp.asarray(list(itertools.product((1.0, -1.0), repeat=dim)), dtype=xi.dtype)
    x = jnp.where(jnp.abs(xi) <= TIE * jnp.sqrt(jnp.sum(xi**2)), 0.0, xi)
    return jnp.prod((1 + signs * jnp.sign(x)) / 2, axis=1)


class SubHorizon(GradientModel, PointStateModel):
    """Sub-horizon correspondence of a law in F, or in E (of F̄_s's Green–Lagrange strain)."""

    even: ClassVar[bool] = False

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        share = sectors(bond.xi) * bond.omega * bond.volume
        K, M = (x[None] * share[:, None, None] for x in (jnp.outer(bond.xi, bond.xi), jnp.outer(bond.eta, bond.xi)))
        return (share, K), M

    def _sums(self, bonds: Bonds) -> tuple[Any, Any]:
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), jax.vmap(self.moments, (EACH_BOND,))(bonds))

    def _kept(self, K: Float[Array, "sectors dim dim"]) -> Array:
        """Which sectors are kept."""
        size = jnp.trace(K, axis1=1, axis2=2) / K.shape[-1]
        unit = K / jnp.where(size > 0, size, 1.0)[:, None, None]
        return (size > 0) & (jnp.linalg.det(unit) > SPAN)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"]:
        """K [length^(dim+2)], zero where no sector of the family spans space."""
        (_, K), _ = self._sums(bonds)
        return jnp.where(jnp.any(self._kept(K)), jnp.sum(K, axis=0), 0.0)

    def _sectors(self, reference: tuple[Array, Array], M: Array) -> tuple[Array, Array, Array]:
        """K_s⁻¹ (I where dropped), H_s = F̄_s − I and p_s (0 where dropped) of every sector, from the sums."""
        share, K = reference
        kept = self._kept(K)
        I = jnp.eye(K.shape[-1], dtype=K.dtype)
        inverse = jax.vmap(lambda A: solve_positive(A, I))(jnp.where(kept[:, None, None], K, I))
        weight = jnp.where(kept, share, 0.0)
        return inverse, jnp.where(kept[:, None, None], M @ inverse, 0.0), weight / jnp.sum(weight)

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        _, H, part = self._sectors(*self._sums(bonds))
        return jnp.dot(part, jax.vmap(lambda H: energy_of_gradient(self.law, H))(H))

    def state(self, sums: Sums) -> Float[Array, "sectors dim dim"]:
        inverse, H, part = self._sectors(sums.reference, sums.deformed)
        P = jax.vmap(lambda H: stress_of_gradient(self.law, H))(H)
        return part[:, None, None] * (P @ inverse)

    def bond_force(self, here: Float[Array, "sectors dim dim"], there, bond: Bonds) -> Float[Array, " dim"]:
        return bond.omega * jnp.einsum("s,sij,j->i", sectors(bond.xi), here, bond.xi)
