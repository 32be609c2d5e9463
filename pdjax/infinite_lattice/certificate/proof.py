"""Proof that the margins of states are at most given levels, by branch and bound over the Brillouin zone.

The chambers of the zone (`chambers`) are divided into boxes. A box is done if its bound (`enclosure`) shows that
A(x) = Ĵ(x) − μ κ²(x) I has no positive eigenvalue on it. Any other box is halved across the coordinate that adds most
to its bound. If A has a positive eigenvalue at the centre of a box, this wave refutes the claim.
"""

import sys
import time
from collections import deque
from typing import NamedTuple

import numpy as np

from .chambers import chambers, symmetries
from .enclosure import (
    SAFE,
    UNIT,
    Boxes,
    Claims,
    Taylor,
    corners_of,
    excess,
    is_negative,
    joined,
    largest,
    taylor,
    wave_vectors,
)

# Divisions of t in [0, π] and of every component of v in [0, 1] with which a proof starts: 8 to 32 and 2 to 8 differ by
# a tenth in the number of boxes.
FIRST = (8, 4)
_CHUNK = 2**17  # boxes × offsets that are bounded at once, so that the arrays stay in the cache
_KAPPA = np.pi**2 / 4  # κ²/t² is at least 1/_KAPPA in the zone.


class Proof(NamedTuple):
    """What is known about the margins of several states after a branch and bound.

    Attributes
    ----------
    upper : array, shape (states,)
        Upper bound of the margin. It is the level μ where every box is done.
    done : array, shape (states,)
        Whether every box is done.
    boxes : array, shape (states,)
        Number of boxes that were bounded.
    value : array, shape (states,)
        The largest quotient λ_max(Ĵ)/(M κ²) at a centre that exceeds the level μ, or −inf.
    wave : array, shape (states, dim)
        The wave x = h k of `value`.
    regions : Boxes or None
        The boxes that are done, if they were asked for.
    frames : array, shape (chambers, dim, dim)
        The matrices W of the chambers in which the boxes lie.
    """

    upper: np.ndarray
    done: np.ndarray
    boxes: np.ndarray
    value: np.ndarray
    wave: np.ndarray
    regions: Boxes | None
    frames: np.ndarray


def _first(states: int, frames: np.ndarray) -> Boxes:
    """The boxes with which the proof of several states starts."""
    count, dim = len(frames), frames.shape[1]
    parts = [FIRST[0]] + [FIRST[1]] * (dim - 1)
    axes = [(np.arange(n) + 0.5) / n for n in parts]
    center = np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], axis=1)
    half = np.broadcast_to(0.5 / np.array(parts), center.shape)
    inside = _inside(center, half)
    center, half = center[inside], half[inside]
    n = len(center)
    state = np.repeat(np.arange(states, dtype=np.int32), count * n)
    chamber = np.tile(np.repeat(np.arange(count, dtype=np.int32), n), states)
    again = (states * count, 1)
    return Boxes(state, chamber, np.tile(center, again), np.tile(half, again), np.full(len(state), np.inf))


def _inside(center: np.ndarray, half: np.ndarray) -> np.ndarray:
    """Whether a box meets its chamber, v₂ ≤ v₁."""
    if center.shape[1] < 3:
        return np.ones(len(center), bool)
    return center[:, 2] - half[:, 2] < center[:, 1] + half[:, 1]


def _halved(boxes: Boxes, T: Taylor, pairs: np.ndarray) -> Boxes:
    """Both halves of every box, cut across the coordinate with the largest part of the bound."""
    reach = T.half.copy()
    reach[:, 1:] *= np.pi * boxes.center[:, :1]
    share = reach**2 / (reach**2).sum(axis=1, keepdims=True)
    axis = np.argmax(pairs.sum(axis=2) + share * T.remainder[:, None], axis=1)
    each = np.arange(len(axis))
    half = boxes.half.copy()
    half[each, axis] /= 2
    low, high = boxes.center.copy(), boxes.center.copy()
    low[each, axis] -= half[each, axis]
    high[each, axis] += half[each, axis]
    both = joined([Boxes(boxes.state, boxes.chamber, c, half, boxes.bound) for c in (low, high)])
    return both.at(_inside(both.center, both.half))


def prove(
    blocks: np.ndarray,
    offsets: np.ndarray,
    level: np.ndarray,
    boxes: int,
    seconds: float = np.inf,
    show: bool = False,
    keep: bool = False,
) -> Proof:
    """Try to prove that the margin of every state is at most its level μ.

    `blocks` (states, offsets, dim, dim) are the cosine series in units of M/h². Of every block only the symmetric part
    counts. The proof of a state ends after `boxes` boxes, and that of all after `seconds`. If `keep` is True, the boxes
    that are done are returned.
    """
    symmetric = (blocks + blocks.transpose(0, 1, 3, 2)) / 2
    group, mean = symmetries(symmetric, offsets)
    change = np.linalg.norm(mean - symmetric, axis=(2, 3)) + 128 * UNIT * np.linalg.norm(mean, axis=(2, 3))
    claims, frames = Claims.of(mean, offsets, level, change), chambers(group)
    states, dim = len(blocks), offsets.shape[1]
    count, upper = np.zeros(states, int), np.array(level, float)
    value, wave = np.full(states, -np.inf), np.zeros((states, dim))
    queue, kept = deque([_first(states, frames)]), []
    size, start = max(64, _CHUNK // len(offsets)), time.monotonic()
    volume, whole = 0.0, float(states * len(frames)) / (2 if dim == 3 else 1)

    def leave(part: Boxes) -> None:
        np.maximum.at(upper, part.state, part.bound)

    while queue:
        some = queue.popleft()
        while queue and len(some.state) < size:
            some = joined([some, queue.popleft()])
        if len(some.state) > size:
            queue.appendleft(some.at(slice(size, None)))
            some = some.at(slice(size))
        late = (count[some.state] >= boxes) | (time.monotonic() - start > seconds) | (value[some.state] > -np.inf)
        leave(some.at(late))
        some = some.at(~late)
        if not len(some.state):
            continue
        count += np.bincount(some.state, minlength=states)
        T = taylor(claims, frames, some)
        more, pairs = excess(T)
        ends = corners_of(T.P, T.P1, T.half)
        done = is_negative(ends, np.broadcast_to(more[:, None], T.half.shape))
        if keep:
            kept.append(some.at(done))
        volume += float(np.prod(2 * some.half[done], axis=1).sum())
        _show(show, int(count.sum()), volume / whole)
        if done.all():
            continue
        some, T, pairs = some.at(~done), T.at(~done), pairs[~done]
        bound = level[some.state] + SAFE * _KAPPA * np.maximum(largest(ends[~done], more[~done]), 0.0)
        some = some._replace(bound=np.minimum(some.bound, bound))
        _refute(claims, frames, some, T, level, value, wave)
        queue.append(_halved(some, T, pairs))
    _show(show, int(count.sum()), 1.0, end=True)
    regions = joined(kept) if kept else None
    return Proof(upper, (upper == level) & (value == -np.inf), count, value, wave, regions, frames)


def _refute(claims: Claims, frames, boxes: Boxes, T: Taylor, level, value: np.ndarray, wave: np.ndarray) -> None:
    """Store the waves at which A has a positive eigenvalue that is more than rounding."""
    suspect = ~is_negative(T.P[:, None], np.zeros(T.half.shape))
    if not suspect.any():
        return
    some = boxes.at(suspect)
    top = np.linalg.eigvalsh(T.P[suspect])[:, -1]
    t, y = wave_vectors(some, frames)
    x = t[:, None] * y
    kappa = (4 * np.sin(x / 2) ** 2).sum(axis=1) / t**2
    found = np.where(top > T.rounding[suspect], level[some.state] + top / kappa, -np.inf)
    for i in np.argsort(found):
        if found[i] > value[some.state[i]]:
            value[some.state[i]], wave[some.state[i]] = found[i], x[i]


def _show(show: bool, boxes: int, share: float, end: bool = False) -> None:
    """The share of the zone that is done, on one line of the terminal."""
    if show and sys.stderr.isatty():
        print(f"\rproof: {boxes} boxes, {100 * share:3.0f} % of the zone", end="\n" if end else "", file=sys.stderr)


def corners(boxes: Boxes, frames: np.ndarray) -> np.ndarray:
    """The corners x = t W(1, v) [1/spacing] of boxes, shape (boxes, 2^dim, dim)."""
    dim = boxes.center.shape[1]
    signs = np.stack(np.meshgrid(*[(-1.0, 1.0)] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    each = (boxes.center[:, None] + signs * boxes.half[:, None]).reshape(-1, dim)
    many = Boxes(*(np.repeat(part, len(signs), axis=0) for part in boxes))._replace(center=each)
    t, y = wave_vectors(many, frames)
    return (t[:, None] * y).reshape(-1, len(signs), dim)
