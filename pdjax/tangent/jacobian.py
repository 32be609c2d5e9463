"""The exact Jacobian J = ∂f/∂u of a body: as JVP, dense, sparse.

Forward differentiation of the force density is the reference (`jvp`, dense `jacobian`). The sparse matrix is
assembled from structure (`pdjax.tangent.assembly`) or, for a check, probed along colours (`pdjax.tangent.coloring`).
V J is symmetric for hyperelastic models; J itself only for equal volumes.
"""

import equinox as eqx
import jax
from jaxtyping import Array, Float

from .._internal.checks import choice
from .._internal.public import public_function
from ..force.fields import body_state, point_field
from ..force.operator import ForceOperator, force_operator
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from .assembly import sparse_jacobian
from .coloring import coloured_jacobian


@eqx.filter_jit
def _along(operator: ForceOperator, u: Array, v: Array, F: Array | None) -> Array:
    return jax.jvp(lambda w: operator(w, F), (u,), (v,))[1]


@public_function
def jvp(model: AbstractModel, families: Families, u, v, F=None) -> Float[Array, "points dim"]:
    """J v, the directional derivative of the force density at u along v (points, dim) [length]."""
    operator = force_operator(model, families, mean=F is not None)
    u, v = (point_field(x, families, name).astype(families.dtype) for x, name in ((u, "u"), (v, "v")))
    return _along(operator, u, v, F)


@public_function
def jacobian(model: AbstractModel, families: Families, u, form: str = "sparse", F=None):
    """The exact Jacobian ∂f/∂u of a body, (points·dim, points·dim) [force/length^(dim+1)].

    Rows and columns run over points, then components. `form` "dense": a JAX array by `jax.jacfwd` (differentiable;
    memory grows with points²); "sparse": a scipy.sparse `csr_array` assembled from structure (`.tobsr((dim, dim))`
    for blocks); "coloured": the same matrix probed by JVPs along colours, for a check or a model of your own whose
    families are too large for the structure. Arguments and errors otherwise as `force_density`.
    """
    choice("form", form, ("sparse", "dense", "coloured"))
    if form == "coloured":
        return coloured_jacobian(model, families, u, F)
    u, F = body_state(model, families, u, F)
    if form == "sparse":
        return sparse_jacobian(model, families, u, F)
    return _dense(force_operator(model, families, mean=F is not None), u.astype(families.dtype), F)


@eqx.filter_jit
def _dense(operator: ForceOperator, u: Array, F: Array | None) -> Array:
    return jax.jacfwd(lambda w: operator(w, F))(u).reshape(u.size, u.size)
