# mypy: disable-error-code="attr-defined"
"""Common base of correspondence models: a material law and an optional control of zero-energy modes.

The contributions of law and control add up:

    W = W_law + W_control,    T = T_law + T_control,    A = (A_law, A_control)

W is the energy density, T the force state and A the point state.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree

from ..geometry.bonds import Bonds
from .base import PointStateModel, Sums
from .control import Tangent
from .kinematics import gradient_moments
from .laws import Law, law_stress


def check_law(name: str, law: object) -> None:
    """Raise ValueError unless `law` is a `Law`."""
    if not isinstance(law, Law):
        raise ValueError(f"{name} needs a Law (LinearElastic, NeoHookean, EnergyLaw or your own); got {law!r}")


def _green_lagrange(H: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    return (H + H.T + H.T @ H) / 2


def energy_of_gradient(law: Law, H: Float[Array, "dim dim"]) -> Float[Array, ""]:
    """ψ of F = I + H [pressure]. A law in E gets the Green–Lagrange strain of F."""
    if law.takes == "E":
        return law.energy(_green_lagrange(H))
    return law.energy(jnp.eye(H.shape[0], dtype=H.dtype) + H)


def stress_of_gradient(law: Law, H: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """P = ∂ψ/∂F at F = I + H [pressure]; for a law in E it is F S."""
    F = jnp.eye(H.shape[0], dtype=H.dtype) + H
    return F @ law_stress(law, _green_lagrange(H)) if law.takes == "E" else law_stress(law, F)


def tangent_at_rest(law: Law, dim: int, dtype: DTypeLike) -> Tangent:
    """The linear map A → ℂ:A [pressure] for A (dim, dim), with ℂ = ∂²ψ/∂F∂F of the law at F = I."""
    rest = jnp.zeros((dim, dim), dtype)
    return lambda A: jax.jvp(lambda H: stress_of_gradient(law, H), (rest,), (A.astype(dtype),))[1]


class WithLaw(PointStateModel):
    """Base of models with the fields `law` and `control`.

    A subclass defines the part of the law alone: `law_energy`, `law_moments`, `law_state` and `law_force`. It sets
    `by_gradient` if its `law_moments` are K and M of the deformation gradient F̄. The control needs the same two sums,
    which are then computed once.
    """

    additive: ClassVar[bool] = True
    by_gradient: ClassVar[bool] = False

    @property
    def hyperelastic(self) -> bool:  # type: ignore[override]
        return self.control is None or self.control.hyperelastic

    @property
    def objective(self) -> bool:  # type: ignore[override]
        return self.control is None or self.control.objective

    @property
    def balances_moments(self) -> bool:  # type: ignore[override]
        return self.objective

    @property
    def isotropic(self) -> bool:
        return self.law.isotropic

    def law_energy(self, bonds: Bonds) -> Float[Array, ""]:
        """W_law [energy/length^dim]."""
        raise NotImplementedError

    def law_moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        """The terms of one bond in the sums from which `law_state` makes A_law."""
        raise NotImplementedError

    def law_state(self, sums: Sums) -> PyTree:
        """A_law, the point state of the law alone."""
        raise NotImplementedError

    def law_energy_of_sums(self, sums: Sums) -> Float[Array, ""] | None:
        """W_law [energy/length^dim], if it is a function of the sums of `law_moments`. Otherwise None."""
        return None

    def law_force(self, here: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        """T_law on one bond [force/length^(2 dim)]."""
        raise NotImplementedError

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        energy = self.law_energy(bonds)
        if self.control is None:
            return energy
        return energy + self.control.energy(bonds, tangent_at_rest(self.law, bonds.xi.shape[1], bonds.xi.dtype))

    def energy_of_sums(self, sums: Sums) -> Float[Array, ""] | None:
        return self.law_energy_of_sums(sums) if self.control is None else None

    def moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        parts = [self.law_moments(bond)]
        if self.control is not None:
            if not self.by_gradient:
                parts.append(gradient_moments(bond))
            if self.control.own_moments:
                parts.append(self.control.moments(bond))
        if len(parts) == 1:
            return parts[0]
        reference, deformed = zip(*parts, strict=True)
        return reference, deformed

    def state(self, sums: Sums) -> PyTree:
        if self.control is None:
            return self.law_state(sums)
        parts = [sums]
        if not self.by_gradient or self.control.own_moments:
            parts = [sums._replace(reference=r, deformed=d) for r, d in zip(sums.reference, sums.deformed, strict=True)]
        gradient = parts[0 if self.by_gradient else 1]
        own = parts[-1:] if self.control.own_moments else []
        tangent = tangent_at_rest(self.law, sums.dim, jax.tree.leaves(gradient.deformed)[0].dtype)
        return self.law_state(parts[0]), self.control.state(gradient, tangent, *own)

    def bond_force(self, here: PyTree, there: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        if self.control is None:
            return self.law_force(here, bond)
        state, opposing = here
        return self.law_force(state, bond) + self.control.force(opposing, bond)
