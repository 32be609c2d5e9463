"""A control of zero-energy modes with a strength for every bond length.

    W + ½ (c/δ) Σ w g(q) |z|²,    z = Y − F̄ξ,    q = |ξ|/δ

g(q) is linear between given values and may be negative. With one constant value the control equals `SillingControl`.
The constants are those of `pdjax.models.control`: δ is the horizon and c the micromodulus of the law.

Where g varies, F̄ is no longer the best fit of the control's own weights, Σ w g z⊗ξ ≠ 0. The derivative of F̄ therefore
stays in the force. With K = Σ w ξ⊗ξ, H = F̄ − I, M_g = Σ w g η⊗ξ and K_g = Σ w g ξ⊗ξ,

    T + ω (c/δ) [g z − Z K⁻¹ ξ],    Z = Σ w g z⊗ξ = M_g − H K_g.

The energy changes neither under rotations nor in affine deformations. On long waves it is of fourth order in k, and
values of both signs can cancel this order.

Source: derived here.
"""

from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, is_concrete
from ..geometry.bonds import Bonds
from ..geometry.shells import piecewise_linear
from .base import Sums
from .control import Control, Tangent, bulk_modulus, micromodulus
from .kinematics import displacement_gradient, gradient_moments, gradient_of_moments, solve_positive


class ShellControl(Control):
    """Control of zero-energy modes whose strength depends on the length of the bond.

    It adds ½ (c/δ) Σ w g(q) |z|² to the energy, with z = Y − F̄ξ and q = |ξ|/δ. The energy is objective. Pass the
    control to `Correspondence`, `SethHill` or `TupekRadovitzky`.

    Parameters
    ----------
    q : tuple of float
        Lengths over the horizon [-], increasing, > 0. `shells` gives those of a lattice.
    strengths : array, shape (values,)
        Strength g [-] at these lengths. It is linear between them and constant beyond, and it may be negative.

    Raises
    ------
    ValueError
        If q is not increasing and > 0, or if the strengths have another shape or are not finite.

    Examples
    --------
    With equal strengths the control is that of Silling.

    >>> law, family = pd.LinearElastic(1.0, 1.0), pd.lattice_family(2, 2)
    >>> control = pd.ShellControl(pd.shells(2, 2), [0.5, 0.5, 0.5])
    >>> same = pd.SillingControl(0.5)
    >>> [round(float(pd.stability(pd.Correspondence(law, c), family, np.eye(2)).margin), 6) for c in (control, same)]
    [-0.159155, -0.159155]
    """

    q: tuple[float, ...] = eqx.field(static=True, converter=lambda q: tuple(float(x) for x in np.ravel(q)))
    strengths: Float[Array, " values"] = eqx.field(converter=as_real)
    shared: ClassVar[tuple[str, ...]] = ("strengths",)
    own_moments: ClassVar[bool] = True

    def __check_init__(self):
        q = np.asarray(self.q)
        if not (len(q) and np.isfinite(q).all() and (q > 0).all() and (np.diff(q) > 0).all()):
            raise ValueError(f"q must be increasing, finite and > 0; got {self.q}")
        if self.strengths.shape != q.shape:
            raise ValueError(f"strengths must have the shape of q, {q.shape}; got {self.strengths.shape}")
        if is_concrete(self.strengths) and not np.isfinite(np.asarray(self.strengths)).all():
            raise ValueError(f"strengths must be finite; got {np.asarray(self.strengths)}")

    def strength(self, xi: Float[Array, "*bonds dim"], horizon: Array) -> Float[Array, "*bonds"]:
        """g [-] of bonds."""
        return piecewise_linear(jnp.sqrt(jnp.sum(xi**2, axis=-1)) / horizon, np.asarray(self.q), self.strengths)

    def _unit(self, horizon: Array, tangent: Tangent, dim: int) -> Array:
        return micromodulus(bulk_modulus(tangent, dim, horizon.dtype), horizon, dim) / horizon

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        reference, deformed = gradient_moments(bond)
        g = self.strength(bond.xi, bond.horizon)
        return g * reference, g * deformed

    def state(self, sums: Sums, tangent: Tangent, *own: Sums) -> Any:
        (mine,) = own
        unit = self._unit(sums.horizon, tangent, sums.dim)
        H = gradient_of_moments(sums.reference, sums.deformed)
        Z = mine.deformed - H @ mine.reference
        return unit * H, unit * solve_positive(sums.reference, Z.T).T, unit

    def force(self, state: Any, bond: Bonds) -> Float[Array, " dim"]:
        H, pull, unit = state
        g = self.strength(bond.xi, bond.horizon)
        return bond.omega * (g * (unit * bond.eta - H @ bond.xi) - pull @ bond.xi)

    def energy(self, bonds: Bonds, tangent: Tangent) -> Float[Array, ""]:
        z = bonds.eta - bonds.xi @ displacement_gradient(bonds).T
        unit = self._unit(bonds.horizon, tangent, bonds.xi.shape[-1])
        weighted = bonds.omega * bonds.volume * self.strength(bonds.xi, bonds.horizon)
        return 0.5 * unit * jnp.sum(weighted[:, None] * z**2)
