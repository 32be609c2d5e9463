"""Sub-horizon correspondence: the family is split into sectors, each with its own deformation gradient.

    F̄_s = (Σ χ_s w Y⊗ξ) K_s⁻¹,   K_s = Σ χ_s w ξ⊗ξ,   W = Σ_s p_s ψ(F̄_s),   p_s = ω₀ₛ/Σ ω₀ₛ,   ω₀ₛ = Σ χ_s w
    T = ω Σ_s χ_s p_s P_s K_s⁻¹ ξ

with w = ω V. The sectors are the 2^d halves, quadrants or octants between the axes. A bond on a border (ξ_i = 0)
belongs to the adjacent sectors in equal parts, so χ_s is a product of factors 1, ½ or 0, one for each axis. A sector is
dropped if it is empty or its bonds do not span space, as at a surface, and the weights p_s are those of the remaining
sectors. A family without any remaining sector raises ValueError. The point state is p_s P_s K_s⁻¹ of every sector.

No public code of this model was found. The sharing of borders and the dropping of sectors are choices made here, which
invariants check. The axes are preferred directions: the model keeps the symmetry of the lattice but not isotropy.

Source: Chowdhury et al. 2019.
"""

import itertools
from typing import ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..geometry.bonds import EACH_BOND, Bonds
from .base import PointStateModel, Sums
from .bond_level import GradientModel
from .kinematics import solve_positive
from .with_law import energy_of_gradient, stress_of_gradient

TIE = 1e-9  # A bond lies on a border if a component is below this part of its length.
SPAN = 1e-2  # Bonds do not span space if det K_s/(tr K_s/d)^d is below this; a full quadrant has 0.59, an octant 0.30.


def sectors(xi: Float[Array, " dim"]) -> Float[Array, " sectors"]:
    """χ_s of one bond: the part of the bond that belongs to each sector; the parts add up to 1."""
    dim = xi.shape[0]
    signs = jnp.asarray(list(itertools.product((1.0, -1.0), repeat=dim)), dtype=xi.dtype)
    x = jnp.where(jnp.abs(xi) <= TIE * jnp.sqrt(jnp.sum(xi**2)), 0.0, xi)
    return jnp.prod((1 + signs * jnp.sign(x)) / 2, axis=1)


class SubHorizon(GradientModel, PointStateModel):
    """Sub-horizon correspondence: W = Σ_s p_s ψ(F̄_s) over the 2^d sectors of the family.

    F̄_s is the nonlocal deformation gradient of sector s (half, quadrant or octant between the axes), and p_s is the
    sector's part of Σ w. The model is exact for affine maps. It drops sectors whose bonds do not span space. The
    sectors make the axes preferred directions.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F̄_s. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.

    Raises
    ------
    ValueError
        If `law` is not a `Law`. Functions that use the model raise it for a family in which no sector spans
        space.

    References
    ----------
    Chowdhury et al. 2019.

    Examples
    --------
    A uniform stretch of 1.1 has the energy of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.SubHorizon(pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

    even: ClassVar[bool] = False

    def moments(self, bond: Bonds) -> tuple[tuple[Array, Array], Array]:
        share = sectors(bond.xi) * bond.omega * bond.volume
        K, M = (x[None] * share[:, None, None] for x in (jnp.outer(bond.xi, bond.xi), jnp.outer(bond.eta, bond.xi)))
        return (share, K), M

    def _sums(self, bonds: Bonds) -> tuple[tuple[Array, Array], Array]:
        return jax.tree.map(lambda x: jnp.sum(x, axis=0), jax.vmap(self.moments, (EACH_BOND,))(bonds))

    def _kept(self, K: Float[Array, "sectors dim dim"]) -> Array:
        """Whether each sector is kept."""
        size = jnp.trace(K, axis1=1, axis2=2) / K.shape[-1]
        unit = K / jnp.where(size > 0, size, 1.0)[:, None, None]
        return (size > 0) & (jnp.linalg.det(unit) > SPAN)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"]:
        """K [length^(dim+2)] of the family, or zero if none of its sectors spans space."""
        (_, K), _ = self._sums(bonds)
        return jnp.where(jnp.any(self._kept(K)), jnp.sum(K, axis=0), 0.0)

    def _sectors(self, reference: tuple[Array, Array], M: Array) -> tuple[Array, Array, Array]:
        """K_s⁻¹, H_s = F̄_s − I and p_s of every sector, from the sums; I, 0 and 0 for a dropped sector."""
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
