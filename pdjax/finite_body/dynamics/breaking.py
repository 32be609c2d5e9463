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
from ..damage.criteria import Criterion
from ..damage.few_points import FEW, bonds_of, model_of, select
from ..damage.fragments import without_fragments
from ..damage.released import energy_drop
from ..scene import Scene

Share = Bool[Array, "points bonds"] | Float[Array, "points bonds"]


class Broken(NamedTuple):
    """What has become of the bonds of a run.

    `alive` (points, bonds) tells which bonds act in the force of this state, or with which share, and `left` which act
    in the next; `breaks` tells whether they differ. `at` (points, bonds) is the number of the step at which a bond
    broke, −1 if it has not: with shares, at which less than half of it was left. `released` is the energy [energy] that
    all breaks have released. `sums` are the reference sums over the bonds that are alive, see `Backend.sums`, or None.
    """

    alive: Share
    left: Share
    breaks: Bool[Array, ""]
    at: Int[Array, "points bonds"]
    released: Float[Array, ""]
    sums: Float[Array, "entries points"] | None


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
    """The bonds of a body before any has broken: those with a weight. Made by NumPy where the families are known.

    `scene` is prepared on padded arrays, with the way "families".
    """
    assert scene.operator is not None
    families = scene.families
    alive = families.acting
    xp = jnp if isinstance(alive, jax.core.Tracer) else np
    alive = xp.asarray(alive)
    alive = alive.astype(families.dtype) if criterion.smooth else alive
    sums = scene.operator.backend.sums(scene.model)
    never = xp.full(alive.shape, -1, xp.int32)
    return Broken(alive, alive, xp.zeros((), bool), never, xp.zeros((), families.dtype), sums)


def pulled(
    scene: Scene, criterion: Criterion, u: Float[Array, "points dim"], factor: Array, bonds: Broken
) -> tuple[Float[Array, "points dim"], Broken]:
    """V (f + λ b) of the bonds that are alive, and with them those that are left after the break at u.

    `scene` is prepared on padded arrays, with the way "families". For a critical stretch both come from one loop over
    the bonds.
    """
    assert scene.operator is not None
    model, families, alive, limit = scene.model, scene.families, bonds.alive, criterion.limit(scene.families)
    backend = scene.operator.backend
    both = None if limit is None else backend.breaking(model, u, alive, limit, bonds.sums)
    if both is None:
        backend = backend.with_share(model, alive, bonds.sums)
        force = eqx.tree_at(lambda s: s.operator.backend, scene, backend).unbalanced(u, factor)
        left = criterion.left(model, families, u, alive)
    else:
        f, hit = both
        force, left = families.volumes[:, None] * (f + factor * scene.load), alive & ~hit
    breaks = jnp.any(left != alive)
    if model.has_shape_tensor:
        left = jax.lax.cond(breaks, lambda: without_fragments(model, families, alive, left), lambda: left)
    return force, bonds._replace(left=left, breaks=breaks)


def after_break(scene: Scene, u: Float[Array, "points dim"], step: Int[Array, ""], bonds: Broken) -> Broken:
    """The bonds after the break of a step, with the energy released at u. A step without a break costs nothing.

    A break at few points costs little, because it changes only what belongs to these points.
    """
    assert scene.operator is not None
    model, families, backend = scene.model, scene.families, scene.operator.backend

    def times(before: Share, after: Share, at: Array) -> Array:
        return jnp.where(_whole(before) & ~_whole(after), step, at)

    def at_few(changed: Array) -> tuple[Array, Array, Array | None]:
        points, real = select(changed)
        own = model_of(model, len(families), points)
        before, after = (bonds_of(families, u, share, points) for share in (bonds.alive, bonds.left))
        W = energy_drop(own, (families, families), (before, after))
        sums = None if bonds.sums is None else backend.new_sums(own, bonds.sums, after, points, real)
        at = times(bonds.alive[points], bonds.left[points], bonds.at[points])
        at = bonds.at.at[jnp.where(real, points, len(families))].set(at, mode="drop")
        return jnp.sum(jnp.where(real, families.volumes[points] * W, 0.0)), at, sums

    def at_all(changed: Array) -> tuple[Array, Array, Array | None]:
        two = [families.with_share(share) for share in (bonds.alive, bonds.left)]
        W = energy_drop(model, two, [own.bonds(u) for own in two])
        sums = None if bonds.sums is None else backend.with_share(model, bonds.left, None).sums(model)
        return jnp.dot(families.volumes, W), times(bonds.alive, bonds.left, bonds.at), sums

    def broken() -> tuple[Array, Array, Array | None]:
        # The energy of a model that needs the other end changes at the neighbours too.
        changed = jnp.any(bonds.left != bonds.alive, axis=1)
        if model.needs_other_end:
            released, at, sums = at_all(changed)
        else:
            released, at, sums = jax.lax.cond(jnp.sum(changed) <= FEW, at_few, at_all, changed)
        return bonds.released + released, at, sums

    released, at, sums = jax.lax.cond(bonds.breaks, broken, lambda: (bonds.released, bonds.at, bonds.sums))
    return bonds._replace(alive=bonds.left, released=released, at=at, sums=sums)


def _whole(share: Share) -> Bool[Array, "points bonds"]:
    """Whether at least half of each bond is left."""
    return share if share.dtype == bool else share >= 0.5


def times_of_breaks(at: Int[Numbers, "points bonds"], dt) -> Float[Numbers, "points bonds"]:
    """The time at which each bond exceeded the criterion, inf if it has not broken."""
    xp = np if isinstance(at, np.ndarray) else jnp
    dt = xp.asarray(dt)
    return xp.where(at >= 0, at.astype(dt.dtype) * dt, xp.asarray(xp.inf, dt.dtype))
