"""The checks of an audit: what can make a state untrustworthy, point by point and for the whole body.

Every check turns what was measured into scores on one scale: below 1 nothing was found, from 1 on the state is
doubtful, from 2 on it is untrusted. A check of points has a score for every point. To add one, write a function and add
a line to `POINT_CHECKS` or `BODY_CHECKS`.

    check             doubtful (1)                                untrusted (2)
    collapse          det F̄ below 0.2                             det F̄ ≤ 0
    instability       margin > 0, but growth below e              growth by e or more while a wave crosses the body
    critical load     critical factor below 1.2                   –
    zero-energy mode  share above 0.01, neighbours alternate      share above 0.1, neighbours alternate (> 0.3)
    steep strain      share above 0.5, no alternation             –
    shape tensor      ratio of its eigenvalues below 0.03         –
    saddle            positive eigenvalue with a smooth mode      with supports, or a mode that alternates
    forces            forces differ from the file's by 1e-6       by 1e-2

**Regions.** A wave needs room. One point with a high score, such as a corner, makes a state doubtful. By instability or
zero-energy modes a state is untrusted only if the score reaches 2 at a quarter as many points as a family has.

**Growth.** A wave of margin μ > 0 grows at most at the rate √μ · 2√dim/h · c, where c is the speed of P-waves. While
such a wave crosses a body of length L, a perturbation grows by the factor exp(√μ · 2√dim · L/h). A margin so small that
this factor stays below e is harmless in a short motion, but not in a state of rest.

**Amplitudes.** A share is quadratic in the amplitude. On a lattice with N = 3, neighbours that alternate with ±20 % of
the strain have a share of about 0.01, and ±60 % one of about 0.1. Weaker modes are not reported. Strains that vary fast
without alternating are no zero-energy mode: solved plates with a clamp or a hole have shares up to 0.49 (N = 2 and 3).

**Where strains are small**, two small energies have any quotient. The check of zero-energy modes therefore divides P by
P + W with the larger of W(U) of the point and its mean over the body.

**Supports.** At the edge of a rigid clamp the strain jumps, which a family sees as z. The checks of zero-energy modes
and of steep strains therefore leave out the points whose components are all held, and their neighbours.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..finite_body.free_spectrum import FreeSpectrum
from ..geometry.report import THIN
from .own_lattice import OwnLattice
from .point_measures import PointMeasures

ALTERNATES = 0.3
COLLAPSING, NEAR_CRITICAL = 0.2, 1.2
ALTERNATING, VARYING = (0.01, 0.1), 0.5
FORCES = 1e-6, 1e-2
LOCAL = 1.99  # the score of a state that is untrusted at a few points only


class Forces(NamedTuple):
    """The differences |V f − given| of the forces of every point, divided by the largest given force [-].

    `hint` is a sentence on what explains them, such as a wrong sign, or an empty string.
    """

    error: np.ndarray
    hint: str = ""


class Evidence(NamedTuple):
    """All that an audit has measured. `size` is L/h of the body, `roughness` the alternation of its worst mode.

    `clamped` (points,) tells which families hold a point that is held in all directions, and `supported` whether any
    component of the body is held.
    """

    points: PointMeasures
    lattice: OwnLattice | None
    body: FreeSpectrum | None
    roughness: float
    forces: Forces | None
    volumes: np.ndarray
    size: float
    dim: int
    clamped: np.ndarray
    supported: bool


class PointCheck(NamedTuple):
    """`score` gives the scores (points,) or None if nothing was measured. `words` tells the value at a point.

    `regional` tells whether a state is untrusted only if a whole region has a score of 2.
    """

    name: str
    score: Callable[[Evidence], np.ndarray | None]
    words: Callable[[Evidence, int], str]
    regional: bool = False

    def of_state(self, score: np.ndarray, family: int) -> float:
        """The score of the state from those of its points, for families of `family` bonds."""
        worst = float(score.max())
        room = max(1, min(family, len(score)) // 4)
        return min(worst, LOCAL) if self.regional and np.partition(score, -room)[-room] < 2 else worst


class BodyCheck(NamedTuple):
    """`judge` gives the score and the words, or None if nothing was found."""

    name: str
    judge: Callable[[Evidence], tuple[float, str] | None]


def _collapse(e: Evidence) -> np.ndarray:
    det = e.points.det
    score = np.where(det < COLLAPSING, 1 + (COLLAPSING - det) / COLLAPSING, (1 - det) / (1 - COLLAPSING))
    return np.where(np.isfinite(det), np.maximum(score, 0.0), 3.0)


def growth(e: Evidence) -> np.ndarray:
    """The exponent by which a perturbation of every point's own lattice can grow while a wave crosses the body."""
    assert e.lattice is not None
    over = np.where(e.lattice.margin > e.lattice.tolerance, e.lattice.margin, 0.0)
    return np.sqrt(over) * 2 * np.sqrt(e.dim) * e.size


def _instability(e: Evidence) -> np.ndarray | None:
    if e.lattice is None:
        return None
    exponent = growth(e)
    return np.where(exponent > 0, 1 + exponent, 0.0)


def _critical(e: Evidence) -> np.ndarray | None:
    if e.lattice is None or e.lattice.critical_factor is None:
        return None
    factor = np.where(np.isnan(e.lattice.critical_factor), np.inf, e.lattice.critical_factor)
    return np.where(factor > 1, np.minimum(NEAR_CRITICAL / np.maximum(factor, 1.0), 1.9), 0.0)


def alternating_shares(e: Evidence) -> np.ndarray:
    """The share of zero-energy modes of every point whose neighbours alternate, 0 elsewhere and beside clamps."""
    return np.where((e.points.alternation > ALTERNATES) & ~e.clamped, zero_energy_shares(e), 0.0)


def _zero_energy(e: Evidence) -> np.ndarray:
    share, (low, high) = alternating_shares(e), ALTERNATING
    return np.where(share < low, share / low, 1 + (share - low) / (high - low))


def _steep(e: Evidence) -> np.ndarray:
    score = np.minimum(zero_energy_shares(e) / VARYING, 1.9)
    return np.where((e.points.alternation <= ALTERNATES) & ~e.clamped, score, 0.0)


def zero_energy_shares(e: Evidence) -> np.ndarray:
    """P/(P + max(W, mean of W)) of every point. The mean leaves out thin points, such as those beside a crack."""
    energy = np.where(np.isfinite(e.points.energy), e.points.energy, 0.0)
    P = e.points.zero_energy * energy
    W = energy - P
    sound = e.points.shape_ratio > THIN
    volumes = e.volumes * sound if sound.any() else e.volumes
    total = P + np.maximum(W, np.dot(volumes, W) / volumes.sum())
    return P / np.where(total > 0, total, 1.0)


def _shape(e: Evidence) -> np.ndarray:
    ratio = e.points.shape_ratio
    return np.minimum(THIN / np.maximum(ratio, THIN / 1.9), 1.9)


def _saddle(e: Evidence) -> tuple[float, str] | None:
    body = e.body
    if body is None or not body.positive:
        return None
    rough = e.roughness > ALTERNATES
    kind = "alternates between neighbours" if rough else "is smooth"
    words = (
        f"the Jacobian of the body has {body.positive} positive eigenvalues; the mode of the largest {kind}"
        f" (alternation {e.roughness:.2f})"
    )
    if not rough and not e.supported:
        return 1.5, f"{words}. It may be the buckling of a body whose supports are not known: pass held="
    return 2.0, words


def _forces(e: Evidence) -> tuple[float, str] | None:
    if e.forces is None:
        return None
    worst = float(np.nanmax(e.forces.error, initial=0.0))
    if worst <= FORCES[0]:
        return None
    at = int(np.nanargmax(e.forces.error))
    words = f"the forces of this model differ from the given ones by {worst:.1e} of the largest given force"
    words += f", at point {at}{e.forces.hint}"
    return (2.0 if worst > FORCES[1] else 1.0), words


def _lattice_words(e: Evidence, i: int) -> str:
    assert e.lattice is not None
    exponent = float(growth(e)[i])
    effect = f"grows by e^{exponent:.1f} while a wave crosses the body"
    return (
        f"an infinite lattice with its stretch is unstable, margin {e.lattice.margin[i]:.2g}: a perturbation {effect}"
    )


def _critical_words(e: Evidence, i: int) -> str:
    assert e.lattice is not None and e.lattice.critical_factor is not None
    return f"an infinite lattice becomes unstable at {e.lattice.critical_factor[i]:.3g} times its strain"


def _zero_words(e: Evidence, i: int) -> str:
    return (
        f"its neighbours alternate (alternation {e.points.alternation[i]:.2f}), zero-energy share"
        f" {e.points.zero_energy[i]:.2f}"
    )


def _steep_words(e: Evidence, i: int) -> str:
    return (
        f"the strain changes much within its family (share {e.points.zero_energy[i]:.2f}); take more points, or spread"
        " the load"
    )


POINT_CHECKS = (
    PointCheck("collapse", _collapse, lambda e, i: f"det F of its family is {e.points.det[i]:.3g}"),
    PointCheck("instability", _instability, _lattice_words, regional=True),
    PointCheck("critical load", _critical, _critical_words),
    PointCheck("zero-energy mode", _zero_energy, _zero_words, regional=True),
    PointCheck("steep strain", _steep, _steep_words),
    PointCheck(
        "shape tensor",
        _shape,
        lambda e, i: (
            f"the shape tensor of its family has the eigenvalue ratio {e.points.shape_ratio[i]:.2g}; below {THIN} it is"
            " nearly singular"
        ),
    ),
)
BODY_CHECKS = (BodyCheck("saddle", _saddle), BodyCheck("forces", _forces))
