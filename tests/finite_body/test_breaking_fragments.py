"""Bonds of models with a shape tensor: fragments, no NaN, and sums over the bonds that remain."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.finite_body.damage import few_points, fragments
from pdjax.finite_body.damage.fragments import LEAST, without_fragments
from pdjax.finite_body.dynamics import breaking
from pdjax.force.backends import padded

LAW = pd.LinearElastic(1.0, 1.0)
BODY = pd.lattice((14, 9))
X = BODY.positions
NOTCHED = pd.cut(pd.families(BODY, 3.015), pd.Segment((0.0, 4.0), (7.0, 4.0)))
APART = np.stack([0 * X[:, 0], 0.02 * (X[:, 1] - 4.0)], axis=1)
MODELS = {
    "Silling": pd.Correspondence(LAW, pd.SillingControl(0.2)),
    "Wan": pd.Correspondence(LAW, pd.WanControl()),
    "Seth-Hill 0": pd.SethHill(0.0, LAW),
    "Seth-Hill 1": pd.SethHill(1.0, LAW),
    "bond level": pd.BondLevel(LAW),
    "sub-horizon": pd.SubHorizon(LAW),
    "reproducing kernel": pd.ReproducingKernel(LAW),
}


def torn(model, families=NOTCHED, share=0.3, steps=60):
    motion = pd.motion(pd.scene(BODY, families, model, moving=True), velocity=APART)
    critical = pd.critical_time_step(motion)
    settings = {"dt": share * critical, "save_every": 10, "show_progress": False}
    watch = {"damage": pd.observers.damage()}
    return pd.simulate(motion, steps * critical, breaking=pd.CriticalStretch(0.05), observers=watch, **settings)


def left_after(model, families, alive):
    """The bonds that are left of `alive` without fragments, in a body that was whole before."""
    before = jnp.asarray(families.weight) > 0
    return np.asarray(without_fragments(model, families, before, jnp.asarray(alive)))


def kept_by_hand(families, alive):
    """The smallest share of K that any direction keeps, at every point, by NumPy and generalised eigenvalues."""
    from scipy.linalg import eigh

    xi, w = np.asarray(families.xi), np.asarray(families.weight * families.influence)
    w = w * np.asarray(families.volumes)[np.asarray(families.neighbours)]
    K = [np.einsum("pb,pbi,pbj->pij", x, xi, xi) for x in (np.where(alive, w, 0), w)]
    return np.array([eigh(a, b, eigvals_only=True)[0] for a, b in zip(*K, strict=True)])


@pytest.mark.parametrize("name", list(MODELS))
def test_a_torn_plate_has_finite_forces_and_a_closed_budget(name):
    coarse, fine = (torn(MODELS[name], share=share, steps=20) for share in (0.3, 0.15))
    for history in (coarse, fine):
        assert np.isfinite(history.u).all() and np.isfinite(np.asarray(history.energies.total)).all()
        lost = np.isfinite(history.broken_at)
        assert lost.any() and np.array_equal(lost, (np.asarray(NOTCHED.weight) > 0) & ~np.asarray(history.alive))
    # Measured, coarse and fine: 3e-3 to 1e-2 and 8e-4 to 3.4e-3.
    errors = [float(np.abs(h.energies.error).max()) for h in (coarse, fine)]
    assert errors[1] < 0.5 * errors[0] and errors[1] < 5e-3


def test_a_fragment_is_a_point_that_has_lost_a_direction():
    families, model = pd.families(BODY, 3.015), MODELS["Silling"]
    alive = np.asarray(families.weight) > 0
    i = int(np.argmin(np.abs(X - [7.5, 4.5]).sum(axis=1)))
    neighbours = np.asarray(families.neighbours)
    off_line = (np.asarray(families.xi)[i, :, 1] != 0) & alive[i]
    one_left = alive.copy()
    one_left[i, np.flatnonzero(off_line)[1:]] = False
    none_left = alive.copy()
    none_left[i, off_line] = False
    back = neighbours, np.asarray(families.reverse)
    one_left, none_left = (x & x[back] for x in (one_left, none_left))
    kept = kept_by_hand(families, one_left)
    assert kept[i] > LEAST and np.array_equal(left_after(model, families, one_left), one_left)
    assert kept_by_hand(families, none_left)[i] < 1e-12
    after = left_after(model, families, none_left)
    assert not after[i].any() and np.array_equal(after, after[back])
    others = neighbours != i
    others[i] = False
    assert np.array_equal(after & others, none_left & others)
    assert np.array_equal(left_after(pd.LPS(1.0, 0.6), families, none_left), none_left)


def test_fragments_take_their_neighbours_along():
    """A chain across the plate loses its side bonds one end first: the test must be repeated."""
    body = pd.lattice((6, 2))
    families = pd.families(body, 1.5)
    alive = np.asarray(families.weight) > 0
    x, y = body.positions.T
    j = np.asarray(families.neighbours)
    rung = alive & (y[:, None] != y[j]) & ~((x[:, None] < 1) & (x[j] < 1))  # only the first rung stays
    left = alive & ~rung
    assert left.sum() == 2 * (5 + 5 + 1)
    # The two points of the rung keep both directions. All others are on a line. Without them, so are these two.
    assert not left_after(MODELS["Silling"], families, left).any()


@pytest.mark.parametrize("unit", [1e-9, 1e6])
def test_fragments_do_not_depend_on_units(unit):
    masks = []
    for scale in (1.0, unit):
        families = pd.families(pd.lattice((9, 7), spacing=scale), 2.1 * scale)
        alive, back = np.asarray(families.weight) > 0, (np.asarray(families.neighbours), np.asarray(families.reverse))
        keep = np.random.default_rng(0).random(alive.shape) < 0.75
        alive &= keep & keep[back]
        masks.append(left_after(MODELS["Seth-Hill 1"], families, alive))
        assert masks[-1].any() and (masks[-1] != alive).any()
    assert np.array_equal(*masks)


def test_the_force_after_a_break_is_that_of_the_body_that_remains():
    """The remaining bonds are the whole family of a correspondence model: `with_weight` knows of no break."""
    history = torn(MODELS["Silling"], steps=20)
    u = np.asarray(history.u[-1])
    broken = NOTCHED.with_broken(np.isfinite(history.broken_at))
    alone = NOTCHED.with_weight(np.asarray(history.alive, float))
    a, b = (np.asarray(pd.force_density(MODELS["Silling"], f, u)) for f in (broken, alone))
    assert np.abs(a).max() > 1e-3 and np.abs(a - b).max() < 1e-13 * np.abs(a).max()  # measured 0


def test_fragments_exert_no_force():
    history = torn(MODELS["Seth-Hill 0"])
    gone = np.asarray(history.observed["damage"][-1]) == 1
    v = np.asarray(history.v)[:, gone]
    first = np.argmax(history.observed["damage"][:, gone] == 1, axis=0)
    assert gone.any()
    for k in range(gone.sum()):
        assert np.array_equal(v[first[k] + 1 :, k], np.broadcast_to(v[-1, k], v[first[k] + 1 :, k].shape))


def test_a_step_that_is_too_long_for_the_cracked_body_is_named():
    """A periodic body is torn at the start. Its new surfaces have smaller families, and are stiffer in this model."""
    body = pd.lattice((12, 10), periodic=True)
    families, model = pd.families(body, 2.1), pd.SethHill(1.0, LAW)
    start = np.where(body.positions[:, [1]] > 5, 0.15, -0.15) * [0.0, 1.0]
    motion = pd.motion(pd.scene(body, families, model, moving=True), start=start)
    criterion = pd.CriticalStretch(0.05)
    after = families.with_broken(criterion.broken(model, families, start))
    cracked = pd.motion(pd.scene(body, after, model, moving=True), start=start)
    critical = [pd.critical_time_step(m) for m in (motion, cracked)]
    dt = sum(critical) / 2
    assert critical[1] < 0.8 * critical[0]  # measured 1.358 and 1.024
    history = pd.simulate(motion, 60 * dt, dt=dt, save_every=10, breaking=criterion, show_progress=False)
    assert np.isfinite(history.u).all() and history.failure is not None
    assert history.failure.critical_step == pytest.approx(critical[1], rel=2e-3)  # measured 4e-4
    assert "is above the critical step" in history.reason and "without the broken bonds" in history.reason


def test_a_body_that_shatters_at_once_gives_a_warning():
    families, model = pd.families(BODY, 3.015), pd.BondBased(1.0)
    motion = pd.motion(pd.scene(BODY, families, model, moving=True), start=0.01 * X)
    bonds = int(families.count.sum()) // 2
    with pytest.warns(UserWarning, match=rf"{bonds} of {bonds} bonds break in the first step"):
        history = pd.simulate(motion, 1.0, dt=0.5, breaking=pd.CriticalStretch(1e-3), show_progress=False)
    assert f"{bonds} bonds broke, the first at t = 0" in str(history) and np.isfinite(history.u).all()


@pytest.mark.parametrize("name", ["LPS", "Silling", "Seth-Hill 1"])
@pytest.mark.parametrize("streamed", [False, True], ids=["whole", "streamed"])
def test_a_break_at_few_points_is_that_of_the_whole_body(name, streamed, monkeypatch):
    """Energy released, fragments and reference sums, computed at the points that change and at all points."""
    if streamed:
        monkeypatch.setattr(padded, "SMALL", 0)
    model = (MODELS | {"LPS": pd.LPS(1.0, 0.6)})[name]
    runs = []
    for few in (few_points.FEW, 1):
        for module in (few_points, fragments, breaking):
            monkeypatch.setattr(module, "FEW", few)
        families = eqx.tree_at(lambda f: f.volumes, NOTCHED, NOTCHED.volumes + 0)  # families that remember no program
        jax.clear_caches()
        runs.append(torn(model, families, steps=20))
    few, all_ = runs
    assert np.isfinite(few.broken_at).any() and np.array_equal(few.broken_at, all_.broken_at)
    assert np.abs(few.u - all_.u).max() < 1e-12 * np.abs(all_.u).max()  # measured 1e-14
    size = np.abs(all_.energies.released).max()
    assert np.abs(few.energies.released - all_.energies.released).max() < 1e-12 * size  # measured 1e-15
