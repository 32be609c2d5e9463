"""Tests of influence functions given by shells, and of signed ones."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 3), (3, 2.5)])
def test_every_bond_of_a_lattice_gets_the_weight_of_its_shell(dim, N):
    q = pd.shells(dim, N)
    weights = np.arange(1.0, len(q) + 1)
    family = pd.lattice_family(dim, N, spacing=0.3, influence=pd.interpolated_influence(q, weights))
    length = np.linalg.norm(np.asarray(family.xi), axis=1) / (0.3 * N)
    wanted = weights[np.argmin(np.abs(length[:, None] - q), axis=1)]
    assert np.abs(np.asarray(family.influence) - wanted).max() < 1e-12  # measured 4e-15


def test_weights_are_differentiable_through_a_family_and_a_body():
    q = pd.shells(2, 2)

    def margin(w):
        family = pd.lattice_family(2, 2, influence=pd.interpolated_influence(q, w))
        return pd.stability(pd.SethHill(0.0, pd.LinearElastic(1.0, 1.0)), family, 0.97 * np.eye(2)).margin

    w = jnp.array([1.0, 0.6, 0.3])
    central = [(float(margin(w + e)) - float(margin(w - e))) / 2e-5 for e in 1e-5 * np.eye(3)]
    assert np.abs(np.asarray(jax.grad(margin)(w)) - central).max() < 1e-7  # measured 2e-10
    body = pd.cloud(np.random.default_rng(1).uniform(size=(12, 2)), np.ones(12))

    def force(w):
        families = pd.families(body, 0.9, influence=pd.interpolated_influence(q, w))
        model = pd.SethHill(0.0, pd.LinearElastic(1.0, 1.0))
        return jnp.sum(pd.force_density(model, families, 0.01 * body.positions**2) ** 2)

    central = [(float(force(w + e)) - float(force(w - e))) / 2e-5 for e in 1e-5 * np.eye(3)]
    assert np.allclose(jax.grad(force)(w), central, rtol=1e-6)  # measured 2e-9


def test_negative_weights_are_refused_unless_they_are_asked_for():
    influence = pd.interpolated_influence(pd.shells(1, 2), [1.0, -0.25])
    with pytest.raises(ValueError, match=r"nowhere negative .see signed_influence"):
        pd.lattice_family(1, 2, influence=influence)
    family = pd.lattice_family(1, 2, influence=pd.signed_influence(influence))
    assert family.influence.tolist() == [1.0, -0.25, 1.0, -0.25]
    assert pd.families(pd.lattice((5,)), 2.0, influence=pd.signed_influence(influence)) is not None
    with pytest.raises(ValueError, match="must be finite and not zero everywhere"):
        pd.lattice_family(1, 2, influence=pd.signed_influence(lambda r, horizon: 0 * r))


def test_wrong_values_are_refused():
    with pytest.raises(ValueError, match="q must be increasing"):
        pd.interpolated_influence([1.0, 0.5], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"weights must have the shape of q, \(2,\)"):
        pd.interpolated_influence([0.5, 1.0], [1.0])
    with pytest.raises(ValueError, match="N must be finite and >= 1"):
        pd.shells(2, 0.5)
