"""The margin of the infinite lattice at every point's own stretch, and the distance to its critical load.

A point of a smoothly deformed body sees the lattice under its own F̄ = R U. Its margin is that of the criterion "symbol"
of `pdjax.stability`. For an objective model it depends on U alone. The **critical factor** t is the first factor at
which the lattice becomes unstable on the point's own path, I + t(U − I). It is above 1 for a stable point.

A body has many points and few different stretches. The stretches are divided into bins by farthest-point clustering
(Gonzalez): every new centre is the stretch that is farthest from the centres before it. The extreme stretches are
therefore centres, whose margin is exact. The points of a bin get the margin of its centre. The error of this is
measured at the points that are farthest from their centres.

A body that is no lattice has no infinite lattice of its own. The lattice of spacing h = V^{1/dim} (median) with the
same horizon and influence takes its place. This is an approximation, and the audit says so.

Reference
---------
T. F. Gonzalez, *Theor. Comput. Sci.* 38 (1985) 293–306 (clustering).
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._internal.checks import computed_in_double
from ..force.fields import affine_stress
from ..geometry.bonds import Families, LatticeFamily, lattice_family
from ..infinite_lattice.lattice_states import resting_modulus
from ..infinite_lattice.margins import margins
from ..models.base import AbstractModel
from ..models.pointwise import split_model

BINS = {1: 64, 2: 192, 3: 48}  # bins by dimension; their search takes about a second
FINE = 1e-6  # Stretches that differ by less [-] share a bin.
CHECKED = 16  # points at which the error of the bins is measured
BEYOND = (1.1, 1.25, 1.5, 2.0, 3.0, 4.0)  # factors tried for stable bins
WITHIN = (0.1, 0.25, 0.5, 0.75, 0.9)  # factors tried for unstable bins
GROUPS = 8  # largest number of materials in a body


class OwnLattice(NamedTuple):
    """Margins (points,) [-], their tolerances, critical factors (inf beyond 4), the bins, and the error of binning.

    The critical factors are None if they were not asked for.
    """

    margin: np.ndarray
    tolerance: np.ndarray
    critical_factor: np.ndarray | None
    bins: int
    error: float


class Material(NamedTuple):
    """The points of one material: their mask, the model with its constants, and two moduli of it.

    `modulus` is the P-wave modulus M and `bulk` the bulk modulus k of the interior lattice at rest [pressure].
    """

    mask: np.ndarray
    model: AbstractModel
    modulus: float
    bulk: float


def own_lattice_family(families: Families) -> tuple[LatticeFamily, str]:
    """The family of an interior point of the body's lattice, and what was assumed, in words ("" for a lattice)."""
    dim, horizons = families.dim, np.asarray(families.horizon, float)
    horizon = float(np.median(horizons))
    volumes = np.asarray(families.volumes, float)
    h = families.spacing or float(np.median(volumes)) ** (1 / dim)
    words = ""
    if families.spacing is None:
        spread = float(volumes.max() / volumes.min())
        words = (
            f"the points are no lattice: margins are those of the lattice of spacing {h:.4g} (median V^(1/{dim})) with"
            f" horizon/spacing {horizon / h:.3g}, an approximation; the volumes differ by a factor of {spread:.3g}"
        )
    if horizons.max() > horizons.min():
        more = (
            f"horizons from {horizons.min():.4g} to {horizons.max():.4g}: margins are those of the median {horizon:.4g}"
        )
        words = f"{words}; {more}" if words else more
    r, omega = _influence(families)
    family = lattice_family(dim, horizon / h, h, lambda x, _: np.interp(np.asarray(x), r, omega))
    return family, words


def _influence(families: Families) -> tuple[np.ndarray, np.ndarray]:
    """Lengths and influences of the body's bonds, sorted by length."""
    if families.grid is not None:
        r = np.linalg.norm(np.array(families.grid.offsets, float).reshape(-1, families.dim), axis=1)
        r, omega = r * float(families.spacing or 1.0), np.asarray(families.grid.influence, float)
    else:
        some = np.linspace(0, len(families) - 1, min(len(families), 256)).astype(int)
        bond = np.arange(families.xi.shape[1]) < np.asarray(families.count)[some, None]
        r = np.linalg.norm(np.asarray(families.xi)[some], axis=-1)[bond]
        omega = np.asarray(families.influence, float)[some][bond]
    order = np.argsort(r)
    return r[order], omega[order]


@eqx.filter_jit
def _bulk(model: AbstractModel, family: LatticeFamily) -> Array:
    """k = ℂ_iijj/d² of the model's own tangent at rest on the interior lattice."""
    I = jnp.eye(family.dim, dtype=family.xi.dtype)
    return jnp.trace(jax.jvp(lambda F: affine_stress(model, family, F), (I,), (I,))[1]) / family.dim**2


def materials(model: AbstractModel, families: Families, family: LatticeFamily) -> list[Material]:
    """The materials of a body: one if its constants are single numbers. Raises ValueError if there are too many."""
    points = len(families)
    varying, shared = split_model(model, points)
    leaves = [np.asarray(x).reshape(points, -1) for x in jax.tree.leaves(varying)]
    if leaves:
        _, first, label = np.unique(np.concatenate(leaves, axis=1), axis=0, return_index=True, return_inverse=True)
        label = label.reshape(-1)
    else:
        first, label = np.zeros(1, int), np.zeros(points, int)
    if len(first) > GROUPS:
        raise ValueError(
            f"the constants of the model take {len(first)} different values over the points; the audit judges up to"
            f" {GROUPS} materials. Audit the parts of the body one after another"
        )
    found = []
    for number, at in enumerate(first):
        single = eqx.combine(jax.tree.map(lambda x, at=at: x[at], varying), shared)
        M = resting_modulus(single, family)
        found.append(Material(label == number, single, M, float(computed_in_double(_bulk, single, family))))
    return found


def cover(values: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Up to `most` centres that cover the rows of `values` (n, p): their indices, each row's bin, and its distance."""
    centres = [int(np.argmax(((values - values.mean(axis=0)) ** 2).sum(axis=1)))]
    label, distance = np.zeros(len(values), int), ((values - values[centres[0]]) ** 2).sum(axis=1)
    while len(centres) < most:
        far = int(np.argmax(distance))
        if distance[far] <= FINE**2:
            break
        new = ((values - values[far]) ** 2).sum(axis=1)
        nearer = new < distance
        label[nearer], distance[nearer] = len(centres), new[nearer]
        centres.append(far)
    return np.array(centres), label, np.sqrt(distance)


def _factors(material: Material, family: LatticeFamily, G: np.ndarray, unstable: np.ndarray) -> np.ndarray:
    """The critical factors of the deformations I + G (bins, dim, dim), to the interpolation between the factors tried.

    `unstable` (bins,) tells which of them are unstable.
    """
    out, I = np.full(len(G), np.inf), np.eye(G.shape[-1])
    moved = np.abs(G).max(axis=(1, 2)) > FINE
    for side, tried in ((unstable, WITHIN), (~unstable, BEYOND)):
        left = np.flatnonzero(side & moved)
        if side is unstable:
            out[left] = 1.0
        before = np.full(len(left), 0.0 if side is unstable else 1.0)
        low = np.full(len(left), -np.inf)
        for t in tried:
            F = I + t * G[left]
            if not len(left):
                break
            whole = np.linalg.det(F) > 0
            value, tolerance = np.full(len(left), np.inf), np.zeros(len(left))
            if whole.any():
                value[whole], tolerance[whole] = margins(material.model, family, F[whole])
            value = np.where(np.isnan(value), np.inf, value)
            crossed = value > tolerance
            known = crossed & np.isfinite(low) & np.isfinite(value)
            share = np.full(len(left), 0.5)
            share[known] = low[known] / (low[known] - value[known])
            out[left[crossed]] = (before + (t - before) * share)[crossed]
            left, low, before = left[~crossed], np.minimum(value[~crossed], 0.0), np.full((~crossed).sum(), t)
    return out


def own_lattice(family: LatticeFamily, parts: list[Material], G: np.ndarray, path: bool, finer: int = 1) -> OwnLattice:
    """Margins and, if `path` is True, critical factors of all points under their deformations I + G (points, dim, dim).

    G is U − I for an objective model and F̄ − I for any other. A point gets NaN if its G is not finite or
    det(I + G) ≤ 0. `finer` multiplies the number of bins.
    """
    points, dim = G.shape[:2]
    margin, tolerance, factor = np.full(points, np.nan), np.zeros(points), np.full(points, np.nan)
    bins, error = 0, 0.0
    whole = np.isfinite(G).all(axis=(1, 2)) & (np.linalg.det(np.eye(dim) + np.where(np.isfinite(G), G, 0.0)) > 0)
    for part in parts:
        index = np.flatnonzero(part.mask & whole)
        if not len(index):
            continue
        mine = G[index]
        centres, label, distance = cover(mine.reshape(len(mine), -1), max(2, finer * BINS[dim] // len(parts)))
        value, rounding = margins(part.model, family, np.eye(dim) + mine[centres])
        margin[index], tolerance[index] = value[label], rounding[label]
        if path:
            factor[index] = _factors(part, family, mine[centres], value > rounding)[label]
        bins += len(centres)
        far = np.argsort(-distance)[:CHECKED]
        far = far[distance[far] > FINE]
        if len(far):
            exact, _ = margins(part.model, family, np.eye(dim) + mine[far])
            error = max(error, float(np.nanmax(np.abs(exact - value[label[far]]), initial=0.0)))
    return OwnLattice(margin, tolerance, factor if path else None, bins, error)
