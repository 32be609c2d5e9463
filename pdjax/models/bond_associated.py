"""Bond-associated correspondence: every bond has a sub-family, the part of the point's family near the bond's end.

    h_b = {k in H : |ξ_k − ξ_b| ≤ r δ},   K_b = Σ_{k∈h_b} w_k ξ_k⊗ξ_k,   F_b = I + (Σ_{k∈h_b} w_k η_k⊗ξ_k) K_b⁻¹,

with w = ω V and the reach r δ of a sub-family.

**Energy-consistent** (`BondAssociated`): W = Σ_b v_b ψ(F_b) with v_b = V_{h_b}/Σ_b V_{h_b}, where V_{h_b} is the volume
of the sub-family of bond b. These weights are the published ones, which public codes use too. The force state is

    T_k = ω_k Σ_{b: k∈h_b} v_b P_b K_b⁻¹ ξ_k.

**As first published** (`BondAssociatedForce`): T_b = ω_b (V_h/V_H) P_b K_b⁻¹ ξ_b, where the stress of a bond's
sub-family acts on that bond alone. This force is not the derivative of an energy, so the Jacobian is not symmetric. The
sum Σ T×Y is not zero, so internal forces exert moments. F_b is exact for affine maps, but Σ V T⊗ξ is not P: it is 9 %
too large in 1D at N = 3 and 14 % too small in 2D at N = 2.

The bonds of each sub-family must span space. If r is near 0 or the family is small, pdjax raises ValueError and names
the bond. The cost of a point is proportional to the square of its number of bonds.

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
    """Kinematics of sub-families of reach r δ, with r > 0 [-]."""

    r: Float[Array, "..."] = eqx.field(converter=as_real, default=1.0)
    one_number: ClassVar[tuple[str, ...]] = ("r",)

    def __check_init__(self):
        check_positive("r", self.r)

    def _members(self, bonds: Bonds) -> Float[Array, "bonds bonds"]:
        """Entry (b, k): w_k if bond k belongs to h_b, else 0."""
        return jnp.where(self._inside(bonds), (bonds.omega * bonds.volume)[None, :], 0.0)

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"]:
        """K_b of every bond [length^(dim+2)]. A bond without weight (padded) gets the K of the whole family."""
        w = bonds.omega * bonds.volume
        members = jnp.where((w > 0)[:, None], self._members(bonds), w[None, :])
        return jnp.einsum("bk,ki,kj->bij", members, bonds.xi, bonds.xi)

    def _gradients(self, bonds: Bonds) -> tuple[Array, Array]:
        """K_b⁻¹ and H_b = F_b − I of every bond. A bond without weight gets H_b = 0."""
        I = jnp.eye(bonds.xi.shape[1], dtype=bonds.xi.dtype)
        inverse = jax.vmap(lambda K: solve_positive(K, I))(self.shape_tensor(bonds))
        members = jnp.where((bonds.omega != 0)[:, None], self._members(bonds), 0.0)
        return inverse, jnp.einsum("bk,ki,kj->bij", members, bonds.eta, bonds.xi) @ inverse

    def _inside(self, bonds: Bonds) -> Bool[Array, "bonds bonds"]:
        """Entry (b, k): whether bond k belongs to h_b."""
        apart = jnp.sum((bonds.xi[:, None, :] - bonds.xi[None, :, :]) ** 2, axis=-1)
        return apart <= (self.r * bonds.horizon * (1 + TIE)) ** 2

    def _volumes(self, bonds: Bonds) -> Float[Array, " bonds"]:
        """V of the bonds with weight, 0 of the others."""
        return jnp.where(bonds.omega != 0, bonds.volume, 0.0)

    def _shares(self, bonds: Bonds) -> Float[Array, " bonds"]:
        """v_b of every bond, 0 for a bond without weight."""
        V = self._volumes(bonds)
        of_family = jnp.where(V > 0, self._inside(bonds) @ V, 0.0)
        return of_family / jnp.sum(of_family)


class BondAssociated(_SubFamilies):
    """Bond-associated correspondence, energy-consistent: W = Σ_b v_b ψ(F_b).

    F_b is the nonlocal deformation gradient of the sub-family h_b = {k in H : |ξ_k − ξ_b| ≤ r δ} of bond b, and v_b is
    proportional to the volume of that sub-family. The force is the exact derivative of the energy. The model is exact
    for affine maps. The cost of a point is proportional to the square of its number of bonds.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F_b. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.
    r : float or array, shape (points,)
        Reach of a sub-family in horizons [-], > 0; 1 by default.

    Raises
    ------
    ValueError
        If `law` is not a `Law` or r is not > 0. Functions that use the model raise it if the bonds of a sub-family do
        not span space.

    References
    ----------
    Chen & Spencer 2019.

    Examples
    --------
    A uniform stretch of 1.1 has the energy of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.BondAssociated(pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

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
    """Bond-associated correspondence as first published: T_b = ω_b (V_h/V_H) P_b K_b⁻¹ ξ_b.

    P_b is the law's stress at F_b, the deformation gradient of the sub-family of bond b (see `BondAssociated`). The
    force is not the derivative of an energy, and internal forces exert moments. Under an affine map the stress Σ V T⊗ξ
    is not that of the law: it is 9 % too large in 1D at N = 3 and 14 % too small in 2D at N = 2.

    Parameters
    ----------
    law : Law
        Material law in F or in E; a law in E gets the Green–Lagrange strain of F_b. λ and μ of `LinearElastic`
        and `NeoHookean` are the Lamé constants of the 3D solid; a 2D body is then in plane strain. For plane stress
        make the law with `plane="stress"`.
    r : float or array, shape (points,)
        Reach of a sub-family in horizons [-], > 0; 1 by default.

    Raises
    ------
    ValueError
        If `law` is not a `Law` or r is not > 0. Functions that use the model raise it if the bonds of a sub-family do
        not span space.

    References
    ----------
    Chen 2018.

    Examples
    --------
    The stress under a stretch of 1.1 in 1D, relative to that of the energy-consistent model:

    >>> law, family, F = pd.LinearElastic(1.0, 1.0), pd.lattice_family(1, 3), np.array([[1.1]])
    >>> one, other = (pd.piola_stress(m(law), family, F) for m in (pd.BondAssociatedForce, pd.BondAssociated))
    >>> round(float(one[0, 0] / other[0, 0]), 3)
    1.086
    """

    hyperelastic: ClassVar[bool] = False
    balances_moments: ClassVar[bool] = False
    affine_exact: ClassVar[bool] = False
    moduli_exact: ClassVar[bool] = False

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        raise ValueError(
            "BondAssociatedForce has no energy: its force is not the derivative of an energy. Use BondAssociated"
        )

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        inverse, H = self._gradients(bonds)
        V = self._volumes(bonds)
        P = jax.vmap(lambda H: stress_of_gradient(self.law, H))(H)
        part = jnp.where(self._members(bonds) > 0, V[None, :], 0.0).sum(axis=1) / jnp.sum(V)
        return (part * bonds.omega)[:, None] * jnp.einsum("bij,bj->bi", P @ inverse, bonds.xi)
