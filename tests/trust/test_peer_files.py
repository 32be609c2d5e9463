"""Audits of dumps that LAMMPS has written (`benchmarks/audits.py`): a block at rest, smoothly strained, and with a
checkerboard of 40 % of the strain. peri/pmb and peri/lps, with the volumes that LAMMPS counts."""

from pathlib import Path

import numpy as np
import pytest

import pdjax as pd
from pdjax.trust import own_lattice

SAMPLES = Path(__file__).parents[1] / "files" / "samples"
SPACING, HORIZON = 0.5, 1.507
PEERS = {"pmb": (pd.BondBased(1.3), "constant"), "lps": (pd.LPS(1.3, 0.7), "inverse distance")}


@pytest.fixture(scope="module", params=list(PEERS))
def audits(request):
    """(model, families, audits of the three states of the dump). Few bins, which takes a tenth of the time."""
    model, influence = PEERS[request.param]
    points, data = pd.read_points(SAMPLES / f"lammps-{request.param}.dump", step=0)
    families = pd.families(points, HORIZON, pd.partial_volume_influence(influence, SPACING))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(own_lattice, "BINS", {3: 3})
        patch.setattr(own_lattice, "CHECKED", 3)
        found = [
            pd.audit(model, families, state.vector("displacement", 3), given_density=state.vector("force", 3))
            for state in data.states()
        ]
    return model, families, found


def test_the_dump_is_the_lattice_that_lammps_was_given(audits):
    _, families, found = audits
    assert len(found) == 3 and families.spacing == SPACING and families.shape is None
    assert np.asarray(families.volumes).tolist() == [0.125] * 80


def test_forces_are_those_of_lammps(audits):
    *_, found = audits
    for state in found:
        assert state.force_error < 3e-13  # measured 1.5e-14 and less


def test_only_the_checkerboard_is_found(audits):
    *_, (rest, smooth, perturbed) = audits
    assert rest.verdict == "trusted" and not rest.findings
    assert smooth.verdict == "trusted" and not smooth.findings
    assert perturbed.verdict == "untrusted"
    assert [f.check for f in perturbed.findings] == ["zero-energy mode"]


def test_wrong_constants_are_noticed_by_the_forces(audits):
    model, families, _ = audits
    if isinstance(model, pd.LPS):
        other = pd.LPS(1.3, 0.71)
        name = "lps"
    else:
        other, name = pd.BondBased(1.31), "pmb"
    _, data = pd.read_points(SAMPLES / f"lammps-{name}.dump", step=1)
    state = pd.audit(
        other,
        families,
        data.vector("displacement", 3),
        given_density=data.vector("force", 3),
        margins=False,
        body=False,
    )
    assert [f.check for f in state.findings] == ["forces"]
    assert 1e-3 < state.force_error < 0.02  # measured 0.008 and 0.012: the constants are wrong by 0.8 % and 1.4 %
