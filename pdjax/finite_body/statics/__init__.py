"""Statics: equilibria of a scene by several methods, equilibrium paths, and derivatives of an equilibrium."""

from .arc_length import EquilibriumPath, equilibrium_path
from .result import Equilibrium
from .solve import SOLVERS, solve

__all__ = ["SOLVERS", "Equilibrium", "EquilibriumPath", "equilibrium_path", "solve"]
