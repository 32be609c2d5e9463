"""Tests of the grid and the search of the Brillouin zone.

A **corner** is a half-reciprocal point: a wave vector with components 0 or π. To **fold** the zone is to reduce it by
symmetry. The comment beside a tolerance is the largest measured error (float64).
"""

import functools
import itertools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_bloch import Peer, difference, random, seth_hill_state

import pdjax as pd
from pdjax.infinite_lattice import brillouin as zone
from pdjax.infinite_lattice import cosine_series
from pdjax.infinite_lattice.bloch import homogeneous_tangent, wave_phases
from pdjax.infinite_lattice.climb import _gradient_and_hessian, climb
from pdjax.infinite_lattice.cosine_series import Forms

# ---------------------------------------------------------------- the grid


def fold(index, symmetry):
    """The representative of integer wave vectors under inversion and the given symmetry."""
    if symmetry == "inversion":
        return index
    index = np.abs(index)
    if symmetry == "cubic":
        return -np.sort(-index, axis=1)
    if symmetry == "tetragonal":
        return np.concatenate([index[:, :1], -np.sort(-index[:, 1:], axis=1)], axis=1)
    return index


GRIDS = list(itertools.product((1, 2, 3), (2, 3, 8, 25), zone.SYMMETRIES))


@pytest.mark.parametrize(("dim", "intervals", "symmetry"), GRIDS)
def test_grid_holds_one_of_every_orbit_and_the_half_reciprocal_points_exactly(dim, intervals, symmetry):
    """The grid holds the integer wave vectors −n < i ≤ n up to inversion and the symmetry. Its components 0 and π are
    exact."""
    z = zone.brillouin_zone(dim, intervals, symmetry)
    index = np.rint(z.grid / z.step).astype(int)
    assert np.max(np.abs(z.grid - index * z.step)) < 1e-15  # 4e-16
    have = set(map(tuple, index))
    assert len(have) == len(index) and (0,) * dim not in have
    whole = np.array(list(itertools.product(range(-intervals + 1, intervals + 1), repeat=dim)))
    for image in fold(whole[(whole != 0).any(axis=1)], symmetry):
        mirror = np.where(np.abs(image) == intervals, intervals, -image)  # −π is π
        assert tuple(image) in have or tuple(mirror) in have
    for corner in fold(zone.half_reciprocal_points(dim), symmetry):
        assert np.any(np.all(z.grid == corner, axis=1))
    assert symmetry == "inversion" or len(have) == len(set(map(tuple, fold(index, symmetry))))


@pytest.mark.parametrize(("dim", "intervals", "symmetry"), GRIDS)
def test_every_grid_point_is_in_one_class_of_equal_nearest_corner_and_signs(dim, intervals, symmetry):
    z = zone.brillouin_zone(dim, intervals, symmetry)
    assert np.array_equal(np.unique(z.members), np.arange(len(z.grid)))
    counted = np.zeros(len(z.grid), dtype=int)
    for row in z.members:
        mine = z.grid[np.unique(row)]
        counted[np.unique(row)] += 1
        assert len(np.unique(np.abs(mine) > np.pi / 2 + 1e-12, axis=0)) == 1
        inner = (mine != 0) & (np.abs(mine) < np.pi)
        for column, some in zip(mine.T, inner.T, strict=True):
            assert len(np.unique(np.sign(column[some]))) <= 1
    assert np.all(counted == 1)


def test_half_reciprocal_points():
    for dim in (1, 2, 3):
        corners = zone.half_reciprocal_points(dim)
        assert corners.shape == (2**dim - 1, dim) and len(np.unique(corners, axis=0)) == 2**dim - 1
        assert set(np.unique(corners)) <= {0.0, np.pi} and corners.any(axis=1).all()
    with pytest.raises(ValueError, match="dim"):
        zone.half_reciprocal_points(4)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_directions_cover_half_a_sphere_with_the_axes(dim):
    """They are unit vectors, no two are opposite, and every direction is within 11 degrees of one of them."""
    n = zone.directions(dim)
    assert np.max(np.abs(np.linalg.norm(n, axis=1) - 1)) < 1e-15  # 2e-16
    overlap = n @ n.T
    assert np.min(overlap) > -1 + 1e-6
    assert np.min(np.max(np.abs(np.eye(dim) @ n.T), axis=1)) > 1 - 1e-15
    probes = random(1, dim).normal(size=(500, dim))
    probes /= np.linalg.norm(probes, axis=1, keepdims=True)
    nearest = np.degrees(np.arccos(np.clip(np.max(np.abs(probes @ n.T), axis=1), 0, 1)))
    assert np.max(nearest) < 11  # 9.2 degrees in 3D, 1.9 in 2D


# ---------------------------------------------------------------- folding keeps the maxima


@pytest.mark.parametrize(
    ("dim", "N", "stretches", "symmetry"),
    [
        (2, 3, (0.9, 0.9), "cubic"),
        (2, 3, (0.9, 1.1), "orthorhombic"),
        (3, 2, (1.1, 1.1, 1.1), "cubic"),
        (3, 2, (0.8, 1.05, 1.05), "tetragonal"),
        (3, 2, (0.9, 1.2, 1.0), "orthorhombic"),
    ],
)
def test_folding_keeps_every_eigenvalue(dim, N, stretches, symmetry):
    """λ_max of the NumPy peer is the same at every wave vector of the whole grid and at its image on the folded one."""
    F, n = np.diag(stretches), 8
    whole, folded = (zone.brillouin_zone(dim, n, s) for s in ("inversion", symmetry))
    assert len(folded.grid) < 0.7 * len(whole.grid)
    image = fold(np.rint(whole.grid / whole.step).astype(int), symmetry) * whole.step
    assert set(map(tuple, np.rint(image / whole.step))) == set(map(tuple, np.rint(folded.grid / whole.step)))
    peer = Peer(dim, N, F, seth_hill_state(dim, N, 0.3))
    assert difference(peer.top(image), peer.top(whole.grid)) < 1e-13  # 2e-15
    sheared = Peer(dim, N, F + 0.3 * np.eye(dim, k=1), seth_hill_state(dim, N, 0.3))
    assert difference(sheared.top(image), sheared.top(whole.grid)) > 0.1  # A sheared lattice has no such symmetry.


def test_kept_symmetry_is_read_off_a_concrete_deformation():
    from pdjax.infinite_lattice.criteria import kept_symmetry

    fam = pd.lattice_family(3, 1.5)
    cases = {
        "cubic": np.diag([0.9] * 3),
        "tetragonal": np.diag([0.9, 1.1, 1.1]),
        "orthorhombic": np.diag([1.1, 1.1, 0.9]),
        "inversion": np.eye(3) + 1e-12 * np.eye(3, k=1),
    }
    for expected, F in cases.items():
        assert kept_symmetry(jnp.asarray(F), fam, True) == expected
        assert kept_symmetry(jnp.asarray(F), fam.with_weight(jnp.full(18, 0.5)), True) == "inversion"
    seen = []
    jax.make_jaxpr(lambda F: seen.append(kept_symmetry(F, fam, True)) or F)(jnp.eye(3))
    assert seen == ["inversion"]


def test_uneven_bonds_are_searched_over_the_whole_zone():
    """Halving the weight of the bonds near one axis or near the other gives one margin and a turned wave vector."""
    fam, model = pd.lattice_family(2, 2), pd.SethHill(0.8, pd.LinearElastic(1.0, 1.0))
    x, y = np.abs(np.asarray(fam.xi)).T
    found = [
        pd.stability(model, fam.with_weight(jnp.where(along, 0.5, 1.0)), 0.9 * np.eye(2)) for along in (x > y, y > x)
    ]
    first, second = (np.asarray(s.wave_vector) for s in found)
    assert abs(float(found[0].margin) - float(found[1].margin)) < 1e-12  # 4e-17
    assert np.max(np.abs(np.abs(first) - np.abs(second[::-1]))) < 1e-6  # 0
    assert abs(abs(first[0]) - abs(first[1])) > 1  # Not on the diagonal, so that a folded zone would miss one.


# ---------------------------------------------------------------- eigenvalues: screen and verdict


@given(seed=st.integers(0, 2**32 - 1), dim=st.integers(1, 3))
def test_closed_form_eigenvalue_of_simple_roots(seed, dim):
    """For well separated roots the closed form is accurate to rounding."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    values = np.array([1.0, -0.7, 0.2])[:dim] + rng.uniform(-0.2, 0.2, dim)
    A = Q @ np.diag(values) @ Q.T
    screen = zone.largest_eigenvalue([[jnp.asarray(a) for a in row] for row in A])
    assert abs(float(screen) - values.max()) < 1e-14  # 7e-16


@pytest.mark.parametrize("split", [0.0, 1e-12, 1e-8])
@pytest.mark.parametrize("values", [(1.0, 1.0, -0.5), (1.0, -0.5, -0.5), (2.0, 2.0, 2.0), (0.0, 0.0, 0.0)])
def test_closed_form_eigenvalue_loses_half_the_digits_at_double_roots_only(values, split):
    """For randomly turned 2×2 and 3×3 matrices the error is never worse than √eps, and the value is finite."""
    rng = random(2)
    for dim in (2, 3):
        for _ in range(20):
            Q = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
            roots = np.array(values[:dim]) + split * np.arange(dim)
            A = Q @ np.diag(roots) @ Q.T
            screen = float(zone.largest_eigenvalue([[jnp.asarray(a) for a in row] for row in A]))
            assert abs(screen - roots.max()) < 1e-7  # 6e-9
            assert abs(float(zone.top_pair(jnp.asarray(A))[0]) - roots.max()) < 1e-14  # 2e-15


def test_largest_eigenvalue_of_a_multiple_of_the_identity_is_exact():
    """The cubic formula has 0/0 there. Its NaN once made the tolerance NaN and the verdict "marginal"."""
    for size in (0.0, 1e-200, -3.0, 1e200):
        A = [[jnp.asarray(size * (i == j)) for j in range(3)] for i in range(3)]
        assert float(zone.largest_eigenvalue(A)) == size
    fam = pd.lattice_family(3, 1.5)
    s = pd.stability(pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), fam, 0.5 * np.eye(3))
    assert s.verdict == "unstable" and abs(float(s.margin) - 0.625) < 1e-12  # 3e-16


def test_screened_eigenvalues_of_symbols_equal_those_of_eigh():
    """`components` and the closed form agree with eigh of the NumPy peer, also at the double roots of the corners."""

    for dim, N, grid in ((1, 3, 24), (2, 3, 16), (3, 1.5, 8)):
        F = 0.9 * np.eye(dim)
        fam, model = pd.lattice_family(dim, N), pd.SethHill(0.3, pd.LinearElastic(1.3, 0.7))
        k = zone.brillouin_zone(dim, grid, "cubic").grid
        parts = jax.jit(
            lambda model, fam, F, k: zone.largest_eigenvalue(
                homogeneous_tangent(model, fam, F).components(wave_phases(fam, k))
            )
        )(model, fam, F, jnp.asarray(k))
        top = Peer(dim, N, F, seth_hill_state(dim, N, 0.3)).top(k)
        assert difference(parts, top) < 1e-7  # 8e-9, at double roots


# ---------------------------------------------------------------- climbing


def test_class_starts_are_the_best_of_each_class():
    z = zone.brillouin_zone(2, 6, "inversion")
    screen = random(3).normal(size=len(z.grid))
    for best, row in zip(np.asarray(zone.class_best(z, jnp.asarray(screen))), z.members, strict=True):
        assert best in row and screen[best] == screen[row].max()


def cone(x):
    """[[x, y], [y, −x]] − |x|² I with its derivatives, so that λ_max = |x| − |x|²."""
    eye, spread = np.eye(2), np.array([[[1.0, 0], [0, -1]], [[0, 1], [1, 0]]])
    A = jnp.einsum("...a,aij->...ij", x, spread) - jnp.sum(x**2, axis=-1)[..., None, None] * eye
    A1 = spread - 2 * x[..., :, None, None] * eye
    A2 = jnp.broadcast_to(-2 * eye[:, :, None, None] * eye, (*A.shape[:-2], 2, 2, 2, 2))
    one = jnp.ones(x.shape[:-1])
    return Forms(A, A1, A2, one, 0 * x, jnp.zeros((*x.shape, 2)))


@pytest.mark.parametrize("start", [(0.7, 0.2), (0.05, -0.03), (-0.4, 0.9)])
def test_climb_over_a_crossing_of_eigenvalues(start):
    """λ_max = |x| − |x|² has a ring of maxima ¼ around the double root at 0, where it has no derivative."""
    v = np.linalg.eigh(np.asarray(cone(jnp.asarray(start)).A))[1][:, -1]
    x, v, q = climb(cone, jnp.asarray(start), jnp.asarray(v), 0.1)
    assert abs(float(q) - 0.25) < 1e-15  # 6e-17
    assert abs(np.linalg.norm(x) - 0.5) < 1e-8  # 1e-16
    assert abs(np.linalg.norm(v) - 1) < 1e-15


def test_the_derivatives_of_a_climb_are_those_of_the_quotient():
    """The gradient and Hessian over (x, v) that `climb` computes agree with autodiff of the quotient."""
    draw = np.random.default_rng(2)
    offsets = cosine_series.reached(2, 8, 2)
    blocks = draw.normal(size=(1, len(offsets), 3))
    known, traced = (cosine_series.Series.of(x, offsets) for x in (blocks, jnp.asarray(blocks)))
    for long, bare in ((False, False), (True, False), (False, True)):
        flags = np.array([long]), np.array([bare])
        x, v = draw.normal(size=2), draw.normal(size=2)
        v /= np.linalg.norm(v)

        def quotient(y, flags=flags):
            f = cosine_series.forms(traced, y[None, None, :2], *flags)
            return y[2:] @ f.A[0, 0] @ y[2:] / (y[2:] @ y[2:]) / f.scale[0, 0]

        _, g, H = _gradient_and_hessian(cosine_series.forms(known, x[None, None], *flags), v[None, None])
        slope, curvature = jax.jit(lambda y: (jax.grad(quotient)(y), jax.hessian(quotient)(y)))(np.concatenate([x, v]))
        assert difference(g[0, 0], slope) < 1e-13  # 2e-15
        assert difference(H[0, 0], curvature) < 1e-13  # 2e-15


def test_a_climb_that_meets_nan_stays_where_it_was():
    start = jnp.array([0.3, 0.4])
    v = jnp.array([1.0, 0.0])

    def broken(x):
        good = jnp.all(x == start)
        return jax.tree.map(lambda a: jnp.where(good, a, jnp.nan), cone(x))

    found, _, q = climb(broken, start, v, 0.1)
    assert np.array_equal(found, start) and np.isfinite(q)
    assert climb(broken, start + 1, v, 0.1)[2] == -np.inf


@pytest.mark.parametrize(("dim", "N"), [(1, 3), (2, 2.3), (3, 1.5)])
@pytest.mark.parametrize("name", ["seth_hill", "silling", "littlewood", "bond_level", "energy_alone"])
def test_the_cosine_series_is_the_symbol(name, dim, N, law):
    """The series of every kind of tangent gives the symbol at short and at long waves."""
    model = {
        "seth_hill": pd.SethHill(0.3, law),
        "silling": pd.Correspondence(law, pd.SillingControl(1.0)),
        "littlewood": pd.Correspondence(law, pd.LittlewoodControl(0.1)),
        "bond_level": pd.BondLevel(law),
        "energy_alone": EnergyAlone(),
    }[name]
    fam, draw = pd.lattice_family(dim, N), np.random.default_rng(dim)
    F = jnp.asarray(0.95 * np.eye(dim) + 0.03 * draw.normal(size=(dim, dim)))
    tangent, bonds = eqx.filter_jit(homogeneous_tangent)(model, fam, F), len(fam.xi)
    offsets = cosine_series.reached(dim, bonds, tangent.rings)
    blocks = np.asarray(cosine_series.series(tangent, dim, bonds))
    k = draw.uniform(-np.pi, np.pi, (20, dim))
    k[0] *= 1e-4
    exact = np.asarray(eqx.filter_jit(lambda tangent, k: tangent(wave_phases(fam, k)))(tangent, jnp.asarray(k)))
    for one, other in zip(exact, cosine_series.symbols(blocks, offsets, k), strict=True):
        assert difference(other, one) < 1e-13  # 1.5e-15
    axes = [np.linspace(0, np.pi, 4)] + [np.linspace(-2, 3, 5)] * (dim - 1)
    packed = cosine_series.packed(jnp.asarray(blocks))
    grid = np.stack([x.reshape(-1) for x in np.meshgrid(*axes, indexing="ij")], axis=1)
    whole = cosine_series.symbols(np.asarray(packed), offsets, grid)
    found = np.asarray(cosine_series.on_grid(packed, offsets, axes)).reshape(packed.shape[1], -1).T
    assert difference(found, whole) < 1e-13  # 1.2e-15


class EnergyAlone(pd.AbstractModel):
    """Springs and the square of a sum, defined by an energy alone, so that the tangent is dense."""

    def energy(self, bonds):
        growth = jnp.sum((bonds.xi + bonds.eta) ** 2, -1) - jnp.sum(bonds.xi**2, -1)
        total = jnp.sum(bonds.volume * jnp.sum(bonds.eta**2, -1))
        return jnp.sum(bonds.omega * bonds.volume * growth**2) + total**2


# ---------------------------------------------------------------- resolution


def hydrostatic(a):
    return (1 + a) * np.eye(2)


# (m, F, λ, μ) in 2D with N = 3: flat and narrow maxima near half-reciprocal points, near ties, and limits k → 0.
STATES = {
    "flat -1e-2": (-0.5, hydrostatic(-1e-2), 1.0, 1.0),
    "flat -1e-4": (-0.5, hydrostatic(-1e-4), 1.0, 1.0),
    "flat 1e-3": (-0.5, hydrostatic(1e-3), 1.0, 1.0),
    "Hencky": (0.0, hydrostatic(-0.05), 1.0, 1.0),
    "tension": (0.3, hydrostatic(0.2), 1.0, 1.0),
    "compression": (1.0, hydrostatic(-0.3), 1.0, 1.0),
    "window": (-2.0, np.diag([0.8, 1.0]), 3.0, 1.0),
    "stable": (2.0, np.array([[1.1, 0.05], [0.0, 1.02]]), 1.3, 0.7),
    "general": (-0.3, np.array([[1.1, 0.2], [-0.1, 0.9]]), 1.3, 0.7),
    "tie": (1.0, hydrostatic(-6.5059e-4), -0.4, 1.0),
    "ridge": (1.0, np.diag([0.9997369136, 1.0]), 1.3, 0.7),
    "far ridge": (2.0, np.array([[0.997490331, 0.000851509], [0.002744805, 1.002717317]]), 3.0, 1.0),
    "fastest": (0.2, hydrostatic(-1.7626e-4), -0.4, 1.0),
}


@functools.cache
def searched(resolution):
    """{state: (margin, eigenvalue, tolerance)} of `pd.stability`, compiled once. F is traced, so the zone is whole."""
    fam = pd.lattice_family(2, 3)

    def one(m, F, lam, mu):
        s = pd.stability(pd.SethHill(m, pd.LinearElastic(lam, mu)), fam, F, resolution=resolution)
        return jnp.stack([s.margin, s.eigenvalue, s.tolerance])

    columns = (np.array(x) for x in zip(*STATES.values(), strict=True))
    return dict(zip(STATES, np.asarray(jax.jit(jax.vmap(one))(*columns)), strict=True))


@pytest.mark.parametrize("name", STATES)
def test_default_resolution_has_six_digits(name):
    """Margin and largest eigenvalue agree at 24 intervals, at 48 intervals, and in the search of the NumPy peer."""
    m, F, lam, mu = STATES[name]
    (margin, value, tolerance), (finer, finer_value, _) = searched(None)[name], searched(48)[name]
    peer = Peer(2, 3, F, seth_hill_state(2, 3, m, lam, mu))
    exact = max(peer.supremum(peer.quotient, 64)[0], peer.long_wave_supremum()[0])
    assert abs(margin / exact - 1) < 1e-6  # 2e-14
    assert abs(margin / finer - 1) < 1e-6  # 2e-15
    if margin > tolerance:
        assert abs(value / peer.supremum(peer.top, 64)[0] - 1) < 1e-6  # 3e-15
        assert abs(value / finer_value - 1) < 1e-6  # 3e-15


def test_resolution_is_checked_and_reported():
    fam, model = pd.lattice_family(1, 3), pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    assert zone.default_intervals(3.0) == zone.default_intervals(2.1) == 24 and zone.default_intervals(1.0) == 8
    for bad in (1, 0, -3):
        with pytest.raises(ValueError, match="resolution"):
            pd.stability(model, fam, np.eye(1), resolution=bad)
    assert difference([pd.stability(model, fam, 0.9 * np.eye(1), resolution=10).resolution], [10]) == 0
