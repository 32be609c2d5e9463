"""Bodies with a horizon for each point: dual-horizon peridynamics, for every model and by every way of evaluation."""

import bodies
import jax
import numpy as np
import pytest
from table import MODELS

import pdjax as pd
from pdjax.force.fields import whole_force

BODY = bodies.points(2, "cloud")
DELTA = np.linspace(2.0, 3.4, len(BODY))[np.random.default_rng(1).permutation(len(BODY))]
PLANAR = [name for name, model in MODELS.items() if 2 in model.dims and name != "sub_horizon"]


def fams():
    return pd.families(BODY, DELTA, pd.gaussian_influence)


def test_a_family_holds_the_points_within_its_own_horizon():
    families, X = fams(), BODY.positions
    apart = np.linalg.norm(X[None] - X[:, None], axis=-1)
    inside = (apart <= DELTA[:, None]) & (apart > 0)
    either = inside | inside.T
    assert not np.array_equal(inside, inside.T)
    weight, true = np.zeros_like(apart), np.asarray(families.is_bond)
    i = np.nonzero(true)[0]
    weight[i, np.asarray(families.neighbours)[true]] = np.asarray(families.weight)[true]
    assert np.array_equal(weight, inside.astype(float)) and np.array_equal(families.count, either.sum(axis=1))
    back = np.asarray(families.neighbours)[np.asarray(families.neighbours), np.asarray(families.reverse)]
    assert (back == np.arange(len(BODY))[:, None]).all()
    omega = np.asarray(families.influence * families.weight)[true]
    lengths = np.linalg.norm(np.asarray(families.xi), axis=-1)[true]
    gaussian = np.exp(-((2 * lengths / DELTA[i]) ** 2))
    assert np.abs(omega / gaussian - 1)[omega > 0].max() < 1e-14  # measured 0
    assert "horizon 2 to 3.4" in str(families)


def test_equal_horizons_are_one_horizon():
    one, each = pd.families(BODY, 2.3), pd.families(BODY, np.full(len(BODY), 2.3))
    assert each.horizon.shape == () and np.array_equal(one.weight, each.weight)


@pytest.mark.parametrize("name", PLANAR)
def test_forces_are_the_gradient_of_the_energy_and_conserve_momentum(name):
    model, families = MODELS[name], fams()
    u = 0.03 * bodies.random(4).normal(size=BODY.positions.shape)
    f, V = np.asarray(pd.force_density(model, families, u)), BODY.volumes[:, None]
    size = np.abs(V * f).max()
    assert np.abs((V * f).sum(axis=0)).max() < 2e-14 * size  # measured 6e-16
    if model.hyperelastic:
        slope = np.asarray(jax.grad(lambda u: pd.strain_energy(model, families, u))(u))
        assert np.abs(slope + V * f).max() < 3e-14 * size  # measured 1e-15
    if model.balances_moments:
        x = BODY.positions + u
        assert abs((V[:, 0] * (x[:, 0] * f[:, 1] - x[:, 1] * f[:, 0])).sum()) < 3e-14 * size  # measured 2e-15
    assert np.abs(pd.force_density(model, families, np.full_like(u, 0.3))).max() < 1e-15 * size  # measured 0


@pytest.mark.parametrize("name", PLANAR)
def test_the_sparse_jacobian_is_the_derivative_of_the_force(name):
    model, families = MODELS[name], fams()
    u = 0.03 * bodies.random(5).normal(size=BODY.positions.shape)
    sparse, dense = (pd.jacobian(model, families, u, form) for form in ("sparse", "dense"))
    assert np.abs(sparse.toarray() - np.asarray(dense)).max() < 5e-14 * np.abs(dense).max()  # measured 2e-15


@pytest.mark.parametrize("name", [n for n in PLANAR if getattr(MODELS[n], "by_moments", False)])
def test_streaming_over_the_bonds_gives_the_same_force(name, monkeypatch):
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 0)
    model, families = MODELS[name], fams()
    u = 0.03 * bodies.random(6).normal(size=BODY.positions.shape)
    found, expected = (
        np.asarray(f) for f in (pd.force_density(model, families, u), whole_force(model, families, families.bonds(u)))
    )
    assert np.abs(found - expected).max() < 2e-14 * np.abs(expected).max()  # measured 1e-15


def test_ways_of_lattices_are_not_offered():
    body = pd.lattice((9, 8))
    families = pd.families(body, np.where(body.positions[:, 0] < 4, 2.0, 3.0))
    assert families.grid is None
    for way in ("slices", "fft"):
        with pytest.raises(ValueError, match=way):
            pd.force_density(MODELS["lps"], families, np.zeros((72, 2)), way=way)
    with pytest.raises(ValueError, match="arrays=False"):
        pd.families(body, np.linspace(2, 3, 72), arrays=False)


def test_a_uniform_strain_is_not_in_equilibrium_where_the_horizon_changes():
    """The stress is exact at every point, but the bonds of two horizons pull differently near the change.

    The forces are internal ones: their sum is 0. They vanish farther than one larger horizon from the change.
    """
    bar = pd.bar(60, 60.0)
    families = pd.families(bar, np.where(bar.positions[:, 0] < 30, 2.01, 4.01))
    model, u = pd.Correspondence(pd.LinearElastic(1.0, 0.0)), 1e-3 * bar.positions
    f = np.asarray(pd.force_density(model, families, u))[:, 0]
    assert abs(f[10:50].sum()) < 1e-17  # measured 4e-19
    assert np.abs(np.r_[f[10:26], f[34:50]]).max() < 5e-18  # measured 2e-19
    assert np.abs(f[26:34]).max() == pytest.approx(1.335334e-4, rel=1e-6)  # E = 1, spacing 1; measured 1e-16
    assert np.abs(np.asarray(pd.strain(model, families, u))[:, 0, 0] - 1.0005e-3).max() < 2e-17  # measured 9e-19


@pytest.mark.parametrize(
    ("horizon", "words"),
    [
        ([1.0, 2.0], "one for each of the 15 points; got shape"),
        (np.r_[np.full(14, 2.0), 0.0], "got the value 0"),
        (np.r_[np.full(14, 2.0), np.nan], "horizon must be finite"),
        (np.r_[np.full(14, 2.0), 0.1], "point 14 has none"),
    ],
)
def test_wrong_horizons_are_refused(horizon, words):
    with pytest.raises(ValueError, match=words):
        pd.families(BODY, horizon)


def test_functions_of_one_horizon_refuse_several():
    families = fams()
    with pytest.raises(ValueError, match="one horizon for all points"):
        pd.surface_correction(pd.BondBased(1.0), families)
    with pytest.raises(ValueError, match="horizon must be one number"):
        pd.neighbour_report(BODY, DELTA)
