"""Models whose symbol is a short sum of known functions of the load, so that one proof covers an interval of loads.

Let B_o(a) be the blocks of the cosine series along a load path. For the models below there are a factor φ(a) > 0 and a
few functions b_k(a) with

    φ(a) B_o(a) = Σ_k b_k(a) C_o,k    and constant blocks C.

On an interval of loads the curve b(a) lies in the convex hull of a few points, its vertices. The largest eigenvalue is
convex. If the series of all vertices have no positive eigenvalue, there is therefore none at any load of the interval.

**Straight**, b = (1, z). The vertices are the ends. On the hydrostatic path all bonds have the same stretch s = 1 + a:

    Seth–Hill and bond-based models of order m     φ B = X + ε (2m X + Y),   ε = (s^{2m} − 1)/2m,   φ = s^{2 − 2m}
    St. Venant–Kirchhoff energies of F̄              the same with m = 1
    linear peridynamic solid                        B = X + (1 − 1/s) Y

X is the material part at rest and Y the geometric part. A zero-energy control of constant stiffness adds a constant to
B. For m = 1 this changes nothing.

**Bent**, b = (1, ε, φ): Seth–Hill with m ≠ 1 and such a control. φ is a power of 1 + 2mε, hence a convex or a concave
function of ε. The vertices are the ends and the point where the tangents at the ends meet.

**Quadratic**, b = (1, a, a²), φ = 1. F is affine in a (hydrostatic, uniaxial strain, simple shear), the strains are
quadratic in F (energies of F̄, Green–Lagrange strains of bonds), and the law is linear. The energy is then quartic in
the displacements, and its second derivatives are quadratic. The third vertex is the Bézier control point
(1, ½(a₀ + a₁), a₀a₁).

At rest the energy has a minimum if weights, moduli and strengths are not negative, so that no eigenvalue is positive
(`rest_is_minimum`). Rest can then be an end of the interval. In the straight case the stable loads form one interval:
it cannot contain an unstable window.
"""

from collections.abc import Callable
from functools import singledispatch
from typing import NamedTuple

import numpy as np

from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ...models.bond_based import BondBased
from ...models.bond_level import GradientModel
from ...models.control import SillingControl, WanControl
from ...models.correspondence import Correspondence
from ...models.laws import LinearElastic
from ...models.lps import LPS
from ...models.seth_hill import SethHill, TupekRadovitzky
from ...models.shell_control import ShellControl
from ..paths import Path, hydrostatic, simple_shear, uniaxial_strain

_MODELS = "pdjax.models."
_NEAR = 1e-6  # Orders this close to ½ or 1 have no form.
AFFINE = (hydrostatic, uniaxial_strain, simple_shear)


class LoadForm(NamedTuple):
    """φ B = Σ b_k C_k along a path.

    `basis` gives b (terms,) of a load, and `scale` gives φ. `vertices` gives the vertices (vertices, terms) for the
    loads between two ends, the first end excluded. The last vertex is the second end.
    """

    basis: Callable[[float], np.ndarray]
    scale: Callable[[float], float]
    vertices: Callable[[float, float], np.ndarray]


def _straight(z: Callable[[float], float], scale: Callable[[float], float]) -> LoadForm:
    def basis(a: float) -> np.ndarray:
        return np.array([1.0, z(a)])

    return LoadForm(basis, scale, lambda low, high: basis(high)[None])


def _quadratic() -> LoadForm:
    def basis(a: float) -> np.ndarray:
        return np.array([1.0, a, a**2])

    def vertices(low: float, high: float) -> np.ndarray:
        return np.array([[1.0, (low + high) / 2, low * high], basis(high)])

    return LoadForm(basis, lambda a: 1.0, vertices)


def _strain(m: float, a: float) -> float:
    with np.errstate(over="ignore"):
        return float(np.log1p(a) if m == 0 else np.expm1(2 * m * np.log1p(a)) / (2 * m))


def _stretch(a: float, power: float) -> float:
    """(1 + a)^power, infinite if it overflows."""
    with np.errstate(over="ignore"):
        return float(np.power(1.0 + a, power))


def _power(m: float) -> LoadForm:
    """For bonds of one stretch whose strain is of order m."""
    return _straight(lambda a: _strain(m, a), lambda a: _stretch(a, 2 - 2 * m))


def _bent(m: float) -> LoadForm:
    """The same with a control of constant stiffness."""

    def scale(a: float) -> float:
        return _stretch(a, 2 - 2 * m)

    def basis(a: float) -> np.ndarray:
        return np.array([1.0, _strain(m, a), scale(a)])

    def vertices(low: float, high: float) -> np.ndarray:
        (_, e0, f0), (_, e1, f1) = basis(low), basis(high)
        k0, k1 = ((2 - 2 * m) * _stretch(a, 2 - 4 * m) for a in (low, high))  # dφ/dε
        meet = np.clip((f0 - f1 + k1 * e1 - k0 * e0) / (k1 - k0), *sorted((e0, e1)))  # It lies between the ends.
        return np.array([[1.0, meet, f0 + k0 * (meet - e0)], basis(high)])

    return LoadForm(basis, scale, vertices)


def load_form(model: AbstractModel, path: Path) -> LoadForm | None:
    """The form of a model along a path, or None if none is known. A subclass of a user may have any energy."""
    return _form(model, path) if type(model).__module__.startswith(_MODELS) else None


def rest_is_minimum(model: AbstractModel, family: LatticeFamily) -> bool:
    """Whether the signs of weights, moduli and strengths show that the energy is a minimum at rest.

    Weights, λ, μ and strengths that are not negative are sufficient. `WanControl` also needs a cubic family, in which
    the shape tensor is a multiple of I.
    """
    law, control = getattr(model, "law", None), getattr(model, "control", None)
    numbers = [family.influence]
    if law is not None:
        numbers += [law.lam, law.mu]
    if isinstance(control, ShellControl):
        numbers.append(control.strengths)
    known = control is None or type(control) in (SillingControl, ShellControl)
    known |= type(control) is WanControl and family.cubic
    return known and all(bool((np.asarray(x) >= 0).all()) for x in numbers)


@singledispatch
def _form(model: AbstractModel, path: Path) -> LoadForm | None:
    """`load_form` of a model of pdjax. Each kind of model registers its own function."""
    return None


def _quartic(path: Path) -> LoadForm | None:
    """For an energy that is quartic in the displacements."""
    return _power(1.0) if path is hydrostatic else _quadratic() if path in AFFINE else None


@_form.register(Correspondence)
def _of_gradient(model: Correspondence, path: Path) -> LoadForm | None:
    return _quartic(path) if model.degree and type(model.law) is LinearElastic else None


@_form.register(GradientModel)
def _of_gradients(model: GradientModel, path: Path) -> LoadForm | None:
    return _quartic(path) if type(model.law) is LinearElastic else None


@_form.register(SethHill)
@_form.register(TupekRadovitzky)
def _of_bond_strain(model: SethHill | TupekRadovitzky, path: Path) -> LoadForm | None:
    if type(model.law) is not LinearElastic:
        return None
    if model.degree:
        return _quartic(path)
    if path is not hydrostatic:
        return None
    m, control = float(model.m), model.control
    if control is None or (control.degree and m == 0.5):  # For m = ½, φ = 1 + ε.
        return _power(m)
    # Next to these orders 1, ε and φ are linearly dependent to rounding.
    return _bent(m) if control.degree and min(abs(m - 1), abs(m - 0.5)) > _NEAR else None


@_form.register(BondBased)
def _of_springs(model: BondBased, path: Path) -> LoadForm | None:
    return _power(0.5 if model.m is None else float(model.m)) if path is hydrostatic else None


@_form.register(LPS)
def _of_extensions(model: LPS, path: Path) -> LoadForm | None:
    return _straight(lambda a: a / (1 + a), lambda a: 1.0) if path is hydrostatic else None
