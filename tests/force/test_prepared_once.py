"""Everything that depends on model and families alone is checked and prepared once, also inside a user's jit."""

import bodies
import equinox as eqx
import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.force import operator as evaluate
from pdjax.force import shape_tensors
from pdjax.force.backends import streamed
from pdjax.force.fields import whole_force

COMPILED = []
jax.monitoring.register_event_duration_secs_listener(
    lambda name, seconds, **_: COMPILED.append(name) if name.endswith("backend_compile_duration") else None
)


def programs(call):
    """The number of programs that a call compiles or loads from a cache folder."""
    COMPILED.clear()
    jax.block_until_ready(call())
    return len(COMPILED)


@pytest.fixture
def counted(monkeypatch):
    """The names of the functions that check and prepare, one for each call."""
    seen = []
    for module, name in ((shape_tensors, "_refuse"), (evaluate, "_backend")):
        real = getattr(module, name)

        def spy(*args, name=name, real=real):
            seen.append(name)
            return real(*args)

        monkeypatch.setattr(module, name, spy)
    return seen


BODY = pd.lattice((7, 5), 0.5)
U = 0.02 * bodies.random(1).normal(size=BODY.positions.shape)


def silling(mu=0.7):
    return pd.Correspondence(pd.LinearElastic(1.3, mu), pd.SillingControl(0.5))


@pytest.mark.parametrize("way", ["families", "slices", "fft"])
def test_a_second_call_with_a_model_made_anew_checks_prepares_and_compiles_nothing(way, counted, monkeypatch):
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 0)
    fams = pd.families(BODY, 1.01)
    first = pd.force_density(silling(), fams, U, way=way)
    assert counted == ["_refuse", "_backend"]
    assert programs(lambda: pd.force_density(silling(), fams, U, way=way)) == 0
    model = silling()
    closed = jax.jit(lambda u: pd.force_density(model, fams, u, way=way))
    slope = jax.grad(lambda u: jnp.sum(pd.force_density(silling(), fams, u, way=way) ** 2))
    assert np.allclose(closed(U), first, rtol=0, atol=1e-14) and np.isfinite(slope(jnp.asarray(U))).all()
    assert counted == ["_refuse", "_backend"]


def test_the_shape_tensors_of_the_bonds_are_shared_by_models_and_constants(counted):
    fams = pd.families(BODY, 1.01)
    models = [silling(0.7), silling(0.8), pd.graded(silling(), 2.0), pd.BondLevel(table.NEO_HOOKEAN)]
    for model in models:  # all need K
        pd.force_density(model, fams, U)
    assert counted.count("_refuse") == 1
    pd.force_density(pd.SethHill(1.0, table.LINEAR), fams, U)  # L
    assert counted.count("_refuse") == 2
    for r, checks in ((0.8, 3), (0.8, 3), (0.9, 4)):  # the tensors of bonds' own families depend on r, not on the law
        pd.strain_energy(pd.BondAssociated(pd.LinearElastic(1.0, r + checks), r), fams, U)
        assert counted.count("_refuse") == checks


def test_reference_sums_are_prepared_for_the_constants_that_they_read(monkeypatch):
    """Other constants may differ or be traced: a gradient with respect to them computes no reference sums."""
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 0)
    seen, real = [], streamed._reference
    monkeypatch.setattr(streamed, "_reference", lambda *args: seen.append(1) or real(*args))
    fams = pd.families(BODY, 1.01)

    def total(mu):
        return jnp.sum(pd.force_density(silling(mu), fams, U, way="slices") ** 2)

    for mu in (0.7, 0.8):
        slope = jax.grad(total)(mu)
        assert abs(slope - (total(mu + 1e-5) - total(mu - 1e-5)) / 2e-5) < 1e-7 * abs(slope)  # measured: 2e-10
    assert len(seen) == 1


def test_changed_families_and_models_are_checked_anew():
    """New weights leave the bonds of a point in one direction, and a smaller r leaves too few bonds in sub-families."""
    fams = pd.families(BODY, 1.01)
    pd.force_density(silling(), fams, U)
    weight = np.array(fams.weight)
    weight[3] = weight[3] * (np.abs(np.asarray(fams.xi[3, :, 1])) < 0.1)
    for changed in (eqx.tree_at(lambda f: f.weight, fams, jnp.asarray(weight)), fams.with_weight(weight)):
        for _ in range(2):
            with pytest.raises(ValueError, match="the family of point 3 "):
                pd.force_density(silling(), changed, U)
    model = pd.BondAssociated(table.NEO_HOOKEAN, 0.9)
    pd.strain_energy(model, fams, U)
    with pytest.raises(ValueError, match="every bond's own family"):
        pd.strain_energy(eqx.tree_at(lambda m: m.r, model, jnp.asarray(0.1)), fams, U)


def test_a_model_with_another_constant_gives_its_own_force():
    fams = pd.families(BODY, 1.01)
    for mu in (0.7, 0.8, 0.7):
        expected = whole_force(silling(mu), fams, fams.bonds(jnp.asarray(U)))
        assert bodies.worst(pd.force_density(silling(mu), fams, U, way="fft"), expected) < 1e-14


def test_an_operator_can_be_jitted_and_rematerialised():
    operator = pd.force_operator(silling(), pd.families(BODY, 1.01))
    expected = operator(U)
    assert np.allclose(jax.jit(operator)(U), expected, rtol=0, atol=1e-14)
    assert np.allclose(jax.checkpoint(operator)(jnp.asarray(U)), expected, rtol=0, atol=1e-14)
    assert operator == operator and operator != pd.force_operator(silling(), operator.families)


@pytest.mark.parametrize("name", ["correspondence svk", "seth_hill m=1", "bond_level average"])
def test_public_functions_are_one_program(name):
    model, fams, fam = table.MODELS[name], pd.families(BODY, 1.03), pd.lattice_family(2, 3, 0.7)
    F, v = np.array([[1.03, 0.01], [0.02, 0.98]]), 2 * U
    bonds = fam.bonds(jax.device_put(F))
    calls = {
        "force_density": lambda: pd.force_density(model, fams, U),
        "force_state": lambda: pd.force_state(model, fam, F),
        "piola_stress": lambda: pd.piola_stress(model, fam, F),
        "strain_energy": lambda: pd.strain_energy(model, fams, U),
        "strain": lambda: pd.strain(model, fams, U),
        "stress": lambda: pd.stress(model, fams, U),
        "jvp": lambda: pd.jvp(model, fams, U, v),
        "jacobian": lambda: pd.jacobian(model, fams, U).data,
        "energy": lambda: model.energy(bonds),
        "method": lambda: model.force_state(bonds),
    }
    jax.clear_caches()
    assert {key: programs(call) for key, call in calls.items()} == dict.fromkeys(calls, 1)
    assert {key: programs(call) for key, call in calls.items()} == dict.fromkeys(calls, 0)
