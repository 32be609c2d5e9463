"""The table of models that every test of an invariant runs over. A new model is one line.

`SMALLER` lists the bodies of models that are not tested on all six bodies, because each compilation takes seconds.
"""

import bodies
import jax.numpy as jnp

import pdjax as pd


class EnergyOnly(pd.AbstractModel):
    """A model reduced to its energy, so that the general path by autodiff evaluates it."""

    base: pd.AbstractModel

    def energy(self, bonds):
        return self.base.energy(bonds)

    def shape_tensor(self, bonds):
        return self.base.shape_tensor(bonds)


def quartic(E, c):
    """A law of a user in E that stiffens with strain."""
    return 0.5 * c["lam"] * jnp.trace(E) ** 2 + c["mu"] * jnp.sum(E * E) + c["b"] * jnp.sum(E * E) ** 2


LINEAR = pd.LinearElastic(lam=1.3, mu=0.7)
NEO_HOOKEAN = pd.NeoHookean(lam=1.3, mu=0.7)

MODELS = {
    "seth_hill m=1": pd.SethHill(1.0, LINEAR),
    "seth_hill m=0": pd.SethHill(0.0, LINEAR),
    "seth_hill m=-0.7": pd.SethHill(-0.7, LINEAR),
    "seth_hill user law": pd.SethHill(0.4, pd.EnergyLaw(quartic, "E", {"lam": 1.3, "mu": 0.7, "b": 2.0})),
    "correspondence svk": pd.Correspondence(LINEAR),
    "correspondence neo-hookean": pd.Correspondence(NEO_HOOKEAN),
    "seth_hill m=1, energy only": EnergyOnly(pd.SethHill(1.0, LINEAR)),
    "bond_based": pd.BondBased(20.0),
    "bond_based m=-0.3": pd.BondBased(20.0, -0.3),
    "lps": pd.LPS(1.5, 0.7),
    "silling control": pd.Correspondence(LINEAR, pd.SillingControl(0.5)),
    "wan control": pd.SethHill(0.4, LINEAR, pd.WanControl()),
    "littlewood control": pd.Correspondence(NEO_HOOKEAN, pd.LittlewoodControl(0.3)),
    "shell control": pd.SethHill(0.4, LINEAR, pd.ShellControl([0.3, 0.7, 1.0], [0.9, -0.2, 0.4])),
    "tupek_radovitzky": pd.TupekRadovitzky(0.4, LINEAR),
    "bond_level": pd.BondLevel(NEO_HOOKEAN),
    "bond_level average": pd.BondLevelAverage(LINEAR),
    "reproducing_kernel 1": pd.ReproducingKernel(LINEAR, 1),
    "reproducing_kernel 2": pd.ReproducingKernel(NEO_HOOKEAN, 2),
    "sub_horizon": pd.SubHorizon(LINEAR),
    "bond_associated": pd.BondAssociated(NEO_HOOKEAN, 0.8),
    "bond_associated force": pd.BondAssociatedForce(LINEAR),
}

FLAT = [(1, "cloud"), (2, "lattice"), (2, "cloud")]
SMALLER = dict.fromkeys(list(MODELS)[list(MODELS).index("bond_based") :], FLAT)
SMALLER |= {name: [*FLAT, (3, "cloud")] for name in ("lps", "wan control", "bond_level average")}
SMALLER["sub_horizon"] = [*FLAT, (3, "lattice")]  # in the cloud some points have no octant that spans space

# One model of each kind, for tests of the machinery only. The models left out share the code path of one of these.
KINDS = {
    name: model
    for name, model in MODELS.items()
    if name not in ("silling control", "wan control", "tupek_radovitzky", "reproducing_kernel 1")
}


def on_bodies(names=MODELS):
    """(name, dim, kind) of every model on every body it is tested on, in the dimensions it is defined in."""
    return [(n, *body) for n in names for body in SMALLER.get(n, bodies.BODIES) if body[0] in MODELS[n].dims]


def in_dimensions(names=MODELS, dims=(1, 2, 3)):
    """(name, dim) of every model in the dimensions it is defined in."""
    return [(name, dim) for name in names for dim in dims if dim in MODELS[name].dims]
