"""The strain energy that breaking bonds release at a fixed displacement.

    ΔΠ = Π(u, before) − Π(u, after) = Σ_i V_i (W_i before − W_i after)

Models that keep the reference sums of the intact family (`keeps_reference`: BondBased and LPS) lose energy with every
strained bond. All other models take their sums over the bonds that remain. In an affine state the remaining bonds give
the same F̄, and such a model releases nothing. In other states it may even gain energy, ΔΠ < 0: the remaining bonds may
be strained more than the mean. So G_c × area is not claimed for correspondence models.
"""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from ..._internal.public import public_function
from ...force.fields import body_state, check_model, energies
from ...geometry.bonds import Bonds, Families
from ...models.base import AbstractModel


def energy_drop(model: AbstractModel, families: Sequence[Families], bonds: Sequence[Bonds]) -> Float[Array, " points"]:
    """W of every point before a break minus that after it; NaN for a model without an energy.

    `families` and `bonds` hold those before and after. Where the model needs no other end, `bonds` and the constants of
    `model` may be those of a few points.
    """
    before, after = bonds
    if not model.hyperelastic:
        return jnp.full(len(before.xi), jnp.nan, before.xi.dtype)
    return energies(model, families[0], before) - energies(model, families[1], after)


@public_function
def released_energy(model: AbstractModel, families: Families, u, broken: ArrayLike, F=None) -> Float[Array, ""]:
    """Compute the strain energy that a body releases when bonds break at a fixed displacement.

    ΔΠ = Π(u, before) − Π(u, after)

    It is that of one break. The energy that all breaks of a run have released is `History.energies.released`.

    Parameters
    ----------
    model : AbstractModel
        The material model. It must have an energy.
    families : Families
        Families of the body before the break.
    u : array, shape (points, dim)
        Displacements [length].
    broken : array of bool, shape (points, bonds)
        Bonds that break, for example from `CriticalStretch.broken`. Both ends of a bond must agree.
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.

    Returns
    -------
    array, shape ()
        ΔΠ [energy]. It is ≥ 0 for `BondBased`. For other models it can be negative.

    Raises
    ------
    ValueError
        If u, F or `broken` is wrong, the model has no energy, or it cannot invert a shape tensor of the bonds that
        remain.

    Notes
    -----
    The difference is taken point by point, so that the energy of the points that keep all bonds does not round it.

    Examples
    --------
    A bar of 4 points is stretched by 10 %. A spring of length 1 releases ½ c s² = 0.005. The LPS, which does not exist
    in 1D, and `BondBased` keep the reference sums. A correspondence model gets its strain from the bonds that remain,
    and releases nothing:

    >>> families, u = pd.families(pd.lattice((4,)), horizon=1.0), 0.1 * pd.lattice((4,)).positions
    >>> parts = pd.cut(families, pd.Plane([2.0], [1.0]))
    >>> broken = np.asarray(parts.weight) < np.asarray(families.weight)
    >>> models = pd.BondBased(1.0), pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> [round(abs(float(pd.released_energy(model, families, u, broken))), 9) for model in models]
    [0.005, 0.0]
    """
    u, F = body_state(model, families, u, F)
    if not model.hyperelastic:
        raise ValueError(f"released_energy needs a model with an energy; {type(model).__name__} here has none")
    after = families.with_broken(broken)
    check_model(model, after, Families)
    return _released(model, families, after, u, F)


@eqx.filter_jit
def _released(model: AbstractModel, before: Families, after: Families, u: Array, F: Array | None) -> Array:
    two = before, after
    return jnp.dot(before.volumes, energy_drop(model, two, [families.bonds(u, F) for families in two]))
