"""The criterion of the critical bond energy: a bond breaks when the work done on it exceeds w_c.

Foster, Silling & Chen 2011 define the energy of a bond by the work of its pair force f = T_ij − T_ji along the motion,

    w = ∫ (T_ij − T_ji)·dη   [energy/length^(2 dim)]

A run would have to integrate it. Here w is a function of the present state alone: half the force times the extension,

    w_ij = ½ (τ_ij + τ_ji),    τ_ij = T_ij·(Y − Y₀)

where Y₀ is the undeformed bond, turned with the material. For models without a shape tensor, such as BondBased and LPS,
the force lies along the bond, and Y₀ = |ξ| Y/|Y|. Models with a shape tensor, such as Correspondence and SethHill, have
transverse forces, and Y₀ = R ξ with the rotation R of the point's F̄ = R U. A rigid rotation changes neither.

The formula equals the work of Foster et al. if the load grows in proportion (radial loading) and the force is linear in
the strain: exactly for BondBased and LPS under similarities, and at small strains for all elastic models where the
material does not rotate. For BondBased and LPS rotations do not matter. In a model with transverse forces the work of
Foster et al. on a single bond contains T·Wξ, of the rotation W. It adds up to zero over a family, and w_ij leaves it
out. At large strains, on other paths, and for the bonds beside a growing crack the two differ too: w_ij does not
remember the path.

A bond that is shorter than at rest does not break, although its energy is positive too.

**Fracture energy.** If every bond across a plane takes w_c with it, then G_c = w_c P with the sum P of
`pdjax.geometry.plane_sums`: w_c = 4 G_c/(πδ⁴) in 3D (Foster et al. 2011), 3 G_c/(2δ³) in 2D, 2 G_c/δ² in 1D. w_c does
not depend on ω or on the model. The energies of the bonds of an LPS or of a correspondence model do not add up to the
strain energy that a break at fixed displacement releases, so a run need not release G_c per area.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from ..._internal.checks import as_real, check_positive, on_device, on_host
from ..._internal.public import public_function
from ...force.fields import force_states, plain_exchange
from ...geometry.bonds import Bonds, Families, LatticeFamily
from ...models.base import AbstractModel
from ...models.kinematics import displacement_gradient
from ...models.pointwise import regular
from .criteria import Criterion
from .fracture_energy import sums_of_plane


def _rest(model: AbstractModel, bonds: Bonds, deformed: Array, length: Array) -> Float[Array, "points bonds dim"]:
    """Y₀, the undeformed bond turned with the material."""
    if not model.has_shape_tensor:
        return deformed * (jnp.linalg.norm(bonds.xi, axis=-1) / length)[..., None]
    H = eqx.filter_vmap(displacement_gradient)(regular(bonds)[0])
    U, _, V = jnp.linalg.svd(jnp.eye(H.shape[-1], dtype=H.dtype) + H)
    return jnp.einsum("pij,pbj->pbi", U @ V, bonds.xi)


def bond_energies(model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, "points bonds"]:
    """w of every bond [energy/length^(2 dim)], without checks. Equal at both ends of a bond."""
    exchange = plain_exchange(families)
    T = force_states(model, families.volumes, bonds, exchange)
    Y = bonds.xi + bonds.eta
    square = jnp.sum(Y * Y, axis=-1)
    length = jnp.sqrt(jnp.where(square > 0, square, 1.0))
    work = jnp.sum(T * (Y - _rest(model, bonds, Y, length)), axis=-1)
    return 0.5 * (work + exchange.back(work))


class CriticalBondEnergy(Criterion):
    """Breaking criterion: a bond breaks when its energy w = ½ (τ_ij + τ_ji) exceeds w_c and it is longer than at rest.

    τ_ij = T_ij·(Y − Y₀), with T the force state and Y₀ the undeformed bond, turned with the material. For elastic
    models under proportional loading at small strain without rotation, w is the work that Foster, Silling & Chen 2011
    integrate.

    It serves the models whose bond force depends on the families of its own ends: BondBased, LPS, Correspondence,
    SethHill, TupekRadovitzky and your own models of this kind.

    Parameters
    ----------
    energy : float
        Critical bond energy w_c [energy/length^(2 dim)], > 0.
    no_fail : array of bool, shape (points,), optional
        Points whose bonds never break.

    Raises
    ------
    ValueError
        If the energy is not finite and > 0.

    References
    ----------
    Foster, Silling & Chen 2011.

    Examples
    --------
    The spring between two points has the energy ½ c s² = 0.005 per pair of volumes:

    >>> families, u = pd.families(pd.lattice((2,)), horizon=1.0), np.array([[0.0], [0.1]])
    >>> [pd.CriticalBondEnergy(w).broken(pd.BondBased(1.0), families, u).tolist() for w in (0.0049, 0.0051)]
    [[[True], [True]], [[False], [False]]]
    """

    energy: Float[Array, ""] = eqx.field(converter=as_real)

    def __check_init__(self):
        check_positive("energy", self.energy)
        if self.energy.ndim:
            raise ValueError(f"energy of CriticalBondEnergy must be one number; got shape {self.energy.shape}")

    def refusal(self, model: AbstractModel) -> str | None:
        if not model.needs_other_end:
            return None
        return (
            f"CriticalBondEnergy cannot serve {type(model).__name__}, whose bond force contains the states of other"
            " bonds; it serves BondBased, LPS, Correspondence, SethHill and TupekRadovitzky. CriticalStretch serves"
            " every model"
        )

    def exceeded(self, model: AbstractModel, families: Families, bonds: Bonds) -> Bool[Array, "points bonds"]:
        longer = jnp.sum((2 * bonds.xi + bonds.eta) * bonds.eta, axis=-1) > 0
        return longer & (bond_energies(model, families, bonds) > self.energy)

    @staticmethod
    @public_function
    def from_fracture_energy(
        energy: ArrayLike, family: LatticeFamily | Families, calibrate: str = "closed form"
    ) -> "CriticalBondEnergy":
        """Make the criterion of the fracture energy G_c: w_c = G_c/P.

        w_c = 4 G_c/(πδ⁴) in 3D, 3 G_c/(2δ³) in 2D, 2 G_c/δ² in 1D.

        Parameters
        ----------
        energy : float
            Fracture energy G_c [energy/area], > 0. In 2D it is the energy per length and thickness.
        family : LatticeFamily or Families
            Families of the body.
        calibrate : {"closed form", "lattice"}, optional
            "closed form" integrates over a full ball. "lattice" counts the bonds of a lattice that cross a plane at
            right angles to an axis.

        Returns
        -------
        CriticalBondEnergy
            The criterion.

        Raises
        ------
        ValueError
            If G_c is not finite and > 0, or the calibration does not apply to these families.

        References
        ----------
        Foster, Silling & Chen 2011.

        Examples
        --------
        >>> criterion = pd.CriticalBondEnergy.from_fracture_energy(np.pi, pd.lattice_family(dim=3, N=2, spacing=0.5))
        >>> round(float(criterion.energy), 6)
        4.0
        """
        energy = as_real(energy, "energy")
        check_positive("energy", energy)
        influence: Callable | None = None
        if calibrate == "closed form":
            influence = lambda r, d: np.ones_like(r)  # noqa: E731  # P does not depend on ω
        sums = sums_of_plane(family, calibrate, influence)
        return CriticalBondEnergy(on_device(np.asarray(on_host(energy) / sums.pairs)))
