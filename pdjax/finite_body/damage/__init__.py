"""Bonds that break: criteria, the fracture energy that calibrates them, and the energy that a break releases.

The modules, in the order in which to read them:

    criteria              Criterion: which bonds break now, the same at both ends, padding and no-fail zones excluded
    critical_stretch      a bond breaks when its stretch exceeds s₀; s₀ from the fracture energy
    critical_bond_energy  a bond breaks when the work done on it exceeds w_c
    breaking_rule         a user's function of a bond and of the states of its ends
    fracture_energy       the energy per area that a plane of breaking bonds releases: closed forms and lattice sums
    released              the drop of the strain energy at a fixed displacement
"""

from .breaking_rule import BreakingRule
from .criteria import Criterion
from .critical_bond_energy import CriticalBondEnergy
from .critical_stretch import CriticalStretch
from .released import released_energy

BREAKING: dict[str, type[Criterion]] = {
    "critical stretch": CriticalStretch,
    "critical bond energy": CriticalBondEnergy,
    "rule": BreakingRule,
}
"""The breaking criteria by name. A new criterion is one class and one line."""

__all__ = ["BREAKING", "BreakingRule", "Criterion", "CriticalBondEnergy", "CriticalStretch", "released_energy"]
