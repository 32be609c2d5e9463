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
from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, namespace, on_host, require
from ..geometry.bonds import Bonds
from .base import Sums
from .kinematics import displacement_gradient, gradient_of_moments, shape_tensor_K, solve_positive

Tangent = Callable[[Any], Float[Array, "dim dim"]]


def micromodulus(bulk, horizon, dim: int):
    """c of the bonds whose d-dimensional bulk modulus is `bulk` [pressure] on a full ball.

    c [pressure/length^(dim+1)]: 18k/(πδ⁴), 12k/(πδ³), 2k/δ² in 3D, 2D, 1D.
    """
    return bulk * {3: 18 / math.pi, 2: 12 / math.pi, 1: 2.0}[dim] / horizon ** (dim + 1)


def bulk_modulus(tangent: Tangent, dim: int, dtype: Any) -> Float[Array, ""]:
    """k = ℂ_iijj/d² [pressure], the d-dimensional bulk modulus of a law's tangent at rest."""
    I = np.eye(dim, dtype=dtype)
    return jnp.tensordot(I, tangent(I), 2) / dim**2


def _positive(name: str, value: Any) -> Array:
    value = as_real(value)
    xp, number = namespace(value), on_host(value)
    return require(value, xp.isfinite(number) & (number >= 0), f"{name} must be finite and >= 0; got {value}")


class Control(eqx.Module):
    """What opposes z. `state` is what a point sends along its bonds, made from K and M of its family (the two trees of
    `sums`) and the law's tangent at rest, A → ℂ:A; the force is linear in it."""

    hyperelastic: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    degree: ClassVar[int] = 1

    def state(self, sums: Sums, tangent: Tangent) -> Any:
        raise NotImplementedError

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        """What T gains on one bond [force/length^(2 dim)]."""
        raise NotImplementedError

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        """What W gains [energy/length^dim]."""
        raise ValueError(f"{type(self).__name__} is not the derivative of an energy")


def _deviation(H: Float[Array, "dim dim"], bonds: Bonds) -> Float[Array, "*bonds dim"]:
    return bonds.eta - bonds.xi @ H.T


class SillingControl(Control):
    """½ g (c/δ) Σ w |z|²; g ≥ 0 [-], of order one."""

    g: Float[Array, "..."] = eqx.field(converter=lambda g: _positive("g", g), default=0.5)

    def _stiffness(self, horizon: Array, tangent: Tangent, dim: int) -> Array:
        return self.g * micromodulus(bulk_modulus(tangent, dim, horizon.dtype), horizon, dim) / horizon

    def state(self, sums: Sums, tangent: Tangent) -> Any:
        stiffness = self._stiffness(sums.horizon, tangent, sums.dim)
        return stiffness * gradient_of_moments(sums.reference, sums.deformed), stiffness

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        pull, stiffness = state
        return bond.omega * (stiffness * bond.eta - pull @ bond.xi)

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        stiffness = self._stiffness(bonds.horizon, tangent, bonds.xi.shape[-1])
        return 0.5 * stiffness * jnp.sum((bonds.omega * bonds.volume)[:, None] * z**2)


def _stiffness_of_wan(K: Float[Array, "dim dim"], tangent: Tangent) -> Float[Array, "dim dim"]:
    return tangent(solve_positive(K, jnp.eye(len(K), dtype=K.dtype)))


class WanControl(Control):
    """½ Σ w z·C₁z with C₁ = ℂ : K⁻¹."""

    objective: ClassVar[bool] = False

    def state(self, sums: Sums, tangent: Tangent) -> Any:
        stiffness = _stiffness_of_wan(sums.reference, tangent)
        return stiffness @ gradient_of_moments(sums.reference, sums.deformed), stiffness

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        pull, stiffness = state
        return bond.omega * (stiffness @ bond.eta - pull @ bond.xi)

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        stiffness = _stiffness_of_wan(shape_tensor_K(bonds), tangent)
        return 0.5 * jnp.einsum("b,bi,ij,bj->", bonds.omega * bonds.volume, z, stiffness, z)


class LittlewoodControl(Control):
    """The hourglass force C c (z·Y) Y/(|ξ||Y|²) along the bond; C ≥ 0 [-], 0.02 to 0.04 in use."""

    C: Float[Array, "..."] = eqx.field(converter=lambda C: _positive("C", C), default=0.03)
    degree: ClassVar[int] = 0
    hyperelastic: ClassVar[bool] = False

    def state(self, sums: Sums, tangent: Tangent) -> Any:
        strength = self.C * micromodulus(bulk_modulus(tangent, sums.dim, sums.horizon.dtype), sums.horizon, sums.dim)
        return strength * gradient_of_moments(sums.reference, sums.deformed), strength

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        pull, strength = state
        Y = bond.xi + bond.eta
        # a bond of no weight (padding, damage) carries nothing, though the published force has no ω
        size = jnp.where(bond.omega > 0, 1.0, 0.0) / jnp.sqrt(jnp.dot(bond.xi, bond.xi))
        return size * jnp.dot(strength * bond.eta - pull @ bond.xi, Y) / jnp.dot(Y, Y) * Y
