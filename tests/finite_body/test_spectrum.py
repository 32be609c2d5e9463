"""Spectra of finite bodies against dense algebra, and critical loads against root finding."""

import functools

import bodies
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from scipy.optimize import brentq
from table import LINEAR, MODELS

import pdjax as pd
from pdjax.scenes import clamped_plate, step_size_bar

SVK = pd.SethHill(1.0, LINEAR)


class NoEnergy(pd.SethHill):
    """A model with an energy that declares that it has none."""

    hyperelastic = False


@functools.cache
def bar():
    return step_size_bar(100, 3, -1e-3)


@functools.cache
def plate():
    return clamped_plate((13, 14), 1.5, np.diag([0.9, 0.95]), SVK)


@functools.cache
def cloud():
    """15 points with unequal volumes; three of them are held."""
    X = bodies.points(2, "cloud").positions
    return pd.scene(
        bodies.points(2, "cloud"),
        bodies.families(2, "cloud"),
        SVK,
        pd.prescribe([0, 1, 7], -0.3 * X[[0, 1, 7]]),
        closed_form=-0.3 * X,
    )


def dense(scene, factor):
    """V^½ ∂f/∂u V^-½ on the free components, from a dense forward derivative of the force."""
    f = jax.jit(jax.jacfwd(lambda u: pd.force_density(scene.model, scene.families, u)))
    J = np.asarray(f(factor * scene.closed_form)).reshape(scene.prescribed.size, -1)
    root = np.sqrt(np.repeat(scene.body.volumes, scene.body.dim))
    H = root[:, None] * J / root
    keep = scene.free.reshape(-1)
    return H[np.ix_(keep, keep)]


# ---------------------------------------------------------------- spectra


@pytest.mark.parametrize(
    "make, factor, positive", [(bar, 0.1, 1), (bar, 1.0, 3), (bar, 0.05, 0), (plate, 1.0, 36), (cloud, 1.0, None)]
)
def test_spectrum_equals_that_of_the_dense_force_derivative(make, factor, positive):
    """NumPy gives all eigenvalues. Inertia must give their count, and every method the largest of them."""
    scene = make()
    H = dense(scene, factor)
    exact = np.linalg.eigvalsh((H + H.T) / 2)[::-1]
    norm = np.abs(exact).max()
    assert worst(H, H.T) / norm < 1e-14  # measured 4e-16
    values, _, about = pd.body_spectrum(scene, factor=factor)
    assert about["method"] == "dense" and len(values) == len(exact)
    assert worst(values, exact) / norm < 1e-13  # measured 2e-15
    assert abs(about["norm"] / norm - 1) < 1e-13  # measured 1e-15
    count = int((exact > 1e-10 * norm).sum())
    assert positive is None or count == positive
    assert about["positive"] == count == pd.body_inertia(scene, factor=factor)
    for method in ("dense", "sparse", "matrix_free"):
        found = pd.body_stability(scene, factor=factor, method=method)
        assert found.method == method and found.positive == (None if method == "matrix_free" else count)
        assert abs(found.eigenvalue - exact[0]) / norm < 1e-13  # measured 7e-16
        assert found.residual / norm < 1e-13  # measured 1e-15
        assert found.verdict == ("unstable" if count else "stable")
        assert found.kind == ("saddle" if count else "minimum")
        # The mode satisfies J v = λ v on the free components and is 0 on the held ones.
        root = np.sqrt(np.repeat(scene.body.volumes, scene.body.dim))[scene.unknowns]
        v = found.mode.reshape(-1)[scene.unknowns]
        assert worst(H @ (root * v) / root, exact[0] * v) / norm < 1e-13  # measured 5e-16
        assert worst(found.mode[~scene.free]) == 0 and abs(np.linalg.norm(found.mode) - 1) < 1e-13


def test_every_method_finds_several_eigenvalues():
    """The five largest eigenvalues, and their modes, of a plate whose eigenvalues are nearly equal."""
    scene = plate()
    H = dense(scene, 0.5)
    exact = np.linalg.eigvalsh((H + H.T) / 2)[::-1]
    for method in ("dense", "sparse", "matrix_free"):
        values, modes, _ = pd.body_spectrum(scene, count=5, factor=0.5, method=method)
        assert worst(values, exact[:5]) / np.abs(exact).max() < 1e-13  # measured 9e-16
        assert modes.shape == (5, 182, 2)


@pytest.mark.parametrize("factor", [0.05, 1.0])
def test_energy_falls_along_an_unstable_mode_and_rises_along_a_stable_one(factor):
    """The second difference of Π along the mode of the largest eigenvalue λ is −λ Σ V v², for either sign of λ."""
    scene = bar()
    top = pd.body_stability(scene, factor=factor)
    u, v, h = factor * scene.closed_form, jnp.asarray(top.mode), 1e-5
    energy = jax.jit(lambda u: pd.strain_energy(scene.model, scene.families, u))
    bend = float(energy(u + h * v) - 2 * energy(u) + energy(u - h * v)) / h**2
    exact = -top.eigenvalue * float(scene.body.volumes @ np.sum(top.mode**2, axis=1))
    assert (bend < 0) == (factor == 1.0)
    assert abs(bend / exact - 1) < 2e-2  # measured 2e-4


def test_a_periodic_chain_has_the_spectrum_of_its_symbol():
    """The symbol at k = 2πj/n gives the spectrum of a chain of 15 points under a mean strain with one point held."""
    n, h, F = 15, 0.5, jnp.array([[0.93]])
    body = pd.lattice((n,), h, periodic=True)
    model = pd.SethHill(1.0, LINEAR)
    symbol = pd.symbol(model, pd.lattice_family(1, 3, h), F, 2 * np.pi * np.arange(n)[:, None] / (n * h))[:, 0, 0]
    scene = pd.scene(body, pd.families(body, 3 * h), model, pd.prescribe(0), mean=F)
    values, _, about = pd.body_spectrum(scene, np.zeros((n, 1)))
    # One point is held, so one of each pair of equal eigenvalues (k and −k) remains; the others interlace (Cauchy).
    exact = np.sort(np.asarray(symbol))[::-1]
    assert len(values) == n - 1
    assert (values <= exact[:-1] + 1e-12).all() and (values >= exact[1:] - 1e-12).all()
    pairs = np.unique(np.round(exact, 9))
    kept = [v for v in pairs if np.isclose(exact, v, atol=1e-8).sum() == 2]
    assert len(kept) == 7
    assert max(np.abs(values - v).min() for v in kept) / about["norm"] < 1e-8  # measured 3e-10 (rounded to 9 digits)


# ---------------------------------------------------------------- critical loads


@pytest.mark.parametrize("make", [bar, plate])
def test_critical_load_is_where_the_dense_eigenvalue_crosses(make):
    """Brent's method finds the root of the largest dense eigenvalue. Few matrix factorisations prove the same root."""
    scene = make()
    f = jax.jit(jax.jacfwd(lambda u: pd.force_density(scene.model, scene.families, u)))
    root, keep = np.sqrt(np.repeat(scene.body.volumes, scene.body.dim)), scene.free.reshape(-1)

    def largest(factor):
        J = np.asarray(f(factor * scene.closed_form)).reshape(len(root), -1)
        H = (root[:, None] * J / root)[np.ix_(keep, keep)]
        return np.linalg.eigvalsh((H + H.T) / 2)[-1]

    found = pd.body_critical_load(scene)
    exact = brentq(largest, 0.5 * found.factor, 1.5 * found.factor, rtol=1e-11)
    assert abs(found.factor / exact - 1) < 1e-6  # measured 5e-9
    assert largest(0.5 * found.factor) < 0
    assert found.proved and found.factorisations <= 8
    # Nearer to the root than 1e-9 rounding decides the sign (measured: at 2.5e-11 an eigenvalue of 8e-15 ‖H‖).
    assert all((count > 0) == (factor > exact) for factor, count in found.positive if abs(factor / exact - 1) > 1e-9)
    mode, top = found.mode, pd.body_stability(scene, factor=found.factor).mode
    assert min(worst(mode, top), worst(mode, -top)) < 1e-8  # measured 6e-12


def test_a_path_that_is_twice_as_fast_has_half_the_critical_factor():
    """The same state is reached at half the load factor."""
    scene = bar()
    once, twice = pd.body_critical_load(scene), pd.body_critical_load(scene, lambda x: 2 * x * scene.closed_form)
    assert abs(2 * twice.factor / once.factor - 1) < 1e-10  # measured 4e-15


def critical_strain(n, N):
    return -0.01 * pd.body_critical_load(step_size_bar(n, N, -0.01, 2 * N)).factor


@pytest.mark.parametrize("N", [1, 3])
def test_odd_horizons_lose_stability_as_the_inverse_square_of_length(N):
    """λ(π − q) = −κ/(N²h²) s², s ≈ q, balances the stress term −(4aκ/N h²) Σ_{p odd} 1/p², with q = π/n."""
    loads = np.array([critical_strain(n + 4 * N, N) for n in (40, 80)])
    odd = sum(1 / p**2 for p in range(1, N + 1, 2))
    ratio = loads * 4 * N * odd * (np.array([40, 80]) / np.pi) ** 2
    slope = np.log2(loads[0] / loads[1])
    assert 1.8 < slope < 2.1  # measured 1.93, 1.89
    assert -1 < ratio[1] < ratio[0] < -0.8  # measured N=1: -0.95, -0.91; N=3: -0.92, -0.85


def test_an_even_horizon_loses_stability_as_the_inverse_sixth_power():
    """For N = 2, s = sin q − sin(2q)/2 ≈ q³/2 gives a clamped sixth-order equation with q⁶ = (2π/n)⁶."""
    loads = np.array([critical_strain(n + 8, 2) for n in (40, 80)])
    ratio = loads * 8 / (0.25 * (2 * np.pi / np.array([40, 80])) ** 6)
    slope = np.log2(loads[0] / loads[1])
    assert 5.3 < slope < 6.2  # measured 5.6; 6 in the limit
    assert -1 < ratio[1] < ratio[0] < -0.5  # measured -0.75, -0.57


def test_a_bar_in_tension_has_no_critical_load():
    found = pd.body_critical_load(step_size_bar(41, 3, 1.0))
    assert np.isinf(found.factor) and found.mode is None and found.proved
    assert all(count == 0 for _, count in found.positive)


def test_wrong_arguments_of_the_spectrum_functions_are_refused():
    scene = bar()
    without = pd.scene(scene.body, scene.families, scene.model, pd.prescribe(np.arange(6)))
    lying = pd.scene(
        scene.body,
        scene.families,
        NoEnergy(1.0, pd.LinearElastic(1.0, 0.0)),
        pd.prescribe(np.arange(6)),
        closed_form=scene.closed_form,
    )
    for function in (pd.body_spectrum, pd.body_stability, pd.body_inertia, pd.body_critical_load):
        with pytest.raises(ValueError, match="NoEnergy has no energy"):
            function(lying)
        with pytest.raises(ValueError, match="this scene has no closed form"):
            function(without)
    with pytest.raises(ValueError, match="method must be one of auto, dense, sparse, matrix_free; got 'lanczos'"):
        pd.body_stability(scene, method="lanczos")
    with pytest.raises(ValueError, match="limit must be > 0"):
        pd.body_critical_load(scene, limit=0.0)
    with pytest.raises(ValueError, match="u must have shape"):
        pd.body_stability(scene, np.zeros((99, 1)))
    with pytest.raises(ValueError, match="u must be finite"):
        pd.body_stability(scene, np.full((100, 1), np.nan))


def test_printed_results_state_verdict_count_and_proof():
    assert "unstable" in str(pd.body_stability(bar())) and "3 positive" in str(pd.body_stability(bar()))
    assert "not counted" in str(pd.body_stability(bar(), method="matrix_free"))
    assert "proved by inertia" in str(pd.body_critical_load(bar()))
    assert MODELS["seth_hill m=1"].hyperelastic and not NoEnergy.hyperelastic


def test_a_body_of_one_unknown_has_a_critical_load():
    """Its stiffness is one number, so the load at which it vanishes can be bracketed directly."""
    scene = pd.scenes.step_size_bar(13, 3, -0.1)
    assert len(np.asarray(scene.unknowns)) == 1
    found = pd.body_critical_load(scene)
    at = [pd.body_spectrum(scene, scene.closed_form * f, factor=f)[0][0] for f in np.linspace(0, 1, 11)]
    first = np.flatnonzero(np.array(at) > 0)
    if found.factor < np.inf and len(first):
        assert (first[0] - 1) / 10 <= found.factor <= first[0] / 10
    else:
        assert not len(first)


def test_the_number_of_eigenvalues_is_at_least_one():
    with pytest.raises(ValueError, match="count must be a whole number >= 1"):
        pd.body_spectrum(pd.scenes.step_size_bar(20, 3, -0.1), count=0)
