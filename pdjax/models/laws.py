"""Hyperelastic laws: a strain energy density of one point; its stress is the derivative.

A law says what it takes: `takes = "E"` for a law in a (Seth–Hill) strain tensor, S = ∂Ψ/∂E; `takes = "F"` for
a law in the deformation gradient, P = ∂ψ/∂F (first Piola–Kirchhoff). Energies are per reference volume,
constants are arrays (no recompilation for new values) and may vary from point to point in a body:
a constant with shape (points,).

    LinearElastic   Ψ = ½ λ tr(E)² + μ E:E            (St. Venant–Kirchhoff when E is Green–Lagrange, Hencky for m = 0)
    NeoHookean      ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)²,  J = det F     (Simo & Pister 1984 family)

λ and μ are those of the 3D solid: in 2D they are the constants of **plane strain**, E₃₃ = 0, and in 1D of uniaxial
strain. **Plane stress** has other constants or another energy: `plane="stress"` of `from_young` and `from_bulk`. The
linear law then has λ′ = 2λμ/(λ + 2μ) in the place of λ, which is exact. `NeoHookean` finds the stretch F₃₃ = f across
the plane at every point, from ∂ψ/∂f = 0: μ (f² − 1) + λ log(J₂ f) = 0 with J₂ = det of the 2D F.
"""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, check_positive, choice, floats_to_arrays, is_concrete


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


def lame_constants(young: Any = None, poisson: Any = None, bulk: Any = None, shear: Any = None) -> tuple[Any, Any]:
    """(λ, μ) [pressure] of the 3D solid from Young's modulus and Poisson's ratio, or from bulk and shear modulus.

    Raises: ValueError for E ≤ 0, ν outside (−1, ½), K ≤ 0, G < 0, where values are known.
    """
    if bulk is None:
        check_positive("E", young)
        if is_concrete(poisson) and not np.all((np.asarray(poisson) > -1) & (np.asarray(poisson) < 0.5)):
            raise ValueError(f"nu must lie between −1 and ½, or the solid is not stable; got {poisson}")
        mu = young / (2 * (1 + poisson))
        return 2 * mu * poisson / (1 - 2 * poisson), mu
    check_positive("K", bulk)
    if is_concrete(shear) and not np.all(np.isfinite(np.asarray(shear)) & (np.asarray(shear) >= 0)):
        raise ValueError(f"G must be finite and >= 0; got {shear}")
    return bulk - 2 * shear / 3, shear


PLANES = ("strain", "stress")


class LinearElastic(Law):
    """Ψ = ½ λ tr(E)² + μ E:E, so S = λ tr(E) I + 2 μ E; in 1D S = (λ + 2μ) E. λ, μ [pressure], in 2D of plane strain.

    Example: `pd.LinearElastic.from_young(E=210e9, nu=0.3, plane="stress")`.
    """

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    takes: ClassVar[str] = "E"  # type: ignore[misc]
    isotropic: ClassVar[bool] = True  # type: ignore[misc]

    @classmethod
    def from_young(cls, E, nu, plane: str = "strain") -> "LinearElastic":
        """From Young's modulus E [pressure] and Poisson's ratio ν [-] of the solid; plane: what 2D means."""
        return cls._of(*lame_constants(E, nu), plane)

    @classmethod
    def from_bulk(cls, K, G, plane: str = "strain") -> "LinearElastic":
        """From the bulk modulus K and shear modulus G [pressure] of the solid; plane: what 2D means."""
        return cls._of(*lame_constants(bulk=K, shear=G), plane)

    @classmethod
    def _of(cls, lam, mu, plane: str) -> "LinearElastic":
        in_plane = choice("plane", plane, PLANES) == "stress"
        return cls(2 * lam * mu / (lam + 2 * mu) if in_plane else lam, mu)  # type: ignore[call-arg]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return 0.5 * self.lam * _trace(tensor) ** 2 + self.mu * jnp.sum(tensor * tensor)


class NeoHookean(Law):
    """ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)²; linearises to LinearElastic(λ, μ). λ, μ [pressure].

    plane: "strain" (λ, μ as they stand in every dimension) or "stress" (2D alone: F₃₃ is found, see the module).
    """

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    plane: str = eqx.field(static=True, default="strain")
    takes: ClassVar[str] = "F"  # type: ignore[misc]
    isotropic: ClassVar[bool] = True  # type: ignore[misc]

    def __check_init__(self):
        choice("plane", self.plane, PLANES)

    @classmethod
    def from_young(cls, E, nu, plane: str = "strain") -> "NeoHookean":
        """From Young's modulus E [pressure] and Poisson's ratio ν [-] at rest; plane: what 2D means."""
        return cls(*lame_constants(E, nu), plane)  # type: ignore[call-arg, arg-type]

    @classmethod
    def from_bulk(cls, K, G, plane: str = "strain") -> "NeoHookean":
        """From the bulk modulus K and shear modulus G [pressure] at rest; plane: what 2D means."""
        return cls(*lame_constants(bulk=K, shear=G), plane)  # type: ignore[call-arg, arg-type]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        log_J = jnp.log(jnp.linalg.det(tensor))
        across: Any = None  # log F₃₃
        if self.plane == "stress":
            if tensor.shape[0] != 2:
                raise ValueError(f'plane="stress" is for bodies of dim 2; this one has dim {tensor.shape[0]}')
            across = _log_stretch_across(self.lam, self.mu, log_J)
        H = tensor - jnp.eye(tensor.shape[0], dtype=tensor.dtype)
        excess = 2 * _trace(H) + jnp.sum(H * H)  # tr FᵀF − d without cancellation
        if across is not None:
            excess, log_J = excess + jnp.expm1(2 * across), log_J + across
        return 0.5 * self.mu * (excess - 2 * log_J) + 0.5 * self.lam * log_J**2


def _log_stretch_across(lam: Array, mu: Array, log_J2: Array) -> Float[Array, ""]:
    """x = log F₃₃ of plane stress: the root of μ (e^{2x} − 1) + λ (x + log J₂), which is convex and grows with x.

    Newton's steps from a point right of the root (both terms are > 0 there) never leave that side; two more from the
    root carry exact derivatives, as the implicit function theorem has them.
    """

    def step(x, lam, mu, log_J2):
        return x - (mu * jnp.expm1(2 * x) + lam * (x + log_J2)) / (2 * mu * jnp.exp(2 * x) + lam)

    frozen = jax.lax.stop_gradient((lam, mu, log_J2))
    x = jnp.maximum(0.0, -frozen[2])
    x = jax.lax.fori_loop(0, 60, lambda _, x: step(x, *frozen), jax.lax.stop_gradient(x))
    for _ in range(2):
        x = step(x, lam, mu, log_J2)
    return x


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
