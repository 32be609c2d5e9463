"""Controls of zero-energy modes: forces that oppose z = Y − F̄ξ, the part of a bond's deformation that F̄ misses.

A control adds a term to the energy density W and to the force state T of a model:

    Silling     W + ½ g (c/δ) Σ w |z|²,     T + ω g (c/δ) z        g a number, c the bond micromodulus of the law
    Wan         W + ½ Σ w z·C₁z,            T + ω C₁ z             (C₁)_ij = ℂ_ijkl (K⁻¹)_kl, no number to choose
    Littlewood  no energy,                  T + C c (z·Y) Y/(|ξ||Y|²)

ℂ is the law's tangent at rest. c is the d-dimensional micromodulus of its bulk modulus k = ℂ_iijj/d²: 18k/(πδ⁴) in 3D,
12k/(πδ³) in 2D, 2k/δ² in 1D. λ and μ therefore come from the model's law, with the meaning that they have there (3D
solid, in 2D plane strain).

The two forces are the exact derivatives of the two energies. The derivative of F̄ does not appear in them, because
Σ w z⊗ξ = 0. With ω = 1 on a full ball and an isotropic law the first two controls are equal at g = 5/8 (3D), 2/3 (2D)
and 3/4 (1D).

Silling's control was published with another scaling whose units do not fit; the scaling above is the one in use since
then. Wan's control is not objective where C₁ is not a multiple of I, which happens on clouds and at surfaces.
Littlewood's force contains no ω. It is normalised here by |ξ||Y|², so that C has no unit. It acts along the bond and is
not the derivative of an energy.

Sources: Silling 2017; Wan et al. 2019; Littlewood 2010.
"""

import math
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float, PyTree

from .._internal.checks import as_real, namespace, on_host, require
from .._internal.shown import shown
from ..geometry.bonds import Bonds
from .base import Sums
from .kinematics import displacement_gradient, gradient_of_moments, shape_tensor_K, solve_positive

Tangent = Callable[[Array | np.ndarray], Float[Array, "dim dim"]]


def micromodulus(bulk, horizon, dim: int):
    """Micromodulus c [pressure/length^(dim+1)] of springs whose d-dimensional bulk modulus is k = `bulk` [pressure].

    For a full ball and ω = 1 it is 18k/(πδ⁴) in 3D, 12k/(πδ³) in 2D and 2k/δ² in 1D.
    """
    return bulk * {3: 18 / math.pi, 2: 12 / math.pi, 1: 2.0}[dim] / horizon ** (dim + 1)


def bulk_modulus(tangent: Tangent, dim: int, dtype: DTypeLike) -> Float[Array, ""]:
    """k = ℂ_iijj/d² [pressure], the d-dimensional bulk modulus of a law's tangent at rest."""
    I = np.eye(dim, dtype=dtype)
    return jnp.tensordot(I, tangent(I), 2) / dim**2


def _positive(name: str, value: object) -> Array:
    value = as_real(value)
    xp, number = namespace(value), on_host(value)
    return require(value, xp.isfinite(number) & (number >= 0), f"{name} must be finite and >= 0; got {value}")


class Control(eqx.Module):
    """Base of the controls: a force that opposes z = Y − F̄ξ.

    `state` is made once for each point, from K and M of its family (the two trees of `sums`) and the law's tangent at
    rest, A → ℂ:A. A control with `own_moments` defines `moments(bond)`, and `state` also gets their sums. `force` gives
    the force on one bond and is linear in that state.
    """

    hyperelastic: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    degree: ClassVar[int] = 1
    own_moments: ClassVar[bool] = False
    one_number: ClassVar[tuple[str, ...]] = ()  # names of fields that hold one number, or one for each point

    def __repr__(self) -> str:
        return shown(self)

    def moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        """The terms of one bond in the sums of the control's own, (reference, deformed)."""
        raise NotImplementedError

    def state(self, sums: Sums, tangent: Tangent, *own: Sums) -> PyTree:
        raise NotImplementedError

    def force(self, state: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        """The contribution of the control to T on one bond [force/length^(2 dim)]."""
        raise NotImplementedError

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        """The contribution of the control to W [energy/length^dim]; ValueError if the control has no energy."""
        raise ValueError(f"{type(self).__name__} is not the derivative of an energy")


def _deviation(H: Float[Array, "dim dim"], bonds: Bonds) -> Float[Array, "*bonds dim"]:
    return bonds.eta - bonds.xi @ H.T


class SillingControl(Control):
    """Silling's control of zero-energy modes, by the energy ½ g (c/δ) Σ w |z|².

    It adds ω g (c/δ) z to the force state, with z = Y − F̄ξ, the horizon δ and the micromodulus c of the model's law.
    The energy is objective. Pass the control to `Correspondence`, `SethHill` or `TupekRadovitzky`.

    Parameters
    ----------
    g : float or array, shape (points,)
        Strength [-], ≥ 0, of order one; 0.5 by default.

    Raises
    ------
    ValueError
        If g is negative or not finite.

    References
    ----------
    Silling 2017.

    Examples
    --------
    >>> law, family = pd.LinearElastic(1.0, 1.0), pd.lattice_family(2, 2)
    >>> pd.stability(pd.Correspondence(law), family, np.eye(2)).verdict
    'marginal'
    >>> pd.stability(pd.Correspondence(law, pd.SillingControl(g=0.5)), family, np.eye(2)).verdict
    'stable'
    """

    g: Float[Array, "..."] = eqx.field(converter=lambda g: _positive("g", g), default=0.5)
    one_number: ClassVar[tuple[str, ...]] = ("g",)

    def _stiffness(self, horizon: Array, tangent: Tangent, dim: int) -> Array:
        return self.g * micromodulus(bulk_modulus(tangent, dim, horizon.dtype), horizon, dim) / horizon

    def state(self, sums: Sums, tangent: Tangent, *own: Sums) -> tuple[Array, Array]:
        stiffness = self._stiffness(sums.horizon, tangent, sums.dim)
        return stiffness * gradient_of_moments(sums.reference, sums.deformed), stiffness

    def force(self, state: tuple[Array, Array], bond: Bonds) -> Float[Array, " dim"]:
        pull, stiffness = state
        return bond.omega * (stiffness * bond.eta - pull @ bond.xi)

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        stiffness = self._stiffness(bonds.horizon, tangent, bonds.xi.shape[-1])
        return 0.5 * stiffness * jnp.sum((bonds.omega * bonds.volume)[:, None] * z**2)


def _stiffness_of_wan(K: Float[Array, "dim dim"], tangent: Tangent) -> Float[Array, "dim dim"]:
    return tangent(solve_positive(K, jnp.eye(len(K), dtype=K.dtype)))


class WanControl(Control):
    """Wan's control of zero-energy modes, by the energy ½ Σ w z·C₁z with C₁ = ℂ : K⁻¹.

    It adds ω C₁ z to the force state, with z = Y − F̄ξ and the tangent ℂ of the model's law at rest. It has no
    parameter. On clouds and at surfaces C₁ is not a multiple of I and the energy is not objective: it changes if the
    deformed body turns. Pass the control to `Correspondence`, `SethHill` or `TupekRadovitzky`.

    References
    ----------
    Wan et al. 2019.

    Examples
    --------
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0), pd.WanControl())
    >>> pd.stability(model, pd.lattice_family(2, 2), np.eye(2)).verdict
    'stable'
    """

    objective: ClassVar[bool] = False

    def state(self, sums: Sums, tangent: Tangent, *own: Sums) -> tuple[Array, Array]:
        stiffness = _stiffness_of_wan(sums.reference, tangent)
        return stiffness @ gradient_of_moments(sums.reference, sums.deformed), stiffness

    def force(self, state: tuple[Array, Array], bond: Bonds) -> Float[Array, " dim"]:
        pull, stiffness = state
        return bond.omega * (stiffness @ bond.eta - pull @ bond.xi)

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        z = _deviation(displacement_gradient(bonds), bonds)
        stiffness = _stiffness_of_wan(shape_tensor_K(bonds), tangent)
        return 0.5 * jnp.einsum("b,bi,ij,bj->", bonds.omega * bonds.volume, z, stiffness, z)


class LittlewoodControl(Control):
    """Littlewood's hourglass force, C c (z·Y) Y/(|ξ||Y|²) along the bond.

    z = Y − F̄ξ, and c is the micromodulus of the model's law. The force is not the derivative of an energy, so
    Jacobians of bodies are not symmetric. Pass the control to `Correspondence`, `SethHill` or `TupekRadovitzky`.

    Parameters
    ----------
    C : float or array, shape (points,)
        Strength [-], ≥ 0; values in use are 0.02 to 0.04, 0.03 by default.

    Raises
    ------
    ValueError
        If C is negative or not finite.

    References
    ----------
    Littlewood 2010.

    Examples
    --------
    >>> control = pd.LittlewoodControl(C=0.04)
    >>> control.hyperelastic, pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0), control).hyperelastic
    (False, False)
    """

    C: Float[Array, "..."] = eqx.field(converter=lambda C: _positive("C", C), default=0.03)
    one_number: ClassVar[tuple[str, ...]] = ("C",)
    degree: ClassVar[int] = 0
    hyperelastic: ClassVar[bool] = False

    def state(self, sums: Sums, tangent: Tangent, *own: Sums) -> tuple[Array, Array]:
        strength = self.C * micromodulus(bulk_modulus(tangent, sums.dim, sums.horizon.dtype), sums.horizon, sums.dim)
        return strength * gradient_of_moments(sums.reference, sums.deformed), strength

    def force(self, state: tuple[Array, Array], bond: Bonds) -> Float[Array, " dim"]:
        pull, strength = state
        Y = bond.xi + bond.eta
        # The published force has no ω, so bonds without weight (padded or broken ones) are set to zero here.
        size = jnp.where(bond.omega != 0, 1.0, 0.0) / jnp.sqrt(jnp.dot(bond.xi, bond.xi))
        return size * jnp.dot(strength * bond.eta - pull @ bond.xi, Y) / jnp.dot(Y, Y) * Y
