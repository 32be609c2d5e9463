"""What every user computes by hand: weighted volume, dilatation, energy density and stress at every point of a body.

    m = Σ ω V |ξ|²,    θ = (d/m) Σ ω V |ξ| (|ξ + η| − |ξ|),    P = Σ V T⊗ξ,    σ = P F̄ᵀ/det F̄

Sums run over the point's family, with the bonds' weights in ω. A point without bonds has 0 of all but of the weighted
volume's kind; its F̄ is I. Sources: Silling et al. 2007 (m, θ, F̄).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._internal.checks import as_real
from .._internal.public import public_function
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..models.kinematics import displacement_gradient, stretch_minus_one
from ..models.pointwise import none_if_empty, regular
from .fields import body_state, energy_of_each, force_states, mean_deformation, plain_exchange, point_field


@eqx.filter_jit
def _weighted_volume(families: Families) -> Array:
    volume = families.volumes[families.neighbours]
    return jnp.sum(families.influence * families.weight * volume * jnp.sum(families.xi**2, axis=-1), axis=1)


@public_function
def weighted_volume(families: Families) -> Float[Array, " points"]:
    """m (points,) [length^(dim+2)] of every family: Σ ω V |ξ|²."""
    families.need_arrays()
    return _weighted_volume(families)


@eqx.filter_jit
def _dilatation(families: Families, u: Array, F: Array | None) -> Array:
    bonds, empty = regular(families.bonds(u, F))
    w = bonds.omega * bonds.volume * jnp.sum(bonds.xi**2, axis=-1)
    strain = stretch_minus_one(bonds.xi, bonds.eta)
    return none_if_empty(families.dim * jnp.sum(w * strain, axis=1) / jnp.sum(w, axis=1), empty)


@public_function
def dilatation(families: Families, u, F=None) -> Float[Array, " points"]:
    """θ (points,) [-] of every family, as the LPS model has it.

    Arguments: u (points, dim) [length]; F (dim, dim) a mean deformation under it, or None.
    """
    families.need_arrays()
    return _dilatation(families, point_field(u, families), mean_deformation(F, families))


@public_function
def energy_density(model: AbstractModel, families: Families, u, F=None) -> Float[Array, " points"]:
    """W (points,) [energy/length^dim] of every point; Σ V W is `strain_energy`.

    Arguments, errors: as `force_density`. A point whose family is too poor for the model, seen under a transformation,
    where nothing can be refused, has NaN: `jnp.isnan` of this finds it.
    """
    return energy_of_each(model, families, *body_state(model, families, u, F))


@eqx.filter_jit
def _cauchy(model: AbstractModel, families: Families, u: Array, F: Array | None) -> Array:
    bonds = families.bonds(u, F)
    T = force_states(model, families.volumes, bonds, plain_exchange(families))
    P = jnp.einsum("pb,pbi,pbj->pij", bonds.volume, T, bonds.xi)
    bonds, empty = regular(bonds)
    G = jnp.eye(families.dim, dtype=P.dtype) + eqx.filter_vmap(displacement_gradient)(bonds)
    return none_if_empty(P @ G.mT / jnp.linalg.det(G)[:, None, None], empty)


@public_function
def cauchy_stress(model: AbstractModel, families: Families, u, F=None) -> Float[Array, "points dim dim"]:
    """σ (points, dim, dim) [pressure] of every point, from the forces of its bonds and F̄.

    Arguments, errors: as `force_density`. Exact under affine maps for every model whose energy is the law's; its
    antisymmetric part elsewhere is what the bonds' moments leave. NaN where a family does not span space.
    """
    return _cauchy(model, families, *body_state(model, families, u, F))


@public_function
def von_mises(stress, out_of_plane=0.0) -> Float[Array, "..."]:
    """The von Mises stress √(3/2 s:s) [pressure], s the deviator of the symmetric part.

    Arguments: stress (..., dim, dim) [pressure]; out_of_plane (...) [pressure] σ₃₃ of a 2D body (0: plane stress; in
        plane strain ν (σ₁₁ + σ₂₂)), and of both directions across a 1D body. Not used in 3D.
    """
    return _von_mises(as_real(stress, "stress"), as_real(out_of_plane, "out_of_plane"))


@eqx.filter_jit
def _von_mises(stress: Array, across: Array) -> Array:
    dim = stress.shape[-1]
    if stress.ndim < 2 or stress.shape[-2] != dim or dim not in (1, 2, 3):
        raise ValueError(f"stress must have shape (..., dim, dim) with dim 1, 2 or 3; got {stress.shape}")
    whole = jnp.zeros((*stress.shape[:-2], 3, 3), stress.dtype).at[..., :dim, :dim].set((stress + stress.mT) / 2)
    for k in range(dim, 3):
        whole = whole.at[..., k, k].set(across)
    deviator = whole - jnp.trace(whole, axis1=-2, axis2=-1)[..., None, None] * jnp.eye(3) / 3
    square = 1.5 * jnp.sum(deviator**2, axis=(-2, -1))
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
