"""The exact Jacobian J = ∂f/∂u of a body: as JVP, dense, sparse.

Forward differentiation of the force density is the reference (`jvp`, dense `jacobian`). The sparse matrix is
assembled from structure (`pdjax.assembly`) or, for a check, probed along colours (`pdjax.coloring`).
V J is symmetric for hyperelastic models; J itself only for equal volumes.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._checks import choice
from .assembly import sparse_jacobian
from .coloring import coloured_jacobian
from .evaluate import force_density
from .force import body_bonds, check_model, point_field
from .models.base import AbstractModel
from .neighbours import Families


def jvp(model: AbstractModel, fams: Families, u, v, F=None) -> Float[Array, "points dim"]:
    """J v, the directional derivative of the force density at u along v (points, dim) [length]."""
    check_model(model, fams, Families)
    u, v = (point_field(x, fams, name).astype(fams.dtype) for x, name in ((u, "u"), (v, "v")))
    return jax.jvp(lambda w: force_density(model, fams, w, F), (u,), (v,))[1]


def jacobian(model: AbstractModel, fams: Families, u, form: str = "sparse", F=None):
    """The exact Jacobian ∂f/∂u of a body, (points·dim, points·dim) [force/length^(dim+1)].

    Rows and columns run over points, then components. `form` "dense": a JAX array by `jax.jacfwd` (differentiable;
    memory grows with points²); "sparse": a scipy.sparse `csr_array` assembled from structure (`.tobsr((dim, dim))`
    for blocks); "coloured": the same matrix probed by JVPs along colours, for a check or a model of your own whose
    families are too large for the structure. Arguments and errors otherwise as `force_density`.
    """
    choice("form", form, ("sparse", "dense", "coloured"))
    if form == "coloured":
        return coloured_jacobian(model, fams, u, F)
    bonds = body_bonds(model, fams, u, F)
    if form == "sparse":
        return sparse_jacobian(model, fams, bonds)
    return _dense(model, fams, jnp.asarray(u, dtype=fams.xi.dtype), F)


@eqx.filter_jit
def _dense(model, fams, u, F):
    n = u.size
    return jax.jacfwd(lambda w: force_density(model, fams, w, F))(u).reshape(n, n)
