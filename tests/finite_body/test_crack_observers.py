"""Observers and functions of cracks, on cracks that are made up and known exactly."""

import numpy as np
import pytest

import pdjax as pd

H = 0.5
BODY = pd.lattice((24, 16), H)
X = BODY.positions
FAMILIES = pd.families(BODY, 3.015 * H)
MIDDLE = 4.0
SCENE = pd.scene(BODY, FAMILIES, pd.BondBased(1.0), moving=True)


def cut_to(x, y=MIDDLE):
    """Mask (points, bonds) of the bonds that cross the straight crack from the left side to x."""
    cracked = pd.cut(FAMILIES, pd.Segment((0.0, y), (x, y)))
    return np.asarray(cracked.weight) < np.asarray(FAMILIES.weight)


def seen(observer, broken):
    zero = np.zeros_like(X)
    return float(observer(SCENE, pd.observers.Snapshot(0.0, 1.0, zero, zero, zero, ~broken)))


@pytest.mark.parametrize("length", [3.0, 5.5, 9.0])
def test_the_tip_of_a_straight_crack_is_found_within_a_horizon(length):
    tip = seen(pd.observers.crack_tip((1.0, MIDDLE), (2.0, 0.0)), cut_to(length))
    # A bond beside the end of the crack goes around it, so the damage is 0.35 a little behind the end.
    assert -0.6 * H < tip - (length - 1.0) < 0.1 * H  # measured: −0.5 h at each length, half a spacing


def test_a_body_without_damage_ahead_of_the_start_has_its_tip_at_the_start():
    nothing = np.zeros_like(cut_to(3.0))
    assert seen(pd.observers.crack_tip((1.0, MIDDLE), (1.0, 0.0)), nothing) == 0
    assert seen(pd.observers.crack_tip((6.0, MIDDLE), (1.0, 0.0)), cut_to(3.0)) == 0
    assert seen(pd.observers.crack_tip((6.0, MIDDLE), (-1.0, 0.0)), cut_to(3.0)) > 5.0


def test_a_tip_is_watched_in_a_run():
    motion = pd.motion(SCENE, velocity=np.stack([0 * X[:, 0], 1e-2 * np.sign(X[:, 1] - MIDDLE)], axis=1))
    watch = {"tip": pd.observers.crack_tip((0.0, MIDDLE), (1.0, 0.0))}
    breaking = pd.CriticalStretch(1e-3, no_fail=X[:, 0] > 8.0)
    dt = 0.4 * pd.critical_time_step(motion)
    history = pd.simulate(motion, 20 * dt, dt=dt, breaking=breaking, observers=watch, save_every=2, show_progress=False)
    tip = history.observed["tip"]
    assert (np.diff(tip) >= 0).all() and 7.0 < tip[-1] < 8.0


def test_tips_are_checked():
    with pytest.raises(ValueError, match="direction must not be 0"):
        pd.observers.crack_tip((0.0, 0.0), (0.0, 0.0))
    with pytest.raises(ValueError, match="damage must lie between 0 and 1"):
        pd.observers.crack_tip((0.0, 0.0), (1.0, 0.0), damage=1.0)
    wrong = {"tip": pd.observers.crack_tip((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}
    with pytest.raises(ValueError, match=r"must have shape \(2,\) for this body"):
        pd.observers.check_observers(SCENE, wrong)


def test_the_path_lists_every_broken_bond_once_in_the_order_of_breaking():
    broken_at = np.where(cut_to(6.0), 1.0, np.inf)
    early = cut_to(3.0)
    broken_at[early] = 0.5
    path = pd.crack_path(FAMILIES, broken_at)
    assert len(path.times) == cut_to(6.0).sum() // 2 and (np.diff(path.times) >= 0).all()
    assert (path.times == 0.5).sum() == early.sum() // 2
    assert np.abs(path.positions[:, 1] - MIDDLE).max() < 1.5 * H and path.positions[:, 0].max() < 6.0 + 1.5 * H
    near = path.near((0.0, MIDDLE), 2.0)
    assert 0 < len(near.times) < len(path.times)
    assert np.linalg.norm(near.positions - [0.0, MIDDLE], axis=1).max() <= 2.0


def test_a_plane_has_its_own_area():
    """The crack of the length a cuts as many bonds as a plane, up to the bonds that go around its ends."""
    areas = [pd.crack_area(FAMILIES, cut_to(x)) for x in (4.0, 8.0)]
    assert areas[1] - areas[0] == pytest.approx(4.0, rel=1e-12)  # measured 4e-16
    assert abs(areas[0] - 4.0) < 1.0 * H  # measured −h/3: the end at the free side


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_the_area_of_a_cut_through_a_periodic_body_is_exact(dim):
    body = pd.lattice((9, 8, 7)[:dim], H, periodic=(False, True, True)[:dim])
    families = pd.families(body, 2.0 * H)
    plane = pd.Plane((4.0 * H,) + (0.0,) * (dim - 1), (1.0,) + (0.0,) * (dim - 1))
    broken = np.asarray(pd.cut(families, plane).weight) < np.asarray(families.weight)
    area = np.prod(np.array([8, 7][: dim - 1]) * H)
    assert pd.crack_area(families, broken) == pytest.approx(area, rel=1e-12)  # measured 1e-16


def test_a_steady_tip_has_its_speed_and_steps_of_the_lattice_are_smoothed():
    t = np.linspace(0.0, 1.0, 101)
    tip = np.maximum(t - 0.2, 0.0) * 3.0
    speed = pd.crack_speed(t, tip, window=0.1)
    assert np.abs(speed[(t > 0.26) & (t < 0.94)] - 3.0).max() < 1e-11  # measured 3e-13
    assert np.abs(speed[t < 0.14]).max() < 1e-12
    stepped = np.floor(tip / 0.05) * 0.05
    smooth = pd.crack_speed(t, stepped, window=0.2)[(t > 0.31) & (t < 0.89)]
    assert np.abs(smooth - 3.0).max() < 0.2  # measured 0.10
    assert np.isnan(pd.crack_speed(np.array([0.0, 1.0]), np.array([0.0, 1.0]), window=0.1)).all()


@pytest.mark.parametrize("angle", [-170.0, -68.0, 0.0, 12.0, 68.0, 135.0])
def test_a_straight_crack_has_its_angle(angle):
    turned, along = np.radians(angle + 30.0), np.radians(30.0)
    s = np.linspace(0.0, 2.0, 50)
    line, normal = np.array([np.cos(turned), np.sin(turned)]), np.array([-np.sin(turned), np.cos(turned)])
    scatter = 0.01 * (-1.0) ** np.arange(50)
    found = pd.crack_angle(
        np.array([3.0, -1.0]) + s[:, None] * line + scatter[:, None] * normal, [np.cos(along), np.sin(along)]
    )
    assert found == pytest.approx(angle, abs=0.1)  # measured 0.034: the scatter across is not symmetric


@pytest.mark.parametrize("half", [15.0, 30.0])
@pytest.mark.parametrize("turn", [0.0, 40.0])
def test_branches_are_found_where_they_begin(half, turn):
    """A crack of the width of a horizon, with two branches from x = 10 on."""
    generator = np.random.default_rng(1)
    delta = 1.0
    s = generator.uniform(0.0, 10.0, 4000)
    stem = np.stack([s, generator.uniform(-0.3, 0.3, s.size)], axis=1)
    arms = []
    for sign in (1.0, -1.0):
        r = generator.uniform(0.0, 10.0, 4000)
        arm = np.stack([10.0 + r, sign * r * np.tan(np.radians(half)) + generator.uniform(-0.3, 0.3, r.size)], axis=1)
        arms.append(arm)
    crack = np.concatenate([stem, *arms])
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    rotation = np.array([[c, -s], [s, c]])
    found = pd.crack_branching(crack @ rotation.T + [2.0, 3.0], [2.0, 3.0], rotation[:, 0], delta)
    # Branches count as two when the gap between them is half a horizon, at x = 10 + 0.55/tan(half).
    assert found.distance == pytest.approx(10.0 + 0.55 / np.tan(np.radians(half)), abs=1.0)  # measured 0.05
    assert found.angle == pytest.approx(2 * half, abs=0.5)  # measured 0.08
    assert (found.counts[:9] == 1).all() and found.counts[-1] == 2


def test_a_single_crack_has_no_branches():
    found = pd.crack_branching(np.stack([np.linspace(0, 5, 100), np.zeros(100)], axis=1), [0, 0], [1, 0], 0.5)
    assert found.distance == np.inf and np.isnan(found.angle) and (found.counts == 1).all()


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="broken_at must have shape"):
        pd.crack_path(FAMILIES, np.zeros(3))
    with pytest.raises(ValueError, match="broken must be bool"):
        pd.crack_area(FAMILIES, np.zeros(3, bool))
    with pytest.raises(ValueError, match="times must increase"):
        pd.crack_speed([0.0, 0.0], [0.0, 1.0], 1.0)
    with pytest.raises(ValueError, match="window must be finite"):
        pd.crack_speed([0.0, 1.0], [0.0, 1.0], 0.0)
    with pytest.raises(ValueError, match="two different points"):
        pd.crack_angle([[0.0, 1.0]], [1.0, 0.0])
    with pytest.raises(ValueError, match=r"shape \(broken, 2\)"):
        pd.crack_angle([[0.0], [1.0]], [1.0, 0.0])
    with pytest.raises(ValueError, match="width must be finite"):
        pd.crack_branching([[0.0, 1.0]], [0.0, 0.0], [1.0, 0.0], 0.0)
