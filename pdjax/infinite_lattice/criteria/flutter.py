"""Criterion "symbol" for a model without an energy, whose Ĵ(k) is real but not symmetric.

A mode Ĵ x = λ x moves as e^{st} with s² = λ/ρ, so that it grows at the rate Re √(λ/ρ). It grows if λ > 0, and also if λ
is not real (flutter). The quantity that takes the place of λ is

    γ² = λ for real λ,   (Re √λ)² otherwise

λ counts as real if |Im λ| ≤ 1e-7 ‖Ĵ‖, because rounding splits a double root by √eps. The margin is the supremum of
γ²/(M κ²) over the grid and over the limit k → 0. The search does not leave the grid, because γ² jumps where two
real roots meet. The derivative is that of the eigenvalue found, yᴴ(∂Ĵ)x/(yᴴx), with its left and right eigenvectors y
and x. An unstable state reports the largest γ² of the grid as its eigenvalue, and grows at the rate √(γ²/ρ).
`jnp.linalg.eig` runs on the CPU only.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from ..._internal.checks import Numbers
from ..bloch import Phases, Tangent, laplacian
from ..brillouin import Zone, directions
from ..cosine_series import on_grid

REAL = 1e-7


def growth_square(value: Complex[Array, "..."], size: Float[Array, "..."]) -> Float[Array, "..."]:
    """γ² of eigenvalues λ of matrices of norm `size`."""
    real = jnp.abs(value.imag) <= REAL * size
    safe = jnp.where(real, -1.0, value)
    return jnp.where(real, value.real, jnp.sqrt(safe).real ** 2)


def _fastest(J: Float[Array, "*waves dim dim"]) -> Float[Array, "*waves"]:
    """The largest γ² of every wave."""
    squares = growth_square(jnp.linalg.eigvals(J), jnp.linalg.norm(J, axis=(-2, -1))[..., None])
    return jnp.max(squares, axis=-1)


def _pair(J: Float[Array, "dim dim"]) -> tuple[Array, Array]:
    """Right and left eigenvectors of the eigenvalue with the largest γ²."""
    values, right = jnp.linalg.eig(J)
    which = jnp.argmax(growth_square(values, jnp.linalg.norm(J)))
    return right[:, which], jnp.linalg.inv(right)[which]


def search(blocks: Float[Numbers, "offsets dim dim"], offsets: np.ndarray, zone: Zone) -> tuple[tuple, tuple, Array]:
    """Search the grid and the limit k → 0 of one state, whose cosine series `blocks` is in units of M/h².

    The result has three parts: for the margin (wave x [1/spacing], whether it is the limit k → 0, right and left
    eigenvectors), for the largest γ² (wave, right and left eigenvectors), and the largest |quotient| on the grid.
    """
    dim, real = offsets.shape[1], blocks.dtype
    grid, compass = jnp.asarray(zone.grid, real), jnp.asarray(directions(dim), real)
    short = on_grid(blocks.reshape(len(offsets), -1), offsets, list(zone.axes)).reshape(dim * dim, -1)[:, zone.places]
    long = -((compass @ jnp.asarray(offsets, real).T) ** 2) @ blocks.reshape(len(offsets), -1)
    J = jnp.concatenate([short.T, long]).reshape(-1, dim, dim)
    unit = jnp.concatenate([laplacian(grid), jnp.ones(len(compass), real)])
    square = _fastest(J)
    square = jnp.where(jnp.isnan(square), -jnp.inf, square)
    screen = square / unit
    i = jnp.argmax(screen)
    j = jnp.argmax(square[: len(grid)])
    wave = jnp.concatenate([grid, compass])[i]
    margin, fastest = (wave, i >= len(grid), *_pair(J[i])), (grid[j], *_pair(J[j]))
    return margin, fastest, jnp.max(jnp.abs(screen[: len(grid)]))


def quotient(tangent: Tangent, phases: Phases, right: Complex[Array, " dim"], left: Complex[Array, " dim"]) -> Array:
    """γ² of the eigenvalue with these eigenvectors. It can be differentiated once in the tangent."""
    J = tangent(phases)
    value = (left @ J.astype(right.dtype) @ right) / (left @ right)
    return growth_square(value, jax.lax.stop_gradient(jnp.linalg.norm(J)))
