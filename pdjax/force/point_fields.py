"""Weighted volume, dilatation, energy density and Cauchy stress of every point of a body.

    m = Σ ω V |ξ|²                         weighted volume [length^(dim+2)]
    θ = (d/m) Σ ω V |ξ| (|ξ + η| − |ξ|)    dilatation [-], d the dimension
    P = Σ V T⊗ξ                            first Piola–Kirchhoff stress [pressure]
    σ = P F̄ᵀ/det F̄                         Cauchy stress [pressure], F̄ the mean deformation gradient of the family

The sums run over the family of the point, and ω contains the weights of the bonds. All of these fields are 0 at a point
without bonds, and F̄ is I there. Sources: Silling et al. 2007 (m, θ, F̄).
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
    """Compute the weighted volume of every point.

    m_i = Σ_j ω_ij V_j |ξ_ij|²

    Parameters
    ----------
    families : Families
        Families of the body, from `families`.

    Returns
    -------
    array, shape (points,)
        m [length^(dim+2)].

    Raises
    ------
    ValueError
        If the families were made with `arrays=False`.

    References
    ----------
    Silling et al. 2007.

    Examples
    --------
    An end point of a bar of four points has one bond of length 1, an inner point has two.

    >>> families = pd.families(pd.lattice((4,)), horizon=1.0)
    >>> np.asarray(pd.weighted_volume(families)).tolist()
    [1.0, 2.0, 2.0, 1.0]
    """
    families.need_arrays()
    return _weighted_volume(families)


@eqx.filter_jit
def _dilatation(families: Families, u: Array, F: Array | None) -> Array:
    bonds, empty = regular(families.bonds(u, F))
    square = bonds.volume * jnp.sum(bonds.xi**2, axis=-1)
    total = jnp.sum(bonds.omega * square * stretch_minus_one(bonds.xi, bonds.eta), axis=1)
    return none_if_empty(families.dim * total / jnp.sum(bonds.reference * square, axis=1), empty)


@public_function
def dilatation(families: Families, u, F=None) -> Float[Array, " points"]:
    """Compute the dilatation of every point, as the `LPS` model defines it.

    θ_i = (d/m_i) Σ_j ω_ij V_j |ξ| (|ξ + η| − |ξ|)

    m_i is the weighted volume of the intact family, and the sum is over the bonds that have not broken
    (`Families.with_broken`).

    Parameters
    ----------
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    array, shape (points,)
        θ [-]. It is 0 at a point without bonds.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, or the families were made with `arrays=False`.

    References
    ----------
    Silling et al. 2007.

    Examples
    --------
    A plate that grows by 1 % in both directions has the dilatation 2 %.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> theta = pd.dilatation(families, np.zeros((20, 2)), 1.01 * np.eye(2))
    >>> round(float(theta[0]), 6)
    0.02
    """
    families.need_arrays()
    return _dilatation(families, point_field(u, families), mean_deformation(F, families))


@public_function
def energy_density(model: AbstractModel, families: Families, u, F=None) -> Float[Array, " points"]:
    """Compute the energy density of every point.

    `strain_energy` is the sum Σ_i V_i W_i.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    array, shape (points,)
        W [energy/length^dim]. It is 0 at a point without bonds.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, the model cannot invert a shape tensor, or the families
        were made with `arrays=False`.

    Notes
    -----
    Traced families, for example inside `jax.jit`, cannot be checked. A point where the shape tensor is singular then
    has W = NaN, and `jnp.isnan` finds it.

    Examples
    --------
    The strain E₁₁ = 0.105 alone has the energy density W = ½ (λ + 2μ) E₁₁², here with λ + 2μ = 3.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> W = pd.energy_density(model, families, np.zeros((20, 2)), np.diag([1.1, 1.0]))
    >>> W.shape, round(float(W[0]), 6)
    ((20,), 0.016538)
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
    """Compute the Cauchy stress of every point from the forces of its bonds.

    σ = P F̄ᵀ/det F̄,    P = Σ V T⊗ξ

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    array, shape (points, dim, dim)
        σ [pressure]. It is 0 at a point without bonds. It is NaN at a point whose bonds do not span space, because F̄
        does not exist there. An example is a point whose bonds all lie on one line in 2D.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, or the families were made with `arrays=False`. Also if
        the model itself inverts a shape tensor, such as `Correspondence` or `SethHill`, and that of a family is
        singular. Models without a shape tensor, such as `BondBased`, give NaN at such a point instead.

    Notes
    -----
    Under affine maps σ is exact for every model whose energy is that of its law. Under other deformations the bonds can
    exert a net moment on the point, and σ then has an antisymmetric part.

    References
    ----------
    Silling et al. 2007 (F̄).

    Examples
    --------
    A plate with λ + 2μ = 3 is stretched by 10 % with its width held: σ₁₁ = F₁₁ S₁₁ = 1.1 · 3 · 0.105.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> sigma = pd.cauchy_stress(model, families, np.zeros((20, 2)), np.diag([1.1, 1.0]))
    >>> round(float(sigma[0, 0, 0]), 4)
    0.3465
    """
    return _cauchy(model, families, *body_state(model, families, u, F))


@public_function
def von_mises(stress, out_of_plane=0.0) -> Float[Array, "..."]:
    """Compute the von Mises stress.

    σ_vM = √(3/2 s:s), with s the deviator of the symmetric part of the stress

    Parameters
    ----------
    stress : array, shape (..., dim, dim)
        Cauchy stress [pressure].
    out_of_plane : float or array, shape (...), optional
        Normal stress [pressure] in the missing directions: σ₃₃ of a 2D body, and both σ₂₂ and σ₃₃ of a 1D body. The
        default 0 is plane stress. In plane strain it is ν (σ₁₁ + σ₂₂). It is not used in 3D.

    Returns
    -------
    array, shape (...)
        σ_vM [pressure].

    Raises
    ------
    ValueError
        If `stress` does not have the shape (..., dim, dim) with dim 1, 2 or 3.

    Examples
    --------
    Uniaxial tension of 3, and pure shear of 1:

    >>> round(float(pd.von_mises(np.diag([3.0, 0.0]))), 3)
    3.0
    >>> round(float(pd.von_mises(np.array([[0.0, 1.0], [1.0, 0.0]]))), 3)
    1.732
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
