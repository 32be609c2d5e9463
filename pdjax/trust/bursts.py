"""Bursts of breaking: bonds that break together, in space and in time.

The states of a run that are stored divide the time, or the load factor, into intervals. A **burst** is a set of bonds
that break within one interval and are connected in space: two bonds belong together if they share an end, or if an end
of one is a neighbour of an end of the other. A crack that grows over many intervals is a sequence of bursts.

Neighbours are those of the families before any bond broke, so a pre-crack made by `cut` separates bursts.
"""

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components

from ..geometry.bonds import Families


class BrokenTogether(NamedTuple):
    """Bonds of one burst, each once.

    `state` is the number of the last stored state before the burst, −1 if there is none. `first` and `last` are the
    times or load factors at which its first and last bond broke. `here` and `there` (bonds,) are the ends of its bonds,
    `slot` (bonds,) their slots in the families of `here`, and `leads` (bonds,) tells which of them broke at `first`.
    """

    state: int
    first: float
    last: float
    here: np.ndarray
    there: np.ndarray
    slot: np.ndarray
    leads: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """The ends of the bonds that broke first, each point once."""
        return np.unique([self.here[self.leads], self.there[self.leads]])


def bursts_of(
    families: Families, broken_at: Float[np.ndarray, "points bonds"], state: Int[np.ndarray, "points bonds"]
) -> list[BrokenTogether]:
    """The bursts, in the order of their first bonds, and at equal times in the order of their places.

    `broken_at` is inf for a bond that did not break. `state` is the number of the last stored state before it broke.
    """
    neighbours, real = np.asarray(families.neighbours), np.asarray(families.weight) > 0
    i, slot = np.nonzero(np.isfinite(broken_at) & np.asarray(families.is_bond))
    once = i < neighbours[i, slot]
    i, slot = i[once], slot[once]
    j, at, before = neighbours[i, slot], broken_at[i, slot], state[i, slot]
    found = []
    for number in np.unique(before):
        mine = np.flatnonzero(before == number)
        ends = np.unique([i[mine], j[mine]])
        local = np.full(len(families), -1)
        local[ends] = np.arange(len(ends))
        joined = real[ends] & (local[neighbours[ends]] >= 0)
        pairs = (
            np.concatenate([np.nonzero(joined)[0], local[i[mine]]]),
            np.concatenate([local[neighbours[ends]][joined], local[j[mine]]]),
        )
        graph = sp.coo_array((np.ones(len(pairs[0])), pairs), shape=(len(ends),) * 2)
        label = connected_components(graph, directed=False)[1][local[i[mine]]]
        for burst in range(label.max() + 1):
            bonds = mine[label == burst]
            times = at[bonds]
            first, last = float(times.min()), float(times.max())
            leads = times == times.min()
            found.append(BrokenTogether(int(number), first, last, i[bonds], j[bonds], slot[bonds], leads))
    return sorted(found, key=lambda b: (b.first, *place_of(families, b)))


def place_of(families: Families, burst: BrokenTogether) -> np.ndarray:
    """Centre (dim,) of the bonds that broke first, in the reference configuration [length]."""
    i, slot = burst.here[burst.leads], burst.slot[burst.leads]
    return (np.asarray(families.positions, float)[i] + np.asarray(families.xi, float)[i, slot] / 2).mean(axis=0)
