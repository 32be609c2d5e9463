"""The result of `identify`: the parameters, their covariance, what the data do not determine, and how the search ended.

J is the Jacobian of the weighted residuals of the data and R that of the regularisation, with respect to the
parameters divided by their scales. With the singular values s and the right singular vectors v of [J; R]

    covariance = σ² (JᵀJ + RᵀR)⁻¹ = σ² Σ v vᵀ/s²,        times the scales

σ² is 1 if the noise is given. Otherwise it is ‖(y − d)‖²/(data − tr J (JᵀJ + RᵀR)⁻¹ Jᵀ). The trace is the number of
parameters that the data determine. Without regularisation it is the number of all parameters.

A direction v of the parameters with s ≤ 1e-8 s_max changes no datum. The parameters that take part in it are not
identifiable, and their variance is infinite.
"""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._internal.ending import Ending
from .._internal.shown import told

NULL = 1e-8  # s/s_max of a direction that changes no datum; exact null directions of bars and plates: below 1e-11
SHARE = 1e-4  # smallest component of a null direction, of unit length, that counts as taking part
NAMED = 4  # components of a direction that its description lists


class IdentifyEnding(Ending):
    """How `identify` ended."""

    COST = 0, "converged: the cost no longer decreases"
    STEP = 1, "converged: the parameters no longer change"
    GRADIENT = 2, "converged: the gradient of the cost is zero"
    OUT_OF_SOLVES = 3, "the forward solves ran out"
    BLOCKED = 4, "no smaller step stays where the model has a prediction"
    INTERRUPTED = 5, "interrupted: this is the best point so far"


class Solves(NamedTuple):
    """Numbers of solves of `identify`.

    Attributes
    ----------
    forward : int
        Forward solves: equilibria or runs, those without a result included.
    tangent : int
        Linearised solves in forward mode, one for each parameter and Jacobian.
    adjoint : int
        Linearised solves in reverse mode, one for each datum and Jacobian.
    finite_differences : int
        Forward solves that one-sided finite differences would take in place of the linearised ones.

    Examples
    --------
    >>> pd.identify(lambda p: p * np.arange(3.0), 1.0, [0.0, 2.0, 4.0]).solves.adjoint
    0
    """

    forward: int
    tangent: int
    adjoint: int
    finite_differences: int


class Identified(eqx.Module):
    """Result of `identify`.

    Attributes
    ----------
    parameters : tree
        The identified parameters, a tree like `start`.
    covariance : array, shape (parameters, parameters)
        Covariance of the flat parameters, in the order of `names`, from the Gauss–Newton Hessian. It is linearised. The
        variance of a parameter that the data do not determine is infinite, and its covariances are NaN.
    standard_deviation : tree
        Square roots of the diagonal of `covariance`, a tree like `start`.
    residual : array or tree
        Prediction minus measurement in the unit of the data, NaN where nothing was measured.
    misfit : float
        Root mean square of the residuals over the noise [-]. Near 1 means that the residuals look like the noise.
        Without `noise`: over the root mean square of the measured values.
    history : array, shape (iterations + 1,)
        Cost ½ ‖weighted residuals‖² [-] at the start and after each accepted step, with regularisation.
    solves : Solves
        Numbers of forward, tangent and adjoint solves, and what finite differences would take.
    identifiable : bool
        True if every direction of the parameters changes the data. Regularisation is not counted.
    singular_values : array, shape (parameters,)
        Singular values of the Jacobian of the weighted data, with respect to the parameters over their scales.
    direction : array, shape (parameters,)
        The direction of the parameters over their scales that changes the data least.
    names : tuple of str
        Name of every flat parameter.
    words : str
        Which parameters the data determine least, in words.
    code : int
        How the search ended; `ending` and `reason` give it as an enumeration and in words.
    failures : int
        Number of trial points without a prediction. The step was shortened to a quarter after each.
    failure : str or None
        Why the last of them had none.
    values : array, shape (parameters,)
        The identified parameters as one flat array, in the order of `names`.

    Examples
    --------
    Two lines through the origin, of which the data know only the sum of the slopes:

    >>> found = pd.identify(lambda p: (p["a"] + p["b"]) * np.arange(3.0), {"a": 1.0, "b": 1.0}, [0.0, 3.0, 6.0])
    >>> found.identifiable, round(float(found.parameters["a"] + found.parameters["b"]), 6)
    (False, 3.0)
    >>> print(found.words)
    not identifiable: no datum changes along +1 a, -1 b (in units of their scales)
    """

    parameters: Any
    covariance: Float[np.ndarray, "parameters parameters"]
    standard_deviation: Any
    residual: Any
    misfit: float
    history: Float[np.ndarray, " iterations"]
    solves: Solves
    identifiable: bool
    singular_values: Float[np.ndarray, " parameters"]
    direction: Float[np.ndarray, " parameters"]
    names: tuple[str, ...] = eqx.field(static=True)
    words: str = eqx.field(static=True)
    code: int
    failures: int = 0
    failure: str | None = eqx.field(static=True, default=None)
    values: Float[np.ndarray, " parameters"] = eqx.field(default_factory=lambda: np.zeros(0))

    @property
    def ending(self) -> IdentifyEnding:
        """How the search ended, as an enumeration."""
        return IdentifyEnding.of(int(self.code))

    @property
    def converged(self) -> bool:
        """True if the search ended at a minimum of the cost."""
        return self.ending in (IdentifyEnding.COST, IdentifyEnding.STEP, IdentifyEnding.GRADIENT)

    @property
    def reason(self) -> str:
        """How the search ended, in words, with the failures on its way."""
        words = self.ending.reason
        if self.failures:
            points = "1 trial point" if self.failures == 1 else f"{self.failures} trial points"
            words += f"; {points} had no prediction, so the step was shortened ({self.failure})"
        return words

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        deviations = np.sqrt(np.diag(self.covariance))
        shown = [f"{n} = {v:.5g} ± {s:.1g}" for n, v, s in zip(self.names, self.values, deviations, strict=True)]
        more = f", and {len(shown) - NAMED} more" if len(shown) > NAMED else ""
        return (
            f"{self.reason}; {', '.join(shown[:NAMED])}{more}; misfit {self.misfit:.2g}, {self.solves.forward} forward"
            f" solves; {self.words}"
        )


class Uncertainty(NamedTuple):
    """Covariance of the parameters over their scales, and the weakest direction of the data."""

    covariance: np.ndarray
    identifiable: bool
    singular_values: np.ndarray
    direction: np.ndarray
    words: str


def spectrum(J: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All singular values, one for each column, and the right singular vectors in the rows of a square matrix."""
    count = J.shape[1]
    tall = np.concatenate([J, np.zeros((max(0, count - len(J)), count))])
    _, s, v = np.linalg.svd(tall, full_matrices=False)
    return s, v


def _direction_in_words(direction: np.ndarray, names: tuple[str, ...]) -> str:
    largest = int(np.argmax(np.abs(direction) > (1 - 1e-6) * np.abs(direction).max()))
    relative = direction / direction[largest]
    order = [k for k in np.argsort(-np.abs(relative), kind="stable") if abs(relative[k]) > SHARE]
    terms = [f"{relative[k]:+.3g} {names[k]}" for k in order[:NAMED]]
    more = f" and {len(order) - NAMED} more" if len(order) > NAMED else ""
    return f"{', '.join(terms)}{more} (in units of their scales)"


def uncertainty(J: np.ndarray, R: np.ndarray, weighted: np.ndarray, known: bool, names: tuple[str, ...]) -> Uncertainty:
    """The covariance by the formulas of the module docstring.

    J, R: Jacobians of the data and of the regularisation. weighted: residuals of the data. known: the noise is given.
    """
    s, v = spectrum(np.concatenate([J, R]))
    kept = s > NULL * max(s[0], np.finfo(float).tiny)
    half = v[kept].T / s[kept]
    covariance = half @ half.T
    if not known:
        free = len(J) - float(np.sum((J @ half) ** 2))
        covariance = covariance * (float(weighted @ weighted) / free if free > 0.5 else np.inf)
    loose = (np.abs(v[~kept]) > SHARE).any(axis=0)
    covariance[loose] = covariance[:, loose] = np.nan
    covariance[loose, loose] = np.inf
    s, v = spectrum(J)
    null = s <= NULL * s[0]
    unused = np.flatnonzero(np.linalg.norm(J, axis=0) == 0)
    if unused.size:
        words = f"not identifiable: the data do not depend on {', '.join(names[k] for k in unused[:NAMED])}"
        words += f" and {unused.size - NAMED} more" if unused.size > NAMED else ""
    elif null.any():
        words = f"not identifiable: no datum changes along {_direction_in_words(v[-1], names)}"
        words += f"; {null.sum()} such directions" if null.sum() > 1 else ""
    else:
        words = f"identifiable; the data determine least {_direction_in_words(v[-1], names)}"
    return Uncertainty(covariance, not null.any(), s, v[-1], words)
