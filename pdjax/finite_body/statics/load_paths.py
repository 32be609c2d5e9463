"""What bonds that have broken leave of a scene: the pieces that nothing holds, and whether a load path remains.

A connected piece is a set of points that no bond joins to other points (`pdjax.finite_body.rigid_motions`). A break
may change the scene in three ways:

    a piece is separated    it has a rigid motion that no support prevents. Nothing loads that motion: the piece is free
                            of forces, and has many equilibria. One of them is as good as another.
    a load is lost          the body forces do work along such a rigid motion. There is no equilibrium.
    the body is severed     no piece is strained: no body force acts, and the prescribed displacements of every piece
                            are those of a rigid motion. More load cannot break another bond.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..rigid_motions import connected_pieces, free_pieces, rigid_motions
from ..scene import Scene

# A displacement, or a work, that is smaller than this share of the largest counts as zero. Measured: below 1e-15.
ZERO = 1e-9


class LoadPaths(NamedTuple):
    """What the bonds that are left can carry.

    `separated` (points,) tells which points belong to a piece with a free rigid motion. `lost` holds the points of a
    loaded piece that nothing holds, or is None. `severed` tells whether no piece is strained.
    """

    separated: Bool[np.ndarray, " points"]
    lost: np.ndarray | None
    severed: bool


def load_paths(scene: Scene, u: Float[np.ndarray, "points dim"]) -> LoadPaths:
    """Examine the pieces of a scene at the displacement u. The scene must be concrete."""
    X, periodic, held = np.asarray(scene.body.positions, float), scene.body.period is not None, ~scene.free
    force = np.asarray(scene.families.volumes)[:, None] * np.asarray(scene.load)
    separated, lost = np.zeros(len(X), bool), None
    for piece in free_pieces(X + u, scene.families, held, periodic):
        separated[piece.points] = True
        pull = force[piece.points]
        work = np.abs(np.einsum("mpi,pi->m", piece.motions, pull))
        if lost is None and (work > ZERO * np.linalg.norm(pull)).any():
            lost = piece.points
    prescribed = np.asarray(scene.prescribed)
    largest = np.abs(prescribed).max(initial=0.0)

    def strained(points: np.ndarray) -> bool:
        if force[points].any():
            return True
        mine = held[points]
        values = prescribed[points][mine]
        motions = rigid_motions(X[points], periodic)[0][:, mine].T
        left = values - motions @ np.linalg.lstsq(motions, values, rcond=None)[0] if values.size else values
        return bool(np.abs(left).max(initial=0.0) > ZERO * largest)

    return LoadPaths(separated, lost, not any(map(strained, connected_pieces(scene.families))))
