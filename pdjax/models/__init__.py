"""Material models, laws and zero-energy controls, one short file each.

The modules, in the order in which to read them:

    kinematics             strains, stretches and shape tensors of one family
    laws                   classical laws: stress and energy of one strain
    base                   the base classes: what a model must define
    promises               a check of the promises of a user's model on one random bond
    with_law               the base of the models that have a classical law
    correspondence         Silling's correspondence model
    seth_hill              the generalised correspondence model, in Seth–Hill strains
    bond_based             springs
    lps                    the linear peridynamic solid
    control                zero-energy controls of the correspondence model
    bond_associated        correspondence with a sub-family for each bond
    sub_horizon            correspondence with a deformation gradient for each sector of the family
    bond_level             correspondence with a deformation gradient that is exact on each bond
    reproducing_kernel     the reproducing-kernel model
    graded                 a model whose energy is multiplied by a factor at each point
    linearised             a model linearised about the reference configuration
    plane                  moduli from E and ν, and the bulk modulus in plane strain and plane stress
    pointwise              the functions of a model at every point of a body
    catalogue              the table of models by name
"""

from . import kinematics, laws
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
    "kinematics",
    "laws",
    "linearised",
    "plane_bulk_modulus",
]
