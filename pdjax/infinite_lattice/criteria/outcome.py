"""What a criterion says: numbers first (traced), then the verdict in words (on the host)."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..._internal.checks import namespace
from ..brillouin import top_pair


class Outcome(NamedTuple):
    """margin [-] (positive: unstable), the eigenvalue behind it, its mode and, for waves, its wave vector.

    `at` is where the criterion's search ended (a vector, a wave …): given back to it, the search is skipped and the
    same quotient is measured for other parameters, which by the envelope theorem is the margin to second order.
    """

    margin: Any  # (): one state; with a leading axis, as of NumPy, where many were judged at once
    eigenvalue: Any
    mode: Any
    wave_vector: Any = None  # (dim,)
    direction: Any = None  # (dim,)
    scale: Any = 1.0
    at: Any = None


def decide(A: Float[Array, "n n"], at: Float[Array, " n"] | None = None) -> tuple[Array, Array]:
    """λ_max by `eigh` (or the quotient of the given vector); the derivative is vᵀ(∂A)v, finite at double roots too."""
    v = jax.lax.stop_gradient(top_pair(jax.lax.stop_gradient(A))[1] if at is None else at)
    return v @ A @ v, v


class Stability(eqx.Module):
    """The answer of `stability`.

    margin: [-] positive unstable, zero to `tolerance` marginal, negative stable.
    eigenvalue, mode: the largest eigenvalue if unstable, else the one at the margin, and its shape. For "symbol":
        eigenvalue [force/length^(dim+1)], growth rate √(eigenvalue/ρ); mode a unit vector, u = mode · e^{ik·X}.
    wave_vector: [1/length], None for criteria without waves; the zero vector means the limit k → 0 along `direction`.
    resolution: grid intervals from 0 to π/h along each axis of the Brillouin zone ("symbol" only).
    """

    criterion: str = eqx.field(static=True)
    margin: Float[Array, "..."]
    eigenvalue: Float[Array, "..."]
    mode: Float[Array, "..."]
    wave_vector: Float[Array, "..."] | None
    direction: Float[Array, "..."] | None
    tolerance: Float[Array, "..."]
    resolution: int | None = eqx.field(static=True)

    @property
    def verdict(self) -> str | np.ndarray:
        """ "stable", "marginal" or "unstable"; of a batch, the array of them. NaN margins are "undefined"."""
        words = verdicts(self.margin, self.tolerance)
        return str(words) if words.ndim == 0 else words

    def __str__(self) -> str:
        lines = [f"{self.criterion}: {self.verdict}, margin {np.asarray(self.margin)}"]
        if self.wave_vector is not None:
            lines.append(f"  wave vector {np.asarray(self.wave_vector)}, eigenvalue {np.asarray(self.eigenvalue)}")
        if jnp.asarray(self.margin).dtype == jnp.float32:
            lines.append(f"  float32: margins within ±{np.asarray(self.tolerance):.1e} can't be told from zero")
        return "\n".join(lines)


def verdicts(margin, tolerance) -> np.ndarray:
    """Words for margins: the sign beyond the tolerance."""
    margin, tolerance = np.asarray(margin), np.asarray(tolerance)
    words = np.where(margin > tolerance, "unstable", np.where(margin < -tolerance, "stable", "marginal"))
    return np.where(np.isnan(margin), "undefined", words)


def margin_tolerance(dtype, scale=1.0):
    """Margins nearer to zero than this are rounding: 256 eps × the largest quotient (measured noise: below 10 eps)."""
    xp = namespace(scale)
    return (256 * jnp.finfo(dtype).eps * xp.maximum(1.0, scale)).astype(dtype)
