"""Regularisation: values, slopes, and what it does to a field that the data do not determine."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

X = np.array([[1.0, 1.5, 3.0], [0.0, 2.0, 2.0]])


def test_tikhonov_sums_squares_of_differences_along_every_axis():
    values = pd.tikhonov(4.0, reference=np.ones((2, 3)))(X)
    assert float(jnp.sum(values**2)) == pytest.approx(4 * np.sum((X - 1) ** 2))
    slopes = pd.tikhonov(4.0, difference=1)(X)
    expected = np.sum(np.diff(X, axis=0) ** 2) + np.sum(np.diff(X, axis=1) ** 2)
    assert float(jnp.sum(slopes**2)) == pytest.approx(4 * expected)


def test_total_variation_is_the_smoothed_sum_of_jumps_without_its_constant():
    d, e = np.diff(X[0]), 0.3
    rho = pd.total_variation(2.0, e)(X[0])
    assert float(jnp.sum(rho**2)) == pytest.approx(2 * np.sum(np.sqrt(d**2 + e**2) - e))


def test_gauss_newton_matrix_of_total_variation_is_exact_for_a_flat_field():
    rho = pd.total_variation(2.0, 0.3)
    flat = jnp.ones(4)
    J = jax.jacfwd(rho)(flat)
    exact = jax.hessian(lambda x: 0.5 * jnp.sum(rho(x) ** 2))(flat)
    np.testing.assert_allclose(J.T @ J, exact, atol=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pd.tikhonov(-1.0), "weight must be finite and >= 0; got -1.0"),
        (lambda: pd.tikhonov(1.0, difference=3), "difference must be 0, 1 or 2; got 3"),
        (lambda: pd.total_variation(1.0, 0.0), "smoothing must be finite and >= 1.49167e-154; got 0.0"),
        (lambda: pd.total_variation(1.0, 1e-160), "smoothing must be finite and >= 1.49167e-154; got 1e-160"),
    ],
)
def test_wrong_weights_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(("wide", "smoothing"), [(True, 1.5e-154), (False, 1.1e-19)], ids=["float64", "float32"])
def test_slopes_of_total_variation_are_right_for_the_smallest_smoothing(wide, smoothing):
    """ρ = Δ/√(√(Δ² + ε²) + ε) has the slope 1/√(2ε) at Δ = 0, and 1/(2√Δ) where Δ is much larger than ε."""
    with jax.enable_x64(wide):
        slopes = jax.jacfwd(pd.total_variation(1.0, smoothing))(jnp.array([1.0, 1.0, 2.0]))
        with pytest.raises(ValueError, match="smoothing must be finite and >="):
            pd.total_variation(1.0, 0.9 * smoothing)
    np.testing.assert_allclose(np.diagonal(slopes, 1), [(2 * smoothing) ** -0.5, 0.5], rtol=1e-6)


@pytest.mark.parametrize("make", [pd.tikhonov, lambda w: pd.total_variation(w, 1.0)])
def test_a_weight_is_differentiated_unless_it_is_zero(make):
    def cost(w):
        return jnp.sum(make(w)(X) ** 2)

    assert float(jax.grad(cost)(0.5)) == pytest.approx(float(cost(1.0)))
    assert not np.any(jax.jit(jax.jacfwd(make(0.0)))(X))
    with pytest.raises(ValueError, match="weight must be > 0 where the residuals are differentiated"):
        jax.grad(cost)(0.0)
    with pytest.raises(eqx.EquinoxRuntimeError, match="weight must be > 0 where"):
        eqx.filter_jit(jax.grad(cost))(jnp.array(0.0))


def averages(field):
    """Data that determine the means of pairs only."""
    return 0.5 * (field["E"][1:] + field["E"][:-1])


def part(field):
    return field["E"]


@pytest.mark.parametrize(
    ("regularisation", "bias"),
    [(pd.tikhonov(1e-6, difference=1, part=part), 1 / 14), ([pd.total_variation(1e-6, 0.01, part=part)], 0.0)],
    ids=["Tikhonov", "total variation"],
)
def test_regularisation_settles_what_the_data_leave_open(regularisation, bias):
    """The alternating field changes no datum, and the result reports it.

    Its amplitude α minimises the sum of squares of the slopes, 6 (2α)² + (1 − 2α)², at 1/14. Total variation sets it
    to zero, because it keeps the jump.
    """
    truth = np.where(np.arange(8) < 4, 1.0, 2.0)
    start = {"E": 1.5 + 0.2 * (-1.0) ** np.arange(8)}
    data = averages({"E": truth})
    found = pd.identify(averages, start, data, noise=0.01, regularisation=regularisation)
    assert found.converged and not found.identifiable
    np.testing.assert_allclose(np.abs(found.parameters["E"] - truth), bias, atol=1e-3)
    assert np.isfinite(found.covariance).all() and found.standard_deviation["E"].max() > 1
    plain = pd.identify(averages, start, data, noise=0.01)
    assert np.isinf(np.diag(plain.covariance)).all()


def test_differences_of_too_few_entries_are_refused():
    with pytest.raises(ValueError, match="have no array of more than 1 entries along an axis"):
        pd.tikhonov(1.0, difference=1)(2.0)
    with pytest.raises(ValueError, match="differences of order 2"):
        pd.tikhonov(1.0, difference=2)(np.ones(2))
