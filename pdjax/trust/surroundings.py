"""The material around a burst of breaking bonds, in the last state that was stored before it.

The points around a burst are the ends of its first bonds and their neighbours. Their deformation comes from the bonds
that were left in that state. Points whose remaining bonds have a nearly singular shape tensor (`THIN`) are left out,
because their F̄ is not reliable.

A wave needs room. What counts is therefore the largest value that a quarter of the points reaches, of the zero-energy
share and of the margin of the intact lattice.

**Change up to the break.** Let e be the strains |Y|/|ξ| − 1 of the bonds of these points. Their rate is taken from the
last two states. `change` is ‖Δe‖ from the stored state to the break, divided by ‖e‖.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from .._internal.checks import finite
from ..geometry.bonds import Families
from ..geometry.report import THIN
from ..infinite_lattice.margins import long_wave_margin
from .auditor import Auditor
from .bursts import BrokenTogether
from .checks import alternating_shares, zero_energy_shares
from .own_lattice import OwnLattice, own_lattice

SOFT = 0.3  # see soft_margins
FINER = 3  # times as many bins of stretches as in an audit: here they serve all states of a run
EQUAL = 0.01  # bonds of a load step count as strained equally within this part
ROOM = 4  # one in so many points must reach a value


class States(NamedTuple):
    """What is read of a run: its times or load factors, its displacements, and when its bonds broke.

    The state of a motion at the time at which a bond broke is the one that broke it. A path of equilibria, `path`, may
    have two states at the load factor at which bonds broke: `settled` is False for the one before the first break. A
    settled state is the one after the break. `dt` is the time step of a motion, if it has one.
    """

    abscissa: str
    at: np.ndarray
    u: np.ndarray
    broken_at: np.ndarray
    path: bool
    settled: np.ndarray
    dt: float | None

    def last_before(self) -> np.ndarray:
        """The number (points, bonds) of the last state before each bond broke, −1 if there is none."""
        if not self.path:
            return np.searchsorted(self.at, self.broken_at, side="right") - 1
        first = np.searchsorted(self.at, self.broken_at, side="left")
        there = np.minimum(first, len(self.at) - 1)
        loaded = (self.at[there] == self.broken_at) & ~self.settled[there]
        return np.where(loaded, first, first - 1)

    def step_of(self, burst: BrokenTogether) -> int:
        """Number of the time step or of the load step in which the first bond broke."""
        if self.path:
            return len(np.unique(self.at[self.at < burst.first]))
        return burst.state if self.dt is None else round(burst.first / float(self.dt))

    def remaining(self, families: Families, state: int) -> Families:
        """The families with the bonds that were left in a state."""
        gone = self.broken_at < self.at[state]
        if self.path and self.settled[state]:
            gone = self.broken_at <= self.at[state]
        return families.with_broken(gone) if gone.any() else families


class Around(NamedTuple):
    """The points around the first bonds of a burst, in the state before it.

    `stretch` (points, dim, dim) is U − I, or F̄ − I if the model is not objective, and NaN where det F̄ ≤ 0. `share` and
    `alternating` are the zero-energy shares that a quarter of the points reaches, of all points and of those whose
    neighbours alternate. `change` is that of the module docstring.
    """

    points: np.ndarray
    stretch: np.ndarray
    share: float
    alternating: float
    change: float


def read_states(run: Any, families: Families) -> States:
    """The states and the broken bonds of a History or of a BreakingPath. Raises ValueError if they do not fit."""
    name = next((name for name in ("times", "load_factors") if hasattr(run, name)), None)
    if name is None or not hasattr(run, "u") or not hasattr(run, "broken_at"):
        raise ValueError(
            "run must be a result of simulate or solve_breaking, with times or load_factors, u and broken_at; got"
            f" {type(run).__name__}"
        )
    if run.broken_at is None:
        raise ValueError("no bond could break in this run: pass breaking= to simulate")
    at, u, broken = np.asarray(getattr(run, name), float), np.asarray(run.u), np.asarray(run.broken_at, float)
    if u.ndim == 3 and u.shape[1] != len(families):
        raise ValueError(
            f"the families have {len(families)} points and the run has {u.shape[1]}; pass the families of the body"
            " that the run started with"
        )
    if u.shape != (len(at), len(families), families.dim):
        raise ValueError(
            f"the run must hold u of every state, shape (states, points, dim) = ({len(at)}, {len(families)},"
            f" {families.dim}); got {u.shape}. Run simulate with fields=True"
        )
    finite("u of the run", u)
    if len(at) == 0 or (np.diff(at) < 0).any():
        raise ValueError(f"{name} must have at least one entry and increase; got {at}")
    if broken.shape != families.weight.shape:
        raise ValueError(
            f"broken_at must have shape (points, bonds) = {families.weight.shape}, with inf for bonds that did not"
            f" break; got {broken.shape}"
        )
    is_bond = np.asarray(families.is_bond)
    broken = np.where(is_bond, broken, np.inf)
    back = broken[np.asarray(families.neighbours), np.asarray(families.reverse)]
    if ((broken != back) & is_bond).any():
        raise ValueError("broken_at must have the same value at both ends of a bond; these families are of another run")
    path = name == "load_factors"
    settled = np.asarray(getattr(run, "settled", np.ones(len(at), bool)))
    return States("load factor" if path else "t", at, u, broken, path, settled, getattr(run, "dt", None))


def _last_of_quarter(points: int) -> int:
    """The rank, from 0, of the last of a quarter of the points."""
    return max(1, points // ROOM) - 1


def _reached(values: Float[np.ndarray, " points"]) -> float:
    """The largest value that a quarter of the points reaches."""
    return float(np.sort(values)[::-1][_last_of_quarter(len(values))])


def _strains(families: Families, points: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Strains |Y|/|ξ| − 1 of the remaining bonds of these points."""
    xi = np.asarray(families.xi)[points].astype(float)
    eta = (u[np.asarray(families.neighbours)[points]] - u[points][:, None]).astype(float)
    twice = (2 * xi * eta + eta * eta).sum(axis=-1) / (xi * xi).sum(axis=-1)
    return (twice / (1 + np.sqrt(np.maximum(1 + twice, 0.0))))[np.asarray(families.weight)[points] > 0]


def most_strained_first(families: Families, states: States, burst: BrokenTogether) -> BrokenTogether:
    """The burst of a path, whose first bonds are those that were strained most in the state before.

    All bonds of a load step break at the same load factor, so their order is not known. In a jump of a crack the far
    bonds break because the near ones have broken.
    """
    if not states.path or burst.state < 0:
        return burst
    u, xi = states.u[burst.state].astype(float), np.asarray(families.xi, float)[burst.here, burst.slot]
    eta = u[burst.there] - u[burst.here]
    strain = np.linalg.norm(xi + eta, axis=1) / np.linalg.norm(xi, axis=1) - 1
    return burst._replace(leads=strain >= strain.max() - EQUAL * abs(strain.max()))


def _change(states: States, remaining: Families, points: np.ndarray, burst: BrokenTogether) -> float:
    """The change of the strains up to the break. It is inf if there is no earlier state to take the rate from."""
    k, at = burst.state, states.at
    if burst.first == at[k]:
        return 0.0
    if k == 0 or at[k] == at[k - 1]:
        return np.inf
    now, before = (_strains(remaining, points, states.u[number]) for number in (k, k - 1))
    size = float(np.linalg.norm(now))
    part = (burst.first - at[k]) / (at[k] - at[k - 1])
    return float(np.linalg.norm(now - before)) * part / size if size > 0 else np.inf


def surroundings(auditor: Auditor, states: States, bursts: list[BrokenTogether]) -> list[Around | None]:
    """What is around every burst. None if no state was stored before it, or if no point keeps a reliable F̄."""
    around: list[Around | None] = [None] * len(bursts)
    families = auditor.families
    neighbours, real = np.asarray(families.neighbours), np.asarray(families.weight) > 0
    for state in sorted({burst.state for burst in bursts if burst.state >= 0}):
        remaining = states.remaining(families, state)
        now = auditor.of_remaining(remaining)
        measured = now.measures(states.u[state], None)
        evidence = now.evidence(measured)
        share, alternating = zero_energy_shares(evidence), alternating_shares(evidence)
        G = measured.stretch if auditor.model.objective else measured.gradient
        upright = np.where(measured.det[:, None, None] > 0, G, np.nan)
        for number, burst in enumerate(bursts):
            if burst.state == state:
                near = np.union1d(burst.ends, neighbours[burst.ends][real[burst.ends]])
                near = near[measured.shape_ratio[near] > THIN]
                if len(near):
                    change = _change(states, remaining, near, burst)
                    around[number] = Around(
                        near, upright[near], _reached(share[near]), _reached(alternating[near]), change
                    )
    return around


def soft_margins(auditor: Auditor) -> np.ndarray:
    """The margins (points,) above which a lattice is soft: it hardly resists some short wave.

    Let μ₀ be the margin of long waves at rest, and μ that of the lattice. The stiffness of a nonlocal solid stops
    growing at waves of the length of the horizon. Relative to the classical law its short waves therefore have a
    stiffness of the order 1/N². The factor (μ/μ₀) N² is 1.9 to 2.04 for LPS (2D, N = 2 to 6, Poisson's ratio 0 to
    0.49), 2.7 to 2.9 for BondBased, and 0 for models with zero-energy modes. A lattice is soft if the factor is below
    SOFT.
    """
    N = float(np.asarray(auditor.family.horizon) / np.asarray(auditor.family.spacing))
    out = np.empty(len(auditor.families))
    for part in auditor.materials:
        out[part.mask] = SOFT * min(long_wave_margin(part.model, auditor.family), 0.0) / N**2
    return out


class Margin(NamedTuple):
    """The margin that a quarter of the points around a burst reaches [-], and its rounding error. inf: collapsed."""

    value: float
    rounding: float


def margins_around(auditor: Auditor, around: list[Around | None]) -> tuple[list[Margin | None], float]:
    """The margins of the intact lattice around all bursts, and the binning error of the ranking.

    One search with bins of stretches ranks the points of each burst. A second one gives the deciding points their own
    margins, without bins.
    """
    some = [a for a in around if a is not None]
    if not some:
        return [None] * len(around), 0.0
    every = np.concatenate([a.points for a in some]), np.concatenate([a.stretch for a in some])
    ranked = _searched(auditor, *every, FINER)
    margin = np.where(np.isnan(ranked.margin), np.inf, ranked.margin)
    parts = np.split(margin, np.cumsum([len(a.points) for a in some])[:-1])
    last = [int(np.argsort(-part, kind="stable")[_last_of_quarter(len(part))]) for part in parts]
    points = np.array([a.points[k] for a, k in zip(some, last, strict=True)])
    exact = _searched(auditor, points, np.stack([a.stretch[k] for a, k in zip(some, last, strict=True)]), len(points))
    values = np.where(np.isnan(exact.margin), np.inf, exact.margin)
    found = iter(map(Margin, values.tolist(), exact.tolerance.tolist()))
    return [None if a is None else next(found) for a in around], ranked.error


def _searched(auditor: Auditor, points: np.ndarray, stretch: np.ndarray, finer: int) -> OwnLattice:
    parts = [part._replace(mask=part.mask[points]) for part in auditor.materials]
    return own_lattice(auditor.family, parts, stretch, path=False, finer=finer)
