"""Proof that the margins of states are at most given levels, by branch and bound over the Brillouin zone.

Long waves come first. Their cones (`boxes`) are divided until the bound (`enclosure`) shows on each of them that
A(x) = Ĵ(x) − μ κ²(x) I has no positive eigenvalue for t ≤ T. Where the remainder of the expansion in t is a large part
of a bound, T of the state is halved. Then the rest of the zone, |x|_∞ > T, is divided into boxes in the same way.
If A has a positive eigenvalue at the centre of a box, this wave refutes the claim.
"""

import sys
import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..bloch import laplacian, squared_chord
from ..cosine_series import upper
from .boxes import Boxes, corners, first_boxes, first_cones, halved, joined
from .chambers import chambers, meets, signed_permutations, symmetries
from .enclosure import UNIT, Claims, Taylor, Work, on_boxes, on_cones
from .polynomials import SAFE, at_vertices, is_negative, monomials, norms, top

_LONG = np.pi / 16  # First end T of the cones of long waves. π/8 and π/32 differ little in the number of boxes.
_SHORTEST = np.pi * 2.0**-20  # Smallest T. Below it rounding decides.
_NARROWEST = 2.0**-40  # Smallest half width of a cone.
_CHUNK = 2**17  # boxes × offsets that are bounded at once, so that the arrays stay in the cache
_STATES = 64  # States that are proved at once. The boxes of one state share a matrix product.


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
    regions : array, shape (boxes, 2^dim, dim), or None
        The corners x = h k of the boxes that are done, if they were asked for.
    """

    upper: np.ndarray
    done: np.ndarray
    boxes: np.ndarray
    value: np.ndarray
    wave: np.ndarray
    regions: np.ndarray | None


def prove(
    blocks: np.ndarray,
    offsets: np.ndarray,
    level: np.ndarray,
    boxes: int,
    seconds: float = np.inf,
    show: bool = False,
    keep: bool = False,
    error: np.ndarray | float = 0.0,
) -> Proof:
    """Try to prove that the margin of every state is at most its level μ.

    `blocks` (states, offsets, dim, dim) are the cosine series in units of M/h². Of every block only the symmetric part
    counts. The proof of a state ends after `boxes` boxes, and that of all after `seconds`, but not before its first
    boxes have been bounded. If `keep` is True, the boxes that are done are returned. `error` (states, offsets) bounds
    what is unknown of every block, in its norm.
    """
    end = time.monotonic() + seconds
    parts = [slice(first, first + _STATES) for first in range(0, len(blocks), _STATES)]
    error = np.broadcast_to(error, blocks.shape[:2])
    proofs = [
        _Search(blocks[part], offsets, level[part], boxes, end, show, keep, error[part]).proof() for part in parts
    ]
    joint = Proof(*(np.concatenate(arrays) for arrays in zip(*proofs, strict=True)))
    return joint if keep else joint._replace(regions=None)


class _Search:
    """Branch and bound of a few states."""

    def __init__(
        self,
        blocks: np.ndarray,
        offsets: np.ndarray,
        level: np.ndarray,
        boxes: int,
        end: float,
        show: bool,
        keep: bool,
        error: np.ndarray,
    ):
        symmetric = (blocks + blocks.transpose(0, 1, 3, 2)) / 2
        group, mean = symmetries(symmetric, offsets)
        change = np.linalg.norm(mean - symmetric, axis=(2, 3)) + 128 * UNIT * np.linalg.norm(mean, axis=(2, 3))
        change += error
        self.claims, self.chambers = Claims.of(mean, offsets, level, change), chambers(group)
        self.states, self.dim = len(blocks), offsets.shape[1]
        # The boxes of the first chambers of all orbits cover whole orthants if −I is the only symmetry.
        self.whole = 2 * len(self.chambers) == len(signed_permutations(self.dim))
        self.level, self.limit, self.end, self.show, self.keep = level, boxes, end, show, keep
        self.size = max(64, _CHUNK // len(offsets))
        self.work = Work(offsets, self.size)
        self.T = np.full(self.states, _LONG)
        self.count, self.upper = np.zeros(self.states, int), np.array(level, float)
        self.value, self.wave = np.full(self.states, -np.inf), np.zeros((self.states, self.dim))
        self.kept, self.kept_cones = [np.zeros((0, 2**self.dim, self.dim))], list[Boxes]()

    def proof(self) -> Proof:
        """Examine the cones, then the boxes."""
        self._examine(first_cones(self.states, self.chambers), self._cones)
        first = self._left(first_boxes(self.states, self.chambers))
        self.volume = self.total = _volume(first)
        self._examine(first, self._boxes)
        self._tell(end=True)
        done = (self.upper == self.level) & (self.value == -np.inf)
        cones = [corners(part, self.T[part.state]) for part in self.kept_cones]
        return Proof(self.upper, done, self.count, self.value, self.wave, np.concatenate([*cones, *self.kept]))

    def _examine(self, first: Boxes, step: Callable[[Boxes], Boxes]) -> None:
        """Bound and divide boxes until none is left. `step` returns the boxes that take the place of some."""
        queue = deque([first])
        while queue:
            some = queue.popleft()
            while queue and len(some.state) < self.size:
                some = joined([some, queue.popleft()])
            if len(some.state) > self.size:
                queue.appendleft(some.at(slice(self.size, None)))
                some = some.at(slice(self.size))
            over = (self.count[some.state] >= self.limit) | (time.monotonic() > self.end)
            late = (over & np.isfinite(some.bound)) | (self.value[some.state] > -np.inf)
            np.maximum.at(self.upper, some.state[late], some.bound[late])
            some = some.at(~late)
            if not len(some.state):
                continue
            some = some.at(np.argsort(some.state, kind="stable"))
            self.count += np.bincount(some.state, minlength=self.states)
            new = step(some)
            if len(new.state):
                queue.append(new)

    def _boxes(self, boxes: Boxes) -> Boxes:
        """Bound boxes of waves. Return the halves of those that are not done."""
        before = _volume(boxes)
        form = on_boxes(self.claims, boxes, self.work)
        done = self._is_negative(form)
        if self.keep:
            self.kept.append(corners(boxes.at(done)))
        boxes, form = boxes.at(~done), form.at(~done)
        x = np.pi * boxes.center
        self._refute(boxes.state, form.c[0], self.claims.error[boxes.state, 0], x)
        curved, excess = self._judged(form)
        nearest = np.pi * np.maximum(np.abs(boxes.center) - boxes.half, 0)
        kappa = np.maximum(laplacian(nearest), squared_chord(self.T[boxes.state]))
        bound = self.level[boxes.state] + SAFE * excess / kappa
        boxes = boxes._replace(bound=np.minimum(boxes.bound, bound))
        new = self._left(halved(boxes, np.argmax(curved, axis=0)))
        self.volume -= before - _volume(new)
        self._tell()
        return new

    def _cones(self, boxes: Boxes) -> Boxes:
        """Bound cones of long waves. Return the halves of those that are not done, or the same with a smaller T."""
        T = self.T[boxes.state]
        near = on_cones(self.claims, boxes, 0 * T, self.work)
        near_done = self._is_negative(near)
        near = near._replace(c=near.c.copy())  # The next expansion takes its memory.
        far = on_cones(self.claims, boxes, T, self.work)
        done = near_done & self._is_negative(far)
        if self.keep:
            self.kept_cones.append(boxes.at(done))
        boxes, near, far, T, near_done = boxes.at(~done), near.at(~done), far.at(~done), T[~done], near_done[~done]
        rounding = self.claims.long_error[boxes.state] @ np.array([1.0, _LONG**2])
        remainder = far.share[0]
        self._refute(boxes.state, T**2 * far.c[0], T**2 * (rounding + remainder), T[:, None] * boxes.center)
        curved, excess = (np.maximum(*both) for both in zip(self._judged(near), self._judged(far), strict=True))
        bound = self.level[boxes.state] + SAFE * np.pi**2 / 4 * excess  # κ²/t² is at least 4/π² in the zone.
        boxes = boxes._replace(bound=np.minimum(boxes.bound, bound))
        # If the limit t = 0 refutes the claim, so does a wave of a small T.
        positive = ~is_negative(near.c[:1], -rounding, self.dim)
        shorter = positive | near_done & (remainder > curved.sum(axis=0) / 4)
        self.T[np.unique(boxes.state[shorter])] /= 2
        lost = np.where(shorter, self.T[boxes.state] < _SHORTEST, boxes.half.max(axis=1) < _NARROWEST)
        np.maximum.at(self.upper, boxes.state[lost], boxes.bound[lost])
        same, cut = shorter & ~lost, ~shorter & ~lost
        new = halved(boxes.at(cut), np.argmax(curved[:, cut], axis=0))
        return joined([boxes.at(same), new.at(meets(self.chambers, new.center, new.half))])

    def _is_negative(self, form: Taylor) -> np.ndarray:
        return is_negative(at_vertices(form.c, self.work.vertices), form.error, self.dim)

    def _judged(self, form: Taylor) -> tuple[np.ndarray, np.ndarray]:
        """What every coordinate adds to the bound beyond first order (dim, boxes), and a bound of λ⁺(A) (boxes,)."""
        exponents = monomials(self.dim).exponents
        size, curved = norms(form.c, self.dim), exponents.sum(axis=1) > 1
        bound = top(form.c[0], self.dim) + SAFE * size[1:].sum(axis=0) + form.error
        return exponents[curved].T @ size[curved] + form.share, np.maximum(bound, 0.0)

    def _left(self, boxes: Boxes) -> Boxes:
        """The boxes that meet a chamber and do not lie among the long waves of the cones."""
        left = np.pi * (np.abs(boxes.center) + boxes.half).max(axis=1) > self.T[boxes.state]
        if not self.whole:
            left &= meets(self.chambers, boxes.center, boxes.half)
        return boxes.at(left)

    def _refute(self, state: np.ndarray, A: np.ndarray, error: np.ndarray, x: np.ndarray) -> None:
        """Store the waves x (boxes, dim) at which A (entries, boxes) has an eigenvalue above its error (boxes,)."""
        suspect = np.flatnonzero(~is_negative(A[None], -error, self.dim))
        highest = np.linalg.eigvalsh(A[:, suspect].T[:, upper(self.dim)[1]])[:, -1]
        quotient = self.level[state[suspect]] + highest / laplacian(x[suspect])
        found = np.where(highest > error[suspect], quotient, -np.inf)
        for i in np.argsort(found):
            s = state[suspect[i]]
            if found[i] > self.value[s]:
                self.value[s], self.wave[s] = found[i], x[suspect[i]]

    def _tell(self, end: bool = False) -> None:
        """The share of the zone that is done, on one line of the terminal."""
        if self.show and sys.stderr.isatty():
            share = 1.0 if end else 1 - self.volume / self.total
            text = f"\rproof: {self.count.sum()} boxes, {100 * share:3.0f} % of the zone"
            print(text, end="\n" if end else "", file=sys.stderr)


def _volume(boxes: Boxes) -> float:
    return float(np.prod(2 * boxes.half, axis=1).sum())
