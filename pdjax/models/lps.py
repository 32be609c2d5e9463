"""The linear peridynamic solid: a bulk modulus for the dilatation θ, a shear modulus for what else a bond does.

    W = ½ k θ² + ½ α Σ w (e − θ|ξ|/d)²,    e = |Y| − |ξ|,   θ = (d/m_w) Σ w |ξ| e,   m_w = Σ w |ξ|²,
    T = ω [p |ξ| + α e] Y/|Y|,    p = d k θ/m_w − α θ/d,    α = d(d + 2) G/m_w

The point state is (p, α). θ is exact under similarities for every family; the shear modulus is exact on a full ball and
off by the anisotropy of a lattice (measured in the atlas). k is the d-dimensional bulk modulus: `plane_bulk_modulus`
gives it for plane strain and plane stress. In 1D there is no shear and the model is refused.

A bond between two materials (k, G that vary from point to point): each end pulls with its own point's constants,
f_ij = t(k_i, G_i, A_i) + t(k_j, G_j, A_j), which is the derivative of the energy Σ V_i W_i. Some public codes give both
ends the mean of the two instead; that is no derivative of this energy. For two points with moduli E and 2E and volumes
1 and 2 the two rules differ by 11 %.
Source: Silling et al. 2007.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._internal.checks import as_real, check_positive
from ..geometry.bonds import Bonds
from .base import PointStateModel, Sums
from .kinematics import stretch_minus_one
from .plane import bulk_and_shear, plane_bulk_modulus


class LPS(PointStateModel):
    """Linear peridynamic solid of bulk and shear modulus [pressure], both > 0 (in 2D `bulk` is the plane's)."""

    bulk: Float[Array, "..."] = eqx.field(converter=as_real)
    shear: Float[Array, "..."] = eqx.field(converter=as_real)
    moduli_exact: ClassVar[bool] = False
    additive: ClassVar[bool] = True
    dims: ClassVar[tuple[int, ...]] = (2, 3)

    def __check_init__(self):
        check_positive("bulk", self.bulk)
        check_positive("shear", self.shear)

    @staticmethod
    def from_young(young, poisson, dim: int = 3, plane: str | None = None) -> "LPS":
        """The solid of E > 0 [pressure] and −1 < ν < ½ [-]; in 2D of plane "strain" or "stress".

        Raises: ValueError for constants out of range, dim 2 without a plane, a plane in 3D.
        """
        bulk, shear = bulk_and_shear(young, poisson)
        if (dim == 2) != (plane is not None) or dim not in (2, 3):
            raise ValueError(f"from_young needs dim 3, or dim 2 and plane 'strain' or 'stress'; got {dim}, {plane!r}")
        return LPS(bulk if plane is None else plane_bulk_modulus(bulk, shear, plane), shear)

    @property
    def isotropic(self) -> bool:
        return True

    def _extensions(self, bonds: Bonds) -> tuple[Array, Array, Array, Array]:
        """e, θ, m_w, α."""
        dim = bonds.xi.shape[1]
        w, length = bonds.omega * bonds.volume, jnp.linalg.norm(bonds.xi, axis=1)
        e = length * stretch_minus_one(bonds.xi, bonds.eta)
        m_w = jnp.sum(w * length**2)
        return e, dim * jnp.sum(w * length * e) / m_w, m_w, dim * (dim + 2) * self.shear / m_w

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        e, theta, _, alpha = self._extensions(bonds)
        deviation = e - theta * jnp.linalg.norm(bonds.xi, axis=1) / bonds.xi.shape[1]
        return 0.5 * self.bulk * theta**2 + 0.5 * alpha * jnp.sum(bonds.omega * bonds.volume * deviation**2)

    def moments(self, bond: Bonds) -> tuple[Array, Array]:
        square = jnp.dot(bond.xi, bond.xi)
        w = bond.omega * bond.volume * square
        return w, w * stretch_minus_one(bond.xi, bond.eta)

    def state(self, sums: Sums) -> tuple[Array, Array]:
        dim, m_w = sums.dim, sums.reference
        theta, alpha = dim * sums.deformed / m_w, dim * (dim + 2) * self.shear / m_w
        return (dim * self.bulk / m_w - alpha / dim) * theta, alpha

    def bond_force(self, here: tuple[Array, Array], there, bond: Bonds) -> Float[Array, " dim"]:
        p, alpha = here
        e = stretch_minus_one(bond.xi, bond.eta)
        return bond.omega * (p + alpha * e) / (1 + e) * (bond.xi + bond.eta)
