"""Audits of the states of a run."""

import json

import numpy as np
import pytest
from table import LINEAR

import pdjax as pd

SHAPE = (9, 7)
FAMILIES = pd.families(pd.lattice(SHAPE, 0.5), 1.01)
X = np.asarray(FAMILIES.positions)
MODEL = pd.Correspondence(LINEAR)
BOARD = (-1.0) ** np.indices(SHAPE).reshape(2, -1).sum(axis=0)[:, None] * np.array([1.0, -1.0])
STATES = [0.01 * X + amplitude * BOARD for amplitude in (0.0, 1e-5, 0.01, 1e-5, 0.02)]
QUIET = {"show_progress": False, "margins": False}


def test_the_first_untrusted_state_is_found_and_audited():
    seen = []
    run = pd.audit_states(MODEL, FAMILIES, STATES, times=[0.0, 0.5, 1.0, 1.5, 2.0], each=seen.append, **QUIET)
    assert run.first == 2 and run.doubtful == 2 and run.verdict == "untrusted"
    assert [state.verdict for state in seen] == ["trusted", "trusted", "untrusted", "trusted", "untrusted"]
    assert run.first_audit is seen[2] and run.last_audit is seen[4] and seen[2].time == 1.0
    assert run.first_audit.positive is not None and run.last_audit.positive is not None and seen[0].positive is None
    for number, state in enumerate(seen):
        alone = pd.audit(MODEL, FAMILIES, STATES[number], margins=False, body=False)
        assert np.array_equal(alone.score, state.score) and run.scores[number].max() == alone.score.max()
    assert "first untrusted state: 2, t = 1, by zero-energy mode" in run.summary
    whole = json.loads(json.dumps(run.as_dict()))
    assert whole["first"] == 2 and whole["times"][-1] == 2.0 and len(whole["scores"]["collapse"]) == 5


def test_trusted_states_have_no_first_one():
    run = pd.audit_states(MODEL, FAMILIES, iter(STATES[:2]), body=False, **QUIET)
    assert run.verdict == "trusted" and run.first is None and run.doubtful is None and run.first_audit is None
    assert run.times.tolist() == [0.0, 1.0] and run.as_dict()["first_audit"] is None


def test_states_are_checked():
    with pytest.raises(ValueError, match="at least one"):
        pd.audit_states(MODEL, FAMILIES, [], **QUIET)
    with pytest.raises(ValueError, match=r"have the shape \(states, points, dim\); got shape \(63, 2\)"):
        pd.audit_states(MODEL, FAMILIES, STATES[0], **QUIET)
    with pytest.raises(ValueError, match=r"got float\. Of a result of solve or equilibrium_path, pass its u"):
        pd.audit_states(MODEL, FAMILIES, 1.0, **QUIET)
    with pytest.raises(ValueError, match="one entry for each of the 5 states"):
        pd.audit_states(MODEL, FAMILIES, STATES, times=[0.0, 1.0], **QUIET)
    with pytest.raises(ValueError, match="u must"):
        pd.audit_states(MODEL, FAMILIES, [STATES[0], STATES[1][:, :1]], body=False, **QUIET)
