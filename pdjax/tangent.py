"""The exact Jacobian J = ∂f/∂u of a body: as JVP, dense, sparse; and the tangent of one family.

Forward differentiation of the force density is the reference (`jvp`, dense `jacobian`). The sparse matrix is
assembled from structure, never probed: with Δ the difference operator (η = Δ u),

    dT = B Δ du + G R Δ du (+ G' R' Δ du for the far end's state),    J = Div dT/du,    (Div T)_i = Σ_j V_j (T_ij −
    T_ji)

where B, G, R come from autodiff of the model's two small functions, point by point. The pattern is
that of the product: two rings of neighbours, three where the far end's state is needed.
V J is symmetric for hyperelastic models; J itself only for equal volumes.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from ._checks import choice, deformation_gradient
from .force import _split, body_bonds, check_model, force_density, point_field
from .models.base import AbstractModel, PointStateModel
from .neighbours import Bonds, Families, Family


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
    bonds = jax.tree.map(lambda x: x[:first], bonds)

    def one(eta, here, there, bond):
        return model.bond_force(unravel(here), unravel(there), bond._replace(eta=eta))

    B = jax.vmap(jax.jacfwd(one, 0), (0, None, 0, 0))(bonds.eta, state, far, bonds)
    G = jax.vmap(jax.jacfwd(one, 1), (0, None, 0, 0))(bonds.eta, state, far, bonds)
    if model.needs_other_end:
        other = jax.vmap(jax.jacfwd(one, 2), (0, None, 0, 0))(bonds.eta, state, far, bonds)
    else:
        other = jnp.zeros_like(G)
    return LowRank(B, G, R, other)


def family_tangent(model: AbstractModel, bonds: Bonds) -> Float[Array, "bonds dim bonds dim"]:
    """C = ∂T/∂η of one family, dense, every point in the same state; (b, i, c, j) = ∂T_bi/∂η_cj."""
    if isinstance(model, PointStateModel):
        t = linearise_states(model, bonds)
        n = bonds.eta.shape[0]
        C = jnp.einsum("bir,rcj->bicj", t.G, t.R)  # own state only: dT at this point by its own bonds
        return C.at[jnp.arange(n), :, jnp.arange(n), :].add(t.B)
    return jax.jacfwd(lambda eta: model.force_state(bonds._replace(eta=eta)))(bonds.eta)


def center_block(model: AbstractModel, fam: Family, F) -> Float[Array, "dim dim"]:
    """D = ∂f(X)/∂x(X): the Jacobian's block at the point itself, on an infinite lattice under x = F X.

    D = Σ_ξ V [−(Σ_ζ C_ξζ) − C_ξξ]: its own bonds all move by −e, and in each neighbour's family one bond moves by +e.
    Arguments: F (dim, dim).  Returns: (dim, dim) [force/length^(dim+1)].  Raises: as `force_state`.
    """
    check_model(model, fam)
    return block_at_center(model, fam, deformation_gradient(F, fam.dim))


def block_at_center(model: AbstractModel, fam: Family, F: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """`center_block` unchecked, for drivers to trace."""
    bonds = fam.bonds(F)
    if isinstance(model, PointStateModel):  # the same sums without ever forming C
        t = linearise_states(model, bonds)
        far = jnp.einsum("b,bir,rbj->ij", bonds.volume, t.G + t.there, t.R)
        own = jnp.einsum("b,bir->ir", bonds.volume, t.G + t.there) @ t.R.sum(axis=1)
        return -2 * jnp.einsum("b,bij->ij", bonds.volume, t.B) - own - far
    C = family_tangent(model, bonds)
    own = jnp.einsum("b,bicj->ij", bonds.volume, C)
    return -own - jnp.einsum("b,bibj->ij", bonds.volume, C)


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
    choice("form", form, ("sparse", "dense"))
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
    if not isinstance(model, PointStateModel):
        return jax.vmap(lambda mine, b: family_tangent(eqx.combine(mine, shared), b))(varying, bonds)
    states = jax.vmap(lambda mine, b: ravel_pytree(eqx.combine(mine, shared).point_state(b))[0])(varying, bonds)
    far = states[fams.neighbours]
    return jax.vmap(lambda mine, b, there: linearise_states(eqx.combine(mine, shared), b, there))(varying, bonds, far)


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
