"""What an observer receives, what an observer on the host is, and the check of a dictionary of observers."""

from typing import NamedTuple, Protocol, runtime_checkable

from jaxtyping import Bool, Float

from ..._internal.checks import Numbers
from ..scene import Scene


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
