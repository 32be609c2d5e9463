"""The result of a static solver: the displacement, the load it carries, why the solver stopped, and the stability.

The relative residual is ‖r‖ divided by the largest of three forces: the internal forces (reactions included), the
applied forces, and the root mean square over the points of the forces of their bonds
(`pdjax.finite_body.factorisation.residual_and_scale`).
"""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import is_concrete
from ..._internal.ending import Ending
from ..._internal.shown import told
from ..spectrum import BodyStability

TORN = 1e3  # ratio of the length of a bond to its reference length beyond which the body counts as come apart


class SolveEnding(Ending):
    """How `solve` ended."""

    CONVERGED = 0, "converged"
    OUT_OF_STEPS = 1, "the iterations ran out"
    NO_DECREASE = 2, "no step along the search direction decreases the residual"
    SINGULAR = 3, "the Jacobian is singular"
    NOT_FINITE = 4, "the residual is not finite: a bond collapsed or the displacement diverged"
    STEP_TOO_SMALL = 5, "the load step fell below the smallest allowed"
    TORN = 6, "the body came apart: a bond is longer than 1000 times its reference length, where its force may vanish"


class Equilibrium(eqx.Module):
    """Result of `solve`: the displacement, whether it is an equilibrium, and whether that is stable.

    Attributes
    ----------
    u : array, shape (points, dim)
        Displacements [length].
    load_factor : array, shape ()
        The load factor λ [-] that the body carries; 1 is the full load.
    residuals : array, shape (iterations,)
        Relative residual [-] after each iteration, for all load steps one after another; NaN where unused.
    iterations : int
        Number of iterations of all load steps.
    code : int
        Why the solver stopped; `reason` gives it in words.
    turned : int
        Number of bonds (directed) that point backwards, (ξ + η)·ξ ≤ 0, so that matter has passed through itself.
    stability : BodyStability or None
        Largest eigenvalue of the Jacobian at u, its mode and the number of positive eigenvalues. None if it was not
        requested, the model has no energy, the forces are not finite, or `solve` was traced.
    failed_step : str or None
        The load step that failed.
    method : str
        The method of `solve`.

    Examples
    --------
    >>> body = pd.bar(2, 2.0)
    >>> families, model = pd.families(body, 1.0), pd.SethHill(1.0, pd.LinearElastic(1.0, 0.0))
    >>> found = pd.solve(pd.scene(body, families, model, pd.prescribe(0), pd.total_force([1], [0.1])))
    >>> found.converged, found.kind, round(float(found.u[1, 0]), 4)
    (True, 'minimum', 0.0467)
    """

    u: Float[Array, "points dim"]
    load_factor: Float[Array, ""]
    residuals: Float[Array | np.ndarray, " iterations"]
    iterations: Array | int
    code: Array | int
    turned: Array | np.integer | int
    stability: BodyStability | None
    failed_step: str | None = eqx.field(static=True, default=None)
    method: str = eqx.field(static=True, default="newton")

    @property
    def converged(self) -> bool | np.ndarray:
        """True if the body carries the full load with a relative residual below the tolerance."""
        good = np.asarray(self.code) == SolveEnding.CONVERGED
        return bool(good) if good.ndim == 0 else good

    @property
    def residual(self):
        """The last finite relative residual [-]."""
        values = np.asarray(self.residuals)
        return float(values[np.isfinite(values)][-1]) if np.isfinite(values).any() else float("nan")

    @property
    def ending(self) -> SolveEnding:
        """How the solver ended, as an enumeration."""
        return SolveEnding.of(int(self.code))

    @property
    def reason(self) -> str:
        """Why the solver stopped, in words."""
        words = self.ending.reason
        return words if self.failed_step is None else f"{words} ({self.failed_step})"

    @property
    def kind(self) -> str | None:
        """Kind of equilibrium: "minimum", "saddle" or "degenerate"; None if `stability` is None."""
        return None if self.stability is None else self.stability.kind

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        head = "converged" if self.converged else f"not converged: {self.reason}"
        what = "" if self.stability is None else f"\n  {self.kind}; {self.stability}"
        turned = f"\n  {int(self.turned)} bonds turned backwards" if int(self.turned) else ""
        return (
            f"{self.method}: {head}; load factor {float(self.load_factor):g}, {int(self.iterations)} iterations,"
            f" relative residual {self.residual:.1e}{what}{turned}"
        )


def _bonds(families, u) -> tuple:
    """ξ and ξ + η (points, bonds, dim), and which bonds are no padding; NumPy arrays if the values are concrete."""
    xi, weight, neighbours = families.xi, families.weight, families.neighbours
    if is_concrete(families, u):
        xi, weight, neighbours, u = map(np.asarray, (xi, weight, neighbours, u))
    return xi, xi + (u[neighbours] - u[:, None, :]), weight > 0


def torn(families, u) -> Array | np.bool_:
    """Whether a bond is longer than TORN times its reference length.

    The forces of some models vanish at such lengths, and then a zero residual does not mean equilibrium.
    """
    with np.errstate(all="ignore"):  # u may hold NaN or infinity
        xi, image, true = _bonds(families, u)
        return (((image**2).sum(axis=-1) > TORN**2 * (xi**2).sum(axis=-1)) & true).any()


def turned_bonds(families, u) -> Array | np.integer:
    """Number of bonds (directed) that point backwards."""
    with np.errstate(all="ignore"):
        xi, image, true = _bonds(families, u)
        return (((image * xi).sum(axis=-1) <= 0) & true).sum()
