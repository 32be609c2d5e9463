"""Sums over the bonds that cross a plane: what a cut takes from the families beside it.

A plane of unit normal n cuts an infinite body. A point at the distance z from the plane loses the bonds with ξ·n > z.
With w = ω V and m_w = Σ w |ξ|² let c(z) be the lost share of m_w:

    c(z) = (1/m_w) Σ_{ξ·n > z} w |ξ|²            lost share [-], ½ at z = 0 and 0 at z = δ
    A₁ = ∫ c dz = Σ_{ξ·n > 0} w |ξ|² ξ·n / m_w   first integral [length], z from 0 to δ
    A₂ = ∫ c² dz                                 second integral [length]
    B = Σ_{ξ·n > 0} w |ξ| ξ·n                    for springs whose energy is proportional to |ξ| [length^(dim+2)]
    P = Σ_{ξ·n > 0} V ξ·n                        bonds per area times V² [length^(dim+1)]

A bond ξ crosses the unit area of the plane ξ·n/V times. In a lattice the points lie in layers. The integrals are then
sums over the layers, and they do not depend on where between two layers the plane lies. For a plane without layers they
are averages over its positions.

**Full ball.** With k_d(q) the part of the sphere beyond the height q, k₁ = ½, k₂ = arccos(q)/π, k₃ = (1 − q)/2, its
integral κ = ½, 1/π, ¼, and S = 2, 2π, 4π the surface of the unit sphere in 1D, 2D, 3D,

    c(z) = ∫_z^δ ω r^{d+1} k_d(z/r) dr / M,   M = ∫ ω r^{d+1} dr,   A₁ = κ ∫ ω r^{d+2} dr / M,
    B = S κ M,   P = S κ ∫ r^d dr             r from 0 to δ

                       3D, ω = 1    3D, ω = δ/r    2D, ω = 1      2D, ω = δ/r
    A₁/δ               5/24         1/5            4/(5π)         3/(4π)
    A₂/δ               125/1848     26/405         0.088131       0.080650
    B                  πδ⁵/5        πδ⁵/4          δ⁴/2           2δ⁴/3
    P                  πδ⁴/4        πδ⁴/4          2δ³/3          2δ³/3
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .bonds import checked_influence

SPHERE = {1: 2.0, 2: 2 * np.pi, 3: 4 * np.pi}
MEAN = {1: 0.5, 2: 1 / np.pi, 3: 0.25}  # κ: half of the mean of |cos|, over the half sphere
BEYOND: dict[int, Callable] = {
    1: lambda q: np.full(np.shape(q), 0.5),
    2: lambda q: np.arccos(q) / np.pi,
    3: lambda q: (1 - q) / 2,
}


class PlaneSums(NamedTuple):
    """The sums of the module docstring: the dimension, A₁, A₂, B and P."""

    dim: int
    first: float
    second: float
    springs: float
    pairs: float


def plane_sums(
    w: Float[np.ndarray, " bonds"],
    volume: Float[np.ndarray, " bonds"],
    xi: Float[np.ndarray, "bonds dim"],
    normal: Float[np.ndarray, " dim"],
) -> PlaneSums:
    """The sums of one family of a lattice. `normal` may have any length > 0."""
    height = xi @ (normal / np.linalg.norm(normal))
    order = np.argsort(height)
    order = order[height[order] > 0]
    height, ahead = height[order], w[order]
    length = np.linalg.norm(xi[order], axis=1)
    share = ahead * length**2 / np.sum(w * np.sum(xi**2, axis=1))
    lost = np.cumsum(share[::-1])[::-1]  # c between the heights of the bond before and of this bond
    return PlaneSums(
        xi.shape[1],
        float(share @ height),
        float(lost**2 @ np.diff(height, prepend=0.0)),
        float(ahead * length @ height),
        float(volume[order] * (ahead != 0) @ height),
    )


def _nodes(panels: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on [0, 1], of degree 15 in each panel: an influence function may have kinks."""
    x, weight = np.polynomial.legendre.leggauss(8)
    at = np.arange(panels)[:, None]
    return ((at + (1 + x) / 2) / panels).reshape(-1), np.tile(weight / 2 / panels, panels)


def ball_plane_sums(dim: int, horizon: float, influence: Callable) -> PlaneSums:
    """The sums of a full ball with this influence function, by quadrature."""
    x, weight = _nodes()

    def omega(r: np.ndarray) -> np.ndarray:
        return np.asarray(checked_influence(influence, r, horizon))

    r, dr = horizon * x, horizon * weight
    at = omega(r)
    M, above = at * r ** (dim + 1) @ dr, at * r ** (dim + 2) @ dr
    z = r
    inner = z[:, None] + (horizon - z[:, None]) * x**2  # k₂ has a root at r = z, which the square removes
    d_inner = (horizon - z[:, None]) * 2 * x * weight
    lost = np.sum(omega(inner) * inner ** (dim + 1) * BEYOND[dim](z[:, None] / inner) * d_inner, axis=1) / M
    surface = SPHERE[dim] * MEAN[dim]
    return PlaneSums(
        dim,
        float(MEAN[dim] * above / M),
        float(lost**2 @ dr),
        float(surface * M),
        float(surface * ((at != 0) * r**dim @ dr)),
    )
