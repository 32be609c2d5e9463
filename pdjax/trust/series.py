"""Audits of the states of a run, and the first state that cannot be trusted."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._internal.progress import progress
from .._internal.public import public_function
from ..finite_body.dynamics.history import History
from ..force.fields import body_state
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from .audit import held_components
from .auditor import Auditor
from .checks import POINT_CHECKS
from .verdict import VERDICTS, Audit


@dataclass(frozen=True, repr=False)
class AuditSeries:
    """Result of `audit_states`: one row of worst scores for every state, and two audits. `print` shows a summary.

    Attributes
    ----------
    times : array, shape (states,)
        Times of the states, or their numbers.
    checks : tuple of str
        Names of the checks of points.
    scores : array, shape (states, checks)
        Score of every check and state: from 1 on doubtful, from 2 on untrusted.
    first : int or None
        Number of the first state that is untrusted.
    doubtful : int or None
        Number of the first state that is doubtful or untrusted.
    first_audit : Audit or None
        Audit of the state `first`, with the spectrum of the body if it was asked for.
    last_audit : Audit
        Audit of the last state, with the spectrum of the body if it was asked for.

    Examples
    --------
    >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> wave = (-1.0) ** np.indices((6, 5)).sum(axis=0).reshape(-1, 1) * np.ones(2)
    >>> smooth = np.asarray(families.positions) * 0.01
    >>> run = pd.audit_states(model, families, [smooth, smooth + 1e-2 * wave], show_progress=False)
    >>> run.first, run.first_audit.findings[0].check
    (1, 'zero-energy mode')
    """

    times: np.ndarray
    checks: tuple[str, ...]
    scores: np.ndarray
    first: int | None
    doubtful: int | None
    first_audit: Audit | None
    last_audit: Audit

    @property
    def verdict(self) -> str:
        """The worst verdict of all states: "trusted", "doubtful" or "untrusted"."""
        if self.first is not None:
            return VERDICTS[2]
        return VERDICTS[0] if self.doubtful is None else VERDICTS[1]

    @property
    def summary(self) -> str:
        """The verdict and the first states that are doubtful and untrusted, as text."""
        lines = [f"{self.verdict}: {len(self.times)} states from t = {self.times[0]:.6g} to {self.times[-1]:.6g}"]
        for words, state in (("doubtful", self.doubtful), ("untrusted", self.first)):
            if state is not None:
                worst = int(np.argmax(self.scores[state]))
                lines.append(
                    f"first {words} state: {state}, t = {self.times[state]:.6g}, by {self.checks[worst]}"
                    f" (score {self.scores[state, worst]:.2f})"
                )
        shown, state = (
            (self.last_audit, len(self.times) - 1) if self.first_audit is None else (self.first_audit, self.first)
        )
        lines.append(f"state {state}:")
        lines += ["  " + line for line in shown.summary.splitlines()]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return self.summary

    def as_dict(self) -> dict[str, Any]:
        """The numbers of the series without the fields of points, for JSON.

        Returns
        -------
        dict
            The verdict, the times and scores, the first bad state, and the audits of this state and the last one.

        Examples
        --------
        >>> families = pd.families(pd.lattice((6, 5)), horizon=3.0)
        >>> model = pd.BondLevel(pd.LinearElastic(1.0, 1.0))
        >>> pd.audit_states(model, families, [np.zeros((30, 2))], show_progress=False).as_dict()["first"] is None
        True
        """
        return {
            "verdict": self.verdict,
            "times": self.times.tolist(),
            "scores": {name: self.scores[:, k].tolist() for k, name in enumerate(self.checks)},
            "first": self.first,
            "doubtful": self.doubtful,
            "first_audit": None if self.first_audit is None else self.first_audit.as_dict(),
            "last_audit": self.last_audit.as_dict(),
        }


def _states(states: Any, times: Any) -> tuple[Iterable[Any], np.ndarray | None, int]:
    """The displacements, their times (None if unknown), and their number."""
    if isinstance(states, History):
        if len(states.u) != len(states.times):
            raise ValueError("this history kept no fields except the last: run simulate with fields=True")
        return np.asarray(states.u), np.asarray(states.times, float), len(states.times)
    if not isinstance(states, Iterable):
        raise ValueError(
            f"states must be a History or a sequence of displacements of shape (points, dim); got"
            f" {type(states).__name__}. Of a result of solve or equilibrium_path, pass its u"
        )
    if not hasattr(states, "__len__"):
        states = list(states)
    if getattr(states, "ndim", 3) != 3:
        raise ValueError(
            f"states must be a History or have the shape (states, points, dim); got shape {states.shape}. For one state"
            " call audit, or pass [u]"
        )
    if len(states) == 0:
        raise ValueError("states must hold at least one displacement; got none")
    if times is not None and len(times) != len(states):
        raise ValueError(f"times must have one entry for each of the {len(states)} states; got {len(times)}")
    return states, None if times is None else np.asarray(times, float), len(states)


@public_function
def audit_states(
    model: AbstractModel,
    families: Families,
    states,
    *,
    times=None,
    held=None,
    margins: bool = True,
    body: bool = True,
    each: Callable[[Audit], None] | None = None,
    show_progress: bool = True,
) -> AuditSeries:
    """Audit the states of a run and find the first one that cannot be trusted.

    Parameters
    ----------
    model : AbstractModel
        The material model with which the states were computed.
    families : Families
        Families of the body, from `families`.
    states : History or sequence of array, each of shape (points, dim)
        A result of `simulate`, or displacements [length].
    times : array, shape (states,), optional
        Times of the states. Default: those of the history, or the numbers of the states.
    held : array of bool, shape (points,) or (points, dim), optional
        Supported points or components, see `audit`.
    margins : bool, optional
        Whether to judge the infinite lattice under the stretch of every point. Default True.
    body : bool, optional
        Whether to compute the spectrum of the body for the first untrusted state and for the last state. Default True.
    each : callable, optional
        Function that gets the `Audit` of every state, for example to write its fields.
    show_progress : bool, optional
        Show a progress bar, if the error stream is a terminal. Default True.

    Returns
    -------
    AuditSeries
        The scores of all states, and the audits of the first untrusted state and of the last state.

    Raises
    ------
    ValueError
        If there are no states, a state or `times` has a wrong shape, or for what `audit` refuses.

    Examples
    --------
    >>> motion = pd.scenes.wave(40, N=3, u0=1e-3, model=pd.BondLevel(pd.LinearElastic(1.0, 1.0)))
    >>> history = pd.simulate(motion, 2.0, show_progress=False, save_every=1)
    >>> run = pd.audit_states(motion.scene.model, motion.scene.families, history, show_progress=False)
    >>> run.verdict, run.first is None
    ('trusted', True)
    """
    every, known, count = _states(states, times)
    moments = np.arange(count, dtype=float) if known is None else known
    auditor, first, doubtful, rows = None, None, None, []
    first_audit, last = None, None
    for number, given in zip(progress(range(count), count, "states", show_progress), every, strict=True):
        u = np.asarray(body_state(model, families, given)[0])
        if auditor is None:
            auditor = Auditor(model, families, held_components(held, families))
        points = auditor.measures(u, None)
        lattice = auditor.lattice(points, path=False) if margins else None
        scores = auditor.scores(auditor.evidence(points, lattice))
        rows.append(
            [check.of_state(scores[check], auditor.bonds) if check in scores else 0.0 for check in POINT_CHECKS]
        )
        worst = max(rows[-1])
        doubtful = number if doubtful is None and worst >= 1 else doubtful
        is_first, is_last = first is None and worst >= 2, number == count - 1
        first = number if is_first else first
        if is_first or is_last or each is not None:
            spectrum = auditor.body(u, None) if body and (is_first or is_last) else None
            state = auditor.judged(u, points, lattice, spectrum, time=float(moments[number]))
            first_audit = state if is_first else first_audit
            last = state
            if each is not None:
                each(state)
    assert last is not None
    names = tuple(check.name for check in POINT_CHECKS)
    return AuditSeries(moments, names, np.array(rows), first, doubtful, first_audit, last)
