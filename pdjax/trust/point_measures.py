"""Measures of every point of a deformed body that need no eigenvalue: how far its family is from an affine deformation.

The family of a point has the best affine deformation F̄ = I + (Σ w η⊗ξ) K⁻¹ with K = Σ w ξ⊗ξ and w = ω V, and the polar
decomposition F̄ = R U. Every bond deviates from it by z = η − (F̄ − I)ξ. In a smooth deformation z is small, of the order
of horizon × strain gradient. A zero-energy mode consists of z alone: a correspondence model does not feel it.

    zero_energy   P/(P + W(U)),  P = ½ (c/δ) D²,  D² = Σ w |z|²   share of the energy that a penalty of strength 1 holds
    non_affine    D²/(D² + Σ w |(U − I)ξ|²)                       the same share without moduli
    alternation   −d_i·d_j/s², the smaller value of two opposite nearest neighbours, of the pair where it is largest

d = Σ w z/Σ w is the mean deviation of a family, and s² the mean of |d|² over the family. W(U) is the energy density of
the model if the same family has the affine deformation U. D² is the non-affine displacement of Falk and Langer. The
first two measures lie between 0 and 1, the alternation between −1 and 1. None changes if the body rotates. Where all
strains are zero to rounding, the first two are 0.

A checkerboard has the alternation 1. A smooth field has about −1. At a surface or at the edge of a hole d changes its
sign once, from one point to the next. The measure therefore asks for neighbours on two sides. With one neighbour only,
a solved plate with a hole (LPS, horizon of 2 spacings) alternates at points with `zero_energy` 0.49, and with pairs at
none. Modes with wavelengths from 2 to 3 spacings alternate, modes with 4 do not.

References
----------
S. A. Silling, *CMAME* 322 (2017) 42–57 (z and its penalty); M. L. Falk, J. S. Langer, *Phys. Rev. E* 57 (1998) 7192
(D²).
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import computed_in_double
from ..geometry.bonds import Bonds, Families
from ..models.base import AbstractModel
from ..models.pointwise import each_point, split_model

CHUNK = 8192  # points whose bonds are in memory at once
NEAREST = 1.2  # A neighbour is near if its bond is at most this many times as long as the shortest of the point.
OPPOSITE = -0.7  # Two neighbours are opposite if the cosine of the angle between their bonds is below this.
SINGULAR = 1e-8  # Families whose K has a smaller ratio of eigenvalues have no F̄.


class PointMeasures(NamedTuple):
    """The measures of all points, as NumPy arrays.

    `gradient` (points, dim, dim) is F̄ − I, and `stretch` (points, dim, dim) is U − I. `energy` (points,) is P + W(U)
    [energy/length^dim]. `shape_ratio` (points,) is the smallest eigenvalue of K divided by the largest. The others are
    those of the module docstring. At points without an invertible K all but `shape_ratio` are 0, and det F̄ is 1.
    """

    gradient: np.ndarray
    stretch: np.ndarray
    det: np.ndarray
    energy: np.ndarray
    shape_ratio: np.ndarray
    zero_energy: np.ndarray
    non_affine: np.ndarray
    alternation: np.ndarray


class _Family(NamedTuple):
    """The bonds of a chunk of points, as NumPy arrays in double precision."""

    rows: slice
    neighbours: np.ndarray
    xi: np.ndarray
    omega: np.ndarray
    volume: np.ndarray
    intact: np.ndarray | None

    @property
    def w(self) -> np.ndarray:
        return self.omega * self.volume


def _chunks(families: Families) -> Iterator[_Family]:
    arrays = families.neighbours, families.xi, families.influence, families.weight, families.volumes
    neighbours, xi, influence, weight, volumes = (np.asarray(x) for x in arrays)
    for start in range(0, len(families), CHUNK):
        rows = slice(start, min(start + CHUNK, len(families)))
        omega = (influence[rows] * weight[rows]).astype(float)
        volume, intact = volumes[neighbours[rows]].astype(float), None
        if families.intact is not None:
            intact = (influence[rows] * np.asarray(families.intact)[rows]).astype(float)
        yield _Family(rows, neighbours[rows], xi[rows].astype(float), omega, volume, intact)


def right_stretch(H: Float[np.ndarray, "*points dim dim"]) -> Float[np.ndarray, "*points dim dim"]:
    """U − I of F = I + H = R U, without cancellation where the strain is small."""
    twice, Q = np.linalg.eigh(H + H.mT + H.mT @ H)  # 2E, of eigenvalues λ² − 1
    grown = twice / (1 + np.sqrt(np.maximum(1 + twice, 0.0)))
    return (Q * grown[..., None, :]) @ Q.mT


def _affine_energies(model: AbstractModel, bonds: Bonds) -> Float[Array, " points"]:
    """W of every family. A model without an energy has the work ½ Σ V T·η in its place."""
    if model.hyperelastic:
        return each_point("energy", model, bonds)
    T = each_point("force_state", model, bonds)
    return 0.5 * jnp.einsum("pb,pbi,pbi->p", bonds.volume, T, bonds.eta)


_energies = eqx.filter_jit(_affine_energies)


def _energy_of_stretch(model: AbstractModel, families: Families, stretch: np.ndarray) -> np.ndarray:
    """W(U) of every point, in chunks that all have the same size."""
    points, size = len(families), min(CHUNK, len(families))
    varying, shared = split_model(model, points)
    W = np.empty(points)
    for part in _chunks(families):
        rows = np.arange(part.rows.start, part.rows.start + size) % points  # The last chunk is filled up.
        pad = size - len(part.xi)

        def filled(x, pad=pad):
            return np.concatenate([x, np.repeat(x[:1], pad, axis=0)]) if pad else x

        xi, omega, volume = (filled(x) for x in (part.xi, part.omega, part.volume))
        eta = np.einsum("pij,pbj->pbi", filled(stretch[part.rows]), xi)
        mine = jax.tree.map(lambda x, rows=rows: x[rows], varying)
        horizon = np.broadcast_to(np.asarray(families.horizon, float), (size,))
        parts: list[Any] = [xi, eta, omega, volume, horizon]
        if part.intact is not None:
            parts.append(filled(part.intact))
        bonds = Bonds(*parts)
        W[part.rows] = computed_in_double(_energies, eqx.combine(mine, shared), bonds)[: len(part.xi)]
    return W


def _nearest(part: _Family) -> tuple[np.ndarray, np.ndarray]:
    """The slots of the nearest neighbours of every point, (points, n), and which of them are neighbours."""
    length = np.where(part.w > 0, np.linalg.norm(part.xi, axis=-1), np.inf)
    near = (part.w > 0) & (length <= NEAREST * length.min(axis=1, keepdims=True))
    slots = np.argsort(~near, axis=1, kind="stable")[:, : max(1, int(near.sum(axis=1).max()))]
    return slots, np.take_along_axis(near, slots, axis=1)


def alternation(families: Families, d: np.ndarray) -> np.ndarray:
    """The alternation of a field d (points, dim) at every point. It is 0 at a point without neighbours.

    Most surface points have no opposite neighbours in the direction of the normal. A point without any pair of opposite
    neighbours gets the largest value of its nearest neighbours, or that of its own single neighbours if it is smaller.
    """
    single, pairs = np.zeros(len(families)), np.zeros(len(families))
    square = (d**2).sum(axis=1)
    for part in _chunks(families):
        slots, near = _nearest(part)
        real = part.w > 0
        s2 = square[part.rows] + (square[part.neighbours] * real).sum(axis=1)
        s2 /= 1 + real.sum(axis=1)
        against = -np.einsum("pi,pni->pn", d[part.rows], d[np.take_along_axis(part.neighbours, slots, axis=1)])
        against = np.where(near, against / np.where(s2 > 0, s2, 1.0)[:, None], -np.inf)
        e = np.take_along_axis(part.xi, slots[..., None], axis=1)
        e = e / np.linalg.norm(e, axis=-1, keepdims=True)
        cosine = np.where(near[:, None, :], e @ e.mT, 2.0)
        other = np.take_along_axis(against, cosine.argmin(axis=-1), axis=1)
        both = np.where(near & (cosine.min(axis=-1) < OPPOSITE), np.minimum(against, other), -np.inf)
        single[part.rows], pairs[part.rows] = against.max(axis=1), both.max(axis=1)
    out = pairs.copy()
    for part in _chunks(families):
        slots, near = _nearest(part)
        theirs = np.where(near, pairs[np.take_along_axis(part.neighbours, slots, axis=1)], -np.inf).max(axis=1)
        own = single[part.rows]
        lent = np.where(np.isfinite(theirs), np.minimum(own, theirs), own)
        out[part.rows] = np.where(np.isfinite(pairs[part.rows]), pairs[part.rows], lent)
    return np.clip(np.where(np.isfinite(out), out, 0.0), -1.0, 1.0)


def point_measures(
    model: AbstractModel,
    families: Families,
    u: np.ndarray,
    F: np.ndarray | None,
    stiffness: Float[np.ndarray, " points"] | float,
    modulus: Float[np.ndarray, " points"] | float,
) -> PointMeasures:
    """The measures of all points under the displacement u (points, dim) and the mean deformation F.

    `stiffness` is c/δ [pressure/length^(dim+2)] of the penalty and `modulus` a modulus [pressure] of the model, one
    number or one for each point.
    """
    points, dim = u.shape
    H, stretch, d = np.zeros((points, dim, dim)), np.zeros((points, dim, dim)), np.zeros((points, dim))
    ratio, D2, S, size = (np.zeros(points) for _ in range(4))
    mean = 0.0 if F is None else np.asarray(F, float) - np.eye(dim)
    eps = float(np.finfo(u.dtype).eps)
    u = u.astype(float)
    for part in _chunks(families):
        eta = u[part.neighbours] - u[part.rows, None, :] + (part.xi @ np.transpose(mean) if F is not None else 0.0)
        wxi = part.w[..., None] * part.xi
        K = wxi.mT @ part.xi
        values = np.linalg.eigvalsh(K)
        top = values[:, -1]
        ratio[part.rows] = np.where(top > 0, values[:, 0] / np.where(top > 0, top, 1.0), 0.0)
        sound = ratio[part.rows] > SINGULAR
        K = np.where(sound[:, None, None], K, np.eye(dim))
        gradient = np.where(sound[:, None, None], (eta.mT @ wxi) @ np.linalg.inv(K), 0.0)
        z = np.where(sound[:, None, None], eta - part.xi @ gradient.mT, 0.0)
        grown = right_stretch(gradient)
        H[part.rows], stretch[part.rows] = gradient, grown
        D2[part.rows] = (part.w * (z**2).sum(axis=-1)).sum(axis=1)
        total = part.w.sum(axis=1)
        d[part.rows] = (part.w[..., None] * z).sum(axis=1) / np.where(total != 0, total, 1.0)[:, None]
        size[part.rows] = np.trace(K, axis1=1, axis2=2)
        S[part.rows] = np.einsum("pij,pjk,pik->p", grown, K, grown)
    noise = (64 * eps * (1 + np.abs(u).max(initial=0.0) / np.asarray(families.horizon))) ** 2
    P = 0.5 * stiffness * D2
    W = _energy_of_stretch(model, families, stretch)
    W = np.where(np.isfinite(W), np.maximum(W, 0.0), np.inf)  # Collapsed matter is found by det F̄.
    return PointMeasures(
        H,
        stretch,
        np.linalg.det(np.eye(dim) + H),
        P + W,
        ratio,
        P / (P + W + modulus * noise),
        D2 / (D2 + S + size * noise),
        alternation(families, d),
    )
