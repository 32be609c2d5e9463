"""The rigid motions of a body that no support prevents, for each of its connected pieces.

A connected piece is a set of points that no bond joins to other points. Its infinitesimal rigid motions are the
translations and, unless the body is periodic, the rotations. A motion is free if it moves no held component.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float

from ..geometry.bonds import Families


class FreePiece(NamedTuple):
    """A connected piece with free rigid motions.

    `points` are its point numbers, `motions` (motions, points of the piece, dim) an orthonormal basis of the free
    motions, and `names` their names. It is piece `number` of `of` pieces.
    """

    points: np.ndarray
    motions: np.ndarray
    names: list[str]
    number: int
    of: int


def rigid_motions(positions: np.ndarray, periodic: bool) -> tuple[np.ndarray, list[str]]:
    """Infinitesimal rigid motions (motions, points, dim), of unit size, and their names."""
    points, dim = positions.shape
    axes = "xyz"[:dim]
    motions, names = [], []
    for k in range(dim):
        motions.append(np.broadcast_to(np.eye(dim)[k], (points, dim)))
        names.append(f"translation along {axes[k]}")
    centred = positions - positions.mean(axis=0)
    size = max(float(np.abs(centred).max()), np.finfo(float).tiny)
    for i in range(0 if periodic else dim):
        for k in range(i + 1, dim):
            turn = np.zeros((points, dim))
            turn[:, i], turn[:, k] = -centred[:, k] / size, centred[:, i] / size
            if np.abs(turn).max() > 0:
                motions.append(turn)
                names.append(f"rotation in the plane {axes[i]}{axes[k]}")
    return np.array(motions), names


def _name_motions(loose: np.ndarray, names: list[str], dim: int) -> list[str]:
    """Names of the free motions, given as coefficients (motions, coefficients) of the named rigid motions.

    A mixture of rotation and translation is a rotation about some held point, so it gets the name of the rotation.
    """
    size, directions = np.linalg.svd(loose, full_matrices=False)[1:]
    span = directions[size > 1e-9 * size[0]]
    share = np.sum(span**2, axis=0)  # the fraction of each named motion that is free
    pure = [k for k in range(len(names)) if share[k] > 1 - 1e-6]
    mixed = sorted((k for k in range(len(names)) if k not in pure), key=lambda k: (k < dim, -share[k]))
    return [names[k] for k in sorted([*pure, *mixed[: len(span) - len(pure)]])]


def connected_pieces(families: Families) -> list[np.ndarray]:
    """The point numbers of each connected piece. The families must be concrete."""
    from scipy.sparse.csgraph import connected_components

    points = len(families)
    true = np.asarray(families.weight) * np.asarray(families.influence) > 0
    i, slot = np.nonzero(true)
    graph = sp.coo_array((np.ones(len(i)), (i, np.asarray(families.neighbours)[i, slot])), shape=(points, points))
    pieces, label = connected_components(graph, directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(order, np.cumsum(np.bincount(label, minlength=pieces))[:-1])


def free_pieces(
    positions: Float[np.ndarray, "points dim"], families: Families, held: Bool[np.ndarray, "points dim"], periodic: bool
) -> Iterator[FreePiece]:
    """The connected pieces with free rigid motions, in the configuration with the given positions [length].

    `held` tells which components are held. The families must be concrete.
    """
    dim, pieces = positions.shape[1], connected_pieces(families)
    for piece, inside in enumerate(pieces):
        motions, names = rigid_motions(positions[inside], periodic)
        flat = motions.reshape(len(names), -1)
        # Only motions that move a point enter the orthonormal basis: points on a line cannot rotate about the line.
        size, mix = np.linalg.eigh(flat @ flat.T)
        basis = (mix / np.sqrt(np.maximum(size, np.finfo(float).tiny))).T[size > 1e-10 * size[-1]]
        at_held = np.einsum("mk,kh->mh", basis, motions[:, held[inside]])  # (motions, held components)
        square = np.linalg.qr(at_held.T, mode="r") if at_held.shape[1] > len(basis) else at_held.T
        _, grip, directions = np.linalg.svd(np.concatenate([square, np.zeros((len(basis), len(basis)))]))
        loose = directions[grip <= 1e-9 * np.sqrt(max(1, at_held.shape[1]) / flat.shape[1])] @ basis
        if len(loose):
            fields = np.einsum("lm,mpi->lpi", loose, motions)
            yield FreePiece(inside, fields, _name_motions(loose, names, dim), piece + 1, len(pieces))
