# mypy: disable-error-code="attr-defined"
"""Correspondence models of order m by the Seth–Hill strains of the bonds: generalised and extended.

    W = Ψ(Ē_m),   Ē_m = L⁻¹ : Σ w e_m(s) n⊗n,   e_m = (s^{2m} − 1)/2m  (m = 0: log s)
    T = ω (n · Z n) s^{2m} Y/|Y|²,   Z = L⁻¹ : S,   S = ∂Ψ/∂E

with w = ω V and n = ξ/|ξ|. The point state is Z, stored as a Mandel vector. Ē_m is exact under affine maps for m = 1,
and for similarities at every m. Otherwise it is exact to first order in the strain.

**Generalised** (`SethHill`): L = Σ w n⊗n⊗n⊗n is the shape tensor of the family itself.
**Extended** (`TupekRadovitzky`): L is the shape tensor of a full ball with the same ω₀ = Σ w, ω₀ (I⊗I + 2 𝟙)/(d(d+2)).
The two are equal in 1D. Inside a lattice the extended one is off by the lattice's anisotropy, and at a surface it is
wrong.

Sources: Tupek & Radovitzky 2014; Foster & Xu 2018; Behzadinasab & Foster, section 2, force state of the generalised
model.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, is_concrete
from ..geometry.bonds import Bonds
from .base import AbstractModel, Sums
from .control import Control
from .kinematics import (
    bond_strain,
    bond_strain_moment,
    direction_mandel,
    from_mandel,
    local_strain,
    mandel_basis,
    power_over_square,
    shape_tensor_L,
    solve_positive,
    to_mandel,
)
from .laws import Law, law_stress
from .plain_order import with_plain_order
from .with_law import WithLaw


class BondStrainModel(WithLaw):
    """Base of the models W = Ψ(Ē_m). A subclass defines the fourth-order shape tensor L."""

    one_number: ClassVar[tuple[str, ...]] = ("m",)

    def __check_init__(self):
        if not isinstance(self.law, Law) or self.law.takes != "E":
            raise ValueError(
                f"{type(self).__name__} needs a law in a strain tensor (takes = 'E', such as LinearElastic), because"
                f" the model computes no deformation gradient; got {self.law!r}"
            )

    @property
    def degree(self) -> int:  # type: ignore[override]
        """2 if m is known to be 1 (not traced) and the control, if any, has a degree. Otherwise 0."""
        quadratic = is_concrete(self.m) and bool(np.all(np.asarray(self.m) == 1))
        return 2 if quadratic and (self.control is None or self.control.degree) else 0

    def specialised(self) -> AbstractModel:
        """The model with an order of ORDERS as a plain number, so that its forces need no exponential."""
        return with_plain_order(self)

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        """L as a Mandel matrix [length^dim]."""
        raise NotImplementedError

    def law_energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.law.energy(self.strain(bonds))

    def fourth_moment(self, bond: Bonds) -> Array:
        """The term of one bond in the sum from which `fourth_of` makes L."""
        raise NotImplementedError

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        """L as a Mandel matrix [length^dim] from the sum of `fourth_moment` over the family."""
        raise NotImplementedError

    def law_moments(self, bond: Bonds) -> tuple[Array, Array]:
        w = bond.omega * bond.volume
        e = bond_strain(bond.xi, bond.eta, self.m)
        return self.fourth_moment(bond), w * e * direction_mandel(bond.xi)

    def _fourth_and_strain(self, sums: Sums) -> tuple[Float[Array, "p p"], Float[Array, "dim dim"]]:
        """L and Ē_m from the sums."""
        L = self.fourth_of(sums.reference, sums.dim)
        return L, from_mandel(solve_positive(L, sums.deformed), sums.dim)

    def law_energy_of_sums(self, sums: Sums) -> Float[Array, ""]:
        return self.law.energy(self._fourth_and_strain(sums)[1])

    def law_state(self, sums: Sums) -> Float[Array, " p"]:
        L, E = self._fourth_and_strain(sums)
        return solve_positive(L, to_mandel(law_stress(self.law, E)))

    def law_force(self, here: Float[Array, " p"], bond: Bonds) -> Float[Array, " dim"]:
        growth = power_over_square(bond.xi, bond.eta, self.m)
        scale = bond.omega / jnp.sum(bond.xi * bond.xi, axis=-1)
        return scale * (direction_mandel(bond.xi) @ here) * growth * (bond.xi + bond.eta)

    shape_tensor = staticmethod(shape_tensor_L)

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Energy density Ψ(E_m(F)) [pressure] with the classical Seth–Hill strain of F (dim, dim)."""
        return self.law.energy(local_strain(F, self.m))

    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Nonlocal strain Ē_m [-] of one family, (dim, dim)."""
        return from_mandel(solve_positive(self.fourth(bonds), bond_strain_moment(bonds, self.m)), bonds.xi.shape[-1])

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Stress S = ∂Ψ/∂E at Ē_m [pressure] of one family, (dim, dim), conjugate to Ē_m."""
        return law_stress(self.law, self.strain(bonds))


class SethHill(BondStrainModel):
    """Generalised correspondence model of order m, W = Ψ(Ē_m).

    Ē_m = L⁻¹ : Σ w e_m(s) n⊗n is a nonlocal strain made from the Seth–Hill strains e_m = (s^{2m} − 1)/2m of the bonds,
    with w = ω V, n = ξ/|ξ| and L = Σ w n⊗n⊗n⊗n. It is exact under affine maps for m = 1, and for similarities at every
    m. Otherwise it is exact to first order in the strain.

    Parameters
    ----------
    m : float or array, shape (points,)
        Order of the strain [-]: 1 is quadratic in the stretch, 0 logarithmic.
    law : Law
        Material law in a strain tensor (`takes = "E"`). λ and μ of `LinearElastic` are the Lamé constants of the 3D
        solid; a 2D body is then in plane strain. For plane stress make the law with `plane="stress"`.
    control : control, optional
        `SillingControl`, `WanControl` or `LittlewoodControl`, which oppose zero-energy modes. None: no control.

    Raises
    ------
    ValueError
        If the law is not one in a strain tensor.

    References
    ----------
    Foster & Xu 2018; Behzadinasab & Foster, section 2, force state of the generalised model.

    Examples
    --------
    A uniform stretch of 1.1 has the strain 0.105 I, so W = ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.SethHill(m=1.0, law=pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    control: Control | None = None

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        return shape_tensor_L(bonds)

    def fourth_moment(self, bond: Bonds) -> Array:
        v = direction_mandel(bond.xi)
        return bond.omega * bond.volume * jnp.outer(v, v)

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        return total


class TupekRadovitzky(BondStrainModel):
    """Extended correspondence model of order m, with the shape tensor of a full ball for every family.

    W = Ψ(Ē_m) as in `SethHill`, but with L = ω₀ (I⊗I + 2 𝟙)/(d(d+2)), ω₀ = Σ w. The model equals `SethHill` in 1D.
    Inside a lattice its moduli are off by the lattice's anisotropy, and at a surface its strain is wrong.

    Parameters
    ----------
    m : float or array, shape (points,)
        Order of the strain [-].
    law : Law
        Material law in a strain tensor (`takes = "E"`). λ and μ of `LinearElastic` are the Lamé constants of the 3D
        solid; a 2D body is then in plane strain. For plane stress make the law with `plane="stress"`.
    control : control, optional
        `SillingControl`, `WanControl` or `LittlewoodControl`, which oppose zero-energy modes. None: no control.

    Raises
    ------
    ValueError
        If the law is not one in a strain tensor.

    References
    ----------
    Tupek & Radovitzky 2014.

    Examples
    --------
    The energy of a uniform stretch inside a lattice is that of the law, ½ λ (0.21)² + 2 μ (0.105)²:

    >>> model = pd.TupekRadovitzky(m=1.0, law=pd.LinearElastic(1.0, 1.0))
    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(model.energy(bonds)), 6)
    0.0441
    """

    m: Float[Array, "..."] = eqx.field(converter=as_real)
    law: Law
    control: Control | None = None
    moduli_exact: ClassVar[bool] = False

    def fourth(self, bonds: Bonds) -> Float[Array, "p p"]:
        return self.fourth_of(jnp.sum(bonds.omega * bonds.volume), bonds.xi.shape[-1])

    def fourth_moment(self, bond: Bonds) -> Array:
        return bond.omega * bond.volume

    def fourth_of(self, total: Array, dim: int) -> Float[Array, "p p"]:
        trace = np.trace(mandel_basis(dim), axis1=1, axis2=2)
        ball = (np.outer(trace, trace) + 2 * np.eye(len(trace))) / (dim * (dim + 2))
        return total * jnp.asarray(ball, dtype=total.dtype)
