"""What the first call of each public function may compile: programs, and lines of StableHLO of all of them.

A program costs about 50 ms to compile however small it is, and a line a further millisecond or so. Both are counts, not
times, so they do not depend on the machine or on what else runs there. A call that exceeds its budget has become slower
to answer for the first time: look for JAX operations outside the one compiled function of the call
(`JAX_LOG_COMPILES=1` names every program), or for a loop that is unrolled. A call that stays far below its budget has
earned a smaller one.
"""

import json
import subprocess
import sys

import pytest

from pdjax.bench.first_calls import CALLS, MAIN, SMALL

BUDGETS = {  # name: (programs, lines); the lines are a tenth above what was counted
    "stability, 2D": (1, 1280),
    "stability, 3D": (1, 2070),
    "stability, a second model": (1, 350),
    "critical_load after stability": (1, 30),
    "critical_load": (2, 1300),
    "critical_load, diagonal": (2, 1300),
    "center_block": (1, 1280),
    "force_density, 10³ points": (2, 1740),
    "jacobian, 10³ points": (1, 1020),
    "body_stability": (1, 1060),
    "solve, 297 points in 3D": (2, 1730),
    "simulate": (2, 2370),
    "lattice_family": (0, 0),
    "families": (0, 0),
    "scene": (0, 0),
    "force_state": (1, 735),
    "model.energy": (1, 425),
    "strain_energy": (1, 525),
    "stress": (1, 545),
}


def counted(*names):
    """name → (programs, lines) of the first calls, one after the other in a fresh process."""
    command = [sys.executable, "-m", "pdjax.bench.first_calls", "--count", *names]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rows = map(json.loads, done.stdout.splitlines())
    return {row["name"]: (row["programs"], row["lines"]) for row in rows}


def test_every_call_has_a_budget():
    assert list(BUDGETS) == list(CALLS)


@pytest.mark.parametrize("names", [*((name,) for name in MAIN), tuple(SMALL)], ids=lambda names: names[0])
def test_a_first_call_compiles_no_more_than_its_budget(names):
    """The small calls share a process: a program that one has compiled is not compiled by the next."""
    found = counted(*names)
    assert list(found) == list(names)
    over = {name: (found[name], BUDGETS[name]) for name in names if any(map(int.__gt__, found[name], BUDGETS[name]))}
    assert not over, f"(programs, lines of StableHLO) found, and their budget: {over}"
