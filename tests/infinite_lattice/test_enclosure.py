"""Bounds of cosine series on boxes: against mpmath, against dense sampling, and the parts of the zone they cover."""

import itertools

import mpmath
import numpy as np
import pytest

from pdjax.infinite_lattice.certificate.boxes import Boxes, corners, first_boxes, first_cones, halved
from pdjax.infinite_lattice.certificate.chambers import chambers, meets, signed_permutations, symmetries
from pdjax.infinite_lattice.certificate.enclosure import Claims, Work, on_boxes, on_cones
from pdjax.infinite_lattice.certificate.polynomials import (
    ORDER,
    SAFE,
    at_vertices,
    is_negative,
    monomials,
    powers,
    replaced,
    top,
)
from pdjax.infinite_lattice.certificate.proof import prove
from pdjax.infinite_lattice.cosine_series import half_offsets, packed, upper

BONDS = {1: 6, 2: 28, 3: 32}


def a_series(dim, seed=0):
    """Random symmetric blocks (1, offsets, dim, dim) that decay with the offset, and the offsets."""
    rng, offsets = np.random.default_rng(seed), half_offsets(dim, BONDS[dim])
    blocks = rng.standard_normal((1, len(offsets), dim, dim)) / (1 + (offsets**2).sum(axis=1))[:, None, None]
    return blocks + blocks.transpose(0, 1, 3, 2), offsets


def claims_of(blocks, offsets, level=0.0):
    """The claims about a single state, and memory for 400 boxes."""
    made = Claims.of(blocks, offsets, np.array([level]), np.zeros((1, len(offsets))))
    return made, Work(offsets, 400)


def some_boxes(dim, count=40, seed=1, largest_half=0.25):
    """Random boxes of waves of many sizes."""
    rng = np.random.default_rng(seed)
    half = largest_half * rng.uniform(0.02, 1, (count, dim)) ** 3
    center = np.clip(rng.uniform(-1, 1, (count, dim)), half - 1, 1 - half)
    return Boxes(np.zeros(count, int), center, half, np.full(count, np.inf))


def some_cones(dim, count=40, seed=1):
    """Random cones of many sizes on random faces."""
    boxes, rng = some_boxes(dim, count, seed), np.random.default_rng(seed)
    face = np.arange(dim) == rng.integers(0, dim, count)[:, None]
    return boxes._replace(center=np.where(face, np.sign(boxes.center), boxes.center), half=boxes.half * ~face)


@pytest.mark.parametrize("kind", ["boxes", "cones"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_coefficients_of_all_orders_equal_those_of_mpmath_within_the_rounding_bound(dim, kind):
    blocks, offsets = a_series(dim)
    claims, work = claims_of(blocks, offsets)
    m, t = monomials(dim), np.array([0.25, 0.25, 0.25])
    T = mpmath.mpf(0.25 * SAFE)

    def g(p):
        return 2 - 2 * mpmath.cos(p) if kind == "boxes" else p**2 - T**2 * p**4 / 12

    boxes = some_boxes(dim, 3) if kind == "boxes" else some_cones(dim, 3)
    c = (on_boxes(claims, boxes, work) if kind == "boxes" else on_cones(claims, boxes, t, work)).c
    half = np.pi * boxes.half * SAFE + 1e-15 if kind == "boxes" else boxes.half
    scale = powers(half, m.exponents)
    if kind == "boxes":
        rounding = (claims.error[0, : len(c), None] * scale).sum(axis=0)
    else:
        rounding = np.full(3, claims.long_error[0] @ [1, 0.25**2])
    for n in range(3):
        center = [mpmath.mpf(float(x)) for x in (np.pi if kind == "boxes" else 1.0) * boxes.center[n]]
        with mpmath.workdps(60):
            dots = [sum(int(a) * x for a, x in zip(o, center, strict=True)) for o in offsets]
            series = [mpmath.taylor(g, p, ORDER) for p in dots]  # g(p + q) = Σ_k series_k q^k
        error = 0.0
        for k, a in enumerate(m.exponents.tolist()):
            multinomial = mpmath.factorial(sum(a)) * m.inverse_factorial[k]
            value = mpmath.zeros(dim)
            for C, o, terms in zip(blocks[0], offsets, series, strict=True):
                value -= mpmath.matrix(C.tolist()) * (terms[sum(a)] * float(np.prod(o.astype(float) ** a)))
            value *= multinomial * scale[k, n]
            error += float(mpmath.norm(value - mpmath.matrix(c[k, :, n][upper(dim)[1]].tolist()), 2))
        assert error <= rounding[n]  # measured: at most 4e-3 of it
        assert rounding[n] < 1e-8


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("level", [0.0, 0.7])
@pytest.mark.parametrize("kind", ["boxes", "cones"])
def test_no_point_of_a_box_exceeds_its_bound_and_the_polynomial_is_off_by_the_error_at_most(dim, level, kind):
    blocks, offsets = a_series(dim, 3)
    claims, work = claims_of(blocks, offsets, level)
    blocks = blocks[0] + level * (np.abs(offsets).sum(axis=1) == 1)[:, None, None] * np.eye(dim)
    boxes = some_boxes(dim, 300) if kind == "boxes" else some_cones(dim, 300)
    rng, m, place = np.random.default_rng(0), monomials(dim), upper(dim)[1]
    T = rng.uniform(0.02, 0.5, 300) ** 2

    def expanded(boxes, T):
        """The Taylor forms whose bounds count, with copies of their arrays."""
        many = [on_boxes(claims, boxes, work)] if kind == "boxes" else []
        if kind == "cones":
            for t in (0 * T, T):
                one = on_cones(claims, boxes, t, work)
                many.append(one._replace(c=one.c.copy()))
        return many

    def quotients(shift, t):
        """A at points of boxes, or A(ty)/t² at points of cones."""
        if kind == "boxes":
            c = 4 * np.sin(np.pi * (boxes.center + shift * boxes.half) @ offsets.T / 2) ** 2
        else:
            y = boxes.center + shift * boxes.half
            c = 4 * np.sin(t[:, None] * (y @ offsets.T) / 2) ** 2 / t[:, None] ** 2
        return -np.einsum("no,oij->nij", c, blocks)

    forms = expanded(boxes, T)
    values = [at_vertices(form.c, work.vertices).copy() for form in forms]
    bound = np.max([top(v, dim).max(axis=0) + f.error for v, f in zip(values, forms, strict=True)], axis=0)
    worst = np.full(300, -np.inf)
    for shift in [*rng.uniform(-1, 1, (40, dim)), *rng.choice([-1.0, 1.0], (8, dim))]:
        t = np.maximum(T * rng.choice([0.0, 1.0, rng.uniform()]), 1e-6)
        worst = np.maximum(worst, np.linalg.eigvalsh(quotients(shift, t))[:, -1])
        u = (
            shift * np.pi * boxes.half / (np.pi * boxes.half * SAFE + 1e-15)
            if kind == "boxes"
            else shift + 0 * boxes.half
        )
        off = quotients(shift, T * SAFE) - np.einsum("kn,kqn->nq", powers(u, m.exponents), forms[-1].c)[:, place]
        assert (np.linalg.norm(off, 2, axis=(1, 2)) <= forms[-1].error - replaced(forms[-1].c, dim) + 1e-13).all()
    assert (worst <= bound + 1e-12).all()
    # The bound is not idle: on small boxes it exceeds the eigenvalue at the centre by little.
    boxes = boxes._replace(half=boxes.half / 256)
    (form,) = expanded(boxes, T)[-1:]
    form.c[0] -= (np.linalg.eigvalsh(form.c[0].T[:, place])[:, -1] + 0.2) * np.eye(dim)[np.triu_indices(dim)][:, None]
    assert is_negative(at_vertices(form.c, work.vertices), form.error, dim).mean() > 0.9


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_polynomial_stays_below_its_matrices_at_the_vertices_plus_the_errors(dim):
    rng, m = np.random.default_rng(0), monomials(dim)
    assert len(m.exponents) == sum(1 for a in itertools.product(range(ORDER + 1), repeat=dim) if sum(a) <= ORDER)
    entries, boxes = dim * (dim + 1) // 2, 200
    c = rng.standard_normal((len(m.exponents), entries, boxes)) * rng.uniform(0, 1, (len(m.exponents), 1, boxes)) ** 8
    room = np.empty(4**dim * entries * boxes)
    bound = top(at_vertices(c, room), dim).max(axis=0) + replaced(c, dim)
    u = np.concatenate([rng.uniform(-1, 1, (3000, dim)), rng.choice([-1.0, 0.0, 1.0], (200, dim))])
    A = np.einsum("kp,kqn->pnq", powers(u, m.exponents), c)[..., upper(dim)[1]]
    assert (np.linalg.eigvalsh(A)[..., -1].max(axis=0) <= bound).all()


def test_a_long_wave_whose_margin_is_zero_ends_the_proof_with_a_small_bound():
    blocks, offsets = np.array([4.0, -1.0])[None, :, None, None], np.array([[1], [2]])  # Ĵ = −16 sin⁴(x/2)
    found = prove(blocks, offsets, np.zeros(1), 10**6)
    assert not found.done[0] and found.boxes[0] < 100
    assert 0 < found.upper[0] < 1e-11  # measured 1e-12
    found = prove(blocks, offsets, np.array([1e-6]), 10**6)
    assert found.done[0] and found.boxes[0] < 200
    found = prove(blocks, offsets, np.array([-1e-6]), 10**6)
    assert not found.done[0] and -1e-6 < found.value[0] <= 0


def test_states_that_are_proved_together_have_the_same_result_as_alone():
    blocks, offsets = a_series(2)
    many = -np.abs(blocks) + np.linspace(0, 2, 70)[:, None, None, None] * blocks
    level = np.tile(np.linspace(0.1, 60, 35), 2)
    together = prove(many, offsets, level, 10**5)
    assert 0 < together.done.sum() < 70
    for i in range(0, 70, 7):
        alone = prove(many[i : i + 1], offsets, level[i : i + 1], 10**5)
        assert alone.done[0] == together.done[i] and (alone.value[0] > level[i]) == (together.value[i] > level[i])


def test_negative_definite_matrices_are_told_from_others():
    rng = np.random.default_rng(0)
    for dim in (1, 2, 3):
        A = rng.standard_normal((500, dim, dim))
        A = A + A.swapaxes(-1, -2) - dim * np.eye(dim)
        excess = rng.uniform(0, 1, 500)
        highest = np.linalg.eigvalsh(A + excess[:, None, None] * np.eye(dim))[:, -1]
        P = packed(A).T
        assert (is_negative(P[None], excess, dim) == (highest < 0)).all() and 0 < (highest < 0).sum() < 500
        assert (top(P, dim) >= np.linalg.eigvalsh(A)[:, -1] - 1e-14).all()
        assert dim == 3 or np.allclose(top(P, dim), np.linalg.eigvalsh(A)[:, -1])


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_boxes_and_cones_cover_the_chambers_and_halves_cover_a_box(dim):
    rng = np.random.default_rng(0)
    for group in (signed_permutations(dim), np.stack([np.eye(dim, dtype=int), -np.eye(dim, dtype=int)])):
        found = chambers(group)
        v = np.sort(rng.uniform(0, 1, (200, dim)), axis=1)[:, ::-1]
        x = np.einsum("nij,nj->ni", found[rng.integers(0, len(found), 200)], v)
        y = x / np.abs(x).max(axis=1, keepdims=True)
        for points, boxes in ((x, first_boxes(1, found)), (y, first_cones(1, found))):
            for _ in range(3):
                inside = (np.abs(points[:, None] - boxes.center) <= boxes.half + 1e-15).all(axis=2)
                assert inside.any(axis=1).all()
                boxes = halved(boxes, np.argmax(boxes.half, axis=1))
                boxes = boxes.at(meets(found, boxes.center, boxes.half))
    boxes = first_boxes(1, chambers(signed_permutations(dim)))
    assert np.allclose(np.ptp(corners(boxes), axis=1), 2 * np.pi * boxes.half)


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
