"""Many devices give the results of one: on four devices that XLA simulates on the host, and in two processes.

The checks are in `on_devices.py`, because the number of devices is fixed when JAX starts. The reference is the general
path (all bonds at once, on one device) or NumPy.
"""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("on_devices.py")


def started(*arguments, devices=1):
    flags = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count={devices}"
    root = [str(SCRIPT.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    env = {**os.environ, "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu", "PYTHONPATH": os.pathsep.join(root)}
    command = [sys.executable, str(SCRIPT), *map(str, arguments)]
    return subprocess.Popen(command, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def finished(process):
    try:
        out, errors = process.communicate(timeout=300)
    finally:
        process.kill()
    assert process.returncode == 0, errors
    return json.loads(out.splitlines()[-1])


@pytest.fixture(scope="module")
def found():
    return finished(started(devices=4))


def test_forces_of_slabs_are_those_of_the_body(found):
    assert found["devices"] == 4
    assert len(found["forces"]) == 4
    for name, error in found["forces"].items():
        assert error < 1e-13, name  # measured: 4e-16


def test_a_force_costs_one_exchange_with_each_neighbour(found):
    counts = found["collectives"]
    assert counts == {"collective-permute": 2, "all-gather": 0, "all-reduce": 0, "all-to-all": 0}


def test_derivatives_dynamics_and_statics_of_slabs(found):
    assert found["gradient"] < 1e-12  # measured: 5e-16, to the displacement and to a constant of the law
    assert found["verlet"] < 1e-12  # measured: 6e-16 after 50 steps
    assert found["verlet stays sharded"]
    assert found["moved"] > 0.1
    assert found["residual"] < 1e-7  # measured: 5e-10 of the load; the inner solver stops at 1e-10


def test_batches_are_divided_over_the_devices_and_give_the_same_results(found):
    sweeps = found["sweeps"]
    assert sweeps["map"] < 1e-13  # measured: 0
    assert sweeps["eigenvalues"] < 1e-13  # measured: 3e-16
    assert sweeps["shares"] == [2]  # of 7 states on 4 devices


def test_errors_say_which_meshes_work(found):
    messages = found["refusals"]
    assert len(messages) == 10
    assert (
        "18 planes, which 4 devices cannot share equally; numbers of devices that work: 1, 2, 3"
        in (messages["not equal"])
    )
    assert "slabs of 3 planes (12 over 4 devices) are thinner than the 4 planes" in messages["thin"]
    assert messages["thin"].endswith("that work: 1, 2, 3")
    assert messages["nobody"].endswith("that work: 1")
    assert "got a masked lattice" in messages["mask"] and "got families of a cloud" in messages["cloud"]
    assert "BondLevelAverage has none" in messages["no moments"]
    assert "must be a jax.sharding.Mesh with an axis" in messages["no mesh"] and "got str" in messages["no mesh"]
    assert "(points, dim) = (64, 2); got (64, 3)" in messages["shape"] and "u must be finite" in messages["nan"]
    assert "one length >= 1; got [(2,), (3,)]" in messages["lengths"]


def test_two_processes_give_the_results_of_one():
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    pair = [started(rank, port) for rank in (0, 1)]
    for one in map(finished, pair):
        assert one["devices"] == 2 and one["own points"] == 40
        assert one["force"] < 1e-13  # measured: 5e-16
        assert one["doubled"] == [0, 2, 4]
