"""A bar, plate or block that is pulled at both ends and has free sides: the scene that shows the errors of surfaces."""

import functools
import math
from collections.abc import Callable

import equinox as eqx
import numpy as np

from .._internal.checks import choice, on_host
from ..finite_body import conditions
from ..finite_body.scene import Scene, scene
from ..force.fields import piola_stress
from ..force.surface_correction import METHODS, surface_correction
from ..geometry.bonds import lattice_family
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..infinite_lattice.paths import uniaxial_stress
from ..models.base import AbstractModel
from .bodies import checked_count, checked_ratio


def pulled_plate(
    shape,
    N: float,
    model: AbstractModel,
    strain: float = 1e-6,
    influence: Callable | str = "constant",
    correction: str | Callable | None = None,
    layer: int | None = None,
) -> Scene:
    """Make a lattice in 1D to 3D that is pulled along its first axis, with free sides.

    An even body force in a layer at each end has the stress P₁₁ that stretches an infinite lattice by `strain` with
    free sides. The closed form is this homogeneous deformation, u = (F − I)(X − X_c). The solution differs from it near
    the ends. In the middle it differs only because the families at the surfaces are not full.

    Parameters
    ----------
    shape : tuple of int
        Number of points along each axis. The spacing is 1.
    N : float
        Horizon over spacing [-].
    model : AbstractModel
        The material model.
    strain : float, optional
        Stretch minus one [-] along the first axis, > −1. Default 1e-6, so that the problem is linear.
    influence : callable or str, optional
        Influence function, or its name, such as "partial volume".
    correction : {None, "energy", "volume"} or callable, optional
        The method of `surface_correction`, a function (model, families) → bond weights, or None for no correction.
    layer : int, optional
        Number of points along the first axis that carry the load at each end. Default: one horizon.

    Returns
    -------
    Scene
        The problem, with its closed form. The point X_c in the middle is held, and others as far as is needed to
        prevent a rotation. They carry no force.

    Raises
    ------
    ValueError
        If the body is too short for two layers and a middle, the method is unknown, or the infinite lattice has no
        stress-free sides at this strain.

    References
    ----------
    Le & Bobaru 2018 (the test of surface corrections)

    Examples
    --------
    >>> model = pd.LPS.from_young(young=1.0, poisson=0.25, dim=2, plane="stress")
    >>> scene = pd.scenes.pulled_plate((30, 10), 3.015, model, correction="energy")
    >>> u = np.asarray(pd.solve(scene).u)
    >>> def middle(u):
    ...     return u.reshape(30, 10, 2)[20, 5, 0] - u.reshape(30, 10, 2)[10, 5, 0]
    >>> round(float(middle(u) / middle(np.asarray(scene.closed_form)) - 1), 3)
    -0.014
    """
    N, cells = checked_ratio(N), tuple(int(s) for s in shape)
    layer = math.ceil(N * (1 - 1e-9)) if layer is None else checked_count("layer", layer, 1)
    if cells[0] < 2 * layer + 3:
        raise ValueError(
            f"the first axis must have at least {2 * layer + 3} points, two layers of {layer} and a middle; got shape"
            f" {cells}"
        )
    if correction is not None and not callable(correction):
        method = choice("correction", correction, METHODS)
        correction = functools.partial(surface_correction, method=method)
    body = lattice(cells)
    family = lattice_family(body.dim, N, influence=influence)
    F = on_host(eqx.filter_jit(uniaxial_stress)(strain, model, family))
    if not np.isfinite(F).all():
        raise ValueError(f"the lattice has no deformation with free sides at the strain {strain}; take a smaller one")
    stress = float(on_host(piola_stress(model, family, F))[0, 0])
    found = families(body, N, influence)
    if callable(correction):
        found = found.with_weight(correction(model, found))
    along = np.indices(cells)[0].ravel()
    force = np.zeros((len(body), body.dim))
    force[along < layer, 0], force[along >= cells[0] - layer, 0] = -stress / layer, stress / layer
    loaded = np.flatnonzero(force[:, 0])
    middle = [n // 2 for n in cells]
    at = body.positions[np.ravel_multi_index(middle, cells)]
    return scene(
        body,
        found,
        model,
        *_supports(cells, middle),
        conditions.body_force(loaded, force[loaded]),
        closed_form=(body.positions - at) @ (F - np.eye(body.dim)).T,
        name="pulled plate",
    )


def _supports(cells: tuple[int, ...], middle: list[int]) -> list[conditions.Condition]:
    """The middle point, and points beside it whose lateral components prevent rotations."""
    dim = len(cells)
    beside = [list(middle) for _ in range(dim)]
    for k in range(dim):
        beside[k][k] += 1 if middle[k] + 1 < cells[k] else -1
    held: dict[int, list[int]] = {int(np.ravel_multi_index(middle, cells)): list(range(dim))}
    for k in range(dim):
        if cells[k] == 1 and k < dim - 1:
            raise ValueError(f"shape must have at least 2 points along axis {k}; got {cells}")
        others = list(range(k + 1, dim))
        if others:
            held[int(np.ravel_multi_index(beside[k], cells))] = others
    return [conditions.prescribe([point], 0.0, components) for point, components in held.items()]
