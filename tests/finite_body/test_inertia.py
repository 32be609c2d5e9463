"""Proofs of the number of positive eigenvalues, against exact rational arithmetic and against planted spectra."""

import functools
from fractions import Fraction

import bodies
import numpy as np
import pytest
import scipy.sparse as sp
from table import LINEAR, MODELS, in_dimensions

import pdjax as pd
from pdjax.finite_body import factorisation, inertia
from pdjax.finite_body.spectrum import scaled_matrix, zero_tolerance

EPS = np.finfo(float).eps


def exact_count(H, above=0.0):
    """Number of eigenvalues of the float64 matrix H above a number, from LDLᵀ in exact rational arithmetic."""
    rows = [[Fraction(float(x)) for x in row] for row in sp.csc_array(H).toarray()]
    size, positive = len(rows), 0
    for k in range(size):
        rows[k][k] -= Fraction(above)
    for k in range(size):
        pivot = rows[k][k]
        assert pivot != 0
        positive += pivot > 0
        for i in [i for i in range(k + 1, size) if rows[i][k] != 0]:
            ratio = rows[i][k] / pivot
            for j in range(k + 1, size):
                if rows[k][j] != 0:
                    rows[i][j] -= ratio * rows[k][j]
    return positive


def planted(size, seed, near):
    """A sparse symmetric matrix of norm near 1 with one eigenvalue at `near`, up to the rounding of its entries."""
    rng = np.random.default_rng([71, seed])
    values = rng.uniform(0.05, 1, size) * np.where(rng.random(size) < rng.uniform(0, 0.6), 1, -1)
    values[0] = near
    H = np.diag(values)
    for _ in range(2 * size):  # rotations in random planes keep the spectrum and fill some of the entries
        i, j = rng.choice(size, 2, replace=False)
        angle = rng.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        H[[i, j]] = turn @ H[[i, j]]
        H[:, [i, j]] = H[:, [i, j]] @ turn.T
    return sp.csc_array((H + H.T) / 2)


def proof_of(H):
    """`prove` with the norm and the tolerance that `body_spectrum` uses, and these two numbers."""
    norm = float(np.abs(np.linalg.eigvalsh(H.toarray())).max())
    tolerance = zero_tolerance(norm, float)
    return inertia.prove(H, norm, tolerance)[0], norm, tolerance


@pytest.mark.parametrize("near", [0.3, 1e-8, -1e-8, 1e-12, -1e-12, 1e-14, -1e-14, 1e-16, -1e-16, 0.0])
def test_no_count_that_is_claimed_as_proved_is_wrong(near):
    """The exact count is that of the float64 matrix, whose smallest eigenvalue differs from `near` by its rounding."""
    proved = 0
    for seed in range(12):
        H = planted(8 + 2 * seed, seed, near)
        found, _, tolerance = proof_of(H)
        proved += found.proved
        if found.proved:
            assert found.reason == ""
            assert found.positive == exact_count(H, tolerance) == exact_count(H, -tolerance)
        else:
            assert "an eigenvalue lies within" in found.reason or "exact only to" in found.reason
    # measured: 12 of 12 down to 1e-11, 11 of 12 at 1e-12, and none at 1e-13 or nearer to zero
    assert proved == 12 if abs(near) >= 1e-8 else proved == 0 if abs(near) <= 1e-14 else True


def test_a_small_pivot_does_not_prevent_a_proof_and_a_large_one_does_not_give_it():
    """The smallest pivot is not the smallest eigenvalue: it may be far smaller, or far larger."""
    found, *_ = proof_of(sp.csc_array([[1e-5, 1.0], [1.0, 1e-5]]))  # pivots 1e-5 and −1e5, eigenvalues near ±1
    assert found.proved and found.positive == 1 and found.error < 1e-9  # measured 1e-10
    L = np.eye(20) - np.tril(np.ones((20, 20)), -1)  # all pivots of −L Lᵀ are −1, its largest eigenvalue is −8e-12
    found, norm, _ = proof_of(sp.csc_array(-L @ L.T))
    assert norm > 1 and not found.proved and "an eigenvalue lies within" in found.reason
    # A zero on the diagonal becomes a pivot of the size of the shift, and the factorisation fails its check.
    found, *_ = proof_of(sp.csc_array([[1.0, 1.0], [1.0, 0.0]]))
    assert found.positive is None and not found.proved and found.reason


def random_sparse(size, seed):
    """A random sparse symmetric indefinite matrix with a diagonal."""
    rng = np.random.default_rng([72, seed])
    H = sp.random_array((size, size), density=3 / size, rng=rng, data_sampler=lambda size: rng.normal(size=size))
    return sp.csc_array(H + H.T + sp.diags_array(rng.normal(size=size)))


@pytest.mark.parametrize("make", [lambda seed: planted(40, seed, 0.2), lambda seed: random_sparse(80, seed)])
def test_the_backward_error_is_at_most_its_bound(make):
    """The error E of the symmetric factors is measured in extended precision with the permutation undone."""
    ratios = []
    for seed in range(8):
        H = make(seed)
        shifted = inertia.shifted(H, 1e-3)
        try:
            factor = factorisation.Factor(shifted)
        except factorisation.Singular:
            continue
        L, U = (x.toarray().astype(np.longdouble) for x in factor.triangles())
        D = np.diag(U)
        half = (L + (U / D[:, None]).T) / 2
        order = np.argsort(factor._lu.perm_c)
        exact = H.toarray().astype(np.longdouble) - np.longdouble(1e-3) * np.eye(H.shape[0])
        error = np.linalg.norm(((half * D) @ half.T - exact[order][:, order]).astype(float), 2)
        assert (np.sort(D)[::-1] > 0).sum() == factor.positive
        ratios.append(error / inertia.backward_bound(factor))
    assert len(ratios) > 4
    assert 1e-4 < max(ratios) < 0.3  # measured 0.001 to 0.01


# ---------------------------------------------------------------- bodies


def matrix_of(scene, u, factor=1.0):
    """H of a scene as `body_spectrum` makes it."""
    return scaled_matrix(factorisation.matrix(scene, u, factor), np.sqrt(factorisation.unknown_volumes(scene)))


def holds(found, H):
    """Whether the claim of a proved result is true of H, by exact arithmetic."""
    return found.positive == exact_count(H, found.tolerance) == exact_count(H, -found.tolerance)


HYPERELASTIC = ["seth_hill m=0", "correspondence neo-hookean", "bond_based", "lps", "bond_level", "silling control"]


@pytest.mark.parametrize("name, dim", in_dimensions(HYPERELASTIC))
def test_the_proved_count_of_a_clamped_body_is_exact(name, dim):
    """Clouds of unequal volumes, undeformed and compressed until most of them are unstable."""
    X = bodies.points(dim, "cloud").positions
    held = np.arange(dim + 1)
    for size in (0.0, 0.05, 0.4):
        u = -size * X
        scene = pd.scene(
            bodies.points(dim, "cloud"), bodies.families(dim, "cloud"), MODELS[name], pd.prescribe(held, u[held])
        )
        H = matrix_of(scene, u)
        assert (H != H.T).nnz == 0
        for method in ("dense", "sparse"):
            found = pd.body_stability(scene, u, method=method)
            assert found.proved and found.reason == "" and found.backward_error < 1e-12, found  # measured 3e-13
            assert "count proved" in str(found)
        assert holds(found, H)


@pytest.mark.parametrize("method", ["dense", "sparse"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_rigid_modes_are_not_counted_with_a_proof(dim, method):
    """A free body has d translations and, undeformed, d (d − 1)/2 rotations, whose eigenvalues are zero to rounding."""
    body, families = bodies.points(dim, "cloud"), bodies.families(dim, "cloud")
    scene = pd.scene(body, families, MODELS["bond_based"], moving=True)
    found = pd.body_stability(scene, np.zeros_like(body.positions), method=method)
    rigid = dim * (dim + 1) // 2
    assert found.verdict == "marginal" and found.positive == 0 and not found.proved
    assert (f"{rigid} eigenvalues lie" if rigid > 1 else "an eigenvalue lies") in found.reason
    assert f"not proved: {found.reason}" in str(found)


def test_the_proved_count_of_a_periodic_body_is_exact():
    """With one point held a periodic body has no rigid modes. With none held its translations prevent the proof."""
    body = pd.lattice((5, 3), 1.0, periodic=True)
    families = pd.families(body, 1.45)
    zero = np.zeros((15, 2))
    for F in (np.eye(2), np.diag([0.8, 0.9])):
        held = pd.scene(body, families, pd.SethHill(1.0, LINEAR), pd.prescribe(0), mean=F)
        found = pd.body_stability(held, zero)
        assert found.proved and holds(found, matrix_of(held, zero))
        free = pd.scene(body, families, pd.SethHill(1.0, LINEAR), mean=F, moving=True)
        found = pd.body_stability(free, zero)
        assert not found.proved and "2 eigenvalues lie" in found.reason


@functools.cache
def bar():
    return pd.scenes.step_size_bar(24, N=3, strain=-0.1)


@pytest.mark.parametrize("method", ["dense", "sparse"])
def test_the_proof_is_lost_at_the_critical_load_only(method):
    """Distances from the critical load are relative. Exact arithmetic counts at each load that is claimed as proved."""
    scene = bar()

    def stability(factor):
        found = pd.body_stability(scene, factor=factor, method=method)
        H = matrix_of(scene, factor * np.asarray(scene.closed_form), factor)
        assert not found.proved or holds(found, H)
        return found

    low, high = 0.0, 1.5 * pd.body_critical_load(scene).factor
    while high - low > 4 * EPS * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if stability(middle).eigenvalue > 0 else (middle, high)
    for distance in (1e-3, 1e-6, 1e-9):
        below, above = stability(low * (1 - distance)), stability(high * (1 + distance))
        assert below.proved and below.positive == 0 and above.proved and above.positive == 1
    for distance in (1e-15, 0.0):
        at = stability(low * (1 - distance)), stability(high * (1 + distance))
        assert not any(found.proved for found in at) and all("an eigenvalue lies" in found.reason for found in at)


def test_a_count_without_matrix_or_with_large_factors_says_why_it_is_not_proved(monkeypatch):
    found = pd.body_stability(bar(), method="matrix_free")
    assert not found.proved and "does not count" in found.reason and found.backward_error == np.inf
    monkeypatch.setattr(factorisation, "CHEAP", 1)
    for factor, positive in ((0.01, 0), (0.3, None)):
        found = pd.body_stability(bar(), factor=factor, method="sparse")
        assert not found.proved and "too large" in found.reason and (positive is None or found.positive == positive)
        assert found.positive == pd.body_stability(bar(), factor=factor, method="dense").positive
