"""Criteria of one point or of one family of bonds, which are cheap and do not consider waves.

    diagonal            max_k D_kk < 0, D = ∂f(X)/∂x(X)                      (Behzadinasab & Foster, section 3.2)
    block               λ_max(D) < 0
    material_center     dT·dY = Σ V δT·δY > 0 if the centre moves: δY = −e on every bond     (Silling 2017)
    material_neighbour  the same if one neighbour moves
    material            the same for the worst δY that is orthogonal to translations and to rotations δY = ΩY

`diagonal` and `block` are necessary conditions of stability only, because D is the mean of the symbol over the
Brillouin zone. Margins (positive is unstable) have no unit. D is divided by M·2d/h², where M is the P-wave modulus and
2d/h² is the mean of κ². dT·dY is divided by Σ w|δY|² and multiplied by K₁₁/M, so that a uniaxial strain of the
undeformed lattice has the margin −1.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...geometry.bonds import Bonds, LatticeFamily
from ...models.base import AbstractModel
from ...models.kinematics import shape_tensor_K
from ...tangent.linearise import family_tangent
from ..bloch import block_at_center, modulus_at_rest
from .outcome import Outcome, decide


def _block_unit(model: AbstractModel, family: LatticeFamily) -> Array:
    return modulus_at_rest(model, family) * 2 * family.dim / family.spacing**2


def diagonal(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """The largest diagonal entry of D, and its axis as the mode."""
    D = block_at_center(model, family, F)
    entries = jnp.diag(D)
    axis = (jnp.arange(family.dim) == jnp.argmax(entries)).astype(D.dtype) if at is None else at
    value, mode = decide(D, axis)
    return Outcome(value / _block_unit(model, family), value, mode, at=mode)


def block(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """The largest eigenvalue of D, and its eigenvector as the mode."""
    value, mode = decide(block_at_center(model, family, F), at)
    return Outcome(value / _block_unit(model, family), value, mode, at=mode)


def _work(model: AbstractModel, family: LatticeFamily, F) -> tuple[Bonds, Array, Array]:
    """(bonds, V C, unit): V C is the matrix of the quadratic form dT·dY of the family, unit the scale K₁₁/M."""
    bonds = family.bonds(F)
    VC = bonds.volume[:, None, None, None] * family_tangent(model, bonds)
    return bonds, VC, shape_tensor_K(bonds)[0, 0] / modulus_at_rest(model, family)


def material_center(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """−dT·dY if the centre moves in the worst direction."""
    bonds, VC, unit = _work(model, family, F)
    value, mode = decide(-jnp.einsum("bicj->ij", VC) / jnp.sum(bonds.omega * bonds.volume), at)
    return Outcome(value * unit, value, mode, at=mode)


def material_neighbour(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """−dT·dY if the worst neighbour moves in the worst direction. Bonds of zero weight do not count."""
    bonds, VC, unit = _work(model, family, F)
    w = bonds.omega * bonds.volume
    each = -jnp.einsum("bibj->bij", VC) / jnp.where(w > 0, w, 1)[:, None, None]
    top = jnp.where(w > 0, jnp.linalg.eigvalsh(jax.lax.stop_gradient(each))[:, -1], -jnp.inf)
    worst, vector = (jnp.argmax(top), None) if at is None else at
    value, direction = decide(each[worst], vector)
    mode = jnp.zeros_like(bonds.xi).at[worst].set(direction)
    return Outcome(value * unit, value, mode, at=(worst, direction))


def _rigid(bonds: Bonds, dim: int) -> Float[Array, "rigid bonds dim"]:
    """Translations and infinitesimal rotations of the deformed family, as δY fields."""
    Y = bonds.xi + bonds.eta
    fields = [jnp.broadcast_to(jnp.eye(dim)[i], Y.shape) for i in range(dim)]
    for i in range(dim):
        for j in range(i + 1, dim):
            spin = np.zeros((dim, dim))
            spin[i, j], spin[j, i] = 1, -1
            fields.append(Y @ spin.T)
    return jnp.stack(fields)


def material(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """−dT·dY for the worst non-rigid δY. The mode is δY (bonds, dim), zero on bonds of zero weight."""
    bonds, VC, unit = _work(model, family, F)
    n, dim = bonds.xi.shape
    w = bonds.omega * bonds.volume
    root = jnp.sqrt(jnp.where(w > 0, w, 1))
    inverse = jnp.where(w > 0, 1 / root, 0)  # A bond of zero weight does no work.
    A = (VC * inverse[:, None, None, None] * inverse[None, None, :, None]).reshape(n * dim, n * dim)
    rigid = (_rigid(bonds, dim) * jnp.where(w > 0, root, 0)[None, :, None]).reshape(-1, n * dim).T
    Q = jnp.linalg.qr(rigid)[0]
    project = jnp.eye(n * dim, dtype=A.dtype) - Q @ Q.T
    idle = jnp.repeat(w <= 0, dim).astype(A.dtype)
    # Rigid and weightless directions get eigenvalues far below all others, so that they are never the largest.
    sink = 10 * jnp.linalg.norm(A) * (Q @ Q.T + jnp.diag(idle))
    value, z = decide(-project @ A @ project - sink, at)
    return Outcome(value * unit, value, inverse[:, None] * z.reshape(n, dim), at=z)
