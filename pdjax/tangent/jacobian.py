"""The exact Jacobian J = ∂f/∂u of a body: products J v, a dense matrix, or a sparse matrix.

`jvp` and the dense matrix use forward differentiation of the force density. They are the reference. The sparse matrix
is assembled from the linearised families (`pdjax.tangent.assembly`). Coloured directional derivatives give the same
matrix as a check (`pdjax.tangent.coloring`). With V the diagonal matrix of the volumes, V J is symmetric for
hyperelastic models. J itself is symmetric only if all volumes are equal.
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
    """Compute the product of the Jacobian with a vector, without the matrix.

    J v = d/dε f(u + ε v) at ε = 0

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length] at which f is linearised.
    v : array, shape (points, dim)
        Direction [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    array, shape (points, dim)
        J v [force/length^dim].

    Raises
    ------
    ValueError
        If u, v or F has a wrong shape or is not finite, det F ≤ 0, or the model cannot invert a shape tensor.

    Examples
    --------
    Two points of volume 1 are joined by a spring of constant 1. Point 1 moves away by 1.

    >>> families = pd.families(pd.lattice((2,)), horizon=1.0)
    >>> Jv = pd.jvp(pd.BondBased(1.0), families, np.zeros((2, 1)), np.array([[0.0], [1.0]]))
    >>> np.asarray(Jv).ravel().tolist()
    [1.0, -1.0]
    """
    operator = force_operator(model, families, mean=F is not None)
    u, v = (point_field(x, families, name).astype(families.dtype) for x, name in ((u, "u"), (v, "v")))
    return _along(operator, u, v, F)


@public_function
def jacobian(model: AbstractModel, families: Families, u, form: str = "sparse", F=None):
    """Compute the exact Jacobian ∂f/∂u of a body.

    J_(iα)(jβ) = ∂f_iα/∂u_jβ

    Rows and columns run over the points, and for each point over its components.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length] at which f is linearised.
    form : {"sparse", "dense", "coloured"}, optional
        "sparse" assembles a matrix from the linearised families. "dense" uses `jax.jacfwd`. "coloured" computes the
        sparse matrix from directional derivatives instead.
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    scipy.sparse.csr_array or array, shape (points·dim, points·dim)
        J [force/length^(dim+1)]. "dense" gives a JAX array, the other forms a `csr_array`.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, det F ≤ 0, the model cannot invert a shape tensor, `form` is none
        of the values above, or the families were made with `arrays=False`.

    Notes
    -----
    The dense form can be differentiated, and its memory grows with the square of the number of points. Use the coloured
    form as a check, or for a model of your own whose families are too large for the assembly. The method
    `.tobsr((dim, dim))` of a sparse result gives its blocks.

    Examples
    --------
    Two points of volume 1 are joined by a spring of constant 1.

    >>> families = pd.families(pd.lattice((2,)), horizon=1.0)
    >>> J = pd.jacobian(pd.BondBased(1.0), families, np.zeros((2, 1)))
    >>> J.toarray().tolist()
    [[-1.0, 1.0], [1.0, -1.0]]
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
