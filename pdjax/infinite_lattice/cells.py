"""The symbol of a periodic lattice whose unit cell holds several points.

Examples are jittered, graded and period-doubled lattices. A cell has q points at X_i and repeats with the periods p. A
plane wave moves the points of the cell at R by u_i(R) = e_i e^{ik·(X_i + R)}. Then

    δη_ij = e^{ik·ξ} e_j − e_i,    δT = (∂T/∂η) δη,    (Ĵ e)_i = Σ_j V_j (δT_ij − e^{ik·ξ} δT_ji)

δT is the JVP of the function that computes the forces of finite bodies. Real and imaginary parts are stored as two
copies of the cell. Quantities that one point reads from another (the state of the far end, the reverse bond) are
multiplied by the phase e^{ik·ξ} of their bond. V Ĵ is Hermitian for a model with an energy. The eigenvalues are those
of V^½ Ĵ V^−½. For q = 1 the result is `pdjax.symbol`, at a higher cost.

A cell under a mean deformation F is in equilibrium only if every point is a centre of symmetry. For other cells
`relaxed` finds the displacements that bring the cell to equilibrium, by Newton's method from the affine deformation.
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
from ..models.pointwise import is_shared
from ..tangent.jacobian import jacobian
from .bloch import squared_chord
from .criteria.outcome import margin_tolerance, verdicts


@public_function
def cell_families(body: Points, horizon: float, influence: Callable | str = constant_influence) -> Families:
    """Find the families of a periodic cell, which can be smaller than the horizon.

    A neighbour and its periodic images are different bonds, and a point can be its own neighbour.

    Parameters
    ----------
    body : Points
        The points of one cell, with a finite period along every axis: `cloud(…, period=…)` or
        `lattice(…, periodic=True)`.
    horizon : float
        Horizon δ > 0 [length].
    influence : callable or str, optional
        Influence function ω(|ξ|, δ), or its name.

    Returns
    -------
    Families
        The families of the points of the cell.

    Raises
    ------
    ValueError
        If the cell is not periodic along every axis, if two points coincide, or if a point has no neighbour.

    Examples
    --------
    A cell of two points at distance 1 with period 2, and horizon 2: each point has four bonds.

    >>> families = pd.cell_families(pd.lattice((2,), periodic=True), 2.0)
    >>> np.asarray(families.count).tolist()
    [4, 4]
    """
    from scipy.spatial import cKDTree

    if body.period is None or not np.isfinite(body.period).all():
        raise ValueError(
            f"body must be periodic along every axis to be a cell; got period {body.period}. Use"
            " cloud(…, period=…) or lattice(…, periodic=True)"
        )
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
    """How points read values of other points: the deviation from the base state is multiplied by e^{ik·ξ}.

    The first half of the points holds the real parts and the second half the imaginary parts.
    """

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
    """Repeat every array for the real and the imaginary part of each point.

    Arrays that all points share are repeated for every point too. Otherwise the length of a shared array could be
    mistaken for the number of points.
    """

    def twice(x):
        if not eqx.is_array(x):
            return x
        if x.ndim and x.shape[0] == points:
            return jnp.concatenate([x, x])
        return jnp.broadcast_to(x, (2 * points, *x.shape))

    return jax.tree.map(twice, tree)


def _twice_each_point(model: AbstractModel, points: int) -> AbstractModel:
    """`_twice` of a model. Arrays that a model declares as shared by all points stay as they are."""

    def twice(path: tuple, leaf):
        return leaf if is_shared(model, path) else _twice(leaf, points)

    return jax.tree_util.tree_map_with_path(twice, model)


def _symbol_at(model: AbstractModel, families: Families, bonds: Bonds, k: Array) -> Complex[Array, "dof dof"]:
    points, dim = len(families), families.dim
    phase = jnp.exp(1j * (families.xi @ k)).astype(jnp.result_type(bonds.eta, jnp.complex64))
    model = _twice_each_point(model, points)
    bonds, volumes = (_twice(x, points) for x in (bonds, families.volumes))
    exchange = _turning(families, phase)

    def force(eta):
        T = force_states(model, volumes, bonds._replace(eta=eta), exchange)
        return jnp.einsum("pb,pbi->pi", bonds.volume, T - exchange.back(T))

    def column(e):
        moved = phase[..., None] * e[families.neighbours] - e[:, None, :]
        moved = jnp.where(families.weight[..., None] > 0, moved, 0.0)  # A padded bond joins a point to itself.
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
    """Compute the symbol V^½ Ĵ(k) V^−½ of a lattice whose cell holds several points.

    Its eigenvalues for all k are those of the Jacobian of the infinite lattice.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the cell, from `cell_families`.
    F : array, shape (dim, dim)
        Mean deformation gradient [-], det F > 0.
    k : array, shape (waves, dim)
        Wave vectors [1/length].
    u : array, shape (points, dim), optional
        Periodic displacements [length] in addition to F, zero by default.

    Returns
    -------
    array of complex, shape (waves, points·dim, points·dim)
        The symbol [force/length^(dim+1)], Hermitian for a model with an energy.

    Raises
    ------
    ValueError
        If `k`, `F` or `u` has another shape or is not finite, if det F ≤ 0, or if the families are too small for the
        model.

    Examples
    --------
    A lattice described by a cell of two points has the symbols of k and of k + π/h.

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> cell = pd.cell_families(pd.lattice((2,), periodic=True), 1.0)
    >>> J = pd.cell_symbol(model, cell, np.eye(1), [[np.pi / 6]])
    >>> np.linalg.eigvalsh(J[0]).round(4).tolist()  # −sin²(π/6), twice
    [-0.25, -0.25]
    """
    k = as_array(k, families.dtype)
    if k.ndim != 2 or k.shape[1] != families.dim:
        raise ValueError(f"k must have shape (waves, {families.dim}) for this cell; got {k.shape}")
    return _symbols(
        model, families, _bonds(model, families, F, u), require(k, namespace(k).isfinite(k), "k must be finite")
    )


@public_function
def relaxed(model: AbstractModel, families: Families, F, tolerance: float = 1e-12, steps: int = 30) -> Array:
    """Find the periodic displacements that bring a cell under F to equilibrium.

    Newton's method starts from the affine deformation. The first point is held.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the cell, from `cell_families`.
    F : array, shape (dim, dim)
        Mean deformation gradient [-], det F > 0.
    tolerance : float, optional
        Largest remaining force, as a fraction of the largest force of the affine deformation.
    steps : int, optional
        Largest number of Newton steps.

    Returns
    -------
    array, shape (points, dim)
        Displacements u [length] in addition to F.

    Raises
    ------
    ValueError
        If the forces do not reach the tolerance within `steps` Newton steps.

    Examples
    --------
    >>> cell = pd.cell_families(pd.cloud([[0.0], [0.9]], 1.0, period=(2.0,)), 2.0)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0), pd.SillingControl(1.0))
    >>> u = pd.relaxed(model, cell, [[1.1]])
    >>> float(abs(pd.force_density(model, cell, u, [[1.1]])).max()) < 1e-12
    True
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
    raise ValueError(
        f"the cell was not balanced in {steps} Newton steps: its largest force was {scale:.1e} and is {left:.1e}."
        " Take more steps or a smaller load; an unstable cell may have no equilibrium near F"
    )


class CellStability(eqx.Module):
    """Verdict and margin of a periodic cell, the result of `cell_stability`.

    Attributes
    ----------
    eigenvalue : float
        Eigenvalue λ [force/length^(dim+1)]: the largest one of the grid if the cell is unstable, otherwise that of the
        wave of the margin. Translations of the whole lattice do not count.
    wave_vector : array, shape (dim,)
        Wave vector of `eigenvalue` [1/length].
    margin : float
        Largest λ/(M κ²) of the grid [-], with κ² = Σ_i ((2/p_i) sin(k_i p_i/2))², or Σ_i (2π/p_i)² at k = 0. It is
        positive if the cell is unstable and negative if it is stable.
    tolerance : float
        Margins between −tolerance and tolerance are zero to rounding.
    verdict : str
        The margin in words.

    Examples
    --------
    >>> cell = pd.lattice((2,), periodic=True)
    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> found = pd.cell_stability(model, pd.cell_families(cell, 1.0), cell.period, np.eye(1), 1.0, intervals=2)
    >>> found.verdict, abs(found.margin) < found.tolerance
    ('marginal', True)
    """

    eigenvalue: float
    wave_vector: np.ndarray
    margin: float
    tolerance: float

    @property
    def verdict(self) -> str:
        """ "stable", "marginal" or "unstable" by the margin, "undefined" if the margin is NaN."""
        return str(verdicts(self.margin, self.tolerance))


@public_function
def cell_stability(
    model: AbstractModel, families: Families, period, F, modulus: float, u=None, intervals: int = 8
) -> CellStability:
    """Decide whether the infinite lattice made of a cell is stable under F.

    The function evaluates `cell_symbol` on a grid of the Brillouin zone that holds the half-reciprocal points
    (components 0 or π/p). It does not search between the grid points, so that it can miss a narrow unstable range.

    Parameters
    ----------
    model : AbstractModel
        A material model that has an energy.
    families : Families
        Families of the cell, from `cell_families`.
    period : array, shape (dim,)
        Periods p of the cell [length].
    F : array, shape (dim, dim)
        Mean deformation gradient [-], det F > 0.
    modulus : float
        Modulus M > 0 [pressure] by which the margin is divided, such as `p_wave_modulus`.
    u : array, shape (points, dim), optional
        Periodic displacements [length] in addition to F, such as those of `relaxed`.
    intervals : int, optional
        Grid intervals from 0 to π/p along each axis.

    Returns
    -------
    CellStability
        Verdict, margin, eigenvalue and wave vector.

    Raises
    ------
    ValueError
        If the model has no energy, if `modulus` or `period` is not finite and > 0, if `intervals` is not a whole number
        ≥ 1, or for what `cell_symbol` refuses.

    Examples
    --------
    A zero-energy control removes the zero-energy modes of the correspondence model.

    >>> cell, law = pd.lattice((2,), periodic=True), pd.LinearElastic(1.0, 0.0)
    >>> families = pd.cell_families(cell, 1.0)
    >>> for model in (pd.Correspondence(law), pd.Correspondence(law, pd.SillingControl(1.0))):
    ...     print(pd.cell_stability(model, families, cell.period, np.eye(1), 1.0, intervals=2).verdict)
    marginal
    stable
    """
    if not (np.isfinite(modulus) and modulus > 0):
        raise ValueError(f"modulus must be finite and > 0; got {modulus}")
    if not (isinstance(intervals, int) and intervals >= 1):
        raise ValueError(f"intervals must be a whole number >= 1; got {intervals!r}")
    if not model.hyperelastic:
        raise ValueError(
            "cell_stability needs a model with an energy, whose symbol is Hermitian;"
            f" {type(model).__name__} has no energy. Use cell_symbol and the eigenvalues of its result"
        )
    period = np.asarray(period, dtype=float)
    if period.shape != (families.dim,) or not (np.isfinite(period) & (period > 0)).all():
        raise ValueError(f"period must hold {families.dim} finite lengths > 0; got {period}")
    steps = [np.arange(0 if axis == 0 else -intervals + 1, intervals + 1) for axis in range(families.dim)]
    index = np.stack([g.reshape(-1) for g in np.meshgrid(*steps, indexing="ij")], axis=1)
    k = np.pi * index / intervals / period
    J = np.array(cell_symbol(model, families, F, k, u))  # A copy, because the block at k = 0 is changed below.
    kappa2 = np.sum(squared_chord(k * period) / period**2, axis=1)
    at_origin = (index == 0).all(axis=1)
    kappa2[at_origin] = np.sum((2 * np.pi / period) ** 2)
    root = np.sqrt(np.asarray(families.volumes))
    shift = np.kron(root[:, None] / np.linalg.norm(root), np.eye(families.dim))
    size = np.abs(J).max()
    # At k = 0 the translations of the whole lattice have λ = 0. They are moved far below every other eigenvalue.
    J[at_origin] -= 10 * size * (shift @ shift.T)
    top = np.linalg.eigvalsh((J + J.conj().transpose(0, 2, 1)) / 2)[:, -1]
    margins = top / (modulus * kappa2)
    best = int(np.argmax(margins))
    where = int(np.argmax(top)) if margins[best] > 0 else best
    unit = float(margin_tolerance(families.xi.dtype)) * max(1.0, len(families) * size / (modulus * kappa2.min()) * 1e-3)
    return CellStability(float(top[where]), k[where], float(margins[best]), unit)
