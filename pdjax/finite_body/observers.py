"""Observers: what is read off a motion at every save. A name and one of these is all that `simulate` needs.

An observer is a function (scene, snapshot) → array, in JAX; any function of that kind will do. Forces are those of the
body: a section transmits the net internal force on all that lies beyond it,

    F = −Σ_{beyond} V f        (pairs within one side cancel: what is left crossed the section)

which is a nonlocal body's own definition: no area, no stress field. In tension along e it points along +e.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..geometry.points import Points
from .conditions import check_points, point_numbers
from .scene import Scene


class Snapshot(NamedTuple):
    """A moment of a motion: time, load factor λ, u, v and V (f + λ b) [force] of all points."""

    t: Float[Array, ""]
    factor: Float[Array, ""]
    u: Float[Array, "points dim"]
    v: Float[Array, "points dim"]
    force: Float[Array, "points dim"]


def _check_points(points: np.ndarray, mask: int | None, scene: Scene) -> None:
    if isinstance(points, np.ndarray):
        check_points("an observer", points, mask, scene.prescribed.shape[0])


def check_observers(scene: Scene, observers: dict[str, Any]) -> None:
    """Ask every observer that can tell whether it fits the scene. JAX would read another point without a word."""
    if not isinstance(observers, dict):
        raise ValueError(f"observers must be a dict, name → function (scene, snapshot); got {observers!r:.80}")
    for name, observer in observers.items():
        if not callable(observer):
            raise ValueError(f"observer {name!r} must be a function (scene, snapshot) → array; got {observer!r:.80}")
        if hasattr(observer, "check"):
            observer.check(scene)


class Probe(eqx.Module):
    """u (points named, dim) [length]."""

    points: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Refuse points that the body does not have."""
        _check_points(self.points, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, "named dim"]:
        return now.u[self.points]


class Reaction(eqx.Module):
    """Σ R (dim,) [force]: the force that supports exert on the points named; zero on free components."""

    points: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Refuse points that the body does not have."""
        _check_points(self.points, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " dim"]:
        held = jnp.ones(now.u.size, bool).at[scene.unknowns].set(False).reshape(now.u.shape)
        return -jnp.sum(jnp.where(held, now.force, 0.0)[self.points], axis=0)


class SectionForce(eqx.Module):
    """F (dim,) [force] through the section beyond which the points named lie, in a body of `mask` points."""

    beyond: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Refuse points that the body does not have."""
        _check_points(self.beyond, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " dim"]:
        internal = now.force - now.factor * scene.families.volumes[:, None] * scene.load
        return -jnp.sum(internal[self.beyond], axis=0)


def probe(points) -> Probe:
    """Displacements of the points named (a mask or point numbers) [length]."""
    numbers, mask = point_numbers(points)
    return Probe(numbers, mask=mask)


def reaction(points) -> Reaction:
    """The force of the supports on the points named [force], all together."""
    numbers, mask = point_numbers(points)
    return Reaction(numbers, mask=mask)


def section_force(body: Points, position: float, axis: int = 0) -> SectionForce:
    """The force through the plane at `position` [length] across `axis`, that of the side beyond it.

    Raises: ValueError if no point or every point lies beyond it.
    """
    if not 0 <= axis < body.dim:
        raise ValueError(f"axis must lie in 0 to {body.dim - 1} for this body; got {axis}")
    if body.period is not None and np.isfinite(body.period[axis]):
        raise ValueError(
            f"the body is periodic along axis {axis}: a second section closes the box and the two cancel; its stress is"
            " `pdjax.piola_stress` or `pdjax.stress`"
        )
    x = body.positions[:, axis]
    beyond = np.flatnonzero(x > position)
    if len(beyond) in (0, len(x)):
        raise ValueError(
            f"a section at {position} leaves one side empty: the body's points lie in {x.min()}, {x.max()}"
        )
    return SectionForce(beyond, mask=len(x))
