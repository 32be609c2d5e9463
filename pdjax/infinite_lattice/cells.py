"""The symbol of a periodic lattice whose cell holds several points: jittered, graded, period-doubled.

A cell of q points at X_i, repeated with the periods p, moves as u_i(R) = e_i e^{ik·(X_i + R)}. Then

    δη_ij = e^{ik·ξ} e_j − e_i,    δT = (∂T/∂η) δη,    (Ĵ e)_i = Σ_j V_j (δT_ij − e^{ik·ξ} δT_ji)

with δT by JVP of the very function that gives the forces of bodies, real and imaginary parts side by side; whatever
travels from point to point (far ends' states, reverse bonds) turns by its phase on the way. V Ĵ is Hermitian for models
with an energy; eigenvalues are those of V^½ Ĵ V^−½. With q = 1 it is `pdjax.symbol` (tests), at more cost.

A cell under a mean deformation F is in equilibrium only where every point sits at a centre of symmetry: `relaxed` finds
the displacements that balance it, by Newton steps from the affine ones.
"""

import itertools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from .._internal.checks import as_array, deformation_gradient, namespace, require
from .._internal.public import public_function
from ..force.fields import Exchange, check_model, force_states, point_field
from ..force.operator import force_density
from ..geometry.bonds import Bonds, Families
from ..geometry.influence import constant_influence
from ..geometry.neighbour_search import checked_horizon, in_box, pack
from ..geometry.points import Points
from ..geometry.ties import tie_radius
from ..models.base import AbstractModel
from ..tangent.jacobian import jacobian
from .criteria.outcome import margin_tolerance, verdicts


@public_function
def cell_families(body: Points, horizon: float, influence: Callable | str = constant_influence) -> Families:
    """The families of a fully periodic cell of any size: a neighbour and its images are different bonds.

    Arguments: body with a finite period along every axis (`cloud(…, period=…)`, `lattice(…, periodic=True)`); horizon δ
        [length]; influence.  Raises: ValueError for a cell that is not periodic, coinciding points, lonely points.
    """
    from scipy.spatial import cKDTree

    if body.period is None or not np.isfinite(body.period).all():
        raise ValueError(f"a cell must be periodic along every axis; got period {body.period}")
    horizon = checked_horizon(horizon)
    period, radius = np.array(body.period), tie_radius(body, horizon)
    X, _ = in_box(body)
    images = np.array(list(itertools.product(*[range(-n, n + 1) for n in np.ceil(radius / period).astype(int)])))
    everywhere = (X[None] + (images * period)[:, None]).reshape(-1, body.dim)
    near = cKDTree(everywhere).query_ball_point(X, radius)
    i = np.repeat(np.arange(len(X)), [len(n) for n in near])
    found = np.concatenate(near).astype(int)
    j, image = found % len(X), images[found // len(X)]
    own = (i == j) & (image == 0).all(axis=1)
    i, j, image = i[~own], j[~own], image[~own]
    vectors = X[j] + image * period - X[i]
    if len(vectors) and np.linalg.norm(vectors, axis=1).min() < 1e-9 * horizon:
        k = int(np.argmin(np.linalg.norm(vectors, axis=1)))
        raise ValueError(f"positions must be distinct; points {i[k]} and {j[k]} coincide")
    forward, backward = np.lexsort((*image.T, j, i)), np.lexsort((*-image.T, i, j))
    opposite = np.empty(len(i), dtype=int)
    opposite[forward] = backward
    return pack(body, float(horizon), influence, (i, j, vectors, opposite))


def _turning(families: Families, phase: Complex[Array, "points bonds"]) -> Exchange:
    """Exchange of the points' real parts, then imaginary parts: what differs from the base state turns by e^{ik·ξ}."""

    def turn(x, index):
        base = jax.lax.stop_gradient(x)
        half = x.shape[0] // 2
        wave = jax.lax.complex((x - base)[:half], (x - base)[half:])[index]
        wave = wave * phase.reshape(phase.shape + (1,) * (wave.ndim - 2))
        both = jnp.concatenate([base[:half][index], base[half:][index]])
        return both + jnp.concatenate([wave.real, wave.imag])

    near, back = (families.neighbours,), (families.neighbours, families.reverse)
    return Exchange(lambda x: turn(x, near), lambda x: turn(x, back))


def _twice(tree, points: int):
    """Every leaf once for the real and once for the imaginary part, for each point: what is shared is repeated too, so
    that no length of a shared array can be taken for a number of points."""

    def twice(x):
        if not eqx.is_array(x):
            return x
        if x.ndim and x.shape[0] == points:
            return jnp.concatenate([x, x])
        return jnp.broadcast_to(x, (2 * points, *x.shape))

    return jax.tree.map(twice, tree)


def _symbol_at(model: AbstractModel, families: Families, bonds: Bonds, k: Array) -> Complex[Array, "dof dof"]:
    points, dim = len(families), families.dim
    phase = jnp.exp(1j * (families.xi @ k)).astype(jnp.result_type(bonds.eta, jnp.complex64))
    model, bonds, volumes = (_twice(x, points) for x in (model, bonds, families.volumes))
    exchange = _turning(families, phase)

    def force(eta):
        T = force_states(model, volumes, bonds._replace(eta=eta), exchange)
        return jnp.einsum("pb,pbi->pi", bonds.volume, T - exchange.back(T))

    def column(e):
        moved = phase[..., None] * e[families.neighbours] - e[:, None, :]
        moved = jnp.where(families.weight[..., None] > 0, moved, 0.0)  # padding: a point and itself
        f = jax.jvp(force, (bonds.eta,), (jnp.concatenate([moved.real, moved.imag]),))[1]
        return jax.lax.complex(f[:points], f[points:]).reshape(-1)

    basis = jnp.eye(points * dim, dtype=bonds.eta.dtype).reshape(-1, points, dim)
    J = jax.vmap(column)(basis).T
    root = jnp.sqrt(jnp.repeat(families.volumes, dim))
    return J * (root[:, None] / root[None, :])


@eqx.filter_jit
def _symbols(model, families, bonds, k):
    return jax.lax.map(lambda one: _symbol_at(model, families, bonds, one), k)


def _bonds(model: AbstractModel, families: Families, F, u) -> Bonds:
    check_model(model, families, Families)
    F = deformation_gradient(F, families.dim)
    return families.bonds(
        np.zeros((len(families), families.dim), families.dtype) if u is None else point_field(u, families), F
    )


@public_function
def cell_symbol(model: AbstractModel, families: Families, F, k, u=None) -> Complex[Array, "waves dof dof"]:
    """V^½ Ĵ(k) V^−½ of a cell on plane waves e^{ik·X}: its eigenvalues are those of the infinite lattice's Jacobian.

    Arguments: families from `cell_families`; F (dim, dim) [-], det F > 0; k (waves, dim) [1/length]; u (points, dim)
        [length], periodic, on top of F.
    Returns: (waves, points·dim, points·dim) [force/length^(dim+1)], Hermitian for a model with an energy.
    Raises: ValueError as `force_density`.
    """
    k = as_array(k, families.dtype)
    if k.ndim != 2 or k.shape[1] != families.dim:
        raise ValueError(f"k must have shape (waves, {families.dim}) for this cell; got {k.shape}")
    return _symbols(
        model, families, _bonds(model, families, F, u), require(k, namespace(k).isfinite(k), "k must be finite")
    )


@public_function
def relaxed(model: AbstractModel, families: Families, F, tolerance: float = 1e-12, steps: int = 30) -> Array:
    """The periodic displacement u (points, dim) [length], first point held, that balances a cell under F.

    Raises: ValueError where Newton's steps do not settle to `tolerance` times the forces of the first step.
    """
    F = deformation_gradient(F, families.dim)
    u = np.zeros((len(families), families.dim))
    if len(families) == 1:
        return as_array(u)
    free = slice(families.dim, None)

    def linearised(u):
        f = np.asarray(force_density(model, families, u, F)).reshape(-1)
        return f, np.asarray(jacobian(model, families, u, "dense", F))

    f, J = linearised(u)
    scale, stiff = np.abs(f).max(), np.abs(J).max() * float(families.horizon)
    rounding = (
        64 * float(jnp.finfo(families.xi.dtype).eps) * stiff * float(np.abs(np.asarray(F) - np.eye(families.dim)).max())
    )
    for _ in range(steps):
        if np.abs(f[free]).max() <= max(tolerance * scale, rounding):
            return as_array(u)
        move = np.linalg.lstsq(J[free, free], f[free], rcond=1e-12)[0]
        u = u - np.concatenate([np.zeros(families.dim), move]).reshape(u.shape)
        f, J = linearised(u)
    left = np.abs(f[free]).max()
    raise ValueError(f"the cell was not balanced in {steps} Newton steps: forces {left:.1e} of {scale:.1e}")


class CellStability(eqx.Module):
    """The answer of `cell_stability`.

    eigenvalue: the largest found (translations apart) [force/length^(dim+1)] and its wave_vector (dim,) [1/length];
    margin: the largest λ/(M κ²) over the grid, κ² that of the cell's own lattice ((2π/p)² for k = 0): positive
    unstable, zero to `tolerance` marginal.
    """

    eigenvalue: float
    wave_vector: np.ndarray
    margin: float
    tolerance: float

    @property
    def verdict(self) -> str:
        """ "stable", "marginal" or "unstable", by the margin; "undefined" where it is NaN."""
        return str(verdicts(self.margin, self.tolerance))


@public_function
def cell_stability(
    model: AbstractModel, families: Families, period, F, modulus: float, u=None, intervals: int = 8
) -> CellStability:
    """Is the infinite lattice made of this cell stable under F? By a grid of its zone, half-reciprocal points included.

    Arguments: as `cell_symbol`; period (dim,) [length]; modulus M [pressure] that the margin is divided by, such as
        `p_wave_modulus`; intervals from 0 to π/p. A grid, not a search: a narrow unstable window can be missed.
    Raises: ValueError for a model without an energy, a modulus or period not > 0, intervals below 1.
    """
    if not (np.isfinite(modulus) and modulus > 0):
        raise ValueError(f"modulus must be finite and > 0; got {modulus}")
    if not (isinstance(intervals, int) and intervals >= 1):
        raise ValueError(f"intervals must be a whole number >= 1; got {intervals!r}")
    if not model.hyperelastic:
        raise ValueError(f"{type(model).__name__} has no energy: its symbol need not be Hermitian; see cell_symbol")
    period = np.asarray(period, dtype=float)
    if period.shape != (families.dim,) or not (np.isfinite(period) & (period > 0)).all():
        raise ValueError(f"period must hold {families.dim} finite lengths > 0; got {period}")
    steps = [np.arange(0 if axis == 0 else -intervals + 1, intervals + 1) for axis in range(families.dim)]
    index = np.stack([g.reshape(-1) for g in np.meshgrid(*steps, indexing="ij")], axis=1)
    k = np.pi * index / intervals / period
    J = np.array(cell_symbol(model, families, F, k, u))  # a copy: translations are moved in it
    kappa2 = np.sum((2 / period * np.sin(k * period / 2)) ** 2, axis=1)
    at_origin = (index == 0).all(axis=1)
    kappa2[at_origin] = np.sum((2 * np.pi / period) ** 2)
    root = np.sqrt(np.asarray(families.volumes))
    shift = np.kron(root[:, None] / np.linalg.norm(root), np.eye(families.dim))
    size = np.abs(J).max()
    J[at_origin] -= 10 * size * (shift @ shift.T)  # translations of the whole, at k = 0 alone, out of the way
    top = np.linalg.eigvalsh((J + J.conj().transpose(0, 2, 1)) / 2)[:, -1]
    margins = top / (modulus * kappa2)
    best = int(np.argmax(margins))
    where = int(np.argmax(top)) if margins[best] > 0 else best
    unit = float(margin_tolerance(families.xi.dtype)) * max(1.0, len(families) * size / (modulus * kappa2.min()) * 1e-3)
    return CellStability(float(top[where]), k[where], float(margins[best]), unit)
