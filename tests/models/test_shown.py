"""Models, laws and controls print their names and values on one line."""

import equinox as eqx
import jax
import numpy as np
import pytest

import pdjax as pd
from pdjax._internal.shown import shown

LAW = pd.LinearElastic(1.0, 1.0)


def quartic(E, c):
    return c["b"] * (E**4).sum()


@pytest.mark.parametrize(
    ("module", "text"),
    [
        (LAW, "LinearElastic(lam=1.0, mu=1.0)"),
        (pd.LinearElastic(np.ones(20), 0.1), "LinearElastic(lam=array(20,), mu=0.1)"),
        (pd.NeoHookean(1, 2, "stress"), "NeoHookean(lam=1.0, mu=2.0, plane='stress')"),
        (
            pd.EnergyLaw(quartic, "E", {"b": 2.0, "rest": (np.ones(3),)}),
            "EnergyLaw(function=quartic, takes='E', constants={'b': 2.0, 'rest': (array(3,),)}, isotropic=False)",
        ),
        (pd.SillingControl(), "SillingControl(g=0.5)"),
        (pd.WanControl(), "WanControl()"),
        (pd.SethHill(1.0, LAW), "SethHill(m=1.0, law=LinearElastic(lam=1.0, mu=1.0))"),
        (
            pd.Correspondence(LAW, pd.LittlewoodControl()),
            "Correspondence(law=LinearElastic(lam=1.0, mu=1.0), control=LittlewoodControl(C=0.03))",
        ),
        (pd.BondBased(np.ones((20,))), "BondBased(c=array(20,))"),
        (pd.BondBased(1.0, 0.0), "BondBased(c=1.0, m=0.0)"),
    ],
)
def test_modules_are_shown_by_name_and_values(module, text):
    assert shown(module) == text
    if isinstance(module, pd.Law):
        assert repr(module) == str(module) == text


def test_single_precision_is_shown_with_its_own_digits():
    with jax.enable_x64(False):
        assert repr(pd.LinearElastic(0.1, np.float32(0.7))) == "LinearElastic(lam=0.1, mu=0.7)"


def test_traced_values_are_shown_by_their_shape():
    texts = []

    @jax.jit
    def show(law):
        texts.append(repr(law))
        return law.lam

    show(pd.LinearElastic(1.0, np.ones(3)))
    assert texts == ["LinearElastic(lam=traced(), mu=traced(3,))"]
    assert repr(jax.tree.map(lambda _: None, LAW)) == "LinearElastic(lam=None, mu=None)"


def test_printing_does_not_change_equinox():
    """The tree, the hash and equality are those of equinox, and so is its own printing."""
    assert eqx.tree_pformat(LAW) == "LinearElastic(lam=weak_f64[], mu=weak_f64[])"
    assert [float(leaf) for leaf in jax.tree.leaves(LAW)] == [1.0, 1.0]
    one, other = (pd.EnergyLaw(quartic, "E") for _ in range(2))
    assert hash(one) == hash(other) and one == other
