"""Coloured Jacobians equal dense ones for models of every structure, and columns of one colour share no row."""

import bodies
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from table import MODELS

import pdjax as pd
from pdjax.tangent.coloring import coloured_jacobian, colouring, jacobian_pattern


@pytest.mark.parametrize("name", ["bond_associated force", "correspondence svk", "bond_level average"])
def test_coloured_jacobian_equals_the_dense_one(name):
    """Models of two rings without a point state, of two rings with one, and of three rings, on a long bar.

    The bar is so long that several points have the same colour.
    """
    fams = pd.families(pd.bar(20), 2.01 / 20)
    u = jnp.asarray(2e-3 * bodies.random(1).uniform(-1, 1, (20, 1)))
    J = coloured_jacobian(MODELS[name], fams, u)
    dense = np.asarray(pd.jacobian(MODELS[name], fams, u, form="dense"))
    assert np.abs(J.toarray() - dense).max() < 1e-14 * np.abs(dense).max()  # measured
    assert J.nnz < dense.size


def test_coloured_jacobian_equals_central_differences_on_a_stretched_plate():
    """Correspondence with the St. Venant–Kirchhoff law is cubic in u, so extrapolated differences are exact."""
    fams = pd.families(pd.lattice((5, 4)), 1.01)
    model, F = MODELS["correspondence svk"], jnp.diag(jnp.array([1.03, 0.98]))
    u = jnp.asarray(0.02 * bodies.random(2).uniform(-1, 1, (20, 2)))

    force = jax.jit(jax.vmap(lambda e: pd.force_density(model, fams, u + e.reshape(20, 2), F)))

    def difference(h):
        return np.asarray(force(h * jnp.eye(40)) - force(-h * jnp.eye(40))).reshape(40, 40).T / (2 * h)

    exact = (4 * difference(0.2) - difference(0.4)) / 3
    J = coloured_jacobian(model, fams, u, F).toarray()
    assert np.abs(J - exact).max() < 1e-14 * np.abs(exact).max()  # measured


@pytest.mark.parametrize("rings", [1, 2, 3])
def test_points_of_one_colour_share_no_row(rings):
    fams = pd.families(pd.lattice((9, 7)), 1.5)
    pattern = jacobian_pattern(fams, rings)
    apart = np.abs(pd.lattice((9, 7)).positions[:, None] - pd.lattice((9, 7)).positions[None]).max(axis=2)
    assert np.array_equal(pattern.toarray() > 0, apart < rings + 0.5)  # the bonds reach the eight neighbours
    colours = colouring(pattern)
    assert all((np.bincount(colours[row.indices]) <= 1).all() for row in pattern)
    least = int(np.diff(pattern.indptr).max())
    assert least <= colours.max() + 1 <= 2 * least  # measured: 9 of 9, 25 of 25, 49 of 49
    assert colours.min() == 0
