"""The scenes: their geometry, their closed forms compared with independent solutions, and the graded model."""

import functools

import bodies
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from scipy.integrate import quad
from scipy.optimize import brentq
from table import MODELS, EnergyOnly

import pdjax as pd
from pdjax import scenes
from pdjax.models.base import PROMISES

UNIT = pd.LinearElastic(1.0, 0.0)
SVK, HENCKY = pd.SethHill(1.0, UNIT), pd.SethHill(0.0, UNIT)


def unbalanced(scene, u):
    """Unbalanced forces on the free components."""
    return np.asarray(scene.unbalanced(u)).reshape(-1)[scene.unknowns]


# ---------------------------------------------------------------- graded model


@pytest.mark.parametrize(
    "make",
    [
        lambda law: pd.SethHill(-0.7, law),
        lambda law: EnergyOnly(pd.SethHill(1.0, law)),
    ],
)
def test_a_graded_model_is_the_model_of_graded_constants(make):
    """c W(λ, μ) = W(cλ, cμ) at every point holds for energy and force, and the force is minus ∂W/∂u."""
    c = bodies.random(60).uniform(0.4, 2.5, 15)
    fams, u = bodies.families(2, "cloud"), jnp.asarray(bodies.displacement(2, "cloud", 60))
    graded, varied = pd.graded(make(pd.LinearElastic(1.3, 0.7)), c), make(pd.LinearElastic(1.3 * c, 0.7 * c))
    force = jax.jit(pd.force_density)(graded, fams, u)
    energy, slope = jax.jit(jax.value_and_grad(lambda u: pd.strain_energy(varied, fams, u)))(u)
    assert abs(pd.strain_energy(graded, fams, u) / energy - 1) < 1e-13  # measured 3e-16
    V = bodies.points(2, "cloud").volumes[:, None]
    assert worst(V * force, -np.asarray(slope)) / worst(slope) < 1e-13  # measured 6e-16


@pytest.mark.parametrize("name", MODELS)
def test_a_graded_model_has_the_promises_of_its_model(name):
    inside, outside = MODELS[name], pd.graded(MODELS[name], 2.0)
    for promise in {*PROMISES, "isotropic"} - {"additive", "degree"}:  # the factor multiplies a force, not the state
        assert getattr(outside, promise) == getattr(inside, promise)
    for kind in (pd.PointStateModel, pd.TwoStageModel):
        assert isinstance(outside, kind) == isinstance(inside, kind)


def test_the_local_energy_of_a_graded_model_is_multiplied_by_the_factor():
    F = jnp.asarray(bodies.deformation(2, 61))
    E = (F.T @ F - jnp.eye(2)) / 2
    psi = 2.5 * (0.65 * jnp.trace(E) ** 2 + 0.7 * jnp.sum(E * E))
    assert worst(pd.graded(MODELS["seth_hill m=1"], 2.5).local_energy(F), psi) < 1e-15  # measured 3e-17


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, [1.0, np.inf]])
def test_a_factor_that_is_not_finite_and_positive_is_refused(factor):
    with pytest.raises(ValueError, match="factor of a graded model must be finite and > 0"):
        pd.graded(SVK, jnp.asarray(factor))


# ---------------------------------------------------------------- the step-size bar


def test_step_size_bar_is_that_of_the_paper():
    """It has n points at spacing 1/n about 0, and six points at each end are held at strain · X."""
    scene = scenes.step_size_bar(41, strain=-0.03)
    x = scene.body.positions[:, 0]
    assert len(x) == 41 and worst(np.diff(x), 1 / 41) < 1e-15  # measured 9e-18
    assert worst(x + x[::-1]) < 1e-15  # measured 6e-17
    assert worst(scene.body.volumes, 1 / 41) == 0 and worst(scene.load) == 0
    assert np.array_equal(scene.unknowns, np.arange(6, 35))
    ends = np.r_[0:6, 35:41]
    assert worst(np.asarray(scene.prescribed)[ends, 0], -0.03 * x[ends]) < 1e-17  # measured 0
    assert int(scene.families.count.max()) == 6  # N = 3 on either side
    assert worst(scene.closed_form[:, 0], -0.03 * x) < 1e-17  # measured 0


@pytest.mark.parametrize("strain", [-0.3, 1.0])
def test_step_size_bar_is_in_equilibrium_while_the_clamps_are_two_horizons_deep(strain):
    """f = 0 on the free points for clamp = 2N. With one point less the surface acts on a free point."""
    good, thin = (scenes.step_size_bar(41, 3, strain, clamp) for clamp in (6, 5))
    size = worst(good.unbalanced(good.closed_form))
    assert worst(unbalanced(good, good.closed_form)) / size < 1e-13  # measured 2e-15
    assert worst(unbalanced(thin, thin.closed_form)) / size > 1e-3


# ---------------------------------------------------------------- the singular bar


def softness(x, alpha):
    return 1 + (alpha / (2 * np.sqrt(x - 0.5)) if x > 0.5 else 0.0)


def scipy_strain(stress):
    """The root of (1 + e)(e + e²/2) = σ on the branch from rest."""
    return brentq(lambda e: (1 + e) * (e + e * e / 2) - stress, 3**-0.5 - 1, 2 + abs(stress), xtol=1e-15, rtol=1e-14)


def scipy_displacement(x, stress, alpha):
    """∫ e dx. Beyond the middle the variable is y with x = ½ + y⁶, where e grows as y⁻²."""
    u = scipy_strain(stress) * min(x, 0.5)
    if x > 0.5:
        top = (x - 0.5) ** (1 / 6)
        density = lambda y: 6 * y**5 * scipy_strain(stress * (1 + alpha / (2 * y**3)))  # noqa: E731
        u += quad(density, 0, top, epsabs=0, epsrel=1e-12)[0]
    return u


@pytest.mark.parametrize("stress, alpha", [(1e-3, 10.0), (0.05, 4.0)])
def test_local_solution_of_the_singular_bar_by_scipy(stress, alpha):
    """The strain is a root of the cubic, and the displacement is found by quadrature."""
    x = np.array([0.1, 0.5, 0.5001, 0.51, 0.7, 1.0])
    u, e = pd.closed_forms.singular_bar_local(SVK, x, 1.0, stress, alpha)
    exact = np.array([scipy_strain(stress * softness(y, alpha)) for y in x])
    assert worst(np.asarray(e) / exact, 1.0) < 1e-12  # measured 2e-14
    exact = np.array([scipy_displacement(y, stress, alpha) for y in x])
    assert worst(np.asarray(u) / exact, 1.0) < 1e-8  # measured 6e-10
    long, _ = pd.closed_forms.singular_bar_local(SVK, 3 * x, 3.0, stress, alpha)
    assert worst(np.asarray(long) / 3 / exact, 1.0) < 1e-8  # measured 6e-10


def test_local_solution_tends_to_the_linear_one():
    """For σ → 0 the difference from the printed small-strain form is proportional to σ."""
    x = np.array([0.2, 0.55, 0.8, 1.0])
    away = []
    for stress in (1e-6, 1e-7):
        u, e = pd.closed_forms.singular_bar_local(SVK, x, 1.0, stress)
        linear = pd.closed_forms.singular_bar_displacement(x, 1.0, stress)
        away_strain = worst(e / pd.closed_forms.singular_bar_strain(x, 1.0, stress), 1.0) / stress
        assert away_strain < 500  # measured 35
        away.append(worst(u / linear, 1.0))
    assert away[1] < 1e-4  # measured 3e-5
    assert away[0] > 5 * away[1]


def test_the_branch_ends_at_the_limit_point():
    """SVK in compression: e = 1/√3 − 1, P = −1/√27; Hencky in tension: e = exp(1) − 1, P = 1/exp(1)."""
    strain = pd.closed_forms.local_strain_of_stress
    least, most = -(3**-1.5), np.exp(-1)
    near = 0.999  # of the peak: the strain is of the order of √0.001 short of it
    assert abs(float(strain(SVK, near * least)) - (3**-0.5 - 1)) < 0.05  # measured 1e-2
    assert abs(float(strain(HENCKY, near * most)) - (np.e - 1)) < 0.2  # measured 1e-1
    assert np.isnan(strain(SVK, least * 1.001)) and np.isnan(strain(HENCKY, most * 1.001))
    for e in (-0.4, 0.7, 3.0):
        assert abs(float(strain(SVK, (1 + e) * (e + e * e / 2))) / e - 1) < 1e-13  # measured 4e-15
    for e in (-0.9, -0.4, 0.7, 1.6):
        assert abs(float(strain(HENCKY, np.log1p(e) / (1 + e))) / e - 1) < 1e-13  # measured 4e-15


def test_local_strain_has_first_and_second_derivatives_in_the_stress():
    """With P = (1 + e)(e + e²/2): de/dσ = 1/P′ and d²e/dσ² = −P″/P′³."""
    for e in (-0.3, 0.0, 0.5):
        slope = jax.grad(lambda s: pd.closed_forms.local_strain_of_stress(SVK, s))
        stress, rate = (1 + e) * (e + e * e / 2), 1 + 3 * e + 1.5 * e * e
        assert abs(float(slope(stress)) * rate - 1) < 1e-12
        assert abs(float(jax.grad(slope)(stress)) * rate**3 / -(3 + 3 * e) - 1) < 1e-11


def test_gradients_of_the_singular_bar_are_finite_although_some_stresses_have_no_local_solution():
    """Near the middle the modulus is so small that the law cannot carry the stress."""

    def load(stress):
        return jnp.sum(pd.scenes.singular_bar(30, 2, stress, 2.0).load)

    forward = jax.jvp(load, (0.02,), (1.0,))[1]
    assert abs(float(jax.grad(load)(0.02)) / float(forward) - 1) < 1e-12  # measured 4e-16


def test_strain_is_nan_where_the_local_bar_has_no_solution():
    """In compression a part of the bar has no solution: there σ (1 + α/2t) is below −1/√27."""
    x, stress = np.linspace(0.5, 1.0, 101), -0.05
    _, e = pd.closed_forms.singular_bar_local(SVK, x, 1.0, stress, 2.0)
    lost = stress * np.array([softness(y, 2.0) for y in x]) < -(3**-1.5)
    assert 5 < lost.sum() < 50
    assert np.array_equal(np.isnan(e), lost)


def test_profile_of_the_singular_bar():
    """E/E₀ = (1 + α/(2√(x − ½)))⁻¹ beyond the middle. 2N points are held, 2N are loaded, and Σ V b = σ."""
    scene = scenes.singular_bar(30, 2, 0.02, 7.0)
    x = (np.arange(30) + 0.5) / 30
    exact = np.array([1 / softness(y, 7.0) for y in x])
    assert worst(scene.model.factor, exact) < 1e-15  # measured 1e-16
    assert np.array_equal(scene.unknowns, np.arange(4, 30))
    assert np.array_equal(np.flatnonzero(np.asarray(scene.load)), np.arange(26, 30))
    assert worst(np.asarray(scene.load).sum() / 30, 0.02) < 1e-15  # measured 3e-18
    even = scenes.singular_bar(30, 2, 0.02, 7.0, traction="even")
    assert worst(np.asarray(even.load)[26:, 0], 0.02 / (4 / 30)) < 1e-15  # measured 0
    assert (
        worst(scene.closed_form[:4, 0], np.array([scipy_displacement(y, 0.02, 7.0) for y in x[:4]])) < 1e-14
    )  # measured 2e-17


@pytest.mark.parametrize("N, m", [(1, 1.0), (1.5, 0.0), (2, -0.7), (3, 1.0), (3, 0.0)])
@pytest.mark.parametrize("stress", [0.02, -0.1])
def test_singular_bar_without_singularity_passes_the_patch_test(N, m, stress):
    """For α = 0 and the exact traction the solution is the homogeneous state to rounding, with the strain by hand."""
    scene = scenes.singular_bar(30, N, stress, 0.0, pd.SethHill(m, UNIT))
    if m == 1:
        e = scipy_strain(stress)
    else:  # P = E_m (1 + e)^{2m − 1}
        e = brentq(
            lambda e: (np.log1p(e) if m == 0 else ((1 + e) ** (2 * m) - 1) / (2 * m)) * (1 + e) ** (2 * m - 1) - stress,
            -0.5,
            0.4,
            xtol=1e-15,
        )
    u = e * scene.body.positions
    assert worst(scene.closed_form, u) < 1e-13  # measured 3e-16
    assert worst(unbalanced(scene, jnp.asarray(u))) < 1e-14  # measured 5e-16
    found = pd.solve(scene, tolerance=1e-12, stability=False)
    assert found.converged
    assert worst(found.u, u) < 1e-13  # measured 9e-16


def test_an_even_traction_disturbs_the_homogeneous_state():
    """The even traction has the same sum, but the solution is not homogeneous."""
    scene = scenes.singular_bar(30, 3, 0.02, 0.0, traction="even")
    found = pd.solve(scene, stability=False)
    assert found.converged
    assert worst(found.u, scene.closed_form) / worst(scene.closed_form) > 0.01


# ---------------------------------------------------------------- plates


@pytest.mark.parametrize(
    "shape, N, name",
    [((12, 11), 2, "seth_hill m=-0.7"), ((9, 11), 1.5, "seth_hill m=1, energy only"), ((5, 7, 6), 1, None)],
)
def test_a_clamped_plate_is_homogeneous(shape, N, name):
    """u = (F − I) X about the middle is an exact equilibrium for every model, and only the rim is held."""
    dim, rim = len(shape), 2 * int(np.ceil(N))
    model = pd.Correspondence(pd.NeoHookean(lam=1.3, mu=0.7)) if name is None else MODELS[name]
    F = bodies.deformation(dim, 62, size=0.2)
    scene = scenes.clamped_plate(shape, N, F, model, spacing=0.5)
    cells = np.indices(shape).reshape(dim, -1).T
    X = 0.5 * (cells + 0.5 - np.array(shape) / 2)
    u = X @ (F - np.eye(dim)).T
    assert worst(scene.closed_form, u) < 1e-14  # measured 0
    inside = ((cells >= rim) & (cells < np.array(shape) - rim)).all(axis=1)
    assert np.array_equal(scene.free, np.repeat(inside[:, None], dim, axis=1)) and inside.any()
    forces = np.asarray(scene.unbalanced(jnp.asarray(u)))
    assert worst(unbalanced(scene, jnp.asarray(u))) / worst(forces) < 1e-14  # measured 1e-16
    assert worst(np.asarray(scene.prescribed)[~inside], u[~inside]) < 1e-14  # measured 0


@functools.cache
def manufactured(n):
    return scenes.manufactured_plate(n, 2)


def wanted(x, y):
    wave = np.array([np.sin(2 * np.pi * x) * np.sin(np.pi * y), np.cos(np.pi * x) * np.sin(2 * np.pi * y)])
    return 0.05 * np.array([x, y]) + 2e-3 * wave


def piola(x, y, h=1e-3):
    """P = F S of u*, with the gradient of u* by central differences of fourth order."""
    F = np.eye(2)
    for k, (a, b) in enumerate([(h, 0), (0, h)]):
        near, far = (wanted(x + s * a, y + s * b) - wanted(x - s * a, y - s * b) for s in (1, 2))
        F[:, k] += (8 * near - far) / (12 * h)
    E = (F.T @ F - np.eye(2)) / 2
    return F @ (np.trace(E) * np.eye(2) + 2 * E)


def test_manufactured_body_force_is_minus_the_divergence_of_the_stress():
    """The divergence is that of P = F (tr E I + 2 E) of u*, by finite differences."""
    scene, h = manufactured(16), 1e-3
    for point in (5 * 16 + 6, 9 * 16 + 4):
        X = scene.body.positions[point]
        divergence = np.zeros(2)
        for k, step in enumerate(np.eye(2) * h):
            near, far = (piola(*(X + s * step))[:, k] - piola(*(X - s * step))[:, k] for s in (1, 2))
            divergence += (8 * near - far) / (12 * h)
        assert worst(scene.load[point], -divergence) / worst(divergence) < 1e-7  # measured 1e-10
        assert worst(scene.closed_form[point], wanted(*X)) < 1e-15  # measured 0


def test_manufactured_plate_converges_at_second_order():
    """For a horizon of 2 spacings the largest error at n = 16 and 32 decreases with an order above 1.5."""
    errors = []
    for n in (16, 32):
        found = pd.solve(manufactured(n), stability=False)
        assert found.converged
        errors.append(worst(found.u, manufactured(n).closed_form))
    assert errors[0] < 1e-3  # measured 2e-4
    assert 1.5 < np.log2(errors[0] / errors[1]) < 2.5  # 1.86


@pytest.mark.parametrize("make", [pd.BondLevel, pd.BondLevelAverage])
def test_the_rim_of_a_plate_is_as_wide_as_its_forces_reach(make):
    """For models with the states of both ends a rim of 2N points left a third ring out of balance by 4e-4."""
    scene = pd.scenes.clamped_plate((14, 13), 2, np.diag([1.01, 0.99]), make(pd.LinearElastic(1.0, 1.0)))
    force = np.asarray(scene.unbalanced(scene.closed_form)).reshape(-1)[np.asarray(scene.unknowns)]
    assert np.abs(force).max() < 1e-14  # 2e-17


def test_a_wave_beyond_the_brillouin_zone_is_refused_and_the_equivalent_wave_is_named():
    with pytest.raises(ValueError, match=r"up to half as many wavelengths.*the same wave as \[-?20\.?\]"):
        pd.scenes.wave(40, k=2 * np.pi * 100 / 40)
