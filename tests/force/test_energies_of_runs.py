"""The energies that runs record by sums over bonds equal those of the general path, `energy_of_each`."""

import bodies
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.force.fields import energy_of_each
from pdjax.force.operator import fast_energies

pytest.importorskip("llvmlite")

POINTS = bodies.random(21).uniform(-0.1, 0.1, size=(35, 2)) + pd.lattice((7, 5), 0.5).positions
BODIES = {
    "lattice": pd.families(pd.lattice((7, 5), 0.5, mask=np.arange(35).reshape(7, 5) != 17), 1.01),
    "periodic": pd.families(pd.lattice((7, 6), 0.5, periodic=(True, False)), 1.01),
    "cloud": pd.families(pd.cloud(POINTS, bodies.random(22).uniform(0.2, 0.3, 35)), 1.01),
}
BY_SUMS = [
    "seth_hill m=0",
    "seth_hill user law",
    "correspondence neo-hookean",
    "bond_based m=-0.3",
    "bond_based",
    "lps",
]


@pytest.mark.parametrize("name", BY_SUMS)
@pytest.mark.parametrize("body", BODIES)
def test_energies_by_sums_over_bonds_are_those_of_the_families(name, body):
    model, families = table.MODELS[name], BODIES[body]
    u = 0.02 * jnp.asarray(bodies.random(23).normal(size=(len(families), 2)))
    operator = pd.force_operator(model, families, "compiled")
    for F in (None, jnp.asarray([[1.02, 0.03], [0.0, 0.97]])):
        found, expected = fast_energies(operator, u, F), energy_of_each(model, families, u, F)
        assert float(jnp.abs(found - expected).max() / expected.max()) < 1e-13  # measured: 2e-15


def test_models_with_a_control_have_no_energy_by_sums():
    operator = pd.force_operator(table.MODELS["silling control"], BODIES["lattice"], "compiled")
    assert fast_energies(operator, jnp.zeros((34, 2)), None) is None


def test_a_run_records_the_same_energies_with_every_backend(monkeypatch):
    """The backend of small bodies has no sums of energies, so its run takes the general path."""
    body = pd.lattice((6, 5), 0.5)
    start = 0.01 * bodies.random(24).normal(size=(30, 2))
    found = {}
    for small, way in ((10_000, "families"), (0, "compiled")):
        monkeypatch.setattr("pdjax.force.backends.padded.SMALL", small)
        motion = pd.motion(pd.scene(body, pd.families(body, 1.01), table.MODELS["lps"], moving=True), start=start)
        assert motion.prepared().scene.operator.way == way
        found[way] = pd.simulate(motion, dt=0.02, duration=0.2).energies.strain
    np.testing.assert_allclose(found["compiled"], found["families"], rtol=1e-14)  # measured: 4e-16
