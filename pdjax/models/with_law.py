# mypy: disable-error-code="attr-defined"
"""What correspondence models share: a classical law, and a control of zero-energy modes beside it, or none.

W = W_law + W_control,    T = T_law + T_control,    A = (A_law, A_control)
"""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..kinematics import gradient_moments
from ..laws import Law
from ..neighbours import Bonds
from .base import PointStateModel, Sums


def check_law(name: str, law: Any) -> None:
    """Refuse what is not a law."""
    if not isinstance(law, Law):
        raise ValueError(f"{name} needs a Law (LinearElastic, NeoHookean, EnergyLaw); got {law!r}")


def energy_of_gradient(law: Law, H: Float[Array, "dim dim"]) -> Float[Array, ""]:
    """ψ of F = I + H: a law in F as it is, a law in E fed the Green–Lagrange strain."""
    if law.takes == "E":
        return law.energy((H + H.T + H.T @ H) / 2)
    return law.energy(jnp.eye(H.shape[0], dtype=H.dtype) + H)


def stress_of_gradient(law: Law, H: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """P = ∂ψ/∂F [pressure]."""
    return jax.grad(lambda H: energy_of_gradient(law, H))(H)


def moduli_at_rest(law: Law, dim: int, dtype: Any) -> Float[Array, "dim dim dim dim"]:
    """ℂ = ∂²ψ/∂F∂F at F = I [pressure]."""
    return jax.hessian(lambda H: energy_of_gradient(law, H))(jnp.zeros((dim, dim), dtype))


class WithLaw(PointStateModel):
    """Subclasses have the fields `law` and `control`; `law_energy`, `law_moments`, `law_state`, `law_force` are without
    control."""

    additive: ClassVar[bool] = True

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

    def law_moments(self, bond: Bonds) -> tuple[Any, Any]:
        """What one bond adds to the sums behind A_law."""
        raise NotImplementedError

    def law_state(self, sums: Sums) -> Any:
        """A_law."""
        raise NotImplementedError

    def law_force(self, here: Any, bond: Bonds) -> Float[Array, " dim"]:
        """T_law on one bond [force/length^(2 dim)]."""
        raise NotImplementedError

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        energy = self.law_energy(bonds)
        if self.control is None:
            return energy
        return energy + self.control.energy(bonds, moduli_at_rest(self.law, bonds.xi.shape[1], bonds.xi.dtype))

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        reference, deformed = self.law_moments(bond)
        if self.control is None:
            return reference, deformed
        K, M = gradient_moments(bond)
        return (reference, K), (deformed, M)

    def state(self, sums: Sums) -> Any:
        if self.control is None:
            return self.law_state(sums)
        (reference, K), (deformed, M) = sums.reference, sums.deformed
        own = self.law_state(sums._replace(reference=reference, deformed=deformed))
        moduli = moduli_at_rest(self.law, sums.dim, K.dtype)
        return own, self.control.state(sums._replace(reference=K, deformed=M), moduli)

    def bond_force(self, here: Any, there: Any, bond: Bonds) -> Float[Array, " dim"]:
        if self.control is None:
            return self.law_force(here, bond)
        state, opposing = here
        return self.law_force(state, bond) + self.control.force(opposing, bond)
