"""What a static solver says: the displacement it reached, how far and why it stopped, and what the equilibrium is.

The residual is relative: ‖r‖ over the largest of the internal forces (reactions included), the applied ones and the
root mean square over points of the forces of their bonds (`pdjax.finite_body.factorisation.residual_and_scale`).
"""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import is_concrete
from ..spectrum import BodyStability

CONVERGED, OUT_OF_STEPS, NO_DECREASE, SINGULAR, NOT_FINITE, STEP_TOO_SMALL, FLOWN = range(7)
TORN = 1e3  # stretch of a bond beyond which the body is said to have come apart
REASONS = (
    "converged",
    "the iterations ran out",
    "no step along the search direction decreases the residual",
    "the Jacobian is singular",
    "the residual is not finite: a bond collapsed or the displacement diverged",
    "the load step fell below the smallest allowed",
    "the body came apart: bonds longer than 1000 times their length, where forces fade",
)


class Equilibrium(eqx.Module):
    """The answer of `solve`.

    u (points, dim) [length]; load_factor: how much of the load it carries (1: all); residuals: relative residual after
    each iteration, of all load steps one after another, nan where unused; iterations; code: why it stopped (`reason`
    in words); turned: bonds whose image points backwards, (ξ + η)·ξ ≤ 0 (matter passed through itself); stability: the
    largest eigenvalue of J there, its mode and count (`BodyStability`), None if not asked for or if traced.
    """

    u: Float[Array, "points dim"]
    load_factor: Float[Array, ""]
    residuals: Float[Array | np.ndarray, " iterations"]
    iterations: Array | int
    code: Array | int
    turned: Array | int
    stability: BodyStability | None
    failed_step: str | None = eqx.field(static=True, default=None)
    method: str = eqx.field(static=True, default="newton")

    @property
    def converged(self) -> bool | np.ndarray:
        """Whether the full load is carried to the tolerance."""
        good = np.asarray(self.code) == CONVERGED
        return bool(good) if good.ndim == 0 else good

    @property
    def residual(self):
        """The last relative residual [-]."""
        values = np.asarray(self.residuals)
        return float(values[np.isfinite(values)][-1]) if np.isfinite(values).any() else float("nan")

    @property
    def reason(self) -> str:
        """Why it stopped, in words."""
        words = REASONS[int(self.code)]
        return words if self.failed_step is None else f"{words} ({self.failed_step})"

    @property
    def kind(self) -> str | None:
        """ "minimum", "saddle" or "degenerate"; None without stability."""
        return None if self.stability is None else self.stability.kind

    def __str__(self) -> str:
        head = "converged" if self.converged else f"not converged: {self.reason}"
        what = "" if self.stability is None else f"\n  {self.kind}; {self.stability}"
        turned = f"\n  {int(self.turned)} bonds turned backwards" if int(self.turned) else ""
        return (
            f"{self.method}: {head}; load factor {float(self.load_factor):g}, {int(self.iterations)} iterations,"
            f" relative residual {self.residual:.1e}{what}{turned}"
        )


def _bonds(families, u) -> tuple:
    """ξ, ξ + η (points, bonds, dim) and which bonds are true; of concrete values on the host."""
    xi, weight, neighbours = families.xi, families.weight, families.neighbours
    if is_concrete(families, u):
        xi, weight, neighbours, u = map(np.asarray, (xi, weight, neighbours, u))
    return xi, xi + (u[neighbours] - u[:, None, :]), weight > 0


def torn(families, u) -> Any:
    """Whether a bond is longer than TORN times its reference length: forces that fade pass for equilibrium there."""
    with np.errstate(all="ignore"):  # u may be no number at all
        xi, image, true = _bonds(families, u)
        return (((image**2).sum(axis=-1) > TORN**2 * (xi**2).sum(axis=-1)) & true).any()


def turned_bonds(families, u) -> Any:
    """How many bonds (directed) point backwards."""
    with np.errstate(all="ignore"):
        xi, image, true = _bonds(families, u)
        return (((image * xi).sum(axis=-1) <= 0) & true).sum()
