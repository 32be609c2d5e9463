"""Tests by waves: the symbol over the whole Brillouin zone, and acoustic tensors.

    symbol   sup over k, the limit k → 0 included, of λ_max(Ĵ(k)) / (M κ²): exact and decisive on an infinite lattice
    affine   −min over N of the acoustic tensor N·∂²W(F)·N of the energy of affine maps, over M: the limit k → 0
    local    the same of the classical law at this F; differs from affine for Seth–Hill unless m = 1

The maximiser is searched with derivatives stopped (`pdjax.zone`); the margin is then the quotient at that wave
vector and mode, so its derivative in any parameter is vᵀ(∂Ĵ)v: the envelope theorem. A model without an energy is
judged by the growth of its modes instead (`flutter`).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..bloch import Phases, Tangent, homogeneous_tangent, long_wave_phases, p_wave_modulus, wave_phases
from ..force import affine_stress
from ..models.base import AbstractModel
from ..neighbours import Family
from ..zone import Zone, class_starts, directions, largest_eigenvalue, nudge, refine, top_pair
from . import flutter
from .outcome import Outcome, margin_tolerance


def _pick(condition, if_true: Phases, if_false: Phases) -> Phases:
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), if_true, if_false)


def _frozen_angles(phases: Phases) -> Phases:
    """The angles k·ξ are fixed numbers; only κ² [1/length²] still knows the spacing."""
    c, s, even = jax.lax.stop_gradient(phases[:3])
    return Phases(c, s, even, phases.kappa2)


def _phases_at(fam: Family, x: Array, is_long: Array) -> Phases:
    """Phases of the wave vector x/h, or of the limit k → 0 along x."""
    return _pick(is_long, long_wave_phases(fam, x), wave_phases(fam, x / fam.spacing))


def _search(tangent: Tangent, M: Array, fam: Family, zone: Zone, fastest: bool):
    """(margin's (x, is_long, mode), the fastest growing (x, mode) or None, the largest |quotient| on the grid).

    All starts, of every kind, climb in one batch: a wave of every class for the margin, the best direction of the
    limit, and (`fastest`) the best wave for the largest eigenvalue itself.
    """
    h, dim = fam.spacing, fam.dim
    grid = jnp.asarray(zone.grid, dtype=h.dtype)
    table = wave_phases(fam, grid / h)
    top = largest_eigenvalue(tangent.components(table))
    screen = top / (M * table.kappa2)
    compass = jnp.asarray(directions(dim), dtype=h.dtype)
    long_screen = largest_eigenvalue(tangent.components(long_wave_phases(fam, compass)))

    waves = class_starts(zone, screen)
    groups = [waves, compass[jnp.argmax(long_screen)][None]] + ([grid[jnp.argmax(top)][None]] if fastest else [])
    sizes = [len(g) for g in groups]
    starts = jnp.concatenate(groups)
    kind = jnp.repeat(jnp.arange(len(groups)), jnp.array(sizes), total_repeat_length=sum(sizes))

    def matrix(x, kind):
        phases = _phases_at(fam, x, kind == 1)
        J = tangent(phases)
        return (J + J.T) / 2 / jnp.where(kind == 2, M / h**2, M * phases.kappa2)

    move = jnp.asarray(nudge(dim, zone.step), dtype=h.dtype)
    climbed = jax.vmap(lambda x, kind: refine(lambda y: matrix(y, kind), x + move, zone.step))(starts, kind)
    points, kinds = jnp.concatenate([starts, climbed]), jnp.concatenate([kind, kind])
    values, modes = jax.vmap(lambda x, kind: top_pair(matrix(x, kind)))(points, kinds)
    values = jnp.where(jnp.isnan(values), -jnp.inf, values)
    i = jnp.argmax(jnp.where(kinds < 2, values, -jnp.inf))
    j = jnp.argmax(jnp.where(kinds == 2, values, -jnp.inf))
    scale = jnp.max(jnp.abs(screen))
    return (points[i], kinds[i] == 1, modes[i]), (points[j], modes[j]) if fastest else None, scale


def symbol(
    model: AbstractModel, fam: Family, F: Float[Array, "dim dim"], zone: Zone, at=None, fastest: bool = True
) -> Outcome:
    """The exact test: see the module. `fastest`: also find the largest eigenvalue, which unstable states report."""
    tangent = homogeneous_tangent(model, fam, F)
    M = p_wave_modulus(model, fam)
    if not model.hyperelastic:
        return _by_growth(tangent, M, fam, zone, at)
    fast, scale = None, jnp.ones((), M.dtype)
    if at is None:
        at, fast, scale = _search(*jax.lax.stop_gradient((tangent, M, fam)), zone, fastest)
    x, is_long, mode = at = jax.lax.stop_gradient(at)
    phases = _frozen_angles(_phases_at(fam, x, is_long))
    work = mode @ tangent(phases) @ mode
    margin = work / (M * phases.kappa2)

    eigenvalue, k = jnp.where(is_long, 0 * work, work), jnp.where(is_long, 0 * x, x)
    if fast is not None:
        y, shape = jax.lax.stop_gradient(fast)
        unstable = jax.lax.stop_gradient(margin) > margin_tolerance(M.dtype, scale)
        growth = shape @ tangent(_frozen_angles(wave_phases(fam, y / fam.spacing))) @ shape
        eigenvalue, k = jnp.where(unstable, growth, eigenvalue), jnp.where(unstable, y, k)
        x, mode = jnp.where(unstable, y, x), jnp.where(unstable, shape, mode)
    k = k - 2 * jnp.pi * jnp.round(k / (2 * jnp.pi))  # climbs may end in the next zone: the same wave
    return Outcome(margin, eigenvalue, mode, k / fam.spacing, x / jnp.linalg.norm(x), scale, at)


def _by_growth(tangent: Tangent, M: Array, fam: Family, zone: Zone, at) -> Outcome:
    scale, fast = jnp.ones((), M.dtype), None
    if at is None:
        at, fast, scale = flutter.search(*jax.lax.stop_gradient((tangent, M, fam)), zone)
    x, is_long, right, left = at = jax.lax.stop_gradient(at)
    phases = _frozen_angles(_phases_at(fam, x, is_long))
    square = flutter.quotient(tangent, phases, right, left)
    eigenvalue, k = jnp.where(is_long, 0 * square, square), jnp.where(is_long, 0 * x, x)
    mode, margin = right.real / jnp.linalg.norm(right.real), square / (M * phases.kappa2)
    if fast is not None:
        y, right, left = jax.lax.stop_gradient(fast)
        growth = flutter.quotient(tangent, _frozen_angles(wave_phases(fam, y / fam.spacing)), right, left)
        unstable = jax.lax.stop_gradient(margin) > margin_tolerance(M.dtype, scale)
        eigenvalue, k, x = (jnp.where(unstable, a, b) for a, b in ((growth, eigenvalue), (y, k), (y, x)))
        mode = jnp.where(unstable, right.real / jnp.linalg.norm(right.real), mode)
    return Outcome(margin, eigenvalue, mode, k / fam.spacing, x / jnp.linalg.norm(x), scale, at)


def _acoustic(fourth: Float[Array, "dim dim dim dim"], model, fam, at) -> Outcome:
    M = p_wave_modulus(model, fam)

    def matrix(A, N):
        return -jnp.einsum("iJkL,J,L->ik", A, N, N) / jnp.sum(N**2)

    if at is None:
        frozen = jax.lax.stop_gradient(fourth / M)
        compass = jnp.asarray(directions(fam.dim), dtype=fam.xi.dtype)
        screen = jax.vmap(lambda N: top_pair(matrix(frozen, N))[0])(compass)
        start = compass[jnp.argmax(screen)]
        move = jnp.asarray(nudge(fam.dim, 0.05), dtype=fam.xi.dtype)
        points = jnp.stack([start, refine(lambda N: matrix(frozen, N), start + move, 0.1)])
        values, modes = jax.vmap(lambda N: top_pair(matrix(frozen, N)))(points)
        best = jnp.argmax(values)
        at = points[best] / jnp.linalg.norm(points[best]), modes[best]
    direction, mode = at = jax.lax.stop_gradient(at)
    value = mode @ matrix(fourth, direction) @ mode
    return Outcome(value / M, value, mode, 0 * direction, direction, at=at)


def affine(model: AbstractModel, fam: Family, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """Strong ellipticity of the energy of affine maps W(F); the eigenvalue is −(acoustic tensor) [pressure]."""
    return _acoustic(jax.jacfwd(lambda G: affine_stress(model, fam, G))(F), model, fam, at)


def local(model: AbstractModel, fam: Family, F: Float[Array, "dim dim"], at=None) -> Outcome:
    """Strong ellipticity of the classical law ψ(F); the eigenvalue is −(acoustic tensor) [pressure]."""
    return _acoustic(jax.hessian(model.local_energy)(F), model, fam, at)
