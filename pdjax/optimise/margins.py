"""The worst margin over several load cases, as an objective or a constraint of a design.

The margin of one case is the supremum over waves of λ_max(Ĵ(k))/(M κ²) (criterion "symbol" of `pdjax.stability`). The
worst margin is the maximum over the cases: negative if all of them are stable.

**Its derivative.** A maximum of smooth functions has no derivative where two of them are equal. `worst_margin` then
returns the derivative of the case, wave and polarisation that its search found. This vector belongs to Clarke's
generalised gradient. Along a line it equals one of the two one-sided derivatives if two cases or two waves share the
maximum. If one wave has a repeated largest eigenvalue, it lies between the two.

**A smooth bound.** The Kreisselmeier–Steinhauser aggregate of sharpness s is

    KS = (1/s) ln Σ tr exp(s A),    A = Ĵ(k)/(M κ²),    summed over the cases and the n waves of the search grid,

directions of the limit k → 0 included. Every branch of every wave counts, so that KS is smooth where eigenvalues cross.
It bounds the largest of the n·dim·cases sampled values v: max v ≤ KS ≤ max v + ln(n·dim·cases)/s. It does not bound
the supremum between the samples.

Sources: Kreisselmeier & Steinhauser 1979; Clarke 1983.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import as_array, differentiated_in_double, frozen, in_double, is_concrete
from .._internal.public import public_function
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily
from ..infinite_lattice.bloch import homogeneous_tangent, laplacian, modulus_at_rest
from ..infinite_lattice.brillouin import Zone, brillouin_zone, is_judging
from ..infinite_lattice.cosine_series import packed, reached, series, upper
from ..infinite_lattice.criteria import at_found, check_at_rest, evaluate, family_zone
from ..infinite_lattice.criteria.on_host import outcomes
from ..infinite_lattice.criteria.waves import sampled as on_zone
from ..infinite_lattice.lattice_states import STATES
from ..models.base import AbstractModel
from .load_cases import LoadCases, checked_cases, groups


@public_function
@differentiated_in_double
@in_double
def worst_margin(
    model: AbstractModel,
    family: LatticeFamily,
    loads: LoadCases | Any,
    sharpness: float | None = None,
    resolution: int | None = None,
) -> Float[Array, ""]:
    """Compute the largest margin of stability over several load cases.

    max over cases of max over k of λ_max(Ĵ(k))/(M κ²)

    Parameters
    ----------
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice, from `lattice_family`.
    loads : LoadCases or array, shape (cases, dim, dim)
        The load cases: from `load_cases`, or deformation gradients [-] with det F > 0.
    sharpness : float, optional
        Sharpness s > 0 [-] of the Kreisselmeier–Steinhauser aggregate, which is smooth and replaces the maximum.
    resolution : int, optional
        Grid intervals of the Brillouin zone, see `stability`.

    Returns
    -------
    array, shape ()
        The worst margin [-]. It is positive if a case is unstable. It is NaN if a load path has no state.

    Raises
    ------
    ValueError
        If the loads have another shape or det F ≤ 0, if the sharpness is not finite and > 0, if a sharpness is given
        for a model without an energy, or for what `stability` refuses.

    Notes
    -----
    First derivatives in the model, the family and the loads are available. In float32 they are computed in float64,
    except inside `jit` and `vmap`. Where two cases or waves share the maximum, the derivative is that of the one which
    the search found. It is then an element of the generalised gradient. With `sharpness` the result is smooth. It lies
    above the largest of the n sampled values (cases × waves × branches) by at most ln(n)/s. The search without
    `sharpness` also climbs between the grid points.

    References
    ----------
    Kreisselmeier & Steinhauser 1979; Clarke 1983 (generalised gradient).

    Examples
    --------
    A penalty of g = 0.013 makes this Seth–Hill model stable at 1 % of compression.

    >>> family, law = pd.lattice_family(2, 2), pd.LinearElastic(1.0, 1.0)
    >>> cases = pd.load_cases("hydrostatic", [-0.01])
    >>> def margin(g):
    ...     return pd.worst_margin(pd.SethHill(1.0, law, pd.SillingControl(g)), family, cases)
    >>> bool(margin(0.0) > 0), bool(margin(0.05) < 0), bool(jax.grad(margin)(0.05) < 0)
    (True, True, True)
    """
    check_model(model, family, LatticeFamily)
    F, symmetries = checked_cases(loads, model, family)
    if sharpness is not None and not is_judging():
        # The symmetry of an array changes abruptly with its values, and the number of samples with it.
        kept = symmetries if isinstance(loads, LoadCases) else ["inversion"] * len(symmetries)
        return _aggregate(model, family, F, kept, sharpness, resolution)
    quiet = quiet_model, quiet_family, quiet_F = frozen((model, family, F))
    if not is_concrete(quiet):
        check_at_rest(quiet_model, quiet_family)
        return _traced(model, family, F, symmetries, resolution)
    worst: tuple[Any, ...] | None = None
    quiet_F = np.asarray(quiet_F)
    for symmetry, members in groups(symmetries):
        zone = family_zone(family, symmetry, resolution)
        for start in range(0, len(members), STATES):
            some = members[start : start + STATES]
            out = outcomes("symbol", quiet_model, quiet_family, quiet_F[some], zone)
            i = int(np.argmax(out.margin))  # The first NaN, if there is one.
            if worst is None or not out.margin[i] <= worst[0]:
                worst = out.margin[i], some[i], zone, jax.tree.map(lambda x, i=i: x[i], out)
            if np.isnan(worst[0]):
                break
    assert worst is not None
    value, case, zone, found = worst
    if is_concrete(model, family, F) or np.isnan(value):
        return as_array(value, family.xi.dtype)
    return jnp.asarray(at_found(model, family, F[case], "symbol", zone, found).margin)


def _traced(
    model: AbstractModel, family: LatticeFamily, F: Any, symmetries: list[str], resolution: int | None
) -> Array:
    """The worst margin inside a traced program: the cases are searched one after another."""
    margins = []
    for symmetry, members in groups(symmetries):
        zone = family_zone(family, symmetry, resolution)
        some = jnp.asarray(F)[members]
        margins.append(jax.lax.map(lambda f, zone=zone: evaluate("symbol", model, family, f, zone).margin, some))
    return jnp.max(jnp.concatenate(margins))


@jax.custom_jvp
def log_trace(A: Float[Array, "*waves dim dim"], sharpness: Array) -> Array:
    """(1/s) ln Σ tr exp(s A) of symmetric matrices."""
    return _log_trace(A, sharpness)[0]


def _log_trace(A: Array, sharpness: Array) -> tuple[Array, Array, Array, Array]:
    values, vectors = jnp.linalg.eigh(A)
    top = jnp.max(values)
    shares = jnp.exp(sharpness * (values - top))
    total = jnp.sum(shares)
    return top + jnp.log(total) / sharpness, shares / total, values, vectors


@log_trace.defjvp
def _(primals, tangents):
    """d KS = Σ p v·dA v with the shares p = exp(s λ)/Σ exp(s λ). It is smooth where eigenvalues cross."""
    (A, sharpness), (dA, ds) = primals, tangents
    value, shares, values, vectors = _log_trace(A, sharpness)
    weights = jnp.einsum("...ib,...b,...jb->...ij", vectors, shares, vectors)
    return value, jnp.sum(weights * dA) + (jnp.sum(shares * values) - value) / sharpness * ds


def _aggregate(
    model: AbstractModel, family: LatticeFamily, F: Any, symmetries: list[str], sharpness: Any, resolution: int | None
) -> Array:
    check_sharpness(sharpness)
    if not model.hyperelastic:
        raise ValueError(
            f"sharpness needs a model with an energy, whose symbol is symmetric; this {type(model).__name__}, or its"
            " control, has none. Leave it out"
        )
    check_at_rest(*frozen((model, family)))
    sharpness = as_array(sharpness, family.xi.dtype)
    parts = []
    for symmetry, members in groups(symmetries):
        intervals = family_zone(family, symmetry, resolution).intervals
        parts.append(_aggregated(model, family, F[members], sharpness, intervals, symmetry))
    # exp is monotone, so that aggregates of parts combine to the aggregate of all.
    return parts[0] if len(parts) == 1 else log_trace(jnp.stack(parts)[:, None, None], sharpness)


def check_sharpness(sharpness) -> None:
    """Raise ValueError for a concrete sharpness that is not one finite number > 0."""
    if is_concrete(sharpness) and not (np.ndim(sharpness) == 0 and np.isfinite(sharpness) and sharpness > 0):
        raise ValueError(f"sharpness must be one finite number > 0, or None for the maximum; got {sharpness}")


def sampled(model: AbstractModel, family: LatticeFamily, F: Array, zone: Zone) -> Float[Array, "cases waves dim dim"]:
    """Ĵ(k)/(M κ²) of every case at every wave of the grid and every direction of the limit k → 0."""
    dim, bonds = family.dim, len(family.influence)
    tangent = homogeneous_tangent(model, family, jnp.eye(dim, dtype=family.xi.dtype))
    offsets = reached(dim, bonds, tangent.rings)
    _, place = upper(dim)

    def one(f):
        waves, long = on_zone(packed(series(homogeneous_tangent(model, family, f), dim, bonds)), offsets, zone)
        return jnp.concatenate([(waves / laplacian(zone.grid)).T, long])[:, place]

    return jax.vmap(one)(F) * family.spacing**2 / modulus_at_rest(model, family)


@eqx.filter_jit
def _aggregated(model, family, F: Array, sharpness: Array, intervals: int, symmetry: str) -> Array:
    return log_trace(sampled(model, family, F, brillouin_zone(family.dim, intervals, symmetry)), sharpness)
