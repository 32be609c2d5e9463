"""The interface of a backend, which computes the forces of one model on one body.

A backend is a module with two functions, and one line in `pdjax.force.operator.BACKENDS`:

    refusal(model, families) -> str | None     why the backend cannot evaluate this model and body, or None if it can
    prepare(model, families) -> Backend        the backend, with everything prepared that does not depend on u
"""

from abc import abstractmethod
from typing import ClassVar, Protocol

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._internal.checks import is_concrete
from ..._internal.memory import remember
from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel


class Backend(eqx.Module):
    """A prepared backend. The model is an argument of `force`, so that its constants can be differentiated."""

    takes_mean: ClassVar[bool] = True  # whether `force` accepts a mean deformation F
    takes_complex: ClassVar[bool] = False  # whether `force` accepts complex displacements
    quick: ClassVar[bool] = False  # compiles with the options QUICK, where its program runs as fast with them

    def sums(self, model: AbstractModel) -> Float[Array, "entries points"] | None:
        """The reference sums of a model that takes them over the bonds that remain, if this backend keeps them."""
        return None

    def new_sums(
        self,
        model: AbstractModel,
        sums: Float[Array, "entries points"],
        bonds: Bonds,
        points: Int[Array, " few"],
        real: Bool[Array, " few"],
    ) -> Float[Array, "entries points"]:
        """The `sums` after the bonds of few points have changed to `bonds` (few, bonds).

        `model` has the constants of these points. Entries of `points` that are not `real` are ignored.
        """
        raise NotImplementedError(f"the backend {type(self).__name__} keeps no reference sums")

    def with_share(
        self,
        model: AbstractModel,
        share: Bool[Array, "points bonds"] | Float[Array, "points bonds"],
        sums: Float[Array, "entries points"] | None,
    ) -> "Backend":
        """The backend of the body in which every bond keeps a share of its weight.

        Models that keep the reference sums (`keeps_reference`) take them over the intact family, others over the bonds
        that remain. `sums` are the latter, if they are known.
        """
        raise NotImplementedError(f"the backend {type(self).__name__} evaluates no broken bonds")

    def breaking(
        self,
        model: AbstractModel,
        u: Float[Array, "points dim"],
        alive: Bool[Array, "points bonds"],
        limit: Array,
        sums: Float[Array, "entries points"] | None,
    ) -> tuple[Float[Array, "points dim"], Bool[Array, "points bonds"]] | None:
        """f of the bonds that are alive, and those that are stretched above `limit`, in one loop over the bonds.

        `sums` as in `with_share`. None if this backend or model has no such loop.
        """
        return None

    def energy(
        self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None
    ) -> Float[Array, " points"] | None:
        """W of every point [energy/length^dim], or None if this backend has no fast way to compute it."""
        return None

    @abstractmethod
    def force(self, model: AbstractModel, u: Float[Array, "points dim"], F: Array | None) -> Float[Array, "points dim"]:
        """f of every point [force/length^dim]. F is a mean deformation gradient or None."""


class BackendModule(Protocol):
    """A module that implements a backend. The module docstring describes its two functions."""

    def refusal(self, model: AbstractModel, families: Families) -> str | None: ...

    def prepare(self, model: AbstractModel, families: Families) -> Backend: ...


def lattice_refusal(model: AbstractModel, families: Families) -> str | None:
    """Why a backend for lattices and models made of moments cannot be used, or None if it can."""
    if families.grid is None or not _equal_volumes(families):
        return (
            "the families do not come from a lattice (`pd.lattice`, `bar`, `plate` or `cuboid`, with equal volumes and"
            " without bond weights)"
        )
    if not model.by_moments:
        return f"{type(model).__name__} has no point state made of sums over single bonds"
    return None


def _equal_volumes(families: Families) -> bool:
    """Whether all points have equal volumes. Traced volumes are assumed equal."""
    if not is_concrete(families.volumes):
        return True

    def found() -> bool:
        volumes = np.asarray(families.volumes)
        return bool((np.abs(volumes - volumes[0]) <= 1e-6 * volumes[0]).all())

    return remember(families, "alike", found)
