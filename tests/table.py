"""The one table of models: every invariant runs over it; a new model is one line."""

import jax.numpy as jnp

import pdjax as pd


class EnergyOnly(pd.AbstractModel):
    """Any model with all but its energy taken away: the general path, by autodiff."""

    base: pd.AbstractModel

    def energy(self, bonds):
        return self.base.energy(bonds)

    def shape_tensor(self, bonds):
        return self.base.shape_tensor(bonds)


def quartic(E, c):
    """A user's law in E: stiffens with strain."""
    return 0.5 * c["lam"] * jnp.trace(E) ** 2 + c["mu"] * jnp.sum(E * E) + c["b"] * jnp.sum(E * E) ** 2


LINEAR = pd.LinearElastic(lam=1.3, mu=0.7)

MODELS = {
    "seth_hill m=1": pd.SethHill(1.0, LINEAR),
    "seth_hill m=0": pd.SethHill(0.0, LINEAR),
    "seth_hill m=-0.7": pd.SethHill(-0.7, LINEAR),
    "seth_hill user law": pd.SethHill(0.4, pd.EnergyLaw(quartic, "E", {"lam": 1.3, "mu": 0.7, "b": 2.0})),
    "correspondence svk": pd.Correspondence(LINEAR),
    "correspondence neo-hookean": pd.Correspondence(pd.NeoHookean(lam=1.3, mu=0.7)),
    "seth_hill m=1, energy only": EnergyOnly(pd.SethHill(1.0, LINEAR)),
}
