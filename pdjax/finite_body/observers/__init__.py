"""Observers: quantities that `simulate` evaluates at every save of a motion.

A save is a state that a run stores. An observer is any JAX function (scene, snapshot) → array. `simulate` and
`simulate_diffrax` take a dictionary, name → observer, and return the values of all saves in `History.observed`. The
modules, in the order in which to read them:

    snapshot    what an observer receives, and observers that run on the host
    probes      displacements, reactions and section forces
    cracks      damage and crack tips
"""

from .cracks import CrackTip, Damage, crack_tip, damage
from .probes import Probe, Reaction, SectionForce, probe, reaction, section_force
from .snapshot import HostObserver, Snapshot, check_observers

__all__ = [
    "CrackTip",
    "Damage",
    "HostObserver",
    "Probe",
    "Reaction",
    "SectionForce",
    "Snapshot",
    "check_observers",
    "crack_tip",
    "damage",
    "probe",
    "reaction",
    "section_force",
]
