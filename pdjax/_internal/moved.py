"""Where the content of modules of earlier versions is now: importing one of them says so."""

import sys
from importlib.abc import MetaPathFinder
from typing import Any

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
    "ways.stream": "force.backends.streaming",
    "ways.walks": "force.backends.traversal",
    "ways.components": "force.backends.components",
    "ways.convolution": "force.backends.fft",
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
    "criteria.continuum": "infinite_lattice.criteria.continuum",
    "criteria.critical": "infinite_lattice.criteria.critical_load",
    "criteria.flutter": "infinite_lattice.criteria.flutter",
    "criteria.on_host": "infinite_lattice.criteria.on_host",
    "criteria.outcome": "infinite_lattice.criteria.outcome",
    "criteria.point": "infinite_lattice.criteria.point",
    "criteria.waves": "infinite_lattice.criteria.waves",
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


def hint(name: str) -> str:
    """The end of an error message about the module `pdjax.name`; empty for a module that never was."""
    whole = MOVED.get(name) or next(
        (f"{new}.{name[len(old) + 1 :]}" for old, new in _packages() if name.startswith(f"{old}.")), None
    )
    return "" if whole is None else f"; its content is in pdjax.{whole} now, and its public names in pdjax itself"


def _packages() -> list[tuple[str, str]]:
    return [(old, new) for old, new in MOVED.items() if old in ("statics", "dynamics", "closed_forms", "paper")]


class _Finder(MetaPathFinder):
    """Finds no module: it raises an error with a hint where Python would raise one without."""

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> None:
        """Raise ModuleNotFoundError for a module that has moved."""
        root, _, name = fullname.partition(".")
        if root == "pdjax" and hint(name):
            raise ModuleNotFoundError(f"there is no module {fullname}{hint(name)}", name=fullname)


def install() -> None:
    """Let imports of modules that have moved say where their content is."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
