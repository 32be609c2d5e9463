"""A model whose energy is multiplied, point by point, by a factor: bars and plates of varying modulus.

    W_i = c_i W,   T_i = c_i T        (the point's own factor: T_ij belongs to point i's energy)

Any model can be graded; promises are those of the model inside.
"""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, is_concrete
from .._internal.public import public_function
from ..geometry.bonds import Bonds
from .base import PROMISES, AbstractModel, PointStateModel, Sums, TwoStageModel


class _Graded(AbstractModel):
    """What all kinds share: everything that is linear in the energy is multiplied, the kinematics are not."""

    base: AbstractModel
    factor: Float[Array, "..."] = eqx.field(converter=as_real)

    @property
    def isotropic(self) -> bool:
        return self.base.isotropic

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        return self.factor * self.base.energy(bonds)

    @property
    def shape_tensor(self) -> Callable:  # type: ignore[override]
        return self.base.shape_tensor

    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return self.factor * self.base.local_energy(F)

    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        return self.base.strain(bonds)

    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        return self.factor * self.base.stress(bonds)


class GradedEnergy(_Graded):
    """A graded model given by its force state."""

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        return self.factor * self.base.force_state(bonds)


class GradedState(_Graded, PointStateModel):
    """A graded model given by point state and bond force. The factor travels with the state."""

    def point_state(self, bonds: Bonds) -> Any:
        return self.base.point_state(bonds)  # type: ignore[attr-defined]

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        return self.base.moments(bond)  # type: ignore[attr-defined]

    def state(self, sums: Sums) -> Any:
        return self.base.state(sums)  # type: ignore[attr-defined]

    @property
    def by_moments(self) -> bool:
        return self.base.by_moments  # type: ignore[attr-defined]

    def bond_force(self, here: Any, there: Any, bond: Bonds) -> Float[Array, " dim"]:
        return self.factor * self.base.bond_force(here, there, bond)  # type: ignore[attr-defined]


class GradedTwoStage(_Graded, TwoStageModel):
    """A graded model of two stages: a bond's energy carries the factor of the point whose energy it is."""

    def point_state(self, bonds: Bonds) -> Any:
        return self.base.point_state(bonds)  # type: ignore[attr-defined]

    def bond_energy(self, here: Any, there: Any, bond: Bonds) -> Float[Array, ""]:
        return self.factor * self.base.bond_energy(here, there, bond)  # type: ignore[attr-defined]


_OWN = {"additive": False, "degree": 0}  # the factor multiplies a force, not the state that it is linear in

for _name in PROMISES:
    for _kind in (GradedEnergy, GradedState, GradedTwoStage):
        setattr(_kind, _name, _OWN[_name] if _name in _OWN else property(attrgetter(f"base.{_name}")))


@public_function
def graded(model: AbstractModel, factor) -> AbstractModel:
    """`model` with its energy times `factor`: one number, or one for each point of the body (points,) [-], > 0.

    Raises: ValueError for a factor that is not finite and positive.
    """
    factor = as_real(factor)
    if is_concrete(factor):
        value = np.asarray(factor)
        if not (np.isfinite(value) & (value > 0)).all():
            raise ValueError("factor of a graded model must be finite and > 0 everywhere")
    kinds = ((PointStateModel, GradedState), (TwoStageModel, GradedTwoStage), (AbstractModel, GradedEnergy))
    return next(graded for kind, graded in kinds if isinstance(model, kind))(model, factor)
