"""The critical time step of an infinite lattice.

The central-difference scheme (velocity Verlet) is stable up to Δt = 2/ω_max, with the largest frequency of all waves,
ω_max² = max over k of λ_max(−Ĵ(k))/ρ. The search of the Brillouin zone (`pdjax.infinite_lattice.criteria.waves`) finds
it for the negative of the symbol. A zero-energy control adds stiffness and lowers this step.

Source: Courant, Friedrichs & Lewy 1928.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import deformation_gradient, frozen, in_double, is_concrete
from .._internal.public import public_function
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .bloch import homogeneous_tangent, wave_phases
from .brillouin import brillouin_zone
from .cosine_series import packed, reached, series
from .criteria import family_zone, kept_symmetry
from .criteria.waves import Found, search, search_few
from .dispersion import checked_density
from .lattice_states import check_at_rest, checked_states, has_series


@public_function
@in_double
def lattice_time_step(
    model: AbstractModel, family: LatticeFamily, F=None, density=1.0, resolution: int | None = None
) -> Float[Array, ""]:
    """Compute the critical time step of velocity Verlet on an infinite lattice.

    Δt = 2/ω_max,   ω_max² = max over k of λ_max(−Ĵ(k))/ρ

    Parameters
    ----------
    model : AbstractModel
        A material model that has an energy.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim), optional
        Deformation gradient [-] of the homogeneous state. The default is the undeformed state.
    density : float, optional
        Mass density ρ > 0 [mass/length^dim].
    resolution : int, optional
        Grid intervals of the Brillouin zone, see `stability`.

    Returns
    -------
    array, shape ()
        Critical time step [time]. It is infinite if no wave oscillates. First derivatives in the model, the family, F
        and the density are exact.

    Raises
    ------
    ValueError
        If the model has no energy, if det F ≤ 0, if the density is not > 0, or for what `stability` refuses.

    Notes
    -----
    `critical_time_step` computes the step of a finite body with its supports. Inside a body this one is a lower bound
    for a homogeneous state.

    Examples
    --------
    A chain of springs of constant 1 has ω = 2 sin(kh/2), so its critical step is 1.

    >>> round(float(pd.lattice_time_step(pd.BondBased(1.0), pd.lattice_family(1, 1))), 6)
    1.0
    """
    if not model.hyperelastic:
        raise ValueError(
            "lattice_time_step needs a model with an energy, whose symbol is symmetric;"
            f" this {type(model).__name__}, or its control, has none"
        )
    F = deformation_gradient(np.eye(family.dim) if F is None else F, family.dim)
    density = checked_density(density, family.xi.dtype)
    zone = family_zone(family, kept_symmetry(F, family, model.isotropic), resolution)
    quiet = quiet_model, quiet_family, quiet_F = frozen((model, family, F))
    if is_concrete(quiet) and has_series(model):
        states = checked_states(quiet_model, quiet_family, np.asarray(quiet_F)[None])
        found = search_few(-packed(states.scaled), states.offsets, zone)
        wave: tuple[Any, Any] | None = found.fast_x[0], found.fast_mode[0]
    else:
        check_at_rest(model, family)
        wave = None
    return _step(model, family, F, density, wave, zone.intervals, zone.symmetry)


@eqx.filter_jit
def _step(model, family, F, density, wave, intervals: int, symmetry: str) -> Array:
    tangent = homogeneous_tangent(model, family, F)
    if wave is None:
        dim, bonds = family.dim, len(family.influence)
        blocks = packed(series(jax.lax.stop_gradient(tangent), dim, bonds))
        size = jnp.max(jnp.abs(blocks))  # The search compares quotients of order one.
        zone = brillouin_zone(dim, intervals, symmetry)
        found: Found = search(-blocks[None] / size, 1, reached(dim, bonds, tangent.rings), zone)
        wave = found.fast_x[0], found.fast_mode[0]
    x, mode = jax.lax.stop_gradient(wave)
    # Only the result depends on the spacing, not the angles k·ξ = x·ξ/h.
    phases = jax.lax.stop_gradient(wave_phases(family, x / family.spacing))
    square = -(mode @ tangent(phases) @ mode) / density
    moves = square > 0
    return jnp.where(moves, 2 / jnp.sqrt(jnp.where(moves, square, 1.0)), jnp.inf)
