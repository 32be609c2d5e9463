"""Forces that another code has computed for a state, beside those of the model."""

from typing import Any

import numpy as np

from .._internal.checks import finite
from ..force.operator import force_density
from .auditor import Auditor
from .checks import Forces

# Forces below this part of modulus/spacing are rounding errors of a state at rest; LAMMPS has 1e-16 (measured).
ROUNDING = 1e-12
# Given forces that differ by less than this part from a multiple of the model's are called a multiple.
MULTIPLE = 1e-3


def compared_forces(auditor: Auditor, u: np.ndarray, F: np.ndarray | None, force: Any, density: Any) -> Forces | None:
    """The differences of the given forces (points, dim), or force densities, from those of the model."""
    if force is None and density is None:
        return None
    if force is not None and density is not None:
        raise ValueError("give force or given_density, not both: force is density times volume")
    name, families = "force" if force is not None else "given_density", auditor.families
    given = finite(name, force if force is not None else density)
    if given.shape != (len(families), families.dim):
        raise ValueError(f"{name} must have shape ({len(families)}, {families.dim}); got {given.shape}")
    own = np.asarray(force_density(auditor.model, families, u, F), float)
    noise = ROUNDING * auditor.modulus.max() / float(np.asarray(auditor.family.spacing))
    if force is not None:
        own, noise = own * auditor.volumes[:, None], noise * auditor.volumes.max()
    largest = max(float(np.linalg.norm(given, axis=1).max(initial=0.0)), float(noise))
    return Forces(np.linalg.norm(own - given, axis=1) / largest, _hint(own, given, float(noise)))


def _hint(own: np.ndarray, given: np.ndarray, noise: float) -> str:
    """What explains that the given forces are not those of the model: they are zero or a multiple of them."""
    largest = float(np.linalg.norm(own, axis=1).max(initial=0.0))
    if largest <= noise or not np.isfinite(largest):
        return ""
    if not given.any():
        return ". The given forces are all zero"
    own = own / largest
    factor = float((own * given).sum() / (own * own).sum())
    rest = float(np.linalg.norm(given - factor * own) / np.linalg.norm(given))
    if rest > MULTIPLE or abs(factor / largest - 1) < MULTIPLE:
        return ""
    return (
        f". The given forces are {factor / largest:.4g} times those of the model: check their sign, their unit, the"
        " constants of the law, and whether they are forces or densities"
    )
