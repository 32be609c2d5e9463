"""Stability criteria of the infinite lattice, from cheap to decisive.

`stability` evaluates any of them and explains them in its docstring. Each criterion is a function (model, family, F,
at=None) → `Outcome`. `at` is the `Outcome.at` of an earlier call: the criterion then skips its search and evaluates
there. A criterion without a search ignores it. To add one, write such a function and add a line to `CRITERIA`. Only
"symbol", which searches the Brillouin zone, takes the zone before `at`.

The modules, in the order in which to read them:

    zones            the part of the Brillouin zone to search, for a family and a deformation
    outcome          the result of a criterion, and its verdict
    point            criteria of one point or of one family, without waves
    waves            the criteria "symbol", "affine" and "local"
    flutter          the criterion "symbol" for a model without an energy
    continuum        the criterion "continuum"
    on_host          criteria of concrete models, for maps of many states
    certified        the criterion "symbol" with a proof
    critical_load    critical loads along a path, and stable orders

Sources: Silling 2017 (material), Behzadinasab & Foster (diagonal, continuum), Born & Huang 1954 (symbol).
"""

from collections.abc import Callable

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import choice, deformation_gradient, frozen, is_concrete, on_device
from ..._internal.public import public_function
from ...force.fields import check_model
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..brillouin import Zone, brillouin_zone
from ..lattice_states import check_at_rest
from .certified import NOT_TRACED, certified_outcome, check_budget, check_criterion
from .continuum import continuum
from .on_host import outcomes
from .outcome import Outcome, Stability, margin_tolerance, verdicts
from .point import block, diagonal, material, material_center, material_neighbour
from .waves import affine, local, symbol
from .zones import family_zone, kept_symmetry

CRITERIA: dict[str, Callable[..., Outcome]] = {
    "diagonal": diagonal,
    "block": block,
    "material": material,
    "material_center": material_center,
    "material_neighbour": material_neighbour,
    "symbol": symbol,
    "affine": affine,
    "local": local,
    "continuum": continuum,
}


def evaluate(
    criterion: str,
    model: AbstractModel,
    family: LatticeFamily,
    F: Float[Array, "dim dim"],
    zone: Zone,
    at=None,
    fastest=False,
) -> Outcome:
    """The named criterion without checks and without `jit`, for the functions that trace it.

    If `at` is the field `at` of an earlier `Outcome`, the search is skipped. If `fastest` is True, "symbol" also finds
    the wave of the largest eigenvalue.
    """
    if criterion == "symbol":
        return symbol(model, family, F, zone, at, fastest)
    return CRITERIA[criterion](model, family, F, at)


@eqx.filter_jit
def _stability(model, family, F, criterion: str, intervals: int, symmetry: str) -> Outcome:
    zone = brillouin_zone(family.dim, intervals, symmetry)
    return evaluate(criterion, model, family, F, zone, fastest=True)


@eqx.filter_jit
def _with_derivative(model, family, F, criterion: str, intervals: int, symmetry: str, found: Outcome) -> Outcome:
    zone = brillouin_zone(family.dim, intervals, symmetry)
    return evaluate(criterion, model, family, F, zone, found.at, fastest=True)


def at_found(model, family, F, criterion: str, zone: Zone, found: Outcome) -> Outcome:
    """The criterion at the wave vector and mode of `found`, so that its derivatives flow."""
    return _with_derivative(model, family, F, criterion, zone.intervals, zone.symmetry, found)


@public_function
def stability(
    model: AbstractModel,
    family: LatticeFamily,
    F,
    criterion: str = "symbol",
    resolution: int | None = None,
    certify: float | None = None,
) -> Stability:
    """Decide whether the infinite lattice is stable under the homogeneous deformation x = F X.

    A small perturbation of the deformed lattice is a sum of plane waves u = e exp(ik·X). The wave of wave vector k and
    polarisation e grows if e is an eigenvector of the symbol Ĵ(k) with an eigenvalue λ > 0. The default criterion finds
    the worst wave of all. The other criteria are cheaper or answer another question, see Notes.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.
    criterion : str, optional
        One of the criteria of Notes.
    resolution : int, optional
        Grid intervals from 0 to π/h along each axis of the Brillouin zone, for the criterion "symbol". The default is 8
        for each spacing of the horizon.
    certify : float, optional
        Relative tolerance of a proof that the search of the zone has missed no wave, for the criterion "symbol", see
        `certify`. The result then has the proved bounds as `certificate`. If the proof finds a worse wave, the result
        is at that wave.

    Returns
    -------
    Stability
        The result, with these attributes:

        - `margin` [-] is the criterion as one dimensionless number: positive is unstable, negative is stable.
        - `tolerance` [-] is the rounding error of the margin. Margins between −tolerance and tolerance are zero.
        - `verdict` is the margin in words: "unstable", "stable", or "marginal" if the margin is zero. In a marginal
          state a motion, called a zero-energy mode, meets no resistance. The verdict of a NaN margin is "undefined".
        - `eigenvalue` is the eigenvalue behind the margin. For "symbol" it is λ [force/length^(dim+1)]. In an unstable
          state it is the largest λ of all waves, and √(λ/ρ) is the growth rate.
        - `wave_vector` [1/length] is the k of that eigenvalue, or None for criteria without waves. The zero vector
          stands for the limit of long waves, k → 0, along `direction`.
        - `mode` is the eigenvector, such as the polarisation e.

    Raises
    ------
    ValueError
        If the criterion is unknown, if det F ≤ 0, if the family is too small for the model, if the P-wave modulus M of
        the model at rest is not positive, or if the model lacks what the criterion needs: "local" needs a classical
        law, and "continuum" needs a point state and no zero-energy control. Also if a proof is asked for another
        criterion than "symbol", or of traced values.

    Notes
    -----
    Every criterion is a quantity that is negative in a stable state. Its margin is that quantity divided by a positive
    unit. M is the P-wave modulus of the model at rest [pressure], which is lam + 2 mu of a classical law. h is the
    spacing, w = ω V the weight of a bond, and K = Σ w ξ⊗ξ the shape tensor.

    - "diagonal": the largest diagonal entry of D = ∂f(X)/∂x(X), the block of the Jacobian at one point, divided by
      2 dim M/h². It is a necessary condition only, because D is the mean of the symbol over all waves. This is the
      criterion of the paper.
    - "block": the largest eigenvalue of D, divided by 2 dim M/h². For the same reason it is a necessary condition only.
    - "material_center": −dT·dY if the centre of one family moves, divided by (M/K₁₁) Σ w |dY|². dY is the increment of
      its deformed bonds, dT that of its force states, and dT·dY = Σ V dT·dY their work.
    - "material_neighbour": the same if one neighbour moves.
    - "material": the same for the worst dY of one family, translations and rotations excluded.
    - "symbol": the largest λ of all waves, each divided by M κ² with κ² = Σ_i ((2/h) sin(k_i h/2))². The limit k → 0
      is included. The criterion is exact on the infinite lattice, because every small perturbation is a sum of such
      waves. λ can be complex for a model without an energy. Then (Re √λ)² takes its place.
    - "affine": minus the smallest eigenvalue of the acoustic tensor of W(F), the energy of affine maps of the family,
      in the worst direction, divided by M. It is the long-wave limit k → 0 of "symbol".
    - "local": the same for ψ(F), the classical law behind the model, divided by M. It differs from "affine" for
      Seth–Hill models with m ≠ 1.
    - "continuum": the largest eigenvalue of D in the limit h → 0 at fixed horizon, for bonds of length 1 with weights
      of sum 1, divided by M. Only its sign has a meaning.

    First derivatives of the margin in `model`, `family` and `F` are exact, by the envelope theorem. Higher derivatives
    are not available.

    References
    ----------
    Silling 2017 (material); Behzadinasab & Foster, section 3.2, diagonal of the Jacobian (diagonal) and its
    continuum limit (continuum); Born & Huang 1954 (symbol).

    Examples
    --------
    The diagonal does not see the instability of the Seth–Hill model in 2 % of compression.

    >>> family = pd.lattice_family(2, 2)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> state = pd.stability(model, family, 0.98 * np.eye(2))
    >>> state.verdict, round(float(state.margin), 4)
    ('unstable', 0.0176)
    >>> pd.stability(model, family, 0.98 * np.eye(2), criterion="diagonal").verdict
    'stable'
    """
    choice("criterion", criterion, list(CRITERIA))
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    zone = family_zone(family, kept_symmetry(F, family, model.isotropic), resolution)
    quiet = quiet_model, quiet_family, quiet_F = frozen((model, family, F))
    certificate = None
    if certify is not None:
        check_budget(certify)
        check_criterion(criterion)
        if not is_concrete(quiet):
            raise ValueError(NOT_TRACED)
        out, certificate = certified_outcome(quiet_model, quiet_family, np.asarray(quiet_F), zone, certify)
        out = jax.tree.map(lambda x: x[0], out)
    elif is_concrete(quiet):
        out = outcomes(criterion, quiet_model, quiet_family, np.asarray(quiet_F)[None], zone)
        out = jax.tree.map(lambda x: x[0], out)
    else:
        check_at_rest(model, family)
        out = _stability(model, family, F, criterion, zone.intervals, zone.symmetry)
    if is_concrete(quiet) and not is_concrete(model, family, F):
        # Derivatives flow through the margin at the wave and mode found.
        out = at_found(model, family, F, criterion, zone, out)
    tolerance = margin_tolerance(family.xi.dtype, out.scale)
    numbers = on_device((out.margin, out.eigenvalue, out.mode, out.wave_vector, out.direction, tolerance))
    margin, eigenvalue, mode, wave_vector, direction, tolerance = numbers
    resolution = zone.intervals if criterion == "symbol" else None
    return Stability(criterion, margin, eigenvalue, mode, wave_vector, direction, tolerance, resolution, certificate)


__all__ = [
    "CRITERIA",
    "Outcome",
    "Stability",
    "at_found",
    "check_at_rest",
    "critical_load",
    "evaluate",
    "family_zone",
    "kept_symmetry",
    "margin_tolerance",
    "stability",
    "verdicts",
]
