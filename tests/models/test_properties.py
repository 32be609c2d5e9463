"""Every model of the table on random bodies with cut bonds and mixed volumes: units, origin and order do not matter.

A body and its image in other units, at another origin or in another order have the same bonds, so the forces of one
follow from those of the other. All bodies have the same number of points and slots, so each model compiles once.
"""

import bodies
import equinox as eqx
import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from table import MODELS

import pdjax as pd

MODULI = ("lam", "mu", "b", "bulk", "shear")  # [pressure]; a bond constant is a pressure over length^(dim + 1)
SEEDS = st.integers(0, 2**32 - 1)
POINTS = 15


@eqx.filter_jit
def force(model, fams, u):
    return pd.force_density(model, fams, u)


class Body:
    """A jittered 2D body with volumes from 1 to 10, some bonds cut or weakened, and a displacement."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        self.x = pd.lattice((5, 3)).positions + 0.1 * rng.uniform(-1, 1, (POINTS, 2))
        self.volumes = 10 ** rng.uniform(0, 1, POINTS)
        strength = rng.choice([0.0, 0.6, 1.0], p=[0.05, 0.15, 0.8], size=(POINTS, POINTS))
        self.strength = np.triu(strength, 1) + np.triu(strength, 1).T
        self.u = 0.02 * rng.normal(size=(POINTS, 2))

    def families(self, order=slice(None), unit=1.0, shift=0.0):
        """Its families with the points in another order, lengths in other units and another origin."""
        cloud = pd.cloud(unit * (self.x[order] + shift), unit**2 * self.volumes[order])
        fams = bodies.padded(pd.families(cloud, unit * 2.6, "gaussian"), POINTS - 1)
        rows = np.arange(POINTS)[:, None]
        return fams.with_weight(np.asarray(fams.is_bond) * self.strength[order][:, order][rows, fams.neighbours])


def in_units(model, length, pressure):
    """The model of the same material with its constants in other units."""
    factors = dict.fromkeys(MODULI, pressure) | {"c": pressure / length**3}

    def scaled(path, leaf):
        name = getattr(path[-1], "name", getattr(path[-1], "key", None))
        return leaf * factors.get(name, 1.0)

    return jax.tree_util.tree_map_with_path(scaled, model)


def apart(a, b):
    return bodies.worst(a, b) / np.abs(b).max()


TRIED = [name for name in MODELS if 2 in MODELS[name].dims and name != "sub_horizon"]  # needs a lattice's quadrants


@settings(max_examples=6)
@given(seed=SEEDS, length=st.integers(-9, 6), pressure=st.integers(-6, 12), far=st.integers(0, 6))
@pytest.mark.parametrize("name", TRIED)
def test_forces_do_not_depend_on_units_origin_or_order_of_points(name, seed, length, pressure, far):
    model, body = MODELS[name], Body(seed)
    f = np.asarray(force(model, body.families(), body.u))
    momentum = np.abs(body.volumes @ f).max() / (body.volumes @ np.abs(f)).max()
    assert momentum < 1e-14  # 2e-16

    h, P = 10.0**length, 10.0**pressure
    assert apart(force(in_units(model, h, P), body.families(unit=h), h * body.u) * (h / P), f) < 1e-12  # 6e-15
    order = np.random.default_rng(seed).permutation(POINTS)
    assert apart(force(model, body.families(order), body.u[order]), f[order]) < 1e-12  # 7e-15
    shifted = body.families(shift=10.0**far * np.array([1.0, -0.3]))
    assert apart(force(model, shifted, body.u), f) < 1e-12 * 10**far  # 7e-15
