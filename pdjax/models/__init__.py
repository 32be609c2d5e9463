"""Material models, laws and zero-energy controls, one short file each."""

from .base import AbstractModel, PointStateModel, TwoStageModel
from .bond_associated import BondAssociated, BondAssociatedForce
from .bond_based import BondBased
from .bond_level import BondLevel, BondLevelAverage
from .catalogue import CATALOGUE
from .control import LittlewoodControl, SillingControl, WanControl
from .correspondence import Correspondence
from .graded import graded
from .linearised import linearised
from .lps import LPS
from .plane import plane_bulk_modulus
from .reproducing_kernel import ReproducingKernel
from .seth_hill import SethHill, TupekRadovitzky
from .shell_control import ShellControl
from .sub_horizon import SubHorizon

__all__ = [
    "CATALOGUE",
    "LPS",
    "AbstractModel",
    "BondAssociated",
    "BondAssociatedForce",
    "BondBased",
    "BondLevel",
    "BondLevelAverage",
    "Correspondence",
    "LittlewoodControl",
    "PointStateModel",
    "ReproducingKernel",
    "SethHill",
    "ShellControl",
    "SillingControl",
    "SubHorizon",
    "TupekRadovitzky",
    "TwoStageModel",
    "WanControl",
    "graded",
    "linearised",
    "plane_bulk_modulus",
]
