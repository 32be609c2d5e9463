"""Dispersion relation: the frequencies of plane waves on the deformed infinite lattice.

A plane wave u = e exp(ik·X) of wave vector k is a mode of the lattice if e is an eigenvector of the symbol Ĵ(k):

    Ĵ(k) e = λ e,   ω² = −λ/ρ                  (λ < 0: frequency ω; λ > 0: growth rate √(λ/ρ))
    ∂ω/∂k = −eᵀ (∂Ĵ/∂k) e / (2ρω)              (group velocity)

The classical law behind the model has ω² = |k|² eig Q(n)/ρ, with the acoustic tensor Q of ψ(F) in the direction n of k
(`classical_frequency`). A zero-energy mode is a wave with k ≠ 0 whose λ is zero to rounding in comparison with M κ²,
where M is the P-wave modulus and κ² = Σ_i ((2/h) sin(k_i h/2))².
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._internal.checks import Numbers, as_real, deformation_gradient, is_concrete, namespace, on_device
from .._internal.public import public_function
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .bloch import homogeneous_tangent, laplacian, modulus_at_rest, wave_phases
from .cosine_series import symbol_slopes, symbols
from .criteria.outcome import margin_tolerance
from .lattice_states import checked_states, has_series, wave_vectors


class Dispersion(eqx.Module):
    """Frequencies and modes of plane waves, the result of `dispersion`.

    Every wave vector has dim branches. They are ordered from the slowest (largest λ) to the fastest.

    Attributes
    ----------
    k : array, shape (waves, dim)
        Wave vectors [1/length].
    eigenvalue : array, shape (waves, dim)
        Eigenvalues λ of the symbol [force/length^(dim+1)].
    frequency : array, shape (waves, dim)
        Angular frequency ω [1/time], 0 for a growing mode.
    growth : array, shape (waves, dim)
        Growth rate √(λ/ρ) [1/time], 0 for a mode that oscillates.
    mode : array, shape (waves, dim, dim)
        Polarisations: mode[w, :, b] is the unit vector of branch b of wave w.
    group_velocity : array, shape (waves, dim, dim)
        Group velocity ∂ω/∂k [length/time]. The axes are wave, branch, component: group_velocity[w, b, :] is the vector
        of branch b of wave w. In `mode` the branch is the last axis. The velocity is NaN where ω = 0, because at k = 0
        it depends on the direction. It is arbitrary where two branches have the same eigenvalue.
    zero_energy : array of bool, shape (waves, dim)
        True for a zero-energy mode: λ = 0 to rounding at k ≠ 0.

    Examples
    --------
    The deformation gradient of the correspondence model with N = 1 does not change in the wave k = π/h.

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> waves = pd.dispersion(model, pd.lattice_family(1, 1), np.eye(1), [np.pi / 2, np.pi])
    >>> waves.zero_energy[:, 0].tolist()
    [False, True]
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


def _branches(
    k: Numbers, J: Numbers, slope: Numbers, scale: Numbers, density: Numbers, tolerance: Array | np.floating
) -> tuple:
    """The fields of `Dispersion` from Ĵ, ∂Ĵ/∂k and scale = M κ². |λ| ≤ tolerance · scale counts as zero."""
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
    """`_dispersion` of concrete values. Only the linearisation is a JAX program, the rest is NumPy."""
    states = checked_states(model, family, F[None])
    h, blocks = states.spacing, states.blocks[0]
    J, slope = (f(blocks, states.offsets, h * k) for f in (symbols, symbol_slopes))
    kappa2 = laplacian(h * k) / h**2
    tolerance = margin_tolerance(family.xi.dtype)  # k and the constants have this precision.
    *found, zero = _branches(k, J, h * slope, states.modulus * kappa2, density, tolerance)
    return Dispersion(*on_device((*(np.ascontiguousarray(x, family.xi.dtype) for x in found), zero)))


def checked_density(density, dtype) -> Numbers:
    """The density as an array. ValueError is raised for a concrete value that is not one finite number > 0."""
    density = namespace(density).asarray(density, dtype)
    if is_concrete(density) and not (density.shape == () and np.isfinite(density) and density > 0):
        raise ValueError(f"density must be one finite number > 0; got {density}")
    return density


@public_function
def dispersion(model: AbstractModel, family: LatticeFamily, F, k, density=1.0) -> Dispersion:
    """Compute the frequencies of plane waves on the infinite lattice deformed by x = F X.

    Ĵ(k) e = λ e,   ω² = −λ/ρ

    Parameters
    ----------
    model : AbstractModel
        A material model that has an energy.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.
    k : array, shape (waves, dim)
        Wave vectors [1/length]. In 1D the shape (waves,) is accepted too.
    density : float, optional
        Mass density ρ > 0 [mass/length^dim].

    Returns
    -------
    Dispersion
        Eigenvalues, frequencies, growth rates, modes and group velocities of every wave.

    Raises
    ------
    ValueError
        If the model has no energy, if det F ≤ 0, if `k` has another shape or is not finite, if `density` is not a
        finite number > 0, or if the family is too small for the model.

    Examples
    --------
    With N = 1 and lam + 2 mu = 1 the correspondence model has ω = |sin kh|/h in 1D.

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> waves = pd.dispersion(model, pd.lattice_family(1, 1), np.eye(1), [0.1, np.pi / 2])
    >>> np.asarray(waves.frequency[:, 0]).round(4).tolist(), round(float(np.sin(0.1)), 4)
    ([0.0998, 1.0], 0.0998)
    """
    check_model(model, family, LatticeFamily)
    if not model.hyperelastic:
        raise ValueError(
            f"dispersion needs a model with an energy, whose symbol is symmetric; {type(model).__name__} has no energy."
            " Use pdjax.symbol and the eigenvalues of its result"
        )
    F = deformation_gradient(F, family.dim)
    k, density = wave_vectors(k, family.dim, F.dtype, listed=True), checked_density(density, F.dtype)
    if is_concrete(model, family, F, k, density) and has_series(model):
        return _from_series(model, family, np.asarray(F), k, density)
    return _dispersion(model, family, F, k, density)


@eqx.filter_jit
def _classical(model: AbstractModel, F: Array, k: Numbers, density: Numbers) -> Array:
    moduli = jax.hessian(model.local_energy)(F)
    square = jnp.linalg.eigvalsh(jnp.einsum("iJkL,wJ,wL->wik", moduli, k, k)) / density
    return jnp.where(square >= 0, jnp.sqrt(jnp.where(square > 0, square, 0.0)), jnp.nan)


@public_function
def classical_frequency(model: AbstractModel, F, k, density=1.0) -> Float[Array, "waves dim"]:
    """Compute the frequencies of plane waves in the classical material law behind a model.

    ω² = |k|² eig Q(n)/ρ, with Q the acoustic tensor of ψ(F) in the direction n = k/|k|

    Parameters
    ----------
    model : AbstractModel
        A material model that has a classical law.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0. In 1D a number is accepted too.
    k : array, shape (waves, dim)
        Wave vectors [1/length]. In 1D the shape (waves,) is accepted too.
    density : float, optional
        Mass density ρ > 0 [mass/length^dim].

    Returns
    -------
    array, shape (waves, dim)
        Angular frequencies ω [1/time], slowest first. They are proportional to |k|. They are NaN where the law itself
        is unstable.

    Raises
    ------
    ValueError
        If the model has no classical law, or if `F`, `k` or `density` is not valid.

    Examples
    --------
    In 1D at rest ω = k √((λ + 2μ)/ρ), here 0.5 × √4.

    >>> model = pd.Correspondence(pd.LinearElastic(lam=2.0, mu=1.0))
    >>> np.asarray(pd.classical_frequency(model, 1.0, [0.5])).round(6).tolist()
    [[1.0]]
    """
    F = as_real(F)
    F = F.reshape(1, 1) if F.ndim == 0 else F
    F = deformation_gradient(F, F.shape[0])
    return _classical(model, F, wave_vectors(k, F.shape[0], F.dtype, listed=True), checked_density(density, F.dtype))
