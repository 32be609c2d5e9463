# mypy: disable-error-code="misc"
"""The tangent of a model about a homogeneous deformation, in the form of a model whose force density is J v.

    η₀ = (F − I) ξ,   δM = Σ (∂moments/∂η)(ξ, η₀) δη,   δA = (∂A/∂M) δM,   δt = t(δA; ξ, η₀) + (∂t/∂η)(A₀; ξ, η₀) δη

The bond force must be linear in the point state (`additive`). All sums are then linear in δη, so every backend that
evaluates bodies can be used, including convolutions. The time for J v of a lattice body with surfaces about x = F X is
then the same for every horizon.
"""

from collections.abc import Callable
from typing import ClassVar

import jax
from jaxtyping import Array, Float, PyTree

from .._internal.checks import as_real, deformation_gradient, is_concrete
from .._internal.public import public_function
from ..geometry.bonds import Bonds
from .base import PointStateModel, Sums


class Linearised(PointStateModel):
    """The model that `linearised` returns: its displacement is v [length], its force density J v about x = F X."""

    shared: ClassVar[tuple[str, ...]] = ("F",)

    base: PointStateModel
    F: Float[Array, "dim dim"]
    hyperelastic: ClassVar[bool] = False
    objective: ClassVar[bool] = False
    balances_moments: ClassVar[bool] = False
    additive: ClassVar[bool] = True

    @property
    def degree(self) -> int:  # type: ignore[override]
        """1 if F and the constants are known, otherwise 0.

        It is 0 too for a control whose force is not proportional to ω, because convolutions need that.
        """
        control = getattr(self.base, "control", None)
        return 1 if is_concrete(self) and (control is None or control.degree) else 0

    @property
    def rings(self) -> int:  # type: ignore[override]
        return self.base.rings

    @property
    def even(self) -> bool:  # type: ignore[override]
        return self.base.even

    @property
    def keeps_reference(self) -> bool:  # type: ignore[override]
        return self.base.keeps_reference

    @property
    def dims(self) -> tuple[int, ...]:  # type: ignore[override]
        return self.base.dims

    @property
    def isotropic(self) -> bool:
        return False

    @property
    def shape_tensor(self) -> Callable:
        return self.base.shape_tensor

    def _at_rest(self, bond: Bonds) -> Bonds:
        """The bond in the homogeneous deformation x = F X."""
        return bond._replace(eta=self.F @ bond.xi - bond.xi)

    def moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        there = self._at_rest(bond)
        (reference, deformed), (_, change) = jax.jvp(
            lambda eta: self.base.moments(there._replace(eta=eta)), (there.eta,), (bond.eta,)
        )
        return (reference, deformed), change

    def state(self, sums: Sums) -> tuple[PyTree, PyTree]:
        reference, deformed = sums.reference

        def state(moved):
            return self.base.state(Sums(reference, moved, sums.horizon, sums.dim))

        return jax.jvp(state, (deformed,), (sums.deformed,))

    def bond_force(self, here: tuple[PyTree, PyTree], there: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        (state, change), at = here, self._at_rest(bond)
        _, direct = jax.jvp(
            lambda eta: self.base.bond_force(state, state, at._replace(eta=eta)), (at.eta,), (bond.eta,)
        )
        return direct + self.base.bond_force(change, change, at) if jax.tree.leaves(change) else direct


@public_function
def linearised(model: PointStateModel, F) -> Linearised:
    """Make a model whose force density is J v, the tangent of `model` about the homogeneous deformation x = F X.

    `force_density(linearised(model, F), families, v)` is J v.

    Parameters
    ----------
    model : PointStateModel
        A model that is defined by `moments` and whose bond force is linear in the point state (`additive`), such as
        `SethHill`, `Correspondence`, `LPS` or `BondBased`.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.

    Returns
    -------
    Linearised
        The tangent model.

    Raises
    ------
    ValueError
        If the model is another one, or if F is not finite with det F > 0.

    Examples
    --------
    For a tiny displacement v the force state of the tangent is that of the model:

    >>> model = pd.LPS(2.0, 1.0)
    >>> bonds = pd.lattice_family(2, 2).bonds((1 + 1e-9) * np.eye(2))
    >>> T, tangent = model.force_state(bonds), pd.linearised(model, np.eye(2)).force_state(bonds)
    >>> bool(np.abs(tangent - T).max() < 1e-8 * np.abs(T).max())
    True
    """
    if not (model.by_moments and model.additive):
        raise ValueError(
            "linearised needs a model that is defined by `moments` and whose bond force is linear in the point state"
            f" (`additive`); got {type(model).__name__}. Use pd.jvp for it"
        )
    F = as_real(F)
    return Linearised(model, deformation_gradient(F, F.shape[0] if F.ndim else 0))
