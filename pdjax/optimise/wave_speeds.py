"""Errors of wave speeds: how far the waves of a lattice are from those of the classical law behind the model.

A lattice wave of wave vector k = k n has the frequencies ω² = −eig Ĵ(k)/ρ. The classical law has ω² = k² eig Q(n)/ρ,
with the acoustic tensor Q of ψ(F). Both sets are ordered from the slowest to the fastest branch, and branch b of one is
compared with branch b of the other. The density cancels. With the ratio r_b = ω_b²/(classical ω_b²),

    phase speed   error = |√r_b − 1|
    group speed   error = |n·∂ω_b/∂k / (classical speed) − 1|

A wave that grows (r_b < 0) has no phase speed. Its error is 1 − r_b, so that an optimiser sees which way to go.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_array, choice, deformation_gradient, differentiated_in_double, in_double, is_concrete
from .._internal.public import public_function
from ..force.fields import affine_stress, check_model
from ..geometry.bonds import LatticeFamily
from ..infinite_lattice.bloch import homogeneous_tangent, long_wave_phases, wave_phases
from ..infinite_lattice.brillouin import directions, is_judging
from ..models.base import AbstractModel
from .margins import check_sharpness, log_trace

RADII = 8  # wave numbers up to kh along every direction
SPEEDS = ("phase", "group")
REFERENCES = ("law", "long waves")


@public_function
@differentiated_in_double
@in_double
def dispersion_error(
    model: AbstractModel,
    family: LatticeFamily,
    kh=1.0,
    *,
    F=None,
    speed: str = "phase",
    branches: tuple[int, ...] | int | None = None,
    against: str = "law",
    sharpness: float | None = None,
) -> Float[Array, ""]:
    """Compute the worst relative error of the wave speeds of a lattice against the classical law behind its model.

    max over k h ≤ kh, directions and branches of |c/c₀ − 1|

    Parameters
    ----------
    model : AbstractModel
        A material model with an energy.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    kh : float, optional
        Largest wave number times the spacing [-], > 0 and at most π.
    F : array, shape (dim, dim), optional
        Deformation gradient [-] of the state on which the waves travel. The default is the undeformed state.
    speed : str, optional
        "phase" for ω/|k|, or "group" for n·∂ω/∂k along the direction n of the wave.
    branches : int or tuple of int, optional
        The branches that count, 0 for the slowest. The default is all. In 2D and 3D branch 0 is a shear wave.
    against : str, optional
        "law" for the speeds of the classical law, or "long waves" for the speeds of the lattice itself in the limit
        k → 0, for models without a classical law.
    sharpness : float, optional
        Sharpness s > 0 [-] of the Kreisselmeier–Steinhauser aggregate, which is smooth and replaces the maximum.

    Returns
    -------
    array, shape ()
        The worst relative error [-]. It is NaN where the law, or the limit of long waves, is itself unstable.

    Raises
    ------
    ValueError
        If the model has no energy, if it has no classical law and `against` is "law", if kh does not lie in (0, π], if
        det F ≤ 0, if `speed` or `against` is unknown, if `branches` names a branch that does not exist, or if the
        sharpness is not > 0.

    Notes
    -----
    The error is sampled at 8 wave numbers up to kh along 1 direction in 1D, 48 in 2D and 193 in 3D. First derivatives
    in the model, the family and F are exact at the worst sample. In float32 they are computed in float64, except inside
    `jit` and `vmap`.

    Examples
    --------
    With N = 1 the 1D correspondence model has ω = |sin kh|/h, so at kh = 1 its waves are 16 % too slow.

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> error = pd.dispersion_error(model, pd.lattice_family(1, 1), kh=1.0)
    >>> round(float(error), 4), round(float(1 - np.sin(1.0)), 4)
    (0.1585, 0.1585)
    """
    check_model(model, family, LatticeFamily)
    if not model.hyperelastic:
        raise ValueError(
            f"dispersion_error needs a model with an energy; this {type(model).__name__}, or its control, has none"
        )
    if is_concrete(kh) and not 0 < kh <= math.pi:
        raise ValueError(f"kh must lie in (0, π]; got {kh}")
    choice("speed", speed, SPEEDS)
    choice("against", against, REFERENCES)
    chosen = tuple(range(family.dim)) if branches is None else tuple(np.atleast_1d(branches).tolist())
    if not chosen or not set(chosen) <= set(range(family.dim)):
        raise ValueError(f"branches must be some of 0 to {family.dim - 1} in dimension {family.dim}; got {branches}")
    real = family.xi.dtype
    F = np.eye(family.dim, dtype=real) if F is None else deformation_gradient(F, family.dim)
    if sharpness is not None:
        check_sharpness(sharpness)
    limit = None if sharpness is None or is_judging() else as_array(sharpness, real)
    return _worst(
        model,
        family,
        F,
        as_array(kh, real),
        limit,
        speed == "group",
        chosen,
        against == "law",
        RADII * (1 + is_judging()),
    )


def _eigen(A: Float[Array, "*waves dim dim"]) -> tuple[Array, Array]:
    """Eigenvalues and eigenvectors of symmetric matrices, with first derivatives that are finite at repeated ones.

    dλ_i = v_i·dA v_i and dv_i = Σ_j v_j (v_j·dA v_i)/(λ_i − λ_j). Terms of equal eigenvalues are left out. They mix the
    vectors of one eigenspace, which have no order.
    """
    fixed = jax.lax.stop_gradient(A)
    values, vectors = jax.lax.stop_gradient(jnp.linalg.eigh(fixed))
    change = jnp.einsum("...ib,...ij,...jc->...bc", vectors, A - fixed, vectors)
    gap = values[..., None, :] - values[..., :, None]
    size = jnp.max(jnp.abs(values), axis=-1)[..., None, None]
    apart = jnp.abs(gap) > 1e-9 * size
    turn = jnp.where(apart, change / jnp.where(apart, gap, 1.0), 0.0)
    return values + jnp.diagonal(change, axis1=-2, axis2=-1), vectors + vectors @ turn


@eqx.filter_jit
def _worst(model, family, F, kh, sharpness, group: bool, branches: tuple[int, ...], law: bool, count: int) -> Array:
    dim, real = family.dim, family.xi.dtype
    compass = jnp.asarray(directions(dim), real)
    radii = kh / family.spacing * jnp.arange(1, count + 1, dtype=real) / count
    tangent = homogeneous_tangent(model, family, F)
    if law:
        acoustic = jnp.einsum("iJkL,wJ,wL->wik", jax.hessian(model.local_energy)(F), compass, compass)
    else:
        acoustic = -tangent(long_wave_phases(family, compass)) * family.spacing**2
    slow, _ = _eigen(acoustic)  # ρ c₀² of every direction and branch

    def stiffness(k, n):
        """−Ĵ(k n)/k²."""
        return -tangent(wave_phases(family, k * n)) / k**2

    def ratios(k, n, slow):
        if not group:
            values, _ = _eigen(stiffness(k, n))
            r = values / slow
            return jnp.where(r > 0, jnp.sqrt(jnp.where(r > 0, r, 1.0)), r)
        A, dA = jax.jvp(lambda q: stiffness(q, n), (k,), (jnp.ones_like(k),))
        values, vectors = _eigen(A)
        r = values / slow
        c = jnp.where(r > 0, jnp.sqrt(jnp.where(r > 0, r, 1.0)), 1.0)
        slope = jnp.einsum("ib,ij,jb->b", vectors, dA, vectors) / slow
        return jnp.where(r > 0, c + k * slope / (2 * c), r)  # ω = k c, so ∂ω/∂k = c + k ∂c/∂k

    over_radii = jax.vmap(ratios, (0, None, None))
    found = jax.vmap(over_radii, (None, 0, 0))(radii, compass, slow)[..., list(branches)]
    errors = jnp.where(slow[:, None, list(branches)] > 0, jnp.abs(found - 1), jnp.nan)
    return jnp.max(errors) if sharpness is None else log_trace(errors.reshape(-1, 1, 1), sharpness)


@public_function
@differentiated_in_double
@in_double
def moduli_error(model: AbstractModel, family: LatticeFamily) -> Float[Array, ""]:
    """Compute how far the small-strain moduli of a lattice are from those of the classical law behind its model.

    ‖ℂ_lattice − ℂ_law‖/‖ℂ_law‖,   ℂ = ∂P/∂F at F = I

    Parameters
    ----------
    model : AbstractModel
        A material model with a classical law.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.

    Returns
    -------
    array, shape ()
        Relative error [-] in the Frobenius norm of all dim⁴ moduli.

    Raises
    ------
    ValueError
        If the model has no classical law, or for what `check_model` refuses.

    Examples
    --------
    Springs on a square lattice with N = 2 are not isotropic. A correspondence model has the moduli of its law.

    >>> family, law = pd.lattice_family(2, 2), pd.LinearElastic(1.0, 1.0)
    >>> bool(pd.moduli_error(pd.Correspondence(law), family) < 1e-12)
    True
    >>> round(float(pd.moduli_error(pd.TupekRadovitzky(1.0, law), family)), 3)
    0.39
    """
    check_model(model, family, LatticeFamily)
    return _moduli_error(model, family)


@eqx.filter_jit
def _moduli_error(model: AbstractModel, family: LatticeFamily) -> Array:
    I = jnp.eye(family.dim, dtype=family.xi.dtype)
    here = jax.jacfwd(lambda F: affine_stress(model, family, F))(I)
    law = jax.hessian(model.local_energy)(I)
    square = jnp.sum((here - law) ** 2)
    size = jnp.sqrt(jnp.where(square > 0, square, 1.0))  # The derivative of the norm at 0 is set to 0.
    return jnp.where(square > 0, size, 0.0) / jnp.sqrt(jnp.sum(law**2))
