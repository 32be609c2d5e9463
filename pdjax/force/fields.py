"""Forces and energies of bodies and of single families.

    f_i = Σ_j [t(A_i, A_j, bond) − t(A_j, A_i, −bond)] V_j = −(1/V_i) ∂Π/∂u_i,   Π = Σ_i V_i W_i

Where bonds are streamed (`pdjax.force.backends`), only the point state A travels between points. Where all bonds of a body go at
once, the force state T of whole families does: f_i = Σ_j (T_ij − T_ji) V_j, and the reverse-bond index finds T_ji.
A model of two stages sends its states out, and the forces on them back (`models.base`).

What travels goes through an `Exchange`, so that the symbol of a periodic cell can turn its phase on the way.

A model's constants may vary from point to point: a leaf whose first axis is as long as the body has points.
"""

from collections.abc import Callable
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
    """How points hear of each other: `far` (points, …) → (points, bonds, …) is a quantity at the other end of a bond;
    `back` (points, bonds, …) → the same is that of the reverse bond, kept by the other end."""

    far: Callable[[Array], Array]
    back: Callable[[Array], Array]


def plain_exchange(families: Families) -> Exchange:
    """Within a body: by the neighbours' indices."""
    return Exchange(lambda x: x[families.neighbours], lambda x: x[families.neighbours, families.reverse])


_NEEDED = {
    LatticeFamily: "an infinite lattice is one LatticeFamily, of pd.lattice_family(dim, N)",
    Families: "a body has Families, of pd.families(body, horizon)",
}


def check_model(
    model: AbstractModel, families: LatticeFamily | Families, kind: type[LatticeFamily] | type[Families]
) -> None:
    """Refuse what is not of the kind a function takes, one `LatticeFamily` or the `Families` of a body; and a family whose
    shape tensor the model needs and can't invert, with the point's index.

    Shape tensors are looked at once for each families object; a model or families that `eqx.tree_at` has changed are
    looked at anew. Nothing is said of values that are traced.
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
    if isinstance(families, LatticeFamily):
        _refuse_varying(model)
    if is_concrete(families):
        check_shape_tensors(model, families)


_ONE_NUMBER = {"c", "m", "bulk", "shear", "g", "C", "r", "lam", "mu", "factor"}


def _refuse_varying(model: AbstractModel) -> None:
    """On a lattice family all points are alike: a constant that varies from point to point has no meaning."""
    for path, leaf in jax.tree_util.tree_leaves_with_path(model):
        name = getattr(path[-1], "name", "")
        if name in _ONE_NUMBER and np.ndim(leaf) > 0:
            raise ValueError(
                f"{name} of {type(model).__name__} must be one number on a lattice family; got shape {np.shape(leaf)}"
            )


def point_field(u, families: Families, name: str = "u") -> Array:
    """`u` as a (points, dim) array, refused where its shape is wrong or it is not finite."""
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
    return None if F is None else deformation_gradient(F, families.dim)


def body_state(model: AbstractModel, families: Families, u, F=None) -> tuple[Array, Array | None]:
    """The checked displacement and mean deformation (or None) of a body whose bonds are needed."""
    check_model(model, families, Families)
    u, F = point_field(u, families), mean_deformation(F, families)
    families.need_arrays()
    return u, F


@eqx.filter_jit
def _family_state(model: AbstractModel, family: LatticeFamily, F: Array) -> Array:
    return model.force_state(family.bonds(F))


@public_function
def force_state(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "bonds dim"]:
    """T of one lattice family under the homogeneous deformation x = F X.

    Arguments: F (dim, dim) [-], det F > 0.  Returns: (bonds, dim) [force/length^(2 dim)].
    Raises: ValueError for det F ≤ 0, NaN, or a family whose shape tensor the model can't invert.
    """
    check_model(model, family, LatticeFamily)
    return _family_state(model, family, deformation_gradient(F, family.dim))


@public_function
def piola_stress(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "dim dim"]:
    """P = Σ V T⊗ξ = ∂W/∂F over affine maps [pressure]: the first Piola–Kirchhoff stress of a homogeneous state.

    Arguments, errors: as `force_state`.
    """
    check_model(model, family, LatticeFamily)
    return _compiled_stress(model, family, deformation_gradient(F, family.dim))


def affine_stress(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """`piola_stress` unchecked, for drivers to trace."""
    bonds = family.bonds(F)
    return jnp.einsum("b,bi,bj->ij", bonds.volume, model.force_state(bonds), bonds.xi)


_compiled_stress = eqx.filter_jit(affine_stress)


def _by_both_ends(method: str, model: AbstractModel, bonds: Bonds, exchange: Exchange) -> Array:
    """model.method(A_here, A_there, bond) on every bond, with the constants of the point whose bond it is."""
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
    """T of every bond of a body; unchecked, for drivers to trace. Each kind of model registers its own."""
    if not model.needs_other_end:
        return each_point("force_state", model, bonds)
    return _by_both_ends("bond_force", model, bonds, exchange)


@force_states.register(TwoStageModel)
def _two_stage_states(model: TwoStageModel, volumes: Array, bonds: Bonds, exchange: Exchange) -> Array:
    """T by both stages: states out, bond energies, the forces on the states back."""
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
    """W of every point of a body; unchecked. Each kind of model registers its own."""
    return each_point("energy", model, bonds)


@energies.register(TwoStageModel)
def _two_stage_energies(model: TwoStageModel, families: Families, bonds: Bonds) -> Float[Array, " points"]:
    return jnp.sum(_by_both_ends("bond_energy", model, bonds, plain_exchange(families)), axis=1)


@eqx.filter_jit
def whole_force(model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, "points dim"]:
    """f of any model, all bonds at once; unchecked.

    Also with a point state it is T that travels: the program then holds the bond force once, not once for each end.
    """
    exchange = plain_exchange(families)
    T = force_states(model, families.volumes, bonds, exchange)
    return jnp.einsum("pb,pbi->pi", bonds.volume, T - exchange.back(T))


@eqx.filter_jit
def _energy(model: AbstractModel, families: Families, u: Array, F: Array | None) -> Float[Array, ""]:
    return jnp.dot(families.volumes, _energies(model, families, u, F))


def _energies(model: AbstractModel, families: Families, u: Array, F: Array | None) -> Float[Array, " points"]:
    return energies(model, families, families.bonds(u, F))


energy_of_each = eqx.filter_jit(_energies)  # W of every point, unchecked


@eqx.filter_jit
def _each_point(method: str, model: AbstractModel, families: Families, u: Array, F: Array | None) -> Array:
    return each_point(method, model, families.bonds(u, F))


@public_function
def strain_energy(model: AbstractModel, families: Families, u, F=None) -> Float[Array, ""]:
    """Π = Σ_i V_i W_i [energy] of a body; arguments and errors as `force_density`."""
    return _energy(model, families, *body_state(model, families, u, F))


@public_function
def strain(model: AbstractModel, families: Families, u, F=None) -> Float[Array, "points dim dim"]:
    """The model's own strain at every point [-]: Ē_m for Seth–Hill, else Green–Lagrange of F̄."""
    return _each_point("strain", model, families, *body_state(model, families, u, F))


@public_function
def stress(model: AbstractModel, families: Families, u, F=None) -> Float[Array, "points dim dim"]:
    """The model's stress at every point [pressure]: of `Correspondence`, `SethHill`, `TupekRadovitzky` the law's own,
    S = ∂Ψ/∂E for a law in E and P = ∂ψ/∂F for a law in F; of all others P = Σ V T⊗ξ of the family (with the point's
    own state at both ends of its bonds)."""
    return _each_point("stress", model, families, *body_state(model, families, u, F))
