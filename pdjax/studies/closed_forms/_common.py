"""Helpers of the closed forms: the list of slips, checks of arguments, smooth quotients, the bonds of a lattice.

    E_m(a) = ((1 + a)^{2m} − 1)/(2m) = L (e^x − 1)/x,   L = log(1 + a), x = 2mL
    edge:    c₁ (1 + a)^{2m} + c₂ E_m(a) = 0   ⇔   log(1 + a) = −z log(1 + t)/t,  z = c₁/c₂, t = 2mz

Both quotients are smooth functions through 0, the value of x and t for m = 0 (the Hencky strain). The first quotient is
`kinematics.seth_hill`.

Symbols: a is the hydrostatic strain, F = (1 + a) I. m is the order of the strain measure. N = δ/h is the horizon over
the spacing.
"""

from collections.abc import Collection
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from ..._internal.checks import choice, is_concrete
from ...geometry.bonds import cells_within
from ...models.kinematics import seth_hill

FORMS = ("printed", "corrected")

SLIPS = {
    "S1": "2D weighted volume: δ = NΔX gives πN²ΔX²b, so π²N² and πN should read π²N⁴ and πN²",
    "S2": "2D lattice sums: four times the quadrant counts the points on the axes twice; the exact sums are finite",
    "S3": "2D law: a law with S = κE for hydrostatic E has ∂S/∂E = (κ/2) δδ or κ I_sym, not κ δδ",
    "S4": "2D: the factor 1/(2m) of the general formula is 1/m in the hydrostatic one; 2πN should be πN",
    "S5": "the quoted 2D critical load −0.037 (m = 1, N = 3) is not a root of the printed criterion",
    "S6": "dT·dY of the moved centre: the sign is wrong, and a summed index is used for the moved coordinate",
    "S11": "the mean of ξ_k²/|ξ|² is 1/3 in 3D: Γ ∝ 2m + 1, m_cr = −1/2",
    "S12": "the nonlocal strain equals the local one for m = 1 and for F = λQ; otherwise only to first order",
    "S13": "2D criteria: the bracket must be positive for stability, not negative",
    "S14": "2D criterion at m = 0: the limit m → 0 of the bracket is 1 (always satisfied), not 1 + 2πN log(1 + a)",
    "S15": "static equation: the two force states of a bond add up; the printed integrand is zero",
}


def check_dim(dim: int) -> int:
    """Return `dim` if it is 1, 2 or 3; raise ValueError otherwise."""
    if dim not in (1, 2, 3):
        raise ValueError(f"dim must be 1, 2 or 3; got {dim!r}")
    return int(dim)


def check_form(form: str) -> str:
    """Return `form` if it is "printed" or "corrected"; raise ValueError otherwise."""
    return choice("form", form, FORMS)


def corrected_slips(form: str | Collection[str], known: tuple[str, ...]) -> frozenset[str]:
    """The slips to correct: none for "printed", all of `known` for "corrected", or those that `form` names."""
    if isinstance(form, str):
        return frozenset(known if check_form(form) == "corrected" else ())
    unknown = sorted(set(form) - set(known))
    if unknown:
        raise ValueError(f"form must be printed, corrected or slips out of {', '.join(known)}; got {unknown}")
    return frozenset(form)


def check_load(a: object) -> jax.Array:
    """Return `a` as an array; raise ValueError where a known value is ≤ −1, so that the stretch is not positive."""
    if is_concrete(a) and not np.all(np.asarray(a) > -1):
        raise ValueError(f"a must be > -1 for the stretch 1 + a to be positive; got {a!r}")
    return jnp.asarray(a, dtype=jnp.result_type(a, float))


def check_ratio(N: Any, whole: bool = False) -> float:
    """Return `N` if it is a finite number ≥ 1 (a whole number if `whole`); raise ValueError otherwise."""
    if not is_concrete(N) or np.ndim(N) != 0 or not np.isfinite(N) or N < 1:
        raise ValueError(f"N = horizon/spacing must be a number >= 1, known before tracing; got {N!r}")
    if whole and float(N) != int(N):
        raise ValueError(f"N = horizon/spacing must be a whole number in this closed form; got {N!r}")
    return int(N) if float(N) == int(N) else float(N)


def _log1p_over(x):
    """log(1 + x)/x; for |x| < 0.05 its Taylor polynomial, so that the function and its derivatives are smooth at 0."""
    near = jnp.abs(x) < 0.05
    series = jnp.polyval(jnp.asarray(_LOG1P, dtype=x.dtype), jnp.where(near, x, 0.0))
    far = jnp.where(near, 1.0, x)
    return jnp.where(near, series, jnp.log1p(far) / far)


# The truncation error at |x| = 0.05 is 0.05^12/13 = 2e-17, below the rounding of float64.
_LOG1P = ((-1.0) ** np.arange(12) / np.arange(1.0, 13.0))[::-1]


def hydrostatic_strain(a: jax.Array, m: ArrayLike) -> jax.Array:
    """E_m(a) = ((1 + a)^{2m} − 1)/(2m), smooth in m at 0, where it equals log(1 + a)."""
    return seth_hill(jnp.log1p(a), m)


def edge(z: jax.Array, m: ArrayLike) -> jax.Array:
    """The root a of z (1 + a)^{2m} + E_m(a) = 0. Without a root a > −1 the result is ±inf, with the sign of −z."""
    t = 2 * jnp.asarray(m) * z
    exists = jnp.isfinite(t) & (t > -1)
    safe = jnp.where(exists, t, 0.0)
    root = jnp.expm1(-jnp.where(exists, z, 0.0) * _log1p_over(safe))
    return jnp.where(exists, root, jnp.where(z > 0, -jnp.inf, jnp.inf))


def lattice_bonds(dim: int, N: float) -> np.ndarray:
    """Bonds of a full family on a simple cubic lattice, in units of the spacing.

    These are the integer points p with 0 < |p| ≤ N (1 + 1e-9).

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-], at least 1.

    Returns
    -------
    array, shape (bonds, dim)
        Bond vectors over the spacing [-].

    Raises
    ------
    ValueError
        If dim is not 1, 2 or 3, or N is not a number ≥ 1.

    Examples
    --------
    A point of a square lattice has 4 nearest neighbours; with N = 2 its family has 12 bonds.

    >>> pd.closed_forms.lattice_bonds(2, 2).shape
    (12, 2)
    """
    dim, N = check_dim(dim), check_ratio(N)
    return cells_within(dim, N).astype(float)
