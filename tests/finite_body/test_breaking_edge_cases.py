"""Breaking in unusual bodies: a horizon for each point, ends that meet, models without an energy, signed influences."""

import jax
import numpy as np
import pytest

import pdjax as pd
from pdjax.force.backends import padded

LAW = pd.LinearElastic(1.0, 1.0)
STILL = {"show_progress": False}


def two_horizons():
    body = pd.lattice((12, 8))
    x, y = body.positions.T
    families = pd.families(body, np.where(x < 6, 2.015, 3.015))
    families = pd.cut(families, pd.Segment((0.0, 4.0), (4.0, 4.0)))
    return body, families, np.stack([0 * x, 0.01 * (y - 4.0)], axis=1)


@pytest.mark.parametrize("streamed", [False, True], ids=["whole", "streamed"])
@pytest.mark.parametrize("model", [pd.LPS(1.0, 0.6), pd.Correspondence(LAW)], ids=["LPS", "correspondence"])
def test_bonds_with_a_weight_at_one_end_break_at_both(model, streamed, monkeypatch):
    if streamed:
        monkeypatch.setattr(padded, "SMALL", 0)
    body, families, velocity = two_horizons()
    motion = pd.motion(pd.scene(body, families, model, moving=True), velocity=velocity)
    history = pd.simulate(motion, 6.0, dt=0.1, breaking=pd.CriticalStretch(0.02), **STILL)
    momentum = np.abs((np.asarray(motion.mass) * np.asarray(history.v[-1])).sum(axis=0)).max()
    assert momentum < 1e-13  # measured 4e-15; 0.04 when the far end was forgotten
    assert float(np.abs(history.energies.error).max()) < 2e-3  # measured 3e-4
    back = np.asarray(families.neighbours), np.asarray(families.reverse)
    at = np.where(np.asarray(families.is_bond), history.broken_at, np.inf)
    one_sided = np.asarray(families.acting) & ~(np.asarray(families.weight) > 0)
    assert np.array_equal(at, at[back]) and np.isfinite(at[one_sided]).any()
    assert len(pd.crack_path(families, at).times) == np.isfinite(at).sum() // 2


def test_solve_breaking_breaks_such_bonds_at_both_ends():
    body, families, velocity = two_horizons()
    y = body.positions[:, 1]
    low, high = y < 2, y > 6
    held = pd.prescribe(low, 10 * velocity[low]), pd.prescribe(high, 10 * velocity[high])
    scene = pd.scene(body, families, pd.LPS(1.0, 0.6), *held)
    path = pd.solve_breaking(scene, pd.CriticalStretch(0.05, no_fail=low | high), load_steps=4, **STILL)
    at, back = path.broken_at, (np.asarray(families.neighbours), np.asarray(families.reverse))
    assert path.broken_bonds > 10 and np.array_equal(
        np.where(families.is_bond, at, 0), np.where(families.is_bond, at[back], 0)
    )


@pytest.mark.parametrize("streamed", [False, True], ids=["whole", "streamed"])
@pytest.mark.parametrize("model", [pd.BondBased(1.0), pd.LPS(1.0, 0.6)], ids=["bond-based", "LPS"])
def test_ends_of_a_broken_bond_may_meet(model, streamed, monkeypatch):
    """The force of a broken bond of length 0 would be 0 · ∞."""
    if streamed:
        monkeypatch.setattr(padded, "SMALL", 0)
    body = pd.lattice((6, 3))
    x = body.positions[:, [0]]
    families = pd.families(body, 1.015)
    parts = pd.cut(families, pd.Plane((3.0, 0.0), (1.0, 0.0)))
    broken = families.with_broken(np.asarray(parts.weight) < np.asarray(families.weight))
    velocity = np.where(x < 3, 1.0, -1.0) * [1.0, 0.0]
    motion = pd.motion(pd.scene(body, broken, model, moving=True), velocity=velocity)
    history = pd.simulate(motion, 1.0, dt=0.25, breaking=pd.CriticalStretch(0.5), **STILL)
    meets = np.asarray(history.u[2] + body.positions)
    assert np.abs(meets[6:9] - meets[9:12]).max() == 0
    assert history.finished and np.abs(history.u[-1] - 1.0 * velocity).max() < 1e-12  # measured 0
    force = pd.force_density(model, broken, history.u[2])
    assert float(np.abs(force).max()) < 1e-12  # measured 0


def test_a_model_without_an_energy_breaks_too():
    body, families, velocity = two_horizons()
    families = pd.cut(pd.families(body, 2.015), pd.Segment((0.0, 4.0), (4.0, 4.0)))
    model = pd.Correspondence(LAW, pd.LittlewoodControl(0.2))
    motion = pd.motion(pd.scene(body, families, model, moving=True), velocity=velocity)
    history = pd.simulate(motion, 6.0, dt=0.1, breaking=pd.CriticalStretch(0.02), **STILL)
    assert history.finished and np.isfinite(history.broken_at).any() and np.isnan(history.energies.released[-1])
    assert "the model has no energy" in str(history)


@pytest.mark.parametrize("model", [pd.BondBased(1.0), pd.LPS(1.0, 0.6)], ids=["bond-based", "LPS"])
def test_a_point_with_negative_bonds_alone_is_no_fragment(model, monkeypatch):
    """Both backends agree, and the force is the gradient of the energy."""
    influence = pd.signed_influence(lambda r, delta: np.where(r > 1.5, -0.1, 1.0))
    families = pd.families(pd.lattice((7, 7)), 2.015, influence)
    short = np.linalg.norm(np.asarray(families.xi), axis=-1) < 1.5
    mine = (np.arange(49) == 24)[:, None] | (np.asarray(families.neighbours) == 24)
    broken = families.with_broken(short & mine & np.asarray(families.is_bond))
    u = 0.02 * np.random.default_rng(0).normal(size=(49, 2))
    whole = np.asarray(pd.force_density(model, broken, u, way="families"))
    monkeypatch.setattr(padded, "SMALL", 0)
    fresh = families.with_broken(short & mine & np.asarray(families.is_bond))
    streamed = np.asarray(pd.force_density(model, fresh, u, way="families"))
    gradient = np.asarray(jax.grad(lambda u: pd.strain_energy(model, broken, u))(u))
    size = np.abs(whole).max()
    assert np.abs(whole - streamed).max() < 1e-13 * size  # measured 1e-16; 1e-2 with another rule for fragments
    assert np.abs(whole + gradient).max() < 1e-13 * size  # measured 5e-16


def test_times_of_saves_and_of_breaks_are_the_same_products():
    body, families, velocity = two_horizons()
    families = pd.cut(pd.families(body, 2.015), pd.Segment((0.0, 4.0), (4.0, 4.0)))
    motion = pd.motion(pd.scene(body, families, pd.LPS(1.0, 0.6), moving=True), velocity=velocity)

    def run(motion):
        return pd.simulate(motion, 8.4, dt=0.1, save_every=3, breaking=pd.CriticalStretch(0.02), **STILL)

    monitored, traced = run(motion), jax.jit(run)(motion)
    assert np.array_equal(monitored.times, traced.times)
    at = np.unique(monitored.broken_at[np.isfinite(monitored.broken_at)])
    assert np.array_equal(monitored.broken_at, traced.broken_at) and len(at) > 3
    steps = np.round(at / 0.1)
    assert np.isin(at[steps % 3 == 0], monitored.times).all() and (steps % 3 == 0).any()
