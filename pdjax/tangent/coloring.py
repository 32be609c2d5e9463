"""The Jacobian of a body by coloured directional derivatives: for models whose structure is not known.

Columns of J that share no row can be probed together. The rows that meet column j are known before any number is,
from the families and the rings of the model: the points within `rings` bonds of j. Points of one colour are further
apart than two such neighbourhoods (a distance-2 colouring of the pattern, greedy in the order of the points), so

    J v,   v = e_k on all points of one colour,

holds dim·colours columns' worth of entries of J, each at its own place. Forward differentiation: exact to rounding.
Colours are at least the largest number of points in a row of J: in 3D that is hundreds, and a small body has no two
points of one colour. Sources: Curtis, Powell & Reid 1974; Gebremedhin, Manne & Pothen 2005.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jaxtyping import Array, Float, Int

from ..force.fields import body_state
from ..force.operator import ForceOperator, force_operator
from ..geometry.bonds import Families
from ..models.base import AbstractModel


def jacobian_pattern(families: Families, rings: int) -> sp.csr_array:
    """Which points' displacements reach which points' forces, (points, points): true bonds, `rings` of them."""
    i, slot = np.nonzero(np.asarray(families.weight) > 0)
    j = np.asarray(families.neighbours)[i, slot]
    here = np.arange(len(families))
    rows, cols = np.concatenate([i, here]), np.concatenate([j, here])
    near = sp.coo_array((np.ones(len(rows), dtype=np.int32), (rows, cols)), shape=(len(families),) * 2).tocsr()
    near = ((near + near.T) > 0).astype(np.int32)  # a bond that weighs nothing from one end may from the other
    pattern = near
    for _ in range(rings - 1):
        pattern = ((pattern @ near) > 0).astype(np.int32)
    pattern.sort_indices()
    return pattern


def colouring(pattern: sp.csr_array) -> Int[np.ndarray, " points"]:
    """A colour 0, 1, … for every column of a symmetric pattern: two columns that meet in a row differ."""
    points = pattern.shape[0]
    colours = np.full(points, -1)
    taken = np.zeros((points, int(np.diff(pattern.indptr).max()) + 1), dtype=bool)  # (row, colour); grows if need be
    for column in range(points):
        rows = pattern.indices[pattern.indptr[column] : pattern.indptr[column + 1]]
        free = ~taken[rows].any(axis=0)
        if not free.any():
            free = np.append(free, True)
            taken = np.concatenate([taken, np.zeros((points, 16), dtype=bool)], axis=1)
        colours[column] = np.argmax(free)
        taken[rows, colours[column]] = True
    return colours


@eqx.filter_jit
def _probes(
    operator: ForceOperator, u: Array, F: Array | None, colours: Array | np.ndarray, count: int
) -> Float[Array, "colours dim points dim"]:
    """∂f/∂(all points of a colour along an axis), for every colour and axis."""
    _, push = jax.linearize(lambda w: operator(w, F), u)
    axes = jnp.eye(u.shape[1], dtype=u.dtype)

    def one(colour):
        mine = (colours == colour).astype(u.dtype)
        return jax.vmap(lambda axis: push(mine[:, None] * axis))(axes)

    return jax.lax.map(one, jnp.arange(count))


def coloured_jacobian(model: AbstractModel, families: Families, u, F=None) -> sp.csr_array:
    """∂f/∂u of a body by coloured JVPs, (points·dim, points·dim) [force/length^(dim+1)].

    Rows and columns run over points, then components; the pattern is that of the model's rings, zeros included.
    Arguments: u (points, dim) [length]; F (dim, dim) a mean deformation or None, as in `force_density`.
    Raises: ValueError as `force_density`.
    """
    u, F = body_state(model, families, u, F)
    operator = force_operator(model, families, mean=F is not None)
    pattern = jacobian_pattern(families, model.rings)
    colours = colouring(pattern)
    probes = np.asarray(_probes(operator, u.astype(families.dtype), F, colours, int(colours.max()) + 1))
    i, j = np.repeat(np.arange(len(families)), np.diff(pattern.indptr)), pattern.indices
    blocks = probes[colours[j], :, i, :].transpose(0, 2, 1)  # [component of f, component of u]
    size = len(families) * families.dim
    return sp.bsr_array((blocks, j, pattern.indptr), shape=(size, size)).tocsr()
