"""Measures of points against least squares, the polar decomposition, and energies summed in explicit loops."""

import bodies
import numpy as np
import pytest
import scipy.linalg
from bodies import worst
from table import MODELS

import pdjax as pd
from pdjax.trust import point_measures as module
from pdjax.trust.auditor import Auditor
from pdjax.trust.point_measures import alternation, point_measures, right_stretch

LAM, MU = 1.3, 0.7
SVK = pd.Correspondence(pd.LinearElastic(LAM, MU))
NAMES = ("zero_energy", "non_affine", "alternation")


def audited(model, families, u, F=None):
    """The measures as `audit` computes them."""
    return Auditor(model, families, np.zeros(u.shape, bool)).measures(np.asarray(u), F)


def measures(model, families, u, F=None):
    """The measures with moduli of 1, because those of a model take seconds to compile."""
    return point_measures(model, families, np.asarray(u), F, 1.0, 1.0)


def bonds_of(families, i):
    """Neighbour numbers, ξ and w = ω V of the bonds of point i that are not padding and not cut."""
    omega = np.asarray(families.influence[i]) * np.asarray(families.weight[i])
    real = omega > 0
    j = np.asarray(families.neighbours[i])[real]
    return j, np.asarray(families.xi[i])[real], omega[real] * np.asarray(families.volumes)[j]


def fitted(families, u, i):
    """H and z of point i from weighted least squares: min Σ w |η − H ξ|²."""
    j, xi, w = bonds_of(families, i)
    eta = u[j] - u[i]
    root = np.sqrt(w)[:, None]
    H = np.linalg.lstsq(root * xi, root * eta, rcond=None)[0].T
    return H, eta - xi @ H.T, w, xi


# ---------------------------------------------------------------- F̄, U and D²


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_gradient_and_non_affine_part_are_those_of_weighted_least_squares(dim):
    families = bodies.families(dim, "cloud")
    u = np.asarray(bodies.displacement(dim, "cloud", 5))
    found = measures(SVK, families, u)
    for i in range(len(u)):
        H, z, w, xi = fitted(families, u, i)
        assert worst(found.gradient[i], H) < 1e-14  # measured 1.4e-16
        stretch = scipy.linalg.polar(np.eye(dim) + H)[1] - np.eye(dim)
        assert worst(found.stretch[i], stretch) < 3e-14  # measured 1.2e-15
        D2, S = np.sum(w * np.sum(z**2, axis=1)), np.sum(w * np.sum((xi @ stretch) ** 2, axis=1))
        assert abs(found.non_affine[i] - D2 / (D2 + S)) < 1e-13  # measured 4e-15
        assert abs(found.det[i] - np.linalg.det(np.eye(dim) + H)) < 5e-15  # measured 2e-16
        values = np.linalg.eigvalsh((w[:, None] * xi).T @ xi)
        assert abs(found.shape_ratio[i] - values[0] / values[-1]) < 1e-14  # measured 0


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("size", [0.3, 1e-3])
def test_stretch_is_that_of_the_polar_decomposition(dim, size):
    for key in range(10):
        H = bodies.rotation(dim, key) @ bodies.deformation(dim, key, size=size) - np.eye(dim)
        U = scipy.linalg.polar(np.eye(dim) + H)[1]
        assert worst(right_stretch(H), U - np.eye(dim)) < 3e-14  # measured 1.7e-15


@pytest.mark.parametrize("size", [1e-6, 1e-9, 1e-12, 1e-14])
def test_stretch_of_a_tiny_strain_has_full_relative_accuracy(size):
    """For a symmetric H, U − I = H whatever its size. The polar decomposition of I + H would lose log10(1/size) digits.

    For a general small H the leading term is the symmetric part, and the next one ½(HᵀH − sym(H)²).
    """
    A = bodies.random(1).normal(size=(3, 3))
    symmetric = size * (A + A.T) / 2
    assert worst(right_stretch(symmetric), symmetric) < 1e-14 * size  # measured 1.2e-15
    H = size * A
    second = symmetric + (H.T @ H - symmetric @ symmetric) / 2
    # measured 6e-16, or 1.4 size² of the cubic term
    assert worst(right_stretch(H), second) < max(1e-14, 30 * size**2) * size


# ---------------------------------------------------------------- the energies


def micro(k, horizon, dim):
    """Micromodulus of springs of d-dimensional bulk modulus k for a full ball and ω = 1 (Silling & Askari 2005)."""
    return {1: 2 * k / horizon**2, 2: 12 * k / (np.pi * horizon**3), 3: 18 * k / (np.pi * horizon**4)}[dim]


def svk(U, xi, w, dim):
    E = (U @ U - np.eye(dim)) / 2
    return LAM / 2 * np.trace(E) ** 2 + MU * np.sum(E * E)


def lps(U, xi, w, dim):
    k, G = 1.5, 0.7
    theta = q = 0.0
    for b in range(len(xi)):
        r = np.linalg.norm(xi[b])
        q += w[b] * r**2
        theta += w[b] * r * (np.linalg.norm(U @ xi[b]) - r)
    theta *= dim / q
    W = k * theta**2 / 2
    for b in range(len(xi)):
        r = np.linalg.norm(xi[b])
        W += dim * (dim + 2) * G / q / 2 * w[b] * (np.linalg.norm(U @ xi[b]) - r - theta * r / dim) ** 2
    return W


def springs(U, xi, w, dim):
    W = 0.0
    for b in range(len(xi)):
        r = np.linalg.norm(xi[b])
        W += w[b] * 20.0 / 4 * (np.linalg.norm(U @ xi[b]) / r - 1) ** 2 * r
    return W


def spring_bulk(families, dim):
    """k of the springs on the interior lattice: W of F = (1 + ε) I is ½ d² k ε²."""
    n, h, horizon = 4, families.spacing, families.horizon
    grid = np.stack(np.meshgrid(*[np.arange(-n, n + 1)] * dim, indexing="ij"), -1).reshape(-1, dim) * h
    r = np.linalg.norm(grid, axis=1)
    r = r[(r > 0) & (r <= horizon * (1 + 1e-9))]
    return np.sum(h**dim * 20.0 * r) / (2 * dim**2)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("name", ["correspondence", "lps", "springs"])
def test_zero_energy_is_the_share_of_a_penalty_summed_in_loops(name, dim):
    """P/(P + W(U)) of a corner, an edge and an inner point. The shear model of LPS is d-dimensional."""
    families = pd.families(pd.lattice(bodies.SHAPES[dim], 0.5), horizon=1.01)
    model, W = {
        "correspondence": (SVK, svk),
        "lps": (pd.LPS(1.5, 0.7), lps),
        "springs": (pd.BondBased(20.0), springs),
    }[name]
    u = 0.02 * bodies.random(dim, 3).normal(size=families.positions.shape)
    bulk = {"correspondence": LAM + 2 * MU / dim, "lps": 1.5, "springs": spring_bulk(families, dim)}[name]
    found = audited(model, families, u)
    for i in (0, 1, 7):
        H, z, w, xi = fitted(families, u, i)
        U = scipy.linalg.polar(np.eye(dim) + H)[1]
        P = 0.5 * micro(bulk, 1.01, dim) / 1.01 * np.sum(w * np.sum(z**2, axis=1))
        energy = W(U, xi, w, dim)
        assert abs(found.zero_energy[i] - P / (P + energy)) < 3e-13  # measured 9e-15
        assert abs(found.energy[i] / (P + energy) - 1) < 5e-13  # measured 2e-14
        assert 0.01 < found.zero_energy[i] < 0.99  # so that both energies count


# ---------------------------------------------------------------- invariants over the table of models


@pytest.mark.parametrize("name", [n for n, m in MODELS.items() if 2 in m.dims])
def test_affine_deformations_are_no_zero_energy_mode_and_rotations_change_nothing(name):
    """Whatever the model, an affine map has z = 0, and a rotation of a rough state leaves all measures as they are."""
    model, families = MODELS[name], bodies.families(2, "cloud")
    X = np.asarray(families.positions)
    F = bodies.deformation(2, 4, size=0.2)
    affine = measures(model, families, X @ (F - np.eye(2)).T)
    assert affine.zero_energy.max() < 1e-29 and affine.non_affine.max() < 1e-29  # measured 2e-31
    assert worst(affine.gradient, np.broadcast_to(F - np.eye(2), affine.gradient.shape)) < 1e-15  # measured 4e-17
    u = np.asarray(bodies.displacement(2, "cloud", 6, size=0.05))
    R = bodies.rotation(2, 8)
    one, other = measures(model, families, u), measures(model, families, (X + u) @ R.T - X + 3.0)
    assert 0.01 < one.zero_energy.max() < 1
    for measure in NAMES:
        assert worst(getattr(one, measure), getattr(other, measure)) < 2e-12  # measured 9e-14
    assert worst(one.stretch, other.stretch) < 3e-14  # measured 1.1e-15
    # The same deformation as a mean F and a displacement under it.
    split = measures(model, families, u - X @ (F - np.eye(2)).T, F)
    for measure in NAMES:
        assert worst(getattr(one, measure), getattr(split, measure)) < 3e-14  # measured 1.4e-15


@pytest.mark.parametrize("length, pressure", [(1e-3, 1e9), (1e3, 1e-9), (1e-9, 1e11)])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_measures_do_not_depend_on_units(length, pressure, dtype):
    """The same cloud in m and mm, or nm, and with moduli in Pa and GPa."""
    points = bodies.points(2, "cloud")
    u = np.asarray(bodies.displacement(2, "cloud", 6))
    one = audited(SVK, pd.families(points, 2.3), u)
    scaled = pd.cloud((points.positions * length).astype(dtype), (points.volumes * length**2).astype(dtype))
    model = pd.Correspondence(pd.LinearElastic(dtype(LAM * pressure), dtype(MU * pressure)))
    other = audited(model, pd.families(scaled, 2.3 * length), (u * length).astype(dtype))
    for measure in (*NAMES, "stretch", "det", "shape_ratio"):
        assert worst(getattr(one, measure), getattr(other, measure)) < (1e-11 if dtype == np.float64 else 2e-5)
    # measured 1e-13 and 3e-6


# ---------------------------------------------------------------- the alternation


def test_a_checkerboard_alternates_and_a_quadratic_field_does_not():
    body = pd.lattice((13, 12), 0.5)
    families = pd.families(body, 1.51)
    X = body.positions
    cells = np.indices((13, 12)).reshape(2, -1).T
    sign = (-1.0) ** cells.sum(axis=1)
    middle = np.linalg.norm(X - X.mean(axis=0), np.inf, axis=1) < 1.3  # more than a horizon from every surface
    assert middle.sum() > 10
    board = measures(SVK, families, 1e-3 * sign[:, None] * np.array([1.0, -0.5]))
    assert worst(board.alternation[middle], 1.0) < 1e-15  # measured 0
    assert board.zero_energy[middle].min() > 0.98  # measured 1, U = I for a checkerboard
    smooth = measures(SVK, families, 1e-3 * np.stack([X[:, 0] ** 2, X[:, 0] * X[:, 1]], axis=1))
    assert smooth.alternation[middle].max() < -0.9  # measured −0.99: d is the same at all of them
    row = measures(SVK, families, 1e-3 * (-1.0) ** cells[:, :1] * np.array([0.0, 1.0]))
    assert row.alternation[middle].min() > 0.99  # measured 0.992: k = (π/h, 0) is found along its only direction
    assert worst(alternation(families, np.zeros_like(X))) == 0


def test_one_change_of_sign_at_a_surface_is_no_alternation():
    """d is 1 in the first row and −1 in all others, as at a free side. Two changes on two sides do alternate."""
    families = pd.families(pd.lattice((8, 5), 0.5), 1.01)
    row = np.indices((8, 5))[0].reshape(-1)
    once = np.where(row == 0, 1.0, -1.0)[:, None] * np.array([1.0, 0.5])
    assert alternation(families, once).max() < -0.9  # measured −1: each row is alike along itself
    stripe = np.where(row == 3, 1.0, -1.0)[:, None] * np.array([1.0, 0.5])
    found = alternation(families, stripe)
    assert worst(found[row == 3], 1.0) < 1e-15 and found[row != 3].max() < -0.9  # measured 0 and −1
    # In 1D the ends of an alternating chain have one neighbour only, and alternate like it. A pair of points does too.
    for n in (9, 2):
        chain = pd.families(pd.lattice((n,), 0.5), 0.51)
        assert worst(alternation(chain, (-1.0) ** np.arange(n)[:, None]), 1.0) < 1e-15  # measured 0
        assert alternation(chain, np.ones((n, 1))).max() == -1


# ---------------------------------------------------------------- families that are cut, padded or empty


def test_padding_changes_nothing():
    points = bodies.points(2, "cloud")
    plain = pd.families(points, bodies.HORIZONS[2], bodies.gaussian)
    padded = bodies.padded(plain, plain.xi.shape[1] + 3)
    u = np.asarray(bodies.displacement(2, "cloud", 6))
    one, other = measures(SVK, plain, u), measures(SVK, padded, u)
    for measure in one._fields:
        assert worst(getattr(one, measure), getattr(other, measure)) < 1e-14, measure  # measured 3e-16


def test_chunks_change_nothing(monkeypatch):
    families, u = bodies.families(2, "cloud"), np.asarray(bodies.displacement(2, "cloud", 6))
    lam = np.linspace(1.0, 2.0, 15)
    model = pd.Correspondence(pd.LinearElastic(lam, 0.7))
    arguments = model, families, u, None, np.linspace(1.0, 2.0, 15), 1.0
    whole = point_measures(*arguments)
    monkeypatch.setattr(module, "CHUNK", 4)
    parts = point_measures(*arguments)
    for measure in whole._fields:
        assert worst(getattr(whole, measure), getattr(parts, measure)) < 1e-15, measure  # measured 0


def test_fragments_and_pieces_have_finite_measures_and_do_not_affect_others():
    """A body of two pieces, one of which has a point without bonds and one with a single bond (K is singular)."""
    families = pd.families(pd.lattice((7, 4)), 2.3)
    i = np.arange(28)[:, None]
    j = np.asarray(families.neighbours)
    piece = i // 16 == j // 16  # columns 0–3 and 4–6
    lost = (i == 27) | (j == 27)
    single = ((i == 0) | (j == 0)) & ~(((i == 0) & (j == 1)) | ((i == 1) & (j == 0)))
    cut = families.with_weight(np.asarray(families.weight) * (piece & ~lost & ~single))
    u = 0.05 * bodies.random(2).normal(size=(28, 2))
    found = measures(pd.BondBased(20.0), cut, u)
    for measure in found._fields:
        assert np.isfinite(getattr(found, measure)).all(), measure
    assert found.shape_ratio[27] == 0 and found.zero_energy[27] == 0 and found.alternation[27] == 0
    assert found.shape_ratio[0] < 1e-15 and found.zero_energy[0] == 0
    alone = pd.families(pd.cloud(families.positions[16:27], 1.0), 2.3)
    rest = measures(pd.BondBased(20.0), alone, u[16:27])
    assert worst(found.non_affine[16:27], rest.non_affine) < 5e-15  # measured 1.1e-16
    assert worst(found.alternation[16:27], rest.alternation) < 1e-15  # measured 0


def test_a_periodic_body_has_no_surface():
    """The measures of a wave do not depend on where the box begins."""
    body = pd.lattice((8, 5), periodic=True)
    families = pd.families(body, 2.3)
    n = np.indices((8, 5)).reshape(2, -1).T
    u = 0.01 * np.stack([np.sin(2 * np.pi * n[:, 0] / 8), np.cos(2 * np.pi * n[:, 1] / 5)], axis=1)
    moved = np.roll(u.reshape(8, 5, 2), (3, 2), (0, 1)).reshape(-1, 2)
    one, other = measures(SVK, families, u), measures(SVK, families, moved)
    for measure in (*NAMES, "det"):
        shifted = np.roll(getattr(one, measure).reshape(8, 5), (3, 2), (0, 1)).reshape(-1)
        assert worst(shifted, getattr(other, measure)) < 1e-15, measure  # measured 0


# ---------------------------------------------------------------- rounding


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("shift", [0.0, 1.0, 1e6])
def test_rigid_motions_have_zero_measures(shift, dtype):
    """Rounding of a large motion is no zero-energy mode, in either precision."""
    families = bodies.families(2, "cloud")
    X = np.asarray(families.positions)
    u = (shift * (X @ bodies.rotation(2, 3).T - X) + 5 * shift * np.array([1.0, -2.0])).astype(dtype)
    if shift == 1e6:
        u = np.broadcast_to(u[:1], u.shape)  # a rotation moves no point by 10⁶ body sizes: a translation
        u = u + (X @ bodies.rotation(2, 3).T - X).astype(dtype)
    found = measures(SVK, families, u)
    assert found.zero_energy.max() < 1e-3 and found.non_affine.max() < 1e-3  # measured 3e-4 and 1.7e-4
