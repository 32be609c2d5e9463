"""All backends give the same force density.

The reference is the general path, `whole_force`, which evaluates all bonds of a body at once.
"""

from dataclasses import replace

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.force.backends.padded import Whole
from pdjax.force.fields import whole_force
from pdjax.force.operator import ways_of

LATTICES = {
    1: (pd.lattice((9,), 0.5), 1.01),
    2: (pd.lattice((7, 5), 0.5, mask=np.arange(35).reshape(7, 5) != 17), 1.01),
    3: (pd.lattice((4, 3, 3), 0.5), 0.75),
}
BY_MOMENTS = [n for n, m in table.MODELS.items() if getattr(m, "by_moments", False)]
FLAT = ("seth_hill m=0", "wan control")  # Not tested in 3D, where they compile for seconds and others cover the code.
CHECKED = [(n, d) for n in BY_MOMENTS for d in table.MODELS[n].dims if d < 3 or n not in FLAT]


@pytest.fixture(autouse=True)
def no_body_is_small(monkeypatch):
    """Without this, these small bodies would be evaluated with all bonds at once, as the reference is."""
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 0)


def test_small_bodies_are_evaluated_with_all_bonds_at_once(monkeypatch):
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 10_000)
    fams = pd.families(pd.lattice((7, 5), 0.5), 1.01)
    operator = pd.force_operator(table.MODELS["lps"], fams)
    assert operator.way == "families" and isinstance(operator.backend, Whole)


def relative(a, b):
    return float(jnp.max(jnp.abs(a - b)) / jnp.max(jnp.abs(b)))


@pytest.mark.parametrize("name,dim", CHECKED)
def test_every_backend_equals_the_general_path(name, dim):
    model, (body, horizon) = table.MODELS[name], LATTICES[dim]
    if name == "sub_horizon" and dim == 3:
        horizon = 0.9
    fams = pd.families(body, horizon, pd.gaussian_influence)
    u = body.positions @ (bodies.deformation(dim, 5) - np.eye(dim)).T
    u = jnp.asarray(u + 0.02 * bodies.random(dim, 6).normal(size=u.shape))
    expected = whole_force(model, fams, fams.bonds(u))
    ways = ways_of(model, fams)
    assert ("fft" in ways) == (model.degree > 0)
    for way in ways:
        found = pd.force_density(model, fams, u, way=way)
        assert relative(found, expected) < 1e-13, way  # measured: 9e-15


@pytest.mark.parametrize("name", ["lps", "correspondence svk", "seth_hill m=1"])
def test_backends_agree_on_a_periodic_lattice_without_arrays(name):
    model = table.MODELS[name]
    body = pd.lattice((7, 6), 0.5, periodic=(True, False))
    fams, lean = (pd.families(body, 1.01, arrays=arrays) for arrays in (True, False))
    u = 0.02 * jnp.asarray(bodies.random(1).normal(size=body.positions.shape))
    F = jnp.asarray([[1.02, 0.03], [0.0, 0.97]])
    for mean in (None, F):
        expected = whole_force(model, fams, fams.bonds(u, mean))
        for way in ("slices", "fft") if mean is None and model.degree else ("slices",):
            assert relative(pd.force_density(model, lean, u, mean, way=way), expected) < 1e-13  # measured: 4e-15


@pytest.mark.parametrize("name", ["seth_hill m=0", "bond_based", "lps"])
def test_a_body_that_moves_as_a_whole_is_free_of_force(name):
    """A translation by one spacing moves a point to the place of an empty cell, whose displacement is 0."""
    body = pd.lattice((7, 5), 0.5)
    lean = pd.families(body, 1.01, arrays=False)
    for step in (0.5, 1, 50.0):  # 1 is an integer on purpose
        f = pd.force_density(table.MODELS[name], lean, jnp.full((35, 2), step) * jnp.asarray([1, 0]), way="slices")
        assert float(jnp.max(jnp.abs(f))) < 1e-12  # measured: 0


def test_constants_may_vary_from_point_to_point():
    body = pd.lattice((7, 5), 0.5)
    fams = pd.families(body, 1.01)
    m = jnp.linspace(-1, 1, 35)
    model = pd.graded(pd.SethHill(m, pd.LinearElastic(1.3, m + 2)), 2 + m)
    u = 0.02 * jnp.asarray(bodies.random(3).normal(size=body.positions.shape))
    expected = whole_force(model, fams, fams.bonds(u))
    for way in ("slices", "families"):
        assert relative(pd.force_density(model, fams, u, way=way), expected) < 1e-13  # measured: 3e-15
    assert "fft" not in ways_of(pd.Correspondence(pd.LinearElastic(m + 2, m + 2)), fams)


@pytest.mark.parametrize("way", ["families", "slices", "fft"])
def test_derivatives_are_exact_in_every_backend(way):
    """The jvp equals a central difference and the vjp is its transpose, also for a constant of the law."""
    body = pd.lattice((7, 5), 0.5)
    fams = pd.families(body, 1.01)
    rng = bodies.random(4)
    u, v, w = (jnp.asarray(s * rng.normal(size=body.positions.shape)) for s in (0.02, 1.0, 1.0))

    def force(u, mu):
        return pd.force_density(pd.Correspondence(pd.LinearElastic(1.3, mu), pd.SillingControl()), fams, u, way=way)

    along, by_mu = jax.jvp(force, (u, 0.7), (v, 0.3))[1], jax.vjp(force, u, 0.7)[1](w)
    h = 1e-5
    central = (force(u + h * v, 0.7 + h * 0.3) - force(u - h * v, 0.7 - h * 0.3)) / (2 * h)
    assert relative(along, central) < 1e-8  # measured: 2e-9
    left, right = jnp.vdot(w, along), jnp.vdot(by_mu[0], v) + 0.3 * by_mu[1]
    assert abs(left - right) < 1e-12 * abs(left)  # measured: 1e-15


ADDITIVE = [n for n in BY_MOMENTS if table.MODELS[n].additive and n not in FLAT]


@pytest.mark.parametrize("name", ADDITIVE)
def test_the_linearised_model_is_the_jacobian_about_a_homogeneous_deformation(name):
    """A body with surfaces and a hole is linearised at u = (F − I) X. The reference J v is that of the general path."""
    model, (body, horizon), F = table.MODELS[name], LATTICES[2], bodies.deformation(2, 9)
    fams = pd.families(body, horizon, pd.gaussian_influence)
    u = jnp.asarray(body.positions @ (F - np.eye(2)).T)
    v = jnp.asarray(bodies.random(8).normal(size=u.shape))
    expected = jax.jit(lambda u, v: jax.jvp(lambda w: whole_force(model, fams, fams.bonds(w)), (u,), (v,))[1])(u, v)
    tangent = pd.linearised(model, F)
    ways = ways_of(tangent, fams)
    assert ("fft" in ways) == (name != "littlewood control")  # the force of this control is not proportional to ω
    for way in ways:
        assert relative(pd.force_density(tangent, fams, v, way=way), expected) < 1e-12, way  # measured: 1e-14


def test_linearised_raises_for_a_model_of_two_stages_and_for_an_inverted_state():
    with pytest.raises(ValueError, match=r"got BondLevel\. Use pd\.jvp"):
        pd.linearised(pd.BondLevel(table.LINEAR), np.eye(2))
    with pytest.raises(ValueError, match="det F > 0"):
        pd.linearised(pd.SethHill(0.0, table.LINEAR), -np.eye(1))


def test_the_operator_compiles_once_for_all_constants():
    body = pd.lattice((7, 5), 0.5)
    fams = pd.families(body, 1.01)
    traced = []

    @jax.jit
    def f(operator, u):
        traced.append(1)
        return operator(u)

    for mu in (0.7, 0.8):
        model = pd.Correspondence(pd.LinearElastic(1.3, mu))
        operator = pd.force_operator(model, fams)
        u = 0.02 * jnp.asarray(bodies.random(5).normal(size=body.positions.shape))
        assert relative(f(operator, u), whole_force(model, fams, fams.bonds(u))) < 1e-13  # measured: 2e-15
    assert len(traced) == 1


class Dashpots(pd.PointStateModel):
    """Bonds that pull with a power of the mean stretch of their family. Subclasses declare the promises."""

    power: int
    odd: bool = False
    hyperelastic = False

    def moments(self, bond):
        w, g = bond.omega * bond.volume, jnp.vdot(bond.xi, bond.eta)
        return w, w * bond.eta[0] if self.odd else w * g**self.power

    def state(self, sums):
        return sums.deformed / sums.reference

    def bond_force(self, here, there, bond):
        return bond.omega * here * (bond.xi + bond.eta)


class Promising(Dashpots):
    additive = True


class Linear(Promising):
    degree = 1


class Squared(Promising):
    def bond_force(self, here, there, bond):
        return bond.omega * here**2 * bond.xi


@pytest.mark.parametrize(
    "model, broken",
    [
        (Promising(2), None),
        (Linear(1), None),
        (Linear(2), "degree"),
        (Promising(1, True), "even"),
        (Squared(1), "additive"),
    ],
)
def test_a_promise_that_does_not_hold_is_refused(model, broken):
    """The promises of a user's model are tested, because a wrong one would give wrong forces without any warning."""
    body = pd.lattice((7, 5), 0.5)
    fams = pd.families(body, 1.01)
    u = 0.02 * jnp.asarray(bodies.random(12).normal(size=body.positions.shape))
    if broken:
        with pytest.raises(ValueError, match=f"declares {broken} ="):
            pd.force_density(model, fams, u, way="slices")
        return
    for way in ways_of(model, fams):
        found = pd.force_density(model, fams, u, way=way)
        assert relative(found, whole_force(model, fams, fams.bonds(u))) < 1e-13, way  # measured: 1e-15


def test_a_lattice_with_changed_volumes_or_positions_is_a_cloud():
    body = pd.lattice((7, 5), 0.5)
    volumes = np.linspace(1, 2, 35)
    for changed in (replace(body, volumes=volumes), replace(body, positions=body.positions + 0.01 * volumes[:, None])):
        fams = pd.families(changed, 1.01)
        alone = pd.families(pd.cloud(changed.positions, changed.volumes), 1.01)
        u = 0.02 * jnp.asarray(bodies.random(13).normal(size=body.positions.shape))
        assert ways_of(table.MODELS["lps"], fams) == ("families", "compiled")
        assert relative(*(pd.force_density(table.MODELS["lps"], f, u) for f in (fams, alone))) < 1e-14  # measured: 0
        with pytest.raises(ValueError, match="changed positions or volumes"):
            pd.families(changed, 1.01, arrays=False)
    fams = eqx.tree_at(lambda f: f.volumes, pd.families(body, 1.01), jnp.asarray(volumes))
    assert ways_of(table.MODELS["lps"], fams) == ("families", "compiled")


def test_gradients_are_finite_where_there_is_no_point():
    """The displacement of the body is far from the 0 of empty cells, and the law divides by a constant."""
    body = pd.lattice((9, 7), 0.5, mask=np.arange(63).reshape(9, 7) < 40)
    lean = pd.families(body, 1.01, arrays=False)
    u = 0.02 * jnp.asarray(bodies.random(14).normal(size=body.positions.shape)) + jnp.asarray([3.0, 0.0])
    model = pd.Correspondence(pd.NeoHookean(1.0, 1.0))

    def slope(way):
        return jax.grad(lambda v: jnp.sum(pd.force_density(model, lean, v, way=way) ** 2))(u)

    assert relative(slope("fft"), slope("slices")) < 1e-10  # measured: 3e-14

    def stiffness(mu, way):
        fung = pd.EnergyLaw(lambda E, c: c[0] / c[1] ** 2 * jnp.sum(jnp.exp(c[1] * E) - c[1] * E), "E", (mu, alpha))
        return jnp.sum(pd.force_density(pd.Correspondence(fung), fams, u, way=way) ** 2)

    fams, alpha = pd.families(body, 1.01), jnp.linspace(2, 3, len(body))
    by_way = [jax.grad(stiffness)(1.0, way) for way in ("slices", "families")]
    assert abs(by_way[0] / by_way[1] - 1) < 1e-12  # measured: 1e-15


def test_every_backend_takes_unusual_constants_and_complex_u_raises():
    """Constants in float32, a law that solves a linear system with its constants, and a traced F of `linearised`."""
    body = pd.lattice((7, 5), 0.5)
    fams = pd.families(body, 1.01)
    u = 0.02 * jnp.asarray(bodies.random(15).normal(size=body.positions.shape))
    A = jnp.asarray([[2.0, 0.3], [0.3, 1.5]])
    solving = pd.EnergyLaw(lambda E, c: 0.5 * jnp.sum(E * jnp.linalg.solve(c, E)), "E", A)
    single = pd.LPS(jnp.linspace(1, 2, 35, dtype=jnp.float32), 1.0)
    for model in (pd.Correspondence(solving), single):
        expected = whole_force(model, fams, fams.bonds(u))
        for way in ("slices", "families"):
            assert relative(pd.force_density(model, fams, u, way=way), expected) < 1e-13  # measured: 1e-15
    F = jnp.asarray(bodies.deformation(2, 16))
    tangent = pd.linearised(table.MODELS["seth_hill m=1"], F)
    by_jit = jax.jit(lambda F: pd.force_density(pd.linearised(table.MODELS["seth_hill m=1"], F), fams, u))(F)
    assert relative(by_jit, pd.force_density(tangent, fams, u, way="fft")) < 1e-13  # measured: 2e-15
    with pytest.raises(ValueError, match="takes real u only; got complex128"):
        pd.force_density(table.MODELS["lps"], fams, u + 1j, way="slices")


def test_families_without_arrays_suffice_for_jvp_and_other_functions_raise():
    body = pd.lattice((7, 5), 0.5)
    fams, lean = (pd.families(body, 1.01, arrays=arrays) for arrays in (True, False))
    u = 0.02 * jnp.asarray(bodies.random(17).normal(size=body.positions.shape))
    model = table.MODELS["lps"]
    assert relative(*(pd.jvp(model, f, u, 2 * u) for f in (lean, fams))) < 1e-13  # measured: 1e-15
    moving = pd.motion(pd.scene(body, lean, model, moving=True), start=u)
    for refused in (
        lambda: pd.jacobian(model, lean, u, "coloured"),
        lambda: lean.with_weight(jnp.ones((35, 8))),
        lambda: pd.simulate(moving, 0.1),
    ):
        with pytest.raises(ValueError, match="arrays=False"):
            refused()


def test_errors_list_the_backends_that_can_evaluate_the_body():
    body = pd.lattice((7, 5), 0.5)
    fams, lean = (pd.families(body, 1.01, arrays=arrays) for arrays in (True, False))
    cloud = pd.families(pd.cloud(body.positions, 0.25), 1.01)
    law = pd.LinearElastic(1.0, 1.0)
    u = jnp.zeros((35, 2))
    with pytest.raises(ValueError, match="way must be one of"):
        pd.force_density(pd.SethHill(1.0, law), fams, u, way="gpu")
    with pytest.raises(ValueError, match=r"not a polynomial in the displacement.*'families', 'slices', 'compiled'$"):
        pd.force_density(pd.SethHill(0.0, law), fams, u, way="fft")
    with pytest.raises(ValueError, match=r"do not come from a lattice.*backends that can: 'families', 'compiled'$"):
        pd.force_density(pd.SethHill(0.0, law), cloud, u, way="slices")
    with pytest.raises(ValueError, match=r"no point state made of sums.*backends that can: 'families'$"):
        pd.force_density(pd.BondLevelAverage(law), fams, u, way="slices")
    with pytest.raises(ValueError, match=r"mean deformation.*'families', 'slices', 'compiled'$"):
        pd.force_density(pd.Correspondence(law), fams, u, jnp.eye(2), way="fft")
    with pytest.raises(ValueError, match="takes no mean deformation"):
        pd.force_operator(pd.Correspondence(law), fams, "fft")(u, jnp.eye(2))
    with pytest.raises(ValueError, match="arrays=False"):
        pd.strain_energy(pd.SethHill(0.0, law), lean, u)
    with pytest.raises(ValueError, match="needs families with arrays"):
        pd.force_density(pd.BondLevelAverage(law), lean, u)
    with pytest.raises(ValueError, match="arrays=False is for lattices"):
        pd.families(pd.cloud(body.positions, 0.25), 1.01, arrays=False)
    with pytest.raises(ValueError, match=r"family of point 0 .*singular"):
        thin = pd.families(pd.lattice((7, 1), 0.5), 1.01, arrays=False)
        pd.force_density(pd.Correspondence(law), thin, jnp.zeros((7, 2)))
    with pytest.raises(ValueError, match="mask must hold one bool"):
        pd.lattice((3, 2), mask=np.ones((2, 3), bool))
