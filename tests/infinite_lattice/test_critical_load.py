"""Tests of critical loads and of stable orders, and of their derivatives, against independent computations."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.infinite_lattice.brillouin import half_reciprocal_points
from pdjax.studies import closed_forms

STIFF = pd.LinearElastic(lam=3.0, mu=1.0)


def brute_margin(model, fam, F, points=81):
    """sup of λ_max(Ĵ)/(M κ²) over a dense grid of half of the zone, with the eigenvalues of NumPy."""
    axis = np.linspace(-np.pi, np.pi, points)
    k = np.stack(np.meshgrid(np.linspace(0, np.pi, points // 2 + 1), axis, indexing="ij"), -1).reshape(-1, 2)
    k = k[np.abs(k).max(axis=1) > 1e-9]
    top = np.linalg.eigvalsh(np.asarray(pd.symbol(model, fam, F, k)))[:, -1]
    return (top / (4 * np.sin(k / 2) ** 2).sum(axis=1)).max() / float(pd.p_wave_modulus(model, fam))


@pytest.mark.parametrize("N", [1, 2, 3])
def test_diagonal_in_1d_is_the_closed_form_over_m(N, law):
    fam = pd.lattice_family(1, N)
    orders = jnp.array([-1.0, 0.0, 0.3, 0.5, 1.0, 2.0])
    for side in ("negative", "positive"):
        found = np.array([pd.critical_load(pd.SethHill(m, law), fam, criterion="diagonal", side=side) for m in orders])
        exact = np.array([closed_forms.critical_load_1d(m, N) for m in orders])
        limit = -0.9 if side == "negative" else 1.0
        here = (exact * np.sign(limit) > 0) & (np.abs(exact) < abs(limit))
        # measured 3e-16
        np.testing.assert_allclose(found[here], exact[here], atol=1e-13)
        assert (found[~here] == np.sign(limit) * np.inf).all()


@pytest.mark.parametrize(("dim", "N"), [(2, 3), (3, 2)])
def test_hydrostatic_diagonal_is_the_closed_form(dim, N):
    fam = pd.lattice_family(dim, N)
    for m, side in ((1.0, "negative"), (-0.8, "positive")):
        found = float(pd.critical_load(pd.SethHill(m, STIFF), fam, criterion="diagonal", side=side))
        exact = float(closed_forms.lattice_critical_load(m, dim, N, 3.0, 1.0))
        assert found == pytest.approx(exact, abs=1e-12)  # measured 1e-16


def test_critical_load_of_the_symbol_is_where_a_dense_scan_changes_sign():
    """In 2D with N = 3 and λ/μ = 3 these are two of the few sides with a non-zero critical load."""
    fam = pd.lattice_family(2, 3)
    for m, side, about in ((-2.0, "negative", -0.1522), (0.4, "positive", 0.7765)):
        model = pd.SethHill(m, STIFF)
        load = float(pd.critical_load(model, fam, pd.uniaxial_strain, "symbol", side))
        assert load == pytest.approx(about, abs=1e-4)
        inside, outside = (brute_margin(model, fam, pd.uniaxial_strain(f * load, model, fam)) for f in (0.995, 1.005))
        assert inside < 0 < outside, (m, inside, outside)


def test_a_path_written_by_a_user_has_the_critical_load_of_the_built_in_path(law):
    """The function of the user has no attribute `symmetry`, so that the whole zone is searched."""
    fam, model = pd.lattice_family(2, 2), pd.SethHill(1.0, law)

    def grow(a, model, fam):
        return jnp.diag(jnp.array([1.0 + a, 1.0 + a]))

    mine = float(pd.critical_load(model, fam, grow, "block", "negative"))
    assert mine == pytest.approx(float(pd.critical_load(model, fam, pd.hydrostatic, "block", "negative")), abs=1e-12)
    assert float(pd.critical_load(model, fam, grow, "block", "negative", limit=abs(mine) / 2)) == -np.inf


def test_critical_loads_of_both_signs_of_shear_are_opposite(law):
    """m = 1 is one of the few orders that are stable under small shear."""
    fam, model = pd.lattice_family(2, 3), pd.SethHill(1.0, law)
    left, right = (float(pd.critical_load(model, fam, pd.simple_shear, "symbol", s)) for s in ("negative", "positive"))
    assert left == pytest.approx(-right, abs=1e-10) and right == pytest.approx(0.125704, abs=1e-5)
    inside, outside = (brute_margin(model, fam, pd.simple_shear(f * right, model, fam)) for f in (0.97, 1.03))
    assert inside < 0 < outside


def slope_by_differences(model, fam, path, sign, a=1e-6):
    """max over half-reciprocal k of λ_max(Ĵ(k; a))/(M κ² a). At rest Ĵ is 0 at these points."""
    k = half_reciprocal_points(fam.dim)
    top = np.linalg.eigvalsh(np.asarray(pd.symbol(model, fam, path(sign * a, model, fam), k)))[:, -1]
    return (top / (4 * np.sin(k / 2) ** 2).sum(axis=1)).max() / a / float(pd.p_wave_modulus(model, fam))


@pytest.mark.parametrize("path", [pd.hydrostatic, pd.uniaxial_strain, pd.uniaxial_stress, pd.simple_shear])
def test_load_slope_is_the_rate_of_the_worst_half_reciprocal_wave(path, law):
    fam = pd.lattice_family(2, 3)
    for m, side, sign in ((0.0, "negative", -1.0), (1.3, "positive", 1.0)):
        model = pd.SethHill(m, law)
        exact = slope_by_differences(model, fam, path, sign)
        # The forward difference has a step of 1e-6. Measured error: 1e-6 of slopes of about 0.2.
        assert float(pd.load_slope(model, fam, path, side)) == pytest.approx(exact, abs=1e-5)


@pytest.mark.parametrize(
    ("dim", "compression", "tension"), [(2, -0.531165, 0.257556), (3, -0.781886, -0.175401)], ids=["2D", "3D"]
)
def test_stable_orders_under_hydrostatic_load_end_at_the_closed_form(dim, compression, tension, law):
    """For N = 3 the ends are the same for two laws."""
    fam = pd.lattice_family(dim, 3)
    closed = closed_forms.hydrostatic_thresholds(dim, 3)
    for which in (law, STIFF):
        negative = pd.stable_orders(fam, which, side="negative")
        positive = pd.stable_orders(fam, which, side="positive")
        assert negative[0] == -np.inf and positive[1] == np.inf
        assert (negative[1], positive[0]) == pytest.approx((compression, tension), abs=1e-6)
        # measured 1e-15
        assert (negative[1], positive[0]) == pytest.approx([float(x) for x in closed], abs=1e-12)


def test_orders_under_uniaxial_strain_depend_on_the_law(law):
    """The ends are where the growth of the worst wave changes sign, computed by differences."""
    fam = pd.lattice_family(2, 3)
    ends = {}
    for name, which in (("soft", law), ("stiff", STIFF)):
        low, high = pd.stable_orders(fam, which, pd.uniaxial_strain, "positive")
        assert high == np.inf
        below, above = (
            slope_by_differences(pd.SethHill(low + d, which), fam, pd.uniaxial_strain, 1.0) for d in (-1e-3, 1e-3)
        )
        assert below > 0 > above
        ends[name] = low
    assert ends["soft"] == pytest.approx(0.438665, abs=1e-5) and ends["stiff"] == pytest.approx(0.333501, abs=1e-5)


def test_no_order_is_stable_in_shear(law):
    assert np.isnan(pd.stable_orders(pd.lattice_family(2, 3), law, pd.simple_shear, "positive")).all()


DIAGONAL = dict(path=pd.hydrostatic, criterion="block", side="negative")  # a double eigenvalue: the block is c I
SYMBOL = dict(path=pd.uniaxial_strain, criterion="symbol", side="negative")


def load_of(theta, options):
    """The critical load as a function of theta = (m, λ, μ, width of a Gaussian influence)."""
    m, lam, mu, width = theta
    fam = pd.lattice_family(2, 3, influence=partial(pd.gaussian_influence, width=width))
    return pd.critical_load(pd.SethHill(m, pd.LinearElastic(lam, mu)), fam, **options)


@pytest.mark.parametrize(
    ("options", "theta", "tolerance"),
    [
        # Measured errors of central differences of step 1e-4: block 4e-9 of derivatives up to 0.03, symbol 3e-7 of 0.3.
        (DIAGONAL, (1.0, 1.0, 1.0, 0.6), 1e-7),
        (SYMBOL, (-2.0, 3.0, 1.0, 3.0), 1e-5),
    ],
    ids=["block, double eigenvalue", "symbol"],
)
def test_derivatives_are_central_differences(options, theta, tolerance):
    theta = np.array(theta)
    load = partial(load_of, options=options)
    assert np.isfinite(load(theta)) and load(theta) != 0
    forward = np.asarray(jax.jacfwd(load)(jnp.asarray(theta)))
    reverse = np.asarray(jax.grad(load)(jnp.asarray(theta)))
    steps = 1e-4 * np.eye(4)
    differences = np.array([(float(load(theta + s)) - float(load(theta - s))) / 2e-4 for s in steps])
    np.testing.assert_allclose(forward, differences, atol=tolerance)
    np.testing.assert_allclose(reverse, forward, atol=1e-12)
    assert np.abs(differences).max() > 1e-3


def test_vmapped_critical_loads_equal_a_loop(law):
    fam = pd.lattice_family(2, 3)

    def load(m):
        return pd.critical_load(pd.SethHill(m, law), fam, criterion="diagonal", side="negative")

    orders = jnp.array([0.4, 1.0, 2.0])
    np.testing.assert_allclose(jax.jit(jax.vmap(load))(orders), [float(load(m)) for m in orders], atol=1e-13)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"side": "left"}, "side must be one of"),
        ({"criterion": "trace"}, "criterion must be one of"),
        ({"limit": 1.0}, "limit must lie between"),
        ({"limit": np.nan}, "limit must lie between"),
        ({"path": None}, "path must be a function"),
        ({"resolution": 1}, "resolution must be an integer"),
    ],
)
def test_bad_input_names_the_argument(change, words, law):
    with pytest.raises(ValueError, match=words):
        pd.critical_load(pd.SethHill(1.0, law), pd.lattice_family(2, 3), **change)


@pytest.mark.parametrize(("m", "side"), [(-2.0, "negative"), (0.4, "positive")])
def test_critical_load_inside_jit_and_vmap_equals_the_eager_one(m, side):
    """The eager search ends with a secant on the host, the traced search with a Newton step."""
    fam = pd.lattice_family(2, 3)

    def load(m):
        return pd.critical_load(pd.SethHill(m, STIFF), fam, pd.uniaxial_strain, "symbol", side)

    plain = float(load(m))
    assert float(jax.jit(load)(m)) == pytest.approx(plain, abs=1e-11)  # 1e-12, at a slope of 1e-3
    batch = jax.vmap(load)(jnp.array([m, 1.01 * m]))
    assert float(batch[0]) == pytest.approx(plain, abs=1e-11)
    assert float(batch[1]) == pytest.approx(float(load(1.01 * m)), abs=1e-11)


def test_concrete_states_are_evaluated_inside_a_jit_of_other_values(law):
    """Results that depend on concrete values only are not traced inside a jit of the user."""
    fam, model = pd.lattice_family(1, 2), pd.SethHill(0.3, law)

    def scaled(x):
        state = pd.stability(model, fam, 0.98 * np.eye(1))
        load = pd.critical_load(model, fam, criterion="diagonal")
        return x * state.margin, x * load, x * pd.center_block(model, fam, np.eye(1)), x * pd.p_wave_modulus(model, fam)

    for inside, outside in zip(jax.jit(scaled)(2.0), scaled(2.0), strict=True):
        np.testing.assert_allclose(inside, outside, rtol=1e-13)  # 1e-15


def test_a_side_has_two_names():
    family, model = pd.lattice_family(1, 2), pd.SethHill(0.0, pd.LinearElastic(1.0, 0.0))
    loads = [
        float(pd.critical_load(model, family, criterion="diagonal", side=side))
        for side in ("negative", "compression", "positive", "tension")
    ]
    assert loads[0] == loads[1] < 0 < loads[2] == loads[3]
