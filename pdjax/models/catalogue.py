# mypy: disable-error-code="arg-type"
"""The table of models that the atlas and the comparisons use. A new model is one line.

Each entry is a function that makes a model from a linear law with the Lamé constants λ, μ (3D solid, in 2D plane
strain) and one lattice family. All models then describe the same solid: models with a law evaluate it in their own
strain, LPS gets the law's two moduli, and bond-based models get its bulk modulus. The Poisson's ratio of a bond-based
model is that of the law only for λ = μ.
"""

from collections.abc import Callable

from .._internal.checks import on_device, on_host
from ..geometry.bonds import LatticeFamily
from .base import AbstractModel
from .bond_associated import BondAssociated, BondAssociatedForce
from .bond_based import BondBased
from .bond_level import BondLevel, BondLevelAverage
from .control import LittlewoodControl, SillingControl, WanControl
from .correspondence import Correspondence
from .laws import LinearElastic
from .lps import LPS
from .reproducing_kernel import ReproducingKernel
from .seth_hill import SethHill, TupekRadovitzky
from .sub_horizon import SubHorizon


def _bulk(law: LinearElastic, family: LatticeFamily):
    """The d-dimensional bulk modulus k = λ + 2μ/d [pressure]."""
    lam, mu = on_host((law.lam, law.mu))
    return on_device(lam + 2 * mu / family.dim)


Maker = Callable[[LinearElastic, LatticeFamily], AbstractModel]


def model_name(text: str) -> str:
    """The name in `CATALOGUE` that a typed name means.

    A hyphen may stand for a dash or a minus sign and 0.5 for ½, and case is ignored. The name of a class without a
    number, such as BondLevel, is accepted too. An unknown name raises ValueError, which lists the names.
    """
    names = {_plain(name): name for name in CATALOGUE} | CLASSES
    if _plain(text) not in names:
        raise ValueError("model must be one of\n  " + "\n  ".join(map(repr, CATALOGUE)) + f"\ngot {text!r}")
    return names[_plain(text)]


CLASSES = {
    "bondbased": "bond-based",
    "correspondence": "Silling",
    "bondlevel": "bond-level",
    "bondlevelaverage": "bond-level, two-sided",
    "bondassociated": "bond-associated",
    "bondassociatedforce": "bond-associated, force",
    "subhorizon": "sub-horizon",
    "reproducingkernel": "reproducing kernel 2",
}
"""The model in `CATALOGUE` that the name of a class means."""


def _plain(name: str) -> str:
    return name.translate(str.maketrans({"–": "-", "—": "-", "−": "-", "½": "0.5"})).lower()


CATALOGUE: dict[str, Maker] = {
    "bond-based": lambda law, family: BondBased.from_family(_bulk(law, family), family),
    "bond-based, quadratic": lambda law, family: BondBased(BondBased.from_family(_bulk(law, family), family).c, 1.0),
    "LPS": lambda law, family: LPS(_bulk(law, family), law.mu),
    "Silling": lambda law, family: Correspondence(law),
    "Silling + penalty": lambda law, family: Correspondence(law, SillingControl()),
    "Silling + Wan": lambda law, family: Correspondence(law, WanControl()),
    "Silling + hourglass": lambda law, family: Correspondence(law, LittlewoodControl()),
    "Seth–Hill 1": lambda law, family: SethHill(1.0, law),
    "Seth–Hill ½": lambda law, family: SethHill(0.5, law),
    "Seth–Hill 0": lambda law, family: SethHill(0.0, law),
    "Seth–Hill −1": lambda law, family: SethHill(-1.0, law),
    "Seth–Hill 1 + penalty": lambda law, family: SethHill(1.0, law, SillingControl()),
    "Seth–Hill 1 + Wan": lambda law, family: SethHill(1.0, law, WanControl()),
    "Seth–Hill 1 + hourglass": lambda law, family: SethHill(1.0, law, LittlewoodControl()),
    "Seth–Hill 0 + penalty": lambda law, family: SethHill(0.0, law, SillingControl()),
    "Seth–Hill 0 + Wan": lambda law, family: SethHill(0.0, law, WanControl()),
    "Seth–Hill 0 + hourglass": lambda law, family: SethHill(0.0, law, LittlewoodControl()),
    "extended 1": lambda law, family: TupekRadovitzky(1.0, law),
    "extended 0": lambda law, family: TupekRadovitzky(0.0, law),
    "bond-level": lambda law, family: BondLevel(law),
    "bond-level, two-sided": lambda law, family: BondLevelAverage(law),
    "bond-associated": lambda law, family: BondAssociated(law),
    "bond-associated, force": lambda law, family: BondAssociatedForce(law),
    "sub-horizon": lambda law, family: SubHorizon(law),
    "reproducing kernel 2": lambda law, family: ReproducingKernel(law, 2),
}
"""Functions (law, family) → model by the name of the model: `pd.CATALOGUE["LPS"](law, family)`."""
