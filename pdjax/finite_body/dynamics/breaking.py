"""Bonds that break during a run of velocity Verlet.

A step from t to t + Δt with breaking bonds:

    1. The bonds that exceed the criterion at u(t) break. They still pull in the force at t, so that their last
       half kick is that of a whole bond.
    2. u moves to t + Δt, and the force there is that of the bonds that are left.

LAMMPS breaks bonds in the same order. A bond acts for half of the step in which it breaks. The released energy is the
drop of the strain energy at the fixed displacement of that moment, t + Δt/2:

    ΔΠ = Π(ū, before) − Π(ū, after),   ū = u(t) + (Δt/2) v(t + Δt/2)

The budget K + Π + released − W_supports − W_loads + D then closes to the second order of the integrator.

BondBased and LPS keep the reference sums of the intact family (`keeps_reference`). All other models take them over the
bonds that remain, and a point whose remaining bonds no longer determine its deformation loses them all
(`pdjax.finite_body.damage.fragments`). In such a model a break may also raise the strain energy, ΔΠ < 0.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..._internal.checks import Numbers
from ...force.fields import energies
from ..damage.criteria import Criterion
from ..damage.fragments import without_fragments
from ..scene import Scene

Share = Bool[Array, "points bonds"] | Float[Array, "points bonds"]


class Broken(NamedTuple):
    """What has become of the bonds of a run.

    `alive` (points, bonds) tells which bonds act in the force of this state, or with which share, and `left` which act
    in the next. `at` (points, bonds) is the number of the step at which a bond broke, −1 if it has not: with shares,
    at which less than half of it was left. `released` is the energy [energy] that all breaks have released.
    """

    alive: Share
    left: Share
    at: Int[Array, "points bonds"]
    released: Float[Array, ""]


def check_breaking(criterion: object, scene: Scene) -> None:
    """Raise ValueError if bonds of this scene cannot break by this criterion."""
    if not isinstance(criterion, Criterion):
        raise ValueError(
            f"breaking must be a breaking criterion, such as pd.CriticalStretch(0.01); got {type(criterion).__name__}"
        )
    if scene.mean is not None:
        raise ValueError("bonds of a body with a mean deformation cannot break in a run; leave out mean")
    scene.families.need_arrays()
    criterion.check(scene.model, scene.families)


def unbroken(criterion: Criterion, scene: Scene) -> Broken:
    """The bonds of a body before any has broken: those with a weight. Made by NumPy where the families are known."""
    families = scene.families
    xp = jnp if isinstance(families.weight, jax.core.Tracer) else np
    alive = xp.asarray(families.weight) > 0
    alive = alive.astype(families.dtype) if criterion.smooth else alive
    return Broken(alive, alive, xp.full(alive.shape, -1, xp.int32), xp.zeros((), families.dtype))


def pulled(
    scene: Scene, criterion: Criterion, u: Float[Array, "points dim"], factor: Array, alive: Share
) -> tuple[Float[Array, "points dim"], Share]:
    """V (f + λ b) of the bonds that are alive, and what is left of them after the break at u.

    `scene` is prepared on padded arrays, with the way "families". For a critical stretch both come from one loop over
    the bonds.
    """
    assert scene.operator is not None
    model, families, limit = scene.model, scene.families, criterion.limit(scene.families)
    both = None
    if limit is not None and model.keeps_reference:
        both = scene.operator.backend.breaking(model, u, alive, limit)
    if both is not None:
        f, hit = both
        return families.volumes[:, None] * (f + factor * scene.load), alive & ~hit
    backend = scene.operator.backend.with_share(model, alive)
    force = eqx.tree_at(lambda s: s.operator.backend, scene, backend).unbalanced(u, factor)
    left = criterion.left(model, families, u, alive)
    if model.has_shape_tensor:
        left = jax.lax.cond(jnp.any(left != alive), lambda x: without_fragments(model, families, x), lambda x: x, left)
    return force, left


def after_break(scene: Scene, u: Float[Array, "points dim"], step: Int[Array, ""], bonds: Broken) -> Broken:
    """The bonds after the break of a step, with the energy released at u. A step without a break costs nothing."""

    def broken() -> tuple[Array, Array]:
        two = (scene.families.with_share(share) for share in (bonds.alive, bonds.left))
        W = [energies(scene.model, families, families.bonds(u)) for families in two]
        released = bonds.released + jnp.dot(scene.families.volumes, W[0] - W[1])
        return released, jnp.where(_whole(bonds.alive) & ~_whole(bonds.left), step, bonds.at)

    released, at = jax.lax.cond(jnp.any(bonds.left != bonds.alive), broken, lambda: (bonds.released, bonds.at))
    return bonds._replace(alive=bonds.left, released=released, at=at)


def _whole(share: Share) -> Bool[Array, "points bonds"]:
    """Whether at least half of each bond is left."""
    return share if share.dtype == bool else share >= 0.5


def times_of_breaks(at: Int[Numbers, "points bonds"], dt) -> Float[Numbers, "points bonds"]:
    """The time at which each bond exceeded the criterion, inf if it has not broken."""
    xp = np if isinstance(at, np.ndarray) else jnp
    return xp.where(at >= 0, at * dt, xp.inf)
