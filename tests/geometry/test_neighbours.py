"""Families agree with brute force, and their ties, order, reverse bonds, padding and bond weights are right."""

import inspect
import itertools

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from bodies import worst
from hypothesis import given, settings
from hypothesis import strategies as st
from table import KINDS, LINEAR, MODELS

import pdjax as pd

# ---------------------------------------------------------------- one lattice family


@pytest.mark.parametrize(
    "dim, N, count",
    [
        (1, 1, 2),
        (1, 2.9, 4),
        (1, 3, 6),
        (2, 1, 4),
        (2, 1.5, 8),
        (2, 2.5, 20),
        (2, 3, 28),
        (3, 1, 6),
        (3, 1.75, 26),
        (3, 3, 122),
    ],
)
def test_lattice_family_is_the_ball_in_centro_symmetric_order(dim, N, count):
    fam = pd.lattice_family(dim, N, spacing=0.25)
    cells = np.asarray(fam.xi) / 0.25
    assert cells.shape == (count, dim) and fam.dim == dim
    assert np.array_equal(cells[: count // 2], -cells[count // 2 :])
    assert set(map(tuple, cells)) == set(map(tuple, ref.lattice_ball(dim, N)[1:]))
    assert float(fam.horizon) == N * 0.25 and np.all(np.asarray(fam.weight) == 1)
    assert np.all(fam.bonds(jnp.eye(dim)).volume == 0.25**dim)


@pytest.mark.parametrize("dim, count", [(1, 6), (2, 28), (3, 122)])
def test_ties_do_not_depend_on_rounding(dim, count):
    """The relative slack of the horizon is 1e-9."""
    for N in (3 * (1 - 1e-10), 0.3 / 0.1, 3 * (1 + 1e-10)):
        assert pd.lattice_family(dim, N).xi.shape[0] == count
    assert pd.lattice_family(dim, 3 * (1 - 1e-8)).xi.shape[0] < count


def test_homogeneous_bonds_are_relative_displacements():
    fam, F = pd.lattice_family(2, 2, 0.5, pd.gaussian_influence), bodies.deformation(2, 1)
    bonds = fam.bonds(jnp.asarray(F))
    assert worst(bonds.xi + bonds.eta, np.asarray(fam.xi) @ F.T) < 1e-15  # 0
    r = np.linalg.norm(fam.xi, axis=1)
    assert worst(bonds.omega, bodies.gaussian(r, 1.0)) < 1e-15  # 6e-17


# ---------------------------------------------------------------- every family of a body


def brute_bonds(body, horizon):
    """Return {(i, j): ξ} over all images of a periodic box."""
    period = [0.0 if not np.isfinite(p) else p for p in body.period or [np.inf] * body.dim]
    shifts = np.array(list(itertools.product(*[(-p, 0.0, p) if p else (0.0,) for p in period])))
    images = (body.positions[None] + shifts[:, None]).reshape(-1, body.dim)
    bonds = {}
    for i, X in enumerate(body.positions):
        xi = images - X
        size = np.sqrt(np.sum(xi**2, axis=1))
        for image in np.flatnonzero((size <= horizon * (1 + 1e-9)) & (size > 0)):
            key = (i, int(image % len(body)))
            assert key not in bonds
            bonds[key] = xi[image]
    return bonds


def check_families(body, horizon):
    """Compare neighbours, ξ, reverse slots, counts, volumes and padding with brute force."""
    fams = pd.families(body, horizon)
    assert (fams.spacing, fams.shape, float(fams.horizon)) == (body.spacing, body.shape, horizon)
    assert np.array_equal(fams.volumes, body.volumes)
    neighbours, reverse, xi = np.asarray(fams.neighbours), np.asarray(fams.reverse), np.asarray(fams.xi)
    true = np.asarray(fams.weight) > 0
    assert set(np.unique(fams.weight)) <= {0.0, 1.0}
    i, slot = np.nonzero(true)
    j = neighbours[i, slot]
    exact = brute_bonds(body, horizon)
    assert sorted(zip(i.tolist(), j.tolist(), strict=True)) == sorted(exact)
    found = np.array([exact[a, b] for a, b in zip(i.tolist(), j.tolist(), strict=True)])
    assert worst(xi[i, slot], found) < 1e-14  # 6e-17
    assert np.array_equal(neighbours[j, reverse[i, slot]], i)
    assert np.array_equal(xi[j, reverse[i, slot]], -xi[i, slot])
    assert np.array_equal(fams.count, true.sum(axis=1)) and fams.count.max() == fams.xi.shape[1]
    i, slot = np.nonzero(~true)
    assert np.array_equal(neighbours[i, slot], i) and np.array_equal(reverse[i, slot], slot)
    assert np.all(np.linalg.norm(xi[i, slot], axis=-1) > 0)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), dim=st.integers(1, 3), slack=st.floats(1.01, 2.0))
def test_families_of_random_clouds(seed, dim, slack):
    positions = np.random.default_rng(seed).uniform(-1, 1, (9, dim))
    distance = np.linalg.norm(positions[:, None] - positions[None], axis=-1) + 9 * np.eye(9)
    check_families(pd.cloud(positions, np.arange(1.0, 10)), float(slack * distance.min(axis=1).max()))


@pytest.mark.parametrize(
    "shape, spacing, horizon, periodic",
    [
        ((7,), 0.1, 0.3, False),
        ((5, 3), 0.1, 0.2, False),
        ((4, 3, 2), 0.1, 0.2, False),
        ((7,), 0.1, 0.3, True),
        ((7, 5), 0.1, 0.2, True),
        ((7, 2), 0.1, 0.3, (True, False)),
        ((3, 2, 5), 0.1, 0.2, (False, False, True)),
    ],
)
def test_families_of_lattices_keep_their_ties(shape, spacing, horizon, periodic):
    body = pd.lattice(shape, spacing, periodic)
    check_families(body, horizon)
    count = np.asarray(pd.families(body, horizon).count)
    full = pd.lattice_family(len(shape), horizon / spacing).xi.shape[0]
    assert (count == full).all() if periodic is True else count.min() < full


@pytest.mark.parametrize("kind", ["lattice", "cloud"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_families_of_the_bodies_of_these_tests(dim, kind):
    check_families(bodies.points(dim, kind), bodies.HORIZONS[dim])


def test_a_mean_deformation_gives_the_bonds_of_the_same_affine_displacement():
    fams, F = bodies.families(2, "cloud"), bodies.deformation(2, 3)
    X, u = bodies.points(2, "cloud").positions, bodies.displacement(2, "cloud", 3)
    apart = fams.bonds(jnp.asarray(u), jnp.asarray(F))
    together = fams.bonds(jnp.asarray(u + X @ (F - np.eye(2)).T))
    true = np.asarray(fams.weight) > 0
    assert worst(apart.eta[true], together.eta[true]) < 1e-14  # 6e-17
    back = fams.reversed(together)
    j, slot = np.asarray(fams.neighbours), np.asarray(fams.reverse)
    for here, there in zip(together[:3], back[:3], strict=True):  # ξ, η, ω in the family of the neighbour
        assert np.array_equal(np.asarray(here)[j, slot][true], there[true])
    volumes = np.asarray(fams.volumes)
    assert np.array_equal(together.volume, volumes[j]) and np.all(back.volume == volumes[:, None])


# ---------------------------------------------------------------- padding


@eqx.filter_jit
def derivatives(model, fams, u, v):
    """Return f, J v and the second derivative of f along v."""

    def slope(w):
        return jax.jvp(lambda x: pd.force_density(model, fams, x), (w,), (v,))[1]

    return pd.force_density(model, fams, u), *jax.jvp(slope, (u,), (v,))


@pytest.mark.parametrize("name", [name for name, model in KINDS.items() if 1 in model.dims])
def test_padding_does_not_change_second_derivatives(name):
    """The padded ξ and ω do not matter, also undeformed, where a strain written with |ξ + η| would give NaN."""
    model, fams = MODELS[name], bodies.families(1, "cloud")
    empty = fams.weight == 0
    other = eqx.tree_at(
        lambda f: (f.xi, f.influence),
        fams,
        (jnp.where(empty[..., None], -33.0, fams.xi), jnp.where(empty, 5.0, fams.influence)),
    )
    v = jnp.asarray(bodies.random(4).normal(size=(len(fams), 1)))
    u, step = jnp.asarray(bodies.displacement(1, "cloud", 4)), 1e-5
    for state in (jnp.zeros_like(u), u):
        for a, b in zip(derivatives(model, fams, state, v), derivatives(model, other, state, v), strict=True):
            assert worst(a, b) == 0
    up, down = (derivatives(model, fams, u + h * v, v)[1] for h in (step, -step))
    assert worst((up - down) / (2 * step), derivatives(model, fams, u, v)[2]) < 1e-5  # 2e-7


def test_padding_does_not_change_the_force_density():
    """Families without spare slots give the same forces as families with a slot for every point."""
    bare = pd.families(bodies.points(2, "cloud"), bodies.HORIZONS[2], pd.gaussian_influence)
    u = jnp.asarray(bodies.displacement(2, "cloud", 4))
    out = bodies.respond(MODELS["correspondence svk"], bodies.families(2, "cloud"), u)
    force = eqx.filter_jit(pd.force_density)(MODELS["correspondence svk"], bare, u)
    assert bare.xi.shape[1] < bodies.families(2, "cloud").xi.shape[1]
    assert worst(force, out.force) < 1e-14  # 0


# ---------------------------------------------------------------- weights of bonds

state = eqx.filter_jit(pd.force_state)


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "correspondence neo-hookean"])
def test_a_lattice_family_without_its_long_bonds_equals_a_smaller_family(name):
    F = jnp.asarray(bodies.deformation(2, 5))
    whole, small = pd.lattice_family(2, 3), pd.lattice_family(2, 2)
    near = np.linalg.norm(whole.xi, axis=1) < 2.1
    cut = whole.with_weight(jnp.asarray(near, dtype=float))
    assert whole.cubic and not cut.cubic
    T = np.asarray(state(MODELS[name], cut, F))
    of = {tuple(xi): t for xi, t in zip(np.asarray(cut.xi), T, strict=True)}
    exact = np.asarray(state(MODELS[name], small, F))
    assert worst([of[tuple(xi)] for xi in np.asarray(small.xi)], exact) < 1e-15  # 0
    assert np.all(T[~near] == 0)


@pytest.mark.parametrize("m", [1.0, 0.0, -0.7])
def test_a_body_cut_by_a_plane_equals_two_separate_bodies(m):
    body, fams = bodies.points(2, "cloud"), bodies.families(2, "cloud")
    u = bodies.displacement(2, "cloud", 6)
    left = body.positions[:, 0] < 2.0
    same = left[:, None] == left[np.asarray(fams.neighbours)]
    cut = fams.with_weight(jnp.asarray(same, dtype=float))
    assert 0 < cut.weight.sum() < fams.weight.sum()
    out = bodies.respond(pd.SethHill(m, LINEAR), cut, u)
    energy = 0.0
    for half in (left, ~left):
        args = (body.positions[half], body.volumes[half], bodies.HORIZONS[2], u[half], m, 1.3, 0.7, bodies.gaussian)
        assert worst(np.asarray(out.force)[half], ref.seth_hill_force(*args)) < 1e-13  # 3e-15
        energy += ref.seth_hill_energy(*args)
    assert worst(out.energy / energy, 1.0) < 1e-13  # 1e-15


def test_weights_multiply_and_padding_keeps_zero_weight():
    fams = bodies.families(2, "cloud")
    half = jnp.full(fams.weight.shape, 0.5)
    twice = fams.with_weight(half).with_weight(half)
    assert np.array_equal(twice.weight, 0.25 * fams.weight)
    assert np.array_equal(twice.bonds(jnp.zeros((15, 2))).omega, 0.25 * fams.influence * fams.weight)


def test_weights_are_traced_and_differentiable():
    fams = bodies.families(1, "cloud")
    u = jnp.asarray(bodies.displacement(1, "cloud", 7))
    weight = jnp.asarray(bodies.random(7).uniform(0.3, 0.9, fams.weight.shape))

    @jax.jit
    def energy(weight):
        return pd.strain_energy(MODELS["seth_hill m=-0.7"], fams.with_weight(weight), u)

    slope, step = jax.grad(energy)(weight), 1e-5
    for i, slot in ((0, 1), (3, 2), (6, 0)):
        up, down = (energy(weight.at[i, slot].add(h)) for h in (step, -step))
        assert worst((up - down) / (2 * step), slope[i, slot]) < 1e-10  # 3e-13
        assert abs(slope[i, slot]) > 1e-6
    assert np.all(np.asarray(slope)[np.asarray(fams.weight) == 0] == 0)


# ---------------------------------------------------------------- printed sizes


def test_families_print_their_sizes_and_traced_values_are_left_out():
    body, family = pd.lattice((5, 4)), pd.lattice_family(2, 2, 0.5)
    fams = pd.families(body, 2.1)
    assert repr(family) == "LatticeFamily(12 bonds, 2D, horizon 1, spacing 0.5)"
    assert repr(family.with_weight(np.ones(12))).endswith("spacing 0.5, weighted bonds)")
    assert repr(fams) == str(fams) == "Families(20 points, 2D, 5 to 11 bonds a point, horizon 2.1)"
    assert (
        repr(pd.families(pd.lattice((9,), periodic=True), 2.0)) == "Families(9 points, 1D, 4 bonds a point, horizon 2)"
    )
    assert repr(pd.families(body, 2.1, arrays=False)).endswith("5 to 11 bonds a point, horizon 2.1, arrays=False)")
    shown = []
    eqx.filter_eval_shape(lambda *trees: shown.extend(map(repr, trees)), family, fams)
    assert shown == ["LatticeFamily(12 bonds, 2D)", "Families(20 points, 2D, at most 11 bonds a point)"]


def test_trees_with_the_structure_of_families_can_be_printed():
    family, fams = pd.lattice_family(2, 2), pd.families(pd.lattice((5, 4)), 2.1)
    for tree in (family, fams):
        for change in (lambda x: True, np.shape, lambda x: x[None], lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype)):
            assert repr(jax.tree.map(change, tree)).startswith(type(tree).__name__)
        assert repr(eqx.partition(tree, lambda x: False)[0]).startswith(type(tree).__name__)


# ---------------------------------------------------------------- wrong use

PAIR = pd.cloud([[0.0, 0.0], [1.0, 0.0]], 1.0)


@pytest.mark.parametrize(
    "call, named",
    [
        (lambda: pd.lattice_family(0, 2), "dim must be 1, 2 or 3; got 0"),
        (lambda: pd.lattice_family(4, 2), "dim"),
        (lambda: pd.lattice_family(2, 0.99), "N .*>= 1"),
        (lambda: pd.lattice_family(2, np.nan), "N .*finite"),
        (lambda: pd.lattice_family(2, np.inf), "N .*finite"),
        (lambda: pd.lattice_family(2, 2, spacing=0.0), "spacing"),
        (lambda: pd.lattice_family(2, 2, spacing=np.nan), "spacing"),
        (lambda: pd.lattice_family(2, 2, influence=lambda r, d: 1.5 - r), "influence.*negative"),
        (lambda: pd.lattice_family(2, 2, influence=lambda r, d: 0 * r), "influence.*zero everywhere"),
        (lambda: pd.lattice_family(2, 2, influence=lambda r, d: 1 / (r - 1)), "influence.*finite"),
        (lambda: pd.lattice_family(2, 1, influence=pd.linear_influence), "linear_influence.*zero everywhere"),
        (lambda: pd.lattice_family(1, 2).with_weight(jnp.full(3, 0.5)), r"weight must have shape \(bonds\) = \(4,\)"),
        (lambda: pd.lattice_family(1, 2).with_weight(jnp.full(4, -0.1)), "weights"),
        (lambda: pd.lattice_family(1, 2).with_weight(jnp.full(4, jnp.nan)), "weights"),
        (lambda: pd.lattice_family(1, 2).with_weight(jnp.array([1.0, 1.0, 0.5, 1.0])), "weights.*even"),
        (lambda: pd.families(pd.lattice((5, 3), 0.5), 0.49), "horizon.*at least one spacing"),
        (lambda: pd.families(PAIR, np.inf), "horizon.*finite"),
        (lambda: pd.families(PAIR, np.nan), "horizon.*finite"),
        (lambda: pd.families(PAIR, 0.0), "horizon"),
        (lambda: pd.families(PAIR, -1.0), "horizon"),
        (lambda: pd.families(PAIR, 0.9), "horizon 0.9; point 0 has none"),
        (lambda: pd.families(pd.cloud([[0.0], [1.0], [5.0]], 1.0), 1.5), "point 2 has none"),
        (lambda: pd.families(pd.cloud([[0.0], [0.0]], 1.0), 1.5), "positions must be distinct; points 0 and 1"),
        (lambda: pd.families(pd.cloud([[0.0, 0], [1, 0], [1, 0]], 1.0), 1.5), "points 1 and 2 coincide"),
        (lambda: pd.families(pd.lattice((5, 4), periodic=True), 2.0), "periodic box"),
        (lambda: pd.families(pd.lattice((9, 2), periodic=(False, True)), 1.5), "periodic box"),
        (lambda: pd.families(PAIR, 1.5, lambda r, d: -r), "influence.*negative"),
        (lambda: pd.families(PAIR, 1.5).with_weight(jnp.full((2, 1), -0.1)), "weights"),
        (
            lambda: pd.families(PAIR, 1.5).with_weight(jnp.full((3, 1), 0.1)),
            r"weight must have shape \(points, bonds\)",
        ),
    ],
)
def test_wrong_use_names_the_argument(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_a_horizon_cannot_be_traced():
    with pytest.raises(ValueError, match=r"horizon.*traced"):
        jax.jit(lambda h: inspect.unwrap(pd.families)(PAIR, h).xi)(1.5)


@pytest.mark.parametrize(
    "build, bad, message",
    [
        (lambda c: pd.lattice_family(2, 2, influence=lambda r, d: c * r), -1.0, "influence"),
        (lambda c: pd.lattice_family(2, 2, spacing=c), -1.0, "spacing"),
        (lambda c: pd.lattice_family(1, 2).with_weight(c * jnp.ones(4)), jnp.inf, "bond weights"),
        (lambda c: bodies.families(1, "cloud").with_weight(c * jnp.ones((7, 6))), -0.5, "bond weights"),
    ],
)
def test_wrong_values_that_are_traced_raise_at_run_time(build, bad, message):
    built = eqx.filter_jit(build)
    jax.block_until_ready(built(jnp.asarray(0.5)))
    with pytest.raises(RuntimeError, match=message):
        jax.block_until_ready(built(jnp.asarray(bad)))
