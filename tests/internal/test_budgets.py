"""Budgets of the first call of each public function: the number of compiled programs and their lines of StableHLO.

A program takes about 50 ms to compile however small it is, and each line takes about one millisecond more. Both are
counts, not times, so they do not depend on the machine or on its load. The first call of a function that exceeds its
budget has become slower. The cause may be a JAX operation outside the one compiled function of the call
(`JAX_LOG_COMPILES=1` names every program), or an unrolled loop. Reduce the budget of a call that stays far below it.
"""

import json
import subprocess
import sys

import pytest

from pdjax.bench.first_calls import CALLS, MAIN, SMALL

BUDGETS = {  # name: (programs, lines); the numbers of lines are a tenth larger than those counted
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
    """name → (programs, lines) of the first calls, which run one after the other in a new process."""
    command = [sys.executable, "-m", "pdjax.bench.first_calls", "--count", *names]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    rows = map(json.loads, done.stdout.splitlines())
    return {row["name"]: (row["programs"], row["lines"]) for row in rows}


def test_every_call_has_a_budget():
    assert list(BUDGETS) == list(CALLS)


@pytest.mark.parametrize("names", [*((name,) for name in MAIN), tuple(SMALL)], ids=lambda names: names[0])
def test_a_first_call_compiles_no_more_than_its_budget(names):
    """The small calls share a process. A program that one of them has compiled is not compiled again by the next."""
    found = counted(*names)
    assert list(found) == list(names)
    over = {name: (found[name], BUDGETS[name]) for name in names if any(map(int.__gt__, found[name], BUDGETS[name]))}
    assert not over, f"(programs, lines of StableHLO) found, and their budget: {over}"
