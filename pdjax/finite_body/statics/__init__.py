"""Statics: equilibria of a scene by several methods, equilibrium paths, and derivatives of an equilibrium.

The modules, in the order in which to read them:

    solve           solve, which chooses a method
    result          Equilibrium, the result
    newton          Newton's method with a line search
    trust_region    Newton's method with a trust region, for difficult equilibria
    relaxation      dynamic relaxation, without a Jacobian
    implicit        derivatives of an equilibrium, by the implicit function theorem
    arc_length      equilibrium_path: equilibria along the load, past limit points
"""

from .arc_length import EquilibriumPath, equilibrium_path
from .result import Equilibrium
from .solve import SOLVERS, solve

__all__ = ["SOLVERS", "Equilibrium", "EquilibriumPath", "equilibrium_path", "solve"]
