"""Observers: quantities that `simulate` evaluates at every save of a motion.

A save is a state that a run stores. An observer is any JAX function (scene, snapshot) → array. `simulate` and
`simulate_diffrax` take a dictionary, name → observer, and return the values of all saves in `History.observed`.

The force through a section is minus the net internal force on all points beyond the section:

    F = −Σ_{beyond} V f

The forces between two points on the same side cancel in this sum, so only forces that cross the section remain. This
definition suits a nonlocal body: it needs neither an area nor a stress field. In tension along e, F points along +e.
"""

from typing import NamedTuple, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._internal.checks import Numbers
from ..geometry.points import Points
from .conditions import check_points, point_numbers
from .scene import Scene


class Snapshot(NamedTuple):
    """State of a motion at one save, as an observer receives it.

    Attributes
    ----------
    t : array, shape ()
        Time [time].
    factor : array, shape ()
        Load factor λ [-].
    u : array, shape (points, dim)
        Displacements [length].
    v : array, shape (points, dim)
        Velocities [length/time].
    force : array, shape (points, dim)
        V (f + λ b) [force]: internal and body forces. On held components it is minus the reaction.
    alive : array of bool, shape (points, bonds), or None
        Bonds that have not broken. With a smooth criterion: the share of each bond that is left [-], float. None if no
        bond can break.

    Examples
    --------
    An observer of your own, here the largest speed, reads a snapshot:

    >>> fastest = lambda scene, now: jnp.max(jnp.abs(now.v))
    >>> still = jnp.zeros((3, 1))
    >>> now = pd.observers.Snapshot(0.0, 1.0, still, still + 2.0, still)
    >>> float(fastest(None, now))
    2.0
    """

    t: Float[Numbers, ""]
    factor: Float[Numbers, ""]
    u: Float[Numbers, "points dim"]
    v: Float[Numbers, "points dim"]
    force: Float[Numbers, "points dim"]
    alive: Bool[Numbers, "points bonds"] | Float[Numbers, "points bonds"] | None = None


@runtime_checkable
class HostObserver(Protocol):
    """An observer that runs on the host, with NumPy arrays, and may stop the run.

    `__call__(scene, snapshot)` returns a dictionary of arrays or numbers, with the same keys and shapes at every save.
    `stops(value)` gets what it returned, and returns the reason to stop the run, or an empty string. Only `simulate`
    accepts such an observer, and not under a transformation of JAX.

    Examples
    --------
    A run that ends when a bond is stretched too far:

    >>> class Tip:
    ...     def __call__(self, scene, now):
    ...         return {"tip": now.u[-1, 0]}
    ...     def stops(self, value):
    ...         return f"the tip has moved by {value['tip']:.2f}" if value["tip"] > 0.05 else ""
    >>> body = pd.bar(3, 3.0)
    >>> held, pull = pd.prescribe([0], 0.0), pd.total_force([2], [0.1])
    >>> motion = pd.motion(pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held, pull))
    >>> history = pd.simulate(motion, 60.0, dt=0.5, save_every=1, observers={"tip": Tip()}, show_progress=False)
    >>> history.reason, history.times.tolist()
    ('an observer stopped the run: tip, the tip has moved by 0.10', [0.0, 0.5, 1.0, 1.5])
    """

    def __call__(self, scene: Scene, now: Snapshot, /) -> dict: ...

    def stops(self, value: dict, /) -> str: ...


def _check_points(points: np.ndarray, mask: int | None, scene: Scene) -> None:
    if isinstance(points, np.ndarray):
        check_points("an observer", points, mask, scene.prescribed.shape[0])


def check_observers(scene: Scene, observers: object, on_host: bool = True) -> None:
    """Check that observers are functions and that the points they name belong to the body.

    Without this check JAX would silently read another point for a point number outside the body.

    Parameters
    ----------
    scene : Scene
        The scene of the motion.
    observers : dict of str to function
        Functions (scene, snapshot) → array. An observer with a method `check(scene)` is asked to check itself.
    on_host : bool, optional
        Whether observers that run on the host are allowed. Default True.

    Raises
    ------
    ValueError
        If `observers` is not a dictionary of functions, if an observer names a point that the body does not have, or if
        an observer runs on the host where this is not possible.

    Examples
    --------
    >>> scene = pd.scenes.step_size_bar(21)
    >>> pd.observers.check_observers(scene, {"tip": pd.observers.probe([21])})
    Traceback (most recent call last):
    ...
    ValueError: an observer names point 21; the body has points 0 to 20
    """
    if not isinstance(observers, dict):
        raise ValueError(f"observers must be a dict, name → function (scene, snapshot); got {observers!r:.80}")
    for name, observer in observers.items():
        if not callable(observer):
            raise ValueError(f"observer {name!r} must be a function (scene, snapshot) → array; got {observer!r:.80}")
        if isinstance(observer, HostObserver) and not on_host:
            raise ValueError(
                f"observer {name!r} runs on the host, which only simulate without a transformation of JAX can do"
            )
        if hasattr(observer, "check"):
            observer.check(scene)


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


class Damage(eqx.Module):
    """Observer of the damage of every point. Made by `damage`.

    Examples
    --------
    >>> pd.observers.Damage()
    Damage()
    """

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " points"]:
        families = scene.families
        w = families.influence * families.weight * families.volumes[families.neighbours]
        alive = families.weight > 0 if now.alive is None else now.alive
        total = jnp.sum(w, axis=1)
        return 1 - jnp.sum(alive * w, axis=1) / jnp.where(total > 0, total, 1)


def damage() -> Damage:
    """Observe the damage of every point: the share of its family that has broken.

    φ_i = 1 − Σ_left ω V / Σ_all ω V

    Returns
    -------
    Damage
        An observer with values of shape (points,) [-]: 0 is intact, 1 has lost all bonds.

    References
    ----------
    Silling & Askari 2005.

    Examples
    --------
    A bar is pulled apart in its middle, where the only bond of a horizon of one spacing breaks:

    >>> body = pd.bar(4, 4.0)
    >>> motion = pd.motion(
    ...     pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), moving=True), start=[[0.0], [0.0], [0.2], [0.2]]
    ... )
    >>> watch = {"damage": pd.observers.damage()}
    >>> criterion = pd.CriticalStretch(0.1)
    >>> history = pd.simulate(motion, 0.1, dt=0.1, observers=watch, breaking=criterion, show_progress=False)
    >>> history.observed["damage"][-1].tolist()
    [0.0, 0.5, 0.5, 0.0]
    """
    return Damage()
