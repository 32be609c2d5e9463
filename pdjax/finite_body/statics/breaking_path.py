"""The result of `solve_breaking`: the equilibria, the bonds that broke between them, the energies and the ending.

**Energies.** At a fixed displacement, breaking bonds release the drop of the strain energy. The body then moves to its
next equilibrium while supports and loads stay constant. It loses a further part of its energy, which in reality becomes
kinetic energy and heat. Both parts are sums over all rounds of breaking:

    released     Σ Π(u, before) − Π(u, after)
    dissipated   Σ Π(u₀) − Π(u₁) + λ V b·(u₁ − u₀)        u₀ before, u₁ after the motion

The works are sums by the trapezoidal rule over the states of the path, with R the force of the supports:

    supports     Σ ½ (R + R')·Δu,      loads    Σ ½ (λ + λ') V b·Δu

Between two load steps without a break the rule is exact for a linear body. The budget

    strain + released + dissipated − supports − loads

is therefore zero up to the nonlinearity of the load steps. In a stable equilibrium the energy has a minimum, so the
dissipated energy is not negative unless the body passes to another branch of equilibria.
"""

from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from ..._internal.ending import Ending
from ..._internal.shown import told
from ...geometry.bonds import Families


class BreakingEnding(Ending):
    """How `solve_breaking` ended."""

    FINISHED = 0, "the body carries the last load step"
    SEVERED = 1, "the body is severed: what is left is not strained by its supports"
    LOAD_LOST = 2, "a loaded piece broke off, so that no equilibrium exists"
    NO_EQUILIBRIUM = 3, "no equilibrium was found"


class BreakingEnergies(NamedTuple):
    """Energy budget of a `BreakingPath`, at all of its states.

    Attributes
    ----------
    strain : array, shape (states,)
        Strain energy Π [energy].
    released : array, shape (states,)
        Strain energy [energy] that breaking bonds have released at fixed displacements. It may fall for models other
        than BondBased.
    dissipated : array, shape (states,)
        Energy [energy] lost by the motions from one equilibrium to the next at constant load.
    supports : array, shape (states,)
        Work [energy] of the supports.
    loads : array, shape (states,)
        Work [energy] of the body forces.

    Examples
    --------
    >>> still = np.zeros(2)
    >>> pd.BreakingEnergies(np.array([0.0, 0.5]), still, still, np.array([0.0, 0.5]), still).error.tolist()
    [0.0, 0.0]
    """

    strain: Float[np.ndarray, " states"]
    released: Float[np.ndarray, " states"]
    dissipated: Float[np.ndarray, " states"]
    supports: Float[np.ndarray, " states"]
    loads: Float[np.ndarray, " states"]

    @property
    def error(self) -> Float[np.ndarray, " states"]:
        """The imbalance of the budget over the largest of the five energies at any state [-]."""
        total = self.strain + self.released + self.dissipated - self.supports - self.loads
        largest = max(float(np.abs(x).max()) for x in self)
        return total / (largest if largest > 0 else 1.0)


class BreakingPath(eqx.Module):
    """Result of `solve_breaking`: the equilibria of a body whose bonds break while its load grows.

    The first state is at rest. A load step without a break adds one state. A load step in which bonds break adds two
    states of the same load factor: the equilibrium before the first of them breaks, and the one after the last.

    Attributes
    ----------
    load_factors : array, shape (states,)
        Load factor λ [-] of every state.
    settled : array of bool, shape (states,)
        False for the equilibrium before bonds break: there bonds exceed the criterion.
    u : array, shape (states, points, dim)
        Displacements [length] of every state.
    reactions : array, shape (states, points, dim)
        Force [force] of the supports on every point of every state; 0 on free components.
    energies : BreakingEnergies
        Strain energy, released and dissipated energy, and the works [energy] of every state.
    alive : array of bool, shape (points, bonds)
        Bonds that are left at the end.
    broken_at : array, shape (points, bonds)
        Load factor [-] at which each bond broke, inf if it did not.
    separated : array of bool, shape (points,)
        Points of pieces that have broken off, so that nothing holds one of their rigid motions. Their displacement is
        one of many in equilibrium.
    intact : Families
        Families of the body before the first break.
    code : int
        Number of the ending; `ending` is the same as an enumeration.
    detail : str
        What else is to be said about the ending.
    factorisations : int
        Number of matrix factorisations.

    Examples
    --------
    A bar of 3 points is pulled apart at its ends. Its bonds break at the stretch 0.05, at the load factor 0.5:

    >>> body = pd.bar(3, 3.0)
    >>> held = pd.prescribe([0, 2], [[0.0], [0.2]])
    >>> bar = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held)
    >>> path = pd.solve_breaking(bar, pd.CriticalStretch(0.049), load_steps=4, bonds_per_step=1)
    >>> path.ending.name, path.load_factors.tolist(), path.broken_bonds
    ('SEVERED', [0.0, 0.25, 0.5, 0.5], 1)
    """

    load_factors: Float[np.ndarray, " states"]
    settled: Bool[np.ndarray, " states"]
    u: Float[np.ndarray, "states points dim"]
    reactions: Float[np.ndarray, "states points dim"]
    energies: BreakingEnergies
    alive: Bool[np.ndarray, "points bonds"]
    broken_at: Float[np.ndarray, "points bonds"]
    separated: Bool[np.ndarray, " points"]
    intact: Families
    code: int = eqx.field(static=True)
    detail: str = eqx.field(static=True, default="")
    factorisations: int = eqx.field(static=True, default=0)

    @property
    def ending(self) -> BreakingEnding:
        """How the path ended, as an enumeration."""
        return BreakingEnding.of(self.code)

    @property
    def reason(self) -> str:
        """How the path ended, in words."""
        return self.ending.reason + (f": {self.detail}" if self.detail else "")

    @property
    def families(self) -> Families:
        """Families of the body at the end, with the broken bonds."""
        return self.intact.with_broken(~self.alive)

    @property
    def broken_bonds(self) -> int:
        """Number of bonds that have broken. A bond between two points counts once."""
        return int(np.isfinite(self.broken_at).sum()) // 2

    def damage(self, state: int = -1) -> Float[np.ndarray, " points"]:
        """Damage φ of every point at a state: the share of its bonds that has broken.

        Parameters
        ----------
        state : int, optional
            Number of the state. Default: the last.

        Returns
        -------
        array, shape (points,)
            φ [-], from 0 to 1. It is 0 for a point without bonds.

        Examples
        --------
        >>> body = pd.bar(3, 3.0)
        >>> held = pd.prescribe([0, 2], [[0.0], [0.2]])
        >>> bar = pd.scene(body, pd.families(body, 1.0), pd.BondBased(1.0), held)
        >>> path = pd.solve_breaking(bar, pd.CriticalStretch(0.04), load_steps=4)
        >>> path.damage(1).tolist(), path.damage().tolist()
        ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0])
        """
        before = np.asarray(self.intact.weight) > 0
        factor = self.load_factors[state]
        broken = (self.broken_at <= factor) if self.settled[state] else (self.broken_at < factor)
        return (broken & before).sum(axis=1) / np.maximum(before.sum(axis=1), 1)

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        at = self.broken_at.min()
        broke = (
            f"{self.broken_bonds} bonds broke, the first at load factor {at:.6g}"
            if np.isfinite(at)
            else "no bond broke"
        )
        error = float(np.abs(self.energies.error).max())
        return (
            f"breaking: {self.reason}\n  {len(self.load_factors)} states up to load factor {self.load_factors[-1]:.6g};"
            f" {broke}; energy error {error:.1e} of the largest"
        )
