"""Scenes: functions of numbers that return a problem, with its closed form if it has one.

`step_size_bar`, `singular_bar`, `clamped_plate`, `manufactured_plate`, `pulled_plate`, `cracked_plate` and
`double_cantilever` return a static problem (`Scene`). `cuboid`, `wave`, `spall_bar`, `branching_plate` and `kalthoff`
return an initial value problem (`Motion`). None of them reads or writes a file or draws a figure. The modules, in the
order in which to read them:

    bodies             the static scenes
    pulled             a plate with free sides, with or without a correction of its surfaces
    motions            the moving scenes
    fracture           a bar that breaks where waves meet
    cracked_plate      a plate with a crack in its middle, and the stress intensity of the handbook
    double_cantilever  two arms that are pulled apart, and the load of beam theory
    glass_plate        a notched plate whose crack branches
    edge_impact        a plate with two notches that is hit between them
    rayleigh           the speed of Rayleigh waves
    springs            the bond-based material of the two plates
    alternation        a measure of how strongly the displacements of neighbouring points alternate
"""

from .bodies import clamped_plate, manufactured_plate, singular_bar, step_size_bar
from .cracked_plate import CrackedPlate, cracked_plate
from .double_cantilever import DoubleCantilever, double_cantilever
from .edge_impact import EdgeImpact, kalthoff
from .fracture import Spall, spall_bar
from .glass_plate import GlassPlate, branching_plate
from .motions import cuboid, wave
from .pulled import pulled_plate

__all__ = [
    "CrackedPlate",
    "DoubleCantilever",
    "EdgeImpact",
    "GlassPlate",
    "Spall",
    "branching_plate",
    "clamped_plate",
    "cracked_plate",
    "cuboid",
    "double_cantilever",
    "kalthoff",
    "manufactured_plate",
    "pulled_plate",
    "singular_bar",
    "spall_bar",
    "step_size_bar",
    "wave",
]
