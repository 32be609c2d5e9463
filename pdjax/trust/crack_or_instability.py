"""`crack_or_instability`: whether bonds broke because a crack grew, or because the model had become unstable before.

A bond also breaks where an instability of the discrete model has stretched it. The picture of the damage does not tell
the two apart. For every burst of breaking (`pdjax.trust.bursts`) this module asks whether the material around its first
bonds was sound in the last stored state before. It judges the **intact** lattice, without any damage, at the
deformation of the points around (`pdjax.trust.surroundings`). Three findings mean "instability first":

    unstable lattice   the margin of the infinite lattice under the stretch of the points exceeds its rounding error
    zero-energy mode   the lattice is soft, and neighbours alternate with a share of zero-energy modes above 0.1, or
                       the share is above 0.5
    collapse           det F̄ ≤ 0

A finding needs a quarter of the points around, because a wave needs room. Next to the faces of a crack single points
alternate in stable models too. Without a finding the verdict is "crack".

**Soft lattices.** −margin is the stiffness of the softest wave, divided by that of the classical law. In Silling's
model it is 0 to rounding: some waves meet no resistance, but they do not grow either. At the tip of a crack such waves
take up the strain, in general without alternating. The share tells which part of the deformation is not that of F̄,
weighted by the energy of a penalty of strength 1. In a model that resists all waves, a large share is only a steep
strain. A lattice is soft if its margin is above that of long waves times 0.3/N². For LPS this factor is 2/N²
(`pdjax.trust.surroundings.soft_margins`).

**Growth.** If the density ρ is known, an instability that cannot have grown does not count. A wave of margin μ grows at
most at the rate √(μ M/ρ) · 2√dim/h, with the P-wave modulus M. `growth` is this rate times the time since the start of
the run. Below 1 the instability is harmless in this run.

**Coarse states.** If the strains change by more than half between the stored state and the break, a state that looks
sound says nothing. The verdict is then "undecided".
"""

from typing import Any

import numpy as np

from .._internal.checks import finite
from .._internal.public import public_function
from ..force.fields import check_model
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from .audit import held_components
from .auditor import Auditor
from .bursts import BrokenTogether, bursts_of, place_of
from .checks import ALTERNATING, VARYING
from .fracture_verdict import CRACK, INSTABILITY, UNDECIDED, Burst, FractureVerdict
from .surroundings import (
    Around,
    Margin,
    States,
    margins_around,
    most_strained_first,
    read_states,
    soft_margins,
    surroundings,
)

COARSE = 0.5  # change of the strains between the stored state and the break, relative to them, that is too much


def _judged(
    burst: BrokenTogether,
    around: Around | None,
    margin: Margin | None,
    growth: float | None,
    soft: float,
    states: States,
) -> tuple[str, str]:
    """The verdict on a burst, and its reason."""
    if burst.state < 0:
        return UNDECIDED, f"no state before it was stored, the first one is at {states.at[0]:.6g}"
    if around is None or margin is None:
        return UNDECIDED, "no point around it has bonds left that determine its deformation"
    state = f"in state {burst.state}, {states.abscissa} = {states.at[burst.state]:.6g},"
    measured = f"margin {margin.value:.2g}, zero-energy share {around.share:.2g}"
    if margin.value == np.inf:
        return INSTABILITY, f"{state} the material around had collapsed, det F ≤ 0"
    harmless = growth is not None and growth < 1
    if margin.value > margin.rounding and not harmless:
        grown = "" if growth is None else f", growth of at most e^{growth:.1f} since the start"
        return INSTABILITY, f"{state} the intact lattice was unstable: {measured}{grown}"
    if margin.value > soft and around.alternating > ALTERNATING[1]:
        return INSTABILITY, f"{state} neighbours alternated in a zero-energy mode: {measured}"
    if margin.value > soft and around.share > VARYING:
        return INSTABILITY, f"{state} zero-energy modes of a soft lattice took up the strain: {measured}"
    if around.change > COARSE:
        change = "by an unknown amount" if np.isinf(around.change) else f"by {100 * around.change:.0f} %"
        advice = "take smaller load steps" if states.path else "take a smaller save_every"
        return UNDECIDED, f"{state} nothing was unstable, but up to the break the strains change {change}: {advice}"
    kind = "was stable" if margin.value < -margin.rounding else "was marginal"
    if margin.value > margin.rounding:
        kind = "had no time to become unstable"
    return CRACK, f"{state} the intact lattice {kind}: {measured}"


def _growth_of_one(auditor: Auditor, density: Any, states: States) -> np.ndarray | None:
    """The rate (points,) [1/time] of a margin of 1, None if it is not known."""
    if density is None:
        return None
    if states.path:
        raise ValueError("density is for a motion, and this run is a path of equilibria: leave density out")
    rho = finite("density", density)
    if (rho <= 0).any() or rho.shape not in ((), (len(auditor.families),)):
        raise ValueError(f"density must be > 0, one number or one for each point; got {density!r:.60}")
    return (
        np.sqrt(auditor.modulus / rho) * 2 * np.sqrt(auditor.families.dim) / float(np.asarray(auditor.family.spacing))
    )


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
        Supported points or components, such as `~scene.free`. Neighbours that alternate beside rigid clamps do not
        count.
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
    states = read_states(run, families)
    found = bursts_of(families, states.broken_at, states.last_before())
    found = [most_strained_first(families, states, burst) for burst in found]
    auditor = Auditor(model, families, held_components(held, families))
    rate = _growth_of_one(auditor, density, states)
    around = surroundings(auditor, states, found)
    soft = soft_margins(auditor)
    margins, error = margins_around(auditor, around)
    bursts, first = [], np.full(len(families), -1)
    for number, (burst, near, margin) in enumerate(zip(found, around, margins, strict=True)):
        growth, limit = None, -np.inf if near is None else float(soft[near.points].max())
        if rate is not None and near is not None and margin is not None:
            elapsed = states.at[burst.state] - states.at[0]
            growth = float(np.sqrt(max(margin.value, 0.0)) * rate[near.points].max() * elapsed)
        verdict, why = _judged(burst, near, margin, growth, limit, states)
        bursts.append(
            Burst(
                verdict,
                burst.first,
                burst.last,
                states.step_of(burst),
                burst.state,
                place_of(families, burst),
                len(burst.here),
                np.nan if margin is None else margin.value,
                np.nan if near is None else near.share,
                growth,
                why,
            )
        )
        ends = np.concatenate([burst.here, burst.there])
        first[ends[first[ends] < 0]] = number
    real = np.asarray(families.weight) > 0
    damage = (np.isfinite(states.broken_at) & real).sum(axis=1) / np.maximum(real.sum(axis=1), 1)
    notes = auditor.notes
    if error > 0:
        words = "the points around each burst were ranked by margins of groups of similar stretches, with errors up to"
        notes = (*notes, f"{words} {error:.1g}; the margin of the deciding point is its own")
    return FractureVerdict(tuple(bursts), damage, first, states.abscissa, notes, float(soft.max()))
