"""The audit as an observer of `simulate`: a run is stopped or flagged when its state can no longer be trusted."""

import equinox as eqx
import numpy as np

from .._internal.checks import choice, on_device
from .._internal.memory import remember, value_key
from ..finite_body.observers import Snapshot
from ..finite_body.scene import Scene
from .auditor import Auditor
from .verdict import Audit

ACTIONS = ("stop", "flag")


class TrustObserver(eqx.Module):
    """Observer that audits every save of a run on the host. `trust_observer` makes it.

    In a run with breaking bonds it judges the bonds that remain.

    Its values in `History.observed` have one entry a save: `score` (below 1 trusted, from 1 doubtful, from 2
    untrusted), `point` (the worst point), `reason` (what was found there), `zero_energy`, `margin` (the largest of all
    points) and `det` (the smallest).

    Parameters
    ----------
    action : str
        "stop" ends the run at the first untrusted save. "flag" records only.
    margins : bool
        Whether the infinite lattice of every point is judged.

    Examples
    --------
    >>> pd.trust_observer().action
    'stop'
    """

    action: str = eqx.field(static=True)
    margins: bool = eqx.field(static=True)

    def audit(self, scene: Scene, now: Snapshot) -> Audit:
        """The audit of a save, without the spectrum of the body.

        Parameters
        ----------
        scene : Scene
            The scene of the motion.
        now : Snapshot
            The state at the save.

        Returns
        -------
        Audit
            The verdict and the measures of all points.
        """
        key = ("auditor", value_key(scene.model))
        auditor = remember(scene.families, key, lambda: Auditor(scene.model, scene.families, ~scene.free))
        if now.alive is not None:
            auditor = auditor.of_remaining(scene.families.with_share(on_device(now.alive)))
        mean = scene.mean_deformation(now.factor)
        u = np.asarray(now.u)
        points = auditor.measures(u, None if mean is None else np.asarray(mean))
        lattice = auditor.lattice(points, path=False) if self.margins else None
        return auditor.judged(u, points, lattice, time=float(now.t))

    def __call__(self, scene: Scene, now: Snapshot) -> dict[str, np.ndarray]:
        state = self.audit(scene, now)
        margin = np.nan if state.margin is None else np.nanmax(state.margin)
        return {
            "score": np.asarray(max((found.score for found in state.findings), default=float(state.score.max()))),
            "point": np.asarray(int(np.argmax(state.score))),
            "zero_energy": np.asarray(state.zero_energy.max()),
            "margin": np.asarray(margin),
            "det": np.asarray(state.det.min()),
            "reason": np.array((state.findings[0].words if state.findings else "")[:240], dtype="U240"),
        }

    def stops(self, value: dict[str, np.ndarray]) -> str:
        """The reason to stop the run after a save, or an empty string.

        Parameters
        ----------
        value : dict of str to array
            What the observer returned for the save.

        Returns
        -------
        str
            What was found at the worst point.
        """
        if self.action == "flag" or not float(value["score"]) >= 2:
            return ""
        return str(value["reason"])


def trust_observer(action: str = "stop", margins: bool = True) -> TrustObserver:
    """Make an observer that stops or flags a run of `simulate` when its state can no longer be trusted.

    Every save is audited like `audit` does, without the spectrum of the body. In a run with breaking bonds the bonds
    that remain are audited.

    Parameters
    ----------
    action : str, optional
        "stop" ends the run at the first save that is untrusted. `History.reason` then says why and where. "flag" lets
        the run go on. Default "stop".
    margins : bool, optional
        Whether to judge the infinite lattice under the stretch of every point. Default True.

    Returns
    -------
    TrustObserver
        An observer for `simulate(observers={"trust": …})`. `History.observed["trust"]` is a dict of arrays with one
        entry a save: `score` (from 1 on doubtful, from 2 on untrusted), `point`, `reason`, `zero_energy`, `margin` and
        `det`.

    Raises
    ------
    ValueError
        If the action is unknown.

    Notes
    -----
    The observer runs on the host, so `simulate_diffrax` and transformations of JAX refuse it.

    Examples
    --------
    A wave that grows in a compressed bar is noticed at the start, before anything can be seen.

    >>> motion = pd.scenes.wave(16, N=3, u0=1e-8, F=[[0.95]], model=pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)))
    >>> history = pd.simulate(motion, 5.0, observers={"trust": pd.trust_observer()}, show_progress=False)
    >>> history.finished, len(history.times)
    (False, 1)
    """
    return TrustObserver(choice("action", action, ACTIONS), margins)
