"""`crack_or_instability`: whether bonds broke because a crack grew, or because the model had become unstable before.

A bond also breaks where an instability of the discrete model has stretched it. The picture of the damage does not tell
the two apart. For every burst of breaking (`pdjax.trust.bursts`) this module asks whether the material around the first
bond was sound in the last stored state before it broke. It judges the **intact** lattice, without any damage, at the
deformation of the points around: the ends of the first bonds and their neighbours.

    unstable lattice   margin of the infinite lattice under the point's stretch above its rounding error
    zero-energy mode   share of zero-energy modes above 0.1, and neighbours alternate (`pdjax.trust.checks`)
    collapse           det F̄ ≤ 0

If a quarter of the points around shows one of them, the verdict is "instability first", otherwise "crack". A wave needs
room, so a single point does not decide: next to the faces of a crack single points alternate in stable models too. A
margin that is zero to rounding, as in Silling's model, is not positive. There the share of zero-energy modes decides.

**Deformation.** F̄ and the deviations from it come from the bonds that were left in that state. Points whose remaining
bonds have a nearly singular shape tensor (`THIN`) are not asked: their F̄ is not reliable.

**Growth.** If the density ρ is known, a margin μ that cannot have grown is harmless. The rate of growth is at most
√(μ M/ρ) · 2√dim/h, with the P-wave modulus M. Over the time since the start of the run a perturbation grows at most by
the factor e^growth. A margin with growth < 1 does not count.

**Coarse states.** Between the stored state and the break the deformation has changed. Let e be the strains of the bonds
around the first bond. Their rate is that between the last two states. If ‖Δe‖ up to the break is more than half of ‖e‖,
a state that looks sound says nothing, and the verdict is "undecided".
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from .._internal.checks import finite
from .._internal.public import public_function
from ..force.fields import check_model
from ..geometry.bonds import Families
from ..geometry.report import THIN
from ..models.base import AbstractModel
from .audit import held_components
from .auditor import Auditor
from .bursts import BrokenTogether, bursts_of, place_of
from .checks import ALTERNATING, alternating_shares
from .fracture_verdict import CRACK, INSTABILITY, UNDECIDED, Burst, FractureVerdict
from .own_lattice import OwnLattice, own_lattice

COARSE = 0.5  # change of the strains between the stored state and the break, relative to them, that is too much
FINER = 3  # times as many bins of stretches as in an audit: here they serve all states of a run
ROOM = 4  # one in so many points around the first bonds must be unstable


class _Run(NamedTuple):
    """What is read of a run. `strictly`: a stored state that has the number at which a bond broke comes after it."""

    abscissa: str
    at: np.ndarray
    u: np.ndarray
    broken_at: np.ndarray
    strictly: bool
    dt: float | None


class _Around(NamedTuple):
    """The points around the first bonds of a burst, in the state before it.

    `points` are the ones that are asked, `stretch` (points, dim, dim) is U − I (F̄ − I if the model is not objective),
    `share` their zero-energy share, and `change` the relative change of the strains up to the break.
    """

    points: np.ndarray
    stretch: np.ndarray
    share: np.ndarray
    change: float


def _read(run: Any, families: Families) -> _Run:
    """The states and the broken bonds of a History or of a BreakingPath."""
    abscissa = next((name for name in ("times", "load_factors") if hasattr(run, name)), None)
    if abscissa is None or not hasattr(run, "u") or not hasattr(run, "broken_at"):
        raise ValueError(
            "run must be a result of simulate or solve_breaking, with times or load_factors, u and broken_at; got"
            f" {type(run).__name__}"
        )
    if run.broken_at is None:
        raise ValueError("no bond could break in this run: pass breaking= to simulate")
    at, u, broken = np.asarray(getattr(run, abscissa), float), np.asarray(run.u), np.asarray(run.broken_at, float)
    if u.shape != (len(at), len(families), families.dim):
        raise ValueError(
            f"the run must hold u of every state, shape (states, points, dim) = ({len(at)}, {len(families)},"
            f" {families.dim}); got {u.shape}. Run simulate with fields=True"
        )
    finite("u of the run", u)
    if len(at) == 0 or (np.diff(at) < 0).any():
        raise ValueError(f"{abscissa} must have at least one entry and increase; got {at}")
    if broken.shape != families.weight.shape:
        raise ValueError(
            f"broken_at must have shape (points, bonds) = {families.weight.shape}, with inf for bonds that did not"
            f" break; got {broken.shape}"
        )
    broken = np.where(np.asarray(families.is_bond), broken, np.inf)
    back = broken[np.asarray(families.neighbours), np.asarray(families.reverse)]
    if (np.where(np.isfinite(broken) | np.isfinite(back), broken != back, False) & np.asarray(families.is_bond)).any():
        raise ValueError("broken_at must have the same value at both ends of a bond; these families are of another run")
    motion = abscissa == "times"
    return _Run("t" if motion else "load factor", at, u, broken, not motion, getattr(run, "dt", None))


def _quarter(values: Float[np.ndarray, " points"]) -> float:
    """The largest value that a quarter of the points reaches. NaN counts as smaller than any number."""
    ordered = np.sort(np.where(np.isnan(values), -np.inf, values))[::-1]
    return float(ordered[max(1, len(ordered) // ROOM) - 1])


def _strains(families: Families, points: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Strains |Y|/|ξ| − 1 of the remaining bonds of these points."""
    xi = np.asarray(families.xi)[points].astype(float)
    eta = (u[np.asarray(families.neighbours)[points]] - u[points][:, None]).astype(float)
    change = (2 * xi * eta + eta * eta).sum(axis=-1) / (xi * xi).sum(axis=-1)
    return (change / (1 + np.sqrt(np.maximum(1 + change, 0.0))))[np.asarray(families.weight)[points] > 0]


def _change(run: _Run, remaining: Families, points: np.ndarray, state: int, first: float) -> float:
    """The change of the strains from the stored state to the break, at the rate of the last two states, over them."""
    if first == run.at[state]:
        return 0.0
    if state == 0 or run.at[state] == run.at[state - 1]:
        return np.inf
    now, before = (_strains(remaining, points, run.u[k]) for k in (state, state - 1))
    size = float(np.linalg.norm(now))
    share = (first - run.at[state]) / (run.at[state] - run.at[state - 1])
    return float(np.linalg.norm(now - before)) * share / size if size > 0 else np.inf


def _surroundings(auditor: Auditor, families: Families, run: _Run, found: list[BrokenTogether]) -> list[_Around | None]:
    """The points around every burst in the state before it, None where no state was stored before."""
    around: list[_Around | None] = [None] * len(found)
    neighbours, real = np.asarray(families.neighbours), np.asarray(families.weight) > 0
    for state in sorted({burst.state for burst in found if burst.state >= 0}):
        moment = run.at[state]
        gone = run.broken_at <= moment if run.strictly else run.broken_at < moment
        remaining = families.with_broken(gone) if gone.any() else families
        now = auditor.of_remaining(remaining)
        measured = now.measures(run.u[state], None)
        share = alternating_shares(now.evidence(measured))
        G = measured.stretch if auditor.model.objective else measured.gradient
        for number, burst in enumerate(found):
            if burst.state == state:
                near = np.union1d(burst.ends, neighbours[burst.ends][real[burst.ends]])
                asked = near[measured.shape_ratio[near] > THIN]
                upright = np.where(measured.det[asked, None, None] > 0, G[asked], np.nan)
                change = _change(run, remaining, asked, state, burst.first)
                around[number] = _Around(asked, upright, share[asked], change)
    return around


def _lattices(auditor: Auditor, around: list[_Around | None]) -> tuple[list[OwnLattice | None], float]:
    """The margins of the points around each burst, from one search for all of them, and the error of its bins."""
    some = [a for a in around if a is not None and len(a.points)]
    if not some:
        return [None] * len(around), 0.0
    points, G = np.concatenate([a.points for a in some]), np.concatenate([a.stretch for a in some])
    parts = [part._replace(mask=part.mask[points]) for part in auditor.materials]
    whole = own_lattice(auditor.family, parts, G, path=False, finer=FINER)
    ends = np.cumsum([len(a.points) for a in some])[:-1]
    split = iter(zip(np.split(whole.margin, ends), np.split(whole.tolerance, ends), strict=True))
    out = [
        OwnLattice(*next(split), None, whole.bins, whole.error) if a is not None and len(a.points) else None
        for a in around
    ]
    return out, whole.error


def _judged(
    burst: BrokenTogether,
    around: _Around | None,
    lattice: OwnLattice | None,
    rate: np.ndarray | None,
    run: _Run,
) -> tuple[str, float, float, float | None, str]:
    """Verdict, margin, zero-energy share, growth and reason. `rate` (points,) [1/time] is that of a margin of 1."""
    if around is None:
        return UNDECIDED, np.nan, 0.0, None, f"no state before it was stored; the first one is at {run.at[0]:.6g}"
    if lattice is None:
        return UNDECIDED, np.nan, 0.0, None, "no point around it has bonds left that determine its deformation"
    collapsed = np.isnan(around.stretch).any(axis=(1, 2))
    margin = np.where(collapsed, np.inf, lattice.margin)
    over = _quarter(np.where(collapsed | (margin > lattice.tolerance), margin, -np.inf))
    value, share, growth = _quarter(margin), _quarter(around.share), None
    if rate is not None:
        elapsed = run.at[burst.state] - run.at[0]
        growth = float(np.sqrt(max(over, 0.0)) * rate[around.points].max() * elapsed)
    grown = growth is None or growth >= 1
    state = f"in state {burst.state}, {run.abscissa} = {run.at[burst.state]:.6g}"
    if over == np.inf:
        return INSTABILITY, value, share, growth, f"{state}, the material around had collapsed, det F ≤ 0"
    if over > 0 and grown:
        seen = f"zero-energy share {share:.2g}"
        more = "" if growth is None else f", growth up to e^{growth:.1f} since the start"
        return (
            INSTABILITY,
            value,
            share,
            growth,
            f"{state}, the intact lattice was unstable, margin {value:.2g}{more}; {seen}",
        )
    if share > ALTERNATING[1]:
        words = f"{state}, the points around were in a zero-energy mode, share {share:.2g}; margin {value:.2g}"
        return INSTABILITY, value, share, growth, words
    if around.change > COARSE:
        words = "by an unknown amount" if np.isinf(around.change) else f"by {100 * around.change:.0f} %"
        words = f"{state}, nothing was unstable, but up to the break the strains change {words}: store more states"
        return UNDECIDED, value, share, growth, words + (", with a smaller save_every" if not run.strictly else "")
    kind = f"was stable, margin {value:.2g}" if over <= 0 else f"had no time to grow, margin {value:.2g}"
    return CRACK, value, share, growth, f"{state}, the intact lattice {kind}; zero-energy share {share:.2g}"


@public_function
def crack_or_instability(
    model: AbstractModel, families: Families, run: object, *, held=None, density=None
) -> FractureVerdict:
    """Decide for every burst of breaking bonds whether a crack grew, or whether the model was unstable before.

    Parameters
    ----------
    model : AbstractModel
        The material model of the run.
    families : Families
        Families of the body at the start of the run, with pre-cracks.
    run : History or BreakingPath
        Result of `simulate` with `breaking`, or of `solve_breaking`. Any object with `times` [time] or `load_factors`
        [-], `u` (states, points, dim) and `broken_at` (points, bonds) will do.
    held : array of bool, shape (points,) or (points, dim), optional
        Supported points or components, such as `~scene.free`. Zero-energy modes beside rigid clamps are not counted.
    density : float or array, shape (points,), optional
        Density [mass/length^dim] of a motion. With it, an instability that had no time to grow does not count.

    Returns
    -------
    FractureVerdict
        The verdict of the first burst, and all bursts with their verdicts, times and places.

    Raises
    ------
    ValueError
        If the run did not keep its states, if no bond could break in it, or if it belongs to other families.

    Notes
    -----
    `pdjax.trust.crack_or_instability` states the criteria. "Crack" means that nothing unstable was found in the state
    before the break. It does not mean that the crack has converged.

    References
    ----------
    Silling 2017 (zero-energy modes of correspondence models).

    Examples
    --------
    A bar of springs is pulled apart. The lattice is stable under tension, so its fracture is a crack.

    >>> body = pd.bar(20, 20.0)
    >>> x = body.positions[:, 0]
    >>> families, model = pd.families(body, 2.0), pd.BondBased(1.0)
    >>> scene = pd.scene(body, families, model, pd.prescribe(x < 2, 0.0), pd.prescribe(x > 18, 1.0))
    >>> motion = pd.motion(scene, schedule=lambda t: 0.01 * t)
    >>> safe = (x < 4) | (x > 16)
    >>> history = pd.simulate(motion, 90.0, breaking=pd.CriticalStretch(0.02, no_fail=safe), show_progress=False)
    >>> pd.crack_or_instability(model, families, history, held=~scene.free).verdict
    'crack'
    """
    check_model(model, families, Families)
    families.need_arrays()
    states = _read(run, families)
    side = "left" if states.strictly else "right"
    before = np.searchsorted(states.at, states.broken_at, side) - 1
    found = bursts_of(families, states.broken_at, before)
    auditor = Auditor(model, families, held_components(held, families))
    around = _surroundings(auditor, families, states, found)
    lattices, error = _lattices(auditor, around)
    rate = None
    if density is not None and not states.strictly:
        h, rho = float(np.asarray(auditor.family.spacing)), finite("density", density)
        rate = np.sqrt(auditor.modulus / rho) * 2 * np.sqrt(families.dim) / h
    bursts, of = [], np.full(len(families), -1)
    for number, (burst, near, lattice) in enumerate(zip(found, around, lattices, strict=True)):
        verdict, margin, share, growth, why = _judged(burst, near, lattice, rate, states)
        step = burst.state + 1 if states.dt is None else round(burst.first / float(states.dt))
        place = place_of(np.asarray(families.positions, float), burst)
        bonds = len(burst.here)
        bursts.append(
            Burst(verdict, burst.first, burst.last, step, burst.state, place, bonds, margin, share, growth, why)
        )
        ends = np.concatenate([burst.here, burst.there])
        of[ends[of[ends] < 0]] = number
    real = np.asarray(families.weight) > 0
    lost = np.isfinite(states.broken_at) & real
    notes = auditor.notes
    if error > 0:
        notes = (
            *notes,
            f"margins were computed for groups of similar stretches; the largest error found is {error:.1g}",
        )
    damage = lost.sum(axis=1) / np.maximum(real.sum(axis=1), 1)
    return FractureVerdict(tuple(bursts), damage, of, states.abscissa, notes)
