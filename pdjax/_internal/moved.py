"""The new places of modules of earlier versions. The import of an earlier module raises an error that names them."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import ModuleType

# A part of a package that has moved with its package has no line of its own.
MOVED = {
    "points": "geometry.points",
    "influence": "geometry.influence",
    "neighbours": "geometry.bonds",
    "family_search": "geometry.neighbour_search",
    "lattice_arrays": "geometry.stencils",
    "ties": "geometry.ties",
    "neighbourhoods": "geometry.report",
    "cuts": "geometry.cuts",
    "kinematics": "models.kinematics",
    "laws": "models.laws",
    "ways.promises": "models.promises",
    "evaluate": "force.operator",
    "shape_tensors": "force.shape_tensors",
    "point_fields": "force.point_fields",
    "devices": "force.backends.slabs",
    "ways": "force.backends",
    "assembly": "tangent.assembly",
    "coloring": "tangent.coloring",
    "linearise": "tangent.linearise",
    "bloch": "infinite_lattice.bloch",
    "zone": "infinite_lattice.brillouin",
    "climb": "infinite_lattice.climb",
    "cosine_series": "infinite_lattice.cosine_series",
    "lattice_states": "infinite_lattice.lattice_states",
    "paths": "infinite_lattice.paths",
    "waves": "infinite_lattice.dispersion",
    "cells": "infinite_lattice.cells",
    "maps": "infinite_lattice.maps",
    "atlas": "infinite_lattice.atlas",
    "criteria": "infinite_lattice.criteria",
    "criteria.body": "finite_body.spectrum",
    "criteria.body_critical": "finite_body.critical_load",
    "conditions": "finite_body.conditions",
    "problem": "finite_body.scene",
    "reduced": "finite_body.factorisation",
    "observers": "finite_body.observers",
    "statics": "finite_body.statics",
    "dynamics": "finite_body.dynamics",
    "export": "files.vtk",
    "closed_forms": "studies.closed_forms",
    "paper": "studies.paper",
    "figures.still": "figures.charts",
    "figures.moving": "figures.motions",
    "compilation_cache": "_internal.compilation_cache",
}


OUTSIDE = ("paper", "closed_forms", "compilation_cache")  # their names are not all names of pdjax itself


def hint(name: str) -> str:
    """The end of the error message for the earlier module `pdjax.name`. It is empty if no such module existed."""
    place = MOVED.get(name)
    if place is None:
        return ""
    text = f"; its content is now in pdjax.{place}"
    elsewhere = [f"{old} in pdjax.{MOVED[old]}" for old in MOVED if old.startswith(f"{name}.")]
    if elsewhere:
        text += f" ({', '.join(elsewhere)})"
    return text if name in OUTSIDE else f"{text}, and its public names are in pdjax itself"


class _Finder(MetaPathFinder):
    """A finder that finds no module. For a module that has moved it raises an error that names the new place."""

    def find_spec(self, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        """Raise ModuleNotFoundError for a module that has moved."""
        root, _, name = fullname.partition(".")
        place = hint(name) if root == "pdjax" else ""
        if place:
            raise ModuleNotFoundError(f"there is no module {fullname}{place}", name=fullname)


def install() -> None:
    """Add the finder, so that the import of a module that has moved names its new place."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
