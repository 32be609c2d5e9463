"""A preconditioner for the Krylov methods on a lattice body: the response of an infinite lattice, inverted by FFT.

The column of −A at an interior point is the force response of the lattice to a unit displacement of that point. Its
Fourier transform K(k) (dim, dim) is the stiffness of a plane wave. The preconditioner

    M⁻¹ = S F⁻¹ K(k)⁻¹ F Sᵀ

extends a vector by zeros to a box (Sᵀ), transforms it (F), divides every wave by its stiffness, and restricts the
result to the free components (S). It would be the exact inverse for a homogeneous periodic body. A body with surfaces
and supports needs a few more iterations. Along an axis that is not periodic the box is longer than the body by one
horizon, so that opposite surfaces are apart.

M must be positive definite. A wave without stiffness (a zero-energy mode) and a growing wave (an unstable state)
therefore get a stiffness of FLOOR times that of springs with the same largest stiffness,

    K ≥ FLOOR · K_max · min(1, κ² N² / (2 (dim + 2))),   κ² = Σ_i 4 sin²(k_i h/2),

where h is the spacing and N the horizon in spacings. The translation k = 0 gets the smallest stiffness of all waves.

The response takes dim products A v. Nothing is known of the model, so this works for any model and any homogeneous
deformation. It comes from one point: a body of very different stiffnesses gains less.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from ..._internal.threads import cores
from ..scene import Scene

# Measured on plates and blocks (LPS, bond-based, Silling with and without control, Seth–Hill): 0.01 to 0.03 take the
# fewest iterations, 0.3 up to half as many again. With 0.001 Seth–Hill bodies take up to twice as many.
FLOOR = 0.02


class LatticeResponse(eqx.Module):
    """The preconditioner b ↦ M⁻¹ b, a symmetric positive definite linear function of the free components."""

    inverse: Complex[Array | np.ndarray, "*waves dim dim"]
    places: Int[Array | np.ndarray, " unknowns"]  # of every free component in the flat array (*box, dim)
    box: tuple[int, ...] = eqx.field(static=True)

    @eqx.filter_jit
    def __call__(self, b: Float[Array | np.ndarray, " unknowns"]) -> Float[Array, " unknowns"]:
        shape, axes = (*self.box, self.inverse.shape[-1]), tuple(range(len(self.box)))
        field = jnp.zeros(int(np.prod(shape)), b.dtype).at[self.places].set(b, unique_indices=True).reshape(shape)
        waves = jnp.fft.rfftn(field, axes=axes)
        waves = jnp.sum(self.inverse * waves[..., None, :], axis=-1)
        field = jnp.fft.irfftn(waves, s=self.box, axes=axes)
        return field.reshape(-1)[self.places].astype(b.dtype)


def _centre(scene: Scene, free: np.ndarray) -> int | None:
    """A point with all components free and as many bonds as any such point, near the middle of the body."""
    candidates = np.flatnonzero(free.all(axis=1))
    if not len(candidates):
        return None
    count = np.asarray(scene.families.count)[candidates]
    candidates = candidates[count == count.max()]
    X = scene.body.positions
    away = np.linalg.norm(X[candidates] - X.mean(axis=0), axis=1)
    return int(candidates[np.argmin(away)])


def lattice_response(scene: Scene, apply: Callable[[np.ndarray], Array]) -> LatticeResponse | None:
    """The preconditioner for A, given as the function v ↦ A v; None if the body is no lattice."""
    body = scene.body
    unknowns, dim = np.asarray(scene.unknowns), body.dim
    free = np.zeros((len(body), dim), dtype=bool)
    free.reshape(-1)[unknowns] = True
    centre = _centre(scene, free)
    if not body.uniform or centre is None:
        return None
    import scipy.fft  # imported here because it would add a sixth to the time of `import pdjax`

    assert body.cells is not None and body.spacing is not None
    reach = float(np.max(np.asarray(scene.families.horizon))) / body.spacing
    wraps = [body.period is not None and np.isfinite(p) for p in body.period or [np.inf] * dim]
    box = tuple(
        n if wrap else scipy.fft.next_fast_len(n + int(reach * (1 + 1e-9)), real=True)
        for n, wrap in zip(body.cells, wraps, strict=True)
    )
    sites = np.arange(len(body)) if body.sites is None else body.sites
    cells = np.stack(np.unravel_index(sites, body.cells), axis=1)
    of_point = np.ravel_multi_index(tuple(cells.T), box)
    places = of_point[unknowns // dim] * dim + unknowns % dim

    number = np.full(free.size, -1)
    number[unknowns] = np.arange(len(unknowns))
    stiffness = np.zeros((int(np.prod(box)) * dim, dim))
    for k in range(dim):
        unit = np.zeros(len(unknowns))
        unit[number[centre * dim + k]] = 1.0
        stiffness[places, k] = -np.asarray(apply(unit), dtype=float)
    axes = tuple(range(dim))
    stiffness = np.roll(stiffness.reshape(*box, dim, dim), -cells[centre], axis=axes)
    K = scipy.fft.rfftn(stiffness, axes=axes, workers=cores())
    return LatticeResponse(_inverse(K, box, reach), places.astype(np.int32), box)


def _inverse(K: np.ndarray, box: tuple[int, ...], reach: float) -> np.ndarray:
    """K⁻¹ of the Hermitian part of K, with the least stiffness of the module docstring."""
    dim = len(box)
    values, vectors = np.linalg.eigh((K + np.conj(np.swapaxes(K, -1, -2))) / 2)
    waves = [np.fft.fftfreq(n) for n in box[:-1]] + [np.fft.rfftfreq(box[-1])]
    kappa = sum(np.meshgrid(*(4 * np.sin(np.pi * w) ** 2 for w in waves), indexing="ij"))
    share = np.minimum(1.0, kappa * reach**2 / (2 * (dim + 2)))
    values = np.maximum(values, FLOOR * values.max() * share[..., None])
    still = (0,) * dim
    values[still] = values[kappa > 0].min(initial=np.inf) if np.size(kappa) > 1 else values.max()
    return (vectors / values[..., None, :]) @ np.conj(np.swapaxes(vectors, -1, -2))
