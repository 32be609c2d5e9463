"""The symbol of an infinite lattice: its exact Jacobian, one d × d block for each wave vector.

On a uniform lattice under x = F X the Jacobian is block-circulant, and its spectrum is that of

    Ĵ(k) = Σ_η J⟨η⟩ e^{ik·η},   k in the Brillouin zone [−π/h, π/h]^d.

By translation invariance one family is enough. With q_ξ = e^{ik·ξ} − 1 and C = ∂T/∂η of that family,

    Ĵ(k) = −Σ_ξζ q̄_ξ V C_ξζ q_ζ.                                                            (any model)

For a point-state model C_ξζ = δ_ξζ B_ξ + G_ξ R_ζ, and in a centro-symmetric family B is even, G and R odd; over half
of it

    Ĵ(k) = −[ Σ b_ξ c_ξ + (Σ g_ξ s_ξ)(Σ r_ξ s_ξ) ],   c = |q|² = 4 sin²(k·ξ/2),  s = sin k·ξ,
    b = 2 V B,   g = 2 V G,   r = 2 R:

linearise once for each (model, F), then thousands of wave vectors are two matrix products with tables of c and s.
As k = tN → 0, Ĵ/t² tends to the same formula with c = (N·ξ)², s = N·ξ: minus the acoustic tensor.
Sources: Born & Huang 1954 for the method; this form for state-based peridynamics is derived here.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._checks import deformation_gradient, require
from .force import affine_stress, check_model
from .models.base import AbstractModel, PointStateModel
from .neighbours import Family
from .tangent import family_tangent, linearise_states


class Phases(NamedTuple):
    """A wave on the half family: c = |q|², s = Im q, even = Re q, and κ² of the lattice Laplacian [1/length²]."""

    c: Float[Array, "*waves half"]
    s: Float[Array, "*waves half"]
    even: Float[Array, "*waves half"]
    kappa2: Float[Array, "*waves"]


def wave_phases(fam: Family, k: Float[Array, "*waves dim"]) -> Phases:
    """Phases of wave vectors k [1/length]; κ² = Σ_i ((2/h) sin(k_i h/2))²."""
    x = k @ fam.xi[: fam.xi.shape[0] // 2].T
    c = 4 * jnp.sin(x / 2) ** 2
    kappa2 = jnp.sum((2 / fam.spacing * jnp.sin(k * fam.spacing / 2)) ** 2, axis=-1)
    return Phases(c, jnp.sin(x), -c / 2, kappa2)


def long_wave_phases(fam: Family, direction: Float[Array, "*waves dim"]) -> Phases:
    """The limit k → 0 along a direction (any length: the quotient by κ² does not depend on it)."""
    x = direction @ fam.xi[: fam.xi.shape[0] // 2].T / fam.spacing
    return Phases(x**2, x, jnp.zeros_like(x), jnp.sum(direction**2, axis=-1) / fam.spacing**2)


class StateTangent(eqx.Module):
    """b, g, r over the half family of a point-state model."""

    b: Float[Array, "half dim dim"]
    g: Float[Array, "half dim rank"]
    r: Float[Array, "half rank dim"]

    def __call__(self, phases: Phases) -> Float[Array, "*waves dim dim"]:
        """Ĵ at every wave of `phases` [force/length^(dim+1)]."""
        direct = jnp.einsum("...h,hij->...ij", phases.c, self.b)
        left = jnp.einsum("...h,hir->...ir", phases.s, self.g)
        right = jnp.einsum("...h,hrj->...rj", phases.s, self.r)
        return -(direct + left @ right)

    def components(self, phases: Phases) -> list[list[Array]]:
        """Ĵ_ij (upper triangle of its symmetric part) as separate (waves,) arrays: what a fast screen wants.

        Two matrix products with the shared tables; the rest is elementwise and fuses.
        """
        half, dim, rank = self.g.shape
        pairs = [(i, j) for i in range(dim) for j in range(i, dim)]
        b = jnp.stack([(self.b[:, i, j] + self.b[:, j, i]) / 2 for i, j in pairs])
        direct = b @ phases.c.T
        odd = jnp.concatenate([self.g.reshape(half, -1), self.r.reshape(half, -1)], axis=1).T @ phases.s.T
        left = odd[: dim * rank].reshape(dim, rank, -1)
        right = odd[dim * rank :].reshape(rank, dim, -1)
        out: list[list[Array]] = [[jnp.zeros(())] * dim for _ in range(dim)]
        for n, (i, j) in enumerate(pairs):
            product = sum(left[i, r] * right[r, j] + left[j, r] * right[r, i] for r in range(rank)) / 2
            out[i][j] = out[j][i] = -(direct[n] + product)
        return out


class DenseTangent(eqx.Module):
    """V C folded on the half family by parity, for models that give the energy alone."""

    even: Float[Array, "half dim half dim"]
    odd: Float[Array, "half dim half dim"]

    def __call__(self, phases: Phases) -> Float[Array, "*waves dim dim"]:
        cosine = jnp.einsum("...a,aibj,...b->...ij", phases.even, self.even, phases.even)
        sine = jnp.einsum("...a,aibj,...b->...ij", phases.s, self.odd, phases.s)
        return -(cosine + sine)

    def components(self, phases: Phases) -> list[list[Array]]:
        J = self(phases)
        dim = J.shape[-1]
        return [[(J[..., i, j] + J[..., j, i]) / 2 for j in range(dim)] for i in range(dim)]


Tangent = StateTangent | DenseTangent


def homogeneous_tangent(model: AbstractModel, fam: Family, F: Float[Array, "dim dim"]) -> Tangent:
    """Linearise a model once at x = F X; the result is called on `Phases`."""
    bonds = fam.bonds(F)
    half = fam.xi.shape[0] // 2
    V = bonds.volume[0]
    if isinstance(model, PointStateModel):
        t = linearise_states(model, bonds, first=half)
        # far-end states carry e^{ik·ξ}: by parity their G adds to the near one in (Σ g s)
        return StateTangent(2 * V * t.B, 2 * V * (t.G + t.there), 2 * t.R.transpose(1, 0, 2))
    C = V * family_tangent(model, bonds)
    same, cross = C[:half, :, :half], C[:half, :, half:]
    mirror, back = C[half:, :, half:], C[half:, :, :half]
    return DenseTangent(same + cross + back + mirror, same - cross - back + mirror)


def symbol(model: AbstractModel, fam: Family, F, k) -> Float[Array, "*waves dim dim"]:
    """Ĵ(k), the exact Jacobian of the infinite lattice on the plane wave e^{ik·X}.

    Arguments: F (dim, dim) [-], det F > 0; k (..., dim) [1/length], any number of wave vectors.
    Returns: (..., dim, dim) real [force/length^(dim+1)]; symmetric for hyperelastic models, zero at k = 0.
    Raises: ValueError for det F ≤ 0, NaN in k, a k of the wrong dimension, a singular family.
    """
    check_model(model, fam)
    F = deformation_gradient(F, fam.dim)
    k = jnp.asarray(k, dtype=F.dtype)
    if k.ndim == 0 or k.shape[-1] != fam.dim:
        raise ValueError(f"k must have shape (..., {fam.dim}) for this family; got {k.shape}")
    k = require(k, jnp.isfinite(k), "k must be finite")
    return _symbol(model, fam, F, k)


@eqx.filter_jit
def _symbol(model: AbstractModel, fam: Family, F: Array, k: Array) -> Array:
    return homogeneous_tangent(model, fam, F)(wave_phases(fam, k))


def p_wave_modulus(model: AbstractModel, fam: Family) -> Float[Array, ""]:
    """M = ∂P₁₁/∂F₁₁ at F = I [pressure]: the law's λ + 2μ, as the model on this family has it."""
    check_model(model, fam)
    return _modulus(model, fam)


@eqx.filter_jit
def _modulus(model: AbstractModel, fam: Family) -> Array:
    I = jnp.eye(fam.dim, dtype=fam.xi.dtype)
    axial = jnp.zeros_like(I).at[0, 0].set(1)
    return jax.jvp(lambda F: affine_stress(model, fam, F), (I,), (axial,))[1][0, 0]
