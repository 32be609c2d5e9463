"""Observers of cracks: the damage of every point and the position of a crack tip.

    φ_i = 1 − Σ_left ω V / Σ_all ω V       damage of a point: the share of its family that has broken

A plane crack takes at most half of the family of a point, and less the farther the point is from it. Ha & Bobaru 2010
take the tip of a crack as the farthest point whose damage exceeds 0.35.

Sources: Silling & Askari 2005; Ha & Bobaru 2010.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import finite
from ..scene import Scene
from .snapshot import Snapshot


def damage_of(scene: Scene, now: Snapshot) -> Float[Array, " points"]:
    """The damage φ of every point. Bonds that were cut before the run do not count."""
    families = scene.families
    w = families.influence * families.weight * families.volumes[families.neighbours]
    alive = families.weight > 0 if now.alive is None else now.alive
    total = jnp.sum(w, axis=1)
    return 1 - jnp.sum(alive * w, axis=1) / jnp.where(total > 0, total, 1)


class Damage(eqx.Module):
    """Observer of the damage of every point. Made by `damage`.

    Examples
    --------
    >>> pd.observers.Damage()
    Damage()
    """

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, " points"]:
        return damage_of(scene, now)


class CrackTip(eqx.Module):
    """Observer of the position of a crack tip along a direction. Made by `crack_tip`.

    Parameters
    ----------
    start : array, shape (dim,)
        Point [length] from which the distance is measured.
    direction : array, shape (dim,)
        Unit vector.
    damage : float
        Damage φ [-] above which a point belongs to the crack.

    Examples
    --------
    >>> pd.observers.CrackTip(np.array([0.5, 0.0]), np.array([1.0, 0.0]), 0.35).damage
    0.35
    """

    start: np.ndarray
    direction: np.ndarray
    damage: float

    def check(self, scene: Scene) -> None:
        """Check that the start has the dimension of the body.

        Parameters
        ----------
        scene : Scene
            The scene of the motion.

        Raises
        ------
        ValueError
            If the dimensions differ.
        """
        if self.start.shape != (scene.body.dim,):
            raise ValueError(
                f"start of a crack_tip must have shape ({scene.body.dim},) for this body; got {self.start.shape}"
            )

    def __call__(self, scene: Scene, now: Snapshot) -> Float[Array, ""]:
        ahead = jnp.asarray((scene.body.positions - self.start) @ self.direction, now.u.dtype)
        return jnp.max(jnp.where(damage_of(scene, now) > self.damage, ahead, 0.0), initial=0.0)


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


def crack_tip(start, direction, damage: float = 0.35) -> CrackTip:
    """Observe how far a crack has grown along a direction.

    max (X_i − start)·direction over the points with φ_i > damage, and 0 if there is none ahead of the start

    Parameters
    ----------
    start : array, shape (dim,)
        Reference position [length] of the tip before the run, such as the end of a notch.
    direction : array, shape (dim,)
        Direction of growth, of any length > 0. Observe the branches of a crack with one direction each.
    damage : float, optional
        Damage φ [-] above which a point belongs to the crack, between 0 and 1. Default 0.35.

    Returns
    -------
    CrackTip
        An observer with values of shape () [length]: the distance of the tip from the start.

    Raises
    ------
    ValueError
        If a vector is not finite, the direction is zero, the shapes differ, or `damage` does not lie between 0 and 1.

    References
    ----------
    Ha & Bobaru 2010.

    Examples
    --------
    The left half of a bar of two rows is peeled open from x = 1 on. Points whose bonds have broken lie up to x = 4.5:

    >>> body = pd.lattice((6, 2))
    >>> X = body.positions
    >>> start = np.where((X[:, 1] > 1) & (X[:, 0] < 5), 0.2, 0.0)[:, None] * [0, 1]
    >>> motion = pd.motion(pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), moving=True), start=start)
    >>> watch = {"tip": pd.observers.crack_tip((1.0, 1.0), (1.0, 0.0), damage=0.3)}
    >>> history = pd.simulate(
    ...     motion, 0.1, dt=0.1, observers=watch, breaking=pd.CriticalStretch(0.1), show_progress=False
    ... )
    >>> history.observed["tip"].tolist()
    [0.0, 3.5]
    """
    start, direction = np.atleast_1d(finite("start", start)), np.atleast_1d(finite("direction", direction))
    size = float(np.linalg.norm(direction))
    if start.ndim != 1 or start.shape != direction.shape or not size > 0:
        raise ValueError(
            "start and direction must be vectors of the same shape (dim,), and the direction must not be 0; got shapes"
            f" {start.shape} and {direction.shape}"
        )
    if not 0 <= damage < 1:
        raise ValueError(f"damage must lie between 0 and 1; got {damage}")
    return CrackTip(start, direction / size, float(damage))
