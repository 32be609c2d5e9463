"""The criterion of the critical stretch: a bond breaks when its stretch exceeds s₀.

    s = |ξ + η|/|ξ| − 1 > s₀

Compression never breaks a bond, because s₀ > 0. Where s₀ varies from point to point, a bond has the smaller value of
its two ends: it breaks at its weaker end. LAMMPS does the same.

`from_fracture_energy` computes s₀ from the fracture energy G_c, see `pdjax.finite_body.damage.fracture_energy`.

**Smooth breaking.** A break is a jump, so no derivative flows through it. With a `smoothing` w > 0 a bond loses its
force gradually. What is left of it is a sigmoid of its stretch, and never grows again:

    β ← min(β, 1/(1 + exp((s − s₀)/w)))

For w → 0 this is the break at s₀.

Source: Silling & Askari 2005.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float
from numpy.typing import ArrayLike

from ..._internal.checks import as_real, check_positive, namespace, on_device, on_host, require
from ..._internal.public import public_function
from ...geometry.bonds import Bonds, Families, LatticeFamily
from ...models.base import AbstractModel
from ...models.kinematics import stretch_minus_one
from .criteria import Criterion
from .fracture_energy import cut_coefficient

WIDEST = 0.2  # of s₀: at rest a bond then has lost 0.7 % of its force


class CriticalStretch(Criterion):
    """Breaking criterion: a bond breaks when s = |Y|/|ξ| − 1 exceeds s₀.

    It serves every model. `from_fracture_energy` computes s₀ for `BondBased` and `LPS`.

    Parameters
    ----------
    stretch : float or array, shape (points,)
        Critical stretch s₀ [-], > 0. With one for each point, a bond has the smaller value of its two ends.
    smoothing : float, optional
        Width w [-] of the sigmoid by which a bond loses its force, > 0. A run then has derivatives beyond the first
        break, see the module. Take s₀/10 or less: at rest a bond has lost the share exp(−s₀/w). Only for models that
        keep the reference sums of the intact family, `BondBased` and `LPS`.
        Default None: a bond breaks at once.
    no_fail : array of bool, shape (points,) or (points, bonds), optional
        Points whose bonds never break, or bonds that never break.

    Raises
    ------
    ValueError
        If a stretch or the smoothing is not finite and > 0.

    References
    ----------
    Silling & Askari 2005.

    Examples
    --------
    The last bond of a bar is stretched by 10 %, in the families of both ends:

    >>> families, u = pd.families(pd.lattice((3,)), horizon=1.0), np.array([[0.0], [0.0], [0.1]])
    >>> broken = pd.CriticalStretch(0.05).broken(pd.BondBased(1.0), families, u)
    >>> i, slot = np.nonzero(np.asarray(broken))
    >>> list(zip(i.tolist(), np.asarray(families.neighbours)[i, slot].tolist()))
    [(1, 2), (2, 1)]
    """

    stretch: Float[Array, "*points"] = eqx.field(converter=as_real)
    smoothing: Float[Array, ""] | None = eqx.field(
        default=None, converter=lambda w: None if w is None else as_real(w, "smoothing")
    )

    def __check_init__(self):
        check_positive("stretch", self.stretch)
        if self.smoothing is not None:
            check_positive("smoothing", self.smoothing)
            share = self.smoothing / namespace(self.stretch, self.smoothing).min(self.stretch)
            narrow = share <= WIDEST
            require(
                share,
                narrow,
                f"smoothing must be at most {WIDEST:g} of the critical stretch, else bonds lose force without any"
                f" stretch; got {share} of it. Take a tenth or less",
            )

    @property
    def smooth(self) -> bool:
        return self.smoothing is not None

    def refusal(self, model: AbstractModel) -> str | None:
        if self.smoothing is None or model.keeps_reference:
            return None
        return (
            f"smoothing cannot serve {type(model).__name__}, which takes its sums over the bonds that remain; it serves"
            " BondBased and LPS. CriticalStretch without smoothing serves every model"
        )

    def check(self, model: AbstractModel, families: Families) -> None:
        super().check(model, families)
        if self.stretch.ndim and self.stretch.shape != (len(families),):
            raise ValueError(
                f"stretch must be one number, or one for each of the {len(families)} points; got shape"
                f" {self.stretch.shape}"
            )

    def _critical(self, families: Families) -> Array:
        """s₀, one number or one for each bond."""
        s0 = self.stretch
        return jnp.minimum(s0[:, None], s0[families.neighbours]) if s0.ndim else s0

    def limit(self, families: Families) -> Array | None:
        if self.smooth:
            return None
        limit = self._critical(families)
        protected = self.protected(families)
        if protected is not None:
            limit = jnp.where(protected, jnp.inf, limit)
        return limit

    def exceeded(self, model: AbstractModel, families: Families, bonds: Bonds) -> Bool[Array, "points bonds"]:
        return stretch_minus_one(bonds.xi, bonds.eta) > self._critical(families)

    def overload(self, model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, "points bonds"]:
        return stretch_minus_one(bonds.xi, bonds.eta) / self._critical(families)

    def left(self, model, families: Families, u, share):
        if self.smoothing is None:
            return super().left(model, families, u, share)
        bonds = families.bonds(u)
        beyond = (stretch_minus_one(bonds.xi, bonds.eta) - self._critical(families)) / self.smoothing
        sigmoid = jax.nn.sigmoid(-beyond)
        protected = self.protected(families)
        if protected is not None:
            sigmoid = jnp.where(protected, 1.0, sigmoid)
        return jnp.minimum(share, sigmoid)

    @staticmethod
    @public_function
    def from_fracture_energy(
        energy: ArrayLike,
        model: AbstractModel,
        family: LatticeFamily | Families,
        calibrate: str = "closed form",
        influence: Callable | str | None = None,
        state: str = "crossing",
        *,
        smoothing: float | None = None,
        no_fail: ArrayLike | None = None,
    ) -> "CriticalStretch":
        """Make the criterion whose broken plane has released the fracture energy G_c per area.

        Parameters
        ----------
        energy : float or array, shape (points,)
            Fracture energy G_c [energy/area], > 0. In 2D it is the energy per length and thickness.
        model : AbstractModel
            `BondBased` without an order, or `LPS`. In 2D its constants contain the state of plane stress or strain.
        family : LatticeFamily or Families
            Families of the body.
        calibrate : {"closed form", "lattice"}, optional
            "closed form" integrates over a full ball of the horizon. "lattice" sums over the bonds of a lattice that
            cross a plane at right angles to an axis, so that such a plane releases exactly G_c.
        influence : callable or str, optional
            Influence function, for "closed form". Default: constant, if ω of the families is constant.
        state : {"crossing", "uniform"}, optional
            Deformation in which the plane breaks. "crossing": the bonds that cross the plane have the stretch s₀, all
            others none. "uniform": all bonds of the body have the stretch s₀. Both are equal for `BondBased`.
        smoothing, no_fail : optional
            As in `CriticalStretch`.

        Returns
        -------
        CriticalStretch
            The criterion.

        Raises
        ------
        ValueError
            If G_c is not finite and > 0, the model has no closed form, the calibration does not apply to these
            families, or the influence function is not known.

        References
        ----------
        Silling & Askari 2005.

        Examples
        --------
        For ω = 1 and E = 1, the plate in plane stress has s₀² = 4πG_c/(9Eδ):

        >>> family = pd.lattice_family(dim=2, N=3)
        >>> model = pd.BondBased.from_young(young=1.0, poisson=1 / 3, horizon=3.0, dim=2, plane="stress")
        >>> criterion = pd.CriticalStretch.from_fracture_energy(0.01, model, family)
        >>> round(float(criterion.stretch**2 / (4 * np.pi * 0.01 / (9 * 3.0))), 9)
        1.0
        """
        energy = as_real(energy, "energy")
        check_positive("energy", energy)
        coefficient = cut_coefficient(model, family, calibrate, influence, state)
        energy, coefficient = on_host((energy, coefficient))
        stretch = on_device(namespace(energy, coefficient).sqrt(energy / coefficient))
        return CriticalStretch(stretch, smoothing, no_fail=no_fail)  # type: ignore[arg-type]

    def fracture_energy(
        self,
        model: AbstractModel,
        family: LatticeFamily | Families,
        normal: ArrayLike | None = None,
        influence: Callable | str | None = None,
        state: str = "crossing",
    ) -> Float[Array, "*points"]:
        """Compute the energy per area that a plane releases when its bonds break at the critical stretch.

        Parameters
        ----------
        model : AbstractModel
            `BondBased` without an order, or `LPS`.
        family : LatticeFamily or Families
            Families of the body.
        normal : array, shape (dim,), optional
            Normal of the plane, of any length > 0, for the sum over the bonds of the lattice. Default: the closed form
            of a full ball, which has no preferred direction.
        influence : callable or str, optional
            Influence function, for the closed form.
        state : {"crossing", "uniform"}, optional
            Deformation in which the plane breaks, see `from_fracture_energy`.

        Returns
        -------
        array, shape () or (points,)
            Energy per area [energy/area].

        Examples
        --------
        A criterion that is exact for planes at right angles to an axis is not exact for diagonal planes:

        >>> family, model = pd.lattice_family(dim=2, N=3), pd.LPS(1.0, 0.4)
        >>> criterion = pd.CriticalStretch.from_fracture_energy(1e-3, model, family, calibrate="lattice")
        >>> [round(1e3 * float(criterion.fracture_energy(model, family, n)), 3) for n in ([1, 0], [1, 1], [1, 2])]
        [1.0, 1.029, 1.059]
        """
        calibrate = "closed form" if normal is None else "lattice"
        coefficient = cut_coefficient(model, family, calibrate, influence, state, normal)
        stretch, coefficient = on_host((self.stretch, coefficient))
        return on_device(namespace(stretch, coefficient).asarray(coefficient * stretch**2))
