"""Force states, force densities, energies, strains and stresses of bodies and of single families.

    f_i = Σ_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)] V_j = −(1/V_i) ∂Π/∂u_i,   Π = Σ_i V_i W_i

    f_i [force/length^dim]    net internal force density of point i
    A_i                       point state: what the bonds of point i need of its family
    t [force/length^(2 dim)]  force state on one bond, the material model
    V_j [length^dim]          volume of point j
    W_i [energy/length^dim]   energy density of point i
    Π [energy]                strain energy of the body

A point needs data of its neighbours. How much depends on the evaluation:

* The backends that stream over the bonds (`pdjax.force.backends`) read only the point states A of the neighbours.
* This module evaluates all bonds of a body at once, and reads the force states T of whole families:
  f_i = Σ_j (T_ij − T_ji) V_j. The reverse-bond index finds T_ji.
* A model of two stages (`models.base`) first reads the states of the neighbours. It then collects the forces on its own
  state from them.

All these readings go through an `Exchange`. The symbol of a periodic cell uses it to multiply the data of another cell
by the phase factor of the wave.

The constants of a model may vary from point to point. A constant does so if the first axis of its array is as long as
the body has points.
"""

from collections.abc import Callable, Iterator
from functools import singledispatch
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_array, deformation_gradient, is_concrete, native
from .._internal.public import public_function
from ..geometry.bonds import EACH_BOND, Bonds, Families, LatticeFamily
from ..models.base import AbstractModel, TwoStageModel
from ..models.pointwise import each_point, none_if_empty, of_each_point, regular, split_model
from .shape_tensors import check_shape_tensors


class Exchange(NamedTuple):
    """The two functions by which points read data of their neighbours.

    `far` maps a quantity of the points (points, …) to (points, bonds, …), its values at the other ends of the bonds.
    `back` maps a quantity of the bonds (points, bonds, …) to the same shape, its values on the reverse bonds j → i.
    """

    far: Callable[[Array], Array]
    back: Callable[[Array], Array]


def plain_exchange(families: Families) -> Exchange:
    """The exchange within a body, by the indices of the neighbours."""
    return Exchange(lambda x: x[families.neighbours], lambda x: x[families.neighbours, families.reverse])


_NEEDED = {
    LatticeFamily: "this function is for an infinite lattice and needs a LatticeFamily, from pd.lattice_family(dim, N)",
    Families: "this function is for a body and needs Families, from pd.families(body, horizon)",
}


def check_model(
    model: AbstractModel, families: LatticeFamily | Families, kind: type[LatticeFamily] | type[Families]
) -> None:
    """Raise ValueError if a function cannot use this model with these families.

    `kind` is what the function needs: one `LatticeFamily`, or the `Families` of a body. The other checks are the
    dimension of the model and the shape tensors: a model that inverts a shape tensor needs it invertible at every
    point. The message names the first point where it is singular.

    Shape tensors are checked once for each families object. A model or families changed by `eqx.tree_at` are checked
    again. Traced values are not checked.
    """
    if not isinstance(families, kind):
        raise ValueError(f"{_NEEDED[kind]}; got {type(families).__name__}")
    if not isinstance(model, AbstractModel):
        raise ValueError(f"model must be a pdjax model such as SethHill or Correspondence; got {model!r}")
    if families.dim not in model.dims:
        allowed = " or ".join(f"{d}" for d in model.dims)
        raise ValueError(
            f"{type(model).__name__} is defined in dimension {allowed}; this family has dim {families.dim}"
        )
    _check_constants(model, families)
    if is_concrete(families):
        check_shape_tensors(model, families)


def _constants(part: eqx.Module) -> Iterator[tuple[str, tuple[int, ...]]]:
    """(name, shape) of every field of a model that its own class, or that of a part, declares in `one_number`."""
    for name in getattr(part, "one_number", ()):
        yield name, np.shape(getattr(part, name))
    for inner in jax.tree.leaves(part, is_leaf=lambda x: x is not part and isinstance(x, eqx.Module)):
        if isinstance(inner, eqx.Module):
            yield from _constants(inner)


def _check_constants(model: AbstractModel, families: LatticeFamily | Families) -> None:
    """Raise ValueError for a constant that is neither one number nor, for a body, one number for each point."""
    for name, shape in _constants(model):
        if not shape:
            continue
        if isinstance(families, LatticeFamily):
            raise ValueError(
                f"{name} of {type(model).__name__} must be one number on a lattice family; got shape {shape}"
            )
        if shape != (len(families),):
            raise ValueError(
                f"{name} of {type(model).__name__} must be one number, or one for each of the {len(families)} points,"
                f" shape ({len(families)},); got shape {shape}"
            )


def point_field(u, families: Families, name: str = "u") -> Array:
    """Convert `u` to an array (points, dim). Raises ValueError if its shape is wrong or a value is not finite."""
    known = is_concrete(u)
    u = u if isinstance(u, jax.Array) else native(name, u) if known else jnp.asarray(u)
    if u.shape != (len(families), families.dim):
        raise ValueError(f"{name} must have shape (points, dim) = ({len(families)}, {families.dim}); got {u.shape}")
    if known:
        value = np.asarray(u)
        if not np.isfinite(value).all():
            bad = np.flatnonzero(~np.isfinite(value).all(axis=1))
            raise ValueError(f"{name} must be finite; {bad.size} points are not, the first is point {bad[0]}")
    if jnp.issubdtype(u.dtype, jnp.inexact):
        return u if isinstance(u, jax.Array) else as_array(u, u.dtype)
    return as_array(u, families.dtype)


def mean_deformation(F, families: Families) -> Array | None:
    """Convert the mean deformation gradient `F` to an array (dim, dim). None, the identity, stays None.

    Raises ValueError if F has a wrong shape, is not finite, or det F ≤ 0.
    """
    return None if F is None else deformation_gradient(F, families.dim)


def body_state(model: AbstractModel, families: Families, u, F=None) -> tuple[Array, Array | None]:
    """Check model, families, u and F, and return u and F as arrays. The families must have arrays of bonds."""
    check_model(model, families, Families)
    u, F = point_field(u, families), mean_deformation(F, families)
    families.need_arrays()
    return u, F


@eqx.filter_jit
def _family_state(model: AbstractModel, family: LatticeFamily, F: Array) -> Array:
    return model.force_state(family.bonds(F))


@public_function
def force_state(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "bonds dim"]:
    """Compute the force state T on every bond of an infinite lattice under a homogeneous deformation.

    T_b = (1/V) ∂W/∂η_b  at  x = F X

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be single numbers.
    family : LatticeFamily
        Family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.

    Returns
    -------
    array, shape (bonds, dim)
        T [force/length^(2 dim)], in the order of `family.xi`.

    Raises
    ------
    ValueError
        If F is not finite or det F ≤ 0, or if the model cannot invert the shape tensor of the family.

    Examples
    --------
    A bar with λ + 2μ = 3 is stretched by 10 %. Its two bonds pull with T = ± F S/2 = ± 1.1 · 3 · 0.105/2.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> T = pd.force_state(model, pd.lattice_family(1, 1), np.array([[1.1]]))
    >>> np.asarray(T).ravel().round(4).tolist()
    [0.1733, -0.1733]
    """
    check_model(model, family, LatticeFamily)
    return _family_state(model, family, deformation_gradient(F, family.dim))


@public_function
def piola_stress(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "dim dim"]:
    """Compute the first Piola–Kirchhoff stress P of an infinite lattice under a homogeneous deformation.

    P = Σ_b V T_b⊗ξ_b = ∂W/∂F  at  x = F X

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be single numbers.
    family : LatticeFamily
        Family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.

    Returns
    -------
    array, shape (dim, dim)
        P [pressure].

    Raises
    ------
    ValueError
        If F is not finite or det F ≤ 0, or if the model cannot invert the shape tensor of the family.

    Examples
    --------
    A bar with λ + 2μ = 3 is stretched by 10 %: P = F S = 1.1 · 3 · (1.1² − 1)/2.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> P = pd.piola_stress(model, pd.lattice_family(1, 1), np.array([[1.1]]))
    >>> round(float(P[0, 0]), 4)
    0.3465
    """
    check_model(model, family, LatticeFamily)
    return _compiled_stress(model, family, deformation_gradient(F, family.dim))


def affine_stress(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """`piola_stress` without checks. Compiled functions trace it."""
    bonds = family.bonds(F)
    return jnp.einsum("b,bi,bj->ij", bonds.volume, model.force_state(bonds), bonds.xi)


_compiled_stress = eqx.filter_jit(affine_stress)


def _by_both_ends(method: str, model: AbstractModel, bonds: Bonds, exchange: Exchange) -> Array:
    """model.method(A_here, A_there, bond) on every bond, with the constants of the point to which the bond belongs."""
    varying, shared = split_model(model, bonds.xi.shape[0])
    bonds, empty = regular(bonds)
    state = of_each_point("point_state", model, bonds)

    def one(mine, here, there, bond):
        return getattr(eqx.combine(mine, shared), method)(here, there, bond)

    far = jax.tree.map(exchange.far, state)
    return none_if_empty(jax.vmap(jax.vmap(one, (None, None, 0, EACH_BOND)))(varying, state, far, bonds), empty)


@singledispatch
def force_states(
    model: AbstractModel, volumes: Float[Array, " points"], bonds: Bonds, exchange: Exchange
) -> Float[Array, "points bonds dim"]:
    """T on every bond of a body, without checks. Each kind of model registers its own function."""
    if not model.needs_other_end:
        return each_point("force_state", model, bonds)
    return _by_both_ends("bond_force", model, bonds, exchange)


@force_states.register(TwoStageModel)
def _two_stage_states(model: TwoStageModel, volumes: Array, bonds: Bonds, exchange: Exchange) -> Array:
    """T by both stages: the point states, the bond energies that depend on them, and the forces on the states."""
    varying, shared = split_model(model, bonds.xi.shape[0])
    bonds, empty = regular(bonds)

    def states(eta):
        return jax.vmap(lambda mine, b: eqx.combine(mine, shared).point_state(b))(varying, bonds._replace(eta=eta))

    def one(eta, here, there, mine, bond):
        return eqx.combine(mine, shared).bond_energy(here, there, bond._replace(eta=eta))

    state, pull = jax.vjp(states, bonds.eta)
    slope = jax.vmap(jax.vmap(jax.grad(one, (0, 1, 2)), (0, None, 0, None, EACH_BOND)))
    slopes = slope(bonds.eta, state, jax.tree.map(exchange.far, state), varying, bonds)
    direct, on_here, on_there = none_if_empty(slopes, empty)
    ratio = bonds.volume / volumes[:, None]

    def total(here, there):
        back = exchange.back(there)
        return jnp.sum(here + ratio.reshape(ratio.shape + (1,) * (back.ndim - 2)) * back, axis=1)

    (indirect,) = pull(jax.tree.map(total, on_here, on_there))
    return (direct + indirect) / bonds.volume[..., None]


@singledispatch
def energies(model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, " points"]:
    """W of every point of a body, without checks. Each kind of model registers its own function."""
    return each_point("energy", model, bonds)


@energies.register(TwoStageModel)
def _two_stage_energies(model: TwoStageModel, families: Families, bonds: Bonds) -> Float[Array, " points"]:
    return jnp.sum(_by_both_ends("bond_energy", model, bonds, plain_exchange(families)), axis=1)


@eqx.filter_jit
def whole_force(model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, "points dim"]:
    """f of any model, computed from all bonds at once and without checks.

    Points exchange T even if the model has a point state. The program then contains the bond force once instead of once
    for each end of a bond.
    """
    exchange = plain_exchange(families)
    T = force_states(model, families.volumes, bonds, exchange)
    return jnp.einsum("pb,pbi->pi", bonds.volume, T - exchange.back(T))


@eqx.filter_jit
def _energy(model: AbstractModel, families: Families, u: Array, F: Array | None) -> Float[Array, ""]:
    return jnp.dot(families.volumes, _energies(model, families, u, F))


def _energies(model: AbstractModel, families: Families, u: Array, F: Array | None) -> Float[Array, " points"]:
    return energies(model, families, families.bonds(u, F))


energy_of_each = eqx.filter_jit(_energies)  # W of every point, without checks


@eqx.filter_jit
def _each_point(method: str, model: AbstractModel, families: Families, u: Array, F: Array | None) -> Array:
    return each_point(method, model, families.bonds(u, F))


@public_function
def strain_energy(model: AbstractModel, families: Families, u, F=None) -> Float[Array, ""]:
    """Compute the strain energy of a body.

    Π = Σ_i V_i W_i

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
    array, shape ()
        Π [energy].

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, the model cannot invert a shape tensor, or the families
        were made with `arrays=False`.

    Examples
    --------
    A plate of 20 points of volume 1 is stretched by 10 % with its width held. The strain is E₁₁ = 0.105 and the energy
    is Π = 20 · ½ (λ + 2μ) E₁₁².

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> energy = pd.strain_energy(model, families, np.zeros((20, 2)), np.diag([1.1, 1.0]))
    >>> round(float(energy), 5)
    0.33075
    """
    return _energy(model, families, *body_state(model, families, u, F))


@public_function
def strain(model: AbstractModel, families: Families, u, F=None) -> Float[Array, "points dim dim"]:
    """Compute the strain of every point, in the measure that the model uses.

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
        Strain [-]: Ē_m for `SethHill`, and the Green–Lagrange strain of F̄ for models without a measure of their own.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, the model cannot invert a shape tensor, or the families
        were made with `arrays=False`.

    Examples
    --------
    A stretch of 10 % is the Green–Lagrange strain (1.1² − 1)/2.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> E = pd.strain(model, families, np.zeros((20, 2)), np.diag([1.1, 1.0]))
    >>> E.shape, round(float(E[0, 0, 0]), 3)
    ((20, 2, 2), 0.105)
    """
    return _each_point("strain", model, families, *body_state(model, families, u, F))


@public_function
def stress(model: AbstractModel, families: Families, u, F=None) -> Float[Array, "points dim dim"]:
    """Compute the stress of every point, in the measure that the model uses.

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
        Stress [pressure]. `Correspondence`, `SethHill` and `TupekRadovitzky` give the stress of their law: S = ∂Ψ/∂E
        for a law in E, and P = ∂ψ/∂F for a law in F. All other models give P = Σ V T⊗ξ of the family, where both ends
        of a bond have the state of the point.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, the model cannot invert a shape tensor, or the families
        were made with `arrays=False`.

    See Also
    --------
    cauchy_stress : the same measure for every model.

    Examples
    --------
    A plate with λ = μ = 1 has the strain E₁₁ = 0.105 alone, so S = diag(λ + 2μ, λ) E₁₁.

    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> S = pd.stress(model, families, np.zeros((20, 2)), np.diag([1.1, 1.0]))
    >>> np.asarray(S[0]).diagonal().round(3).tolist()
    [0.315, 0.105]
    """
    return _each_point("stress", model, families, *body_state(model, families, u, F))
