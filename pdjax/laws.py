"""Hyperelastic laws: a strain energy density of one point; its stress is the derivative.

A law says what it takes: `takes = "E"` for a law in a (Seth–Hill) strain tensor, S = ∂Ψ/∂E; `takes = "F"` for
a law in the deformation gradient, P = ∂ψ/∂F (first Piola–Kirchhoff). Energies are per reference volume,
constants are arrays (no recompilation for new values) and may vary from point to point in a body:
a constant with shape (points,).

    LinearElastic   Ψ = ½ λ tr(E)² + μ E:E            (St. Venant–Kirchhoff when E is Green–Lagrange, Hencky for m = 0)
    NeoHookean      ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)²,  J = det F     (Simo & Pister 1984 family)
"""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._checks import as_real, choice, floats_to_arrays


def _trace(A: Float[Array, "dim dim"]) -> Float[Array, ""]:
    """A : I, where `jnp.trace` would mask the matrix."""
    return jnp.tensordot(np.eye(len(A), dtype=A.dtype), A, 2)


class Law(eqx.Module):
    """A strain energy. Subclasses set `takes` to "E" or "F" and define `energy` of that tensor.

    `isotropic` is a promise: only then may a lattice's symmetry shorten the search of its waves.
    """

    takes: eqx.AbstractVar[str]
    isotropic: eqx.AbstractVar[bool]

    def __check_init__(self):
        floats_to_arrays(self)

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Strain energy density [force/length² in 2D and 3D terms: the modulus' unit]."""
        raise NotImplementedError


class LinearElastic(Law):
    """Ψ = ½ λ tr(E)² + μ E:E, so S = λ tr(E) I + 2 μ E; in 1D S = (λ + 2μ) E. λ, μ [pressure]."""

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    takes: ClassVar[str] = "E"  # type: ignore[misc]
    isotropic: ClassVar[bool] = True  # type: ignore[misc]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return 0.5 * self.lam * _trace(tensor) ** 2 + self.mu * jnp.sum(tensor * tensor)


class NeoHookean(Law):
    """ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)²; linearises to LinearElastic(λ, μ). λ, μ [pressure]."""

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    takes: ClassVar[str] = "F"  # type: ignore[misc]
    isotropic: ClassVar[bool] = True  # type: ignore[misc]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        log_J = jnp.log(jnp.linalg.det(tensor))
        H = tensor - jnp.eye(tensor.shape[0], dtype=tensor.dtype)
        excess = 2 * _trace(H) + jnp.sum(H * H)  # tr FᵀF − d without cancellation
        return 0.5 * self.mu * (excess - 2 * log_J) + 0.5 * self.lam * log_J**2


class EnergyLaw(Law):  # type: ignore[misc]
    """A law from a user's function: `EnergyLaw(lambda E, c: ..., takes="E", constants=c)`.

    `function` maps (tensor, constants) to the energy density; `constants` is any tree of arrays (traced,
    differentiable). Its value and stress at rest should be zero. `isotropic=True` promises that it is.
    """

    function: Callable[[Any, Any], Any] = eqx.field(static=True)  # type: ignore[misc]
    takes: str = eqx.field(static=True)  # type: ignore[misc]
    constants: Any = eqx.field(converter=lambda tree: jax.tree.map(as_real, tree), default=())
    isotropic: bool = eqx.field(static=True, default=False)

    def __check_init__(self):
        choice("takes", self.takes, ("E", "F"))

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return self.function(tensor, self.constants)


def law_label(law: Law) -> str:
    """The law and its constants in words, for figures and files: LinearElastic(lam=1, mu=1)."""
    values = {name: getattr(law, name) for name in ("lam", "mu", "constants") if hasattr(law, name)}
    shown = ", ".join(f"{k}={np.asarray(v):g}" if np.ndim(v) == 0 else f"{k}=…" for k, v in values.items())
    function = getattr(law, "function", None)
    name = getattr(function, "__name__", None) or type(law).__name__
    return f"{name}({shown})"


def law_stress(law: Law, tensor: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """∂Ψ/∂E (symmetric) for a law in E, P = ∂ψ/∂F for a law in F [pressure]."""
    gradient = jax.grad(law.energy)(tensor)
    return (gradient + gradient.T) / 2 if law.takes == "E" else gradient
