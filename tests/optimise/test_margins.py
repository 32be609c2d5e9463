"""Tests of the worst margin over load cases, its smooth bound, and their derivatives."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from table import MODELS, in_dimensions

import pdjax as pd
from pdjax.infinite_lattice.brillouin import brillouin_zone
from pdjax.optimise.margins import log_trace, sampled

LAW = pd.LinearElastic(1.3, 0.7)


def model_of(g, m=1.0):
    return pd.SethHill(m, LAW, pd.SillingControl(g))


@pytest.mark.parametrize("dim", [1, 2])
def test_worst_margin_is_the_largest_margin_of_stability(dim):
    family, model = pd.lattice_family(dim, 2), model_of(0.03)
    cases = pd.load_cases([p for n, p in pd.PATHS.items() if dim > 1 or n != "simple-shear"], [-0.05, 0.02])
    each = [float(pd.stability(model, family, F).margin) for F in np.asarray(cases(model, family))]
    assert abs(float(pd.worst_margin(model, family, cases)) - max(each)) < 1e-12  # measured 0 to 2e-15
    assert float(pd.worst_margin(model, family, cases(model, family))) == float(pd.worst_margin(model, family, cases))
    inside = jax.jit(lambda g: pd.worst_margin(model_of(g), family, cases))(0.03)
    assert abs(float(inside) - max(each)) < 1e-9  # measured 2e-16 to 3e-12


CASES = [
    (1, 2, ["hydrostatic"], None),
    (2, 2, ["hydrostatic", "uniaxial-stress"], None),
    (2, 2, ["hydrostatic", "simple-shear"], 50.0),
    pytest.param(3, 1.8, ["uniaxial-strain"], 50.0, marks=pytest.mark.long),
]


@pytest.mark.parametrize(("dim", "N", "paths", "sharpness"), CASES)
def test_derivative_of_the_worst_margin_is_its_central_difference(dim, N, paths, sharpness):
    family, cases = pd.lattice_family(dim, N), pd.load_cases(paths, [-0.04, 0.03])

    def margin(x):
        return pd.worst_margin(model_of(x[0], x[1]), family, cases, sharpness=sharpness)

    x = jnp.array([0.07, 0.6])
    slope = np.asarray(jax.grad(margin)(x))
    step = 1e-5 * np.eye(2)
    central = np.array([(float(margin(x + e)) - float(margin(x - e))) / 2e-5 for e in step])
    assert np.abs(slope - central).max() < 2e-7 * max(1.0, np.abs(central).max())  # measured up to 3e-9


QUICK = ("lps", "shell control")
KINDS = [
    pytest.param(name, dim, marks=() if name in QUICK and dim == 2 else pytest.mark.long)
    for name, dim in in_dimensions(dims=(1, 2))
]


@pytest.mark.parametrize(("name", "dim"), KINDS)
@pytest.mark.parametrize("sharpness", [None, pytest.param(60.0, marks=pytest.mark.long)])
def test_derivative_in_all_constants_of_every_model_is_its_central_difference(name, dim, sharpness):
    """Along a random direction of all constants of the model and of the deformation.

    With m = 1 the worst wave can be one on which the material part of the symbol vanishes. Its eigenvalue is then
    repeated, the margin has a kink, and the derivative lies between the one-sided ones.
    """
    model = MODELS[name]
    if sharpness is not None and not model.hyperelastic:
        pytest.skip("the aggregate needs a symmetric symbol")
    family, rng = pd.lattice_family(dim, 2), np.random.default_rng(3)
    F = np.stack([np.eye(dim) + 0.04 * rng.uniform(-1, 1, (dim, dim)) for _ in range(2)])
    constants, rest = eqx.partition((model, F), eqx.is_inexact_array)
    way = jax.tree.map(lambda x: rng.uniform(-1, 1, np.shape(x)) * (0.1 * np.abs(x) + 0.01), constants)
    if hasattr(model, "r"):  # The margin jumps where the radius r of a sub-family passes a bond, as at r = 1.
        way = eqx.tree_at(lambda tree: tree[0].r, way, 0.0)

    def margin(t):
        moved, G = eqx.combine(jax.tree.map(lambda x, d: x + t * d, constants, way), rest)
        return pd.worst_margin(moved, family, G, sharpness=sharpness)

    slope = float(jax.jvp(margin, (jnp.array(0.0),), (jnp.array(1.0),))[1])
    h = 1e-4
    value = {n: float(margin(n * h)) for n in (-2, -1, 0, 1, 2)}
    left, right = (value[0] - value[-1]) / h, (value[1] - value[0]) / h
    if abs(right - left) > 5e-4:  # a curvature of 5: a kink. Measured 1.6e-3 at kinks, up to 1e-4 elsewhere
        assert sharpness is None and left - 1e-4 < slope < right + 1e-4  # a maximum is convex at its kinks
    else:
        central = (8 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12 * h)
        assert abs(slope - central) < 1e-7 * max(1.0, abs(central))  # measured up to 3e-9


def stretched(theta):
    """A lattice compressed along x. At theta = 0 its two shear branches coincide for waves along x."""
    return jnp.diag(jnp.stack([0.95 + 0 * theta, 1 + theta, 1 - theta]))


@pytest.mark.parametrize(
    "number",
    [
        lambda model, family: pd.worst_margin(model, family, pd.load_cases("hydrostatic", [-0.05, 0.05])),
        lambda model, family: pd.worst_margin(model, family, pd.load_cases("hydrostatic", [-0.05]), sharpness=50.0),
        pd.dispersion_error,
    ],
    ids=["margin", "smooth margin", "phase speeds"],
)
@pytest.mark.parametrize("dim", [1, pytest.param(3, marks=pytest.mark.long)])
def test_gradient_in_float32_is_that_of_float64_for_a_lattice_of_a_micrometre(dim, number):
    """In pascal and metres the products of moduli and wave numbers leave the range of float32."""

    def gradient(wide):
        with jax.enable_x64(wide):
            family = pd.lattice_family(dim, 2 if dim == 1 else 1.8, spacing=1e-6)

            def value(p):
                law = pd.LinearElastic(1e11 * p[0], 0.7e11 * p[1])
                return number(pd.SethHill(p[2], law, pd.SillingControl(p[3])), family)

            found = jax.grad(value)(jnp.array([1.0, 1.0, 1.0, 0.5]))
        assert found.dtype == (float if wide else np.float32)
        return np.asarray(found)

    exact = gradient(True)
    np.testing.assert_allclose(gradient(False), exact, atol=1e-5 * np.abs(exact).max())  # measured 1e-7


def test_second_derivative_in_float32_is_not_lost():
    with jax.enable_x64(False):
        family, cases = pd.lattice_family(1, 2), pd.load_cases("hydrostatic", [-0.05])
        found = jax.jacfwd(jax.grad(lambda g: pd.worst_margin(model_of(g), family, cases, sharpness=50.0)))(0.03)
    exact = jax.jacfwd(jax.grad(lambda g: pd.worst_margin(model_of(g), family, cases, sharpness=50.0)))(0.03)
    assert float(found) == pytest.approx(float(exact), rel=1e-2) and abs(float(exact)) > 0


def test_smooth_bound_at_a_repeated_eigenvalue():
    """Value, bound and derivative where two shear branches of one wave cross, in 3D."""
    family, model = pd.lattice_family(3, 1.8), model_of(0.05)

    def bound(theta, sharpness=40.0):
        return pd.worst_margin(model, family, stretched(theta)[None], sharpness=sharpness, resolution=4)

    h = 1e-4
    central = (float(bound(jnp.array(h))) - float(bound(jnp.array(-h)))) / (2 * h)
    slope = float(jax.grad(bound)(jnp.array(0.0)))
    assert abs(slope) < 1e-12 and abs(central) < 1e-10  # even in theta: measured 1e-17 and 0
    curved = float(bound(jnp.array(h))) + float(bound(jnp.array(-h))) - 2 * float(bound(jnp.array(0.0)))
    assert curved / h**2 < 40 * 10  # no kink: a kink of slope 0.1 would give 0.2/h = 2000
    zone = brillouin_zone(3, 4, "inversion")
    values = np.linalg.eigvalsh(np.asarray(sampled(model, family, stretched(jnp.array(0.0))[None], zone)))
    largest, n = values.max(), values.size
    for sharpness in (10.0, 40.0, 1000.0):
        value = float(bound(jnp.array(0.0), sharpness))
        assert largest - 1e-12 <= value <= largest + np.log(n) / sharpness + 1e-12
        exact = largest + np.log(np.exp(sharpness * (values - largest)).sum()) / sharpness
        assert abs(value - exact) < 1e-12


def test_derivative_of_a_trace_of_exponentials_is_smooth_at_a_crossing():
    def matrix(t):
        return jnp.array([[[1.0 + t, 0.0], [0.0, 1.0 - t]]])

    for t in (0.0, 1e-9, 0.1):
        slope = float(jax.grad(lambda t: log_trace(matrix(t), jnp.asarray(20.0)))(t))
        assert abs(slope - np.tanh(20.0 * t)) < 1e-12  # ln(2 cosh(s t))/s + 1


def test_derivative_at_a_kink_is_one_of_the_one_sided_ones():
    """Compression and tension share the maximum at one order m, and the worst margin has a kink there."""
    family, cases = pd.lattice_family(1, 2), pd.load_cases("hydrostatic", [-0.05, 0.05])

    def margin(m):
        return pd.worst_margin(pd.SethHill(m, LAW, pd.SillingControl(0.02)), family, cases)

    slope = jax.grad(margin)
    low, high = 0.0, 1.0
    for _ in range(40):  # bisection of the kink, where the derivative changes its sign
        middle = (low + high) / 2
        low, high = (middle, high) if float(slope(middle)) < 0 else (low, middle)
    left = (float(margin(low)) - float(margin(low - 1e-4))) / 1e-4
    right = (float(margin(high + 1e-4)) - float(margin(high))) / 1e-4
    assert left < -1e-3 and right > 1e-3
    assert abs(float(slope(low)) - left) < 1e-3 * abs(left) and abs(float(slope(high)) - right) < 1e-3 * right


def test_a_load_path_without_a_state_gives_nan():
    def nowhere(a, model, family):
        return jnp.full((family.dim, family.dim), jnp.nan) + a

    family = pd.lattice_family(1, 2)
    assert np.isnan(float(pd.worst_margin(model_of(0.1), family, pd.load_cases([pd.hydrostatic, nowhere], [0.01]))))


def test_wrong_loads_are_refused():
    family, model = pd.lattice_family(2, 2), model_of(0.1)
    with pytest.raises(ValueError, match=r"loads must have shape \(cases, 2, 2\).*got \(1, 3, 3\)"):
        pd.worst_margin(model, family, np.eye(3)[None])
    with pytest.raises(ValueError, match="det F > 0"):
        pd.worst_margin(model, family, np.diag([1.0, -1.0])[None])
    with pytest.raises(ValueError, match="sharpness must be one finite number > 0"):
        pd.worst_margin(model, family, np.eye(2)[None], sharpness=0.0)
    with pytest.raises(ValueError, match="sharpness needs a model with an energy"):
        hourglass = pd.SethHill(1.0, LAW, pd.LittlewoodControl(0.03))
        pd.worst_margin(hourglass, family, np.eye(2)[None], sharpness=10.0)
    with pytest.raises(ValueError, match="path must be one of hydrostatic"):
        pd.load_cases("shear", [0.1])
    with pytest.raises(ValueError, match="a must be > -1"):
        pd.load_cases("hydrostatic", [-1.5])
    with pytest.raises(ValueError, match="at least one path and one load"):
        pd.load_cases([], [0.1])
