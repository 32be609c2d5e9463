"""The verdicts on the paper's claims follow from the stored numbers.

The stored numbers give the stored rows. If the number that decides is changed, the verdict changes. (A claim that is
not decidable from the text stays so for all numbers.)
"""

import copy
import math

import pytest
from test_paper import SAVED

from pdjax.studies import paper
from pdjax.studies.paper import results
from pdjax.studies.paper._common import OPEN, judge

KEPT = results.read(SAVED, quick=False)
CLAIMS = {claim.key: claim for claim in paper.CLAIMS}
EVERY = object()  # in a path: every entry at this level

FREE, BOTH = [False, False], ("2D, N = 3", "3D, N = 2")
EDGE, READ = "|ω| h/c at k = π/h, large u0", "ω over the symbol's, m = 1, large u0"
AFTER = "force differs after the onset by, in the mean"
ONCE = "fails at once [compression, tension]"
SPOILT = [  # key, [(path of a number, new value)], new verdict
    ("equilibrium", [("uniform", "net force", 1e-3)], "refuted"),
    ("static", [("uniform", "bracket, exact", 0.0)], "confirmed"),
    ("entry", [("formula from autodiff", 1e-3)], "refuted"),
    ("centre", [("uniform", "strain of a moved centre", 0.1)], "refuted"),
    ("strain", [("strain", "m = 0, 10 % stretch", 1e-17)], "confirmed"),
    ("silling", [("Silling", EVERY, "verdict", "stable")], "confirmed"),
    ("m_cr", [("m_cr", "2D", "exact", 0.1)], "refuted"),
    ("m_cr_3d", [("m_cr", "3D", "exact", 0.0)], "confirmed"),
    ("dTdY", [("dT dY", "3D", "exact", 0.0), ("dT dY", "3D", "printed", 0.0)], "confirmed"),
    ("a_cr_1d", [("1D diagonal", 3, -0.0752)], "refuted"),
    ("nonlocality", [("1D symbol fails at once", EVERY, False)], "confirmed"),
    ("volume", [("2D, N = 3", "bonds", 9.42)], "confirmed"),
    ("sums", [("2D, N = 3", "sum of 1/p², exact", 14.9)], "confirmed"),
    ("law", [("2D, N = 3", "I : dS/dE : I of S = κE over κ", EVERY, 4.0)], "confirmed"),
    ("factor", [("2D, N = 3", "q of the general formula", 6 * math.pi)], "confirmed"),
    ("a_cr_2d", [("2D, N = 3", "reachable", [-0.037])], "confirmed"),
    ("inequality", [("2D, N = 3", "at rest", "printed", True)], "confirmed"),
    ("hencky", [("2D, N = 3", "m = 0, by autodiff", -0.05), ("2D, N = 3", "m = 0", "printed", -0.05)], "confirmed"),
    ("dimension", [("diagonal of λ = μ = 1, N = 3", "2D", -0.0371)], "confirmed"),
    ("map_1d", [("printed diagonal from autodiff", 1e-3)], "refuted"),
    ("map_2d", [("diagonal by law", "bulk", "printed is wrong about", 0.0)], "confirmed"),
    ("map_2d", [("diagonal by law", "bulk", "corrected from autodiff", 1e-3)], "refuted"),
    ("sides_1d", [("stable in compression above m = 1/2", 5.0)], "confirmed"),
    ("slightest", [(ONCE, "m = 1", 3, FREE)], "refuted"),
    ("discretisation", [(ONCE, EVERY, EVERY, FREE)], "confirmed"),
    ("log", [(ONCE, "m = 0", {lattice: FREE for lattice in BOTH})], "confirmed"),
    ("source", [("the law itself, m = 1", -0.01)], "refuted"),
    ("stabilise", [("with Silling's penalty, m = 1", "-0.18", "unstable")], "confirmed"),
    ("switch", [("orders that bear uniaxial stress", "negative", [-2.0, -1.0])], "refuted"),
    ("bar_tension", [("m = 1, tension", 0, "kind", "saddle")], "refuted"),
    ("bar_form", [("m = 1, tension", -1, "printed from local", 1e-3)], "confirmed"),
    ("bar_compression", [("m = 1, compression", EVERY, "kind", "minimum")], "refuted"),
    ("bar_silling", [("Silling, tension", 0, "positive", 1)], "confirmed"),
    ("step_tension", [("outcomes", 0, "distance", 1.0)], "refuted"),
    ("step_size", [("outcomes", EVERY, "homogeneous", "minimum")], "confirmed"),
    ("step_region", [("own critical strain, n = 100", -0.074)], "confirmed"),
    ("cuboid", [("m = 0, tension", "onset", None)], "refuted"),
    ("cuboid_step", [("m = 0, tension, half the step", "onset", 0.06)], "refuted"),
    ("cuboid_step", [("m = 0, tension, half the step", AFTER, 0.5)], "refuted"),
    ("cuboid_fields", [("m = 0, compression", "alternation at the end", "x", 1e-6)], "confirmed"),
    ("waves_small", [("orders from the symbol, small u0", 0.1)], "refuted"),
    ("waves_zeros", [(EDGE, EVERY, 0.0)], "confirmed"),
    ("waves_zeros", [("zeros of the symbol, k h / π", [])], "refuted"),
    ("waves_edge", [("wave at the zone's edge", "at rest", "unstable")], "confirmed"),
    ("waves_edge", [("wave at the zone's edge", "λ h²/κ", "+0.01", 0.01)], "refuted"),
    ("waves_edge", [("wave at the zone's edge", "lattices from it", 24, 0.5)], "refuted"),
    ("waves_large", [(READ, EVERY, [1.0, 0.0]), ("the same, sign of u0 changed", [1.0, 0.0])], "confirmed"),
]


def numbers(figure: str):
    """The numbers of a sheet as they were before JSON turned integer keys and infinity into words."""

    def back(value):
        if isinstance(value, dict):
            return {int(key) if key.isdigit() else key: back(v) for key, v in value.items()}
        if isinstance(value, list):
            return [back(v) for v in value]
        return float(value) if value in ("inf", "-inf", "nan") else value

    return back(KEPT["figures"][figure]["numbers"])


def put(where, path, value):
    """Put a value at the end of a path, which must exist."""
    key, *rest = path
    for at in list(where if isinstance(where, dict) else range(len(where))) if key is EVERY else [key]:
        if rest:
            put(where[at], rest, value)
        else:
            assert isinstance(where, list) or at in where
            where[at] = value


@pytest.mark.parametrize("key", CLAIMS)
def test_stored_rows_follow_from_stored_numbers(key):
    kept = next(row for row in KEPT["claims"] if row["key"] == key)
    assert CLAIMS[key].row(numbers(CLAIMS[key].figure)) == kept


@pytest.mark.parametrize(("key", "changes", "verdict"), SPOILT)
def test_a_changed_number_changes_the_verdict(key, changes, verdict):
    claim = CLAIMS[key]
    before = numbers(claim.figure)
    after = copy.deepcopy(before)
    for *path, value in changes:
        put(after, path, value)
    assert after != before
    assert claim.row(after)["verdict"] == verdict != claim.row(before)["verdict"]


def test_every_decidable_claim_has_a_changed_number():
    open_ones = {row["key"] for row in KEPT["claims"] if row["verdict"] == OPEN}
    assert {key for key, *_ in SPOILT} | open_ones == set(CLAIMS)
    assert [judge(True), judge(False, True), judge(False)] == ["confirmed", "corrected", "refuted"]
