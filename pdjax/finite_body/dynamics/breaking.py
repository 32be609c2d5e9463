"""Bonds that break during a run of velocity Verlet.

A step from t to t + Δt with breaking bonds:

    1. The bonds that exceed the criterion at u(t) break. They still pull in the force at t, so that their last
       half kick is that of a whole bond.
    2. u moves to t + Δt, and the force there is that of the bonds that are left.

LAMMPS breaks bonds in the same order. A bond acts for half of the step in which it breaks. The released energy is the
drop of the strain energy at the fixed displacement of that moment, t + Δt/2:

    ΔΠ = Π(ū, before) − Π(ū, after),   ū = u(t) + (Δt/2) v(t + Δt/2)

The budget K + Π + released − W_supports − W_loads + D then closes to the second order of the integrator. The models
must keep the reference sums of the intact family (`keeps_reference`).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ...force.fields import energies
from ..damage.criteria import Criterion, exceeding
from ..scene import Scene


def check_breaking(criterion: object, scene: Scene) -> None:
    """Raise ValueError if bonds of this scene cannot break by this criterion."""
    if not isinstance(criterion, Criterion):
        raise ValueError(
            f"breaking must be a breaking criterion, such as pd.CriticalStretch(0.01); got {type(criterion).__name__}"
        )
    if not scene.model.keeps_reference:
        raise ValueError(
            f"{type(scene.model).__name__} takes its sums over the bonds that are left, so its bonds cannot break in a"
            " run yet; BondBased and LPS can"
        )
    if scene.mean is not None:
        raise ValueError("bonds of a body with a mean deformation cannot break in a run; leave out mean")
    scene.families.need_arrays()
    criterion.check(scene.model, scene.families)


def all_alive(scene: Scene) -> Bool[Array, "points bonds"]:
    """The bonds of a body before any has broken: those with a weight."""
    return scene.families.weight > 0


def pulled(
    scene: Scene, criterion: Criterion, u: Float[Array, "points dim"], factor: Array, alive: Bool[Array, "points bonds"]
) -> tuple[Float[Array, "points dim"], Bool[Array, "points bonds"]]:
    """V (f + λ b) of the bonds that are alive, and those of them that exceed the criterion at u.

    `scene` is prepared on padded arrays, with the way "families". For a critical stretch both come from one loop over
    the bonds.
    """
    assert scene.operator is not None
    limit = criterion.limit(scene.families)
    both = None if limit is None else scene.operator.backend.breaking(scene.model, u, alive, limit)
    if both is not None:
        f, hit = both
        return scene.families.volumes[:, None] * (f + factor * scene.load), hit
    backend = scene.operator.backend.broken(scene.model, alive)
    force = eqx.tree_at(lambda s: s.operator.backend, scene, backend).unbalanced(u, factor)
    return force, exceeding(criterion, scene.model, scene.families.with_broken(~alive), u, None)


def drop(
    scene: Scene,
    u: Float[Array, "points dim"],
    alive: Bool[Array, "points bonds"],
    dying: Bool[Array, "points bonds"],
) -> Float[Array, ""]:
    """The strain energy that the dying bonds release at u. It costs nothing in a step in which no bond breaks."""

    def released() -> Array:
        before, after = (scene.families.with_broken(~left) for left in (alive, alive & ~dying))
        W = [energies(scene.model, families, families.bonds(u)) for families in (before, after)]
        return jnp.dot(scene.families.volumes, W[0] - W[1])

    return jax.lax.cond(jnp.any(dying), released, lambda: jnp.zeros((), scene.families.volumes.dtype))
