"""A point that has lost all its bonds has no force and no energy in any model, and all derivatives are finite."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import table

import pdjax as pd
from pdjax.force.backends.padded import Whole

KINDS = (
    "seth_hill m=-0.7",
    "seth_hill m=1, energy only",
    "bond_based",
    "lps",
    "silling control",
    "bond_level",
    "reproducing_kernel 2",
    "bond_associated",
)
BODY = pd.lattice((5, 4))
LOST = 19  # a corner
FAMS = pd.families(BODY, 2.3)
ENDS = np.asarray(FAMS.neighbours) == LOST
WEIGHT = np.where(ENDS | (np.arange(20)[:, None] == LOST), 0.0, 1.0)
U = 1e-2 * np.random.default_rng(0).normal(size=(20, 2))
KEEP = np.arange(20) != LOST
REST = pd.families(pd.cloud(BODY.positions[KEEP], 1.0), 2.3)


@pytest.mark.parametrize("name", [n for n, model in table.MODELS.items() if 2 in model.dims])
def test_a_point_without_bonds_has_no_force_and_does_not_affect_the_rest(name):
    model = table.MODELS[name]

    @jax.jit
    def answers(weight, u):
        fams = FAMS.with_weight(weight)
        energy = pd.strain_energy(model, fams, u) if model.hyperelastic else jnp.zeros(())
        return pd.force_density(model, fams, u), energy, pd.stress(model, fams, u)

    @jax.jit
    def slopes(weight, u):
        by_u = jax.jacfwd(lambda u: answers(weight, u)[0])(u)
        return by_u, jax.grad(lambda w: jnp.sum(answers(w, u)[0] ** 2))(weight)

    f, energy, stress = answers(WEIGHT, U)
    assert not f[LOST].any() and not stress[LOST].any()
    alone = pd.force_density(model, REST, U[KEEP])
    assert np.abs(f[KEEP] - alone).max() <= 1e-14 * np.abs(alone).max()  # 3e-16
    if model.hyperelastic:
        its_energy = pd.strain_energy(model, REST, U[KEEP])
        assert abs(energy - its_energy) <= 1e-14 * abs(its_energy)  # 2e-16
    if name in KINDS:
        by_u, by_weight = slopes(WEIGHT, U)
        assert np.isfinite(by_u).all() and not by_u[LOST].any() and not by_u[:, :, LOST].any()
        assert np.isfinite(by_weight).all() and not by_weight[LOST].any()  # 0 by convention
        sparse = pd.jacobian(model, FAMS.with_weight(WEIGHT), U).toarray().reshape(by_u.shape)
        assert np.abs(sparse - by_u).max() < 1e-14 * np.abs(by_u).max()  # 3e-16


@pytest.mark.parametrize("name", ["seth_hill m=-0.7", "lps", "silling control", "tupek_radovitzky"])
def test_a_point_without_bonds_has_no_force_in_streamed_backends(name):
    """Bodies with many bonds are streamed slot by slot, with prepared sums over the reference configuration."""
    model, body = table.MODELS[name], pd.lattice((40, 40))
    fams, lost = pd.families(body, 3.0), 815
    weight = np.where((np.asarray(fams.neighbours) == lost) | (np.arange(1600)[:, None] == lost), 0.0, 1.0)
    fams, u = fams.with_weight(weight), 1e-2 * np.random.default_rng(1).normal(size=(1600, 2))
    f = pd.force_density(model, fams, u)
    assert not isinstance(pd.force_operator(model, fams).backend, Whole) and not f[lost].any()
    keep = np.arange(1600) != lost
    alone = pd.force_density(model, pd.families(pd.cloud(body.positions[keep], 1.0), 3.0), u[keep])
    assert np.abs(f[keep] - alone).max() < 1e-13 * np.abs(alone).max()  # 2e-15
    assert np.isfinite(jax.grad(lambda u: jnp.sum(pd.force_density(model, fams, u) ** 2))(jnp.asarray(u))).all()


def test_a_singular_family_raises_and_under_jit_makes_only_its_own_point_nan():
    model, fams = pd.Correspondence(table.LINEAR), FAMS.with_weight(np.where(np.arange(20)[:, None] == LOST, 0.0, 1.0))
    poor = np.asarray(FAMS.weight).copy()
    poor[LOST, 1:] = 0.0
    fams = FAMS.with_weight(poor)
    with pytest.raises(ValueError, match=f"point {LOST}"):
        pd.force_density(model, fams, U)
    density = jax.jit(lambda w: pd.energy_density(model, FAMS.with_weight(w), U))(poor)
    assert np.flatnonzero(np.isnan(density)).tolist() == [LOST]


def test_both_held_halves_of_a_cut_body_find_their_equilibrium():
    """The left half stays at 0, and the right half moves as its support does."""
    fams = pd.cut(pd.families(BODY, 2.3), pd.Plane((2.0, 0.0), (1.0, 0.0)))
    x = BODY.positions[:, 0]
    scene = pd.scene(BODY, fams, pd.LPS(1.5, 0.7), pd.prescribe(x < 1, 0.0), pd.prescribe(x > 4, [0.1, 0.0]))
    u = np.asarray(pd.solve(scene).u)
    assert np.abs(u[x < 2]).max() < 1e-12 and np.abs(u[x > 2] - [0.1, 0.0]).max() < 1e-12  # 0, 3e-16
