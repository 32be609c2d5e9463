"""`audit`: whether a computed state of a body can be trusted, point by point and as a whole.

The state may come from pdjax or from another code. `audit` needs the points, the displacement and the model that the
code claims to use. It asks three questions:

* Do the points deform smoothly, or in zero-energy modes (`pdjax.trust.point_measures`)?
* Is the lattice stable under the stretch of every point (`pdjax.trust.own_lattice`)?
* Is the body itself stable, rigid motions excluded (`pdjax.finite_body.free_spectrum`)?

`pdjax.trust.checks` turns the answers into a verdict.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from .._internal.public import public_function
from ..force.fields import body_state
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from .auditor import Auditor
from .given_forces import compared_forces
from .verdict import Audit


def held_components(held: Any, families: Families) -> np.ndarray:
    """`held` as a mask (points, dim). None holds nothing; a mask (points,) holds all components of its points."""
    shape = (len(families), families.dim)
    if held is None:
        return np.zeros(shape, bool)
    mask = np.asarray(held)
    if mask.dtype != bool or mask.shape not in (shape, shape[:1]):
        raise ValueError(
            f"held must be a bool mask of shape {shape[:1]} or {shape}, True where the body is supported; got"
            f" {mask.dtype} of shape {mask.shape}"
        )
    return np.broadcast_to(mask[:, None], shape) if mask.ndim == 1 else mask


@public_function
def audit(
    model: AbstractModel,
    families: Families,
    u: Float[Any, "points dim"],
    *,
    F=None,
    held=None,
    force=None,
    given_density=None,
    margins: bool = True,
    body: bool = True,
) -> Audit:
    """Decide whether a computed state of a body can be trusted.

    Parameters
    ----------
    model : AbstractModel
        The material model with which the state was computed.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
    held : array of bool, shape (points,) or (points, dim), optional
        Supported points or components, such as `~scene.free`. The default supports nothing, and rigid motions do not
        count as instabilities. Pass it if there are clamps: the strain jumps at their edges.
    force : array, shape (points, dim), optional
        Internal forces V f [force] that another code has computed for this state. They are compared with pdjax's.
    given_density : array, shape (points, dim), optional
        The same as a force density f [force/length^dim].
    margins : bool, optional
        Whether to judge the infinite lattice under the stretch of every point. Default True.
    body : bool, optional
        Whether to compute the largest eigenvalue of the Jacobian of the body. Default True. It is left out for bodies
        of more than 60 000 unknowns in 2D and 15 000 in 3D, with a note.

    Returns
    -------
    Audit
        The verdict, what was found and where, and the measures of all points.

    Raises
    ------
    ValueError
        If an array has a wrong shape or is not finite, if the model cannot invert a shape tensor, or if the constants
        of the model take more than 8 values over the points.

    Notes
    -----
    `pdjax.trust.checks` lists the checks and their limits. For a body that is no lattice, margins are those of the
    lattice of spacing V^{1/dim}, and a note says so. A state may be trusted and still be wrong: the audit does not know
    the loads, and it does not compare with a finer discretisation.

    References
    ----------
    Silling 2017 (zero-energy penalty); Falk & Langer 1998 (non-affine displacement); Haynsworth 1968 (inertia).

    Examples
    --------
    Silling's model does not feel a checkerboard. The audit does.

    >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> checkerboard = 0.01 * (-1.0) ** np.indices((6, 5)).sum(axis=0).reshape(-1, 1) * np.ones(2)
    >>> state = pd.audit(model, families, checkerboard)
    >>> state.verdict, state.findings[0].check, float(state.zero_energy.max().round(1))
    ('untrusted', 'zero-energy mode', 1.0)
    """
    displacement, gradient = body_state(model, families, u, F)
    u, mean = np.asarray(displacement), None if gradient is None else np.asarray(gradient, float)
    auditor = Auditor(model, families, held_components(held, families))
    forces = compared_forces(auditor, u, mean, force, given_density)
    points = auditor.measures(u, mean)
    lattice = auditor.lattice(points, path=True) if margins else None
    spectrum = auditor.body(u, mean) if body else None
    return auditor.judged(u, points, lattice, spectrum, forces)
