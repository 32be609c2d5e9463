"""Orders m of a Seth–Hill strain that are known when the force is prepared: 1, ½, 0, −½ and −1 need no exponential."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.models.kinematics import ORDERS, bond_strain, power_over_square

LAW = pd.LinearElastic(1.0, 1.0)
BODY = pd.lattice((9, 7))
FAMILIES = pd.families(BODY, 2.1)
U = 0.05 * np.random.default_rng(0).normal(size=BODY.positions.shape)
MODELS = {
    "Seth-Hill": lambda m: pd.SethHill(m, LAW),
    "Tupek-Radovitzky": lambda m: pd.TupekRadovitzky(m, LAW),
    "controlled": lambda m: pd.SethHill(m, LAW, pd.SillingControl(0.3)),
    "bond-based": lambda m: pd.BondBased(1.0, m),
}


@pytest.mark.parametrize("m", ORDERS)
def test_strains_of_known_orders_have_all_digits(m):
    """Against the definition, in 40 digits."""
    mpmath = pytest.importorskip("mpmath")
    mpmath.mp.dps = 40
    for eta in (1e-9, 1e-3, 0.3, -0.4, 4.0):
        s, order = 1 + mpmath.mpf(eta), mpmath.mpf(m)
        strain = mpmath.log(s) if m == 0 else (s ** (2 * order) - 1) / (2 * order)
        power = s ** (2 * order) / s**2
        xi, move = jnp.ones(1), jnp.full(1, eta)
        assert float(bond_strain(xi, move, m)) == pytest.approx(float(strain), rel=1e-15)  # measured 3e-16
        assert float(power_over_square(xi, move, m)) == pytest.approx(float(power), rel=2e-15)  # measured 6e-16


@pytest.mark.parametrize(
    ("name", "m", "way"),
    [("Seth-Hill", m, way) for m in ORDERS for way in ("families", "slices")]
    + [(name, 0.5, "slices") for name in list(MODELS)[1:]],
)
def test_a_known_order_has_the_force_of_a_traced_one(name, m, way):
    known = pd.force_density(MODELS[name](m), FAMILIES, U, way=way)
    traced = jax.jit(lambda m: pd.force_density(MODELS[name](m), FAMILIES, U, way=way))(m)
    assert np.abs(known - traced).max() < 1e-13 * np.abs(traced).max()  # measured up to 2e-15


@pytest.mark.parametrize("m", [1.0, 0.0])
def test_derivatives_in_a_known_order_are_exact(m):
    """The order is traced where a derivative with respect to it is taken, also where the value is known."""

    def force(m):
        return jnp.sum(jnp.sin(pd.force_density(pd.SethHill(m, LAW), FAMILIES, U)))

    central = (float(force(m + 1e-5)) - float(force(m - 1e-5))) / 2e-5
    for derivative in (jax.grad(force)(m), jax.jacfwd(force)(m)):
        assert float(derivative) == pytest.approx(central, rel=1e-6)  # measured 1e-9


@pytest.mark.parametrize("m", [1.0, 0.3])
def test_a_known_order_needs_no_exponential(m):
    operator = pd.force_operator(pd.SethHill(m, LAW), FAMILIES, way="slices")
    text = jax.jit(operator).lower(U).as_text()
    assert ("exponential" in text) == (m not in ORDERS)


def test_an_order_of_each_point_and_an_integer_order_work():
    orders = np.full(len(BODY), 0.5)
    each = pd.force_density(pd.SethHill(orders, LAW), FAMILIES, U)
    one, whole = (pd.force_density(pd.SethHill(m, LAW), FAMILIES, U) for m in (0.5, 1))
    assert np.abs(each - one).max() < 1e-13 * np.abs(one).max()  # measured 1e-15
    assert np.abs(whole - pd.force_density(pd.SethHill(1.0, LAW), FAMILIES, U)).max() == 0
