"""Lattice symmetries of a cosine series, and the part of the Brillouin zone that has to be examined.

A **lattice symmetry** is a signed permutation matrix R with B_{Ro} = R B_o Rᵀ for all offsets o. Then
Ĵ(Rx) = R Ĵ(x) Rᵀ, so that the waves x and Rx have the same eigenvalues. R = −I always is a symmetry.

All signed permutation matrices W, 2, 8 and 48 of them in 1D, 2D and 3D, divide the zone into **chambers**

    { t W(1, v) :  0 ≤ t ≤ π,  0 ≤ … ≤ v₂ ≤ v₁ ≤ 1 }.

A symmetry maps chambers onto chambers. One chamber of every orbit is enough: one for a cubic state, and half of all
chambers for a state without other symmetries than −I. A proof leaves out the boxes that meet none of these chambers.
"""

import itertools
from functools import lru_cache

import numpy as np

# Largest deviation of a block from its mirror image that counts as rounding, relative to the largest block.
ROUNDING = 1e-13


@lru_cache(maxsize=4)
def signed_permutations(dim: int) -> np.ndarray:
    """All signed permutation matrices (matrices, dim, dim), the identity first."""
    found = []
    for order in itertools.permutations(range(dim)):
        for signs in itertools.product((1, -1), repeat=dim):
            found.append(np.eye(dim, dtype=int)[list(order)] * np.array(signs)[:, None])
    return np.stack(found)


@lru_cache(maxsize=256)
def _moved(matrix: bytes, dim: int, offsets: bytes) -> np.ndarray | None:
    """For every offset o, the index of R o or −R o in the offsets. None if one of them is not there."""
    R, o = np.frombuffer(matrix, int).reshape(dim, dim), np.frombuffer(offsets, int).reshape(-1, dim)
    index = {tuple(x): i for sign in (1, -1) for i, x in enumerate((sign * o).tolist())}
    places = [index.get(tuple(x)) for x in (o @ R.T).tolist()]
    return None if None in places else np.array(places)


def symmetries(blocks: np.ndarray, offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lattice symmetries (symmetries, dim, dim) that all states share, and the blocks averaged over them.

    The blocks (states, offsets, dim, dim) have every symmetry up to rounding, their average has it exactly.
    """
    dim, limit = offsets.shape[1], ROUNDING * np.abs(blocks).max(axis=(1, 2, 3))
    raw = np.ascontiguousarray(offsets, int).tobytes()
    group, mean = [], np.zeros_like(blocks)
    for R in signed_permutations(dim):
        places = _moved(R.tobytes(), dim, raw)
        if places is None:
            continue
        image = R.T @ blocks[:, places] @ R
        if (np.abs(image - blocks).max(axis=(1, 2, 3)) <= limit).all():
            group.append(R)
            mean += image
    found = np.stack(group)
    products = (found[:, None] @ found[None]).reshape(-1, dim * dim) @ 3 ** np.arange(dim * dim)
    if len(np.unique(products)) > len(found):  # Rounding has accepted a part of a group.
        return np.stack([np.eye(dim, dtype=int), -np.eye(dim, dtype=int)]), blocks
    return found, mean / len(found)


def chambers(group: np.ndarray) -> np.ndarray:
    """One matrix W (chambers, dim, dim) for every orbit of chambers under the symmetries of `group`."""
    left = {W.tobytes(): W for W in signed_permutations(group.shape[1])}
    found = []
    while left:
        W = next(iter(left.values()))
        found.append(W)
        for R in group:
            left.pop((R @ W).tobytes(), None)
    return np.stack(found)


def meets(chambers: np.ndarray, center: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Whether boxes (boxes, dim) meet the interior of one of the chambers. Every box lies in one orthant."""
    found = np.zeros(len(center), bool)
    for W in chambers:
        v, r = center @ W, half @ np.abs(W)
        inside = (v > 0).all(axis=1)
        for i, j in itertools.combinations(range(len(W)), 2):
            inside &= v[:, i] + r[:, i] > v[:, j] - r[:, j]
        found |= inside
    return found
