"""What a backend is: the forces of one model on one body, with everything that does not depend on u prepared.

A backend is a module with two functions, and one line in `pdjax.force.operator.BACKENDS`:

    refusal(model, families) -> str | None     why this model and body can't be evaluated so; None if they can
    prepare(model, families) -> Backend        the prepared backend
"""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import is_concrete
from ..._internal.memory import remember
from ...geometry.bonds import Families


class Backend(eqx.Module):
    """A prepared backend. The model stays an argument of `force`, so that its constants may be differentiated."""

    takes_mean: ClassVar[bool] = True  # a mean deformation F under the displacement
    takes_complex: ClassVar[bool] = False  # complex displacements
    compiler_options: ClassVar[dict] = {}

    @abstractmethod
    def force(self, model: Any, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point [force/length^dim]; F is a mean deformation or None."""


def lattice_refusal(model: Any, families: Families) -> str | None:
    """Why a backend for lattices and models made of moments does not apply; None if it does."""
    if families.grid is None or not _equal_volumes(families):
        return "they do not come from a lattice (`pd.lattice`, `bar`, `plate`, `cuboid`, without weights of their own)"
    if not model.by_moments:
        return f"{type(model).__name__} has no point state made of sums over single bonds"
    return None


def _equal_volumes(families: Families) -> bool:
    """Whether all points have the volume of a cell, as far as it is known."""
    if not is_concrete(families.volumes):
        return True

    def found() -> bool:
        volumes = np.asarray(families.volumes)
        return bool((np.abs(volumes - volumes[0]) <= 1e-6 * volumes[0]).all())

    return remember(families, "alike", found)
