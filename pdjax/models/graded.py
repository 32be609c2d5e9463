"""A model whose energy is multiplied by a factor at each point, for bars and plates of varying modulus.

    W_i = c_i W,   T_i = c_i T        (T_ij belongs to the energy of point i and gets the factor of point i)

Every model can be graded. Most promises of the graded model are those of the model inside.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._internal.checks import as_real, is_concrete
from .._internal.public import public_function
from ..geometry.bonds import Bonds
from ..geometry.plane_sums import PlaneSums
from .base import PROMISES, AbstractModel, PointStateModel, Sums, TwoStageModel


class _Graded(AbstractModel):
    """Base of the graded models: energies, forces and stresses get the factor, the kinematics do not."""

    base: AbstractModel
    factor: Float[Array, "..."] = eqx.field(converter=as_real)
    one_number: ClassVar[tuple[str, ...]] = ("factor",)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.factor * self.base.energy(bonds)

    def cut_energy(self, sums: PlaneSums, uniform: bool) -> Array:
        return self.factor * self.base.cut_energy(sums, uniform)

    @property
    def shape_tensor(self) -> Callable:
        return self.base.shape_tensor

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return self.factor * self.base.local_energy(F)

    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        return self.base.strain(bonds)

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        return self.factor * self.base.stress(bonds)


class GradedEnergy(_Graded):
    """Graded form of a model that defines its energy or force state."""

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        return self.factor * self.base.force_state(bonds)


class GradedState(_Graded, PointStateModel):
    """Graded form of a model that defines point state and bond force; the factor multiplies the bond force."""

    base: PointStateModel

    def point_state(self, bonds: Bonds) -> PyTree:
        return self.base.point_state(bonds)

    def moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        return self.base.moments(bond)

    def state(self, sums: Sums) -> PyTree:
        return self.base.state(sums)

    @property
    def by_moments(self) -> bool:
        return self.base.by_moments

    def bond_force(self, here: PyTree, there: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        return self.factor * self.base.bond_force(here, there, bond)


class GradedTwoStage(_Graded, TwoStageModel):
    """Graded form of a two-stage model: a bond's energy gets the factor of the point that it belongs to."""

    base: TwoStageModel

    def point_state(self, bonds: Bonds) -> PyTree:
        return self.base.point_state(bonds)

    def bond_energy(self, here: PyTree, there: PyTree, bond: Bonds) -> Float[Array, ""]:
        return self.factor * self.base.bond_energy(here, there, bond)


# These promises are not those of the model inside: the factor multiplies the bond force and not the point state, so the
# force of a bond is no longer linear in the sum of the states of both ends.
_OWN = {"additive": False, "degree": 0}

for _name in PROMISES:
    for _kind in (GradedEnergy, GradedState, GradedTwoStage):
        setattr(_kind, _name, _OWN[_name] if _name in _OWN else property(attrgetter(f"base.{_name}")))


@public_function
def graded(model: AbstractModel, factor) -> AbstractModel:
    """Make a model whose energy and forces are those of `model` times a factor at each point.

    W_i = c_i W,   T_i = c_i T

    Parameters
    ----------
    model : AbstractModel
        The model to be graded. Its constants keep their meaning: λ and μ of its law belong to the 3D solid, in 2D to
        plane strain.
    factor : float or array, shape (points,)
        Factor c [-], > 0: one number, or one for each point of the body.

    Returns
    -------
    AbstractModel
        The graded model.

    Raises
    ------
    ValueError
        If a factor is not finite and > 0.

    Examples
    --------
    >>> model, bonds = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> round(float(pd.graded(model, 3.0).energy(bonds) / model.energy(bonds)), 9)
    3.0
    """
    factor = as_real(factor)
    if is_concrete(factor):
        value = np.asarray(factor)
        if not (np.isfinite(value) & (value > 0)).all():
            raise ValueError("factor of a graded model must be finite and > 0 everywhere")
    if isinstance(model, PointStateModel):
        return GradedState(model, factor)
    if isinstance(model, TwoStageModel):
        return GradedTwoStage(model, factor)
    return GradedEnergy(model, factor)
