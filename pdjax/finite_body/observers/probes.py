"""Observers of displacements, reactions and section forces.

The force through a section is minus the net internal force on all points beyond the section:

    F = −Σ_{beyond} V f

The forces between two points on the same side cancel in this sum, so only forces that cross the section remain. This
definition suits a nonlocal body: it needs neither an area nor a stress field. In tension along e, F points along +e.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...geometry.points import Points
from ..conditions import check_points, point_numbers
from ..scene import Scene
from .snapshot import Snapshot


def _check_points(points: np.ndarray, mask: int | None, scene: Scene) -> None:
    if isinstance(points, np.ndarray):
        check_points("an observer", points, mask, scene.prescribed.shape[0])


class Probe(eqx.Module):
    """Observer of the displacements of points. Made by `probe`.

    Parameters
    ----------
    points : array of int, shape (selected,)
        Point numbers.
    mask : int, optional
        Number of points of the body, where the points came from a mask.

    Examples
    --------
    >>> pd.observers.Probe(np.array([2, 3])).points
    array([2, 3])
    """

    points: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Check that the body of a scene has the points.

        Parameters
        ----------
        scene : Scene
            The scene of the motion.

        Raises
        ------
        ValueError
            If the body does not have one of the points, or if the mask is that of a body of another size.
        """
        _check_points(self.points, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, "named dim"]:
        return now.u[self.points]


class Reaction(eqx.Module):
    """Observer of the force that the supports exert on points. Made by `reaction`.

    Σ R, R = −V (f + λ b) on held components, 0 on free components

    Parameters
    ----------
    points : array of int, shape (selected,)
        Point numbers.
    mask : int, optional
        Number of points of the body, where the points came from a mask.

    Examples
    --------
    >>> pd.observers.Reaction(np.array([0, 1])).points
    array([0, 1])
    """

    points: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Check that the body of a scene has the points.

        Parameters
        ----------
        scene : Scene
            The scene of the motion.

        Raises
        ------
        ValueError
            If the body does not have one of the points, or if the mask is that of a body of another size.
        """
        _check_points(self.points, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " dim"]:
        held = jnp.ones(now.u.size, bool).at[scene.unknowns].set(False).reshape(now.u.shape)
        return -jnp.sum(jnp.where(held, now.force, 0.0)[self.points], axis=0)


class SectionForce(eqx.Module):
    """Observer of the force through a section of the body. Made by `section_force`.

    F = −Σ_{beyond} V f

    Parameters
    ----------
    beyond : array of int, shape (selected,)
        Numbers of the points beyond the section.
    mask : int, optional
        Number of points of the body.

    Examples
    --------
    >>> pd.observers.SectionForce(np.array([3, 4]), mask=5).beyond
    array([3, 4])
    """

    beyond: np.ndarray
    mask: int | None = eqx.field(static=True, default=None, kw_only=True)

    def check(self, scene: Scene) -> None:
        """Check that the body of a scene has the points.

        Parameters
        ----------
        scene : Scene
            The scene of the motion.

        Raises
        ------
        ValueError
            If the body does not have one of the points, or if the mask is that of a body of another size.
        """
        _check_points(self.beyond, self.mask, scene)

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " dim"]:
        internal = now.force - now.factor * scene.families.volumes[:, None] * scene.load
        return -jnp.sum(internal[self.beyond], axis=0)


def probe(points) -> Probe:
    """Observe the displacements of points.

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The observed points: a mask over all points of the body, or their numbers.

    Returns
    -------
    Probe
        An observer with values of shape (selected, dim) [length].

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers.

    Examples
    --------
    Observe the right side of a lattice. Pass `watch` to `simulate` as `observers`:

    >>> body = pd.lattice((5, 4))
    >>> watch = {"right side": pd.observers.probe(body.positions[:, 0] > 4)}
    >>> watch["right side"].points
    array([16, 17, 18, 19])
    """
    numbers, mask = point_numbers(points)
    return Probe(numbers, mask=mask)


def reaction(points) -> Reaction:
    """Observe the total force that the supports exert on points.

    Σ R, R = −V (f + λ b) on held components, 0 on free components

    Parameters
    ----------
    points : array of bool, shape (points,), or of int, shape (selected,)
        The observed points: a mask over all points of the body, or their numbers.

    Returns
    -------
    Reaction
        An observer with values of shape (dim,) [force].

    Raises
    ------
    ValueError
        If `points` is empty, names a point twice, or is neither a mask nor point numbers.

    Examples
    --------
    The support of a bar at rest carries no load before the bar has moved, then it resists the pull of 0.01:

    >>> body = pd.bar(3, 3.0)
    >>> held, pull = pd.prescribe([0], 0.0), pd.total_force([2], [0.01])
    >>> motion = pd.motion(pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held, pull), damping=1.0)
    >>> watch = {"support": pd.observers.reaction([0])}
    >>> history = pd.simulate(motion, 60.0, dt=0.5, save_every=120, observers=watch, show_progress=False)
    >>> np.round(history.observed["support"][:, 0], 4) + 0.0
    array([ 0.  , -0.01])
    """
    numbers, mask = point_numbers(points)
    return Reaction(numbers, mask=mask)


def section_force(body: Points, position: float, axis: int = 0) -> SectionForce:
    """Observe the force through a plane section of a body.

    F = −Σ_{beyond} V f

    Parameters
    ----------
    body : Points
        The body of the scene. It must not be periodic along `axis`.
    position : float
        Coordinate [length] of the section along `axis`.
    axis : int, optional
        Direction of the normal of the section. Default 0.

    Returns
    -------
    SectionForce
        An observer with values of shape (dim,) [force], positive along the normal in tension.

    Raises
    ------
    ValueError
        If no point or every point lies beyond the section, if the body has no such axis, or if it is periodic along it.

    Examples
    --------
    >>> body = pd.bar(5, 5.0)
    >>> pd.observers.section_force(body, 2.8).beyond
    array([3, 4])
    """
    if not 0 <= axis < body.dim:
        raise ValueError(f"axis must lie in 0 to {body.dim - 1} for this body; got {axis}")
    if body.period is not None and np.isfinite(body.period[axis]):
        raise ValueError(
            f"the body is periodic along axis {axis}, so one section does not divide it into two sides: the forces"
            " through the section and across the period cancel; use `pdjax.piola_stress` or `pdjax.stress` instead"
        )
    x = body.positions[:, axis]
    beyond = np.flatnonzero(x > position)
    if len(beyond) in (0, len(x)):
        raise ValueError(
            f"a section at {position} leaves one side empty: the points of the body lie between {x.min()} and {x.max()}"
        )
    return SectionForce(beyond, mask=len(x))
