"""The symbol of an infinite lattice: its exact Jacobian on plane waves, one d × d block for each wave vector.

On a uniform lattice of spacing h under x = F X the Jacobian is block-circulant. Its eigenvalues are those of the symbol

    Ĵ(k) = Σ_η J⟨η⟩ e^{ik·η},   k in the Brillouin zone [−π/h, π/h]^d,

where J⟨η⟩ is the block of the Jacobian that couples two points at the distance vector η.

**Any model.** All families are equal, so one family is enough. With C = ∂T/∂η of this family and q_ξ = e^{ik·ξ} − 1,

    Ĵ(k) = −Σ_ξζ q̄_ξ V C_ξζ q_ζ.

**Point-state model.** Here C_ξζ = δ_ξζ B_ξ + G_ξ R_ζ (`pdjax.tangent.linearise`). In a centro-symmetric family B is
even and G and R are odd in ξ, so sums over one half of the family suffice:

    Ĵ(k) = −[ Σ b_ξ c_ξ + (Σ g_ξ s_ξ)(Σ r_ξ s_ξ) ],   c = |q|² = 4 sin²(k·ξ/2),  s = sin k·ξ,
    b = 2 V B,   g = 2 V G,   r = 2 R.

If the states of a model are not even in ξ, the formula for any model is used.

**Model of two stages.** Let H be the Hessian of the energy of a bond. The states are linear in η, so they add no second
derivative. The states of both ends are coupled; with ρ = Σ r s,

    Ĵ(k) = −[ Σ b c + (Σ g s) ρ + ρᵀ(Σ g s)ᵀ + ρᵀ (Σ H_here + H_there + (H_mixed + H_mixedᵀ) cos k·ξ) ρ ].

A model is linearised once for each F. After that, thousands of wave vectors need only two matrix products with tables
of c and s.

**Long waves.** As k = tN → 0, Ĵ/t² tends to the same formula with c = (N·ξ)² and s = N·ξ. This limit is minus the
acoustic tensor.

Sources: Born & Huang 1954 for the method. This form for state-based peridynamics is derived here.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import Numbers, Same
from ..force.fields import affine_stress
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel, PointStateModel, TwoStageModel
from ..tangent.linearise import family_tangent, linearise_states, linearise_two_stage


def squared_chord(angle: Same, long: Numbers | None = None) -> Same:
    """c = |e^{ix} − 1|² = 4 sin²(x/2) of every angle x, or its limit x² for long waves where `long` is True."""
    xp = np if isinstance(angle, np.ndarray) else jnp
    c = 4 * xp.sin(angle / 2) ** 2
    return c if long is None else xp.where(long, angle**2, c)


def laplacian(x: Float[Numbers, "*waves dim"], long: Numbers | None = None) -> Float[Numbers, "*waves"]:
    """κ² = Σ_i 4 sin²(x_i/2) [1/spacing²] of the lattice Laplacian at x = h k, or |x|² for long waves."""
    return squared_chord(x, long).sum(axis=-1)


class Phases(NamedTuple):
    """Plane waves on half of a family: c = |q|², s = Im q, even = Re q, and κ² [1/length²] of the lattice Laplacian."""

    c: Float[Array, "*waves half"]
    s: Float[Array, "*waves half"]
    even: Float[Array, "*waves half"]
    kappa2: Float[Numbers, "*waves"]


def wave_phases(family: LatticeFamily, k: Float[Array, "*waves dim"]) -> Phases:
    """The phases of wave vectors k [1/length], with κ² = Σ_i ((2/h) sin(k_i h/2))²."""
    x = k @ family.xi[: family.xi.shape[0] // 2].T
    c = squared_chord(x)
    return Phases(c, jnp.sin(x), -c / 2, laplacian(k * family.spacing) / family.spacing**2)


def long_wave_phases(family: LatticeFamily, direction: Float[Array, "*waves dim"]) -> Phases:
    """The phases in the limit k → 0 along a direction of any length: the quotient by κ² does not depend on it."""
    x = direction @ family.xi[: family.xi.shape[0] // 2].T / family.spacing
    return Phases(x**2, x, jnp.zeros_like(x), jnp.sum(direction**2, axis=-1) / family.spacing**2)


def _components(tangent: Callable, phases: Phases) -> list[list[Array]]:
    """The entries Ĵ_ij of the symmetric part of Ĵ as separate arrays (waves,)."""
    J = tangent(phases)
    dim = J.shape[-1]
    return [[(J[..., i, j] + J[..., j, i]) / 2 for j in range(dim)] for i in range(dim)]


def _sums(t: "StateTangent | TwoStageTangent", phases: Phases) -> tuple[Array, Array, Array]:
    """Σ b c, Σ g s and Σ r s over the half family."""
    direct = jnp.einsum("...h,hij->...ij", phases.c, t.b)
    left = jnp.einsum("...h,hir->...ir", phases.s, t.g)
    right = jnp.einsum("...h,hrj->...rj", phases.s, t.r)
    return direct, left, right


class StateTangent(eqx.Module):
    """The tangent of a point-state model: b, g and r over half of the family.

    All kinds of tangents declare three properties. `rings` is the number of rings of neighbours that the blocks of the
    cosine series reach. `series_on_host` says that NumPy makes the series, and `one_by_one` that a tangent takes so
    much time and memory that several states are linearised one after another.
    """

    rings: ClassVar[int] = 2
    series_on_host: ClassVar[bool] = True
    one_by_one: ClassVar[bool] = False

    b: Float[Array, "half dim dim"]
    g: Float[Array, "half dim rank"]
    r: Float[Array, "half rank dim"]

    @classmethod
    def of(cls, model: PointStateModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> "StateTangent":
        """The tangent of a point-state model at x = F X."""
        bonds, half = family.bonds(F), family.xi.shape[0] // 2
        V, t = bonds.volume[0], linearise_states(model, bonds, first=half)
        # The states of far ends have the phase e^{ik·ξ}. By parity their G adds to that of this point in Σ g s.
        return cls(2 * V * t.B, 2 * V * (t.G + t.there), 2 * t.R.transpose(1, 0, 2))

    def __call__(self, phases: Phases) -> Float[Array, "*waves dim dim"]:
        """Ĵ [force/length^(dim+1)] at every wave of `phases`."""
        direct, left, right = _sums(self, phases)
        return -(direct + left @ right)

    def components(self, phases: Phases) -> list[list[Array]]:
        """The entries Ĵ_ij of the symmetric part of Ĵ as separate arrays (waves,), for a fast scan of many waves.

        It needs two matrix products with the tables of c and s. All other operations are elementwise, and XLA fuses
        them.
        """
        half, dim, rank = self.g.shape
        pairs = [(i, j) for i in range(dim) for j in range(i, dim)]
        b = jnp.stack([(self.b[:, i, j] + self.b[:, j, i]) / 2 for i, j in pairs])
        direct = b @ phases.c.T
        odd = jnp.concatenate([self.g.reshape(half, -1), self.r.reshape(half, -1)], axis=1).T @ phases.s.T
        waves = phases.s.shape[0]
        left = odd[: dim * rank].reshape(dim, rank, waves)  # the rank is 0 for springs, which have no state
        right = odd[dim * rank :].reshape(rank, dim, waves)
        out: list[list[Array]] = [[jnp.zeros(())] * dim for _ in range(dim)]
        for n, (i, j) in enumerate(pairs):
            product = sum(left[i, r] * right[r, j] + left[j, r] * right[r, i] for r in range(rank)) / 2
            out[i][j] = out[j][i] = -(direct[n] + product)
        return out


class DenseTangent(eqx.Module):
    """The tangent V C of a model that gives only its energy, folded onto half of the family by parity."""

    rings: ClassVar[int] = 2
    series_on_host: ClassVar[bool] = False
    one_by_one: ClassVar[bool] = True

    even: Float[Array, "half dim half dim"]
    odd: Float[Array, "half dim half dim"]

    @classmethod
    def of(cls, model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> "DenseTangent":
        """The tangent of any model of one stage at x = F X."""
        bonds, half = family.bonds(F), family.xi.shape[0] // 2
        C = bonds.volume[0] * family_tangent(model, bonds)
        same, cross = C[:half, :, :half], C[:half, :, half:]
        mirror, back = C[half:, :, half:], C[half:, :, :half]
        return cls(same + cross + back + mirror, same - cross - back + mirror)

    def __call__(self, phases: Phases) -> Float[Array, "*waves dim dim"]:
        cosine = jnp.einsum("...a,aibj,...b->...ij", phases.even, self.even, phases.even)
        sine = jnp.einsum("...a,aibj,...b->...ij", phases.s, self.odd, phases.s)
        return -(cosine + sine)

    components = _components


class TwoStageTangent(eqx.Module):
    """The tangent of a model of two stages: b, g and r over half of the family, and the Hessian of the states.

    `level` is the constant part of this Hessian plus the value of its cosine part at k = 0. `mixed` are the
    coefficients of cos k·ξ.
    """

    rings: ClassVar[int] = 3
    series_on_host: ClassVar[bool] = False
    one_by_one: ClassVar[bool] = False

    b: Float[Array, "half dim dim"]
    g: Float[Array, "half dim rank"]
    r: Float[Array, "half rank dim"]
    level: Float[Array, "rank rank"]
    mixed: Float[Array, "half rank rank"]

    @classmethod
    def of(cls, model: TwoStageModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> "TwoStageTangent":
        """The tangent of a model of two stages at x = F X: the Hessians of the whole family, folded onto half of it."""
        t, half = linearise_two_stage(model, family.bonds(F)), family.xi.shape[0] // 2
        level = jnp.sum(t.here + t.there + t.mixed + t.mixed.mT, axis=0)
        mixed = 2 * (t.mixed + t.mixed.mT)[:half]
        by_states = 2 * (t.by_here + t.by_there)[:half]
        return cls(2 * t.direct[:half], by_states, 2 * t.R[:, :half].transpose(1, 0, 2), level, mixed)

    def __call__(self, phases: Phases) -> Float[Array, "*waves dim dim"]:
        direct, left, state = _sums(self, phases)
        inner = self.level + jnp.einsum("...h,hrs->...rs", phases.even, self.mixed)  # cos k·ξ = 1 + Re q
        coupled = left @ state
        return -(direct + coupled + coupled.mT + state.mT @ inner @ state)

    components = _components


Tangent = StateTangent | DenseTangent | TwoStageTangent


@singledispatch
def tangent_kind(model: AbstractModel) -> type[Tangent]:
    """The class of the tangent of a model. Each kind of model registers its own function."""
    return DenseTangent


@tangent_kind.register(PointStateModel)
def _of_states(model: PointStateModel) -> type[Tangent]:
    return StateTangent if model.even else DenseTangent


@tangent_kind.register(TwoStageModel)
def _of_both_ends(model: TwoStageModel) -> type[Tangent]:
    return TwoStageTangent


def homogeneous_tangent(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> Tangent:
    """Linearise a model at x = F X. The result is a function of `Phases` that gives Ĵ."""
    if model.needs_other_end and not model.even:
        raise ValueError(
            f"{type(model).__name__} needs the states of both ends of a bond, and its states are not even (ξ → −ξ), so"
            " one family does not give its symbol. Compute it with pdjax.cell_symbol for a cell of one point"
        )
    of: Callable[..., Tangent] = tangent_kind(model).of
    return of(model, family, F)


@singledispatch
def block_at_center(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """`pdjax.center_block` without checks: ∂f(X)/∂x(X) on an infinite lattice under x = F X.

    Each kind of model registers its own function. Compiled functions trace it.
    """
    bonds = family.bonds(F)
    C = family_tangent(model, bonds)
    own = jnp.einsum("b,bicj->ij", bonds.volume, C)
    return -own - jnp.einsum("b,bibj->ij", bonds.volume, C)


@block_at_center.register(PointStateModel)
def _block_of_states(model: PointStateModel, family: LatticeFamily, F: Array) -> Float[Array, "dim dim"]:
    """The same sums, without the array C."""
    bonds = family.bonds(F)
    t = linearise_states(model, bonds)
    far = jnp.einsum("b,bir,rbj->ij", bonds.volume, t.G + t.there, t.R)
    own = jnp.einsum("b,bir->ir", bonds.volume, t.G + t.there) @ t.R.sum(axis=1)
    return -2 * jnp.einsum("b,bij->ij", bonds.volume, t.B) - own - far


@block_at_center.register(TwoStageModel)
def _block_of_both_ends(model: TwoStageModel, family: LatticeFamily, F: Array) -> Float[Array, "dim dim"]:
    """The mean of the symbol over a grid of waves. It is exact because no harmonic is higher than 3N."""
    waves = np.stack(np.meshgrid(*[np.arange(3 * family.reach + 1)] * family.dim, indexing="ij"), axis=-1)
    k = jnp.asarray(2 * np.pi / len(waves) * waves.reshape(-1, family.dim), dtype=family.xi.dtype) / family.spacing
    return jnp.mean(TwoStageTangent.of(model, family, F)(wave_phases(family, k)), axis=0)


@eqx.filter_jit
def modulus_at_rest(model: AbstractModel, family: LatticeFamily) -> Float[Array, ""]:
    """`pdjax.p_wave_modulus` without checks: M = ∂P₁₁/∂F₁₁ [pressure] at F = I. Compiled functions trace it."""
    I = jnp.eye(family.dim, dtype=family.xi.dtype)
    axial = jnp.zeros_like(I).at[0, 0].set(1)
    return jax.jvp(lambda F: affine_stress(model, family, F), (I,), (axial,))[1][0, 0]
