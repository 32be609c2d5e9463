"""Scenes: functions of numbers that return a boundary value problem with its closed form. No files, no pictures.

`singular_bar`, `step_size_bar` are the paper's; `clamped_plate` is their sister in 2D and 3D; `manufactured_plate`
has a smooth solution known beforehand. Layers that hold or load a body are two horizons deep where the homogeneous
state has to stay exact: a free point feels two rings of neighbours.
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


def _unit_model(model: AbstractModel | None) -> AbstractModel:
    """The paper's model of order m = 1 and modulus 1 unless another is given."""
    return SethHill(1.0, LinearElastic(1.0, 0.0)) if model is None else model  # type: ignore[call-arg, arg-type]


def _count(name: str, value, least: int) -> int:
    if not float(value).is_integer() or value < least:
        raise ValueError(f"{name} must be a whole number >= {least}; got {value!r}")
    return int(value)


def _ratio(N) -> float:
    if not (math.isfinite(N) and N >= 1):
        raise ValueError(f"N = horizon / spacing must be finite and >= 1; got {N!r}")
    return float(N)


def _on_rim(shape: tuple[int, ...], rim: int) -> np.ndarray:
    """Which cells (cells,) of a lattice lie within `rim` of its border."""
    cell = np.indices(shape).reshape(len(shape), -1)
    return np.any((cell < rim) | (cell >= np.array(shape)[:, None] - rim), axis=0)


def step_size_bar(n: int, N: float = 3, strain=-1e-3, clamp: int = 6, model: AbstractModel | None = None) -> Scene:
    """The bar of the paper's step-size experiment: ends prescribed at once, the rest starts at u = 0.

    n points at spacing 1/n, centred on 0; `clamp` points at each end are held at u = strain · X. Its closed form is
    the homogeneous u = strain · X, an exact equilibrium while clamp ≥ 2N.
    Arguments: n points; N = horizon/spacing; strain [-] > −1; clamp points; model of unit modulus by default.
    Raises: ValueError for a strain ≤ −100 %, or clamps that leave nothing free. Source: section 5.2.
    """
    clamp, N = _count("clamp", clamp, 1), _ratio(N)
    n = _count("n", n, 2 * clamp + 1)
    if is_concrete(strain) and not (math.isfinite(float(strain)) and strain > -1):
        raise ValueError(f"strain must be finite and > -1 (a bar can't lose all its length); got {strain!r}")
    x = ((np.arange(n) + 0.5) / n - 0.5)[:, None]
    body = Points(x, np.full(n, 1.0 / n), 1.0 / n, (n,))
    u = on_host(as_real(strain)) * x
    ends = np.r_[0:clamp, n - clamp : n]
    held = conditions.prescribe(ends, u[ends])
    return scene(body, families(body, N / n), _unit_model(model), held, closed_form=u, name="step-size bar")


def singular_bar(
    n: int,
    N: float = 3,
    stress=1e-3,
    alpha: float = 10.0,
    model: AbstractModel | None = None,
    traction: str = "exact",
) -> Scene:
    """The bar of unit length whose modulus drops to zero just beyond its middle, pulled by a stress.

    E(x) = E₀ for x ≤ ½, E₀ (1 + α/(2√(x − ½)))⁻¹ beyond, E₀ the model's. The 2N points at x = 0 are held at the local
    solution, the 2N points at x = 1 carry the stress. Its closed form is the nonlinear local solution.
    Arguments: n points, even (½ lies between two of them); N; stress σ [pressure]; alpha α ≥ 0 [-]; model by default
        of order 1 and E₀ = 1; traction "exact" (a homogeneous state stays exact) or "even" (σ spread evenly).
    Raises: ValueError for an odd n, layers that meet, a stress that the local law can't carry at x = 1.
    Source: Breitenfeld et al. 2014; section 5.1.
    """
    N = _ratio(N)
    layer = 2 * math.ceil(N)
    n = _count("n", n, 2 * layer + 2)
    if n % 2:
        raise ValueError(f"n must be even, so that no point sits on the singularity at 1/2; got {n}")
    if not alpha >= 0:
        raise ValueError(f"alpha must be >= 0; got {alpha!r}")
    if traction not in ("exact", "even"):
        raise ValueError(f"traction must be 'exact' or 'even'; got {traction!r}")
    base = _unit_model(model)
    body = lattice((n,), 1.0 / n)
    x = body.positions[:, 0]
    beyond = np.maximum(x - 0.5, 0)
    softness = 1 + np.where(beyond > 0, alpha / (2 * np.sqrt(np.where(beyond > 0, beyond, 1))), 0)
    at_end = 1 + alpha / (2 * math.sqrt(0.5))
    # the end x = 1 is one more place of the local solution, so that one program finds both
    u, strain = on_host(singular_bar_local(base, np.append(x, 1.0), 1.0, as_array(stress), as_array(alpha)))
    u, end_strain = u[:-1], strain[-1]
    if is_concrete(end_strain) and not np.isfinite(end_strain):
        raise ValueError(
            f"stress {stress} has no local equilibrium at the loaded end: beyond the law's limit point"
            " (or a strain above 100)"
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
    """A lattice of `shape` cells, 1D to 3D, whose rim of 2N points is held at u = (F − I) X: homogeneous within.

    (3N points for a model whose forces reach three rings of neighbours.)

    Arguments: shape cells along each axis; N; F (dim, dim) [-]; model; spacing [length], 1/shape[0] by default.
    Raises: ValueError for det F ≤ 0 or a shape without interior.
    """
    N, shape = _ratio(N), tuple(int(s) for s in shape)
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
    """u* (points, 2) at X and the body force b (points, 2) that `manufactured_plate` describes."""

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
    """A unit square under the body force for which the local theory has a smooth solution known beforehand.

    u* = stretch X + amplitude (sin 2πX sin πY, cos πX sin 2πY),   b = −Div P(I + ∇u*),  P = ∂ψ/∂F,

    with the rim of 2N points held at u*, its closed form. The body differs from it by the nonlocal model's own error,
    of the order of horizon², and by the lattice's. A stretched state keeps order m = 1 stable.
    Arguments: n points along a side; N = horizon/spacing, or give `horizon` [length] instead and N is ignored; model
        with a classical law (order 1, λ = μ = 1 by default); stretch, amplitude [-].
    Raises: ValueError for a plate without interior. Source: ours.
    """
    N = _ratio(N) if horizon is None else _ratio(horizon * n)
    rim = 2 * math.ceil(N * (1 - 1e-9))
    n = _count("n", n, 2 * rim + 1)
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
