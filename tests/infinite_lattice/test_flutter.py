"""Tests of the criterion "symbol" for models without an energy: the growth of their modes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.infinite_lattice.criteria.flutter import growth_square

LAW = pd.LinearElastic(1.0, 1.0)


def test_growth_of_known_roots():
    """The growth rate γ of s² = λ is 2 for λ = 4, 0 for λ = −4, and 1 for λ = (1 + 2i)²."""
    value = jnp.asarray([4.0, -4.0, (1 + 2j) ** 2, -1 + 1e-9j])
    np.testing.assert_allclose(growth_square(value, jnp.ones(4)), [4.0, -4.0, 1.0, -1.0], rtol=1e-14)


def test_margin_of_a_symmetric_symbol_without_energy_is_that_of_eigh():
    """The hourglass force has no energy, but its symbol on a lattice is symmetric, so that `eigh` applies too."""
    fam, F = pd.lattice_family(2, 2), jnp.diag(jnp.asarray([0.97, 1.02]))
    model = pd.SethHill(0.0, LAW, pd.LittlewoodControl(0.05))
    found = pd.stability(model, fam, F, resolution=32)
    k = np.pi / 32 * np.stack(np.meshgrid(np.arange(0, 33), np.arange(-31, 33), indexing="ij"), -1).reshape(-1, 2)
    k = k[(k != 0).any(axis=1)]
    J = np.asarray(pd.symbol(model, fam, F, k))
    assert np.abs(J - J.transpose(0, 2, 1)).max() < 1e-13 * np.abs(J).max()  # 4e-16
    kappa2 = np.sum((2 * np.sin(k / 2)) ** 2, axis=1)
    quotient = np.linalg.eigvalsh(J)[:, -1] / kappa2 / float(pd.p_wave_modulus(model, fam))
    assert float(found.margin) >= quotient.max() - 1e-12
    assert float(found.margin) == pytest.approx(quotient.max(), abs=2e-3)  # The limit k → 0 is not on the grid.


def test_eigenvalue_of_a_force_without_energy_is_that_of_a_periodic_lattice():
    """The bond-associated model as first published, at a load beyond the critical load of the law. Its Jacobian on a
    periodic lattice is symmetric in any homogeneous deformation."""
    model, F = pd.BondAssociatedForce(LAW), jnp.asarray([[0.7, 0.2], [0.0, 0.75]])
    found = pd.stability(model, pd.lattice_family(2, 2), F, resolution=5)  # the waves of ten points
    assert found.verdict == "unstable"
    fams = pd.families(pd.lattice((10, 10), periodic=True), 2.0)
    J = np.asarray(pd.jacobian(model, fams, np.zeros((100, 2)), "dense", F))
    assert np.abs(J - J.T).max() < 1e-13 * np.abs(J).max()  # 4e-16
    largest = np.sqrt(np.linalg.eigvals(J).astype(complex)).real.max() ** 2
    assert float(found.eigenvalue) == pytest.approx(largest, rel=1e-10)  # 1e-15


def test_derivative_of_a_margin_without_energy():
    """The derivative by left and right eigenvectors agrees with a central difference."""
    fam = pd.lattice_family(2, 2)

    def margin(mu):
        model = pd.BondAssociatedForce(pd.LinearElastic(1.0, mu))
        return pd.stability(model, fam, 0.9 * jnp.eye(2), resolution=6).margin

    slope, h = jax.grad(margin)(1.0), 1e-5
    assert float(slope) == pytest.approx(float(margin(1 + h) - margin(1 - h)) / (2 * h), rel=1e-6)  # 1e-9


def test_surfaces_make_the_published_force_unstable_at_rest():
    """The published force is not unstable on the infinite lattice at rest (2D, N = 2). A small body at rest is
    unstable, but not with the form that derives from an energy."""
    fams = pd.families(pd.lattice((6, 5)), 2.0)
    rates = []
    for model in (pd.BondAssociatedForce(LAW), pd.BondAssociated(LAW)):
        assert pd.stability(model, pd.lattice_family(2, 2), jnp.eye(2)).verdict != "unstable"
        values = np.linalg.eigvals(np.asarray(pd.jacobian(model, fams, np.zeros((30, 2)), "dense")))
        rates.append(np.sqrt(values.astype(complex)).real.max())
    assert rates[0] > 0.1 and rates[1] < 1e-5, rates  # 0.69, 2e-8


def test_dispersion_refuses_a_model_without_an_energy():
    fam = pd.lattice_family(1, 2)
    with pytest.raises(ValueError, match="no energy"):
        pd.dispersion(pd.BondAssociatedForce(LAW), fam, jnp.eye(1), [1.0])
