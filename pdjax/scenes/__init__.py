"""Scenes: functions of numbers that return a problem, with its closed form if it has one.

`step_size_bar`, `singular_bar`, `clamped_plate`, `manufactured_plate` and `pulled_plate` return a static problem
(`Scene`). `cuboid` and `wave` return an initial value problem (`Motion`). None of them reads or writes a file or draws
a figure. The modules, in the order in which to read them:

    bodies         the static scenes
    pulled         a plate with free sides, with or without a correction of its surfaces
    motions        the moving scenes
    alternation    a measure of how strongly the displacements of neighbouring points alternate
"""

from .bodies import clamped_plate, manufactured_plate, singular_bar, step_size_bar
from .motions import cuboid, wave
from .pulled import pulled_plate

__all__ = ["clamped_plate", "cuboid", "manufactured_plate", "pulled_plate", "singular_bar", "step_size_bar", "wave"]
