"""Points, fields and sets from files: `read_points`. `READERS` lists the formats; a new one is one module and one line.

A file is untrusted. Readers run no code from it: no pickles, no XML entities. They check announced sizes against the
length of the file before they allocate memory.
"""

import importlib
from pathlib import Path
from types import ModuleType

from .contents import States

# Module of the reader of each suffix.
READERS = {
    ".txt": "text",
    ".csv": "text",
    ".dat": "text",
    ".npz": "arrays",
    ".data": "lammps_data",
    ".lmp": "lammps_data",
    ".dump": "lammps_dump",
    ".lammpstrj": "lammps_dump",
    ".vtu": "vtu",
    ".vtk": "legacy_vtk",
    ".msh": "gmsh",
    ".inp": "abaqus",
    ".exo": "exodus",
    ".e": "exodus",
    ".ex2": "exodus",
    ".pvd": "series",
    ".series": "series",
    ".pvtu": "series",
}


def reader(path: Path) -> ModuleType:
    """The module that reads files of this suffix. Raises ValueError that lists the suffixes if there is none."""
    name = READERS.get(path.suffix.lower())
    if name is None:
        known = ", ".join(sorted(READERS))
        raise ValueError(f"{path.name} has a suffix that no reader knows; expected one of {known}; got {path.suffix!r}")
    return importlib.import_module(f".{name}", __package__)


def opened(path: Path) -> States:
    """The states of a file, by the reader of its suffix."""
    return reader(path).states(path)
