"""Weighted volume, dilatation, energy density and stress of every point equal their sums written out."""

import bodies
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_weighted_volume_and_dilatation_are_the_sums_of_their_definition(dim):
    body, fams = bodies.points(dim, "cloud"), bodies.families(dim, "cloud")
    u = bodies.displacement(dim, "cloud", 5)
    for i, (m, theta) in enumerate(zip(pd.weighted_volume(fams), pd.dilatation(fams, u), strict=True)):
        near = np.asarray(fams.neighbours)[i, : int(fams.count[i])]
        xi = body.positions[near] - body.positions[i]
        r, Y = np.linalg.norm(xi, axis=1), np.linalg.norm(xi + u[near] - u[i], axis=1)
        w = bodies.gaussian(r, bodies.HORIZONS[dim]) * body.volumes[near]
        assert m == pytest.approx(np.sum(w * r**2), rel=1e-13)
        assert theta == pytest.approx(dim * np.sum(w * r * (Y - r)) / np.sum(w * r**2), rel=1e-11, abs=1e-13)


def test_a_uniform_stretch_has_the_dilatation_of_its_size():
    fams = pd.families(pd.lattice((6, 5, 4)), 2.0)
    assert np.abs(np.asarray(pd.dilatation(fams, np.zeros((120, 3)), F=1.01 * np.eye(3))) - 0.03).max() < 1e-14  # 1e-16


@pytest.mark.parametrize("name", ["seth_hill m=1", "lps", "bond_level average", "bond_associated"])
def test_energy_densities_add_up(name):
    fams, u = bodies.families(2, "cloud"), bodies.displacement(2, "cloud", 3)
    W = pd.energy_density(table.MODELS[name], fams, u)
    total = float(pd.strain_energy(table.MODELS[name], fams, u))
    assert W.shape == (15,) and float(jnp.dot(fams.volumes, W)) == pytest.approx(total, rel=1e-14)


@pytest.mark.parametrize("name", ["correspondence neo-hookean", "silling control", "bond_level"])
@pytest.mark.parametrize("dim", [2, 3])
def test_cauchy_stress_of_an_affine_map_is_the_laws(name, dim):
    """σ = P Fᵀ/J with P by central differences of the law. It holds at surfaces too, where F̄ is exact."""
    model, fams, F = table.MODELS[name], bodies.families(dim, "cloud"), bodies.deformation(dim, 4)
    sigma = np.asarray(pd.cauchy_stress(model, fams, bodies.points(dim, "cloud").positions @ (F - np.eye(dim)).T))
    h = 1e-6
    P = np.zeros((dim, dim))
    for i, j in np.ndindex(dim, dim):
        step = np.zeros((dim, dim))
        step[i, j] = h
        P[i, j] = float(model.local_energy(jnp.asarray(F + step)) - model.local_energy(jnp.asarray(F - step))) / (2 * h)
    right = P @ F.T / np.linalg.det(F)
    assert np.abs(sigma - right).max() < 1e-8 * np.abs(right).max()  # 2e-10, of the differences


def test_von_mises_of_known_states():
    shear = np.array([[0.0, 2.0], [2.0, 0.0]])
    assert pd.von_mises(shear) == pytest.approx(2 * np.sqrt(3))
    assert pd.von_mises(np.diag([3.0, 0.0])) == pytest.approx(3.0)  # plane stress, pulled
    assert pd.von_mises(np.diag([3.0, 0.0, 0.0])) == pytest.approx(3.0)
    assert pd.von_mises(np.diag([3.0, 0.0]), 0.9) == pytest.approx(np.sqrt(9 - 2.7 + 0.81))
    assert pd.von_mises(2.0 * np.eye(3)) == pytest.approx(0.0, abs=1e-15)
    assert pd.von_mises(np.zeros((4, 5, 2, 2))).shape == (4, 5)
    with pytest.raises(ValueError, match=r"\(\.\.\., dim, dim\)"):
        pd.von_mises(np.zeros(3))


def test_derivatives_of_fields_equal_central_differences():
    import jax

    fams, u = bodies.families(2, "cloud"), bodies.displacement(2, "cloud", 9)

    def total(u):
        sigma = pd.cauchy_stress(table.MODELS["lps"], fams, u)
        return jnp.sum(pd.von_mises(sigma)) + jnp.sum(pd.dilatation(fams, u) ** 2)

    direction = bodies.random(2, 11).normal(size=u.shape)
    slope = float(jnp.vdot(jax.grad(total)(u), direction))
    difference = float(total(u + 1e-6 * direction) - total(u - 1e-6 * direction)) / 2e-6
    assert slope == pytest.approx(difference, rel=1e-7)  # 3e-9
