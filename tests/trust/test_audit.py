"""Verdicts of states whose faults were planted, and the arguments and results of `audit`."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from table import LINEAR, NEO_HOOKEAN

import pdjax as pd
from pdjax.trust import own_lattice

SHAPE = (12, 9)
BODY = pd.lattice(SHAPE, 0.5)
X = BODY.positions
CELLS = np.indices(SHAPE).reshape(2, -1).T
FAMILIES = pd.families(BODY, 1.51)
LEVEL = pd.BondLevel(LINEAR)
PLAIN = pd.Correspondence(LINEAR)
SMOOTH = X @ np.array([[0.01, 0.002], [0.0, -0.003]]) + 2e-4 * np.stack([X[:, 1] ** 2, X[:, 0] * X[:, 1]], axis=1)
INNER = 66  # a point in the middle
QUICK = {"margins": False, "body": False}


@pytest.fixture(autouse=True)
def few_bins(monkeypatch):
    """Twelve bins of stretches instead of 192. `test_own_lattice` judges the error of binning."""
    monkeypatch.setattr(own_lattice, "BINS", {2: 12})


def checks(state):
    return {found.check for found in state.findings}


def board(center=INNER, radius=1.1):
    """A checkerboard of amplitude 1 that is confined to a disc."""
    near = np.linalg.norm(X - X[center], axis=1) < radius
    return ((-1.0) ** CELLS.sum(axis=1) * near)[:, None] * np.array([1.0, 0.0])


def test_a_smooth_state_is_trusted_and_reports_all_its_fields():
    state = pd.audit(LEVEL, FAMILIES, SMOOTH)
    assert state.verdict == "trusted" and state.trusted and state.findings == ()
    assert state.positive == 0 and state.margin.max() < 0 and state.eigenvalue < 0
    assert set(state.fields) == {
        *("displacement", "score", "zero_energy", "non_affine", "alternation", "det_F", "shape_ratio"),
        *("margin", "critical_factor", "worst_mode"),
    }
    for name, values in state.fields.items():
        assert len(values) == len(X) and values.shape[1:] == ((2,) if name in ("displacement", "worst_mode") else ())
    assert worst(state.displacement, SMOOTH) == 0
    assert "trusted: nothing was found" in state.summary and "places nearest to a limit" in repr(state)
    # F̄ of a quadratic field is its gradient where the family is symmetric.
    H = np.array([[0.01, 0.002], [0.0, -0.003]]).T + 2e-4 * np.array([[0, 2 * X[INNER, 1]], [X[INNER, 1], X[INNER, 0]]])
    assert abs(state.det[INNER] - np.linalg.det(np.eye(2) + H)) < 1e-15  # measured 0
    whole = json.loads(json.dumps(state.as_dict()))
    assert whole["verdict"] == "trusted" and whole["time"] is None and whole["positive"] == 0
    assert whole["fields"]["det_F"]["min"] == state.det.min() and "displacement" not in whole["fields"]
    only = pd.audit(LEVEL, FAMILIES, SMOOTH, **QUICK)
    assert only.margin is None and only.positive is None and only.mode is None and "margin" not in only.fields


def test_a_local_checkerboard_turns_the_verdict_as_its_amplitude_grows():
    """Amplitudes in parts of the strain × spacing of the state. The worst point lies in the disc."""
    verdicts, shares = [], []
    for amplitude in (0.0, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0, 3.0):
        state = pd.audit(PLAIN, FAMILIES, SMOOTH + amplitude * 0.01 * 0.5 * board(), **QUICK)
        verdicts.append(state.verdict)
        shares.append(state.zero_energy[INNER])
        if amplitude >= 1:
            assert np.linalg.norm(X[state.findings[0].point] - X[INNER]) < 1.6
            assert state.findings[0].check == "zero-energy mode" and "alternate" in state.findings[0].words
    assert verdicts[:4] == ["trusted"] * 4 and verdicts[4] == "doubtful" and verdicts[-1] == "untrusted"
    assert (np.diff(shares[4:]) > 0).all() and shares[0] < 0.01  # measured 0.002, 0.01 at 0.1, 0.55 at 1


@pytest.mark.parametrize(
    ("factor", "hint"), [(-1.0, "are -1 times"), (1000.0, "are 1000 times"), (0.0, "are all zero"), (1.0001, "")]
)
def test_forces_that_are_a_multiple_of_those_of_the_model_are_told_so(factor, hint):
    f = np.asarray(pd.force_density(LEVEL, FAMILIES, SMOOTH))
    state = pd.audit(LEVEL, FAMILIES, SMOOTH, given_density=factor * f, **QUICK)
    assert hint in state.findings[0].words and ("The given forces" in state.findings[0].words) == bool(hint)


def test_wrong_forces_are_found_and_right_ones_are_not():
    f = np.asarray(pd.force_density(LEVEL, FAMILIES, SMOOTH))
    V = np.asarray(FAMILIES.volumes)[:, None]
    for right in ({"force": V * f}, {"given_density": f}):
        state = pd.audit(LEVEL, FAMILIES, SMOOTH, **right, **QUICK)
        assert state.verdict == "trusted" and state.force_error < 1e-15  # measured 0
    state = pd.audit(LEVEL, FAMILIES, SMOOTH, force=1.001 * V * f, **QUICK)
    assert state.verdict == "doubtful" and abs(state.force_error - 0.001 / 1.001) < 2e-15  # measured 8e-17
    moved = f.copy()
    moved[INNER] += np.linalg.norm(f, axis=1).max() * np.array([0.0, 0.5])
    state = pd.audit(LEVEL, FAMILIES, SMOOTH, given_density=moved, **QUICK)
    assert state.verdict == "untrusted" and "at point 66" in state.findings[0].words
    state = pd.audit(LEVEL, FAMILIES, SMOOTH, force=V * np.asarray(pd.force_density(PLAIN, FAMILIES, SMOOTH)), **QUICK)
    assert state.verdict == "untrusted" and checks(state) == {"forces"}  # the forces of another model
    # Where a code reports no force at all, the difference is told in units of force.
    state = pd.audit(LEVEL, FAMILIES, SMOOTH, given_density=0 * f, **QUICK)
    assert state.verdict == "untrusted"


def test_an_inverted_family_is_untrusted():
    """The point in the middle is reflected through its neighbours: its family collapses."""
    u = SMOOTH.copy()
    near = np.linalg.norm(X - X[INNER], axis=1) < 1.6
    u[near, 0] -= 2.2 * (X[near, 0] - X[INNER, 0])
    state = pd.audit(PLAIN, FAMILIES, u)
    assert state.verdict == "untrusted" and "collapse" in checks(state)
    assert state.det.min() < 0 and np.isnan(state.margin[state.det <= 0]).all()
    json.dumps(state.as_dict())
    other = pd.audit(pd.Correspondence(NEO_HOOKEAN), FAMILIES, u, **QUICK)  # ψ is not finite there
    assert other.verdict == "untrusted" and np.isfinite(other.zero_energy).all()


def test_a_thin_chain_of_points_is_doubtful():
    """A column of points three horizons long is joined to the plate: its shape tensors are nearly singular."""
    spike = np.stack([np.full(8, X[INNER, 0]), X[:, 1].max() + 0.5 * np.arange(1, 9)], axis=1)
    spike[:, 0] += 1e-2 * (-1.0) ** np.arange(8)
    families = pd.families(pd.cloud(np.concatenate([X, spike]), 0.25), 1.51)
    u = 0.01 * np.asarray(families.positions)
    state = pd.audit(pd.BondBased(20.0), families, u, **QUICK)
    assert state.verdict == "doubtful" and checks(state) == {"shape tensor"}
    assert state.findings[0].point >= len(X) and state.shape_ratio[-1] < 1e-3  # measured 1e-4


def test_a_compressed_plate_is_a_saddle_whose_mode_alternates():
    """SethHill m = 1 is unstable under compression: the points and the body say so alike."""
    state = pd.audit(pd.SethHill(1.0, LINEAR), FAMILIES, -0.05 * X)
    assert state.verdict == "untrusted" and checks(state) >= {"instability", "saddle"}
    exact = pd.stability(pd.SethHill(1.0, LINEAR), pd.lattice_family(2, 1.51 / 0.5, 0.5), 0.95 * np.eye(2))
    assert worst(state.margin, float(exact.margin)) < 1e-14 and exact.verdict == "unstable"  # measured 1e-17
    assert state.critical_factor.max() <= 0.1  # half of the first factor that is tried
    (words,) = (found.words for found in state.findings if found.check == "saddle")
    assert "alternates" in words and str(state.positive) in words


def test_buckling_without_supports_is_doubtful_and_with_them_untrusted():
    """A slender column under its ends' compression: the mode is smooth, and only supports tell what it means."""
    body = pd.lattice((40, 3), 0.5)
    families = pd.families(body, 1.01)
    u = body.positions * np.array([-0.05, 0.01])
    free = pd.audit(LEVEL, families, u, margins=False)
    held = np.zeros((120, 2), bool)
    ends = (body.positions[:, 0] < 1.0) | (body.positions[:, 0] > 19.0)
    held[ends, 0] = True
    held[body.positions[:, 0] < 1.0, 1] = True
    supported = pd.audit(LEVEL, families, u, held=held, margins=False)
    assert supported.positive > 0 and supported.verdict == "untrusted"
    assert "is smooth" in next(found.words for found in supported.findings if found.check == "saddle")
    assert free.positive > 0 and free.verdict == "doubtful" and "pass held=" in free.summary


def test_the_edge_of_a_rigid_clamp_is_no_zero_energy_mode():
    """The strain jumps at the clamp, also for a model without zero-energy modes. Held points are left out."""
    left = X[:, 0] < 1.5
    u = 0.02 * np.maximum(X[:, :1] - 1.5, 0) * np.array([1.0, 0.0])
    u[:, 1] = -0.3 * 0.02 * np.where(left, 0.0, X[:, 1] - X[:, 1].mean())
    blind, told = pd.audit(LEVEL, FAMILIES, u, **QUICK), pd.audit(LEVEL, FAMILIES, u, held=left, **QUICK)
    assert blind.score[left].max() > 0.7 and told.score[left].max() < 0.1  # measured 0.80 and 0.044
    beyond = X[:, 0] > 1.5 + 1.51  # families that hold no clamped point
    assert (blind.score == told.score)[beyond].all()


def test_places_are_more_than_two_horizons_apart_and_sorted():
    rough = SMOOTH + 0.02 * board(14, 0.8) + 0.01 * board(93, 0.8)
    state = pd.audit(PLAIN, FAMILIES, rough, **QUICK)
    at = np.array([place.position for place in state.places])
    assert len(at) >= 2 and worst(at, X[[place.point for place in state.places]]) == 0
    apart = np.linalg.norm(at[:, None] - at, axis=-1)[~np.eye(len(at), dtype=bool)]
    assert apart.min() > 2 * 1.51  # measured 3.6
    scores = [place.score for place in state.places]
    assert scores == sorted(scores, reverse=True) and scores[0] == state.score.max()


def test_arguments_are_checked():
    with pytest.raises(ValueError, match="held must be a bool mask"):
        pd.audit(LEVEL, FAMILIES, SMOOTH, held=np.zeros(108))
    with pytest.raises(ValueError, match="held must be a bool mask"):
        pd.audit(LEVEL, FAMILIES, SMOOTH, held=np.zeros((108, 3), bool))
    with pytest.raises(ValueError, match="not both"):
        pd.audit(LEVEL, FAMILIES, SMOOTH, force=SMOOTH, given_density=SMOOTH)
    with pytest.raises(ValueError, match=r"force must have shape \(108, 2\)"):
        pd.audit(LEVEL, FAMILIES, SMOOTH, force=SMOOTH[:5], **QUICK)
    with pytest.raises(ValueError, match="given_density"):
        pd.audit(LEVEL, FAMILIES, SMOOTH, given_density=np.nan * SMOOTH, **QUICK)
    with pytest.raises(ValueError, match="u must"):
        pd.audit(LEVEL, FAMILIES, SMOOTH[:, :1])
    with pytest.raises(ValueError, match="finite"):
        pd.audit(LEVEL, FAMILIES, np.where(CELLS == 3, np.nan, SMOOTH))


def test_a_mask_of_points_holds_all_their_components():
    left = X[:, 0] < 1.0
    one = pd.audit(LEVEL, FAMILIES, SMOOTH, held=left, margins=False)
    other = pd.audit(LEVEL, FAMILIES, SMOOTH, held=np.stack([left, left], axis=1), margins=False)
    assert one.eigenvalue == other.eigenvalue and not one.mode[left].any()


def test_the_body_at_rest_and_under_a_mean_deformation():
    """No displacement at all is trusted. F = I + H without displacement equals the displacement H X."""
    rest = pd.audit(LEVEL, FAMILIES, np.zeros_like(X))
    assert rest.verdict == "trusted" and rest.zero_energy.max() == 0 and np.isinf(rest.critical_factor).all()
    F = np.array([[1.02, 0.01], [0.0, 0.99]])
    one, other = pd.audit(LEVEL, FAMILIES, 0 * X, F=F), pd.audit(LEVEL, FAMILIES, X @ (F - np.eye(2)).T)
    assert worst(one.margin, other.margin) < 1e-14  # measured 3e-17
    assert abs(one.eigenvalue / other.eigenvalue - 1) < 2e-13  # measured 7e-15


def test_float32_has_the_verdict_of_float64():
    narrow = jax.tree.map(lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, FAMILIES)
    assert narrow.xi.dtype == np.float32
    for u in (SMOOTH, SMOOTH + 0.02 * board()):
        one = pd.audit(PLAIN, FAMILIES, u, **QUICK)
        other = pd.audit(PLAIN, narrow, jnp.asarray(u, jnp.float32), **QUICK)
        assert one.verdict == other.verdict and worst(one.zero_energy, other.zero_energy) < 3e-5  # measured 1.4e-6
