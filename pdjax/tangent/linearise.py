"""The tangent of one family, by automatic differentiation of the small functions of a model.

The tangent ∂T/∂η has a different form for each kind of model:

    point-state model      ∂T_b/∂η_c = δ_bc B_b + G_b R_c,  B = ∂t/∂η,  G = ∂t/∂A,  R = ∂A/∂η     (LowRank)
    model of two stages    the second derivatives of the bond energies φ(η, A_here, A_there), and R   (TwoStage)
    any other model        the dense C = ∂T/∂η of the force state

A is the point state. It has few entries, so the product G R has a low rank.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ..geometry.bonds import EACH_BOND, Bonds
from ..models.base import AbstractModel, PointStateModel, Sums, TwoStageModel


class LowRank(NamedTuple):
    """The tangent ∂T_b/∂η_c = δ_bc B_b + G_b R_c of one family. `there` is G for the state of the far end.

    R is the derivative of the state, or of the sums from which the state is computed if these are fewer.
    """

    B: Float[Array, "bonds dim dim"]
    G: Float[Array, "bonds dim rank"]
    R: Float[Array, "rank bonds dim"]
    there: Float[Array, "bonds dim rank"]


class _Slope(NamedTuple):
    """The raveled state with its unravel function, and ∂A/∂η = outer · R. `outer` None stands for the identity."""

    state: Array
    unravel: Callable
    outer: Float[Array, "rank sums"] | None
    R: Float[Array, "sums bonds dim"]


def _slope_of_state(model: PointStateModel, bonds: Bonds) -> _Slope:
    """The state of a family and its derivative in η.

    For a model made of moments the chain rule gives it: ∂A/∂sums times ∂moments/∂η of each bond. This is a smaller
    program than reverse differentiation of the whole state.
    """
    if not model.by_moments:
        state, unravel = ravel_pytree(model.point_state(bonds))
        R = jax.jacrev(lambda eta: ravel_pytree(model.point_state(bonds._replace(eta=eta)))[0])(bonds.eta)
        return _Slope(state, unravel, None, R)

    def moments(eta, bond):
        reference, deformed = model.moments(bond._replace(eta=eta))
        flat = ravel_pytree(deformed)[0]
        return flat, (reference, deformed)

    slopes, each = jax.vmap(jax.jacfwd(moments, has_aux=True), (0, EACH_BOND))(bonds.eta, bonds)
    reference, deformed = jax.tree.map(lambda x: jnp.sum(x, axis=0), each)
    total, structure = ravel_pytree(deformed)

    def state_of(total):
        state = model.state(Sums(reference, structure(total), bonds.horizon, bonds.xi.shape[-1]))
        return ravel_pytree(state)[0], state

    outer, state = jax.jacfwd(state_of, has_aux=True)(total)
    return _Slope(*ravel_pytree(state), outer, jnp.moveaxis(slopes, 1, 0))


def linearise_states(
    model: PointStateModel, bonds: Bonds, there: Float[Array, "bonds rank"] | None = None, first: int | None = None
) -> LowRank:
    """B, G and R of one family, by automatic differentiation of `point_state` and `bond_force`.

    `there` holds the raveled states at the far ends, (bonds, rank). None means that they equal the state of this point,
    as under a homogeneous deformation. `first` restricts the result to that many leading bonds: a centro-symmetric
    family needs only half of them.
    """
    state, unravel, outer, R = _slope_of_state(model, bonds)
    far = jnp.broadcast_to(state, (bonds.eta.shape[0], state.shape[0])) if there is None else there
    R, far = R[:, :first], far[:first]
    bonds = jax.tree.map(lambda x: x[:first] if x.ndim else x, bonds)  # δ is one number for all bonds

    def one(eta, here, there, bond):
        return model.bond_force(unravel(here), unravel(there), bond._replace(eta=eta))

    ends = (0, 1, 2) if model.needs_other_end else (0, 1)
    slopes = jax.vmap(jax.jacfwd(one, ends), (0, None, 0, EACH_BOND))(bonds.eta, state, far, bonds)
    B, G = slopes[:2]
    if model.needs_other_end:  # the state of a far end has another `outer`, so R must be that of the state itself
        return LowRank(B, G, R if outer is None else jnp.einsum("rq,qbd->rbd", outer, R), slopes[2])
    G = G if outer is None else G @ outer
    return LowRank(B, G, R, jnp.zeros_like(G))


class TwoStage(NamedTuple):
    """The second derivatives of the bond energies φ(η, A_here, A_there) of one family, and R = ∂A/∂η."""

    direct: Float[Array, "bonds dim dim"]
    by_here: Float[Array, "bonds dim rank"]  # ∂²φ/∂η∂A_here
    by_there: Float[Array, "bonds dim rank"]
    here: Float[Array, "bonds rank rank"]
    mixed: Float[Array, "bonds rank rank"]  # ∂²φ/∂A_here∂A_there
    there: Float[Array, "bonds rank rank"]
    R: Float[Array, "rank bonds dim"]


def linearise_two_stage(
    model: TwoStageModel, bonds: Bonds, there: Float[Array, "bonds rank"] | None = None
) -> TwoStage:
    """The Hessian of the energy of every bond, and the derivative of the state. `there` as in `linearise_states`."""
    state, unravel = ravel_pytree(model.point_state(bonds))
    R = jax.jacrev(lambda eta: ravel_pytree(model.point_state(bonds._replace(eta=eta)))[0])(bonds.eta)
    far = jnp.broadcast_to(state, (bonds.eta.shape[0], state.shape[0])) if there is None else there

    def one(eta, here, there, bond):
        return model.bond_energy(unravel(here), unravel(there), bond._replace(eta=eta))

    hessian = jax.hessian(one, argnums=(0, 1, 2))
    (direct, by_here, by_there), (_, here, mixed), (_, _, at_far) = jax.vmap(hessian, (0, None, 0, EACH_BOND))(
        bonds.eta, state, far, bonds
    )
    return TwoStage(direct, by_here, by_there, here, mixed, at_far, R)


@singledispatch
def family_tangent(model: AbstractModel, bonds: Bonds) -> Float[Array, "bonds dim bonds dim"]:
    """The dense tangent C = ∂T/∂η of one family, with all points in the same state: C[b, i, c, j] = ∂T_bi/∂η_cj.

    Each kind of model registers its own function. A model of two stages raises ValueError, because its force state is
    not a function of one family.
    """
    return jax.jacfwd(lambda eta: model.force_state(bonds._replace(eta=eta)))(bonds.eta)


@family_tangent.register(PointStateModel)
def _point_state_tangent(model: PointStateModel, bonds: Bonds) -> Float[Array, "bonds dim bonds dim"]:
    t = linearise_states(model, bonds)
    n = bonds.eta.shape[0]
    C = jnp.einsum("bir,rcj->bicj", t.G, t.R)  # G only: the state of the far end does not depend on these bonds
    return C.at[jnp.arange(n), :, jnp.arange(n), :].add(t.B)


@family_tangent.register(TwoStageModel)
def _two_stage_refusal(model: TwoStageModel, bonds: Bonds) -> Float[Array, "bonds dim bonds dim"]:
    raise ValueError(
        f"the force state of {type(model).__name__} depends on its neighbours' families too, so criteria of one family"
        ' ("material", "material_center", "material_neighbour") do not apply; use "block" or "symbol"'
    )


FamilyTangent = LowRank | TwoStage | Array


@singledispatch
def linearise(model: AbstractModel, bonds: Bonds, there: Float[Array, "bonds rank"] | None = None) -> FamilyTangent:
    """The tangent of one family in the form that suits the model: `LowRank`, `TwoStage`, or the dense C.

    Each kind of model registers its own function. `there` as in `linearise_states`.
    """
    return family_tangent(model, bonds)


linearise.register(PointStateModel)(linearise_states)
linearise.register(TwoStageModel)(linearise_two_stage)
