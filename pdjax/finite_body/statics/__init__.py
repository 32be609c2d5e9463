"""Statics: equilibria of a scene by several methods, equilibrium paths, and derivatives of an equilibrium.

The modules, in the order in which to read them:

    solve           solve, which chooses a method
    result          Equilibrium, the result
    newton          Newton's method with a line search
    trust_region    Newton's method with a trust region, for difficult equilibria
    relaxation      dynamic relaxation, without a Jacobian
    implicit        derivatives of an equilibrium, by the implicit function theorem
    arc_length      equilibrium_path: equilibria along the load, past limit points
    breaking        solve_breaking: equilibria of a body whose bonds break while its load grows
    breaking_rounds the rounds of solve_breaking: solve, find the bonds that break, break them
    breaking_path   BreakingPath, its result
    recycled        the linear solver of solve_breaking, which uses a factorisation many times
    load_paths      the pieces that have broken off, and whether a load path remains
"""

from .arc_length import EquilibriumPath, equilibrium_path
from .breaking import solve_breaking
from .breaking_path import BreakingEnergies, BreakingPath
from .result import Equilibrium
from .solve import SOLVERS, solve

__all__ = [
    "SOLVERS",
    "BreakingEnergies",
    "BreakingPath",
    "Equilibrium",
    "EquilibriumPath",
    "equilibrium_path",
    "solve",
    "solve_breaking",
]
