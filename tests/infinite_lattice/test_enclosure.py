"""Bounds of cosine series on boxes: against mpmath, against dense sampling, and the parts of the zone they cover."""

import mpmath
import numpy as np
import pytest

from pdjax.infinite_lattice.certificate.chambers import chambers, signed_permutations, symmetries
from pdjax.infinite_lattice.certificate.enclosure import (
    Boxes,
    Claims,
    corners_of,
    excess,
    is_negative,
    largest,
    taylor,
    wave_vectors,
)
from pdjax.infinite_lattice.cosine_series import half_offsets

BONDS = {1: 6, 2: 28, 3: 32}


def a_series(dim, seed=0):
    """Random symmetric blocks (1, offsets, dim, dim) that decay with the offset, and the offsets."""
    rng, offsets = np.random.default_rng(seed), half_offsets(dim, BONDS[dim])
    blocks = rng.standard_normal((1, len(offsets), dim, dim)) / (1 + (offsets**2).sum(axis=1))[:, None, None]
    return blocks + blocks.transpose(0, 1, 3, 2), offsets


def some_boxes(dim, count=40, seed=1, largest_half=0.25):
    """Random boxes of many sizes, some of which touch t = 0, in random chambers."""
    rng = np.random.default_rng(seed)
    half = largest_half * rng.uniform(0.02, 1, (count, dim)) ** 3
    center = np.clip(rng.uniform(0, 1, (count, dim)), half, 1 - half)
    center[::4, 0] = half[::4, 0]
    chamber = rng.integers(0, len(signed_permutations(dim)), count)
    return Boxes(np.zeros(count, int), chamber, center, half, np.full(count, np.inf))


def exact(blocks, offsets, t, y):
    """P(t, y) = −Σ C_o 4 sin²(t o·y/2)/t² in the precision of mpmath."""
    total = mpmath.zeros(blocks.shape[1])
    for C, o in zip(blocks, offsets, strict=True):
        p = sum(mpmath.mpf(int(a)) * b for a, b in zip(o, y, strict=True))
        total -= mpmath.matrix(C.tolist()) * (4 * mpmath.sin(t * p / 2) ** 2 / t**2)
    return total


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_value_and_derivatives_of_P_equal_those_of_mpmath_within_the_rounding_bound(dim):
    blocks, offsets = a_series(dim)
    claims = Claims.of(blocks, offsets, np.zeros(1), np.zeros((1, len(offsets))))
    frames, boxes = signed_permutations(dim), some_boxes(dim, 6)
    T = taylor(claims, frames, boxes)
    for n in range(len(boxes.state)):
        W, (t, *v) = frames[boxes.chamber[n]], [mpmath.mpf(float(c)) for c in boxes.center[n]]
        t = mpmath.mpf(float(wave_vectors(boxes.at(np.array([n])), frames)[0][0]))

        def at(*z, W=W):
            y = [sum(int(W[i, j]) * a for j, a in enumerate((1, *z[1:]))) for i in range(dim)]
            return exact(blocks[0], offsets, z[0], y)

        def entry(order, i, j, z=(t, *v), at=at):
            with mpmath.workdps(40):
                return mpmath.diff(lambda *z: at(*z)[i, j], z, order) if any(order) else at(*z)[i, j]

        first = np.eye(dim, dtype=int)
        i, j = n % dim, (n + 1) % dim
        errors = [abs(T.P[n, i, j] - entry((0,) * dim, i, j))]
        for a in range(dim):
            errors.append(abs(T.P1[n, a, i, j] - entry(tuple(first[a]), i, j)) * T.half[n, a])
            for b in range(dim):
                second = entry(tuple(first[a] + first[b]), i, j)
                errors.append(0.5 * abs(T.P2[n, a, b, i, j] - second) * T.half[n, a] * T.half[n, b])
        assert float(sum(errors)) <= T.rounding[n]  # measured: at most 4e-5 of it
        assert T.rounding[n] < 1e-9


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("level", [0.0, 0.7])
def test_no_point_of_a_box_exceeds_its_bound(dim, level):
    blocks, offsets = a_series(dim, 3)
    claims = Claims.of(blocks, offsets, np.array([level]), np.zeros((1, len(offsets))))
    frames, boxes = signed_permutations(dim), some_boxes(dim, 300)
    T = taylor(claims, frames, boxes)
    more, _ = excess(T)
    bound = largest(corners_of(T.P, T.P1, T.half), more)
    rng, worst = np.random.default_rng(0), np.full(len(bound), -np.inf)
    blocks = blocks[0] + level * (np.abs(offsets).sum(axis=1) == 1)[:, None, None] * np.eye(dim)
    for shift in [*rng.uniform(-1, 1, (40, dim)), *rng.choice([-1.0, 1.0], (8, dim))]:
        t, y = wave_vectors(boxes._replace(center=boxes.center + shift * boxes.half), frames)
        t = np.maximum(t, 1e-6)
        c = 4 * np.sin(t[:, None] * (y @ offsets.T) / 2) ** 2 / t[:, None] ** 2
        worst = np.maximum(worst, np.linalg.eigvalsh(-np.einsum("no,oij->nij", c, blocks))[:, -1])
    assert (worst <= bound + 1e-12).all()
    # The bound is not idle: on small boxes it exceeds the eigenvalue at the centre by little.
    T = taylor(claims, frames, boxes._replace(half=boxes.half / 256))
    above = corners_of(T.P - (np.linalg.eigvalsh(T.P)[:, -1] + 0.05)[:, None, None] * np.eye(dim), T.P1, T.half)
    assert is_negative(above, excess(T)[0][:, None] * np.ones(dim)).all()


def test_negative_definite_matrices_are_told_from_others():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((500, 1, 3, 3))
    A = A + A.swapaxes(-1, -2) - 2 * np.eye(3)
    excess = rng.uniform(0, 1, (500, 3))
    top = np.linalg.eigvalsh(A[:, 0] + excess[:, :, None] * np.eye(3))[:, -1]
    assert (is_negative(A, excess) == (top < 0)).all() and 0 < (top < 0).sum() < 500


@pytest.mark.parametrize(("dim", "every"), [(1, 2), (2, 8), (3, 48)])
def test_chambers_cover_the_zone_once_under_the_symmetries(dim, every):
    matrices = signed_permutations(dim)
    assert len(matrices) == every
    assert len(chambers(matrices)) == 1
    assert len(chambers(np.stack([np.eye(dim, dtype=int), -np.eye(dim, dtype=int)]))) == every // 2


@pytest.mark.parametrize("dim", [2, 3])
def test_symmetries_of_a_series_are_found_and_the_average_over_them_keeps_a_symmetric_series(dim):
    blocks, offsets = a_series(dim, 5)
    group, _ = symmetries(blocks, offsets)
    assert len(group) == 2  # a series without symmetry
    matrices = signed_permutations(dim)
    index = {tuple(s * x): i for s in (1, -1) for i, x in enumerate(offsets)}
    places = np.array([[index[tuple(R @ o)] for o in offsets] for R in matrices])
    cubic = np.mean([R.T @ blocks[:, p] @ R for R, p in zip(matrices, places, strict=True)], axis=0)
    group, mean = symmetries(cubic, offsets)
    assert len(group) == len(matrices)
    assert np.abs(mean - cubic).max() < 1e-14  # measured 4e-16
