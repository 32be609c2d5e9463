"""The linear peridynamic solid: a bulk modulus for the dilatation θ and a shear modulus for the rest of the extension.

    W = ½ k θ² + ½ α Σ w (e − θ|ξ|/d)²,    e = |Y| − |ξ|,   θ = (d/m_w) Σ w |ξ| e,   m_w = Σ w |ξ|²,
    T = ω [p |ξ| + α e] Y/|Y|,    p = d k θ/m_w − α θ/d,    α = d(d + 2) G/m_w

with w = ω V. The point state is (p, α). θ is exact under similarities for every family. The shear modulus is exact on a
full ball. On a lattice it is off by the lattice's anisotropy, which the atlas measures.

k is the d-dimensional bulk modulus. With λ and μ of the 3D solid it is K = λ + 2μ/3 in 3D and λ + μ in plane strain,
and G = μ. `plane_bulk_modulus` computes k for plane strain and plane stress. The model does not exist in 1D, where
there is no shear, and raises ValueError.

A bond between two materials (k and G vary from point to point): each end pulls with its own point's constants,

    f_ij = t(k_i, G_i, A_i) + t(k_j, G_j, A_j),

which is the derivative of the energy Σ V_i W_i. Some public codes use the mean of the two constants at both ends, which
is not a derivative of this energy. For two points with moduli E and 2E and volumes 1 and 2 the two rules differ by
11 %.

**Broken bonds** (`Families.with_broken`). m_w and α are those of the intact family, and θ sums over the bonds that
remain. The force of public codes, T above, then belongs to the energy

    W = ½ (k − k*) θ² + ½ α Σ w e²,    k* = (d + 2) G/d

which equals the first form for an intact family. With r the ratio of the remaining m_w to the intact one, the damaged
family is that of an LPS with the bulk modulus r² k + r (1 − r) k* and the shear modulus r G. If m_w were the sum of the
remaining family, breaking bonds would release nothing in a state of uniform expansion.

Source: Silling et al. 2007.
"""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, check_positive
from ..geometry.bonds import Bonds
from ..geometry.plane_sums import PlaneSums
from .base import PointStateModel, Sums
from .kinematics import growth_and_stretch, stretch_minus_one
from .plane import bulk_and_shear, plane_bulk_modulus


class LPS(PointStateModel):
    """Linear peridynamic solid, W = ½ k θ² + ½ α Σ w (e − θ|ξ|/d)².

    e = |Y| − |ξ| is the extension of a bond, θ = (d/m_w) Σ w |ξ| e the dilatation, m_w = Σ w |ξ|² the weighted volume
    and α = d(d + 2) G/m_w. A bond between two materials carries f_ij = t(k_i, G_i, A_i) + t(k_j, G_j, A_j): each end
    pulls with its own point's constants and state.

    Parameters
    ----------
    bulk : float or array, shape (points,)
        d-dimensional bulk modulus k [pressure], > 0. With λ and μ of the 3D solid it is λ + 2μ/3 in 3D and λ + μ in
        plane strain. `plane_bulk_modulus` computes it for plane strain and plane stress.
    shear : float or array, shape (points,)
        Shear modulus G = μ [pressure], > 0.

    Raises
    ------
    ValueError
        If a modulus is not finite and > 0. Functions that use the model raise it for 1D families.

    References
    ----------
    Silling et al. 2007.

    Examples
    --------
    A uniform stretch of 1.1 has θ = 0.2 in 2D and the energy ½ k θ²:

    >>> model = pd.LPS(bulk=2.0, shear=1.0)
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.04
    """

    bulk: Float[Array, "..."] = eqx.field(converter=as_real)
    shear: Float[Array, "..."] = eqx.field(converter=as_real)
    one_number: ClassVar[tuple[str, ...]] = ("bulk", "shear")
    moduli_exact: ClassVar[bool] = False
    additive: ClassVar[bool] = True
    keeps_reference: ClassVar[bool] = True
    dims: ClassVar[tuple[int, ...]] = (2, 3)

    def __check_init__(self):
        check_positive("bulk", self.bulk)
        check_positive("shear", self.shear)

    @staticmethod
    def from_young(young, poisson, dim: int = 3, plane: str | None = None) -> "LPS":
        """Make the model from Young's modulus and Poisson's ratio of the 3D solid.

        Parameters
        ----------
        young : float or array, shape (points,)
            Young's modulus E of the 3D solid [pressure], > 0.
        poisson : float or array, shape (points,)
            Poisson's ratio ν of the 3D solid [-], between −1 and ½.
        dim : int
            Dimension, 2 or 3.
        plane : "strain" or "stress"
            Required for dim 2.

        Returns
        -------
        LPS
            The model.

        Raises
        ------
        ValueError
            If a constant is out of range, if dim 2 comes without `plane`, or if `plane` comes with dim 3.

        Examples
        --------
        In plane strain k = λ + μ, and E = 1, ν = ¼ has λ = μ = 0.4:

        >>> model = pd.LPS.from_young(young=1.0, poisson=0.25, dim=2, plane="strain")
        >>> round(float(model.bulk), 9), float(model.shear)
        (0.8, 0.4)
        """
        bulk, shear = bulk_and_shear(young, poisson)
        if (dim == 2) != (plane is not None) or dim not in (2, 3):
            raise ValueError(
                f"from_young needs dim 3, or dim 2 and plane 'strain' or 'stress'; got dim {dim}, plane {plane!r}"
            )
        return LPS(bulk if plane is None else plane_bulk_modulus(bulk, shear, plane), shear)

    @property
    def isotropic(self) -> bool:
        return True

    def _extensions(self, bonds: Bonds) -> tuple[Array, Array, Array, Array]:
        """e, θ, m_w, α."""
        dim = bonds.xi.shape[1]
        w, length = bonds.omega * bonds.volume, jnp.linalg.norm(bonds.xi, axis=1)
        e = length * stretch_minus_one(bonds.xi, bonds.eta)
        m_w = jnp.sum(bonds.reference * bonds.volume * length**2)
        return e, dim * jnp.sum(w * length * e) / m_w, m_w, dim * (dim + 2) * self.shear / m_w

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        e, theta, _, alpha = self._extensions(bonds)
        deviation = e - theta * jnp.linalg.norm(bonds.xi, axis=1) / bonds.xi.shape[1]
        square = jnp.sum(bonds.omega * bonds.volume * deviation**2)
        if bonds.intact is not None:  # Σ w e² − m_w θ²/d² of the intact m_w, without cancellation
            lost = (bonds.intact - bonds.omega) * bonds.volume * jnp.sum(bonds.xi**2, axis=1)
            square += jnp.sum(lost) * (theta / bonds.xi.shape[1]) ** 2
        return 0.5 * self.bulk * theta**2 + 0.5 * alpha * square

    def extension_energies(self, sums: Callable[[int, int], np.ndarray]) -> np.ndarray:
        square, fourth = sums(2, 2), sums(2, 4)
        dim, m_w = square.shape[1], square.sum(axis=1, keepdims=True)
        mean = np.divide(square, m_w, out=np.zeros(square.shape), where=m_w > 0)  # θ/d
        bulk, shear = (np.asarray(x, float)[..., None] for x in (self.bulk, self.shear))
        deviation = np.divide(fourth, m_w, out=np.zeros(square.shape), where=m_w > 0) - mean**2
        return 0.5 * bulk * (dim * mean) ** 2 + 0.5 * dim * (dim + 2) * shear * deviation

    def cut_energy(self, sums: PlaneSums, uniform: bool) -> Array:
        springs = (sums.dim + 2) * self.shear / sums.dim  # the bulk modulus of a solid of independent springs
        square = 2 * sums.first - sums.second if uniform else sums.second
        return sums.dim**2 * ((self.bulk - springs) * square + springs * sums.first)

    def moments(self, bond: Bonds) -> tuple[Array, Array]:
        square = bond.volume * jnp.dot(bond.xi, bond.xi)
        return bond.reference * square, bond.omega * square * stretch_minus_one(bond.xi, bond.eta)

    def energy_of_sums(self, sums: Sums) -> Float[Array, ""]:
        return 0.5 * self.bulk * (sums.dim * sums.deformed / sums.reference) ** 2

    def energy_of_bond(self, sums: Sums, bond: Bonds) -> Float[Array, ""]:
        dim, length = sums.dim, jnp.sqrt(jnp.dot(bond.xi, bond.xi))
        deviation = length * (stretch_minus_one(bond.xi, bond.eta) - sums.deformed / sums.reference)
        return 0.5 * dim * (dim + 2) * self.shear / sums.reference * bond.omega * bond.volume * deviation**2

    def state(self, sums: Sums) -> tuple[Array, Array]:
        dim, m_w = sums.dim, sums.reference
        theta, alpha = dim * sums.deformed / m_w, dim * (dim + 2) * self.shear / m_w
        return (dim * self.bulk / m_w - alpha / dim) * theta, alpha

    def bond_force(self, here: tuple[Array, Array], there, bond: Bonds) -> Float[Array, " dim"]:
        p, alpha = here
        g, s = growth_and_stretch(bond.xi, bond.eta)
        return bond.omega * (p * (1 + s) + alpha * g) / (1 + g + s) * (bond.xi + bond.eta)
