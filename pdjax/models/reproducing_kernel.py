"""Reproducing-kernel correspondence, bond-associated: F̄ of a higher order than affine, corrected on each bond.

    F̄ = I + Σ η⊗Φ,    Φ_j = w_j (1/δ) Q_∇ᵀ M⁻¹ Q(ξ_j/δ),    M = Σ w Q Qᵀ,    Q = the monomials of degree 1 to order
    F_b = ½(F̄_i + F̄_j) corrected on the bond (bond_level.mended),    W_i = (1/ω₀) Σ w ψ(F_b),    w = ω V, ω₀ = Σ w

Q_∇ᵀ selects the linear monomials. F̄ is then the gradient at ξ = 0 of the weighted least-squares polynomial through the
family, and it is exact for polynomial fields of that order. Order 1 gives Φ = w K⁻¹ξ, which is `BondLevelAverage`. The
force is the exact gradient of Σ V_i W_i and reaches three rings of neighbours. (One public code corrects with
(I − ξξᵀ)/|ξ|², which is right only for |ξ| = 1.)

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
    """Reproducing-kernel correspondence: W = (1/ω₀) Σ w ψ(F_b) with gradients exact for polynomial displacements.

    F̄ is the gradient of a weighted least-squares polynomial through the family. F_b is the mean of F̄ at both ends of
    the bond, corrected so that it maps ξ to Y exactly. The force is the exact gradient of the energy and reaches three
    rings of neighbours. Order 1 is the same model as `BondLevelAverage`.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F_b. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.
    order : 1 or 2
        Degree of the polynomial, 2 by default. It is static: another order recompiles.

    Raises
    ------
    ValueError
        If `law` is not a `Law` or `order` is not 1 or 2. Functions that use the model raise it for a family with
        too few bonds for the polynomial.

    References
    ----------
    Hillman, Pasetto & Zhou 2020; Behzadinasab, Trask & Bazilevs 2021.

    Examples
    --------
    A uniform stretch of 1.1 has the energy of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.ReproducingKernel(pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

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
        """The moment matrix M [length^dim] of one family."""
        Q = self._basis(bonds)
        return jnp.einsum("b,bp,bq->pq", bonds.omega * bonds.volume, Q, Q)

    def point_state(self, bonds: Bonds) -> tuple[Array, Array]:
        dim, w, Q = bonds.xi.shape[1], bonds.omega * bonds.volume, self._basis(bonds)
        linear = jnp.asarray(np.eye(Q.shape[1], dim), dtype=Q.dtype)
        weights = Q @ solve_positive(self.shape_tensor(bonds), linear) * (w / bonds.horizon)[:, None]
        return jnp.einsum("bi,bj->ij", bonds.eta, weights), 1 / jnp.sum(w)
