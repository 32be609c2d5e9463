"""Criteria of concrete models on concrete families.

A small JAX program linearises the states (`pdjax.infinite_lattice.lattice_states`). The criteria "symbol" (a search of
the Brillouin zone), "diagonal" and "block" (sums of blocks) follow from the linearised states in NumPy. A map has
thousands of states. Their search is one JAX program, which all models share.

Every other criterion is a JAX program of its own, for STATES states at once. Inside `jit`, `grad` or `vmap` the
criteria are traced directly (`pdjax.infinite_lattice.criteria.evaluate`).
"""

from collections.abc import Callable
from functools import lru_cache, partial

import equinox as eqx
import jax
import numpy as np

from ..._internal.checks import computed_in_double
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..brillouin import Zone, brillouin_zone, in_zone
from ..cosine_series import packed, reached, works
from ..lattice_states import STATES, States, check_at_rest, checked_states, has_series, rings
from .outcome import Outcome, margin_tolerance
from .second_look import looked_again
from .waves import Found, search, search_few

# Number of states of a map that climb in one batch, by dimension: the fastest measured of 16, 64, 256 and 1024.
MANY = {1: 64, 2: 256, 3: 64}


@lru_cache(maxsize=64)
def _search(
    dim: int, bonds: int, rings: int, intervals: int, symmetry: str
) -> Callable[[np.ndarray, np.ndarray], Found]:
    """The search for many states as one program, which depends on sizes only."""
    offsets, zone = reached(dim, bonds, rings), brillouin_zone(dim, intervals, symmetry)
    return jax.jit(partial(search, offsets=offsets, zone=zone, group=MANY[dim]))


def searched(states: States, model: AbstractModel, family: LatticeFamily, zone: Zone) -> Found:
    """Where the searches of all states ended, as NumPy arrays."""
    scaled = packed(states.scaled)
    if len(scaled) <= STATES:
        return looked_again(states.scaled, states.offsets, zone, search_few(scaled, states.offsets, zone))
    count, many = len(scaled), MANY[family.dim]
    padded = np.zeros((-(-count // many) * many, *scaled.shape[1:]), scaled.dtype)
    padded[:count] = scaled
    program = _search(family.dim, len(family.influence), rings(model), zone.intervals, zone.symmetry)
    found = Found(*(x[:count] for x in computed_in_double(program, padded, np.asarray(count))))
    return looked_again(states.scaled, states.offsets, zone, found)


def from_states(
    criterion: str, model: AbstractModel, family: LatticeFamily, states: States, zone: Zone
) -> Outcome | None:
    """The named criterion of linearised states in NumPy, or None if it needs more than their cosine series."""
    if criterion not in FROM_STATES or not has_series(model) or (criterion == "symbol" and not model.hyperelastic):
        return None
    return FROM_STATES[criterion](model, family, states, zone)


def _symbol(model: AbstractModel, family: LatticeFamily, states: States, zone: Zone) -> Outcome:
    return at_waves(searched(states, model, family, zone), states, family)


def at_waves(found: Found, states: States, family: LatticeFamily) -> Outcome:
    """The outcome of the criterion "symbol" at the waves that a search or a proof has found."""
    M, h = states.modulus, states.spacing
    work, kappa2 = works(states.blocks, states.offsets, found.x, found.is_long, found.mode)
    margin = work * h**2 / (M * kappa2)
    never = np.zeros(len(work), bool)
    growth, _ = works(states.blocks, states.offsets, found.fast_x, never, found.fast_mode)
    unstable = margin > margin_tolerance(family.xi.dtype, found.scale)
    eigenvalue = np.where(unstable, growth, np.where(found.is_long, 0.0, work))
    x, mode = (np.where(unstable[:, None], a, b) for a, b in ((found.fast_x, found.x), (found.fast_mode, found.mode)))
    k = np.where((found.is_long & ~unstable)[:, None], 0.0, x)
    direction = x / np.linalg.norm(x, axis=1, keepdims=True)
    return Outcome(margin, eigenvalue, mode, in_zone(k) / h, direction, found.scale, tuple(found))


def _of_blocks(model: AbstractModel, family: LatticeFamily, states: States, zone: Zone, whole: bool) -> Outcome:
    D = -2 * states.blocks.sum(axis=1)
    if whole:
        symmetric = np.where(np.isfinite(D), (D + D.transpose(0, 2, 1)) / 2, 0.0)
        mode = np.linalg.eigh(symmetric)[1][..., -1]
    else:
        mode = np.eye(family.dim)[np.argmax(np.einsum("sii->si", D), axis=1)]
    value = np.einsum("si,sij,sj->s", mode, D, mode)
    margin = value / (np.asarray(states.modulus) * 2 * family.dim / states.spacing**2)
    return Outcome(margin, value, mode, scale=np.ones(len(D)), at=mode)


FROM_STATES: dict[str, Callable[[AbstractModel, LatticeFamily, States, Zone], Outcome]] = {
    "symbol": _symbol,
    "diagonal": partial(_of_blocks, whole=False),
    "block": partial(_of_blocks, whole=True),
}


@eqx.filter_jit
def _traced(criterion: str, model: AbstractModel, family: LatticeFamily, F, intervals: int, symmetry: str) -> Outcome:
    from . import evaluate

    zone = brillouin_zone(family.dim, intervals, symmetry)
    return jax.vmap(lambda F: evaluate(criterion, model, family, F, zone, fastest=True))(F)


def outcomes(criterion: str, model: AbstractModel, family: LatticeFamily, F: np.ndarray, zone: Zone) -> Outcome:
    """The named criterion at up to STATES deformations F (states, dim, dim), after checks of family and modulus.

    The result is an `Outcome` of NumPy arrays with a leading axis of states.
    """
    if criterion in FROM_STATES and has_series(model):
        out = from_states(criterion, model, family, checked_states(model, family, F), zone)
        if out is not None:
            return out
    check_at_rest(model, family)
    padded = np.broadcast_to(np.eye(family.dim), (STATES, family.dim, family.dim)).copy()
    padded[: len(F)] = F
    out = computed_in_double(_traced, criterion, model, family, padded, zone.intervals, zone.symmetry)
    return jax.tree.map(lambda x: np.broadcast_to(x, (STATES,))[: len(F)] if np.ndim(x) == 0 else x[: len(F)], out)
