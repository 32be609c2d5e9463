"""Scenes that move: the paper's cuboid, and plane waves on periodic bars and lattices, at rest or deformed."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_real, deformation_gradient, is_concrete, on_host
from ..finite_body import conditions
from ..finite_body.dynamics.system import Motion, Ramp, motion
from ..finite_body.scene import scene
from ..geometry.bonds import LatticeFamily, lattice_family
from ..geometry.neighbour_search import families
from ..geometry.points import lattice
from ..infinite_lattice.dispersion import dispersion
from ..infinite_lattice.lattice_states import p_wave_modulus
from ..infinite_lattice.paths import uniaxial_stress
from ..models.base import AbstractModel
from .bodies import _count, _ratio, _unit_model


@eqx.filter_jit
def _rate_of_uniaxial_stress(model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """dF/da at rest of the path `uniaxial_stress`."""
    at_rest = jnp.zeros((), family.xi.dtype)
    return jax.jvp(lambda a: uniaxial_stress(a, model, family), (at_rest,), (jnp.ones_like(at_rest),))[1]


def cuboid(shape, N: float = 3, strain=0.05, rate=1e-2, model: AbstractModel | None = None, density=1.0) -> Motion:
    """The paper's cuboid: a body pulled or pushed along x by its ends, at a constant rate.

    A lattice of `shape` cells, the last axis one length unit long: (32, 8, 8) is 4 × 1 × 1. Of the 2N layers at each
    end u_x = λ(t) strain (x − centre) is prescribed and the rest is free, so that uniaxial stress is a motion of all of
    it; it starts with the velocity field of that, contraction included, so that no front runs in from ends and sides.
    Arguments: shape 1 to 3 counts; N; strain [-] > −1 at the end; rate [1/time] > 0 of its magnitude; model by default
        of order 1 and unit modulus; density. Its natural duration is |strain|/rate.
    Raises: ValueError for a shape without free layers, a strain or rate that can't be. Source: section 5.3.
    """
    N, shape = _ratio(N), tuple(_count("every entry of shape", s, 1) for s in np.atleast_1d(shape))
    layers = 2 * math.ceil(N)
    if shape[0] <= 2 * layers:
        raise ValueError(f"the first side must have more than {2 * layers} cells, two ends of 2N; got shape {shape}")
    if not (is_concrete(strain) and math.isfinite(strain) and strain > -1 and strain != 0):
        raise ValueError(f"strain must be a finite number > -1 and not 0; got {strain!r}")
    if not (is_concrete(rate) and math.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be a finite number > 0 [1/time]; got {rate!r}")
    h = 1.0 / shape[-1]
    body = lattice(shape, h)
    x = body.positions[:, 0] - 0.5 * h * shape[0]
    ends = np.flatnonzero(np.abs(x) > 0.5 * h * (shape[0] - 2 * layers))
    held = conditions.prescribe(ends, strain * x[ends, None], components=0)
    fixed = scene(body, families(body, N * h), _unit_model(model), held, moving=True, name="cuboid")
    duration = abs(strain) / rate
    family = lattice_family(body.dim, N, h)
    pull = on_host(_rate_of_uniaxial_stress(fixed.model, family))
    centre = 0.5 * h * np.array(shape)
    velocity = math.copysign(rate, strain) * (body.positions - centre) @ pull.T
    return motion(fixed, density, schedule=Ramp(duration), velocity=velocity, duration=duration)  # type: ignore


def wave(
    n,
    N: float = 3,
    k=None,
    u0=1e-6,
    model: AbstractModel | None = None,
    dim: int = 1,
    *,
    F=None,
    branch: int = -1,
    travelling: bool = False,
    density=1.0,
    periods: float = 4.0,
) -> Motion:
    """A plane wave on a periodic lattice of spacing 1, on top of a homogeneous deformation.

    u = u0 e cos(k·(X − X₀)) at t = 0, a crest on the first point X₀, at rest (a standing wave) or moving along k; e the
    polarisation of one branch of the symbol. The scene's closed form is that start.
    Arguments: n points along each side, or a shape; N; k (dim,), or its first component [1/length]: it must fit the
        box, k_i = 2π j/n_i (default: the longest wave along x); u0 [length]; model by default of order 1 and unit
        modulus; dim; F (dim, dim) mean deformation; branch −1 the fastest, 0 the slowest; travelling; density; periods:
        the natural duration is that many periods; of a classical P-wave for a mode that stands still; of one that
        grows, until it is 1 % of the spacing.
    Raises: ValueError for a k that doesn't fit (with the nearest that does) or lies beyond the Brillouin zone (with the
        wave that it is), a box of two horizons or less.
    """
    N = _ratio(N)
    shape = tuple(_count("n", s, 2) for s in ((n,) * dim if np.ndim(n) == 0 else n))
    dim = len(shape)
    if not -dim <= branch < dim:
        raise ValueError(f"branch must lie in {-dim} to {dim - 1} in {dim}D; got {branch}")
    if np.size(k) > dim and k is not None:
        raise ValueError(f"k must have at most {dim} components in {dim}D; got {k}")
    given = np.zeros(dim)
    given[0] = 2 * np.pi / shape[0]
    if k is not None:
        given[: np.size(k)] = np.atleast_1d(np.asarray(k, dtype=float))
        given[np.size(k) :] = 0.0
    steps = given * np.array(shape) / (2 * np.pi)
    if not (np.isfinite(given).all() and np.abs(steps - np.round(steps)).max() < 1e-6):
        nearest = 2 * np.pi * np.round(np.nan_to_num(steps)) / np.array(shape)
        raise ValueError(
            f"k must fit the periodic box, k_i = 2π j/n_i; got {given}, the nearest that fits is {nearest}"
        )
    if (np.abs(steps) > np.array(shape) / 2 + 1e-6).any():
        same = np.round(steps) - np.array(shape) * np.round(np.round(steps) / np.array(shape))
        raise ValueError(
            f"a lattice of {shape} points has waves of up to half as many lengths along each side; {np.round(steps)}"
            f" are more, and on these points the wave is that of {same}"
        )
    body = lattice(shape, 1.0, periodic=True)
    model = _unit_model(model)
    mean = None if F is None else deformation_gradient(F, dim)
    family = lattice_family(dim, N)
    found = on_host(dispersion(model, family, np.eye(dim) if mean is None else mean, given[None], density))
    e, omega = found.mode[0, :, branch], found.frequency[0, branch]
    phase = ((body.positions - body.positions[0]) @ given)[:, None]  # a crest on a point: k = π/h is seen
    u0 = on_host(as_real(u0))
    start = u0 * np.cos(phase) * e
    velocity = omega * u0 * np.sin(phase) * e if travelling else None
    fixed = scene(body, families(body, N), model, mean=mean, closed_form=start, moving=True, name="wave")
    duration = None
    if is_concrete(omega, u0):
        rate, growth = float(omega), float(found.growth[0, branch])
        rate = rate or math.sqrt(float(p_wave_modulus(model, family)) / density) * float(np.linalg.norm(given))
        if growth and u0:
            duration = math.log(max(1e-2 / abs(float(u0)), 10.0)) / growth
        elif rate:
            duration = periods * 2 * np.pi / rate
    return motion(fixed, density, start=start, velocity=velocity, duration=duration)
