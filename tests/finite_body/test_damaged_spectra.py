"""Spectra of bodies after bonds have broken, against the eigenvalues of a dense Jacobian by automatic differentiation.

The body is a plate with a crack of broken bonds, unequal volumes and a random strain. In some tests one point, or a
corner of several points, has lost all its bonds to the rest.
"""

import jax
import numpy as np
import pytest
from table import LINEAR

import pdjax as pd
from pdjax.finite_body.free_spectrum import free_spectrum

SHAPE = (8, 6)
X = pd.lattice(SHAPE).positions
RANDOM = np.random.default_rng(5)
BODY = pd.cloud(X, RANDOM.uniform(0.8, 1.2, len(X)))
FAMILIES = pd.families(BODY, 2.1)
WHOLE = np.asarray(FAMILIES.weight) > 0
LEFT = X[:, 0] < 2
U = 0.02 * X * [1.0, -0.3] + 1e-3 * RANDOM.normal(size=X.shape)
MODELS = {
    "bond-based": pd.BondBased(1.0),
    "LPS": pd.LPS(1.5, 0.7),
    "correspondence": pd.Correspondence(LINEAR),
    "Seth-Hill with control": pd.SethHill(1.0, LINEAR, pd.SillingControl(0.5)),
}
FREE = np.zeros(X.shape, bool)


def parted(points):
    """The bonds (points, bonds) that join these points to others."""
    inside = np.isin(np.arange(len(X)), points)
    return WHOLE & (inside[:, None] != inside[np.asarray(FAMILIES.neighbours)])


NOTCH = pd.Segment((4.0, -1.0), (4.0, 3.0))
CRACK = np.asarray(pd.cut(FAMILIES, NOTCH).weight) < np.asarray(FAMILIES.weight)
ONE = [int(np.argmin(np.abs(X - [5.5, 3.5]).sum(axis=1)))]
CORNER = np.flatnonzero((X[:, 0] > 6) & (X[:, 1] > 4))  # four points
PARTS = {"point": ONE, "corner": CORNER}


def cracked(fragment=()):
    """The families after the crack has broken, and the bonds of a fragment."""
    return FAMILIES.with_broken(CRACK | parted(np.asarray(fragment, int)))


def scene(model, families, moving=False):
    return pd.scene(BODY, families, model, pd.prescribe(LEFT, 0.0), moving=moving)


def dense(model, families, free=None):
    """The matrix V^½ J V^-½ on the free components."""
    J = np.asarray(jax.jit(jax.jacfwd(lambda u: pd.force_density(model, families, u)))(U)).reshape(U.size, -1)
    root = np.sqrt(np.repeat(BODY.volumes, 2))
    some = np.arange(U.size) if free is None else np.flatnonzero(free.reshape(-1))
    return (root[:, None] * J / root)[np.ix_(some, some)]


@pytest.mark.parametrize("name", list(MODELS))
def test_spectrum_of_a_cracked_body_is_that_of_its_dense_jacobian(name):
    model, families = MODELS[name], cracked()
    plate = scene(model, families)
    H = dense(model, families, plate.free)
    values, modes, about = pd.body_spectrum(plate, U)
    exact = np.linalg.eigvalsh((H + H.T) / 2)[::-1]
    assert np.abs(H - H.T).max() < 1e-13 * about["norm"]  # measured 1e-16
    assert np.abs(values - exact).max() < 1e-13 * about["norm"]  # measured 2e-15
    assert about["positive"] == (exact > about["tolerance"]).sum() == 0 and about["proved"]
    top, _, counted = pd.body_spectrum(plate, U, 3, method="sparse")
    assert np.abs(top - exact[:3]).max() < 1e-12 * about["norm"] and counted["positive"] == 0  # measured 5e-16
    assert pd.body_stability(plate, U).verdict == "stable" and modes.shape == (len(exact), len(X), 2)


@pytest.mark.parametrize("part", list(PARTS))
@pytest.mark.parametrize("name", list(MODELS))
def test_zero_modes_of_a_fragment_are_no_instability(name, part):
    """The whole plate is held at the left, so only the fragment is loose."""
    model, families = MODELS[name], cracked(PARTS[part])
    plate = scene(model, families, moving=True)
    H = dense(model, families, plate.free)
    exact = np.linalg.eigvalsh((H + H.T) / 2)
    if part == "point":
        state = pd.body_stability(plate, U)
        assert state.positive == 0 and state.verdict == "marginal"
        assert (np.abs(exact) < state.tolerance).sum() == 2  # measured 2e-15; the next one is -5e-3
    found = free_spectrum(model, families, U, None, ~plate.free)
    assert found.positive == 0 and found.reason == "" and found.rigid == {"point": 2, "corner": 3}[part]
    # Without the point, and without the rigid motions of the corner, the rest has negative eigenvalues only.
    inside = np.isin(np.arange(len(X)), PARTS[part])
    rest = dense(model, families, plate.free & ~inside[:, None])
    largest = [np.linalg.eigvalsh((rest + rest.T) / 2)[-1]]
    if part == "corner":
        x = (X + U)[inside]
        spin = (x - x.mean(axis=0)) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        motions = np.stack([np.tile([1.0, 0.0], (len(x), 1)), np.tile([0.0, 1.0], (len(x), 1)), spin])
        motions = (np.sqrt(BODY.volumes[inside])[:, None] * motions).reshape(3, -1)
        Q = np.linalg.svd(motions)[2][3:]
        own = dense(model, families, np.broadcast_to(inside[:, None], X.shape))
        largest.append(np.linalg.eigvalsh(Q @ (own + own.T) @ Q.T / 2)[-1])
    assert found.eigenvalue == pytest.approx(max(largest), abs=1e-13)  # measured 1e-15
    assert pd.audit(model, families, U, held=~plate.free, margins=False).positive == 0


def test_a_scene_at_rest_names_the_fragment_that_nothing_holds():
    with pytest.raises(ValueError, match=f"it contains point {ONE[0]}.*moving=True"):
        scene(MODELS["LPS"], cracked(ONE))


def test_breaking_bonds_at_rest_lowers_no_eigenvalue_of_a_bond_based_body():
    """The energy loses non-negative terms, so every eigenvalue of J rises or stays."""
    plates = scene(MODELS["bond-based"], FAMILIES), scene(MODELS["bond-based"], cracked())
    whole, broken = (pd.body_spectrum(plate, 0 * X)[0] for plate in plates)
    assert (broken - whole).min() > 0  # measured 2e-3 of the largest
    assert 0 < broken[0] / whole[0] < 0.3 and broken[0] < 0  # measured 0.22: softer, and stable


def test_unstable_modes_of_a_compressed_body_are_counted_with_the_bonds_that_remain():
    """The cracked body has fewer unstable modes, because fewer bonds are compressed: 36 in place of 42."""
    u, counts = -0.12 * X, []
    for families in (FAMILIES, cracked()):
        plate = scene(pd.SethHill(1.0, LINEAR), families)
        state = pd.body_stability(plate, u)
        J = np.asarray(pd.jacobian(plate.model, families, u, "dense")).reshape(u.size, -1)
        root, free = np.sqrt(np.repeat(BODY.volumes, 2)), np.flatnonzero(plate.free.reshape(-1))
        H = (root[:, None] * J / root)[np.ix_(free, free)]
        assert state.positive == (np.linalg.eigvalsh((H + H.T) / 2) > state.tolerance).sum()
        assert pd.body_inertia(plate, u) == state.positive and state.verdict == "unstable"
        counts.append(state.positive)
    assert counts == [42, 36]
