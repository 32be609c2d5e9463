"""Cracks and instabilities that are known beforehand, in runs of prescribed displacements and of `simulate`."""

import json
import types
from dataclasses import dataclass, replace

import numpy as np
import pytest
from table import LINEAR

import pdjax as pd
from pdjax.trust.bursts import bursts_of

SHAPE, H = (14, 11), 0.5
BODY = pd.lattice(SHAPE, H)
FAMILIES = pd.families(BODY, 3.015 * H)
X = BODY.positions
MIDDLE = np.array([X[:, 0].mean(), X[:, 1].mean()])
BOARD = (-1.0) ** np.indices(SHAPE).reshape(2, -1).sum(axis=0)[:, None] * np.array([1.0, -1.0])
SILLING = pd.Correspondence(LINEAR)
CONTROLLED = pd.Correspondence(LINEAR, pd.SillingControl(0.5))
SVK = pd.SethHill(1.0, LINEAR)
LPS = pd.LPS(1.5, 0.7)
STABLE = {"bond-based": pd.BondBased(1.0), "LPS": LPS}
TIMES = np.linspace(0, 1, 41)
OPENING = np.stack([0.2 * np.tanh((X[:, 0] - MIDDLE[0]) / 1.5), 0 * X[:, 0]], axis=1)  # opens a vertical plane


@dataclass
class Run:
    """A run of a user: states at times, and when bonds broke."""

    times: np.ndarray
    u: np.ndarray
    broken_at: np.ndarray


@dataclass
class Path:
    """The same over load factors."""

    load_factors: np.ndarray
    u: np.ndarray
    broken_at: np.ndarray


def prescribed(u, limit, times=TIMES, every=1, families=FAMILIES):
    """The run with the displacements u(t): bonds break at a stretch above the limit, every few states are stored."""
    xi, neighbours = np.asarray(families.xi), np.asarray(families.neighbours)
    at = np.full(neighbours.shape, np.inf)
    for t in times[::-1]:
        now = u(t)
        stretch = np.linalg.norm(xi + now[neighbours] - now[:, None], axis=-1) / np.linalg.norm(xi, axis=-1) - 1
        at[(stretch > limit) & (np.asarray(families.weight) > 0)] = t
    return Run(times[::every], np.stack([u(t) for t in times[::every]]), at)


def at_once(families, u, bond=(0, 0), times=(0.0, 1.0)):
    """A run in which the state u is stored twice, and one bond breaks at the end."""
    at = np.full(families.weight.shape, np.inf)
    i, slot = bond
    at[i, slot] = at[int(families.neighbours[i, slot]), int(families.reverse[i, slot])] = times[-1]
    return Run(np.array(times), np.stack([u] * len(times)), at)


def centre():
    """A bond of the middle point."""
    return int(np.argmin(np.linalg.norm(X - MIDDLE, axis=1))), 0


@pytest.mark.parametrize("name", list(STABLE))
def test_a_plane_that_opens_in_a_stable_model_is_a_crack(name):
    model = STABLE[name]
    run = prescribed(lambda t: t * OPENING, 0.03)
    found = pd.crack_or_instability(model, FAMILIES, run)
    assert found.verdict == "crack" and found.counts["instability first"] == found.counts["undecided"] == 0
    assert abs(found.bursts[0].place[0] - MIDDLE[0]) < H and 0.2 < found.bursts[0].time < 0.9
    assert sum(burst.bonds for burst in found.bursts) == np.isfinite(run.broken_at).sum() // 2
    assert all(burst.margin < -0.05 for burst in found.bursts)  # measured -0.094 and -0.066
    assert found.damage.max() > 0.3 and ((found.burst_of >= 0) == (found.damage > 0)).all()


def test_a_checkerboard_that_breaks_bonds_is_an_instability():
    u = lambda t: 0.002 * X + 0.02 * t * BOARD  # noqa: E731
    run = prescribed(u, 0.03)
    found = pd.crack_or_instability(SILLING, FAMILIES, run)
    first = found.bursts[0]
    assert found.verdict == "instability first" and found.first_instability == 0 and first.time > 0.3
    assert first.zero_energy > 0.5 and abs(first.margin) < 1e-10  # measured 0.95, 4e-17
    assert "neighbours alternated" in first.why


def test_the_same_plane_in_silling_is_a_crack_as_long_as_nothing_alternates():
    run = prescribed(lambda t: t * OPENING, 0.03, every=2)
    found = pd.crack_or_instability(SILLING, FAMILIES, run)
    assert found.verdict == "crack" and found.bursts[0].zero_energy < 0.4  # measured 0.25
    assert abs(found.bursts[0].margin) < 1e-10  # measured 1e-17: Silling's model is marginal


@pytest.mark.parametrize("model, verdict", [(SILLING, "instability first"), (CONTROLLED, "crack"), (LPS, "crack")])
def test_a_jump_between_two_rows_is_an_instability_only_where_the_lattice_does_not_resist_it(model, verdict):
    """F̄ hardly sees the jump, and no neighbours alternate. A controlled model and LPS resist it."""
    jump = 0.05 * np.sign(X[:, :1] - MIDDLE[0] - 0.1 * H) * [1.0, 0.0]
    found = pd.crack_or_instability(model, FAMILIES, prescribed(lambda t: t * jump, 0.03))
    assert found.verdict == verdict and found.bursts[0].zero_energy > 0.5  # measured 0.73 and 0.75
    assert (found.bursts[0].margin > found.soft) == (verdict == "instability first")


@pytest.mark.parametrize("poisson", [0.25, 0.49])
@pytest.mark.parametrize("N", [2.0, 3.015, 4.0])
def test_models_that_resist_all_waves_are_not_soft_whatever_their_moduli_and_horizon(N, poisson):
    """The margin of LPS at rest is 6.6 times the limit of a soft lattice, although it falls as 1/N² and with G/K."""
    model, body = pd.LPS.from_young(1.0, poisson, dim=2, plane="strain"), pd.lattice((9, 9))
    families = pd.families(body, N)
    found = pd.crack_or_instability(model, families, at_once(families, 0 * body.positions, (40, 0)))
    ratio = found.bursts[0].margin / found.soft
    assert found.verdict == "crack" and 6 < ratio < 7  # measured 6.55 to 6.82


@pytest.mark.parametrize("model, verdict", [(SVK, "instability first"), (LPS, "crack")])
def test_compression_beyond_the_critical_load_of_seth_hill_is_an_instability(model, verdict):
    """The margin is that of `stability` under the same deformation."""
    found = pd.crack_or_instability(model, FAMILIES, at_once(FAMILIES, -0.1 * X, centre()))
    exact = pd.stability(model, pd.lattice_family(2, 3.015, H), 0.9 * np.eye(2))
    assert found.verdict == verdict and (exact.verdict == "unstable") == (verdict == "instability first")
    assert found.bursts[0].margin == pytest.approx(float(exact.margin), rel=1e-12)  # measured 9e-16
    assert found.bursts[0].bonds == 1 and found.bursts[0].state == 1


def test_collapsed_matter_is_an_instability():
    u = np.where(np.linalg.norm(X - MIDDLE, axis=1, keepdims=True) < 3, -2.0, 0.0) * (X - MIDDLE) * [1.0, 0.0]
    found = pd.crack_or_instability(LPS, FAMILIES, at_once(FAMILIES, u, centre()))
    assert found.verdict == "instability first" and "collapsed" in found.bursts[0].why


def test_units_change_nothing():
    """Lengths in mm, another modulus, other times."""
    small = pd.families(pd.lattice(SHAPE, 1e-3 * H), 3.015e-3 * H)
    soft, hard = (pd.SethHill(1.0, pd.LinearElastic(m * 1.3, m * 0.7)) for m in (1.0, 1e9))
    u = lambda t: -0.06 * t * X * [0.0, 1.0] + t * OPENING  # noqa: E731
    run = prescribed(u, 0.03, every=2)
    other = Run(1e-6 * run.times, 1e-3 * run.u, 1e-6 * run.broken_at)
    found, scaled = pd.crack_or_instability(soft, FAMILIES, run), pd.crack_or_instability(hard, small, other)
    assert found.counts == scaled.counts and len(found.bursts) > 1
    for a, b in zip(found.bursts, scaled.bursts, strict=True):
        assert (a.verdict, a.bonds, a.state) == (b.verdict, b.bonds, b.state)
        assert b.margin == pytest.approx(a.margin, rel=1e-11)  # measured 1e-14
        assert b.zero_energy == pytest.approx(a.zero_energy, abs=1e-12)  # measured 3e-16
        assert np.abs(1e3 * b.place - a.place).max() < 1e-12  # measured 3e-15


def test_the_order_of_the_points_changes_nothing():
    order = np.random.default_rng(3).permutation(len(X))
    volumes = np.full(len(X), H**2)
    one, two = (pd.families(pd.cloud(X[p], volumes), 3.015 * H) for p in (np.arange(len(X)), order))
    u = OPENING + 0.005 * BOARD
    runs = (
        prescribed(lambda t: t * u, 0.03, TIMES[:17], 2, one),
        prescribed(lambda t: t * u[order], 0.03, TIMES[:17], 2, two),
    )
    found, moved = (pd.crack_or_instability(SILLING, f, run) for f, run in zip((one, two), runs, strict=True))
    assert len(found.bursts) > 2 and "approximation" in found.notes[0]
    for a, b in zip(found.bursts, moved.bursts, strict=True):
        assert (a.verdict, a.time, a.last, a.bonds, a.state) == (b.verdict, b.time, b.last, b.bonds, b.state)
        assert b.zero_energy == pytest.approx(a.zero_energy, abs=1e-12)  # measured 3e-16
        assert np.abs(a.place - b.place).max() < 1e-12
    assert np.array_equal(found.damage[order], moved.damage) and np.array_equal(found.burst_of[order], moved.burst_of)


def test_a_run_in_which_nothing_broke_says_so():
    run = prescribed(lambda t: t * OPENING, 9.0)
    found = pd.crack_or_instability(LPS, FAMILIES, run)
    assert found.verdict == "nothing broke" == str(found) and found.bursts == () and not found.damage.any()
    assert found.counts == {"crack": 0, "instability first": 0, "undecided": 0} and (found.burst_of == -1).all()


def test_bursts_are_connected_in_space_and_lie_between_two_states():
    """Two bonds far apart are two bursts, two that share an end are one, and later ones are another."""
    at = np.full(FAMILIES.weight.shape, np.inf)
    neighbours, reverse = np.asarray(FAMILIES.neighbours), np.asarray(FAMILIES.reverse)
    for t, i, slot in ((0.6, 0, 0), (0.7, 0, 1), (0.6, 153, 0), (1.2, 0, 2)):
        at[i, slot] = at[neighbours[i, slot], reverse[i, slot]] = t
    state = np.floor(np.where(np.isfinite(at), at, 0.0)).astype(int)
    found = bursts_of(FAMILIES, at, state)
    assert [(b.state, b.first, b.last, len(b.here)) for b in found] == [
        (0, 0.6, 0.7, 2),
        (0, 0.6, 0.6, 1),
        (1, 1.2, 1.2, 1),
    ]
    assert 0 in found[0].ends and len(found[0].ends) == 2 and 153 in found[1].ends


def test_coarse_states_leave_the_verdict_open_and_finer_ones_decide_it():
    for every in (16, 40):
        run = prescribed(lambda t: t**4 * OPENING, 0.03, every=every)
        coarse = pd.crack_or_instability(LPS, FAMILIES, run)
        assert coarse.verdict == "undecided" and "smaller save_every" in coarse.bursts[0].why
    fine = pd.crack_or_instability(LPS, FAMILIES, prescribed(lambda t: t**4 * OPENING, 0.03))
    assert fine.verdict == "crack" and fine.counts["undecided"] == 0


def test_a_bond_that_breaks_before_the_first_stored_state_is_undecided():
    run = at_once(FAMILIES, 0.01 * X, centre())
    early = replace(run, broken_at=np.where(np.isfinite(run.broken_at), -1.0, np.inf))
    found = pd.crack_or_instability(LPS, FAMILIES, early)
    assert found.verdict == "undecided" and "no state before it was stored" in found.bursts[0].why
    at_start = replace(run, broken_at=np.where(np.isfinite(run.broken_at), 0.0, np.inf))
    assert pd.crack_or_instability(LPS, FAMILIES, at_start).verdict == "crack"


def test_an_instability_that_has_no_time_to_grow_does_not_count():
    run = at_once(FAMILIES, -0.1 * X, centre())
    light, heavy = (pd.crack_or_instability(SVK, FAMILIES, run, density=rho) for rho in (1.0, 1e6))
    assert (
        light.verdict == "instability first"
        and heavy.verdict == "crack"
        and "no time to become unstable" in heavy.bursts[0].why
    )
    margin, speed = light.bursts[0].margin, np.sqrt(1.3 + 2 * 0.7)
    exact = np.sqrt(margin) * speed * 2 * np.sqrt(2) / H
    assert light.bursts[0].growth == pytest.approx(exact, rel=1e-12)  # measured 0
    assert heavy.bursts[0].growth == pytest.approx(1e-3 * light.bursts[0].growth, rel=1e-12)


def test_a_path_of_equilibria_is_judged_by_the_state_before_the_load_step():
    """Its state at a load factor is the one after the bonds have broken."""
    run = prescribed(lambda t: t * OPENING, 0.03)
    found = pd.crack_or_instability(LPS, FAMILIES, Path(run.times, run.u, run.broken_at))
    assert found.verdict == "crack" and found.abscissa == "load factor" and "load factor = " in str(found)
    assert all(run.times[burst.state] < burst.time and burst.step == burst.state + 1 for burst in found.bursts)


def test_a_path_with_the_state_before_the_break_is_judged_by_that_state():
    """`solve_breaking` keeps two states of a load step in which bonds break. The most strained bonds count as first."""
    u, at = 0.15 * OPENING, np.full(FAMILIES.weight.shape, np.inf)
    run = prescribed(lambda t: t * u, 0.01, times=np.array([0.0, 0.5, 1.0]))
    at[np.isfinite(run.broken_at)] = 1.0
    path = Path(np.array([0.0, 0.5, 1.0, 1.0]), np.stack([0 * u, u / 2, u, 1.1 * u]), at)
    path.settled = np.array([True, True, False, True])
    found = pd.crack_or_instability(LPS, FAMILIES, path)
    (burst,) = found.bursts
    assert (
        found.verdict == "crack" and burst.state == 2 and burst.step == 2 and burst.bonds == np.isfinite(at).sum() / 2
    )
    assert burst.margin == pytest.approx(-0.066, abs=1e-3)  # measured -0.0659, as before the break
    assert abs(burst.place[0] - MIDDLE[0]) < 0.1 * H
    path.u = path.u[[0, 0, 2, 3]]  # no rate is needed: the judged state is the one that broke the bonds
    assert pd.crack_or_instability(LPS, FAMILIES, path).verdict == "crack"
    path.settled = np.ones(4, bool)  # then the state before is the last one of a smaller load
    assert pd.crack_or_instability(LPS, FAMILIES, path).bursts[0].state == 1


def test_the_text_and_the_dictionary_tell_all():
    u = lambda t: 0.002 * X + 0.02 * t * BOARD  # noqa: E731
    found = pd.crack_or_instability(SILLING, FAMILIES, prescribed(u, 0.03))
    assert str(found).startswith("instability first: ") and f"t = {found.bursts[0].time:.6g}" in str(found)
    whole = json.loads(json.dumps(found.as_dict()))
    assert whole["verdict"] == "instability first" and len(whole["bursts"]) == len(found.bursts)
    assert sum(whole["counts"].values()) == len(found.bursts)
    assert sum(whole["bonds"].values()) == sum(b.bonds for b in found.bursts)


def test_wrong_runs_are_named():
    run = at_once(FAMILIES, 0.01 * X)
    judge = lambda run: pd.crack_or_instability(LPS, FAMILIES, run)  # noqa: E731
    with pytest.raises(ValueError, match="run must be a result of simulate"):
        judge(run.u)
    with pytest.raises(ValueError, match="no bond could break"):
        judge(replace(run, broken_at=None))
    with pytest.raises(ValueError, match="fields=True"):
        judge(replace(run, u=run.u[-1:]))
    with pytest.raises(ValueError, match="broken_at must have shape"):
        judge(replace(run, broken_at=run.broken_at[:, :1]))
    with pytest.raises(ValueError, match="increase"):
        judge(replace(run, times=run.times[::-1]))
    one_end = np.full(FAMILIES.weight.shape, np.inf)
    one_end[0, 0] = 1.0
    with pytest.raises(ValueError, match="both ends"):
        judge(replace(run, broken_at=one_end))


def test_families_of_another_body_are_named():
    run = types.SimpleNamespace(times=np.arange(2.0), u=np.zeros((2, 30, 2)), broken_at=np.full((30, 12), np.inf))
    with pytest.raises(ValueError, match="the families have 20 points and the run has 30"):
        pd.crack_or_instability(pd.LPS(1.0, 0.6), pd.families(pd.lattice((5, 4)), 2.1), run)
