"""Models of the user: their constants are arrays, and errors in them are explained."""

import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd

PLANE = pd.lattice_family(2, 2)


class Springs(pd.AbstractModel):
    stiffness: float
    softening: float = 0.0
    power: int = 2
    label: float = eqx.field(static=True, default=1.5)

    def energy(self, bonds):
        e = jnp.expm1(pd.log_stretch(bonds.xi, bonds.eta))
        return jnp.sum(bonds.omega * bonds.volume * self.stiffness * (e**self.power - self.softening * e**3))


class Unfinished(pd.AbstractModel):
    k: float


class Eta(Springs):
    def energy(self, bonds):
        return jnp.sum(jnp.linalg.norm(bonds.eta, axis=1))  # not differentiable at rest


class PerBond(Springs):
    def energy(self, bonds):
        return jnp.sum(bonds.eta**2, axis=1)


def test_floats_become_arrays_and_nothing_else_does():
    model = Springs(1.0, 0.5)
    assert isinstance(model.stiffness, jax.Array) and float(model.softening) == 0.5
    assert model.power == 2 and isinstance(model.power, int)
    assert model.label == 1.5 and isinstance(model.label, float)


def test_another_value_is_not_traced_again():
    traces = []

    @eqx.filter_jit
    def margin(model):
        traces.append(1)
        return jnp.sum(pd.force_state(model, PLANE, 1.05 * jnp.eye(2)) ** 2)

    values = [float(margin(Springs(1.0, b))) for b in (0.1, 0.2, 0.3)]
    assert len(set(values)) == 3 and len(traces) == 1


def test_critical_load_of_a_field_has_a_derivative():
    load = lambda model: pd.critical_load(model, PLANE, criterion="affine", side="positive")  # noqa: E731
    slope = eqx.filter_grad(load)(Springs(1.0, 2.0))  # filter_grad differentiates arrays only, not Python floats
    central = float(load(Springs(1.0, 2.0 + 1e-4)) - load(Springs(1.0, 2.0 - 1e-4))) / 2e-4
    assert abs(float(slope.softening) / central - 1) < 1e-6
    assert abs(float(slope.stiffness)) < 1e-12  # a common factor does not change a critical load


def test_fields_of_a_user_law_become_arrays():
    class Own(pd.Law):
        k: float
        takes = "E"
        isotropic = True

        def energy(self, tensor):
            return self.k * jnp.sum(tensor**2)

    assert isinstance(Own(1.5).k, jax.Array) and isinstance(pd.SethHill(1.0, Own(1.5)).law.k, jax.Array)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda: pd.stability(Unfinished(1.0), PLANE, np.eye(2)), NotImplementedError, "Unfinished defines no energy"),
        (lambda: pd.stability(Eta(1.0), PLANE, np.eye(2)), ValueError, r"eta =\s+u_j − u_i; the deformed bond"),
        (lambda: pd.stability(PerBond(1.0), PLANE, np.eye(2)), ValueError, r"one number.*got shape \(12,\)"),
        (lambda: pd.stability(Springs(float("nan")), PLANE, np.eye(2)), ValueError, "every constant is finite"),
        (lambda: pd.model_atlas(["Seth-Hill 7"]), ValueError, "'Seth–Hill ½'"),
    ],
)
def test_errors_of_user_models_say_what_is_wrong(call, error, words):
    with pytest.raises(error, match=words):
        call()


def test_errors_distinguish_a_lattice_family_from_families_of_a_body():
    """It runs in another process, because the tests check types before the package does."""
    code = """
import numpy as np, pdjax as pd
model, one = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), pd.lattice_family(2, 2)
all = pd.families(pd.lattice((5, 5)), 2.0)
calls = [lambda f=f: f(model, all, np.eye(2)) for f in (pd.stability, pd.force_state, pd.center_block)]
calls += [lambda f=f: f(model, one, np.zeros((4, 2))) for f in (pd.force_density, pd.jacobian, pd.strain)]
for call in calls:
    try:
        call()
    except ValueError as error:
        print(error)
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert said.count("for an infinite lattice and needs a LatticeFamily, from pd.lattice_family") == 3
    assert said.count("for a body and needs Families, from pd.families") == 3


@pytest.mark.parametrize(
    ("typed", "name"),
    [
        ("seth-hill 1", "Seth–Hill 1"),
        ("Seth-Hill -1", "Seth–Hill −1"),
        ("SETH–HILL 0.5", "Seth–Hill ½"),
    ],
)
def test_names_of_models_can_be_typed_in_ascii(typed, name):
    assert pd.models.catalogue.model_name(typed) == name


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_continuum_is_marginal_at_the_order_where_gamma_vanishes(dim, law):
    """Terms of the size of the stress cancel there, and the rounding that remains must not be taken for a load."""
    fam, model = pd.lattice_family(dim, 2), pd.SethHill(1 - dim / 2, law)
    for side in ("negative", "positive"):
        assert np.isinf(pd.critical_load(model, fam, pd.hydrostatic, "continuum", side))
    for a in (-0.95, -0.5, 0.5):
        assert pd.stability(model, fam, (1 + a) * np.eye(dim), "continuum").verdict == "marginal"
    assert pd.stability(pd.SethHill(1.1 - dim / 2, law), fam, 0.5 * np.eye(dim), "continuum").verdict == "unstable"


def test_a_map_names_its_parameter():
    grid = pd.stability_map([0.0, 0.5], [-0.1, 0.1], N=2, model=lambda b: Springs(1.0, b), show_progress=False)
    assert pd.figures.stability_map(grid).axes[0].get_xlabel() == "b of Springs"


def test_a_declared_array_is_shared_by_a_body_of_as_many_points():
    """A body of four points must not take a shared constant of four entries for one number for each point."""
    body = pd.lattice((2, 2))
    families, u = pd.families(body, 1.5), np.array([[0.0, 0], [0.1, 0], [0, 0.2], [0.1, 0.1]])

    def energy(E, c):
        return 0.5 * jnp.sum(c["table"]) * jnp.trace(E) ** 2 + jnp.sum(E * E)

    def force(table, **declared):
        law = pd.EnergyLaw(energy, "E", {"table": jnp.asarray(table)}, **declared)
        return np.asarray(pd.force_density(pd.Correspondence(law), families, u))

    expected = force(10.0)
    assert np.array_equal(force([1.0, 2.0, 3.0, 4.0], shared=("table",)), expected)
    assert np.abs(force([1.0, 2.0, 3.0, 4.0]) - expected).max() > 0.1  # undeclared: one number for each point
    assert np.array_equal(force([1.0, 4.0, 5.0]), expected)  # three entries can't be one for each of four points


def test_a_user_declares_which_constants_are_one_number():
    class Declared(Springs):
        one_number = ("stiffness",)

    families, three = pd.families(pd.lattice((2, 2)), 1.5), jnp.ones(3)
    with pytest.raises(ValueError, match="stiffness of Declared must be one number on a lattice family"):
        pd.force_state(Declared(three), PLANE, np.eye(2))
    with pytest.raises(ValueError, match="stiffness of Declared must be one number, or one for each of the 4 points"):
        pd.force_density(Declared(three), families, np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r"stiffness of .* must be one number on a lattice family"):
        pd.force_state(pd.graded(Declared(three), 2.0), PLANE, np.eye(2))  # The part inside declares it.


def test_a_constant_with_another_number_of_entries_than_points_is_refused():
    families = pd.families(pd.lattice((2, 2)), 1.5)
    model = pd.Correspondence(pd.LinearElastic(jnp.ones(3), 1.0))
    with pytest.raises(ValueError, match=r"lam of Correspondence must be one number, or one for each of the 4 points"):
        pd.force_density(model, families, np.zeros((4, 2)))
