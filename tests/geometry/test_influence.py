"""Influence functions have their known values, are smooth and even, and their parameters are differentiable."""

from functools import partial

import bodies
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from bodies import worst
from hypothesis import given
from hypothesis import strategies as st
from table import MODELS

import pdjax as pd
from pdjax.geometry.influence import INFLUENCES

# Values at q = r/δ = ¼, ½, ¾, 1, computed by hand.
KNOWN = {
    "constant": (pd.constant_influence, [1, 1, 1, 1]),
    "inverse distance": (pd.inverse_distance_influence, [4, 2, 4 / 3, 1]),
    "linear": (pd.linear_influence, [0.75, 0.5, 0.25, 0]),
    "cubic spline": (pd.cubic_spline_influence, [23 / 32, 1 / 4, 1 / 32, 0]),
    "gaussian": (pd.gaussian_influence, np.exp([-1 / 4, -1, -9 / 4, -4])),
    "gaussian, wide": (partial(pd.gaussian_influence, width=1.0), np.exp([-1 / 16, -1 / 4, -9 / 16, -1])),
    "a user's": (lambda r, delta: (r / delta) ** 2 + 0.5, [0.5625, 0.75, 1.0625, 1.5]),
}


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("horizon", [1.0, 0.3])
def test_known_values(name, horizon):
    influence, values = KNOWN[name]
    q = jnp.array([0.25, 0.5, 0.75, 1.0])
    assert worst(influence(q * horizon, horizon), np.array(values, dtype=float)) < 1e-14  # 9e-16


@pytest.mark.parametrize("name", KNOWN)
def test_even_and_nonnegative_in_a_family(name):
    """Opposite bonds have equal ω to the last bit, and ω is not negative just beyond the horizon."""
    influence, _ = KNOWN[name]
    omega = np.asarray(pd.lattice_family(3, 2, 0.1, influence).influence)
    assert np.array_equal(omega[: len(omega) // 2], omega[len(omega) // 2 :])
    assert np.all(omega >= 0) and np.any(omega > 0)
    assert np.all(influence(jnp.array([1.0 + 1e-9]), 1.0) >= 0)


@given(q=st.floats(1e-3, 1.0), horizon=st.floats(1e-3, 1e3))
def test_influence_depends_only_on_length_over_horizon(q, horizon):
    for influence, _ in KNOWN.values():
        scaled, plain = (influence(jnp.asarray(q * h), jnp.asarray(h)) for h in (horizon, 1.0))
        assert worst(scaled / jnp.maximum(plain, 1e-300), plain / jnp.maximum(plain, 1e-300)) < 1e-9  # 1e-15


def test_cubic_spline_is_twice_continuously_differentiable():
    """Value, slope and curvature agree across q = ½ (¼, −3/2, 6) and are 0 at q = 1. The third derivative jumps."""
    derivatives = [lambda q: pd.cubic_spline_influence(q, 1.0)]
    for _ in range(3):
        derivatives.append(jax.grad(derivatives[-1]))
    below, above = ([float(d(jnp.asarray(0.5 + h))) for d in derivatives] for h in (-1e-9, 1e-9))
    assert worst(below[:3], [0.25, -1.5, 6.0]) < 1e-7  # 4e-8
    assert worst(above[:3], [0.25, -1.5, 6.0]) < 1e-7  # 1e-8
    assert abs(below[3] - 36) < 1e-9 and abs(above[3] + 12) < 1e-9  # 0
    end = [float(d(jnp.asarray(1 - 1e-9))) for d in derivatives[:3]]
    assert worst(end, 0.0) < 1e-7  # 1e-8


def test_parameters_are_traced_and_differentiable():
    """The derivative of a force density by the width equals its central difference; a new width compiles nothing."""
    body, u = bodies.points(1, "cloud"), bodies.displacement(1, "cloud", 1)

    @jax.jit
    def force(width):
        fams = pd.families(body, bodies.HORIZONS[1], partial(pd.gaussian_influence, width=width))
        return pd.force_density(MODELS["correspondence svk"], fams, u)

    width, step = 0.5, 1e-5
    slope = jax.jvp(force, (width,), (1.0,))[1]
    difference = (force(width + step) - force(width - step)) / (2 * step)
    assert worst(slope, difference) < 1e-8  # 3e-10
    assert worst(slope) > 1e-3
    at_half = pd.families(body, bodies.HORIZONS[1], pd.gaussian_influence)
    assert (
        worst(force(0.5), eqx.filter_jit(pd.force_density)(MODELS["correspondence svk"], at_half, u)) < 1e-15
    )  # 1e-16
    assert force._cache_size() == 1


def test_a_user_function_with_a_parameter_is_differentiable():
    """For ω = q^p on a lattice family, dω/dp = ω log q."""

    def power(r, delta, p):
        return (r / delta) ** p

    def omega(p):
        return pd.lattice_family(2, 2, 0.5, partial(power, p=p)).influence

    value, slope = jax.jvp(eqx.filter_jit(omega), (1.3,), (1.0,))
    q = np.linalg.norm(pd.lattice_family(2, 2).xi, axis=1) / 2
    assert worst(value, q**1.3) < 1e-15  # 0
    assert worst(slope, q**1.3 * np.log(q)) < 1e-15  # 0


def test_partial_volumes_agree_with_hand_computed_families():
    """1D, δ = 2h: β = 1, ½, so Σβξ² = 2(1 + ½·4) = 6.

    2D, δ = 2.2h: β = 1, 1, 0.7 at r/h = 1, √2, 2. 2D, δ = 1.6h: β = 2.1 − √2 at r/h = √2.
    """
    part = pd.partial_volume_influence(pd.constant_influence, 1.0)
    line = pd.lattice_family(1, 2, 1.0, part)
    assert worst(jnp.sum(line.influence * line.xi[:, 0] ** 2), 6.0) < 1e-15  # 0
    for N, at in ((2.2, {1: 1, 2: 1, 4: 0.7}), (1.6, {1: 1, 2: 2.1 - np.sqrt(2)})):
        fam = pd.lattice_family(2, N, 1.0, part)
        square = np.round(np.sum(np.asarray(fam.xi) ** 2, axis=1)).astype(int)
        assert worst(fam.influence, np.array([at[k] for k in square], dtype=float)) < 1e-15  # 2e-16
    weighted = pd.lattice_family(2, 2.2, 1.0, pd.partial_volume_influence(pd.inverse_distance_influence, 1.0))
    length = np.linalg.norm(weighted.xi, axis=1)
    assert worst(weighted.influence, np.where(length > 1.9, 0.7, 1.0) * 2.2 / length) < 1e-15  # 2e-16


def test_partial_volumes_give_the_closed_form_symbol_and_jacobian():
    """Springs in 1D, δ = 2h, h = ½: Ĵ(k) = −2ch[(1 − cos kh)/h + ½ (1 − cos 2kh)/2h].

    The middle point of a bar responds to a wave with the same factor.
    """
    h, c = 0.5, 1.3
    part = pd.partial_volume_influence(pd.constant_influence, h)
    k = 2.0
    exact = -2 * c * h * ((1 - np.cos(k * h)) / h + 0.5 * (1 - np.cos(2 * k * h)) / (2 * h))
    fam = pd.lattice_family(1, 2, h, part)
    symbol = pd.symbol(pd.BondBased(c), fam, jnp.eye(1), jnp.array([k]))
    assert worst(symbol, np.array([[exact]])) < 1e-14  # 4e-16
    bar = pd.bar(9, 9 * h)
    fams = pd.families(bar, 2 * h, part)
    wave = jnp.cos(k * (bar.positions - bar.positions[4]))
    assert worst(pd.jvp(pd.BondBased(c), fams, jnp.zeros((9, 1)), wave)[4], np.array([exact])) < 1e-14  # 0


def test_partial_volumes_are_differentiable_in_the_spacing():
    """For β = ½ + (δ − r)/h at r = 2, δ = 2.2: dβ/dh = −0.2/h². All spacings share one program; 0 is refused."""

    @jax.jit
    def beta(h):
        return pd.partial_volume_influence(pd.constant_influence, h)(jnp.array(2.0), 2.2)

    assert worst(jax.grad(beta)(0.8), -0.2 / 0.64) < 1e-14  # 2e-16
    assert worst(beta(0.5), 0.9) < 1e-14 and beta._cache_size() == 1  # 3e-16
    with pytest.raises(ValueError, match="spacing must be finite and > 0"):
        pd.partial_volume_influence(pd.constant_influence, 0.0)


@pytest.mark.parametrize("name", INFLUENCES)
def test_a_name_stands_for_its_function(name):
    named, meant = (pd.lattice_family(2, 2.5, influence=f) for f in (name, INFLUENCES[name]))
    assert np.array_equal(named.influence, meant.influence)
    body = pd.cloud(pd.lattice((4, 3)).positions, 1.0)
    assert np.array_equal(pd.families(body, 2.1, name).influence, pd.families(body, 2.1, INFLUENCES[name]).influence)


def test_partial_volumes_by_name_take_the_spacing_of_the_points():
    lattice, cloud = pd.lattice((9, 8), 0.5), pd.cloud(pd.lattice((9, 8), 0.5).positions, 0.25)
    meant = pd.partial_volume_influence("constant", 0.5)
    for body in (lattice, cloud):
        named, given = (pd.families(body, 1.6, f) for f in ("partial volume", meant))
        assert np.array_equal(named.influence, given.influence) and float(named.influence.min()) < 1
    named, given = (pd.lattice_family(2, 3.2, 0.5, f) for f in ("partial volume", meant))
    assert np.array_equal(named.influence, given.influence)
    lean = pd.families(lattice, 1.6, "partial volume", arrays=False)
    assert float(lean.grid.influence.min()) < 1
    with pytest.raises(ValueError, match="needs a spacing here"):
        pd.partial_volume_influence("partial volume", 0.5)


def test_parabolic_influence_has_known_values_and_unknown_names_are_refused():
    r = np.array([0.1, 0.5, 0.75, 1.0])
    assert np.allclose(pd.parabolic_influence(r, 1.0), [1, 1, 0.75, 0], atol=1e-15)
    with pytest.raises(ValueError, match="influence must be one of constant, inverse distance"):
        pd.lattice_family(2, 2, influence="gauss")
    with pytest.raises(ValueError, match="influence must be a function"):
        pd.lattice_family(2, 2, influence=3.0)
