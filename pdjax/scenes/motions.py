"""Moving scenes: the cuboid of the paper (Behzadinasab & Foster), and plane waves on periodic lattices."""

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
from ..models.base import AbstractModel
from .bodies import checked_count, checked_ratio, unit_model


@eqx.filter_jit
def _rate_of_uniaxial_stress(model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """dF/da of the path `uniaxial_stress`, F = diag(1 + a, b, b) with P₂₂ = 0, at a = 0."""
    dim, dtype = family.dim, family.xi.dtype
    along = jnp.zeros((dim, dim), dtype).at[0, 0].set(1.0)
    if dim == 1:
        return along
    lateral = jnp.eye(dim, dtype=dtype) - along
    _, rate = jax.linearize(lambda F: model.stress(family.bonds(F))[1, 1], jnp.eye(dim, dtype=dtype))
    return along - rate(along) / rate(lateral) * lateral


def cuboid(shape, N: float = 3, strain=0.05, rate=1e-2, model: AbstractModel | None = None, density=1.0) -> Motion:
    """Make the paper's cuboid: a body whose ends are pulled apart or pushed together along x at a constant rate.

    The body is a lattice whose last side is one unit of length long: the shape (32, 8, 8) gives a body of 4 × 1 × 1. In
    2N layers at each end u_x = λ(t) strain (x − centre) is prescribed, with λ(t) = t rate/|strain|. All other
    components are free, so the whole body can move in uniaxial stress. The initial velocities are those of uniaxial
    stress, including the lateral contraction. No wave front therefore enters from the ends and the sides.

    Parameters
    ----------
    shape : int or tuple of 1 to 3 int
        Number of points along each axis.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    strain : float, optional
        Strain [-] at the end of the motion, > −1 and not 0. Default 0.05.
    rate : float, optional
        Magnitude > 0 of the strain rate [1/time]. Default 0.01.
    model : AbstractModel, optional
        The material model. Default: `SethHill` of order 1 with unit modulus.
    density : float or array, shape (points,), optional
        Density [mass/length^dim]. Default 1.

    Returns
    -------
    Motion
        The problem. Its default duration is |strain|/rate.

    Raises
    ------
    ValueError
        If the two ends leave no layer free, or if the strain or the rate is invalid.

    References
    ----------
    Behzadinasab & Foster, section 5.3

    Examples
    --------
    A strain of 0.05 at a rate of 0.01 takes 5 units of time:

    >>> motion = pd.scenes.cuboid(9, N=2, strain=0.05, rate=0.01)
    >>> motion.duration, motion.start.shape
    (5.0, (9, 1))
    """
    N, shape = checked_ratio(N), tuple(checked_count("every entry of shape", s, 1) for s in np.atleast_1d(shape))
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
    fixed = scene(body, families(body, N * h), unit_model(model), held, moving=True, name="cuboid")
    duration = abs(strain) / rate
    family = lattice_family(body.dim, N, h)
    pull = on_host(_rate_of_uniaxial_stress(fixed.model, family))
    centre = 0.5 * h * np.array(shape)
    velocity = math.copysign(rate, strain) * (body.positions - centre) @ pull.T
    return motion(fixed, density, schedule=Ramp(duration), velocity=velocity, duration=duration)


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
    """Make a plane wave on a periodic lattice of spacing 1, on top of a homogeneous deformation.

    u = u₀ e cos(k·(X − X₀)) at t = 0

    X₀ is the first point, so a crest lies on a point. e is the polarisation of one branch of the symbol. The wave
    starts at rest (a standing wave) or with the velocities of a wave that travels along k. The closed form of the scene
    is the initial displacement.

    Parameters
    ----------
    n : int or tuple of int
        Number of points along each side, or the shape of the lattice.
    N : float, optional
        Horizon over spacing [-]. Default 3.
    k : float or array, shape (dim,), optional
        Wave vector [1/length], or its first component. It must fit the periodic box: k_i = 2π j/n_i with integer j.
        Default: the longest wave along x.
    u0 : float, optional
        Amplitude u₀ [length]. Default 1e-6.
    model : AbstractModel, optional
        The material model. Default: `SethHill` of order 1 with unit modulus.
    dim : int, optional
        Dimension, if n is one number. Default 1.
    F : array, shape (dim, dim), optional
        Mean deformation gradient [-]. Default: undeformed.
    branch : int, optional
        Branch of the symbol: −1 (the default) is the fastest, 0 the slowest.
    travelling : bool, optional
        Start with the velocities of a travelling wave. Default False.
    density : float, optional
        Density [mass/length^dim]. Default 1.
    periods : float, optional
        Default duration of the motion, in periods of the wave. Default 4. A mode of zero frequency uses the period of a
        classical P-wave. For a growing mode the duration is the time in which it grows to 1 % of the spacing,
        or tenfold if that takes longer.

    Returns
    -------
    Motion
        The problem, with its default duration.

    Raises
    ------
    ValueError
        If k does not fit the box (the message names the nearest k that does), if k lies beyond the Brillouin zone (the
        message names the equivalent wave), or if the box is not longer than two horizons.

    Examples
    --------
    On a chain of springs ω = 2 sin(k/2) = √2 for k = π/2, so 4 periods take 8π/√2:

    >>> motion = pd.scenes.wave(8, N=1, k=np.pi / 2, model=pd.BondBased(1.0))
    >>> round(motion.duration, 6), round(8 * np.pi / 2**0.5, 6)
    (17.771532, 17.771532)
    """
    N = checked_ratio(N)
    shape = tuple(checked_count("n", s, 2) for s in ((n,) * dim if np.ndim(n) == 0 else n))
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
            f"k must fit the periodic box, k_i = 2π j/n_i with integer j; got {given}, and the nearest k that fits is"
            f" {nearest}"
        )
    if (np.abs(steps) > np.array(shape) / 2 + 1e-6).any():
        same = np.round(steps) - np.array(shape) * np.round(np.round(steps) / np.array(shape))
        raise ValueError(
            f"k lies beyond the Brillouin zone: a lattice of {shape} points has waves of up to half as many wavelengths"
            f" along each side; got {np.round(steps)} wavelengths, which on these points is the same wave as {same}"
        )
    body = lattice(shape, 1.0, periodic=True)
    model = unit_model(model)
    mean = None if F is None else deformation_gradient(F, dim)
    family = lattice_family(dim, N)
    found = on_host(dispersion(model, family, np.eye(dim) if mean is None else mean, given[None], density))
    e, omega = found.mode[0, :, branch], found.frequency[0, branch]
    # The crest lies on a point. Between two points a wave of k = π/h would vanish on all points.
    phase = ((body.positions - body.positions[0]) @ given)[:, None]
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
