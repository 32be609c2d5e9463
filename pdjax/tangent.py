"""The exact Jacobian J = ∂f/∂u of a body: as JVP, dense, sparse; and the tangent of one family.

Forward differentiation of the force density is the reference (`jvp`, dense `jacobian`). The sparse matrix is
assembled from structure, never probed: with Δ the difference operator (η = Δ u),

    dT = B Δ du + G R Δ du (+ G' R' Δ du for the far end's state),    J = Div dT/du,    (Div T)_i = Σ_j V_j (T_ij −
    T_ji)

where B, G, R come from autodiff of the model's two small functions, point by point. The pattern is
that of the product: two rings of neighbours, three where the far end's state is needed.
A model of two stages has, with Z = (Δ; S; S at the far end), S = R Δ its states, and H the Hessian of a bond's energy,
V J = −Zᵀ (V H) Z, since its states are linear in η.
V J is symmetric for hyperelastic models; J itself only for equal volumes.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ._checks import choice
from .coloring import coloured_jacobian
from .evaluate import force_density
from .force import _split, body_bonds, check_model, point_field
from .models.base import AbstractModel, PointStateModel, TwoStageModel
from .neighbours import EACH_BOND, Bonds, Families


class LowRank(NamedTuple):
    """∂T_b/∂η_c = δ_bc B_b + G_b R_c of one family; `there` is the part of G by the far end's state."""

    B: Float[Array, "bonds dim dim"]
    G: Float[Array, "bonds dim rank"]
    R: Float[Array, "rank bonds dim"]
    there: Float[Array, "bonds dim rank"]


def linearise_states(model: PointStateModel, bonds: Bonds, there=None, first: int | None = None) -> LowRank:
    """B, G, R of one family by autodiff of `point_state` (reverse) and `bond_force` (forward).

    `there` holds the states at the far ends, (bonds, rank) raveled; None: equal to this point's (homogeneous).
    `first`: only for that many leading bonds (a centro-symmetric family needs but its half).
    """
    state, unravel = ravel_pytree(model.point_state(bonds))
    R = jax.jacrev(lambda eta: ravel_pytree(model.point_state(bonds._replace(eta=eta)))[0])(bonds.eta)
    far = jnp.broadcast_to(state, (bonds.eta.shape[0], state.shape[0])) if there is None else there
    R, far = R[:, :first], far[:first]
    bonds = jax.tree.map(lambda x: x[:first] if x.ndim else x, bonds)  # δ is no array of bonds

    def one(eta, here, there, bond):
        return model.bond_force(unravel(here), unravel(there), bond._replace(eta=eta))

    each = (0, None, 0, EACH_BOND)
    B = jax.vmap(jax.jacfwd(one, 0), each)(bonds.eta, state, far, bonds)
    G = jax.vmap(jax.jacfwd(one, 1), each)(bonds.eta, state, far, bonds)
    if model.needs_other_end:
        other = jax.vmap(jax.jacfwd(one, 2), each)(bonds.eta, state, far, bonds)
    else:
        other = jnp.zeros_like(G)
    return LowRank(B, G, R, other)


class TwoStage(NamedTuple):
    """The second derivatives of bond energies φ(η, A_here, A_there), and R = ∂A/∂η, of one family."""

    direct: Float[Array, "bonds dim dim"]
    by_here: Float[Array, "bonds dim rank"]  # ∂²φ/∂η∂A_here
    by_there: Float[Array, "bonds dim rank"]
    here: Float[Array, "bonds rank rank"]
    mixed: Float[Array, "bonds rank rank"]  # ∂²φ/∂A_here∂A_there
    there: Float[Array, "bonds rank rank"]
    R: Float[Array, "rank bonds dim"]


def linearise_two_stage(model: TwoStageModel, bonds: Bonds, there=None) -> TwoStage:
    """Hessians of every bond's energy and derivative of the state, by autodiff; `there` as in `linearise_states`."""
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


def family_tangent(model: AbstractModel, bonds: Bonds) -> Float[Array, "bonds dim bonds dim"]:
    """C = ∂T/∂η of one family, dense, every point in the same state; (b, i, c, j) = ∂T_bi/∂η_cj.

    Raises: ValueError for a model of two stages, whose force state is not a function of one family.
    """
    if isinstance(model, TwoStageModel):
        raise ValueError(
            f"the force state of {type(model).__name__} depends on its neighbours' families too: criteria of one family"
            ' ("material", "material_center", "material_neighbour") do not apply; use "block" or "symbol"'
        )
    if isinstance(model, PointStateModel):
        t = linearise_states(model, bonds)
        n = bonds.eta.shape[0]
        C = jnp.einsum("bir,rcj->bicj", t.G, t.R)  # own state only: dT at this point by its own bonds
        return C.at[jnp.arange(n), :, jnp.arange(n), :].add(t.B)
    return jax.jacfwd(lambda eta: model.force_state(bonds._replace(eta=eta)))(bonds.eta)


def jvp(model: AbstractModel, fams: Families, u, v, F=None) -> Float[Array, "points dim"]:
    """J v, the directional derivative of the force density at u along v (points, dim) [length]."""
    check_model(model, fams)
    u, v = (point_field(x, fams, name).astype(fams.xi.dtype) for x, name in ((u, "u"), (v, "v")))
    return jax.jvp(lambda w: force_density(model, fams, w, F), (u,), (v,))[1]


def jacobian(model: AbstractModel, fams: Families, u, form: str = "sparse", F=None):
    """The exact Jacobian ∂f/∂u of a body, (points·dim, points·dim) [force/length^(dim+1)].

    Rows and columns run over points, then components. `form` "dense": a JAX array by `jax.jacfwd` (differentiable;
    memory grows with points²); "sparse": a scipy.sparse `csr_array` assembled from structure (`.tobsr((dim, dim))`
    for blocks). Arguments and errors otherwise as `force_density`.
    """
    choice("form", form, ("sparse", "dense", "coloured"))
    if form == "coloured":
        return coloured_jacobian(model, fams, u, F)
    bonds = body_bonds(model, fams, u, F)
    if form == "sparse":
        return _sparse(model, fams, bonds)
    return _dense(model, fams, jnp.asarray(u, dtype=fams.xi.dtype), F)


@eqx.filter_jit
def _dense(model, fams, u, F):
    n = u.size
    return jax.jacfwd(lambda w: force_density(model, fams, w, F))(u).reshape(n, n)


@eqx.filter_jit
def _point_tangents(model, fams, bonds):
    """LowRank of every point (point-state models), or the dense C of every point."""
    varying, shared = _split(model, len(fams))
    if not isinstance(model, PointStateModel | TwoStageModel):
        return jax.vmap(lambda mine, b: family_tangent(eqx.combine(mine, shared), b))(varying, bonds)
    states = jax.vmap(lambda mine, b: ravel_pytree(eqx.combine(mine, shared).point_state(b))[0])(varying, bonds)
    far = states[fams.neighbours]
    linearise: Any = linearise_two_stage if isinstance(model, TwoStageModel) else linearise_states
    return jax.vmap(lambda mine, b, there: linearise(eqx.combine(mine, shared), b, there))(varying, bonds, far)


def _block_csr(rows, cols, blocks, shape) -> sp.csr_array:
    """A CSR matrix of equal blocks (n, a, b) at block positions (rows, cols)."""
    n, a, b = blocks.shape
    r = np.broadcast_to((rows[:, None, None] * a + np.arange(a)[None, :, None]), (n, a, b)).reshape(-1)
    c = np.broadcast_to((cols[:, None, None] * b + np.arange(b)[None, None, :]), (n, a, b)).reshape(-1)
    return sp.coo_array((blocks.reshape(-1), (r, c)), shape=(shape[0] * a, shape[1] * b)).tocsr()


def _sparse(model: AbstractModel, fams: Families, bonds: Bonds) -> sp.csr_array:
    points, dim = len(fams), fams.dim
    tangents = _point_tangents(model, fams, bonds)
    true = np.asarray(fams.weight) > 0
    i, slot = np.nonzero(true)
    j = np.asarray(fams.neighbours)[i, slot]
    bond, count = np.arange(len(i)), len(i)
    ones = np.broadcast_to(np.eye(dim), (count, dim, dim))
    V = np.asarray(fams.volumes, dtype=float)
    difference = _block_csr(bond, j, ones, (count, points)) - _block_csr(bond, i, ones, (count, points))
    if isinstance(model, TwoStageModel):
        return _of_energies(tangents, V, difference, (i, slot, j))
    divergence = _block_csr(i, bond, ones * V[j][:, None, None], (points, count)) - _block_csr(
        j, bond, ones * V[i][:, None, None], (points, count)
    )
    if isinstance(model, PointStateModel):
        B, G, R, there = (np.asarray(x) for x in tangents)
        state = _block_csr(i, bond, R.transpose(0, 2, 1, 3)[i, slot], (points, count)) @ difference
        # (Div G) (R Δ), never Div (G R Δ): the product over bonds holds a family's square of entries
        pull = divergence @ _block_csr(bond, i, G[i, slot], (count, points))
        if model.needs_other_end:
            pull = pull + divergence @ _block_csr(bond, j, there[i, slot], (count, points))
        J = divergence @ (_block_csr(bond, bond, B[i, slot], (count, count)) @ difference) + pull @ state
    else:
        number = np.full(true.shape, -1)
        number[i, slot] = bond
        p, b, c = np.nonzero(true[:, :, None] & true[:, None, :])
        blocks = np.asarray(tangents).transpose(0, 1, 3, 2, 4)[p, b, c]
        J = divergence @ (_block_csr(number[p, b], number[p, c], blocks, (count, count)) @ difference)
    J = J.tocsr()
    J.sort_indices()
    return J


def _of_energies(t: TwoStage, V: np.ndarray, difference: sp.csr_array, true: tuple) -> sp.csr_array:
    """J of a model of two stages: −V⁻¹ Zᵀ (V H) Z, the states of both ends taken together before the widest product."""
    i, slot, j = true
    bond, count, points = np.arange(len(i)), len(i), len(V)
    dim = t.direct.shape[-1]
    direct, by_here, by_there, here, mixed, there = (np.asarray(x)[i, slot] * V[i][:, None, None] for x in t[:-1])
    state = _block_csr(i, bond, np.asarray(t.R).transpose(0, 2, 1, 3)[i, slot], (points, count)) @ difference
    stretched = _block_csr(bond, bond, direct, (count, count)) @ difference
    cross = _block_csr(bond, i, by_here, (count, points)) + _block_csr(bond, j, by_there, (count, points))
    pair = _block_csr(i, j, mixed, (points, points))
    inner = _block_csr(i, i, here, (points, points)) + _block_csr(j, j, there, (points, points)) + pair + pair.T
    coupled = (difference.T @ cross) @ state
    VJ = -(difference.T @ stretched + coupled + coupled.T + state.T @ (inner @ state))
    J = (sp.diags_array(np.repeat(1 / V, dim)) @ VJ).tocsr()
    J.sort_indices()
    return J
