"""Dispersion: the frequencies of plane waves on the deformed infinite lattice, from its symbol.

    Ĵ(k) e = λ e,   ω² = −λ/ρ:   λ < 0 a wave of frequency ω, λ > 0 a mode that grows at √(λ/ρ)
    ∂ω/∂k = −eᵀ (∂Ĵ/∂k) e / (2ρω)                               (group velocity)

The classical line is that of the law itself, ω² = |k|² eig Q(n)/ρ with the acoustic tensor Q of ψ(F):
`classical_frequency`. A zero-energy mode is a wave, k ≠ 0, whose λ vanishes to rounding beside the law's M κ².
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._internal.checks import as_real, deformation_gradient, is_concrete, namespace, on_device, require
from .._internal.public import public_function
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .bloch import homogeneous_tangent, modulus_at_rest, wave_phases
from .cosine_series import symbol_slopes, symbols
from .criteria.outcome import margin_tolerance
from .lattice_states import checked_states, has_series


class Dispersion(eqx.Module):
    """The answer of `dispersion`; branches run from the slowest (largest λ) to the fastest.

    k (waves, dim) [1/length]; eigenvalue λ (waves, dim); frequency ω and growth (waves, dim) [1/time], one of them 0;
    mode (waves, dim, dim): mode[w, :, b] is the unit polarisation of branch b; group_velocity (waves, dim branches,
    dim) [length/time], NaN where ω = 0 (at k = 0 it depends on the direction) and arbitrary between equal branches;
    zero_energy (waves, dim): λ = 0 to rounding at k ≠ 0.
    """

    k: Float[Array, "waves dim"]
    eigenvalue: Float[Array, "waves dim"]
    frequency: Float[Array, "waves dim"]
    growth: Float[Array, "waves dim"]
    mode: Float[Array, "waves dim dim"]
    group_velocity: Float[Array, "waves dim dim"]
    zero_energy: Bool[Array, "waves dim"]


@eqx.filter_jit
def _dispersion(model: AbstractModel, family: LatticeFamily, F: Array, k: Array, density: Array) -> Dispersion:
    tangent = homogeneous_tangent(model, family, F)

    def one(k):
        return tangent(wave_phases(family, k))

    J, slope = jax.vmap(one)(k), jax.vmap(jax.jacfwd(one))(k)  # (waves, dim, dim), (waves, dim, dim, dim of k)
    scale = modulus_at_rest(model, family) * wave_phases(family, k).kappa2
    return Dispersion(*_branches(k, J, slope, scale, density, margin_tolerance(J.dtype)))


def _branches(k: Any, J: Any, slope: Any, scale: Any, density: Any, tolerance: Any) -> tuple:
    """The fields of `Dispersion` from Ĵ, ∂Ĵ/∂k and M κ², which is 0 at k = 0; `tolerance` beside M κ² counts as 0."""
    xp = namespace(J, density)
    value, mode = xp.linalg.eigh((J + J.mT) / 2)
    value, mode = value[:, ::-1], mode[:, :, ::-1]
    zero_mode = abs(value) <= tolerance * scale[:, None]
    square = xp.where(zero_mode, 0.0, -value / density)

    def root(x):
        return xp.where(x > 0, xp.sqrt(xp.where(x > 0, x, 1.0)), 0.0)

    frequency = root(square)
    slope = xp.einsum("wib,wijc,wjb->wbc", mode, slope, mode)
    moves = (frequency > 0) & ~zero_mode
    group = -slope / (2 * density * xp.where(moves, frequency, xp.nan))[..., None]
    return k, value, frequency, root(-square), mode, group, zero_mode & (scale[:, None] > 0)


def _from_series(
    model: AbstractModel, family: LatticeFamily, F: np.ndarray, k: np.ndarray, density: np.ndarray
) -> Dispersion:
    """`_dispersion` of values that are known, in NumPy but for the linearisation."""
    states = checked_states(model, family, F[None])
    h, blocks = states.spacing, states.blocks[0]
    J, slope = (f(blocks, states.offsets, h * k) for f in (symbols, symbol_slopes))
    kappa2 = np.sum((2 / h * np.sin(k * h / 2)) ** 2, axis=-1)
    tolerance = margin_tolerance(family.xi.dtype)  # of the precision that k and the constants were given in
    *found, zero = _branches(k, J, h * slope, states.modulus * kappa2, density, tolerance)
    return Dispersion(*on_device((*(np.ascontiguousarray(x, family.xi.dtype) for x in found), zero)))  # type: ignore[call-arg]


def _waves(k, dim: int, dtype) -> Any:
    k = namespace(k).asarray(k, dtype)
    k = k[:, None] if k.ndim == 1 and dim == 1 else k
    if k.ndim != 2 or k.shape[1] != dim:
        raise ValueError(f"k must have shape (waves, {dim}) for this family; got {k.shape}")
    return require(k, namespace(k).isfinite(k), "k must be finite")


def _positive(density, dtype) -> Any:
    density = namespace(density).asarray(density, dtype)
    if is_concrete(density) and not (density.shape == () and np.isfinite(density) and density > 0):
        raise ValueError(f"density must be one finite number > 0; got {density}")
    return density


@public_function
def dispersion(model: AbstractModel, family: LatticeFamily, F, k, density=1.0) -> Dispersion:
    """Frequencies of plane waves on the infinite lattice deformed by x = F X.

    Arguments: F (dim, dim) [-]; k (waves, dim) [1/length], in 1D (waves,) too; density ρ > 0 [mass/length^dim].
    Returns: `Dispersion`.  Raises: ValueError as `symbol`, for a density ≤ 0, a model without an energy.
    """
    check_model(model, family, LatticeFamily)
    if not model.hyperelastic:
        raise ValueError(f"{type(model).__name__} has no energy: its symbol need not be symmetric; use pdjax.symbol")
    F = deformation_gradient(F, family.dim)
    k, density = _waves(k, family.dim, F.dtype), _positive(density, F.dtype)
    if is_concrete(model, family, F, k, density) and has_series(model):
        return _from_series(model, family, np.asarray(F), k, density)
    return _dispersion(model, family, F, k, density)


@eqx.filter_jit
def _classical(model: AbstractModel, F: Array, k: Array, density: Array) -> Array:
    moduli = jax.hessian(model.local_energy)(F)
    square = jnp.linalg.eigvalsh(jnp.einsum("iJkL,wJ,wL->wik", moduli, k, k)) / density
    return jnp.where(square >= 0, jnp.sqrt(jnp.where(square > 0, square, 0.0)), jnp.nan)


@public_function
def classical_frequency(model: AbstractModel, F, k, density=1.0) -> Float[Array, "waves dim"]:
    """ω (waves, dim) [1/time] of plane waves in the classical law behind a model, slowest first: straight lines in |k|.

    Arguments: as `dispersion`. NaN where the law itself is unstable.  Raises: ValueError for a model without a law.
    """
    F = as_real(F)
    F = F.reshape(1, 1) if F.ndim == 0 else F
    F = deformation_gradient(F, F.shape[0])
    return _classical(model, F, _waves(k, F.shape[0], F.dtype), _positive(density, F.dtype))
