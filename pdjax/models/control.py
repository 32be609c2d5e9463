"""Control of zero-energy modes: forces that oppose z = Y − F̄ξ, what F̄ does not see of a bond.

    Silling     W + ½ g (c/δ) Σ w |z|²,     T + ω g (c/δ) z        g a number, c the bond micromodulus of the law
    Wan         W + ½ Σ w z·C₁z,            T + ω C₁ z             (C₁)_ij = ℂ_ijkl (K⁻¹)_kl, no number to choose
    Littlewood  no energy,                  T + C c (z·Y) Y/(|ξ||Y|²)

The two energies are exact as they stand, for Σ w z⊗ξ = 0: F̄ takes no part in their derivative. ℂ is the law's tangent
at rest and c the d-dimensional micromodulus of its bulk modulus k = ℂ_iijj/d²: 18k/(πδ⁴) in 3D, 12k/(πδ³) in 2D, 2k/δ²
in 1D. With ω = 1 on a full ball and an isotropic law the first two are equal at g = 5/8 (3D), 2/3 (2D), 3/4 (1D).
Silling's control is published with another scaling whose units do not fit; this one is in use since. Wan's is
not objective where C₁ is no multiple of I: on clouds and at surfaces. Littlewood's, without ω, is normalised here by
|ξ||Y|² so that C has no unit; it acts along the bond and is the derivative of nothing.

Sources: Silling 2017; Wan et al. 2019; Littlewood 2010.
"""

import math
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._checks import as_real, require
from ..kinematics import displacement_gradient, shape_tensor_K, solve_positive
from ..neighbours import Bonds


def micromodulus(bulk, horizon, dim: int):
    """c of the bonds whose d-dimensional bulk modulus is `bulk` [pressure] on a full ball.

    c [pressure/length^(dim+1)]: 18k/(πδ⁴), 12k/(πδ³), 2k/δ² in 3D, 2D, 1D.
    """
    return bulk * {3: 18 / math.pi, 2: 12 / math.pi, 1: 2.0}[dim] / horizon ** (dim + 1)


def bulk_modulus(moduli: Float[Array, "dim dim dim dim"]) -> Float[Array, ""]:
    """k = ℂ_iijj/d² [pressure], the d-dimensional bulk modulus of a law's tangent at rest."""
    return jnp.einsum("iijj->", moduli) / moduli.shape[0] ** 2


def _positive(name: str, value: Any) -> Array:
    value = as_real(value)
    return require(value, jnp.isfinite(value) & (value >= 0), f"{name} must be finite and >= 0; got {value}")


class Control(eqx.Module):
    """What opposes z. `state` is what a point sends along its bonds, made from its family and the law's tangent ℂ."""

    hyperelastic: ClassVar[bool] = True
    objective: ClassVar[bool] = True

    def state(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Any:
        raise NotImplementedError

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        """What T gains on one bond [force/length^(2 dim)]."""
        raise NotImplementedError

    def energy(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Float[Array, ""]:
        """What W gains [energy/length^dim]."""
        raise ValueError(f"{type(self).__name__} is not the derivative of an energy")


def _deviation(H: Float[Array, "dim dim"], bonds: Bonds) -> Float[Array, "*bonds dim"]:
    return bonds.eta - bonds.xi @ H.T


class SillingControl(Control):
    """½ g (c/δ) Σ w |z|²; g ≥ 0 [-], of order one."""

    g: Float[Array, "..."] = eqx.field(converter=lambda g: _positive("g", g), default=0.5)

    def _stiffness(self, bonds: Bonds, moduli) -> Array:
        return self.g * micromodulus(bulk_modulus(moduli), bonds.horizon, bonds.xi.shape[1]) / bonds.horizon

    def state(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Any:
        return displacement_gradient(bonds), self._stiffness(bonds, moduli)

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        H, stiffness = state
        return bond.omega * stiffness * _deviation(H, bond)

    def energy(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        return 0.5 * self._stiffness(bonds, moduli) * jnp.sum((bonds.omega * bonds.volume)[:, None] * z**2)


def _stiffness_of_wan(bonds: Bonds, moduli) -> Float[Array, "dim dim"]:
    inverse = solve_positive(shape_tensor_K(bonds), jnp.eye(bonds.xi.shape[1], dtype=bonds.xi.dtype))
    return jnp.einsum("ijkl,kl->ij", moduli, inverse)


class WanControl(Control):
    """½ Σ w z·C₁z with C₁ = ℂ : K⁻¹."""

    objective: ClassVar[bool] = False

    def state(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Any:
        return displacement_gradient(bonds), _stiffness_of_wan(bonds, moduli)

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        H, stiffness = state
        return bond.omega * (stiffness @ _deviation(H, bond))

    def energy(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        return 0.5 * jnp.einsum("b,bi,ij,bj->", bonds.omega * bonds.volume, z, _stiffness_of_wan(bonds, moduli), z)


class LittlewoodControl(Control):
    """The hourglass force C c (z·Y) Y/(|ξ||Y|²) along the bond; C ≥ 0 [-], 0.02 to 0.04 in use."""

    C: Float[Array, "..."] = eqx.field(converter=lambda C: _positive("C", C), default=0.03)
    hyperelastic: ClassVar[bool] = False

    def state(self, bonds: Bonds, moduli: Float[Array, "dim dim dim dim"]) -> Any:
        c = micromodulus(bulk_modulus(moduli), bonds.horizon, bonds.xi.shape[1])
        return displacement_gradient(bonds), self.C * c

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        H, strength = state
        Y = bond.xi + bond.eta
        # a bond of no weight (padding, damage) carries nothing, though the published force has no ω
        size = jnp.where(bond.omega > 0, strength, 0.0) / jnp.linalg.norm(bond.xi)
        return size * jnp.dot(_deviation(H, bond), Y) / jnp.dot(Y, Y) * Y
