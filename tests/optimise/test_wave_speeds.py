"""Tests of the errors of wave speeds and moduli, and of the critical time step of a lattice."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

LAW = pd.LinearElastic(1.3, 0.7)


def test_phase_error_of_a_chain_is_that_of_its_closed_form():
    """For a chain with N = 1 the correspondence model has c/c0 = sin(kh)/kh, the springs sin(kh/2)/(kh/2)."""
    chain = pd.lattice_family(1, 1)
    law = pd.LinearElastic(1.0, 0.0)
    found = float(pd.dispersion_error(pd.Correspondence(law), chain, kh=1.3))
    assert abs(found - (1 - np.sin(1.3) / 1.3)) < 1e-14  # measured 0
    group = float(pd.dispersion_error(pd.Correspondence(law), chain, kh=1.3, speed="group"))
    assert abs(group - (1 - np.cos(1.3))) < 1e-14  # measured 1e-16
    springs = float(pd.dispersion_error(pd.BondBased.from_family(1.0, chain), chain, kh=1.3, against="long waves"))
    assert abs(springs - (1 - np.sin(0.65) / 0.65)) < 1e-14  # measured 1e-16


def test_error_agrees_with_the_dispersion_relation():
    """The same error from `dispersion` and `classical_frequency`, on the same waves."""
    family, model = pd.lattice_family(2, 2, spacing=0.1), pd.Correspondence(LAW, pd.SillingControl(0.5))
    angle = np.arange(48) * np.pi / 48
    k = np.concatenate([r / 0.1 * np.stack([np.cos(angle), np.sin(angle)], axis=1) for r in np.arange(1, 9) / 8])
    F = np.diag([0.99, 1.01])
    ratio = pd.dispersion(model, family, F, k, 2.0).frequency / pd.classical_frequency(model, F, k, 2.0)
    for branches in (None, (0,), (1,)):
        error = np.abs(np.asarray(ratio)[:, slice(None) if branches is None else list(branches)] - 1).max()
        assert abs(float(pd.dispersion_error(model, family, 1.0, F=F, branches=branches)) - error) < 1e-12  # 1e-15
    n = k / np.linalg.norm(k, axis=1, keepdims=True)
    waves = pd.dispersion(model, family, F, k, 2.0)
    speed = np.einsum("wbc,wc->wb", np.asarray(waves.group_velocity), n)
    error = np.abs(speed / np.asarray(pd.classical_frequency(model, F, n, 2.0)) - 1).max()
    assert abs(float(pd.dispersion_error(model, family, 1.0, F=F, speed="group")) - error) < 1e-12  # measured 2e-15


@pytest.mark.parametrize("speed", ["phase", "group"])
@pytest.mark.parametrize("sharpness", [None, 30.0])
def test_derivative_of_the_error_is_its_central_difference(speed, sharpness):
    law = pd.LinearElastic(1.3, 0.7)
    q = pd.shells(2, 2)

    def error(x):
        family = pd.lattice_family(2, 2, influence=pd.interpolated_influence(q, x[1:]))
        model = pd.Correspondence(law, pd.SillingControl(x[0]))
        return pd.dispersion_error(model, family, 1.0, speed=speed, sharpness=sharpness)

    x = jnp.array([0.4, 1.0, 0.7, 0.4])
    slope = np.asarray(jax.grad(error)(x))
    central = np.array([(float(error(x + e)) - float(error(x - e))) / 2e-5 for e in 1e-5 * np.eye(4)])
    assert np.abs(slope - central).max() < 1e-7  # measured up to 4e-10


def test_a_wave_that_grows_has_an_error_above_one():
    family = pd.lattice_family(1, 2)
    error = float(pd.dispersion_error(pd.SethHill(1.0, LAW), family, np.pi, F=np.array([[0.9]])))
    assert error > 1
    controlled = pd.SethHill(1.0, LAW, pd.SillingControl(0.5))
    assert np.isfinite(jax.grad(lambda x: pd.dispersion_error(controlled, family, x))(1.0))


def test_moduli_error_is_zero_for_exact_models_and_differentiable_there():
    family = pd.lattice_family(2, 2)
    assert float(pd.moduli_error(pd.SethHill(0.3, LAW), family)) < 1e-12  # measured 3e-16
    extended = pd.moduli_error(pd.TupekRadovitzky(0.3, LAW), family)
    I = jnp.eye(2)
    from_stress = jax.jacfwd(lambda F: pd.piola_stress(pd.TupekRadovitzky(0.3, LAW), family, F))(I)
    law = jax.hessian(pd.SethHill(0.3, LAW).local_energy)(I)
    assert abs(float(extended) - float(jnp.linalg.norm(from_stress - law) / jnp.linalg.norm(law))) < 1e-13
    assert np.isfinite(jax.grad(lambda lam: pd.moduli_error(pd.SethHill(1.0, pd.LinearElastic(lam, 1.0)), family))(1.0))


@pytest.mark.parametrize("dim", [1, 2, pytest.param(3, marks=pytest.mark.long)])
def test_time_step_of_the_lattice_is_that_of_its_fastest_wave(dim):
    """Against a dense scan of the zone, and its derivative against central differences."""
    family = pd.lattice_family(dim, 2, spacing=0.1)
    F = 0.98 * np.eye(dim)

    def step(g):
        return pd.lattice_time_step(pd.SethHill(0.5, LAW, pd.SillingControl(g)), family, F, density=2.0)

    axis = np.linspace(-np.pi, np.pi, {1: 2001, 2: 201, 3: 41}[dim]) / 0.1
    k = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    J = np.asarray(pd.symbol(pd.SethHill(0.5, LAW, pd.SillingControl(0.3)), family, F, k))
    scanned = 2 / np.sqrt(-np.linalg.eigvalsh(J).min() / 2.0)
    found = float(step(0.3))
    assert found <= scanned * (1 + 1e-12) and found > scanned * (1 - {1: 1e-5, 2: 1e-3, 3: 2e-2}[dim])
    assert abs(float(jax.jit(step)(0.3)) - found) < 1e-12 * found
    central = (float(step(0.3 + 1e-5)) - float(step(0.3 - 1e-5))) / 2e-5
    assert abs(float(jax.grad(step)(0.3)) - central) < 1e-6 * abs(central)


def test_wrong_arguments_are_refused():
    family, model = pd.lattice_family(2, 2), pd.SethHill(1.0, LAW)
    with pytest.raises(ValueError, match=r"kh must lie in \(0, π\]; got 4"):
        pd.dispersion_error(model, family, kh=4.0)
    with pytest.raises(ValueError, match="branches must be some of 0 to 1"):
        pd.dispersion_error(model, family, branches=(2,))
    with pytest.raises(ValueError, match="BondBased has no classical law"):
        pd.dispersion_error(pd.BondBased(1.0), family)
    with pytest.raises(ValueError, match="sharpness must be one finite number > 0"):
        pd.dispersion_error(model, family, sharpness=-5.0)
    with pytest.raises(ValueError, match="speed must be one of phase, group"):
        pd.dispersion_error(model, family, speed="energy")
    hourglass = pd.SethHill(1.0, LAW, pd.LittlewoodControl(0.03))
    with pytest.raises(ValueError, match="needs a model with an energy"):
        pd.dispersion_error(hourglass, family)
    with pytest.raises(ValueError, match="needs a model with an energy"):
        pd.lattice_time_step(hourglass, family)
    with pytest.raises(ValueError, match="density must be one finite number > 0"):
        pd.lattice_time_step(model, family, density=0.0)
