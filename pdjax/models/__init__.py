"""The material models, one short file each, and the one table of them."""

from .base import AbstractModel, PointStateModel
from .correspondence import Correspondence
from .graded import graded
from .seth_hill import SethHill

__all__ = ["AbstractModel", "Correspondence", "PointStateModel", "SethHill", "graded"]
