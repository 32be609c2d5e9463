"""Homogeneous states of an infinite lattice, linearised: one small program for each model class, numbers ever after.

A state is a deformation gradient F. `linearised` gives its cosine series (`pdjax.infinite_lattice.cosine_series`) and the P-wave modulus
of the model. That is all that the symbol, the block at a point, and the search of the Brillouin zone have to know, so
they are NumPy here, and the search is one program for all models (`pdjax.infinite_lattice.criteria.waves.search`).

The program takes STATES deformations at once and the resting state beside them. What has been linearised is remembered
with the family. It computes in double precision, also for a family of single precision, so that a verdict does not
depend on units.
"""

import itertools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_array, computed_in_double, deformation_gradient, is_concrete, on_device, require
from .._internal.memory import remember, value_key
from .._internal.public import public_function
from .._internal.xla import ONCE, compiled_with
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .bloch import (
    DenseTangent,
    StateTangent,
    block_at_center,
    homogeneous_tangent,
    modulus_at_rest,
    tangent_kind,
    wave_phases,
)
from .cosine_series import reached, series, series_of_state, symbols

STATES = 16


class States(NamedTuple):
    """blocks (states, offsets, dim, dim) [force/length^(dim+1)] of the cosine series, half of the offsets they stand
    for (offsets, dim), M [pressure] (of all, or one for each state), spacing [length]; all NumPy."""

    blocks: np.ndarray
    offsets: np.ndarray
    modulus: Any
    spacing: float

    @property
    def scaled(self) -> np.ndarray:
        """The blocks in units of M/h²."""
        return self.blocks * np.reshape(self.spacing**2 / self.modulus, (-1, 1, 1, 1))


def rings(model: AbstractModel) -> int:
    """How many rings of neighbours the blocks of a model's series reach."""
    return tangent_kind(model).rings


def offsets_of(model: AbstractModel, family: LatticeFamily) -> np.ndarray:
    """Half of the offsets (offsets, dim) that the blocks of a model's series stand for."""
    return reached(family.dim, len(family.influence), rings(model))


def modulus_of(resting: np.ndarray, offsets: np.ndarray, spacing: float) -> Any:
    """M [pressure] (...,) from the blocks (..., offsets, dim, dim) of resting states: minus Ĵ₁₁/k² of long waves."""
    return resting[..., 0, 0] @ offsets[:, 0] ** 2 * spacing**2


@compiled_with(ONCE)
def _linearise(model: AbstractModel, family: LatticeFamily, F: Float[Array, "states dim dim"], count: Array) -> Any:
    """Of the first `count` deformations: the tangents of a point-state model, or the series of any other."""
    dim, bonds = family.dim, len(family.influence)

    def one(F):
        return series(homogeneous_tangent(model, family, F), dim, bonds)

    kind = tangent_kind(model)
    if kind is StateTangent:
        return jax.vmap(lambda F: homogeneous_tangent(model, family, F))(F)
    if kind is not DenseTangent:
        return jax.vmap(one)(F)
    # A dense tangent takes long and much memory: one after the other, and no more than are asked for.
    blank = jnp.zeros((len(F), len(reached(dim, bonds, 2)), dim, dim), F.dtype)
    return jax.lax.fori_loop(0, count, lambda i, out: out.at[i].set(one(F[i])), blank)


def linearised(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> States:
    """The states F (states, dim, dim) of a concrete model on a concrete, checked family; up to STATES at once."""
    dim, count = family.dim, len(F)
    every = np.broadcast_to(np.eye(dim), (STATES + 1, dim, dim)).copy()  # the first stays the resting one
    every[1 : count + 1] = F

    def make():
        out = computed_in_double(_linearise, model, family, every, np.asarray(count + 1))
        if isinstance(out, StateTangent):
            each = zip(out.b, out.g, out.r, strict=True)
            out = np.stack([series_of_state(*parts) for parts in itertools.islice(each, count + 1)])
        offsets, h = offsets_of(model, family), float(family.spacing)
        return States(out[1 : count + 1], offsets, float(modulus_of(out[0], offsets, h)), h)

    return remember(family, ("linearised", value_key(model), every.tobytes(), count), make)


def has_series(model: AbstractModel) -> bool:
    """Whether one family is enough for the symbol of a model: not where states of both ends are needed and not even."""
    return model.even or not model.needs_other_end


def resting_modulus(model: AbstractModel, family: LatticeFamily) -> float:
    """M [pressure] of a concrete model on a concrete, checked family."""

    def make():
        if has_series(model):
            return linearised(model, family, np.zeros((0, family.dim, family.dim))).modulus
        return float(computed_in_double(modulus_at_rest, model, family))

    return remember(family, ("modulus", value_key(model)), make)


def check_at_rest(model: AbstractModel, family: LatticeFamily) -> None:
    """Refuse a singular family, and a model whose P-wave modulus is not positive: every margin is divided by it."""
    check_model(model, family, LatticeFamily)
    if is_concrete(model, family):
        check_modulus(model, resting_modulus(model, family))


def check_modulus(model: AbstractModel, M: float) -> None:
    """Refuse a P-wave modulus that is NaN or not positive."""
    if np.isnan(M):
        raise ValueError(
            f"{type(model).__name__} has no stiffness at rest that is a number: its P-wave modulus there is nan. Is"
            " every constant finite? Does the energy take a norm or a power of bonds.eta, which is 0 at rest (eta ="
            " u_j − u_i; the deformed bond is xi + eta)?"
        )
    if not M > 0:
        raise ValueError(
            f"law must have a positive P-wave modulus (lam + 2 mu) at rest; this one has {M:g}:"
            " it is unstable before any load"
        )


def checked_states(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> States:
    """`linearised`, after the checks of the family and of the modulus: no program beside its own."""
    check_model(model, family, LatticeFamily)
    states = linearised(model, family, F)
    remember(family, ("modulus", value_key(model)), lambda: states.modulus)
    check_modulus(model, states.modulus)
    return states


@public_function
def symbol(model: AbstractModel, family: LatticeFamily, F, k) -> Float[Array, "*waves dim dim"]:
    """Ĵ(k), the exact Jacobian of the infinite lattice on the plane wave e^{ik·X}.

    Arguments: F (dim, dim) [-], det F > 0; k (..., dim) [1/length], any number of wave vectors.
    Returns: (..., dim, dim) real [force/length^(dim+1)]; symmetric for hyperelastic models, zero at k = 0.
    Raises: ValueError for det F ≤ 0, NaN in k, a k of the wrong dimension, a singular family.
    """
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    k = _wave_vectors(k, family.dim, F.dtype)
    if is_concrete(model, family, F, k):
        states = linearised(model, family, np.asarray(F)[None])
        return on_device(symbols(states.blocks[0], states.offsets, k * states.spacing))
    return _symbol(model, family, F, k)


def _wave_vectors(k: Any, dim: int, dtype: Any) -> Any:
    k = jnp.asarray(k, dtype=dtype) if not is_concrete(k) else np.asarray(k, dtype=dtype)
    if k.ndim == 0 or k.shape[-1] != dim:
        raise ValueError(f"k must have shape (..., {dim}) for this family; got {k.shape}")
    if is_concrete(k):
        if not np.isfinite(k).all():
            raise ValueError("k must be finite")
        return k
    return require(k, jnp.isfinite(k), "k must be finite")


@eqx.filter_jit
def _symbol(model: AbstractModel, family: LatticeFamily, F: Array, k: Array) -> Array:
    return homogeneous_tangent(model, family, F)(wave_phases(family, k))


@public_function
def center_block(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "dim dim"]:
    """D = ∂f(X)/∂x(X): the Jacobian's block at the point itself, on an infinite lattice under x = F X.

    D = Σ_ξ V [−(Σ_ζ C_ξζ) − C_ξξ]: its own bonds all move by −e, and in each neighbour's family one bond moves by +e.
    It is the mean of the symbol over the Brillouin zone, −2 Σ B of its cosine series.
    Arguments: F (dim, dim).  Returns: (dim, dim) [force/length^(dim+1)].  Raises: as `force_state`.
    """
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    if is_concrete(model, family, F) and has_series(model):
        return on_device(-2 * linearised(model, family, np.asarray(F)[None]).blocks[0].sum(axis=0))
    return _center_block(model, family, F)


@eqx.filter_jit
def _center_block(model: AbstractModel, family: LatticeFamily, F: Array) -> Array:
    return block_at_center(model, family, F)


@public_function
def p_wave_modulus(model: AbstractModel, family: LatticeFamily) -> Float[Array, ""]:
    """M = ∂P₁₁/∂F₁₁ at F = I [pressure]: the law's λ + 2μ, as the model on this family has it."""
    check_model(model, family, LatticeFamily)
    if is_concrete(model, family):
        return as_array(resting_modulus(model, family), family.xi.dtype)
    return modulus_at_rest(model, family)
