"""The part of the Brillouin zone that the criterion "symbol" searches, for a family and a deformation."""

import numpy as np

from ..._internal.checks import is_concrete
from ...geometry.bonds import LatticeFamily
from ..brillouin import Zone, brillouin_zone, default_intervals, is_judging


def family_zone(family: LatticeFamily, symmetry: str, resolution: int | None) -> Zone:
    """The Brillouin zone of a family. If `resolution` is None, the horizon of the family sets it."""
    if resolution is None:
        resolution = default_intervals(family.reach)
    elif is_judging() and isinstance(resolution, int):
        resolution *= 2
    if not (isinstance(resolution, int) and resolution >= 2):
        raise ValueError(f"resolution must be an integer >= 2 (grid intervals from 0 to π/h); got {resolution!r}")
    return brillouin_zone(family.dim, resolution, symmetry)


def kept_symmetry(F, family: LatticeFamily, isotropic: bool) -> str:
    """The symmetry of the deformed lattice, which is "inversion" if F is traced."""
    if not (family.cubic and isotropic and is_concrete(F)):
        return "inversion"
    F = np.asarray(F)
    stretch = np.diag(F)
    if (F != np.diag(stretch)).any():
        return "inversion"
    if (stretch == stretch[0]).all():
        return "cubic"
    return "tetragonal" if (stretch[1:] == stretch[1]).all() else "orthorhombic"
