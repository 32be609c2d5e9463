"""Tests of derivatives of a root by Newton steps, against closed forms."""

import jax
import jax.numpy as jnp
import pytest

from pdjax._internal.implicit_step import implicit_root, implicit_step


def cube_root(theta, order):
    """The root of x³ = θ, found without derivatives."""
    root = jax.lax.stop_gradient(jnp.cbrt(theta))
    return implicit_root(lambda x: x**3 - theta, root, order)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_derivatives_of_a_root_are_exact_up_to_the_order(order):
    found, exact, power = lambda theta: cube_root(theta, order), 2.0, 1 / 3
    for _ in range(order + 1):
        assert float(jax.jit(found)(8.0)) == pytest.approx(exact, rel=1e-12)  # 1e-15
        found, exact, power = jax.grad(found), exact * power / 8.0, power - 1
    assert abs(float(found(8.0)) / exact - 1) > 0.01  # The next order needs one more step.


def test_forward_and_reverse_derivatives_of_a_root_agree():
    forward = jax.jacfwd(jax.jacrev(lambda theta: cube_root(theta, 2)))(8.0)
    assert float(forward) == pytest.approx(-1 / 144, rel=1e-12)


def test_a_step_improves_the_root_and_its_slope_is_a_constant():
    near = jnp.asarray(2.0 + 1e-5)
    step, slope = implicit_step(lambda x: x**3 - 8.0, near)
    assert abs(float(near - step) - 2.0) < 1e-9  # 5e-11
    assert float(slope) == pytest.approx(12.0, rel=1e-4)
    assert float(jax.grad(lambda theta: implicit_step(lambda x: x**3 - theta * x, near)[1])(4.0)) == 0.0
