"""The backend "compiled": its emitted functions, derivatives, threads, machine code, layouts and refusals.

`test_backends` compares the forces of all backends. The reference of the derivatives here is the backend "families".
"""

import threading

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.models.kinematics import log1p

pytest.importorskip("llvmlite")
from pdjax.force.backends import compiled
from pdjax.force.backends.compiled import emit, layouts, machine
from pdjax.force.backends.compiled.pair_sum import pair_sum
from pdjax.force.backends.compiled.pairs import PairProgram, tangent, transposed

LATTICE = pd.lattice((7, 5), 0.5, mask=np.arange(35).reshape(7, 5) != 17)
BODIES = {
    "lattice": (LATTICE, 1.01),
    "periodic": (pd.lattice((6, 5), 0.5, periodic=(True, False)), 1.01),
    "cloud": (pd.cloud(LATTICE.positions, bodies.random(40).uniform(0.2, 0.3, 34)), 1.01),
    "horizons": (pd.cloud(LATTICE.positions, 0.25), bodies.random(41).uniform(1.01, 1.2, 34)),
}


@pytest.fixture(autouse=True)
def stream_every_body(monkeypatch):
    """Otherwise these small bodies would be evaluated with all bonds at once."""
    monkeypatch.setattr("pdjax.force.backends.padded.SMALL", 0)


def relative(a, b):
    return float(np.max(np.abs(np.asarray(a) - np.asarray(b))) / np.max(np.abs(np.asarray(b))))


def body_of(kind, key=1):
    """Families of a body and a displacement of about 6 % strain."""
    body, horizon = BODIES[kind]
    fams = pd.families(body, horizon, pd.gaussian_influence)
    return fams, jnp.asarray(0.03 * bodies.random(42, key).normal(size=body.positions.shape))


def at_points(function, *rows):
    """function(x, …) in every point, by the loop over points."""
    count = len(rows[0])
    each = layouts._each(-(-count // 16) * 16)
    program = PairProgram(lambda here, *_: ([function(*here)], [jnp.zeros(())]), len(rows), [], 1)
    padded = [jnp.asarray(np.pad(np.asarray(x, float), (0, each[0] - count), constant_values=1.0)) for x in rows]
    return np.asarray(pair_sum(program, "points", (jnp.asarray(each),), padded, [])[0])[:count]


def spread(low, high, *key):
    """Random numbers with random and with similar neighbours, so that vectors are mixed and not mixed."""
    x = bodies.random(43, *key).uniform(low, high, 800)
    return np.append(x, np.sort(x))


STRETCH = 10.0 ** spread(-3, 3, 1)
ACCURATE = {
    "exp near 0": (jnp.exp, np.exp, (spread(-0.1, 0.1),), 5e-16),  # measured: 2.1e-16
    "exp": (jnp.exp, np.exp, (spread(-708, 709),), 5e-16),  # measured: 2.7e-16
    "log": (jnp.log, np.log, (10.0 ** spread(-300, 300),), 5e-16),  # measured: 1.6e-16
    "log near 1": (jnp.log, np.log, (spread(0.5, 2.0),), 8e-16),  # measured: 4.3e-16
    "log1p near 0": (log1p, np.log1p, (spread(-0.1, 0.1),), 8e-16),  # measured: 4.4e-16
    "log1p": (log1p, np.log1p, (spread(-0.999, 10.0),), 8e-16),  # measured: 3.4e-16
    "pow of stretches": (jnp.power, np.power, (STRETCH, spread(-4, 4, 2)), 1e-14),  # measured: 3.9e-15
    "pow near 1": (jnp.power, np.power, (spread(0.95, 1.05), spread(-4, 4, 2)), 5e-16),  # measured: 2.2e-16
    "sqrt": (jnp.sqrt, np.sqrt, (STRETCH,), 2e-16),  # measured: 1.1e-16
    "rsqrt": (jax.lax.rsqrt, lambda x: 1 / np.sqrt(x), (STRETCH,), 4e-16),  # measured: 1.6e-16
    "whole power": (lambda x: x**7, lambda x: x**7, (STRETCH,), 1e-15),  # measured: 5.1e-16
    "negative power": (lambda x: x**-5, lambda x: x**-5, (STRETCH,), 1e-15),  # measured: 3.7e-16
}


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="the reference needs longer numbers than float64")
@pytest.mark.parametrize("name", ACCURATE)
def test_emitted_functions_are_accurate_to_a_few_units_in_the_last_place(name):
    function, exact, rows, tolerance = ACCURATE[name]
    expected = exact(*(x.astype(np.longdouble) for x in rows))
    assert relative_to_each(at_points(function, *rows), expected) < tolerance


def relative_to_each(found, expected):
    return float(np.max(np.abs((found - expected) / expected)))


SPECIAL = np.array([0.0, np.inf, -np.inf, np.nan, -1.0, -2.0, 1.0, 1e308, -1e308, 800.0, -800.0, 1e-300, 0.06, -0.06])


@pytest.mark.parametrize(
    "function", [jnp.exp, jnp.log, log1p, jnp.sqrt, jnp.abs, jnp.sign, jnp.power, jnp.maximum, jnp.minimum]
)
def test_emitted_functions_have_the_special_values_of_jax(function):
    two = function in (jnp.power, jnp.maximum, jnp.minimum)
    first = SPECIAL[SPECIAL != -np.inf] if function is jnp.power else SPECIAL  # (−∞)^0.5 is NaN here and ∞ in JAX
    rows = [x.ravel() for x in np.meshgrid(first, [*SPECIAL, 2.0, 3.0, 0.5, -3.0])] if two else [SPECIAL]
    expected = np.asarray(jax.jit(function)(*map(jnp.asarray, rows)))
    np.testing.assert_allclose(at_points(function, *rows), expected, rtol=1e-13)  # measured: 2.4e-14, of (1e308)^0.06


SCALARS = {
    "pow": lambda x, y: x**y,
    "log1p": lambda x, y: log1p(x * y),
    "abs sign": lambda x, y: jnp.abs(x - y) * jnp.sign(y) + jnp.abs(x),
    "max min": lambda x, y: jnp.maximum(x, y) * jnp.minimum(x, 2 * y),
    "select": lambda x, y: jnp.where((x > y) & ~(x == 1) | (y >= 3), x * y, x / y),
    "roots": lambda x, y: jnp.sqrt(x) * jax.lax.rsqrt(y) + x**-3 + jnp.square(y),
    "exp log": lambda x, y: jnp.exp(x * jnp.log(y)),
}


@pytest.mark.parametrize("name", SCALARS)
def test_derivatives_of_emitted_functions_are_emitted_too(name):
    """`unserved` looks at the function alone, so its derivatives must not need any other operation."""
    program = PairProgram(lambda here, *_: ([SCALARS[name](*here)], [jnp.zeros(())]), 2, [], 1)
    for _ in range(3):
        along = tangent(program, tuple(range(program.rows)), ())
        back = transposed(along, tuple(range(program.rows, along.rows)), ())
        assert program.unserved is along.unserved is back.unserved is None
        program = along if program.rows > 2 else back


def derivatives(model, fams, u, way, twice):
    """The jvp and the vjp in u and the model, and, if `twice`, the forward derivative of the latter."""
    v, w = (jnp.asarray(bodies.random(44, k).normal(size=u.shape)) for k in (0, 1))

    @eqx.filter_jit
    def found(model, u):
        def force(u, model):
            return pd.force_density(model, fams, u, way=way)

        def slopes(u):
            return jax.grad(lambda u, m: jnp.vdot(w, force(u, m)), (0, 1))(u, model)

        along = jax.jvp(lambda u: force(u, model), (u,), (v,))[1]
        return along, jax.jvp(slopes, (u,), (v,)) if twice else slopes(u)

    return found(model, u)


@pytest.mark.parametrize(
    "name,kind,twice",
    [
        ("seth_hill m=-0.7", "lattice", False),
        ("littlewood control", "periodic", False),
        ("bond_based m=-0.3", "cloud", True),
        ("lps", "horizons", True),
    ],
)
def test_derivatives_equal_those_of_families(name, kind, twice):
    fams, u = body_of(kind)
    found, expected = (
        jax.tree.leaves(derivatives(table.MODELS[name], fams, u, way, twice)) for way in ("compiled", "families")
    )
    for a, b in zip(found, expected, strict=True):
        assert relative(a, b) < 1e-13  # measured: 1.3e-15


def test_constants_may_vary_from_point_to_point():
    for kind in ("lattice", "cloud"):
        fams, u = body_of(kind, 2)
        m = jnp.linspace(-1, 1, 34)
        model = pd.graded(pd.LPS(2 + m, 0.7), 2 + m)

        def slope(way, m=model, fams=fams, u=u):
            return eqx.filter_jit(jax.grad(lambda m: jnp.sum(pd.force_density(m, fams, u, way=way) ** 2)))(m)

        slopes = slope("compiled"), slope("families")
        for a, b in zip(*map(jax.tree.leaves, slopes), strict=True):
            assert relative(a, b) < 1e-12  # measured: 2e-15


@pytest.mark.parametrize("kind", ["lattice", "cloud"])
def test_transformations_of_jax_take_the_operator(kind):
    fams, u = body_of(kind, 3)
    model = table.MODELS["lps"]
    operator, other = (pd.force_operator(model, fams, way) for way in ("compiled", "families"))
    many, F = jnp.stack([u, 2 * u, -u]), jnp.asarray([[1.02, 0.03], [0.0, 0.97]])
    one_by_one = jnp.stack([other(x) for x in many])
    assert relative(jax.vmap(operator)(many), one_by_one) < 1e-13  # measured: 1e-15
    assert relative(jax.vmap(operator, 2, 2)(jnp.moveaxis(many, 0, 2)), jnp.moveaxis(one_by_one, 0, 2)) < 1e-13
    batched, expected = (
        jax.vmap(lambda c, f=f: pd.force_density(pd.LPS(c, 0.7), fams, u, way=f))(jnp.asarray([1.0, 2.0]))
        for f in ("compiled", "families")
    )
    assert relative(batched, expected) < 1e-13  # measured: 1e-15

    def march(f):
        def step(u, _):
            return u + 1e-3 * f(u), None

        return jax.grad(lambda u: jnp.sum(jax.lax.scan(jax.checkpoint(step), u, None, length=3)[0] ** 3))(u)

    assert relative(march(operator), march(other)) < 1e-12  # measured: 1e-15
    by_F, expected = (jax.grad(lambda F, f=f: jnp.sum(f(u, F) ** 2))(F) for f in (operator, other))
    assert relative(by_F, expected) < 1e-12  # measured: 1e-15
    with jax.disable_jit():
        assert relative(operator(u), one_by_one[0]) < 1e-13  # measured: 1e-15


def test_numbers_that_are_not_finite_stay_at_the_bonds_that_have_them():
    for kind in ("lattice", "periodic", "cloud"):
        fams, u = body_of(kind, 4)
        u = u.at[3, 0].set(jnp.nan)
        operators = [pd.force_operator(table.MODELS["lps"], fams, way) for way in ("compiled", "families")]
        found, expected = (np.asarray(jax.jit(operator)(u)) for operator in operators)
        assert np.array_equal(np.isnan(found), np.isnan(expected)) and not np.isnan(found).all()
        ok = ~np.isnan(found)
        assert relative(found[ok], expected[ok]) < 1e-13  # measured: 1e-15


STRIPS = {
    "plane by plane": (pd.lattice((20, 7, 6), 0.5), 0.75),
    "planes of two periodic axes": (pd.lattice((30, 3, 9), 0.5, periodic=(True, False, True)), 0.75),
    "a plate with a hole": (pd.lattice((30, 40), 0.5, mask=np.arange(1200).reshape(30, 40) != 617), 1.01),
    "few long rows": (pd.lattice((3, 90), 0.5), 1.01),
}


@pytest.mark.parametrize("name", STRIPS)
def test_strips_and_parts_of_a_lattice_do_not_change_its_forces(name, monkeypatch):
    body, horizon = STRIPS[name]
    u = jnp.asarray(0.03 * bodies.random(45).normal(size=body.positions.shape))
    model = table.MODELS["lps"]
    expected = pd.force_density(model, pd.families(body, horizon), u, way="slices")
    shares = set()
    for strip, parts in ((1024, 64), (16, 64), (5, 2)):
        monkeypatch.setattr(layouts, "STRIP", strip)
        monkeypatch.setattr(layouts, "PARTS", parts)
        operator = pd.force_operator(model, pd.families(body, horizon), "compiled")
        shares.add(tuple(np.asarray(operator.backend.layout.sizes)[[1, 2, 5, 6]].tolist()))
        assert relative(operator(u), expected) < 1e-13  # measured: 2e-15
    assert len(shares) > 2


@pytest.mark.parametrize("count", [2, 15, 16, 17, 33])
def test_bodies_of_any_number_of_points_have_the_forces_of_families(count):
    """One vector holds 16 points on some processors. These bodies fill it in part, exactly, or a little more."""
    body, model = pd.lattice((count,), 0.5), table.MODELS["bond_based m=-0.3"]
    u = jnp.asarray(0.03 * bodies.random(46).normal(size=(count, 1)))
    for fams in (pd.families(body, 1.01), pd.families(pd.cloud(body.positions, 0.5), 1.01), pd.families(body, 99.0)):
        found, expected = (pd.force_density(model, fams, u, way=way) for way in ("compiled", "families"))
        assert relative(found, expected) < 1e-13  # measured: 6e-16


@pytest.mark.parametrize("kind", list(BODIES))
def test_the_forces_do_not_depend_on_the_order_in_which_threads_work(kind):
    fams, u = body_of(kind, 5)
    operator = pd.force_operator(table.MODELS["silling control"], fams, "compiled")
    first = np.asarray(operator(u))
    assert all(np.array_equal(np.asarray(operator(u)), first) for _ in range(30))


class Springs(pd.PointStateModel):
    """Springs of the stiffness `law(s)`. Subclasses define the law."""

    c: jax.Array | float = 1.0
    hyperelastic = False

    def moments(self, bond):
        return bond.omega * bond.volume, ()

    def state(self, sums):
        return ()

    def bond_force(self, here, there, bond):
        s = jnp.sqrt(jnp.sum((bond.xi + bond.eta) ** 2) / jnp.sum(bond.xi**2))
        return bond.omega * self.law(s) * (bond.xi + bond.eta)


class Numbered(Springs):
    number: int = eqx.field(static=True, default=0)

    def law(self, s):
        return self.c * (s - 1) * (self.number + 1.5)


def test_threads_of_python_may_compile_and_call_the_same_program_at_once():
    body = LATTICE
    _, u = body_of("lattice", 6)
    failed = []
    for number in range(2):
        model = Numbered(number=number)
        all_ = [pd.families(body, 1.01) for _ in range(4)]
        expected = pd.force_density(model, all_[0], u, way="slices")
        start = threading.Barrier(4)

        def call(fams, model=model, expected=expected, start=start):
            try:
                start.wait()
                for _ in range(5):
                    found = pd.force_operator(model, fams, "compiled")(u)
                    assert relative(found, expected) < 1e-13  # measured: 4e-16
            except BaseException as error:
                failed.append(error)

        threads = [threading.Thread(target=call, args=(fams,)) for fams in all_]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert not failed


def test_new_constants_and_new_bodies_compile_no_machine_code():
    def all_of(model, fams, u):
        def force(u, model=model):
            return pd.force_density(model, fams, u, way="compiled")

        jax.jvp(force, (u,), (u,))
        jax.grad(lambda u, m: jnp.sum(force(u, m) ** 2), (0, 1))(u, model)

    fams, u = body_of("lattice", 7)
    all_of(pd.SethHill(0.3, pd.LinearElastic(1.3, 0.7)), fams, u)
    before = len(machine._ENGINES)
    all_of(pd.SethHill(0.4, pd.LinearElastic(2.0, 0.9)), fams, u)
    for shape, periodic in (((9, 8), False), ((5, 6), True)):
        body = pd.lattice(shape, 0.25, periodic=periodic)
        u = jnp.asarray(0.01 * bodies.random(47).normal(size=body.positions.shape))
        all_of(pd.SethHill(0.3, pd.LinearElastic(1.3, 0.7)), pd.families(body, 0.51), u)
    assert len(machine._ENGINES) == before


class Twisted(Springs):
    def law(self, s):
        return jnp.tanh(self.c * (s - 1))


class Read(Springs):
    def law(self, s):
        return jax.lax.bitcast_convert_type(jax.lax.bitcast_convert_type(s, jnp.int64) + 1, jnp.float64)


class Backward(Springs):
    def law(self, s):
        @jax.custom_vjp
        def square(x):
            return x * x

        square.defvjp(lambda x: (x * x, x), lambda x, g: (2 * x * g,))
        return square(s - 1)


class Rooted(Springs):
    def state(self, sums):
        return jnp.cbrt(sums.reference)

    def bond_force(self, here, there, bond):
        return bond.omega * here * bond.eta


class Named(Springs):
    def law(self, s):
        @jax.custom_jvp
        def log1p(x):
            return jnp.log(1 + 2 * x)

        log1p.defjvp(lambda p, t: (log1p(*p), t[0] * 2 / (1 + 2 * p[0])))
        return self.c * log1p(s - 1)


class Powered(Springs):
    def law(self, s):
        return (s - 1) ** self.c


@pytest.mark.parametrize(
    "model, why",
    [
        (Twisted(), "Twisted uses the operation tanh, which has no vector instruction"),
        (Read(), "Read uses the operation add of whole numbers"),
        (Backward(), "Backward uses the operation custom_vjp_call"),
        (Powered(jnp.asarray(2)), "Powered has constants of the type int64"),
        (pd.BondLevel(table.LINEAR), "BondLevel has no point state made of sums"),
    ],
)
def test_what_the_backend_cannot_evaluate_is_named_and_another_one_is_taken(model, why):
    fams, _ = body_of("lattice", 8)
    with pytest.raises(ValueError, match=rf"way='compiled' cannot evaluate .*: {why}.*; backends that can: 'families'"):
        pd.force_operator(model, fams, "compiled")
    assert pd.force_operator(model, fams).way in ("slices", "families")


@pytest.mark.parametrize("model", [Rooted(), Named(), Powered(2.0), Powered(3.0)])
def test_models_of_users_have_the_forces_of_families(model):
    """A state that has no vector instructions, a function called log1p, and powers of negative numbers."""
    for kind in ("lattice", "cloud"):
        fams, u = body_of(kind, 9)
        assert pd.force_operator(model, fams).way == "compiled"
        found, expected = (pd.force_density(model, fams, u, way=way) for way in ("compiled", "families"))
        assert relative(found, expected) < 1e-13  # measured: 3e-15


class Divided(pd.PointStateModel):
    """A state that divides by a sum of the deformation, which is 0 where no point is."""

    c: float
    hyperelastic = False

    def moments(self, bond):
        w = bond.omega * bond.volume
        return w * jnp.sum(bond.xi**2), w * jnp.sum((bond.xi + bond.eta) ** 2)

    def state(self, sums):
        return self.c * (1 - sums.reference / sums.deformed)

    def bond_force(self, here, there, bond):
        return bond.omega * here * (bond.xi + bond.eta)


def test_gradients_in_the_model_are_finite_where_there_is_no_point():
    for kind in ("lattice", "cloud"):
        fams, u = body_of(kind, 13)
        found, expected = (
            jax.grad(lambda c, f=fams, u=u, w=w: jnp.sum(pd.force_density(Divided(c), f, u, way=w) ** 2))(1.3)
            for w in ("compiled", "families")
        )
        assert abs(found / expected - 1) < 1e-12  # measured: 1e-14


def _scaled(law, factor):
    """A law that closes over a factor."""
    return pd.EnergyLaw(lambda E, c: factor * law.energy(E), "E", 1.0)


def test_a_law_that_closes_over_a_traced_value_is_evaluated_by_another_backend():
    fams, u = body_of("lattice", 14)

    def force(c, way="auto"):
        law = pd.EnergyLaw(lambda E, _: c * jnp.sum(E * E), "E", 1.0)
        return pd.force_density(pd.SethHill(1.0, law), fams, u, way=way)

    assert relative(jax.jit(force)(2.0), force(2.0, "slices")) < 1e-13  # measured: 1e-15
    correspondence = pd.Correspondence(pd.LinearElastic(1.3, 0.7))
    law = pd.EnergyLaw(lambda E, _: 0.65 * jnp.trace(E) ** 2 + 0.7 * jnp.sum(E * E), "E", 1.0)
    by_fft = jax.jit(lambda one: pd.force_density(pd.Correspondence(_scaled(law, one)), fams, u, way="fft"))(1.0)
    assert relative(by_fft, pd.force_density(correspondence, fams, u, way="slices")) < 1e-13  # measured: 1e-15
    with pytest.raises(ValueError, match="SethHill uses a traced value that is no field of it"):
        jax.jit(lambda c: force(c, "compiled"))(2.0)


@pytest.mark.filterwarnings("ignore:Explicitly requested dtype float64")
def test_bodies_that_the_backend_cannot_evaluate_are_named():
    fams, u = body_of("lattice", 10)
    model = table.MODELS["lps"]
    single = jax.tree.map(lambda x: x.astype(np.float32) if x.dtype == np.float64 else x, fams)
    for body, why in (
        (single, "computes in float64, and the families are in float32"),
        (fams.with_share(jnp.asarray(fams.is_bond)), "some of its bonds are broken"),
    ):
        with pytest.raises(ValueError, match=f"way='compiled' cannot evaluate .*: .*{why}"):
            pd.force_operator(model, body, "compiled")
    with pytest.raises(ValueError, match="the families are traced"):
        jax.jit(lambda f: pd.force_density(model, f, u, way="compiled"))(fams)
    assert compiled.refusal(model, fams) is None
    operator = pd.force_operator(model, fams, "compiled")
    with jax.enable_x64(False), pytest.raises(ValueError, match="computes in float64 only; got float32"):
        operator(np.asarray(u))


def test_derivatives_in_the_geometry_raise_and_say_what_to_do():
    for kind in ("lattice", "cloud"):
        fams, u = body_of(kind, 11)
        operator = pd.force_operator(table.MODELS["lps"], fams, "compiled")
        with pytest.raises(
            NotImplementedError, match=r"geometry of a body .* u, F or the model alone, or .*'families'"
        ):
            eqx.filter_grad(lambda operator, u=u: jnp.sum(operator(u) ** 2))(operator)


def test_without_llvmlite_the_message_tells_how_to_install_it(monkeypatch):
    find = compiled.importlib.util.find_spec
    monkeypatch.setattr(compiled.importlib.util, "find_spec", lambda name: None if name == "llvmlite" else find(name))
    compiled.unavailable.cache_clear()
    try:
        fams, _ = body_of("lattice", 12)
        with pytest.raises(ValueError, match=r"it needs the package llvmlite; install it with: pip install"):
            pd.force_operator(table.MODELS["lps"], fams, "compiled")
        assert pd.force_operator(table.MODELS["lps"], fams).way == "slices"
    finally:
        compiled.unavailable.cache_clear()


def test_unserved_names_the_first_operation_without_a_vector_instruction():
    one = jax.ShapeDtypeStruct((), np.float64)
    assert emit.unserved(jax.make_jaxpr(lambda x: jnp.exp(x) / 3)(one)) is None
    assert emit.unserved(jax.make_jaxpr(lambda x: jnp.sin(jnp.cos(x)))(one)) == "the operation cos"
    assert emit.unserved(jax.make_jaxpr(lambda x: x.astype(jnp.float32))(one)) == "numbers of the type float32"
