"""Setting up a problem compiles no program, because geometry, conditions, models, scenes and motions use NumPy.

Every JAX operation outside a compiled program compiles its own program, which takes about 50 ms. These tests count
compilations, so they do not depend on the speed of the machine.
"""

from contextlib import contextmanager
from functools import partial

import jax
import jax.monitoring
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax._internal.checks import as_array, as_real, check_positive, deformation_gradient, require
from pdjax.finite_body.dynamics.system import check_schedule
from pdjax.force.fields import check_model
from pdjax.geometry.bonds import Bonds
from pdjax.infinite_lattice.cells import cell_families

COMPILED = [0]


def _count(name, seconds, **_):
    COMPILED[0] += name == "/jax/core/compile/backend_compile_duration"


jax.monitoring.register_event_duration_secs_listener(_count)


@contextmanager
def programs(*checked):
    """Count the programs compiled inside the context, in a list with one entry.

    The context starts with an empty cache. The programs that check SPRINGS on the given families are compiled before
    the count starts, because they belong to the model.
    """
    jax.clear_caches()
    for fams in checked:
        check_model(SPRINGS, fams, pd.Families)
    before, found = COMPILED[0], [0]
    yield found
    found[0] = COMPILED[0] - before


LAW = {"lam": 1.0, "mu": 0.7}
SPRINGS = pd.BondBased(1.3)
PLATE = pd.lattice((5, 4), 0.5)
CLOUD = pd.cloud(np.random.default_rng(0).uniform(0, 3, (20, 2)), np.linspace(1, 2, 20))
FAMILIES = pd.families(PLATE, 1.0)
FAMILY = pd.lattice_family(2, 3)
TORUS = pd.lattice((7, 6), periodic=True)
MASK = np.arange(20).reshape(5, 4) != 7


def scene(*conditions, **more):
    return pd.scene(PLATE, FAMILIES, SPRINGS, pd.prescribe([0, 1, 2, 3], [0.0, 0.1]), *conditions, **more)


SETUP = {
    "lattice_family": lambda: pd.lattice_family(3, 2, 0.25),
    "lattice_family, spacing of an array": lambda: pd.lattice_family(2, 2, jax.device_put(np.float64(0.25))),
    "lattice_family, influences": lambda: [
        pd.lattice_family(2, 2, 0.25, influence)
        for influence in (
            pd.inverse_distance_influence,
            pd.linear_influence,
            pd.cubic_spline_influence,
            pd.gaussian_influence,
            partial(pd.gaussian_influence, width=0.3),
            pd.partial_volume_influence(pd.constant_influence, 0.25),
            lambda r, delta: (r / delta) ** 2 + 0.5,
        )
    ],
    "lattice_family, with_weight": lambda: FAMILY.with_weight(np.full(28, 0.5)),
    "bonds of a family": lambda: FAMILY.bonds(0.9 * np.eye(2)),
    "lattice": lambda: (pd.lattice((5, 4), 0.5, periodic=True), pd.lattice((5, 4), mask=MASK)),
    "bar, plate, cuboid": lambda: (pd.bar(5), pd.plate((2.0, 1.0), 0.5), pd.cuboid((1.0, 1.0, 2.0), 0.5)),
    "cloud": lambda: pd.cloud([[0.0, 0.0], [1.0, 0.0]], 1.0),
    "families of a lattice": lambda: pd.families(PLATE, 1.0, pd.gaussian_influence),
    "families of a part of a lattice": lambda: pd.families(pd.lattice((5, 4), mask=MASK), 2.0),
    "families without arrays": lambda: pd.families(PLATE, 1.0, arrays=False),
    "families of a cloud": lambda: pd.families(CLOUD, 2.0, pd.linear_influence),
    "families of a cell": lambda: cell_families(pd.lattice((2, 3), periodic=True), 3.0),
    "families, with_weight": lambda: FAMILIES.with_weight(np.full(FAMILIES.weight.shape, 0.5)),
    "bonds of a body": lambda: FAMILIES.bonds(np.zeros((20, 2)), 0.9 * np.eye(2)),
    "laws": lambda: (
        pd.LinearElastic(1, 0.7),
        pd.NeoHookean(1.0, np.float64(0.7)),
        pd.EnergyLaw(lambda E, c: c * jnp.sum(E * E), "E", (0.5, [1, 2])),
    ),
    "models": lambda: (
        pd.SethHill(0.5, pd.LinearElastic(**LAW), pd.WanControl()),
        pd.Correspondence(pd.NeoHookean(**LAW), pd.SillingControl(1)),
        pd.Correspondence(pd.NeoHookean(**LAW), pd.LittlewoodControl(0.1)),
        pd.BondAssociated(pd.LinearElastic(**LAW), 0.7),
        pd.LPS(1.0, [0.5] * 20),
        pd.BondBased(1, 2),
    ),
    "elastic constants": lambda: (
        pd.LPS.from_young(1.0, 0.2),
        pd.LPS.from_young(1.0, 0.2, 2, "stress"),
        pd.BondBased.from_bulk(1.0, 3.0, 2, "strain"),
        pd.BondBased.from_young(1.0, 0.25, 3.0),
        pd.BondBased.from_family(1.0, FAMILY),
        pd.plane_bulk_modulus(1.0, 0.5, "stress"),
    ),
    "catalogue": lambda: [make(pd.LinearElastic(**LAW), FAMILY) for make in pd.CATALOGUE.values()],
    "graded": lambda: pd.graded(pd.BondBased(1.0), np.linspace(1, 2, 20)),
    "linearised": lambda: pd.linearised(pd.Correspondence(pd.LinearElastic(**LAW)), [[0.9, 0.1], [0.0, 1.0]]),
    "checks": lambda: (
        deformation_gradient([[1, 0], [0, 1]], 2),
        check_positive("c", as_real(1)),
        as_real([1, 2]),
        as_array([1, 2]),
        require(np.ones(3), np.ones(3, bool), "never"),
    ),
    "conditions": lambda: (
        pd.prescribe([0, 1], [0.0, 0.1]),
        pd.prescribe(np.arange(20) < 3, 0, components=1),
        pd.body_force([4, 5], [[0.1, 0.2], [0.3, 0.4]]),
        pd.total_force([4, 5], (1.0, 2.0)),
        pd.homogeneous_traction([4, 5], 0.9 * np.eye(2)),
    ),
}

SCENES = {
    "scene": (
        lambda: scene(
            pd.total_force([18, 19], [1.0, 2.0]), pd.body_force([9], [0.1, 0]), closed_form=np.zeros((20, 2))
        ),
        FAMILIES,
    ),
    "periodic scene": (
        lambda: pd.scene(TORUS, pd.families(TORUS, 2.0), SPRINGS, pd.prescribe([0], 0.0), mean=0.9 * np.eye(2)),
        pd.families(TORUS, 2.0),
    ),
    "motion": (
        lambda: pd.motion(scene(), 2, damping=1, schedule=pd.Ramp(10), velocity=np.ones((20, 2), int)),
        FAMILIES,
    ),
    "motion of many schedules": (
        lambda: [
            check_schedule(pd.motion(scene(), np.linspace(1, 2, 20), schedule=schedule), np.linspace(0, 20, 11))
            for schedule in (None, pd.Hold(), pd.Ramp(10.0), pd.SmoothRamp(10.0))
        ],
        FAMILIES,
    ),
    "step_size_bar": (lambda: pd.scenes.step_size_bar(33, model=SPRINGS), pd.families(pd.bar(33), 3 / 33)),
    "clamped_plate": (
        lambda: pd.scenes.clamped_plate((7, 6), 1, 0.9 * np.eye(2), SPRINGS),
        pd.families(pd.lattice((7, 6), 1 / 7), 1 / 7),
    ),
}


@pytest.mark.parametrize("name", SETUP)
def test_setting_up_compiles_nothing(name):
    with programs() as found:
        SETUP[name]()
    assert found == [0]


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_compiles_nothing_beside_the_check_of_its_model(name):
    build, checked = SCENES[name]
    with programs(checked) as found:
        build()
    assert found == [0]


def test_a_user_schedule_compiles_one_program():
    made = scene()
    with programs() as found:
        pd.motion(made, schedule=lambda t: jnp.sin(t) ** 2)
    assert found == [1]


CLASSICAL = pd.Correspondence(pd.LinearElastic(1.0, 1.0))


@pytest.mark.parametrize(
    "build, model, fams",
    [
        (
            lambda: pd.scenes.singular_bar(18, 2, model=CLASSICAL, traction="even"),
            pd.graded(CLASSICAL, np.ones(18)),
            pd.families(pd.bar(18), 2 / 18),
        ),
        (
            lambda: pd.scenes.manufactured_plate(11, 2, model=CLASSICAL),
            CLASSICAL,
            pd.families(pd.lattice((11, 11), 1 / 11), 2 / 11),
        ),
    ],
)
def test_a_closed_form_compiles_one_program(build, model, fams):
    with programs() as check:
        check_model(model, fams, pd.Families)
    with programs() as found:
        build()
    assert found[0] <= check[0] + 1


# ---------------------------------------------------------------- the same numbers under a transformation


def same(found, traced):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(traced), strict=True):
        assert (a.dtype, a.shape) == (b.dtype, b.shape)
        np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-15)  # 2e-16


@pytest.mark.parametrize("influence", [pd.gaussian_influence, pd.cubic_spline_influence, lambda r, d: jnp.exp(-r / d)])
def test_a_lattice_family_equals_that_of_a_traced_spacing(influence):
    def build(spacing):
        fam = pd.lattice_family(3, 2, spacing, pd.partial_volume_influence(influence, spacing))
        return fam, fam.bonds(0.9 * jnp.eye(3))

    same(build(0.3), jax.jit(build)(0.3))


def test_bonds_of_a_body_equal_those_under_jit():
    u, F = np.random.default_rng(1).normal(size=(20, 2)), np.array([[0.9, 0.1], [0.0, 1.1]])
    fams = FAMILIES.with_weight(np.full(FAMILIES.weight.shape, 0.5))
    found = fams.bonds(jnp.asarray(u), jnp.asarray(F))
    assert isinstance(found, Bonds)
    same(found, jax.jit(lambda u, F: fams.bonds(u, F))(u, F))


@pytest.mark.parametrize("schedule", [pd.Hold(), pd.Ramp(10.0), pd.SmoothRamp(10.0)])
def test_factor_and_rate_of_a_schedule_are_its_value_and_derivative(schedule):
    made = pd.motion(scene(), schedule=schedule)
    for t in (0.0, 3.0, 12.0):
        same(made.factor(t), jax.jit(lambda t: made.factor(t))(t))


def test_a_subclass_of_ramp_uses_its_own_value():
    class Half(pd.Ramp):
        def __call__(self, t):
            return 0.5 * super().__call__(t)

    factor, rate = pd.motion(scene(), schedule=Half(10.0)).factor(4.0)
    assert (float(factor), float(rate)) == (0.2, 0.05)


def test_arrays_given_by_a_user_are_copied():
    u, weight, constant = np.ones((2048, 2)), np.ones(28), np.ones(4096)
    kept = pd.prescribe(np.arange(2048), u), FAMILY.with_weight(weight), as_real(constant), as_array(constant)
    for array in (u, weight, constant):
        array[:] = 0.0
    assert all(np.all(np.asarray(x) == 1) for x in (kept[0].u, kept[1].weight, kept[2], kept[3]))


def test_a_python_number_keeps_its_weak_type():
    """A weakly typed number adopts the precision of arrays. Whole numbers and NumPy numbers have a fixed one."""
    assert as_real(1.0).weak_type and not as_real(1).weak_type and not as_real(np.float64(1.0)).weak_type
    assert pd.LPS.from_young(1.0, 0.2).shear.weak_type
    assert not pd.LPS.from_young(np.float64(1.0), 0.2).shear.weak_type
    assert pd.BondBased.from_bulk(1.0, np.float32(3.0)).c.dtype == jnp.float32


@pytest.mark.parametrize("value", [None, [1.0, None], "no number"])
def test_values_that_are_no_numbers_are_refused(value):
    for convert in (as_real, as_array):
        with pytest.raises((TypeError, ValueError)):
            convert(value)
