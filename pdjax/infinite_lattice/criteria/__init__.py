"""Stability criteria, from cheap to decisive, behind one function.

Each criterion is a function (model, family, F) → `Outcome`; a new one is a small function and a line in `CRITERIA`.
Criteria that search a Brillouin zone take it as a fourth argument. Source of the ladder: Silling 2017 (material),
Behzadinasab & Foster (diagonal, continuum), Born & Huang 1954 (symbol).
"""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import choice, deformation_gradient, frozen, is_concrete, on_device
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..brillouin import Zone, brillouin_zone, default_intervals
from ..lattice_states import check_at_rest
from .continuum import continuum
from .on_host import outcomes
from .outcome import Outcome, Stability, margin_tolerance, verdicts
from .point import block, diagonal, material, material_center, material_neighbour
from .waves import affine, local, symbol

CRITERIA = {
    "diagonal": diagonal,
    "block": block,
    "material": material,
    "material_center": material_center,
    "material_neighbour": material_neighbour,
    "symbol": symbol,
    "affine": affine,
    "local": local,
    "continuum": continuum,
}


def evaluate(
    criterion: str,
    model: AbstractModel,
    family: LatticeFamily,
    F: Float[Array, "dim dim"],
    zone: Zone,
    at=None,
    fastest=False,
) -> Outcome:
    """The named criterion, unjitted and unchecked: what drivers trace. `at`: an earlier `Outcome.at`, to skip the
    search; `fastest`: "symbol" also looks for the largest eigenvalue itself."""
    if criterion == "symbol":
        return symbol(model, family, F, zone, at, fastest)
    return CRITERIA[criterion](model, family, F, at)  # type: ignore[operator]


def family_zone(family: LatticeFamily, symmetry: str, resolution: int | None) -> Zone:
    """The Brillouin zone of a family; `resolution` None: the default for its reach."""
    if resolution is None:
        resolution = default_intervals(family.reach)
    if not (isinstance(resolution, int) and resolution >= 2):
        raise ValueError(f"resolution must be an integer >= 2 (grid intervals from 0 to π/h); got {resolution!r}")
    return brillouin_zone(family.dim, resolution, symmetry)


def kept_symmetry(F, family: LatticeFamily, isotropic: bool) -> str:
    """The symmetry of the deformed lattice, as far as a concrete F shows it."""
    if not (family.cubic and isotropic and is_concrete(F)):
        return "inversion"
    F = np.asarray(F)
    stretch = np.diag(F)
    if (F != np.diag(stretch)).any():
        return "inversion"
    if (stretch == stretch[0]).all():
        return "cubic"
    return "tetragonal" if (stretch[1:] == stretch[1]).all() else "orthorhombic"


@eqx.filter_jit
def _stability(model, family, F, criterion: str, intervals: int, symmetry: str) -> Outcome:
    zone = brillouin_zone(family.dim, intervals, symmetry)
    return evaluate(criterion, model, family, F, zone, fastest=True)


@eqx.filter_jit
def _with_derivative(model, family, F, criterion: str, intervals: int, symmetry: str, found: Outcome) -> Outcome:
    """What was `found`, with the derivatives that it has where the search ended."""
    zone = brillouin_zone(family.dim, intervals, symmetry)
    return evaluate(criterion, model, family, F, zone, found.at, fastest=True)


@public_function
def stability(
    model: AbstractModel, family: LatticeFamily, F, criterion: str = "symbol", resolution: int | None = None
) -> Stability:
    """Is the infinite lattice stable under the homogeneous deformation x = F X?

    Arguments: F (dim, dim) [-], det F > 0; criterion one of `CRITERIA`; resolution: grid intervals from 0 to
        π/h along each axis of the Brillouin zone ("symbol"; default 8 for each spacing of the horizon).
    Returns: `Stability` (.verdict, .margin, .eigenvalue, .wave_vector, .mode), differentiable by the envelope theorem.
    Raises: ValueError for an unknown criterion, det F ≤ 0, a singular family, a law unstable at rest (λ + 2μ ≤ 0) or
        without a local form. Derivatives of the margin are exact to first order, no further.
    """
    choice("criterion", criterion, list(CRITERIA))
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    zone = family_zone(family, kept_symmetry(F, family, model.isotropic), resolution)
    quiet = quiet_model, quiet_family, quiet_F = frozen((model, family, F))
    if is_concrete(quiet):
        out = outcomes(criterion, quiet_model, quiet_family, np.asarray(quiet_F)[None], zone)
        out = jax.tree.map(lambda x: x[0], out)
        if not is_concrete(model, family, F):  # a derivative flows through: the quotient where the search has ended
            out = _with_derivative(model, family, F, criterion, zone.intervals, zone.symmetry, out)
    else:
        check_at_rest(model, family)
        out = _stability(model, family, F, criterion, zone.intervals, zone.symmetry)
    tolerance = margin_tolerance(family.xi.dtype, out.scale)
    numbers: Any = on_device((out.margin, out.eigenvalue, out.mode, out.wave_vector, out.direction, tolerance))
    margin, eigenvalue, mode, wave_vector, direction, tolerance = numbers
    resolution = zone.intervals if criterion == "symbol" else None
    return Stability(criterion, margin, eigenvalue, mode, wave_vector, direction, tolerance, resolution)


__all__ = [
    "CRITERIA",
    "Outcome",
    "Stability",
    "check_at_rest",
    "evaluate",
    "family_zone",
    "kept_symmetry",
    "margin_tolerance",
    "stability",
    "verdicts",
]
