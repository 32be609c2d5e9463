"""Bonds that lose their force gradually, and derivatives with respect to bond weights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

LAW = pd.LinearElastic(1.0, 1.0)
BODY = pd.lattice((12, 8))
X = BODY.positions
NOTCHED = pd.cut(pd.families(BODY, 2.1), pd.Segment((0.0, 4.0), (6.0, 4.0)))
APART = np.stack([0 * X[:, 0], 0.01 * (X[:, 1] - 4.0)], axis=1)
POINT = jnp.array([1.0, 0.02, 0.002])  # bulk modulus, critical stretch, smoothing


def run(bulk, stretch, smoothing, steps=30, every=10, dt=0.3):
    motion = pd.motion(pd.scene(BODY, NOTCHED, pd.LPS(bulk, 0.6), moving=True), velocity=APART)
    breaking = pd.CriticalStretch(stretch, smoothing=smoothing)
    return pd.simulate(motion, steps * dt, dt=dt, save_every=every, breaking=breaking, show_progress=False)


def end(p):
    return jnp.sum(run(*p).u[-1] ** 2)


def test_derivatives_of_a_run_beyond_the_first_break_are_exact():
    value, reverse = jax.jit(jax.value_and_grad(end))(POINT)
    assert float(jnp.sum(run(*POINT).alive < 0.5)) > 60 + float(jnp.sum(NOTCHED.weight == 0))
    plain = jax.jit(end)
    forward = jax.jit(jax.jacfwd(end))(POINT)
    for k, size in enumerate(np.asarray(POINT) * 1e-6):
        central = float(plain(POINT.at[k].add(size)) - plain(POINT.at[k].add(-size))) / (2 * size)
        assert float(reverse[k]) == pytest.approx(central, rel=1e-6)  # measured 1e-9
        assert float(forward[k]) == pytest.approx(float(reverse[k]), rel=1e-10)  # measured 1e-14
    assert float(plain(POINT)) == pytest.approx(float(value), rel=1e-13)


def test_narrow_smoothing_is_the_break():
    hard, smooth = (run(1.0, 0.02, w) for w in (None, 1e-6))
    assert hard.alive.dtype == bool and not hard.alive.all()
    assert np.array_equal(np.asarray(smooth.alive) > 0.5, hard.alive)
    assert np.abs(np.asarray(smooth.u) - hard.u).max() < 1e-5 * np.abs(hard.u).max()  # measured 0
    assert np.array_equal(smooth.broken_at, hard.broken_at)


def test_the_energy_budget_of_a_smooth_run_closes_to_the_second_order():
    errors = [
        float(np.abs(run(1.0, 0.02, 0.002, steps=30 * k, every=10 * k, dt=0.3 / k).energies.error).max())
        for k in (1, 2, 4)
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2] and errors[2] < 1e-3  # measured 6e-3, 1.6e-3, 4e-4


def test_a_bond_never_recovers():
    watch = {"left": lambda scene, now: now.alive}
    motion = pd.motion(pd.scene(BODY, NOTCHED, pd.LPS(1.0, 0.6), moving=True), velocity=APART)
    breaking = pd.CriticalStretch(0.02, smoothing=0.002, no_fail=X[:, 0] > 11)
    history = pd.simulate(motion, 30.0, dt=0.3, breaking=breaking, observers=watch, show_progress=False)
    left = np.asarray(history.observed["left"])
    assert (np.diff(left, axis=0) <= 0).all() and left.min() == 0 and left.max() == 1
    safe = (np.asarray(NOTCHED.weight) > 0) & (X[:, 0] > 11)[:, None]
    assert (left[:, safe] == 1).all()


MODELS = {"bond-based": pd.BondBased(1.0), "LPS": pd.LPS(1.0, 0.5), "correspondence": pd.Correspondence(LAW)}


@pytest.mark.parametrize("name", list(MODELS))
def test_the_derivative_of_the_energy_in_the_bond_weights_is_exact(name):
    rng = np.random.default_rng(0)
    u = X * [0.02, -0.01] + 1e-3 * rng.normal(size=X.shape)
    families = pd.families(BODY, 2.1)

    def energy(weight):
        return pd.strain_energy(MODELS[name], families.with_weight(weight), u)

    ones, direction = jnp.ones(families.weight.shape), rng.normal(size=families.weight.shape)
    central = float(energy(ones + 1e-5 * direction) - energy(ones - 1e-5 * direction)) / 2e-5
    # Measured 3e-9, the error of the difference.
    assert float(jnp.sum(jax.grad(energy)(ones) * direction)) == pytest.approx(central, rel=1e-7)


@pytest.mark.parametrize("model", [pd.BondLevel(LAW), pd.SethHill(1.0, LAW)], ids=["bond level", "Seth-Hill"])
def test_the_derivative_of_the_margin_in_the_bond_weights_is_exact(model):
    family, F = pd.lattice_family(2, 2), np.diag([1.05, 0.98])
    half = len(family.xi) // 2

    def margin(weight):
        return pd.stability(model, family.with_weight(jnp.concatenate([weight, weight])), F).margin

    ones = jnp.ones(half)
    gradient = np.asarray(jax.grad(margin)(ones))
    central = [float(margin(ones.at[k].add(1e-5)) - margin(ones.at[k].add(-1e-5))) / 2e-5 for k in range(half)]
    assert np.abs(gradient - central).max() < 1e-7 * np.abs(gradient).max()  # measured 1e-9
    assert np.abs(gradient).max() > 1e-4
