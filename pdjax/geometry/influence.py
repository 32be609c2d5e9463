"""Influence functions ω(r, δ): how much a bond of reference length r counts in a family of horizon δ.

An influence function is any callable of (r, δ) → ω ≥ 0. It is called once for a family or a body, with NumPy arrays
where r and δ are known and with JAX arrays where they are traced; operators and functions of jax.numpy take both.
Being a function of the distance alone it is even, ω(ξ) = ω(−ξ), and as symmetric as the lattice. Give it parameters
with `functools.partial`: they are traced and differentiable too, e.g. `partial(gaussian_influence, width=w)`.

    name                ω by q = r/δ                              as public codes have it
    "constant"          1                                         Peridigm "One"
    "inverse distance"  1/q                                       LAMMPS peri/lps 1/r; Peridynamics.jl "linear"
    "linear"            1 − q
    "parabolic"         1 for q ≤ ½, 4q(1 − q) beyond             Peridigm "Parabolic Decay"
    "gaussian"          exp(−(q/width)²), width ½                 Peridigm "Gaussian" with width 1
    "cubic spline"      1 − 6q² + 6q³ for q ≤ ½, 2(1 − q)³ beyond Peridynamics.jl "cubic B-spline"

A constant factor on ω changes nothing in correspondence models and LPS, whose sums are divided by sums of ω.

A neighbour whose cell the horizon cuts counts with a part of its volume (`partial_volume_influence`): as ω and V enter
every sum as their product, a factor on the volume is a factor on ω.

Source: Silling & Askari 2005 and Seleson & Parks 2011 for the common choices; Monaghan 1992 for the spline; Parks et
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


def _together(r: Lengths, *others: Any) -> tuple[Any, ...]:
    """(NumPy or jax.numpy, r, the others): NumPy where r is a NumPy array and no value is traced."""
    if not isinstance(r, np.ndarray):
        return jnp, r, *others
    return namespace(others), r, *on_host(others)


@public_function
def constant_influence(r: Lengths, horizon) -> Lengths:
    """ω = 1 [-]; r and horizon in [length]."""
    xp, r = _together(r)
    return xp.ones_like(r)


@public_function
def inverse_distance_influence(r: Lengths, horizon) -> Lengths:
    """ω = δ/r [-]; r and horizon in [length]."""
    _, r, horizon = _together(r, horizon)
    return horizon / r


@public_function
def linear_influence(r: Lengths, horizon) -> Lengths:
    """ω = 1 − r/δ [-], zero at the horizon; r and horizon in [length]."""
    xp, r, horizon = _together(r, horizon)
    return xp.maximum(1 - r / horizon, 0)


@public_function
def cubic_spline_influence(r: Lengths, horizon) -> Lengths:
    """ω = the cubic B-spline scaled to 1 at r = 0 [-], zero at the horizon; r and horizon in [length]."""
    xp, r, horizon = _together(r, horizon)
    q = xp.minimum(r / horizon, 1)
    return xp.where(q <= 0.5, 1 - 6 * q**2 + 6 * q**3, 2 * (1 - q) ** 3)


@public_function
def gaussian_influence(r: Lengths, horizon, width=0.5) -> Lengths:
    """ω = exp(−(r/(width·δ))²) [-], cut off at the horizon; width is a fraction of the horizon [-]."""
    xp, r, horizon, width = _together(r, horizon, width)
    return xp.exp(-((r / (width * horizon)) ** 2))


@public_function
def parabolic_influence(r: Lengths, horizon) -> Lengths:
    """ω = 1 up to half the horizon, then 4q(1 − q) [-], zero at the horizon; r and horizon in [length]."""
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


def named_influence(influence: Any) -> Callable:
    """An influence function from itself or from its name in `INFLUENCES`."""
    if isinstance(influence, str):
        return INFLUENCES[choice("influence", influence, tuple(INFLUENCES))]
    if not callable(influence):
        raise ValueError(
            f"influence must be a function (r, horizon) → ω, or one of {', '.join(INFLUENCES)}; got {influence!r}"
        )
    return influence


@public_function
def partial_volume_influence(influence: Callable | str, spacing) -> Callable:
    """`influence` times the part β of a neighbour's volume that lies within the horizon.

        β(r) = ½ + (δ − r)/h between 0 and 1: 1 up to half a spacing h from the horizon, ½ at the horizon

    Arguments: influence (r, δ) → ω ≥ 0; spacing h > 0 [length] of the lattice, may be traced.
    Returns: a callable (r, δ) → ω β [-], for `lattice_family` and `families` as any other. The families hold the
        points within δ: one beyond it is no neighbour, even if the horizon cuts its cell.
    Raises: ValueError for a spacing that is not finite and > 0.
    Source: Parks et al. 2008, as the PERI package of LAMMPS has it.
    """
    spacing = as_real(spacing)
    check_positive("spacing", spacing)

    influence = named_influence(influence)

    def part_of_volume(r: Lengths, horizon) -> Lengths:
        xp, r, delta, h = _together(r, horizon, spacing)
        return influence(r, horizon) * xp.clip(0.5 + (delta - r) / h, 0, 1)

    return part_of_volume
