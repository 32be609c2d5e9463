"""The sparse Jacobian of a body, assembled from the linearised families without directional derivatives.

Let Δ be the difference operator (η = Δ u), and (Div T)_i = Σ_j V_j (T_ij − T_ji), so that f = Div T.

**Point-state model.** A family has dT = B Δ du + G R Δ du, plus G' R Δ du if the force needs the state of the far end.
Here B = ∂t/∂η, G = ∂t/∂A, G' = ∂t/∂A_there and R = ∂A/∂η. The Jacobian J = Div dT/du is a direct part D, which couples
a point to one ring of neighbours, plus a product of two such matrices, J = D + P S. S = ∂A/∂u gives the states and
P = ∂f/∂A the forces that the states exert:

    D_ij = V_j (B_ij + B_ji),   S_ij = R_ij,   P_ij = V_j (G'_ij − G_ji),   P_ii = Σ_j V_j (G_ij − G'_ji)

and D_ii = −Σ_j D_ij, S_ii = −Σ_j S_ij. The product takes most of the time: 2 dim² · rank · ring² operations a point.
SciPy computes (P S)ᵀ = Sᵀ Pᵀ, and each thread computes a part of its rows. The transposition of the result then sorts
its indices. Moments Σ η ⊗ g(ξ), such as F̄, have S_ij = s_ij ⊗ 1: component d of u changes the entries (l, d) by s_l.
The blocks (dim, rank) (rank, dim) of the product then become (1, rank/dim) (rank/dim, dim²), with fewer operations.
The pattern is two rings, or three if the state of the far end is needed.

**Model of two stages.** Let S = R Δ be its states, Z = (Δ; S; S at the far end), and H the Hessian of the energy of a
bond. Then V J = −Zᵀ (V H) Z, because the states are linear in η.

**Any other model.** Its dense tangent C = ∂T/∂η gives J = Div C Δ.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import singledispatch
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array

from .._internal.checks import computed_in_double
from .._internal.threads import cores
from .._internal.xla import QUICK, compiled_with
from ..geometry.bonds import Bonds, Families
from ..models.base import AbstractModel, PointStateModel, TwoStageModel
from ..models.pointwise import regular, split_model
from .linearise import FamilyTangent, LowRank, TwoStage, linearise


def _point_tangents(model: AbstractModel, families: Families, bonds: Bonds) -> FamilyTangent:
    """The tangent of the family of every point (`linearise`). Entries of bonds without weight have no meaning."""
    varying, shared = split_model(model, len(families))
    bonds, _ = regular(bonds)
    if not model.needs_other_end:
        return jax.vmap(lambda mine, b: linearise(eqx.combine(mine, shared), b))(varying, bonds)
    states = jax.vmap(lambda mine, b: ravel_pytree(eqx.combine(mine, shared).point_state(b))[0])(varying, bonds)
    far = states[families.neighbours]
    return jax.vmap(lambda mine, b, there: linearise(eqx.combine(mine, shared), b, there))(varying, bonds, far)


def _block_csr(rows, cols, blocks, shape) -> sp.csr_array:
    """A CSR matrix of equal blocks (n, a, b) at block positions (rows, cols)."""
    n, a, b = blocks.shape
    r = np.broadcast_to((rows[:, None, None] * a + np.arange(a)[None, :, None]), (n, a, b)).reshape(-1)
    c = np.broadcast_to((cols[:, None, None] * b + np.arange(b)[None, None, :]), (n, a, b)).reshape(-1)
    return sp.coo_array((blocks.reshape(-1), (r, c)), shape=(shape[0] * a, shape[1] * b)).tocsr()


class _Rings(NamedTuple):
    """The block pattern of one ring of neighbours. The row of a point holds the point itself, then its neighbours."""

    start: np.ndarray  # (points + 1,) first block of every row
    column: np.ndarray  # (blocks,) block column, the index of a point
    own: np.ndarray  # (points,) block of the point itself
    place: np.ndarray  # (true bonds,) block of every bond with weight
    bond: np.ndarray  # (true bonds,) place of the bond in a flat array (points · bonds)
    reverse: np.ndarray  # (true bonds,) place of its reverse bond there

    @staticmethod
    def of(families: Families) -> "_Rings":
        """The pattern of these families. A bond belongs to it if one of its two directions has a weight."""
        weight, neighbours, back = (np.asarray(x) for x in (families.weight, families.neighbours, families.reverse))
        true = (weight > 0) | (weight[neighbours, back] > 0)
        start = np.concatenate([[0], np.cumsum(true.sum(axis=1) + 1)])
        i, slot = np.nonzero(true)
        place = start[i] + np.cumsum(true, axis=1)[i, slot]
        j = neighbours[i, slot]
        column = np.empty(start[-1], dtype=np.int32)
        column[start[:-1]] = np.arange(len(true))
        column[place] = j
        slots = true.shape[1]
        return _Rings(start.astype(np.int32), column, start[:-1], place, i * slots + slot, j * slots + back[i, slot])

    def matrix(self, on_bonds: np.ndarray, on_points: np.ndarray, reverse: bool = False) -> sp.bsr_array:
        """The matrix with blocks (points, bonds, a, b) at the neighbours and (points, a, b) on the diagonal.

        With `reverse` the block of a bond is that of its reverse bond.
        """
        points, (a, b) = len(on_points), on_points.shape[1:]
        blocks = np.empty((len(self.column), a, b))
        blocks[self.own] = on_points
        blocks[self.place] = on_bonds.reshape(-1, a, b).take(self.reverse if reverse else self.bond, axis=0)
        # The columns are copied because SciPy sorts the indices of 1 × 1 blocks in place.
        return sp.bsr_array((blocks, self.column.copy(), self.start), shape=(points * a, points * b))


def _rows(A: sp.bsr_array, first: int, last: int) -> sp.bsr_array:
    """The block rows first to last of A, without a copy of its blocks."""
    a, b = A.indptr[first], A.indptr[last]
    shape = ((last - first) * A.blocksize[0], A.shape[1])
    return sp.bsr_array((A.data[a:b], A.indices[a:b], A.indptr[first : last + 1] - a), shape=shape)


def _product(left: sp.bsr_array, right: sp.bsr_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(data, indices, indptr) of left · right. Each thread computes a part of the rows; SciPy releases the GIL."""
    threads, load = cores(), left.indptr
    cuts = np.searchsorted(load, load[-1] * np.arange(threads) / threads).tolist()
    with ThreadPoolExecutor(threads) as pool:
        parts = list(pool.map(lambda a, b: _rows(left, a, b) @ right, cuts, [*cuts[1:], len(load) - 1]))
    starts = np.cumsum([0, *(len(p.indices) for p in parts)])
    data, indices = (np.concatenate([getattr(p, name) for p in parts]) for name in ("data", "indices"))
    indptr = np.concatenate([[0], *(p.indptr[1:] + s for p, s in zip(parts, starts, strict=False))])
    return data, indices, indptr.astype(load.dtype)


def _transposed_product(left: sp.bsr_array, right: sp.bsr_array, dim: int) -> sp.bsr_array:
    """(left right)ᵀ with sorted indices, for a product of which every block has the entries of one (dim, dim) block.

    Only the product runs in threads: a thread gets fresh memory for every array, which is expensive to touch.
    """
    data, indices, indptr = _product(left, right)
    points = len(indptr) - 1
    # The transposition of the blocks' numbers tells where each block goes, and sorts the columns of every row.
    numbers = sp.csr_array((np.arange(len(indices), dtype=indices.dtype), indices, indptr), shape=(points, points))
    numbers = numbers.tocsc()
    blocks = data.reshape(-1, dim, dim).take(numbers.data, axis=0).transpose(0, 2, 1)
    return sp.bsr_array((blocks, numbers.indices, numbers.indptr), shape=(points * dim, points * dim))


@eqx.filter_jit
def _tangents(model: AbstractModel, families: Families, u: Array, F: Array | None) -> FamilyTangent:
    return _point_tangents(model, families, families.bonds(u, F))


class _RingBlocks(NamedTuple):
    """D, Pᵀ and Sᵀ of the module docstring: blocks on bonds (points, bonds, …) and on points (points, …).

    `separable` tells whether S_ij = s_ij ⊗ 1. The entries of the state are in the order (l, d) for that.
    """

    direct: tuple[Any, Any]  # blocks [component of f, component of u]
    force: tuple[Any, Any]  # [entry of the state, component of f]
    state: tuple[Any, Any]  # [component of u, entry of the state]
    separable: Array


@compiled_with(QUICK)
def _ring_blocks(model: PointStateModel, families: Families, u: Array, F: Array | None) -> _RingBlocks:
    bonds = families.bonds(u, F)
    real = (families.weight > 0)[..., None, None]
    t = _point_tangents(model, families, bonds)
    assert isinstance(t, LowRank)
    B, G, S = (jnp.where(real, x, 0.0) for x in (t.B, t.G, jnp.moveaxis(t.R, 2, 1)))
    back, V, own = (families.neighbours, families.reverse), bonds.volume[..., None, None], families.volumes
    D, P, P_own = V * (B + B[back]), -own[:, None, None, None] * G, V * G
    if model.needs_other_end:
        there = jnp.where(real, t.there, 0.0)[back]
        P, P_own = P + own[:, None, None, None] * there, P_own - V * there
    P, P_own, S = jnp.swapaxes(P, -1, -2), jnp.swapaxes(jnp.sum(P_own, axis=1), -1, -2), jnp.swapaxes(S, -1, -2)
    rank, dim = S.shape[-1], S.shape[-2]
    separable = jnp.asarray(False)
    if dim > 1 and rank and rank % dim == 0:
        order = np.arange(rank).reshape(dim, -1).T.reshape(-1)
        P, P_own, S = P[:, :, order], P_own[:, order], S[..., order]
        apart = S.reshape(*S.shape[:-1], -1, dim)
        separable = jnp.all(apart == jnp.eye(dim)[:, None, :] * apart[:, :, :1, :, :1])
    S_own = -jnp.sum(S, axis=1)
    return _RingBlocks((D, -jnp.sum(D, axis=1)), (P, P_own), (S, S_own), separable)


@singledispatch
def sparse_jacobian(model: AbstractModel, families: Families, u: Array, F: Array | None) -> sp.csr_array:
    """J (points·dim, points·dim) with sorted indices, at checked u and mean deformation F (or None).

    Each kind of model registers its own function. This one is for any model with a force state of one family.
    """
    tangents = computed_in_double(_tangents, model, families, u, F)
    at, difference, V = _bonds_of(families)
    i, slot, j = at
    dim, points, count = families.dim, len(families), len(i)
    bond = np.arange(count)
    ones = np.broadcast_to(np.eye(dim), (count, dim, dim))
    out = _block_csr(i, bond, ones * V[j][:, None, None], (points, count))
    back = _block_csr(j, bond, ones * V[i][:, None, None], (points, count))
    true = np.asarray(families.weight) > 0
    number = np.full(true.shape, -1)
    number[i, slot] = bond
    p, b, c = np.nonzero(true[:, :, None] & true[:, None, :])
    blocks = np.asarray(tangents).transpose(0, 1, 3, 2, 4)[p, b, c]
    J = (out - back) @ (_block_csr(number[p, b], number[p, c], blocks, (count, count)) @ difference)
    J = J.tocsr()
    J.sort_indices()
    return J


@sparse_jacobian.register(PointStateModel)
def _of_states(model: PointStateModel, families: Families, u: Array, F: Array | None) -> sp.csr_array:
    """J = D + P S, as the module docstring derives it."""
    blocks: _RingBlocks = computed_in_double(_ring_blocks, model, families, u, F)
    rings, dim, rank = _Rings.of(families), families.dim, blocks.state[0].shape[-1]
    direct = rings.matrix(*blocks.direct)
    direct.sort_indices()
    if not rank:
        return direct.tocsr()
    force, state = list(blocks.force), list(blocks.state)
    if blocks.separable:
        force = [x.reshape(*x.shape[:-2], rank // dim, dim * dim) for x in force]
        state = [x[..., :1, ::dim] for x in state]
    J = _transposed_product(rings.matrix(state[0], state[1], reverse=True), rings.matrix(*force), dim)
    # The pattern of the product contains that of D, so D is added in place: fresh memory is expensive to touch.
    J.data[np.searchsorted(_block_numbers(J), _block_numbers(direct))] += direct.data
    return J.tocsr()  # its indices are sorted because those of the product are


def _block_numbers(A: sp.bsr_array) -> np.ndarray:
    """row · rows + column of every block."""
    rows = len(A.indptr) - 1
    return np.repeat(np.arange(rows) * rows, np.diff(A.indptr)) + A.indices


@sparse_jacobian.register(TwoStageModel)
def _of_both_ends(model: TwoStageModel, families: Families, u: Array, F: Array | None) -> sp.csr_array:
    """J = −V⁻¹ Zᵀ (V H) Z, as the module docstring derives it."""
    at, difference, V = _bonds_of(families)
    return _of_energies(computed_in_double(_tangents, model, families, u, F), V, difference, at)


def _bonds_of(families: Families) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], sp.csr_array, np.ndarray]:
    """(point, slot and neighbour of every bond with weight), the difference operator Δ, and the volumes."""
    i, slot = np.nonzero(np.asarray(families.weight) > 0)
    j = np.asarray(families.neighbours)[i, slot]
    bond, count = np.arange(len(i)), len(i)
    ones = np.broadcast_to(np.eye(families.dim), (count, families.dim, families.dim))
    shape = (count, len(families))
    difference = _block_csr(bond, j, ones, shape) - _block_csr(bond, i, ones, shape)
    return (i, slot, j), difference, np.asarray(families.volumes, dtype=float)


def _of_energies(t: TwoStage, V: np.ndarray, difference: sp.csr_array, true: tuple) -> sp.csr_array:
    """J = −V⁻¹ Zᵀ (V H) Z. The blocks of the two ends are added up before the product that has the most entries."""
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
