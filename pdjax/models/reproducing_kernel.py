"""Reproducing-kernel correspondence, bond-associated: F̄ of a higher order than affine, mended on each bond.

    F̄ = I + Σ η⊗Φ,    Φ_j = w_j (1/δ) Q_∇ᵀ M⁻¹ Q(ξ_j/δ),    M = Σ w Q Qᵀ,    Q = the monomials of degree 1 to `order`
    F_b = ½(F̄_i + F̄_j) mended on the bond (`bond_level.mended`),    W_i = (1/ω₀) Σ w ψ(F_b)

Q_∇ᵀ picks the linear monomials: F̄ is the gradient at ξ = 0 of the weighted least-squares polynomial through the family,
exact for polynomial fields of that order. Order 1 is Φ = w K⁻¹ξ: `BondLevelAverage`. The force is the exact gradient of
Σ V_i W_i and reaches three rings. (One public code mends with (I − ξξᵀ)/|ξ|²: right for |ξ| = 1 only.)
Sources: Hillman, Pasetto & Zhou 2020; Behzadinasab, Trask & Bazilevs 2021.
"""

import itertools

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry.bonds import Bonds
from .bond_level import TwoSidedModel
from .kinematics import solve_positive


class ReproducingKernel(TwoSidedModel):
    """Reproducing-kernel correspondence of a law in F or E; `order` 1 (linear basis) or 2 (quadratic)."""

    order: int = eqx.field(static=True, default=2)

    def __check_init__(self):
        if self.order not in (1, 2):
            raise ValueError(f"order must be 1 (linear basis) or 2 (quadratic); got {self.order!r}")

    def _basis(self, bonds: Bonds) -> Float[Array, "bonds n"]:
        x = bonds.xi / bonds.horizon
        pairs = itertools.combinations_with_replacement(range(x.shape[1]), 2)
        return jnp.concatenate(
            [x] + ([jnp.stack([x[:, i] * x[:, j] for i, j in pairs], axis=1)] * (self.order == 2)), 1
        )

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"]:
        """The moment matrix M [length^dim]."""
        Q = self._basis(bonds)
        return jnp.einsum("b,bp,bq->pq", bonds.omega * bonds.volume, Q, Q)

    def point_state(self, bonds: Bonds) -> tuple[Array, Array]:
        dim, w, Q = bonds.xi.shape[1], bonds.omega * bonds.volume, self._basis(bonds)
        linear = jnp.asarray(np.eye(Q.shape[1], dim), dtype=Q.dtype)
        weights = Q @ solve_positive(self.shape_tensor(bonds), linear) * (w / bonds.horizon)[:, None]
        return jnp.einsum("bi,bj->ij", bonds.eta, weights), 1 / jnp.sum(w)
