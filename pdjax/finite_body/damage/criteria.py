"""What a breaking criterion is: which bonds of a deformed body break now.

A criterion defines `exceeded(model, families, bonds)`, an array of bool (points, bonds). It says for every bond, seen
from one end, whether the bond breaks. `broken` makes the answer of the criterion from it:

    a bond breaks if either end says so, it exists, it has not broken before, and no end lies in the no-fail zone

Both ends of a bond therefore agree, and padding never counts. `broken` uses the present weights of the families and
works inside `jax.jit` and `jax.lax.scan`. A criterion is a pytree: its constants may be traced.

A broken bond stays broken: `families.with_broken(broken)` gives the families after the break. To use a criterion step
by step, call `broken` with the families of the step before.
"""

from typing import Any

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._internal.checks import native
from ..._internal.shown import shown
from ...force.fields import body_state
from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel


def _mask(points: Any) -> Array | None:
    """The no-fail zone as an array of bool, (points,) or (points, bonds)."""
    if points is None or isinstance(points, jax.Array):
        return points
    mask = native("no_fail", points)
    if mask.dtype != bool or mask.ndim not in (1, 2):
        raise ValueError(
            f"no_fail must be a mask of bool, shape (points,) or (points, bonds); got shape {mask.shape} of"
            f" {mask.dtype}"
        )
    return jax.device_put(np.array(mask))


class Criterion(eqx.Module):
    """Base class of the breaking criteria. A subclass defines `exceeded`, and `refusal` if it cannot serve every model.

    Attributes
    ----------
    no_fail : array of bool, shape (points,) or (points, bonds), or None
        Points whose bonds never break, for example where supports or loads act. Or bonds that never break, for example
        all that do not cross a weak interface. None: all bonds may break.
    """

    no_fail: Bool[Array, " points"] | Bool[Array, "points bonds"] | None = eqx.field(
        default=None, converter=_mask, kw_only=True
    )

    def protected(self, families: Families) -> Bool[Array, "points bonds"] | None:
        """The bonds of the no-fail zone, the same at both ends of a bond. None if there is no such zone."""
        if self.no_fail is None:
            return None
        if self.no_fail.ndim == 1:
            return self.no_fail[:, None] | self.no_fail[families.neighbours]
        return self.no_fail | self.no_fail[families.neighbours, families.reverse]

    def __repr__(self) -> str:
        return shown(self)

    def refusal(self, model: AbstractModel) -> str | None:
        """Why the criterion cannot serve this model, and which models it can serve. None if it can."""
        return None

    def exceeded(self, model: AbstractModel, families: Families, bonds: Bonds) -> Bool[Array, "points bonds"]:
        """Whether each bond breaks, seen from the point to which it belongs. The value for padding is ignored."""
        raise NotImplementedError(f"{type(self).__name__} defines no exceeded(model, families, bonds)")

    def overload(self, model: AbstractModel, families: Families, bonds: Bonds) -> Float[Array, "points bonds"] | None:
        """The measure of each bond over its critical value [-], above 1 where it breaks. None without a measure."""
        return None

    @property
    def smooth(self) -> bool:
        """Whether bonds lose their force gradually, so that `left` gives shares and a run has derivatives."""
        return False

    def limit(self, families: Families) -> Array | None:
        """The critical stretch, one number or one for each bond, if the criterion is one and not smooth; else None."""
        return None

    def left(
        self,
        model: AbstractModel,
        families: Families,
        u: Float[Array, "points dim"],
        share: Bool[Array, "points bonds"] | Float[Array, "points bonds"],
    ) -> Bool[Array, "points bonds"] | Float[Array, "points bonds"]:
        """What is left of every bond after the break at u: True or False, or a share of it from 0 to 1.

        `families` are those before the first break, and `share` is what was left of every bond before.
        """
        return share & ~exceeding(self, model, families.with_share(share), u, None)

    def check(self, model: AbstractModel, families: Families) -> None:
        """Raise ValueError if the criterion cannot serve the model, or its arrays do not belong to this body."""
        why = self.refusal(model)
        if why is not None:
            raise ValueError(why)
        shapes = (len(families),), families.weight.shape
        if self.no_fail is not None and self.no_fail.shape not in shapes:
            raise ValueError(
                f"no_fail must have one entry for each of the {len(families)} points, shape {shapes[0]}, or one for"
                f" each bond, shape {shapes[1]}; got shape {self.no_fail.shape}"
            )

    def broken(self, model: AbstractModel, families: Families, u, F=None) -> Bool[Array, "points bonds"]:
        """Find the bonds that break at a displacement.

        Parameters
        ----------
        model : AbstractModel
            The material model.
        families : Families
            Families of the body. Bonds of weight 0 have broken before.
        u : array, shape (points, dim)
            Displacements [length].
        F : array, shape (dim, dim), optional
            Homogeneous deformation gradient [-] under the displacement. Default: the identity.

        Returns
        -------
        array of bool, shape (points, bonds)
            True for the bonds that break now, in the families of both ends.

        Raises
        ------
        ValueError
            If the criterion cannot serve the model; the message names those that it can. If an array of the criterion
            does not have one entry for each point. If u or F is wrong.
        """
        u, F = body_state(model, families, u, F)
        self.check(model, families)
        return _broken(self, model, families, u, F)


def exceeding(
    criterion: Criterion, model: AbstractModel, families: Families, u: Array, F: Array | None
) -> Bool[Array, "points bonds"]:
    """`Criterion.broken` without checks, for functions that trace it."""
    back = families.neighbours, families.reverse
    hit = criterion.exceeded(model, families, families.bonds(u, F))
    here = families.weight > 0
    hit = (hit & here) | (hit[back] & here[back])  # with two horizons a bond may have a weight at one end only
    protected = criterion.protected(families)
    if protected is not None:
        hit &= ~protected
    return hit & families.is_bond


_broken = eqx.filter_jit(exceeding)
