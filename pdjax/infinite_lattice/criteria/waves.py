"""Criteria of waves.

    symbol   sup over the Brillouin zone, k → 0 included, of λ_max(Ĵ(k)) / (M κ²): exact on the infinite lattice
    affine   −min over N of λ_min(N·∂²W(F)·N) / M: the acoustic tensor of the energy of affine maps, the limit k → 0
    local    the same for the classical law ψ(F), which differs from affine for Seth–Hill unless m = 1

**Search.** `search` finds the wave vector and mode of the maximum, on the cosine series of the symbol and without
derivatives (see `pdjax.infinite_lattice.brillouin` for its words: grid, screen, start, climb). The margin is then the
quotient at that wave vector and mode. By the envelope theorem its derivative in any parameter is vᵀ(∂Ĵ)v. For a model
without an energy, the growth of its modes takes the place of λ_max (`flutter`).
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..._internal.checks import Numbers, namespace
from ...force.fields import affine_stress
from ...geometry.bonds import LatticeFamily
from ...models.base import AbstractModel
from ..bloch import Phases, homogeneous_tangent, laplacian, long_wave_phases, modulus_at_rest, wave_phases
from ..brillouin import Zone, class_best, directions, in_zone, largest_eigenvalue, nudge, second_best, top_pair
from ..climb import climb
from ..cosine_series import Forms, Series, entries, forms, on_grid, packed, reached, series, upper
from . import flutter
from .outcome import Outcome, margin_tolerance

# Number of states whose starts climb in one batch, by dimension. A large batch has fewer sequential steps. In a small
# batch fewer finished starts wait for the slowest one.
GROUP = {1: 16, 2: 16, 3: 4}


class Found(NamedTuple):
    """Where the searches of many states ended.

    `x` [1/spacing] and `mode` belong to the largest quotient. If `is_long` is True, x is the direction of the limit
    k → 0. `fast_x` and `fast_mode` belong to the largest eigenvalue. `scale` is the largest |quotient| on the grid.
    """

    x: Float[Numbers, "states dim"]
    is_long: Bool[Numbers, " states"]
    mode: Float[Numbers, "states dim"]
    fast_x: Float[Numbers, "states dim"]
    fast_mode: Float[Numbers, "states dim"]
    scale: Float[Numbers, " states"]


def sampled(blocks: Float[Numbers, "offsets p"], offsets: np.ndarray, zone: Zone) -> tuple[Numbers, Numbers]:
    """Ĵ of one state on the grid of the zone (p, waves), and Ĵ/|x|² in the limit x → 0 along `directions` (compass, p).

    `blocks` and both results hold upper triangles (`packed`).
    """
    dim, real = offsets.shape[1], blocks.dtype
    compass = directions(dim).astype(real)
    values = on_grid(blocks, offsets, list(zone.axes)).reshape(blocks.shape[1], -1)[:, zone.places]
    (rows, columns), _ = upper(dim)
    pairs = compass[:, rows] * compass[:, columns] * np.where(rows == columns, 1, 2).astype(real)
    fourth = (offsets[:, rows] * offsets[:, columns]).astype(real).T @ blocks
    return values, -(pairs @ fourth)


def _screen(
    blocks: Float[Numbers, "offsets p"], offsets: np.ndarray, zone: Zone
) -> tuple[Numbers, Numbers, Array | np.floating]:
    """The starts (lanes, dim) of one state, Ĵ at the starts (lanes, p), and the largest |quotient| on the grid.

    The starts are the best wave of every class, the second best wave of all, the wave of the largest eigenvalue, and
    the best direction of the limit k → 0.
    """
    xp, dim, real = namespace(blocks), offsets.shape[1], blocks.dtype
    grid, compass = zone.grid.astype(real), directions(dim).astype(real)
    values, long = sampled(blocks, offsets, zone)
    top = largest_eigenvalue(entries(values, dim))
    screen = top / laplacian(grid)
    way = xp.argmax(largest_eigenvalue(entries(long.T, dim)))
    waves = xp.concatenate([class_best(zone, screen), xp.stack([second_best(zone, screen), xp.argmax(top)])])
    starts = xp.concatenate([xp.asarray(grid)[waves], xp.asarray(compass)[way][None]])
    return starts, xp.concatenate([values[:, waves].T, long[way][None]]), xp.max(abs(screen))


def search(
    blocks: Float[Numbers, "states offsets p"],
    count: Array | int,
    offsets: np.ndarray,
    zone: Zone,
    group: int | None = None,
) -> Found:
    """Search the Brillouin zone for the first `count` states in one program. The results of the other states are unset.

    `blocks` holds the cosine series of every state in units of M/h² (`packed`). `group` states climb in one batch.
    """
    states, dim, real = blocks.shape[0], offsets.shape[1], blocks.dtype
    group = math.gcd(states, group or GROUP[dim])

    def one_group(i, found):
        some = jax.lax.dynamic_slice_in_dim(blocks, i * group, group)
        new = _climbed(some, _screened(some, jnp.minimum(group, count - i * group), offsets, zone), offsets, zone)
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_slice_in_dim(x, y, i * group, 0), found, new)

    vector, flag = jnp.zeros((states, dim), real), jnp.zeros(states, bool)
    blank = Found(vector, flag, vector, vector, vector, jnp.zeros(states, real))
    return jax.lax.fori_loop(0, -(-count // group), one_group, blank)


def search_few(blocks: Numbers, offsets: np.ndarray, zone: Zone) -> Found:
    """`search` for a few states in NumPy, which compiles nothing."""
    with np.errstate(all="ignore"):  # Values that are not finite lose every comparison.
        each = [_screen(state, offsets, zone) for state in blocks]
        starts, at, scale = (np.stack(parts) for parts in zip(*each, strict=True))
        return _climbed(blocks, (starts, at, scale), offsets, zone)


def _screened(blocks: Float[Numbers, "states offsets p"], count: Array | int, offsets: np.ndarray, zone: Zone) -> tuple:
    """`_screen` of the first `count` states, one after another."""
    (states, _, size), dim, lanes = blocks.shape, offsets.shape[1], len(zone.members) + 3

    def one(i, made):
        return tuple(x.at[i].set(y) for x, y in zip(made, _screen(blocks[i], offsets, zone), strict=True))

    blank = [jnp.ones((states, lanes, dim), blocks.dtype), jnp.zeros((states, lanes, size), blocks.dtype)]
    return jax.lax.fori_loop(0, count, one, (*blank, jnp.zeros(states, blocks.dtype)))


def _climbed(blocks: Numbers, screened: tuple, offsets: np.ndarray, zone: Zone) -> Found:
    """Let all starts climb in one batch, and return for each state the best of the starts and of their maxima."""
    starts, at, scale = screened
    xp, (states, lanes, dim), real = namespace(blocks), starts.shape, blocks.dtype
    bare, long = np.arange(lanes) == lanes - 2, np.arange(lanes) == lanes - 1
    _, place = upper(dim)
    finite = xp.isfinite(at).all(axis=-1)  # NumPy's eigh raises an error for NaN.
    values, vectors = xp.linalg.eigh(xp.where(finite[..., None], at, 0)[..., place])
    kappa2 = xp.where(bare, 1.0, laplacian(starts, long[:, None]))
    at_start = xp.where(finite, values[..., -1] / kappa2, -xp.inf)
    sums = Series.of(blocks, offsets)
    begin = starts + nudge(dim, zone.step).astype(real)
    climbed = climb(lambda x: forms(sums, x, long, bare), begin, vectors[..., -1], zone.step)
    x, v, q = (xp.concatenate(both, axis=1) for both in zip((starts, vectors[..., -1], at_start), climbed, strict=True))
    q, bare = xp.where(xp.isnan(q), -xp.inf, q), np.tile(bare, 2)
    best, fast = (xp.argmax(xp.where(out, -xp.inf, q), axis=1) for out in (bare, ~bare))
    row = np.arange(states, dtype=np.int32)
    return Found(x[row, best], xp.asarray(np.tile(long, 2))[best], v[row, best], x[row, fast], v[row, fast], scale)


def _pick(condition, if_true: Phases, if_false: Phases) -> Phases:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), if_true, if_false)


def _frozen_angles(phases: Phases) -> Phases:
    """Stop the derivatives of the angles k·ξ in the spacing. Only κ² [1/length²] depends on the spacing."""
    c, s, even = jax.lax.stop_gradient(phases[:3])
    return Phases(c, s, even, phases.kappa2)


def _phases_at(family: LatticeFamily, x: Array, is_long: Array) -> Phases:
    """Phases of the wave vector x/h, or of the limit k → 0 along x if `is_long` is True."""
    return _pick(is_long, long_wave_phases(family, x), wave_phases(family, x / family.spacing))


def symbol(
    model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], zone: Zone, at=None, fastest: bool = True
) -> Outcome:
    """The criterion "symbol". If `fastest` is True, an unstable state reports its largest eigenvalue."""
    tangent = homogeneous_tangent(model, family, F)
    M = modulus_at_rest(model, family)
    if not model.hyperelastic:
        return _by_growth(tangent, M, family, zone, at)
    if at is None:
        quiet, unit = jax.lax.stop_gradient((tangent, family.spacing**2 / M))
        bonds = len(family.influence)
        blocks = packed(series(quiet, family.dim, bonds)) * unit
        found = search(blocks[None], 1, reached(family.dim, bonds, tangent.rings), zone)
        at = jax.tree.map(lambda y: y[0], found)
    x, is_long, mode, y, shape, scale = at = jax.lax.stop_gradient(at)
    phases = _frozen_angles(_phases_at(family, x, is_long))
    work = mode @ tangent(phases) @ mode
    margin = work / (M * phases.kappa2)

    eigenvalue, k = jnp.where(is_long, 0 * work, work), jnp.where(is_long, 0 * x, x)
    if fastest:
        unstable = jax.lax.stop_gradient(margin) > margin_tolerance(M.dtype, scale)
        growth = shape @ tangent(_frozen_angles(wave_phases(family, y / family.spacing))) @ shape
        eigenvalue, k = jnp.where(unstable, growth, eigenvalue), jnp.where(unstable, y, k)
        x, mode = jnp.where(unstable, y, x), jnp.where(unstable, shape, mode)
    k = in_zone(k)  # A climb can end in a neighbouring zone.
    return Outcome(margin, eigenvalue, mode, k / family.spacing, x / jnp.linalg.norm(x), scale, at)


def _by_growth(tangent, M: Array, family: LatticeFamily, zone: Zone, at) -> Outcome:
    if at is None:
        quiet, unit = jax.lax.stop_gradient((tangent, family.spacing**2 / M))
        bonds = len(family.influence)
        blocks = series(quiet, family.dim, bonds) * unit
        at = flutter.search(blocks, reached(family.dim, bonds, tangent.rings), zone)
    (x, is_long, right, left), (y, *pair), scale = at = jax.lax.stop_gradient(at)
    phases = _frozen_angles(_phases_at(family, x, is_long))
    square = flutter.quotient(tangent, phases, right, left)
    eigenvalue, k = jnp.where(is_long, 0 * square, square), jnp.where(is_long, 0 * x, x)
    mode, margin = right.real / jnp.linalg.norm(right.real), square / (M * phases.kappa2)
    growth = flutter.quotient(tangent, _frozen_angles(wave_phases(family, y / family.spacing)), *pair)
    unstable = jax.lax.stop_gradient(margin) > margin_tolerance(M.dtype, scale)
    eigenvalue, k, x = (jnp.where(unstable, a, b) for a, b in ((growth, eigenvalue), (y, k), (y, x)))
    mode = jnp.where(unstable, pair[0].real / jnp.linalg.norm(pair[0].real), mode)
    return Outcome(margin, eigenvalue, mode, k / family.spacing, x / jnp.linalg.norm(x), scale, at)


def _acoustic_forms(fourth: Float[Array, "dim dim dim dim"], N: Float[Numbers, "*lanes dim"]) -> Forms:
    """−(N·A·N) / |N|² with derivatives. A (i, J, k, L) is made symmetric in J, L and in i, k."""
    A = (fourth + fourth.transpose(0, 3, 2, 1)) / 2
    A = -((A + A.transpose(2, 1, 0, 3)) / 2).transpose(1, 3, 0, 2)
    first = jnp.einsum("abij,...b->...aij", A, N)
    eye = jnp.eye(N.shape[-1], dtype=N.dtype)
    curvature = jnp.broadcast_to(2 * A, (*N.shape[:-1], *A.shape))
    square = jnp.sum(N**2, axis=-1)
    return Forms(jnp.einsum("...aij,...a->...ij", first, N), 2 * first, curvature, square, 2 * N, 2 * eye)


def _acoustic(fourth: Float[Array, "dim dim dim dim"], model, family, at) -> Outcome:
    M = modulus_at_rest(model, family)

    def matrix(A, N):
        return -jnp.einsum("iJkL,J,L->ik", A, N, N) / jnp.sum(N**2)

    if at is None:
        frozen = jax.lax.stop_gradient(fourth / M)
        compass = jnp.asarray(directions(family.dim), dtype=family.xi.dtype)
        screen = jax.vmap(lambda N: top_pair(matrix(frozen, N))[0])(compass)
        start = compass[jnp.argmax(screen)]
        begin = start + jnp.asarray(nudge(family.dim, 0.05), dtype=family.xi.dtype)
        climbed, *_ = climb(lambda N: _acoustic_forms(frozen, N), begin, top_pair(matrix(frozen, begin))[1], 0.1)
        points = jnp.stack([start, climbed])
        values, modes = jax.vmap(lambda N: top_pair(matrix(frozen, N)))(points)
        best = jnp.argmax(jnp.where(jnp.isnan(values), -jnp.inf, values))
        at = points[best] / jnp.linalg.norm(points[best]), modes[best]
    direction, mode = at = jax.lax.stop_gradient(at)
    value = mode @ matrix(fourth, direction) @ mode
    return Outcome(value / M, value, mode, 0 * direction, direction, at=at)


def affine(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """Strong ellipticity of the energy of affine maps W(F). The eigenvalue is that of −(acoustic tensor) [pressure]."""
    return _acoustic(jax.jacfwd(lambda G: affine_stress(model, family, G))(F), model, family, at)


def local(model: AbstractModel, family: LatticeFamily, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """Strong ellipticity of the classical law ψ(F). The eigenvalue is that of −(acoustic tensor) [pressure]."""
    return _acoustic(jax.hessian(model.local_energy)(F), model, family, at)
