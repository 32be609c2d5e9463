"""Scenes: functions of numbers that return a problem, with its closed form where it has one. No files, no pictures.

At rest (`Scene`): `step_size_bar`, `singular_bar`, `clamped_plate`, `manufactured_plate`. Moving (`Motion`): `cuboid`,
`wave`.
"""

from .bodies import clamped_plate, manufactured_plate, singular_bar, step_size_bar
from .motions import cuboid, wave

__all__ = ["clamped_plate", "cuboid", "manufactured_plate", "singular_bar", "step_size_bar", "wave"]
