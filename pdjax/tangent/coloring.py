"""The sparse Jacobian of a body by coloured directional derivatives, for models of any structure.

One directional derivative gives several columns of J at once if no two of them have an entry in the same row. The
pattern of J follows from the families and from the number of rings that the model reaches: column j has entries in the
rows of all points within `rings` bonds of j. A greedy distance-2 colouring of this pattern gives two points different
colours if their columns meet in a row. Then

    J v,   v = e_k on all points of one colour and 0 elsewhere,

contains the entries of the columns (j, k) of all points j of that colour, each in its own row. One such product for
every colour and every axis k gives all of J. Forward differentiation makes the entries exact to rounding.

The number of colours is at least the largest number of points in a row of J. In 3D this means hundreds of colours, and
in a small body every point has its own. Sources: Curtis, Powell & Reid 1974; Gebremedhin, Manne & Pothen 2005.
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
    """The pattern (points, points) of J: which displacements affect which forces, by up to `rings` bonds in a row."""
    i, slot = np.nonzero(np.asarray(families.weight) > 0)
    j = np.asarray(families.neighbours)[i, slot]
    here = np.arange(len(families))
    rows, cols = np.concatenate([i, here]), np.concatenate([j, here])
    near = sp.coo_array((np.ones(len(rows), dtype=np.int32), (rows, cols)), shape=(len(families),) * 2).tocsr()
    near = ((near + near.T) > 0).astype(np.int32)  # one of the two directions of a bond may have weight 0
    pattern = near
    for _ in range(rings - 1):
        pattern = ((pattern @ near) > 0).astype(np.int32)
    pattern.sort_indices()
    return pattern


def colouring(pattern: sp.csr_array) -> Int[np.ndarray, " points"]:
    """A colour 0, 1, … for every column of a symmetric pattern. Columns that meet in a row have different colours."""
    points = pattern.shape[0]
    colours = np.full(points, -1)
    taken = np.zeros((points, int(np.diff(pattern.indptr).max()) + 1), dtype=bool)  # (row, colour), widened if needed
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
    """The derivative of f along every axis, with all points of one colour moving together, for every colour."""
    _, push = jax.linearize(lambda w: operator(w, F), u)
    axes = jnp.eye(u.shape[1], dtype=u.dtype)

    def one(colour):
        mine = (colours == colour).astype(u.dtype)
        return jax.vmap(lambda axis: push(mine[:, None] * axis))(axes)

    return jax.lax.map(one, jnp.arange(count))


def coloured_jacobian(model: AbstractModel, families: Families, u, F=None) -> sp.csr_array:
    """∂f/∂u of a body by coloured JVPs, (points·dim, points·dim) [force/length^(dim+1)].

    Rows and columns run over the points, then over components. The matrix stores every entry of the pattern, zeros
    included. u (points, dim) [length] and F (dim, dim), a mean deformation or None, are as in `jacobian`.
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
