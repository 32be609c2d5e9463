"""The energy per area that a plane of breaking bonds releases, from the critical stretch.

The bonds that cross a plane break at the stretch s. A₁, A₂ and B are the sums of `pdjax.geometry.plane_sums`, and
k* = (d + 2) G/d is the bulk modulus of a solid of independent springs. The released energy per area is

    BondBased            G_c = ½ c B s²
    LPS, "crossing"      G_c = d² [(k − k*) A₂ + k* A₁] s²
    LPS, "uniform"       G_c = d² [(k − k*) (2A₁ − A₂) + k* A₁] s²

**The two states.** The bond of an LPS has no energy of its own, because the dilatation θ couples the bonds of a family.
The released energy depends on what the other bonds do. A point at the distance z from the plane has lost the share c(z)
of m_w, and W = ½ (k − k*) θ² + ½ α Σ w e² with α m_w = d² k* (`pdjax.models.lps`). m_w is that of the intact family.

* "crossing": crossing bonds have e = s |ξ|, all others e = 0. Before the break θ = d c s and Σ w e² = c m_w s². After
  it both are 0. The integral of W over both sides of the plane gives the formula.
* "uniform": all bonds have e = s |ξ|, as under hydrostatic tension. θ falls from d s to d s (1 − c).

The states agree for k = k*: ν = ¼ in 3D and in plane strain, ⅓ in plane stress. There LPS has the fracture energy of
BondBased with the influence ω |ξ|. At the tip of a crack neither state is exact.

**Closed forms.** For a full ball and ω = 1 in BondBased, with the constants of `BondBased.from_young`,

    s₀² = 5 G_c/(9Kδ) in 3D,   4π G_c/(9Eδ) in plane stress,   5π G_c/(12Eδ) in plane strain

The first is equation 27 of Silling & Askari 2005. For LPS with ω = δ/|ξ|, "crossing" gives

    G_c = [3G + (26/45) (K − 5G/3)] δ s₀² in 3D,   [6G/π + 0.3226 (k − 2G)] δ s₀² in 2D.

Madenci & Oterkus 2014 print (3/4)⁴ = 0.316 and 16/(9π²) = 0.180 in place of 26/45 = 0.578 and 0.3226. Their values are
d² times the square of the mean of c, where c is the lost share of the volume, not of m_w: ¾ · ¼ = 3/16 in 3D and 2/(3π)
in 2D. The values here use the mean of the square, which the energy contains. The difference vanishes for k = k*.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from ..._internal.checks import choice, finite, is_concrete
from ...force.surface_correction import full_family
from ...geometry.bonds import Families, LatticeFamily
from ...geometry.influence import constant_influence, named_influence
from ...geometry.plane_sums import PlaneSums, ball_plane_sums, plane_sums
from ...models.base import AbstractModel

CALIBRATIONS = ("closed form", "lattice")
STATES = ("crossing", "uniform")


def _lattice_sums(family: LatticeFamily | Families, normal: ArrayLike | None) -> PlaneSums:
    if isinstance(family, LatticeFamily):
        xi = np.asarray(family.xi, float)
        volume = np.full(len(xi), float(family.spacing) ** family.dim)
        w = np.asarray(family.influence * family.weight, float) * volume
    else:
        if family.spacing is None:
            raise ValueError('calibrate="lattice" needs the families of a lattice; use "closed form" for a cloud')
        w, xi = (np.asarray(x[0], float) for x in full_family(family))
        volume = np.full(len(xi), family.spacing**family.dim)
    n = np.eye(family.dim)[0] if normal is None else finite("normal", normal)
    if n.shape != (family.dim,) or not n.any():
        raise ValueError(f"normal must be a vector of shape ({family.dim},), not 0; got {normal!r}")
    return plane_sums(w, volume, xi, n)


def _ball_sums(family: LatticeFamily | Families, influence: Callable | str | None) -> PlaneSums:
    if influence is None:
        omega = np.asarray(family.influence)[np.asarray(family.is_bond) if isinstance(family, Families) else ...]
        if np.ptp(omega) > 1e-6 * np.max(np.abs(omega)):
            raise ValueError(
                "the closed form needs the influence function of these families, which is not constant; pass it as"
                ' influence=…, or use calibrate="lattice"'
            )
        level = float(np.mean(omega))
        return ball_plane_sums(family.dim, float(family.horizon), lambda r, d: level * constant_influence(r, d))
    return ball_plane_sums(family.dim, float(family.horizon), named_influence(influence, family.spacing))


def sums_of_plane(
    family: LatticeFamily | Families,
    calibrate: str,
    influence: Callable | str | None = None,
    normal: ArrayLike | None = None,
) -> PlaneSums:
    """The sums of a plane, from a full ball ("closed form") or from the lattice of these families ("lattice")."""
    choice("calibrate", calibrate, CALIBRATIONS)
    if not isinstance(family, LatticeFamily | Families):
        raise ValueError(
            f"family must be a LatticeFamily (lattice_family) or Families (families); got {type(family).__name__}"
        )
    if isinstance(family, Families):
        family.need_arrays()
    if not is_concrete(family):
        raise ValueError("a fracture energy is computed on the host; call it outside jit and grad")
    if np.ndim(family.horizon):
        raise ValueError("a fracture energy needs one horizon for all points; these families have one for each")
    return _lattice_sums(family, normal) if calibrate == "lattice" else _ball_sums(family, influence)


def cut_coefficient(
    model: AbstractModel,
    family: LatticeFamily | Families,
    calibrate: str,
    influence: Callable | str | None,
    state: str,
    normal: ArrayLike | None = None,
) -> Array:
    """G_c/s² [pressure · length] of a plane, see the module docstring. `normal` is for "lattice"; default: an axis."""
    choice("state", state, STATES)
    if not isinstance(model, AbstractModel):
        raise ValueError(f"model must be a pdjax model, here BondBased or LPS; got {model!r}")
    sums = sums_of_plane(family, calibrate, influence, normal)
    if family.dim not in model.dims:
        raise ValueError(f"{type(model).__name__} is not defined in dimension {family.dim}")
    try:
        return model.cut_energy(sums, state == "uniform")
    except NotImplementedError as error:
        raise ValueError(
            f"the fracture energy of a critical stretch is known for BondBased without an order and for LPS; {error}."
            " Give the stretch itself, CriticalStretch(s₀), or use CriticalBondEnergy"
        ) from None
