# mypy: disable-error-code="misc"
"""A model's tangent about a homogeneous deformation, as a model of its own: its force density is J v.

    η₀ = (F − I) ξ,   δM = Σ (∂moments/∂η)(ξ, η₀) δη,   δA = (∂A/∂M) δM,   δt = t(δA; ξ, η₀) + (∂t/∂η)(A₀; ξ, η₀) δη

the force being linear in the point state (`additive`). All sums are linear in δη, so every way to evaluate a body
applies, convolutions included: J v of a lattice body about x = F X, surfaces and all, costs the same for every horizon.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import jax
from jaxtyping import Array, Float

from .._internal.checks import as_real, deformation_gradient, is_concrete
from .._internal.public import public_function
from ..geometry.bonds import Bonds
from .base import PointStateModel, Sums


class Linearised(PointStateModel):
    """J v about x = F X (made by `linearised`): u is v [length], `force_density` is J v."""

    base: PointStateModel
    F: Float[Array, "dim dim"]
    hyperelastic: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    balances_moments: ClassVar[bool] = False
    additive: ClassVar[bool] = True

    @property
    def degree(self) -> int:  # type: ignore[override]
        """1 where F and the constants are known; 0 for a control whose force does not grow with ω, as convolutions need
        it."""
        control = getattr(self.base, "control", None)
        return 1 if is_concrete(self) and (control is None or control.degree) else 0

    @property
    def rings(self) -> int:  # type: ignore[override]
        return self.base.rings

    @property
    def even(self) -> bool:  # type: ignore[override]
        return self.base.even

    @property
    def dims(self) -> tuple[int, ...]:  # type: ignore[override]
        return self.base.dims

    @property
    def isotropic(self) -> bool:
        return False

    @property
    def shape_tensor(self) -> Callable:  # type: ignore[override]
        return self.base.shape_tensor

    def _at_rest(self, bond: Bonds) -> Bonds:
        """The bond as the homogeneous deformation has it."""
        return bond._replace(eta=self.F @ bond.xi - bond.xi)

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        there = self._at_rest(bond)
        (reference, deformed), (_, change) = jax.jvp(
            lambda eta: self.base.moments(there._replace(eta=eta)), (there.eta,), (bond.eta,)
        )
        return (reference, deformed), change

    def state(self, sums: Sums) -> Any:
        reference, deformed = sums.reference

        def state(moved):
            return self.base.state(Sums(reference, moved, sums.horizon, sums.dim))

        return jax.jvp(state, (deformed,), (sums.deformed,))

    def bond_force(self, here: Any, there: Any, bond: Bonds) -> Float[Array, " dim"]:
        (state, change), at = here, self._at_rest(bond)
        _, direct = jax.jvp(
            lambda eta: self.base.bond_force(state, state, at._replace(eta=eta)), (at.eta,), (bond.eta,)
        )
        return direct + self.base.bond_force(change, change, at) if jax.tree.leaves(change) else direct


@public_function
def linearised(model: PointStateModel, F) -> Linearised:
    """The tangent of `model` about x = F X, itself a model: `force_density(linearised(model, F), families, v)` is J v.

    Arguments: model made of moments whose force is linear in the point state (`additive`); F (dim, dim) [-], det F > 0.
    Raises: ValueError for another model, or an F that can't be.
    """
    if not (isinstance(model, PointStateModel) and model.by_moments and model.additive):
        raise ValueError(
            f"linearised needs a model made of moments whose bond force is linear in the point state (`additive`); got"
            f" {type(model).__name__}: use pd.jvp"
        )
    F = as_real(F)
    return Linearised(model, deformation_gradient(F, F.shape[0] if F.ndim else 0))
