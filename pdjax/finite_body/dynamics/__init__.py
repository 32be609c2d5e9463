"""Motions of bodies: velocity Verlet, the solvers of diffrax, time steps, and growth rates and frequencies."""

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
