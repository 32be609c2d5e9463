"""Tests of errors that were found in the criteria and corrected."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.models.kinematics import seth_hill


def orthotropic(E, c):
    return 0.5 * (c[0] * E[0, 0] ** 2 + c[1] * E[1, 1] ** 2 + 2 * c[2] * E[0, 1] ** 2 + 2 * c[3] * E[0, 0] * E[1, 1])


def test_a_law_that_prefers_axes_is_searched_in_the_whole_zone():
    """Under hydrostatic F the lattice is cubic but this law is not. Its worst wave runs along y, not along x."""
    fam = pd.lattice_family(2, 3)
    model = pd.SethHill(1.0, pd.EnergyLaw(orthotropic, "E", jnp.array([4.0, 0.2, 0.2, -0.8])))
    found = pd.stability(model, fam, 1.02 * jnp.eye(2))
    axis = np.linspace(0, np.pi, 241)
    k = np.stack(np.meshgrid(axis, np.concatenate([-axis[1:], axis]), indexing="ij"), -1).reshape(-1, 2)
    k = k[np.abs(k).max(axis=1) > 0]
    top = np.linalg.eigvalsh(np.asarray(pd.symbol(model, fam, 1.02 * jnp.eye(2), k)))[:, -1]
    dense = (top / (4 * np.sin(k / 2) ** 2).sum(axis=1)).max() / float(pd.p_wave_modulus(model, fam))
    assert found.verdict == "unstable" and abs(found.wave_vector[1]) > 1 > abs(found.wave_vector[0])
    assert dense <= float(found.margin) < dense * 1.01  # The grid of 240 intervals is 0.1 % lower.
    assert float(pd.critical_load(model, fam, side="positive")) < 0.02


@pytest.mark.parametrize(("lam", "mu"), [(1.0, -1.0), (-2.0, 1.0)])
def test_a_law_unstable_at_rest_is_refused(lam, mu):
    model, fam = pd.SethHill(1.0, pd.LinearElastic(lam, mu)), pd.lattice_family(2, 2)
    for ask in (
        lambda: pd.stability(model, fam, np.eye(2)),
        lambda: pd.critical_load(model, fam),
        lambda: pd.stability_map([1.0], [0.1], N=2, law=model.law),
    ):
        with pytest.raises(ValueError, match="law must have a positive P-wave modulus"):
            ask()


def test_a_long_wave_margin_does_not_depend_on_the_spacing():
    """Its derivative in h is 0, because both parts of the quotient scale with h in the same way."""

    def margin(h):
        model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
        return pd.stability(model, pd.lattice_family(2, 2, h), jnp.diag(jnp.array([0.6, 1.0]))).margin

    assert float(margin(1.0)) > 0.05
    assert abs(float(jax.grad(margin)(1.0))) < 1e-12  # measured 1e-16


def test_wave_vectors_are_reported_inside_the_zone(law):
    fam = pd.lattice_family(2, 3, spacing=0.5)
    for m, a in ((0.0, 0.01), (1.0, -0.02), (1.0, 0.02)):
        k = np.asarray(pd.stability(pd.SethHill(m, law), fam, (1 + a) * jnp.eye(2)).wave_vector)
        assert (np.abs(k) <= np.pi / 0.5 * (1 + 1e-12)).all()


def test_extreme_orders_do_not_overflow_the_strain():
    ell = jnp.log(jnp.array([0.5, 2.0]))
    found = seth_hill(ell, jnp.array([1100.0, -1100.0]))
    np.testing.assert_allclose(found, [-1 / 2200, 1 / 2200], rtol=1e-14)
