"""Influence functions ω(r, δ): the weight of a bond of reference length r in a family of horizon δ.

An influence function is any callable (r, δ) → ω ≥ 0. `lattice_family` and `families` call it once. They pass NumPy
arrays if r and δ are known, and JAX arrays if they are traced. Operators and functions of jax.numpy accept both.

An influence function must not be negative: a negative weight can make a shape tensor singular and a body unstable.
`signed_influence` lifts this rule for one function.

An influence function depends on the distance alone. It is therefore even, ω(ξ) = ω(−ξ), and keeps the symmetry of the
lattice. Pass parameters with `functools.partial`, for example `partial(gaussian_influence, width=w)`. They may be
traced and differentiated.

    name                ω as a function of q = r/δ                name in public codes
    "constant"          1                                         Peridigm "One"
    "inverse distance"  1/q                                       LAMMPS peri/lps 1/r; Peridynamics.jl "linear"
    "linear"            1 − q
    "parabolic"         1 for q ≤ ½, 4q(1 − q) beyond             Peridigm "Parabolic Decay"
    "gaussian"          exp(−(q/width)²), width ½                 Peridigm "Gaussian" with width 1
    "cubic spline"      1 − 6q² + 6q³ for q ≤ ½, 2(1 − q)³ beyond Peridynamics.jl "cubic B-spline"
    "partial volume"    ½ + (δ − r)/h, limited to [0, 1]          LAMMPS, with the spacing h

A constant factor on ω does not change correspondence models and LPS, because they divide their sums by sums of ω.

The horizon may cut the cell of a neighbour. `partial_volume_influence` then counts only a part of the neighbour's
volume. ω and V enter every sum as a product, so it applies the factor to ω. By name it takes the spacing of the
lattice, or for a cloud V^(1/dim) of the median volume.

Sources: Silling & Askari 2005 and Seleson & Parks 2011 for the common choices, Monaghan 1992 for the spline, Parks et
al. 2008 for the partial volumes (LAMMPS).
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, check_positive, choice, namespace, on_host
from .._internal.public import public_function

Lengths = Float[Array | np.ndarray, "..."]


def _together(r: Lengths, *others: object) -> tuple[Any, ...]:
    """The module to compute with, r and the others. It is NumPy if r is a NumPy array and no value is traced."""
    if not isinstance(r, np.ndarray):
        return jnp, r, *others
    return namespace(others), r, *on_host(others)


@public_function
def constant_influence(r: Lengths, horizon) -> Lengths:
    """Constant influence function.

    ω = 1

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length]; ω does not depend on it.

    Returns
    -------
    array, shape of r
        ω [-].

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 1.0])
    >>> pd.constant_influence(r, 1.0).tolist()
    [1.0, 1.0, 1.0]
    """
    xp, r = _together(r)
    return xp.ones_like(r)


@public_function
def inverse_distance_influence(r: Lengths, horizon) -> Lengths:
    """Influence function that is inversely proportional to the distance.

    ω = δ/r

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length].

    Returns
    -------
    array, shape of r
        ω [-].

    Notes
    -----
    Some public codes call this function "linear", for example Peridynamics.jl. In pdjax `linear_influence` is
    1 − r/δ, which is zero at the horizon.

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 1.0])
    >>> pd.inverse_distance_influence(r, 1.0).tolist()
    [4.0, 2.0, 1.0]
    """
    _, r, horizon = _together(r, horizon)
    return horizon / r


@public_function
def linear_influence(r: Lengths, horizon) -> Lengths:
    """Influence function that decreases linearly to zero at the horizon.

    ω = 1 − r/δ

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length].

    Returns
    -------
    array, shape of r
        ω [-].

    Notes
    -----
    Some public codes use the name "linear" for δ/r, for example Peridynamics.jl. In pdjax that function is
    `inverse_distance_influence`. With N = 1 all bonds are as long as the horizon and ω is zero for all of them, which
    `lattice_family` refuses.

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 1.0])
    >>> pd.linear_influence(r, 1.0).tolist()
    [0.75, 0.5, 0.0]
    """
    xp, r, horizon = _together(r, horizon)
    return xp.maximum(1 - r / horizon, 0)


@public_function
def cubic_spline_influence(r: Lengths, horizon) -> Lengths:
    """Cubic B-spline, scaled to 1 at r = 0 and zero at the horizon.

    ω = 1 − 6q² + 6q³ for q = r/δ ≤ ½, 2(1 − q)³ beyond

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length].

    Returns
    -------
    array, shape of r
        ω [-].

    References
    ----------
    Monaghan 1992

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 1.0])
    >>> pd.cubic_spline_influence(r, 1.0).tolist()
    [0.71875, 0.25, 0.0]
    """
    xp, r, horizon = _together(r, horizon)
    q = xp.minimum(r / horizon, 1)
    return xp.where(q <= 0.5, 1 - 6 * q**2 + 6 * q**3, 2 * (1 - q) ** 3)


@public_function
def gaussian_influence(r: Lengths, horizon, width=0.5) -> Lengths:
    """Gaussian influence function, cut off at the horizon.

    ω = exp(−(r/(width·δ))²)

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length].
    width : float, optional
        Width as a fraction of the horizon [-]. It may be traced.

    Returns
    -------
    array, shape of r
        ω [-].

    Notes
    -----
    The function itself is positive for all r. It is cut off because a family holds no bond beyond the horizon. Pass
    another width with `functools.partial(pd.gaussian_influence, width=0.3)`.

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 1.0])
    >>> pd.gaussian_influence(r, 1.0).round(3).tolist()
    [0.779, 0.368, 0.018]
    """
    xp, r, horizon, width = _together(r, horizon, width)
    return xp.exp(-((r / (width * horizon)) ** 2))


@public_function
def parabolic_influence(r: Lengths, horizon) -> Lengths:
    """Influence function that is 1 up to half the horizon and falls as a parabola to zero.

    ω = 1 for q = r/δ ≤ ½, 4q(1 − q) beyond

    Parameters
    ----------
    r : array
        Reference lengths of bonds [length].
    horizon : float
        Horizon δ [length].

    Returns
    -------
    array, shape of r
        ω [-].

    Examples
    --------
    >>> r = np.array([0.25, 0.5, 0.75, 1.0])
    >>> pd.parabolic_influence(r, 1.0).tolist()
    [1.0, 1.0, 0.75, 0.0]
    """
    xp, r, horizon = _together(r, horizon)
    q = xp.minimum(r / horizon, 1)
    return xp.where(q <= 0.5, 1, 4 * q * (1 - q))


INFLUENCES: dict[str, Callable] = {
    "constant": constant_influence,
    "inverse distance": inverse_distance_influence,
    "linear": linear_influence,
    "parabolic": parabolic_influence,
    "gaussian": gaussian_influence,
    "cubic spline": cubic_spline_influence,
}


PARTIAL = "partial volume"  # the one name whose function depends on the spacing


def named_influence(influence: object, spacing: object = None) -> Callable:
    """Return the influence function itself, or the one with this name.

    The name "partial volume" is `partial_volume_influence` with ω = 1. It needs the spacing of the points.
    """
    names = (*INFLUENCES, PARTIAL)
    if isinstance(influence, str):
        if choice("influence", influence, names) != PARTIAL:
            return INFLUENCES[influence]
        if spacing is None:
            raise ValueError(f"influence {PARTIAL!r} needs a spacing here; use pd.partial_volume_influence(ω, spacing)")
        return partial_volume_influence("constant", spacing)
    if not callable(influence):
        raise ValueError(
            f"influence must be a function (r, horizon) → ω, or one of {', '.join(names)}; got {influence!r}"
        )
    return influence


@public_function
def partial_volume_influence(influence: Callable | str, spacing) -> Callable:
    """Influence function times the share β of a neighbour's volume that lies within the horizon.

    β(r) = ½ + (δ − r)/h, limited to [0, 1]

    β is 1 for bonds shorter than the horizon by at least half a spacing, and ½ for bonds as long as the horizon.

    Parameters
    ----------
    influence : callable or str
        Influence function (r, δ) → ω ≥ 0, or its name.
    spacing : float
        Spacing h of the lattice [length], > 0. It may be traced.

    Returns
    -------
    callable
        (r, δ) → ω β [-]. Pass it to `lattice_family` or `families` as `influence`.

    Raises
    ------
    ValueError
        If the spacing is not finite and > 0.

    Notes
    -----
    A family holds only the points within δ. A point beyond δ is no neighbour, even if the horizon cuts its cell.

    References
    ----------
    Parks et al. 2008; the PERI package of LAMMPS uses this formula.

    Examples
    --------
    On a line with δ = 2h, the neighbour at distance h counts in full and that at 2h counts by half.

    >>> part = pd.partial_volume_influence("constant", spacing=1.0)
    >>> pd.lattice_family(dim=1, N=2, influence=part).influence.tolist()
    [1.0, 0.5, 1.0, 0.5]
    """
    spacing = as_real(spacing)
    check_positive("spacing", spacing)

    influence = named_influence(influence)

    def part_of_volume(r: Lengths, horizon) -> Lengths:
        xp, r, delta, h = _together(r, horizon, spacing)
        return influence(r, horizon) * xp.clip(0.5 + (delta - r) / h, 0, 1)

    return part_of_volume


class SignedInfluence:
    """An influence function that may be negative, from `signed_influence`."""

    def __init__(self, influence: Callable):
        self.influence = influence
        self.__name__ = f"signed {getattr(influence, '__name__', type(influence).__name__)}"

    def __call__(self, r: Lengths, horizon: Any) -> Lengths:
        return self.influence(r, horizon)


@public_function
def signed_influence(influence: Callable | str) -> SignedInfluence:
    """Allow an influence function to be negative.

    Parameters
    ----------
    influence : callable or str
        Influence function (r, δ) → ω, or its name.

    Returns
    -------
    SignedInfluence
        The same function. `lattice_family` and `families` accept its negative values.

    Notes
    -----
    Negative weights are a tool of design. They can make a shape tensor singular or a model unstable at rest. Judge the
    result with `stability` on a fine grid before you use it.

    Examples
    --------
    >>> signed = pd.signed_influence(pd.interpolated_influence([0.5, 1.0], [1.0, -0.25]))
    >>> pd.lattice_family(1, 2, influence=signed).influence.tolist()
    [1.0, -0.25, 1.0, -0.25]
    """
    return SignedInfluence(named_influence(influence))
