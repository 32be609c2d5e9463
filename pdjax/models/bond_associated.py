"""Bond-associated correspondence: every bond has a family of its own, the part of the point's that lies near its end.

    h_b = {k in H : |ξ_k − ξ_b| ≤ r δ},   K_b = Σ_{k∈h_b} w_k ξ_k⊗ξ_k,   F_b = I + (Σ_{k∈h_b} w_k η_k⊗ξ_k) K_b⁻¹,

**Energy-consistent** (`BondAssociated`): W = Σ_b v_b ψ(F_b), v_b = V_{h_b}/Σ_b V_{h_b} with the volume V_{h_b} of the
bond's sub-family, as published and as public codes have it, and so

    T_k = ω_k Σ_{b: k∈h_b} v_b P_b K_b⁻¹ ξ_k.

**As first published** (`BondAssociatedForce`): T_b = ω_b (V_h/V_H) P_b K_b⁻¹ ξ_b, the stress of a bond's own sub-family
on that bond alone: the derivative of no energy, Jacobian not symmetric, and Σ T×Y ≠ 0: internal forces exert moments.
F_b is exact for affine maps, but Σ V T⊗ξ is not P: off by +9 % in 1D at N = 3, −14 % in 2D at N = 2.
Each sub-family must span space: r near 0 or a small family is refused with the bond named. Work is bonds² a point.
Sources: Chen 2018 (force); Chen & Spencer 2019 (energy).
"""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._internal.checks import as_real, check_positive
from ..geometry.bonds import TIE, Bonds
from .bond_level import GradientModel
from .kinematics import solve_positive
from .with_law import energy_of_gradient, stress_of_gradient


class _SubFamilies(GradientModel):
    """Kinematics by sub-families of reach r δ, r [-] > 0."""

    r: Float[Array, "..."] = eqx.field(converter=as_real, default=1.0)

    def __check_init__(self):
        check_positive("r", self.r)

    def _members(self, bonds: Bonds) -> Float[Array, "bonds bonds"]:
        """w_k where k belongs to h_b, else 0: (b, k)."""
        return jnp.where(self._inside(bonds), (bonds.omega * bonds.volume)[None, :], 0.0)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"]:
        """K_b of every bond; of a bond without weight (padding), which has no part in anything, the family's K."""
        w = bonds.omega * bonds.volume
        members = jnp.where((w > 0)[:, None], self._members(bonds), w[None, :])
        return jnp.einsum("bk,ki,kj->bij", members, bonds.xi, bonds.xi)

    def _gradients(self, bonds: Bonds) -> tuple[Array, Array]:
        """K_b⁻¹ and H_b = F_b − I of every bond, 0 of a bond without weight (K_b is not that of its members)."""
        I = jnp.eye(bonds.xi.shape[1], dtype=bonds.xi.dtype)
        inverse = jax.vmap(lambda K: solve_positive(K, I))(self.shape_tensor(bonds))
        members = jnp.where((bonds.omega > 0)[:, None], self._members(bonds), 0.0)
        return inverse, jnp.einsum("bk,ki,kj->bij", members, bonds.eta, bonds.xi) @ inverse

    def _inside(self, bonds: Bonds) -> Bool[Array, "bonds bonds"]:
        """(b, k): whether k belongs to h_b."""
        apart = jnp.sum((bonds.xi[:, None, :] - bonds.xi[None, :, :]) ** 2, axis=-1)
        return apart <= (self.r * bonds.horizon * (1 + TIE)) ** 2

    def _volumes(self, bonds: Bonds) -> Float[Array, " bonds"]:
        """V of the true bonds, 0 of those without weight."""
        return jnp.where(bonds.omega > 0, bonds.volume, 0.0)

    def _shares(self, bonds: Bonds) -> Float[Array, " bonds"]:
        """v_b, 0 of a bond without weight."""
        V = self._volumes(bonds)
        of_family = jnp.where(V > 0, self._inside(bonds) @ V, 0.0)
        return of_family / jnp.sum(of_family)


class BondAssociated(_SubFamilies):
    """Bond-associated correspondence of a law in F or E, with the forces of its energy."""

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        _, H = self._gradients(bonds)
        return jnp.dot(self._shares(bonds), jax.vmap(lambda H: energy_of_gradient(self.law, H))(H))

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        inverse, H = self._gradients(bonds)
        P = jax.vmap(lambda H: stress_of_gradient(self.law, H))(H)
        each = self._shares(bonds)[:, None, None] * (P @ inverse)
        member = self._members(bonds)  # (b, k), holds ω_k V_k
        return jnp.einsum("bk,bij,kj->ki", member, each, bonds.xi) / bonds.volume[:, None]


class BondAssociatedForce(_SubFamilies):
    """Bond-associated correspondence as first published: a force without an energy, and not the law's stress."""

    hyperelastic: ClassVar[bool] = False
    balances_moments: ClassVar[bool] = False
    affine_exact: ClassVar[bool] = False
    moduli_exact: ClassVar[bool] = False

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        raise ValueError("BondAssociatedForce is not the derivative of an energy; BondAssociated is")

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        inverse, H = self._gradients(bonds)
        V = self._volumes(bonds)
        P = jax.vmap(lambda H: stress_of_gradient(self.law, H))(H)
        part = jnp.where(self._members(bonds) > 0, V[None, :], 0.0).sum(axis=1) / jnp.sum(V)
        return (part * bonds.omega)[:, None] * jnp.einsum("bij,bj->bi", P @ inverse, bonds.xi)
