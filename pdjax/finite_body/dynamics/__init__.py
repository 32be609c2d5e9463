"""Motions of bodies: velocity Verlet, the solvers of diffrax, time steps, and growth rates and frequencies.

The modules, in the order in which to read them:

    system        Motion: a scene with density, initial state and supports that move (Ramp, SmoothRamp, Hold)
    time_step     the critical time step of explicit integration
    run           simulate: the motion, its saved states and its checks
    verlet        velocity Verlet, and the energies of a state
    terms         the solvers of diffrax for the same motion
    history       History, the result, and Failure, where and why a run ended
    rates         growth rates and frequencies, measured on a motion
    checkpoint    files from which a run continues
"""

from .history import Failure, History
from .rates import Rate, amplitude, measured_rate, verlet_rate
from .run import simulate
from .system import Hold, Motion, Ramp, SmoothRamp, motion
from .terms import diffrax_start, diffrax_terms, simulate_diffrax, symplectic_terms
from .time_step import critical_time_step
from .verlet import Energies

__all__ = [
    "Energies",
    "Failure",
    "History",
    "Hold",
    "Motion",
    "Ramp",
    "Rate",
    "SmoothRamp",
    "amplitude",
    "critical_time_step",
    "diffrax_start",
    "diffrax_terms",
    "measured_rate",
    "motion",
    "simulate",
    "simulate_diffrax",
    "symplectic_terms",
    "verlet_rate",
]
