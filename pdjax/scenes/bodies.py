"""Static scenes: functions of numbers that return a boundary value problem with its closed form.

`singular_bar` and `step_size_bar` are problems of the paper (Behzadinasab & Foster). `clamped_plate` is a homogeneous
problem in 1D to 3D, like `step_size_bar`. `manufactured_plate` has a smooth solution that is known beforehand.

The layers that hold or load a body are two horizons deep where the homogeneous state has to be an exact equilibrium.
The force on a free point depends on its neighbours and on the neighbours of these.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_array, as_real, deformation_gradient, is_concrete, on_host
from ..finite_body import conditions
from ..finite_body.scene import Scene, scene
from ..geometry.neighbour_search import families
from ..geometry.points import Points, lattice
from ..models import SethHill, graded
from ..models.base import AbstractModel
from ..models.laws import LinearElastic
from ..studies.closed_forms.local_bar import singular_bar_local


def unit_model(model: AbstractModel | None) -> AbstractModel:
    """The given model, or by default the Seth–Hill model of the paper with order m = 1 and modulus 1."""
    return SethHill(1.0, LinearElastic(1.0, 0.0)) if model is None else model  # type: ignore[call-arg, arg-type]


def checked_count(name: str, value, least: int) -> int:
    if not float(value).is_integer() or value < least:
        raise ValueError(f"{name} must be a whole number >= {least}; got {value!r}")
    return int(value)


def checked_ratio(N) -> float:
    if not (math.isfinite(N) and N >= 1):
        raise ValueError(f"N = horizon / spacing must be finite and >= 1; got {N!r}")
    return float(N)


def _on_rim(shape: tuple[int, ...], rim: int) -> np.ndarray:
    """Mask (cells,) of the cells of a lattice that lie within `rim` cells of its border."""
    cell = np.indices(shape).reshape(len(shape), -1)
    return np.any((cell < rim) | (cell >= np.array(shape)[:, None] - rim), axis=0)


def step_size_bar(n: int, N: float = 3, strain=-1e-3, clamp: int = 6, model: AbstractModel | None = None) -> Scene:
    """Make the bar of the paper's step-size experiment, whose ends are displaced in one step.

    The bar has n points at spacing 1/n and its centre at X = 0. At each end `clamp` points are held at u = strain · X.
    A solver starts from u = 0 at all other points. The closed form is the homogeneous u = strain · X. It is an exact
    equilibrium if clamp ≥ 2N.

    Parameters
    ----------
    n : int
        Number of points.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    strain : float, optional
        Strain [-] of the bar, > −1. Default −0.001.
    clamp : int, optional
        Number of held points at each end. Default 6.
    model : AbstractModel, optional
        The material model. Default: `SethHill` of order 1 with unit modulus.

    Returns
    -------
    Scene
        The problem, with its closed form.

    Raises
    ------
    ValueError
        If the strain is not above −1, or if no point is free.

    References
    ----------
    Behzadinasab & Foster, section 5.2

    Examples
    --------
    >>> scene = pd.scenes.step_size_bar(21, strain=-0.001)
    >>> len(scene.unknowns), round(float(scene.closed_form[0, 0]), 6)
    (9, 0.000476)
    """
    clamp, N = checked_count("clamp", clamp, 1), checked_ratio(N)
    n = checked_count("n", n, 2 * clamp + 1)
    if is_concrete(strain) and not (math.isfinite(float(strain)) and strain > -1):
        raise ValueError(f"strain must be finite and > -1 (a bar can't lose all its length); got {strain!r}")
    x = ((np.arange(n) + 0.5) / n - 0.5)[:, None]
    body = Points(x, np.full(n, 1.0 / n), 1.0 / n, (n,))
    u = on_host(as_real(strain)) * x
    ends = np.r_[0:clamp, n - clamp : n]
    held = conditions.prescribe(ends, u[ends])
    return scene(body, families(body, N / n), unit_model(model), held, closed_form=u, name="step-size bar")


def singular_bar(
    n: int,
    N: float = 3,
    stress=1e-3,
    alpha: float = 10.0,
    model: AbstractModel | None = None,
    traction: str = "exact",
) -> Scene:
    """Make the bar of unit length whose modulus drops to zero just beyond its middle, under a stress.

    E(x) = E₀ for x ≤ ½,     E(x) = E₀ (1 + α/(2√(x − ½)))⁻¹ for x > ½

    E₀ is the modulus of the model. The 2N points at x = 0 are held at the local solution, and the 2N points at x = 1
    carry the stress. The closed form is the solution of the nonlinear local theory.

    Parameters
    ----------
    n : int
        Number of points, even, so that x = ½ lies between two of them.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    stress : float, optional
        Stress σ [pressure], positive in tension. Default 0.001.
    alpha : float, optional
        Strength α ≥ 0 [-] of the singularity. Default 10. With 0 the bar is homogeneous.
    model : AbstractModel, optional
        The material model. Default: `SethHill` of order 1 with E₀ = 1.
    traction : str, optional
        "exact" (the default, see `homogeneous_traction`) or "even" (the force σ is spread evenly, see `total_force`).

    Returns
    -------
    Scene
        The problem, with its closed form.

    Raises
    ------
    ValueError
        If n is odd, if the two layers leave too few points free, or if the local law cannot carry the stress at x = 1.

    References
    ----------
    Breitenfeld et al. 2014; Behzadinasab & Foster, section 5.1

    Examples
    --------
    With α = 0 the bar is homogeneous. The stress P = 1.1 · ½ (1.1² − 1) = 0.1155 gives a strain of 0.1:

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 0.0))
    >>> scene = pd.scenes.singular_bar(20, N=1, stress=0.1155, alpha=0.0, model=model)
    >>> round(float(scene.body.positions[-1, 0]), 4), round(float(scene.closed_form[-1, 0]), 6)
    (0.975, 0.0975)
    """
    N = checked_ratio(N)
    layer = 2 * math.ceil(N)
    n = checked_count("n", n, 2 * layer + 2)
    if n % 2:
        raise ValueError(f"n must be even, so that no point sits on the singularity at 1/2; got {n}")
    if not alpha >= 0:
        raise ValueError(f"alpha must be >= 0; got {alpha!r}")
    if traction not in ("exact", "even"):
        raise ValueError(f"traction must be 'exact' or 'even'; got {traction!r}")
    base = unit_model(model)
    body = lattice((n,), 1.0 / n)
    x = body.positions[:, 0]
    beyond = np.maximum(x - 0.5, 0)
    softness = 1 + np.where(beyond > 0, alpha / (2 * np.sqrt(np.where(beyond > 0, beyond, 1))), 0)
    at_end = 1 + alpha / (2 * math.sqrt(0.5))
    # The end x = 1 is appended to the points, so that one program finds both local solutions.
    u, strain = on_host(singular_bar_local(base, np.append(x, 1.0), 1.0, as_array(stress), as_array(alpha)))
    u, end_strain = u[:-1], strain[-1]
    if is_concrete(end_strain) and not np.isfinite(end_strain):
        raise ValueError(
            f"stress {stress} has no local equilibrium at the loaded end: it lies beyond the limit point of the law, or"
            " its strain exceeds 100; take a smaller stress or a smaller alpha"
        )
    held, loaded = np.arange(layer), np.arange(n - layer, n)
    pull: conditions.Condition
    if traction == "exact":
        pull = conditions.homogeneous_traction(loaded, 1 + end_strain.reshape(1, 1), graded(base, 1 / at_end))
    else:
        pull = conditions.total_force(loaded, on_host(as_array(stress)).reshape(1))
    return scene(
        body,
        families(body, N / n),
        graded(base, 1 / softness),
        conditions.prescribe(held, u[held, None]),
        pull,
        closed_form=u[:, None],
        name="singular bar",
    )


def clamped_plate(shape, N: float, F, model: AbstractModel, spacing: float | None = None) -> Scene:
    """Make a lattice in 1D to 3D whose rim is held at a homogeneous deformation, u = (F − I) X.

    The rim is 2N points wide, or 3N for a model whose forces reach three rings of neighbours. The origin of X is the
    centre of the lattice. The closed form u = (F − I) X is an exact equilibrium.

    Parameters
    ----------
    shape : tuple of int
        Number of points along each axis.
    N : float
        Horizon over spacing [-].
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.
    model : AbstractModel
        The material model.
    spacing : float, optional
        Spacing [length] of the lattice. Default 1/shape[0].

    Returns
    -------
    Scene
        The problem, with its closed form.

    Raises
    ------
    ValueError
        If det F ≤ 0, or if the rim leaves no point free.

    Examples
    --------
    A rim of 4 points leaves 1 × 2 free points of 9 × 10:

    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> scene = pd.scenes.clamped_plate((9, 10), 2, np.diag([1.1, 1.0]), model)
    >>> len(scene.unknowns)
    4
    """
    N, shape = checked_ratio(N), tuple(int(s) for s in shape)
    rings = max(2, model.rings)
    rim = rings * math.ceil(N)
    if min(shape) <= 2 * rim:
        raise ValueError(f"every side must have more than {2 * rim} cells, two rims of {rings}N; got shape {shape}")
    h = 1.0 / shape[0] if spacing is None else float(spacing)
    body = lattice(shape, h)
    F = deformation_gradient(F, body.dim)
    X = body.positions - 0.5 * h * np.array(shape)
    u = X @ (on_host(F) - np.eye(body.dim)).T
    held = np.flatnonzero(_on_rim(shape, rim))
    return scene(
        body,
        families(body, N * h),
        model,
        conditions.prescribe(held, u[held]),
        closed_form=u,
        name="clamped plate",
    )


@eqx.filter_jit
def _manufactured(model: AbstractModel, X: Float[Array, "points 2"], stretch: Array, amplitude: Array):
    """u* (points, 2) at X and the body force b (points, 2) of `manufactured_plate`."""

    def wanted(X):
        x, y = X
        wave = jnp.stack([jnp.sin(2 * jnp.pi * x) * jnp.sin(jnp.pi * y), jnp.cos(jnp.pi * x) * jnp.sin(2 * jnp.pi * y)])
        return stretch * X + amplitude * wave

    def piola(X):
        return jax.grad(model.local_energy)(jnp.eye(2, dtype=X.dtype) + jax.jacfwd(wanted)(X))

    def force(X):
        return -jnp.einsum("ijj->i", jax.jacfwd(piola)(X))

    return jax.vmap(wanted)(X), jax.lax.map(force, X, batch_size=256)


def manufactured_plate(
    n: int, N: float, horizon: float | None = None, model: AbstractModel | None = None, stretch=0.05, amplitude=2e-3
) -> Scene:
    """Make a unit square under a body force for which the local theory has a known smooth solution.

    u* = stretch X + amplitude (sin 2πX sin πY, cos πX sin 2πY),   b = −Div P(I + ∇u*),  P = ∂ψ/∂F

    The rim of 2N points is held at u*, which is the closed form. The solution of the scene differs from u* by the error
    of the nonlocal model, of the order of horizon², and by the error of the lattice. The stretch keeps the model of
    order m = 1 stable.

    Parameters
    ----------
    n : int
        Number of points along a side.
    N : float
        Horizon over spacing [-]. Ignored if `horizon` is given.
    horizon : float, optional
        Horizon [length], instead of N.
    model : AbstractModel, optional
        A model with a classical law. Default: `SethHill` of order 1 with λ = μ = 1.
    stretch : float, optional
        Homogeneous part [-] of u*. Default 0.05.
    amplitude : float, optional
        Amplitude [length] of the waves of u*. Default 0.002.

    Returns
    -------
    Scene
        The problem, with its closed form u*.

    Raises
    ------
    ValueError
        If the rim leaves no point free.

    Examples
    --------
    The middle of the plate is at X = Y = ½, where the waves vanish and u* = 0.05 · ½ = 0.025:

    >>> scene = pd.scenes.manufactured_plate(9, 2, model=pd.Correspondence(pd.LinearElastic(1.0, 1.0)))
    >>> middle = np.asarray(scene.closed_form[40])
    >>> print(middle.round(6), len(scene.unknowns))
    [0.025 0.025] 2
    """
    N = checked_ratio(N) if horizon is None else checked_ratio(horizon * n)
    rim = 2 * math.ceil(N * (1 - 1e-9))
    n = checked_count("n", n, 2 * rim + 1)
    if model is None:
        model = SethHill(1.0, LinearElastic(1.0, 1.0))  # type: ignore[call-arg, arg-type]
    body = lattice((n, n), 1.0 / n)
    X = as_array(body.positions)
    u, force = on_host(_manufactured(model, X, as_real(stretch), as_real(amplitude)))
    on_rim = _on_rim((n, n), rim)
    held, inside = np.flatnonzero(on_rim), np.flatnonzero(~on_rim)
    return scene(
        body,
        families(body, N / n),
        model,
        conditions.prescribe(held, u[held]),
        conditions.body_force(inside, force[inside]),
        closed_form=u,
        name="manufactured plate",
    )
