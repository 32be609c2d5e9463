"""The spectrum of a body without its rigid motions, against a dense eigenproblem on an explicit complement."""

import bodies
import jax
import numpy as np
import pytest
import scipy.linalg
from bodies import worst
from table import LINEAR, MODELS

import pdjax as pd
from pdjax.finite_body import free_spectrum as module
from pdjax.finite_body.free_spectrum import free_spectrum
from pdjax.scenes import clamped_plate, step_size_bar

SVK = pd.SethHill(1.0, LINEAR)
LPS = pd.LPS(1.5, 0.7)
FREE = {dim: np.zeros((len(bodies.points(dim, "cloud")), dim), bool) for dim in (1, 2, 3)}


@jax.jit
def derivative(model, families, u):
    return jax.jacfwd(lambda u: pd.force_density(model, families, u))(u)


def rigid(x, pieces, turns=True):
    """Columns (components, motions): translations and infinitesimal rotations of each piece, one by one."""
    points, dim = x.shape
    columns = []
    for piece in pieces:
        inside = np.isin(np.arange(points), piece)[:, None]
        for k in range(dim):
            columns.append(inside * np.eye(dim)[k])
        for i in range(dim if turns else 0):
            for k in range(i + 1, dim):
                spin = np.zeros((dim, dim))
                spin[i, k], spin[k, i] = -1, 1
                columns.append(inside * (x @ spin.T))
    return np.stack([c.reshape(-1) for c in columns], axis=1)


def dense(model, families, u, motions, held=None):
    """All eigenvalues of V^½ J V^-½ on the free components, on the complement of the motions."""
    J = np.asarray(derivative(model, families, u)).reshape(u.size, -1)
    root = np.sqrt(np.repeat(np.asarray(families.volumes), u.shape[1]))
    free = np.arange(u.size) if held is None else np.flatnonzero(~held.reshape(-1))
    H = (root[:, None] * J / root)[np.ix_(free, free)]
    Q = scipy.linalg.null_space((root[:, None] * motions)[free].T) if motions is not None else np.eye(len(free))
    values = np.linalg.eigvalsh(Q.T @ (H + H.T) @ Q / 2)
    return values, np.abs(np.linalg.eigvalsh((H + H.T) / 2)).max(), Q.shape


@pytest.mark.parametrize("dim, pressed", [(1, 0.0), (1, 0.3), (2, 0.0), (2, 0.3), (3, 0.3)])
@pytest.mark.parametrize("path", ["dense", "sparse"])
def test_spectrum_of_a_stressed_free_body_is_that_on_the_complement_of_its_rigid_motions(
    dim, pressed, path, monkeypatch
):
    """A cloud with unequal volumes in a random state, and the same body rotated by a large angle."""
    if path == "sparse":
        monkeypatch.setattr(module, "DENSE", 0)
    families = bodies.families(dim, "cloud")
    X = np.asarray(families.positions)
    u = np.asarray(bodies.displacement(dim, "cloud", 2, size=0.05)) - pressed * X
    motions = rigid(X + u, [np.arange(len(X))])
    values, norm, shape = dense(SVK, families, u, motions)
    assert shape[1] == u.size - {1: 1, 2: 3, 3: 6}[dim]
    found = free_spectrum(SVK, families, u, None, FREE[dim])
    assert found.reason == "" and found.rigid == motions.shape[1]
    assert abs(found.eigenvalue - values[-1]) / norm < 3e-14  # measured 1e-15, dense and sparse
    assert found.positive == (values > 1e-10 * norm).sum()
    assert (found.positive > 0) == (pressed > 0)  # both kinds occur
    assert abs(np.linalg.norm(found.mode) - 1) < 1e-14  # measured 2e-16
    weighted = np.asarray(families.volumes)[:, None] * found.mode
    assert worst(motions.T @ weighted.reshape(-1)) < 2e-14  # measured 9e-16
    # The mode has the eigenvalue as its Rayleigh quotient.
    J = np.asarray(derivative(SVK, families, u)).reshape(u.size, -1)
    v = found.mode.reshape(-1)
    quotient = (weighted.reshape(-1) @ J @ v) / (weighted.reshape(-1) @ v)
    assert abs(quotient - values[-1]) / norm < 2e-14  # measured 9e-16
    R = bodies.rotation(dim, 7)
    turned = free_spectrum(SVK, families, (X + u) @ R.T - X + 2.0, None, FREE[dim])
    assert turned.positive == found.positive and turned.rigid == found.rigid
    assert abs(turned.eigenvalue - found.eigenvalue) / norm < 3e-14  # measured 8e-16


@pytest.mark.parametrize("path", ["dense", "sparse"])
@pytest.mark.parametrize("compressed", [False, True])
def test_rigid_rotation_of_a_compressed_body_is_no_instability(path, compressed, monkeypatch):
    """A uniform strain E stresses a free body. A rotation has the eigenvalue of the moment of its surface forces.

    Without the projection a compressed body has a positive eigenvalue more, or a stretched one has none less.
    """
    if path == "sparse":
        monkeypatch.setattr(module, "DENSE", 0)
    families = bodies.families(2, "cloud")
    u = (-0.02 if compressed else 0.02) * np.asarray(families.positions)
    motions = rigid(np.asarray(families.positions) + u, [np.arange(15)])
    with_rotation, norm, _ = dense(LPS, families, u, motions[:, :2])
    without, _, _ = dense(LPS, families, u, motions)
    assert (with_rotation[-1] > 1e-6 * norm) == compressed  # measured ±5e-3
    found = free_spectrum(LPS, families, u, None, FREE[2])
    assert found.positive == 0 and without[-1] < 0
    assert abs(found.eigenvalue - without[-1]) / norm < 3e-14  # measured 1e-15


@pytest.mark.parametrize("make, factor", [(step_size_bar, 0.1), (step_size_bar, 1.0), (clamped_plate, 1.0)])
def test_spectrum_of_a_supported_scene_is_that_of_body_stability(make, factor):
    if make is step_size_bar:
        scene = step_size_bar(100, 3, -1e-3)
    else:
        scene = clamped_plate((11, 10), 1.5, np.diag([0.9, 0.95]), SVK)
    u = factor * np.asarray(scene.closed_form)
    exact = pd.body_stability(scene, factor=factor)
    found = free_spectrum(scene.model, scene.families, u, None, ~scene.free)
    assert found.rigid == 0 and found.positive == exact.positive
    assert abs(found.eigenvalue - exact.eigenvalue) / exact.norm < 1e-14  # measured 1e-16
    assert not found.mode[~scene.free].any()
    # The largest eigenvalue is simple in all three: the next one is less by 2e-3 of the norm or more.
    assert abs(1 - abs(np.sum(found.mode * exact.mode))) < 1e-14  # measured 2e-16


@pytest.mark.parametrize("path", ["dense", "sparse"])
def test_a_body_that_is_held_in_part_keeps_its_free_rotation(path, monkeypatch):
    """One point is held: the rotation about it is free. A roller besides holds the rotation too."""
    if path == "sparse":
        monkeypatch.setattr(module, "DENSE", 0)
    families = bodies.families(2, "cloud")
    X = np.asarray(families.positions)
    u = 0.02 * X
    held = FREE[2].copy()
    held[3] = True
    x = X + u
    turn = np.stack([-(x - x[3])[:, 1], (x - x[3])[:, 0]], axis=1).reshape(-1, 1)
    values, norm, _ = dense(LPS, families, u, turn, held)
    found = free_spectrum(LPS, families, u, None, held)
    assert found.rigid == 1 and abs(found.eigenvalue - values[-1]) / norm < 1e-14  # measured 1e-16
    held[11, 1] = True
    values, norm, _ = dense(LPS, families, u, None, held)
    found = free_spectrum(LPS, families, u, None, held)
    assert found.rigid == 0 and abs(found.eigenvalue - values[-1]) / norm < 1e-14  # measured 3e-16


@pytest.mark.parametrize("path", ["dense", "sparse"])
def test_every_piece_has_its_own_rigid_motions(path, monkeypatch):
    """A plate cut in two, of which one part has lost a point: 3 + 3 + 2 motions."""
    if path == "sparse":
        monkeypatch.setattr(module, "DENSE", 0)
    families = pd.cut(pd.families(pd.lattice((7, 4)), 1.5), pd.Plane((4.0, 0.0), (1.0, 0.0)))
    i, j = np.arange(28)[:, None], np.asarray(families.neighbours)
    families = families.with_weight(np.asarray(families.weight) * ((i != 27) & (j != 27)))
    X = np.asarray(families.positions)
    parts = [np.flatnonzero(X[:, 0] < 4.0), np.flatnonzero(X[:, 0] > 4.0)[:-1], np.array([27])]
    u = 1e-3 * bodies.random(1).normal(size=X.shape)
    motions = rigid(X + u, parts)[:, :-1]  # a single point does not rotate
    values, norm, _ = dense(LPS, families, u, motions)
    found = free_spectrum(LPS, families, u, None, np.zeros((28, 2), bool))
    assert found.rigid == 8 and found.positive == 0
    assert abs(found.eigenvalue - values[-1]) / norm < 2e-14  # measured 1e-15


def test_a_periodic_body_has_translations_only():
    """The largest eigenvalue of a periodic lattice under F is that of its symbol over the waves that fit."""
    body = pd.lattice((6, 5), 0.5, periodic=True)
    families = pd.families(body, 1.01)
    F = np.diag([1.05, 0.97])
    found = free_spectrum(SVK, families, np.zeros((30, 2)), F, np.zeros((30, 2), bool), periodic=True)
    family = pd.lattice_family(2, 1.01 / 0.5, 0.5)
    waves = [(2 * np.pi / 3.0 * a, 2 * np.pi / 2.5 * b) for a in range(6) for b in range(5) if (a, b) != (0, 0)]
    values = [np.linalg.eigvalsh(np.asarray(pd.symbol(SVK, family, F, np.array(k)))) for k in waves]
    norm = np.abs(values).max()
    assert found.rigid == 2
    assert abs(found.eigenvalue - np.max(values)) / norm < 1e-14  # measured 2e-16
    assert found.positive == (np.array(values) > 1e-10 * norm).sum()


def test_a_bond_based_plate_that_is_a_mechanism_has_more_than_its_rigid_motions():
    """Springs between nearest neighbours only do not resist shear: eigenvalues are zero, not positive."""
    families = pd.families(pd.lattice((5, 3)), 1.0)
    found = free_spectrum(pd.BondBased(1.0), families, np.zeros((15, 2)), None, np.zeros((15, 2), bool))
    assert found.rigid == 3 and found.positive == 0 and abs(found.eigenvalue) < found.tolerance  # measured 0.02 of it


def test_what_has_no_spectrum_says_why(monkeypatch):
    families, u = bodies.families(2, "cloud"), np.zeros((15, 2))
    found = free_spectrum(MODELS["littlewood control"], families, u, None, FREE[2])
    assert found.positive is None and "no energy" in found.reason
    assert "held" in free_spectrum(LPS, families, u, None, ~FREE[2]).reason
    pressed = -np.asarray(families.positions)  # all points coincide
    assert "not finite" in free_spectrum(LPS, families, pressed, None, FREE[2]).reason
    monkeypatch.setattr(module, "LARGEST", {2: 29})
    found = free_spectrum(LPS, families, u, None, FREE[2])
    assert "30 unknowns are more than 29" in found.reason and found.eigenvalue is None and found.mode is None
