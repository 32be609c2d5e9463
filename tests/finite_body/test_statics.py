"""Statics: equilibria by every method, messages if there is none, derivatives, paths through limit points."""

import functools
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import reference as ref
from bodies import worst
from scipy.optimize import brentq

import pdjax as pd
from pdjax.finite_body.statics import SOLVERS
from pdjax.finite_body.statics.result import SolveEnding
from pdjax.scenes import singular_bar, step_size_bar

UNIT = pd.LinearElastic(1.0, 0.0)
SVK, HENCKY = pd.SethHill(1.0, UNIT), pd.SethHill(0.0, UNIT)
METHODS = ("newton", "newton_krylov", "trust_region", "relaxation")


@functools.cache
def stretched():
    return step_size_bar(41, 3, 1.0)


@functools.cache
def pulled():
    return singular_bar(40, 3, 1e-3)


@functools.cache
def paper():
    return step_size_bar(100, 3, -1e-3)


@functools.cache
def pair(load=1.0, model=HENCKY):
    """Two points joined by one bond. The left point is held, the right one is pulled."""
    body = pd.bar(2, 2.0)
    return pd.scene(body, pd.families(body, 1.0), model, pd.prescribe(0), pd.total_force([1], [load]))


@functools.cache
def solved(scene_of, method):
    return pd.solve(scene_of(), method, stability=method == "newton")


# ---------------------------------------------------------------- the methods


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_the_stretched_bar(method):
    """Every method finds u = X at +100 % strain in one step, and reports that it converged."""
    found = solved(stretched, method)
    assert SOLVERS == METHODS
    assert found.converged and found.reason == "converged" and found.method == method
    assert worst(found.u, stretched().body.positions) < 1e-10  # measured 1e-12
    assert found.residual <= 1e-10 and float(found.load_factor) == 1 and int(found.turned) == 0
    assert 1 <= found.iterations <= 1000


@pytest.mark.parametrize("method", METHODS[1:3])
def test_methods_agree_on_the_singular_bar(method):
    """All methods find the same equilibrium in tension."""
    newton, other = solved(pulled, "newton"), solved(pulled, method)
    assert newton.converged and other.converged
    assert newton.kind == "minimum"
    assert worst(other.u, newton.u) / worst(newton.u) < 1e-9  # measured 3e-16


def test_forces_of_the_reference_balance_where_newton_stopped():
    """f + b = 0 holds for the forces of the NumPy reference, with the modulus of each point."""
    scene, u = pulled(), np.asarray(solved(pulled, "newton").u)
    x = scene.body.positions[:, 0]
    states = ref.seth_hill_states(scene.body.positions, scene.body.volumes, 3 / 40, u, 1.0, 1.0, 0.0)
    beyond = np.maximum(x - 0.5, 1e-9)
    modulus = np.where(x > 0.5, 1 / (1 + 10 / (2 * np.sqrt(beyond))), 1.0)
    f = np.zeros(40)
    for i, (near, T) in states.items():
        for slot, j in enumerate(near):
            f[i] += modulus[i] * T[slot, 0] / 40
            f[j] -= modulus[i] * T[slot, 0] / 40
    left = (f + np.asarray(scene.load)[:, 0])[6:]
    assert worst(left) / worst(f) < 1e-9  # measured 1e-11


def test_singular_bar_tends_to_the_local_solution():
    """The error against the nonlinear local solution at fixed N = 3 decreases with n, faster than n^-0.4."""
    errors = []
    for n in (40, 80, 160):
        scene = singular_bar(n, 3, 1e-3)
        found = pd.solve(scene, stability=False)
        assert found.converged
        errors.append(np.linalg.norm(found.u - scene.closed_form) / np.linalg.norm(scene.closed_form))
    assert errors[0] < 0.3  # measured 1e-1
    assert all(0.4 < np.log2(a / b) < 1 for a, b in pairwise(errors))  # 0.56, 0.53


def test_newton_ends_quadratically():
    """The last residuals satisfy r_{k+1} ≤ C r_k² with one C < 20, and the last is below the tolerance."""
    found = pd.solve(pulled(), tolerance=1e-13, stability=False)
    r = found.residuals
    assert r[-1] <= 1e-13 and (np.diff(r) < 0).all()
    steep = [b / a**2 for a, b in pairwise(r) if 1e-6 < a < 0.1]
    assert len(steep) >= 2 and max(steep) < 20  # measured 1.0
    assert found.iterations == len(r) - 1


def test_the_paper_bar_has_a_smooth_saddle_and_a_distant_minimum():
    """At −0.1 % with 100 points the homogeneous state has 3 unstable modes; relaxation ends more than 30 % away."""
    scene = paper()
    smooth = pd.solve(scene, predictor="tangent")
    assert smooth.converged and smooth.kind == "saddle" and smooth.stability.positive == 3
    assert worst(smooth.u, scene.closed_form) / worst(scene.closed_form) < 1e-12  # measured 3e-14
    settled = pd.solve(scene, "relaxation")
    assert settled.converged and settled.kind == "minimum" and settled.stability.positive == 0
    away = np.linalg.norm(settled.u - scene.closed_form) / np.linalg.norm(scene.closed_form)
    assert away > 0.3  # measured 1.2
    energy = [float(pd.strain_energy(scene.model, scene.families, e.u)) for e in (settled, smooth)]
    assert energy[0] < 0.9 * energy[1]


@pytest.mark.parametrize("method", ["newton", "trust_region"])
@pytest.mark.parametrize("predictor", ["none", "tangent"])
def test_load_steps_end_where_one_step_does(method, predictor):
    """Four or more load steps and a single one find the same equilibrium."""
    found = pd.solve(pulled(), method, step=0.25, predictor=predictor, stability=False)
    assert found.converged and float(found.load_factor) == 1
    assert worst(found.u, solved(pulled, "newton").u) / worst(found.u) < 1e-9  # measured 2e-11


def test_a_start_at_the_solution_takes_no_iterations():
    found = pd.solve(stretched(), start=stretched().body.positions, stability=False)
    assert found.converged and found.iterations == 0


# ---------------------------------------------------------------- no equilibrium


def hencky_pull(load):
    """The strain e with 2 log(1 + e)/(1 + e) = load, since each of the two points has the energy ½ log²(1 + e)."""
    return brentq(lambda e: 2 * np.log1p(e) / (1 + e) - load, 0, np.e - 1, xtol=1e-15)


@pytest.mark.parametrize("step", [1.0, 0.25])
def test_a_load_beyond_the_limit_point_is_not_carried(step):
    """The bond carries at most 2/exp(1). `solve` returns the last equilibrium below, and the reason in words."""
    found = pd.solve(pair(), step=step)
    assert not found.converged
    factor = float(found.load_factor)
    assert 0.7 < factor < 2 / np.e
    assert (
        "from load factor" in found.reason
        and found.ending != SolveEnding.CONVERGED
        and found.ending.reason in found.reason
    )
    assert "not converged" in str(found)
    assert abs(float(found.u[1, 0]) / hencky_pull(factor) - 1) < 1e-7  # measured 3e-15
    assert found.kind == "minimum" and found.stability.positive == 0
    with pytest.raises(RuntimeError, match="no equilibrium of the scene: newton: not converged"):
        pd.solve(pair(), step=step, throw=True)


def test_exhausted_iterations_are_reported():
    found = pd.solve(pulled(), max_iterations=2, smallest_step=1.0, stability=False)
    assert not found.converged and "the iterations ran out" in found.reason
    found = pd.solve(paper(), "relaxation", max_iterations=1, smallest_step=1.0, stability=False)
    assert not found.converged and "the iterations ran out" in found.reason


@pytest.mark.parametrize("method", METHODS)
def test_a_collapsed_start_is_no_equilibrium(method):
    """Both points start in one place, so the forces and their scale are NaN. No method counts that as converged."""
    found = pd.solve(pair(), method, start=[[0.0], [-1.0]], smallest_step=1.0)
    assert not found.converged and "the residual is not finite" in found.reason and found.stability is None


@pytest.mark.parametrize(
    "arguments, named",
    [
        ({"method": "bfgs"}, "method must be one of newton, newton_krylov, trust_region, relaxation; got 'bfgs'"),
        ({"predictor": "secant"}, "predictor must be one of tangent, none"),
        ({"tolerance": 0.0}, "tolerance must lie between 0 and 1"),
        ({"tolerance": 2.0}, "tolerance must lie between 0 and 1"),
        ({"tolerance": np.nan}, "tolerance must lie between 0 and 1"),
        ({"step": 0.0}, "need 0 < smallest_step <= step <= 1"),
        ({"step": 1.5}, "need 0 < smallest_step <= step <= 1"),
        ({"step": 1e-4}, "need 0 < smallest_step <= step <= 1"),
        ({"smallest_step": 0.0}, "need 0 < smallest_step <= step <= 1"),
    ],
)
def test_bad_arguments_are_refused(arguments, named):
    with pytest.raises(ValueError, match=named):
        pd.solve(pair(), **arguments)


# ---------------------------------------------------------------- derivatives


def end_of(method):
    """The function (m, strain) → u of one point of an inhomogeneous bar that is clamped at both ends."""
    c = np.where(np.arange(31) < 13, 1.0, 0.5)

    def value(p):
        model = pd.graded(pd.SethHill(p[0], UNIT), c)
        bar = step_size_bar(31, 2, p[1], 4, model)
        return pd.solve(bar, method, tolerance=1e-12, stability=False).u[17, 0]

    return value


def stress_of(p):
    """The displacement u at the end of the singular bar for the stress σ."""
    return pd.solve(singular_bar(30, 2, p[0], 2.0), tolerance=1e-12, stability=False).u[-1, 0]


@pytest.mark.parametrize(
    "value, at",
    [(end_of("newton"), [0.9, 0.08]), (end_of("trust_region"), [0.9, 0.08]), (stress_of, [0.02])],
)
def test_derivatives_of_an_equilibrium(value, at):
    """Reverse and forward derivatives equal central differences, for the order m, the strain and the stress."""
    at, h = np.array(at), 1e-5
    slope = np.asarray(jax.grad(value)(jnp.asarray(at)))
    for k, step in enumerate(np.eye(len(at)) * h):
        up, down = (float(value(jnp.asarray(at + s * step))) for s in (1, -1))
        assert abs((up - down) / (2 * h) / slope[k] - 1) < 1e-6  # measured 3e-9
        direction = jnp.asarray(step / h)
        assert abs(float(jax.jvp(value, (jnp.asarray(at),), (direction,))[1]) / slope[k] - 1) < 1e-9  # measured 5e-15


def test_trust_region_under_jit_and_vmap():
    """A batch equals its members solved one by one, and its gradient equals Newton's implicit derivative."""
    scene = pulled()

    def value(scale):
        bent = eqx.tree_at(lambda s: s.load, scene, scale * scene.load)
        return pd.solve(bent, "trust_region", tolerance=1e-12)

    def newton(scale):
        bent = eqx.tree_at(lambda s: s.load, scene, scale * scene.load)
        return pd.solve(bent, tolerance=1e-12, stability=False).u

    scales = jnp.array([0.6, 0.9, 1.1])
    batch = eqx.filter_jit(eqx.filter_vmap(value))(scales)
    assert np.asarray(batch.converged).all() and batch.u.shape == (3, 40, 1)
    for k, scale in enumerate(scales):
        assert worst(batch.u[k], newton(scale)) / worst(batch.u[k]) < 1e-10  # measured 6e-16
    slope, h = jax.jit(jax.grad(lambda s: value(s).u[-1, 0]))(0.9), 1e-4
    assert abs((newton(0.9 + h) - newton(0.9 - h))[-1, 0] / (2 * h) / slope - 1) < 1e-6  # measured 7e-11
    for method in ("newton", "newton_krylov", "relaxation"):
        with pytest.raises(ValueError, match=f"method '{method}' runs on the host; under jit or vmap use"):
            jax.jit(lambda s, method=method: pd.solve(eqx.tree_at(lambda t: t.load, scene, s), method).u)(scene.load)


# ---------------------------------------------------------------- paths


def test_a_path_passes_the_limit_point_of_a_bond():
    """λ = 2 log(1 + e)/(1 + e) has its maximum 2/exp(1) at e = exp(1) − 1, and the states beyond are unstable."""
    path = pd.equilibrium_path(pair(), states=40)
    e = path.u[:, 1, 0]
    assert worst(path.load_factors, 2 * np.log1p(e) / (1 + e)) < 1e-9  # measured 8e-11
    assert e[-1] > 2.5 and worst(path.u[:, 0]) == 0
    assert np.array_equal(path.positive, e > np.e - 1)
    (top,) = path.limit_points
    assert abs(path.load_factors[top] / (2 / np.e) - 1) < 1e-3  # measured 7e-7
    assert abs(e[top] - (np.e - 1)) < 0.1
    assert path.load_factors.max() <= 2 / np.e
    assert path.reason == "all 40 states were computed before the load factor reached 1"


def test_a_monotone_path_ends_at_the_solution():
    """The path has no limit point before the full load. At its last state it agrees with `solve`."""
    scene = pulled()
    path = pd.equilibrium_path(scene, states=40)
    assert path.reason == "converged" and path.load_factors[-1] >= 1 and len(path.limit_points) == 0
    assert (np.diff(path.load_factors) > 0).all() and (path.positive == 0).all()
    factor = path.load_factors[-1]
    over = eqx.tree_at(lambda s: (s.load, s.prescribed), scene, (factor * scene.load, factor * scene.prescribed))
    found = pd.solve(over, stability=False)
    assert worst(path.u[-1], found.u) / worst(found.u) < 1e-9  # measured 3e-11


class NoEnergy(pd.SethHill):
    """A model with an energy that declares that it has none."""

    hyperelastic = False


def test_wrong_arguments_of_a_path_are_refused():
    for wrong in ({"arc": 0.0}, {"arc": 0.3, "largest_arc": 0.2}, {"states": 0}):
        with pytest.raises(ValueError, match="need 0 < arc <= largest_arc and states >= 1"):
            pd.equilibrium_path(pair(), **wrong)
    with pytest.raises(ValueError, match="NoEnergy has no energy"):
        pd.equilibrium_path(pair.__wrapped__(model=NoEnergy(0.0, UNIT)))
