"""The result of a criterion: traced numbers (`Outcome`), and the verdict in words on the host (`Stability`)."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from ..._internal.checks import Numbers, namespace
from ..._internal.shown import told
from ..brillouin import top_pair
from ..certificate.certificate import Certificate


class Outcome(NamedTuple):
    """The margin [-] (positive is unstable), its eigenvalue and mode and, for criteria of waves, its wave vector.

    `at` holds the vectors or the wave at which the search of the criterion ended. A later call that gets `at` skips the
    search and evaluates the same quotient for other parameters. By the envelope theorem this quotient is the margin to
    second order. `scale` is the size of the terms whose rounding limits the margin.
    """

    margin: Numbers  # Shape () for one state. A leading axis, if there is one, counts states.
    eigenvalue: Numbers
    mode: Numbers
    wave_vector: Numbers | None = None  # (dim,)
    direction: Numbers | None = None  # (dim,)
    scale: Numbers | float = 1.0
    at: PyTree = None


def decide(A: Float[Array, "n n"], at: Float[Array, " n"] | None = None) -> tuple[Array, Array]:
    """λ_max by `eigh`, or the quotient of the vector `at`. Its derivative vᵀ(∂A)v is finite at double roots too."""
    v = jax.lax.stop_gradient(top_pair(jax.lax.stop_gradient(A))[1] if at is None else at)
    return v @ A @ v, v


class Stability(eqx.Module):
    """Verdict, margin and worst mode of a homogeneous state, the result of `stability`.

    Under `jax.vmap` every array has a leading axis of states.

    Attributes
    ----------
    criterion : str
        Name of the criterion.
    margin : array, shape ()
        The criterion as a dimensionless number: positive is unstable, negative is stable.
    eigenvalue : array, shape ()
        Eigenvalue behind the margin. For "symbol" it is an eigenvalue λ of the symbol [force/length^(dim+1)]. An
        unstable state has the largest λ of all waves, which grows at the rate √(λ/ρ). Any other state has the λ of the
        wave of the margin. For "affine" and "local" it is minus an eigenvalue of the acoustic tensor [pressure].
    mode : array, shape (dim,) or (bonds, dim)
        Eigenvector of `eigenvalue`. For "symbol" it is the polarisation, a unit vector: u = mode · e^{ik·X}. For
        "material" and "material_neighbour" it holds the increment of every bond of the family.
    wave_vector : array, shape (dim,), or None
        Wave vector k [1/length], None for criteria without waves. The zero vector stands for the limit k → 0 along
        `direction`.
    direction : array, shape (dim,), or None
        Unit vector along k.
    tolerance : array, shape ()
        Margins between −tolerance and tolerance are zero to rounding.
    resolution : int or None
        Grid intervals from 0 to π/h along each axis of the Brillouin zone ("symbol" only).
    certificate : Certificate or None
        Proved bounds of the margin, if `stability` was asked to certify it.
    verdict : str
        The margin in words.

    Examples
    --------
    In tension this Seth–Hill model is softest for the checkerboard wave, with k = π/h along both axes.

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> state = pd.stability(model, pd.lattice_family(2, 2), 1.02 * np.eye(2))
    >>> state.verdict, np.abs(np.asarray(state.wave_vector) / np.pi).round(6).tolist()
    ('stable', [1.0, 1.0])
    """

    criterion: str = eqx.field(static=True)
    margin: Float[Array, "..."]
    eigenvalue: Float[Array, "..."]
    mode: Float[Array, "..."]
    wave_vector: Float[Array, "..."] | None
    direction: Float[Array, "..."] | None
    tolerance: Float[Array, "..."]
    resolution: int | None = eqx.field(static=True)
    certificate: Certificate | None = None

    @property
    def verdict(self) -> str | np.ndarray:
        """ "stable", "marginal" or "unstable", or an array of these for a batch. A NaN margin is "undefined"."""
        words = verdicts(self.margin, self.tolerance)
        return str(words) if words.ndim == 0 else words

    def __repr__(self) -> str:
        return told(self)

    def __str__(self) -> str:
        def text(values: Numbers) -> str:
            return np.array2string(np.asarray(values), precision=4)

        lines = [f"{self.criterion}: {self.verdict}, margin {text(self.margin)}"]
        if self.wave_vector is not None:
            lines.append(f"  wave vector {text(self.wave_vector)}, eigenvalue {text(self.eigenvalue)}")
        if jnp.asarray(self.margin).dtype == jnp.float32:
            lines.append(f"  float32: margins within ±{np.asarray(self.tolerance):.1e} can't be told from zero")
        if self.certificate is not None:
            lines.append(f"  proof: {self.certificate}".replace("\n", "\n  "))
        return "\n".join(lines)


def verdicts(margin, tolerance) -> np.ndarray:
    """The verdict of every margin: its sign if it exceeds the tolerance, else "marginal"."""
    margin, tolerance = np.asarray(margin), np.asarray(tolerance)
    words = np.where(margin > tolerance, "unstable", np.where(margin < -tolerance, "stable", "marginal"))
    return np.where(np.isnan(margin), "undefined", words)


def margin_tolerance(dtype, scale=1.0):
    """The rounding error of a margin: 256 eps × the largest quotient `scale`. The measured noise is below 10 eps."""
    xp = namespace(scale)
    return (256 * jnp.finfo(dtype).eps * xp.maximum(1.0, scale)).astype(dtype)
