"""Errors in finite bodies that a review found: each test keeps one of them from coming back."""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import pdjax as pd

BAR = pd.LinearElastic(lam=1.0, mu=0.0)


class NoEnergy(pd.AbstractModel):
    """A model whose energy the library is not told of, so that it does not treat J as symmetric."""

    base: pd.AbstractModel
    hyperelastic: ClassVar[bool] = False

    def force_state(self, bonds):
        return self.base.force_state(bonds)

    def shape_tensor(self, bonds):
        return self.base.shape_tensor(bonds)


def pulled(model, force=0.05, **how):
    """The solution of a bar of 31 points; six are held and two are pulled."""
    body = pd.bar(31)
    conditions = pd.prescribe(np.arange(6), 0.0), pd.body_force([29, 30], force)
    return pd.solve(pd.scene(body, pd.families(body, 3 / 31), model, *conditions), stability=False, **how)


def test_critical_load_is_the_first_of_many_crossings():
    """77 eigenvalues cross before the one that Newton would follow. The reference is the root of the dense spectrum."""
    scene = pd.scenes.clamped_plate((13, 12), 1.5, np.diag([0.7, 0.7]), pd.Correspondence(pd.LinearElastic(1.0, 1.0)))
    found = pd.body_critical_load(scene)

    def top(factor):
        return pd.body_spectrum(scene, factor * scene.closed_form, factor=factor)[0][0]

    assert found.proved
    assert abs(found.factor - brentq(top, 0.1, 1.0, xtol=1e-10)) < 1e-8  # measured 2e-10


@pytest.mark.parametrize("method", ["newton", "newton_krylov", "relaxation", "trust_region"])
def test_every_method_solves_a_model_without_an_energy(method):
    """LU with pivoting and GMRES replace the symmetric solvers, and the kind of the equilibrium is None."""
    result = pulled(NoEnergy(pd.SethHill(1.0, BAR)), method=method)
    assert result.converged and result.kind is None
    assert np.allclose(result.u, pulled(pd.SethHill(1.0, BAR)).u, atol=1e-9)  # measured 1e-11


def test_a_body_that_flies_apart_is_no_equilibrium():
    """For order −1 in tension the forces vanish at stretches of 10⁴, so a zero residual does not mean equilibrium."""
    scene = pd.scenes.step_size_bar(60, 3, 0.05, model=pd.SethHill(-1.0, BAR))
    far = scene.displacement(1e6 * jnp.asarray(np.random.default_rng(3).normal(size=len(scene.unknowns))))
    result = pd.solve(scene, start=far, tolerance=1e-3, smallest_step=1.0, stability=False)
    assert not result.converged
    assert "came apart" in result.reason


def test_residual_of_a_periodic_body_without_load_is_relative_to_its_bond_forces():
    """There are no reactions and no loads, so the residual is divided by the forces of the bonds."""
    body = pd.lattice((30,), 1 / 30, periodic=True)
    held = pd.prescribe([0], 0.0)
    result = pd.solve(pd.scene(body, pd.families(body, 0.1), pd.SethHill(1.0, BAR), held, mean=[[1.02]]))
    assert result.converged and result.kind == "minimum"
    assert np.abs(result.u).max() < 1e-15


@pytest.mark.parametrize("method", ["newton", "trust_region"])
def test_second_derivatives_of_an_equilibrium(method):
    """d²/dκ² from grad of grad equals central differences of the first derivative."""

    def answer(modulus):
        return jnp.sin(5 * pulled(pd.SethHill(1.0, pd.LinearElastic(modulus, 0.0)), method=method).u).sum()

    first = jax.grad(answer)
    slope = (first(1.0 + 1e-4) - first(1.0 - 1e-4)) / 2e-4
    assert abs(jax.grad(first)(1.0) - slope) < 1e-5 * abs(slope)  # measured 2e-8


def test_derivative_of_an_unconverged_solution_is_nan():
    def answer(m):
        return pulled(pd.SethHill(m, BAR), max_iterations=1, smallest_step=1.0).u.sum()

    value, slope = jax.value_and_grad(answer)(1.0)
    assert np.isfinite(value) and np.isnan(slope)


def test_a_failed_first_step_stays_at_rest():
    """The first step is halved once and fails again, so the result is the state at load factor 0, not at 1."""
    scene = pd.scenes.step_size_bar(60, 3, -0.9)
    result = pd.solve(scene, step=0.8, smallest_step=0.6, max_iterations=2)
    assert not result.converged
    assert float(result.load_factor) == 0.0
    assert np.abs(result.u).max() == 0.0


def test_traction_of_a_periodic_body_is_uniform_across_its_periodic_boundary():
    body = pd.lattice((20, 10), 0.1, periodic=(False, True))
    left, right = body.positions[:, 0] < 0.5, body.positions[:, 0] > 1.5
    pull = pd.homogeneous_traction(right, np.diag([1.01, 1.02]))
    model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    scene = pd.scene(body, pd.families(body, 0.25), model, pd.prescribe(left, 0.0), pull)
    load = np.asarray(scene.load).reshape(20, 10, 2)
    assert np.ptp(load, axis=1).max() < 1e-13  # measured 7e-16
    assert np.abs(load[-1, 0, 0]) > 0.1


def test_a_singular_bar_without_load_rests():
    assert np.abs(pd.scenes.singular_bar(60, 3, 0.0).closed_form).max() == 0.0
