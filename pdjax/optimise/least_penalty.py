"""The least strength of a zero-energy control that makes all load cases stable.

The energy of a control is linear in its strength g. For a fixed wave and polarisation the quotient v·Ĵv/(M κ²) is
therefore linear in g, and the worst margin, a maximum of such functions, is convex in g. It decreases, because the
control only adds stiffness. Newton's method from g = 0 then approaches the root from below and never passes it. It ends
after as many steps as different waves are worst on the way, usually two to four.

A control does not act on affine deformations, that is on the limit of long waves. If the worst wave is long, the
derivative in g is zero and no strength suffices.
"""

from collections.abc import Callable

import jax
import numpy as np

from .._internal.checks import as_array
from .._internal.public import public_function
from ..geometry.bonds import LatticeFamily
from ..infinite_lattice.criteria import family_zone
from ..infinite_lattice.criteria.on_host import outcomes
from ..infinite_lattice.lattice_states import STATES
from ..models.base import AbstractModel
from .load_cases import LoadCases, checked_cases
from .margins import worst_margin

FLAT = 1e-9  # With a smaller slope the worst wave may be a long one, on which the control does not act.
TOLERANCE = 1e-12
STEPS = 50


class _Flat(Exception):
    """The margin does not depend on the strength."""


def _long_waves_grow(model: AbstractModel, family: LatticeFamily, loads: LoadCases, margin: float) -> bool:
    """Whether a long wave has a larger margin than `margin` in some case, so that no control can help."""
    cases = np.asarray(checked_cases(loads, model, family)[0])
    zone = family_zone(family, "inversion", None)
    parts = (cases[i : i + STATES] for i in range(0, len(cases), STATES))
    return any((outcomes("affine", model, family, part, zone).margin > margin + TOLERANCE).any() for part in parts)


@public_function
def least_penalty(
    build: Callable[..., AbstractModel], family: LatticeFamily, loads: LoadCases, margin: float = 0.0
) -> float:
    """Find the least strength of a zero-energy control at which no load case has a larger margin than the given one.

    min g ≥ 0   with   worst_margin(build(g)) ≤ margin

    Parameters
    ----------
    build : callable
        Strength g → model, such as ``lambda g: pd.SethHill(1.0, law, pd.SillingControl(g))``. The energy must be
        linear in g and must not decrease with it.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    loads : LoadCases or array, shape (cases, dim, dim)
        The load cases, see `worst_margin`.
    margin : float, optional
        Largest margin [-] that is allowed, at most 0. With 0, the least penalty is just marginal.

    Returns
    -------
    float
        The least strength g [-]. It is 0 if no control is needed, and infinite if none suffices, because the worst wave
        is a long wave, on which controls do not act.

    Raises
    ------
    ValueError
        If `margin` is positive, if a load path has no state, if the margin does not decrease with g, or for what
        `worst_margin` refuses.

    Examples
    --------
    In 1D with m = 1 the least penalty for 5 % of compression equals the Green–Lagrange strain, (1 − 0.95²)/2.

    >>> law, family = pd.LinearElastic(1.0, 1.0), pd.lattice_family(1, 2)
    >>> cases = pd.load_cases("hydrostatic", [-0.05])
    >>> round(pd.least_penalty(lambda g: pd.SethHill(1.0, law, pd.SillingControl(g)), family, cases), 6)
    0.04875
    """
    if not margin <= 0:
        raise ValueError(f"margin must be at most 0, because an unstable lattice is not wanted; got {margin}")
    rate = jax.value_and_grad(lambda g: worst_margin(build(g), family, loads))

    def excess(g: float) -> tuple[float, float]:
        value, slope = (float(x) for x in rate(as_array(g)))
        if np.isnan(value):
            raise ValueError("loads must have a state on every path; the margin of a case is NaN")
        if abs(value - margin) <= TOLERANCE or (g == 0 and value <= margin):
            return 0.0, slope
        if slope > -FLAT:
            if _long_waves_grow(build(g), family, loads, margin):
                raise _Flat
            if not slope < 0:
                raise ValueError(
                    f"build must return a model whose margin decreases with g; its derivative at g = {g:g} is {slope:g}"
                )
        return value - margin, slope

    from scipy.optimize import root_scalar  # imported here, because the import takes a third of a second

    try:
        return float(root_scalar(excess, x0=0.0, fprime=True, method="newton", xtol=1e-14, maxiter=STEPS).root)
    except _Flat:
        return float(np.inf)
