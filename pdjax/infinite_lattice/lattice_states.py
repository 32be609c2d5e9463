"""Linearised homogeneous states of an infinite lattice, and the public functions that read them.

A state is a deformation gradient F. `linearised` gives its cosine series (`pdjax.infinite_lattice.cosine_series`),

    Ĵ(x) = −Σ_o B_o 4 sin²(o·x/2),    x = h k,  o over half of the integer offsets,

and the P-wave modulus M of the model. The symbol, the block at a point and the search of the Brillouin zone need
nothing else of the model. The first two are therefore computed with NumPy, and the search is one compiled program for
all models (`pdjax.infinite_lattice.criteria.waves.search`).

Each class of models compiles one small program. It linearises up to STATES deformations at once, together with the
undeformed state. The family object keeps the results. The program computes in double precision even for a family in
single precision, so that a verdict does not depend on the units.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import DTypeLike
from jaxtyping import Array, Float

from .._internal.checks import (
    Numbers,
    as_array,
    computed_in_double,
    deformation_gradient,
    is_concrete,
    namespace,
    on_device,
    require,
)
from .._internal.memory import remember, value_key
from .._internal.public import public_function
from .._internal.xla import ONCE, compiled_with
from ..force.fields import check_model
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel
from .bloch import (
    Tangent,
    block_at_center,
    homogeneous_tangent,
    modulus_at_rest,
    tangent_kind,
    wave_phases,
)
from .cosine_series import reached, series, symbols

STATES = 16


class States(NamedTuple):
    """Linearised states, as NumPy arrays.

    `blocks` (states, offsets, dim, dim) [force/length^(dim+1)] are the blocks B_o of the cosine series, and `offsets`
    (offsets, dim) the half of the offsets to which they belong. `modulus` is M [pressure], one number or one for each
    state. `spacing` is h [length].
    """

    blocks: np.ndarray
    offsets: np.ndarray
    modulus: np.ndarray | float
    spacing: float

    @property
    def scaled(self) -> np.ndarray:
        """The blocks in units of M/h²."""
        return self.blocks * np.reshape(self.spacing**2 / self.modulus, (-1, 1, 1, 1))


def rings(model: AbstractModel) -> int:
    """The number of rings of neighbours that the blocks of a model's cosine series reach."""
    return tangent_kind(model).rings


def offsets_of(model: AbstractModel, family: LatticeFamily) -> np.ndarray:
    """Half of the offsets (offsets, dim), those to which the blocks of a model's cosine series belong."""
    return reached(family.dim, len(family.influence), rings(model))


def modulus_of(resting: np.ndarray, offsets: np.ndarray, spacing: float) -> np.ndarray | np.floating:
    """M [pressure] (...,) from the blocks (..., offsets, dim, dim) of undeformed states: −Ĵ₁₁/k² of long waves."""
    return resting[..., 0, 0] @ offsets[:, 0] ** 2 * spacing**2


@compiled_with(ONCE)
def _linearise(
    model: AbstractModel, family: LatticeFamily, F: Float[Array, "states dim dim"], count: Array
) -> Tangent | Array:
    """The tangents of a point-state model, or the cosine series of any other model, at the first `count` states F."""
    dim, bonds = family.dim, len(family.influence)

    def one(F):
        return series(homogeneous_tangent(model, family, F), dim, bonds)

    kind = tangent_kind(model)
    if kind.series_on_host:
        return jax.vmap(lambda F: homogeneous_tangent(model, family, F))(F)
    if not kind.one_by_one:
        return jax.vmap(one)(F)
    # The loop computes one state after the other, and only the first `count`.
    blank = jnp.zeros((len(F), len(reached(dim, bonds, kind.rings)), dim, dim), F.dtype)
    return jax.lax.fori_loop(0, count, lambda i, out: out.at[i].set(one(F[i])), blank)


def linearised_now(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> np.ndarray:
    """The blocks B_o (states, offsets, dim, dim) of up to STATES states F (states, dim, dim), which are not kept."""
    return _blocks(model, family, F)[1 : len(F) + 1]


def _blocks(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> np.ndarray:
    """The blocks of the undeformed state and of the states F. The rows behind them are unset."""
    dim, count = family.dim, len(F)
    every = np.broadcast_to(np.eye(dim), (STATES + 1, dim, dim)).copy()  # the first remains the undeformed state
    every[1 : count + 1] = F
    out = computed_in_double(_linearise, model, family, every, np.asarray(count + 1))
    if tangent_kind(model).series_on_host:
        states = [jax.tree.map(lambda x, i=i: x[i], out) for i in range(count + 1)]
        out = np.stack([series(state, dim, len(family.influence)) for state in states])
    return np.asarray(out)


def linearised(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> States:
    """Linearise a model at up to STATES states F (states, dim, dim). No value is traced, and the family is checked."""

    def make():
        out = _blocks(model, family, F)
        offsets, h = offsets_of(model, family), float(family.spacing)
        return States(out[1 : len(F) + 1], offsets, float(modulus_of(out[0], offsets, h)), h)

    return remember(family, ("linearised", value_key(model), F.shape, F.tobytes()), make)


def has_series(model: AbstractModel) -> bool:
    """Whether one family gives the symbol. It does not if the states of both ends are needed and are not even."""
    return model.even or not model.needs_other_end


def resting_modulus(model: AbstractModel, family: LatticeFamily) -> float:
    """M [pressure] of a model on a checked family. No value is traced."""

    def make():
        if has_series(model):
            return linearised(model, family, np.zeros((0, family.dim, family.dim))).modulus
        return float(computed_in_double(modulus_at_rest, model, family))

    return remember(family, ("modulus", value_key(model)), make)


def check_at_rest(model: AbstractModel, family: LatticeFamily) -> None:
    """Raise ValueError for a singular shape tensor or a P-wave modulus that is not positive.

    Every margin is divided by this modulus.
    """
    check_model(model, family, LatticeFamily)
    if is_concrete(model, family):
        check_modulus(model, resting_modulus(model, family))


def check_modulus(model: AbstractModel, M: float) -> None:
    """Raise ValueError for a P-wave modulus that is NaN or not positive."""
    if np.isnan(M):
        raise ValueError(
            f"the P-wave modulus of {type(model).__name__} in the undeformed state is nan. Check that every constant is"
            " finite, and that the energy takes no norm or power of bonds.eta, which is 0 in the undeformed state"
            " (eta = u_j − u_i; the deformed bond is xi + eta)"
        )
    if not M > 0:
        raise ValueError(
            f"law must have a positive P-wave modulus (lam + 2 mu) in the undeformed state; got {M:g}, so the lattice"
            " is unstable without any load. Check the constants of the law"
        )


def checked_states(model: AbstractModel, family: LatticeFamily, F: np.ndarray) -> States:
    """`linearised` with the checks of the family and of the modulus. It compiles no further program."""
    check_model(model, family, LatticeFamily)
    states = linearised(model, family, F)
    remember(family, ("modulus", value_key(model)), lambda: states.modulus)
    check_modulus(model, float(states.modulus))
    return states


@public_function
def symbol(model: AbstractModel, family: LatticeFamily, F, k) -> Float[Array, "*waves dim dim"]:
    """Compute the symbol of an infinite lattice: its exact Jacobian on plane waves.

    Ĵ(k) = Σ_η J⟨η⟩ e^{ik·η},    f = Ĵ(k) a e^{ik·X}  for  u = a e^{ik·X}

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be single numbers.
    family : LatticeFamily
        Family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-] of the homogeneous state, det F > 0.
    k : array, shape (..., dim)
        Wave vectors [1/length], any number of them.

    Returns
    -------
    array, shape (..., dim, dim)
        Ĵ(k) [force/length^(dim+1)], real. It is symmetric for hyperelastic models and zero at k = 0. A state is
        unstable if Ĵ(k) has a positive eigenvalue for some k.

    Raises
    ------
    ValueError
        If F is not finite or det F ≤ 0, if k is not finite or has another dimension than the lattice, or if the model
        cannot invert the shape tensor of the family.

    References
    ----------
    Born & Huang 1954 (the method).

    Examples
    --------
    A chain of springs of constant 1 has Ĵ(k) = −4 sin²(k/2).

    >>> chain = pd.lattice_family(1, 1)
    >>> J = pd.symbol(pd.BondBased(1.0), chain, np.eye(1), [[0.0], [np.pi / 2], [np.pi]])
    >>> [round(x, 3) for x in np.asarray(J).ravel().tolist()]
    [0.0, -2.0, -4.0]
    """
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    k = wave_vectors(k, family.dim, F.dtype)
    if is_concrete(model, family, F, k):
        states = linearised(model, family, np.asarray(F)[None])
        return on_device(symbols(states.blocks[0], states.offsets, k * states.spacing))
    return _symbol(model, family, F, k)


def wave_vectors(k, dim: int, dtype: DTypeLike, listed: bool = False) -> Numbers:
    """`k` as an array of finite wave vectors (..., dim). If `listed`, (waves, dim); in 1D also given as (waves,)."""
    xp = namespace(k)
    k = xp.asarray(k, dtype)
    if listed and k.ndim == dim == 1:
        k = k[:, None]
    if k.ndim == 0 or k.shape[-1] != dim or (listed and k.ndim != 2):
        raise ValueError(f"k must have shape ({'waves' if listed else '...'}, {dim}) for this family; got {k.shape}")
    return require(k, xp.isfinite(k), "k must be finite")


@eqx.filter_jit
def _symbol(model: AbstractModel, family: LatticeFamily, F: Array, k: Array) -> Array:
    return homogeneous_tangent(model, family, F)(wave_phases(family, k))


@public_function
def center_block(model: AbstractModel, family: LatticeFamily, F) -> Float[Array, "dim dim"]:
    """Compute the diagonal block of the Jacobian of an infinite lattice: how f of a point depends on its own position.

    D = ∂f(X)/∂x(X) = Σ_ξ V [−(Σ_ζ C_ξζ) − C_ξξ],    C = ∂T/∂η

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be single numbers.
    family : LatticeFamily
        Family of the lattice, from `lattice_family`.
    F : array, shape (dim, dim)
        Deformation gradient [-] of the homogeneous state, det F > 0.

    Returns
    -------
    array, shape (dim, dim)
        D [force/length^(dim+1)].

    Raises
    ------
    ValueError
        If F is not finite or det F ≤ 0, or if the model cannot invert the shape tensor of the family.

    Notes
    -----
    If the point moves by e, the η of all its own bonds change by −e, and in the family of each neighbour the η of one
    bond changes by +e. D is also the mean of the symbol over the Brillouin zone, which is −2 Σ_o B_o of its cosine
    series.

    Examples
    --------
    A point in a chain of springs of constant 1 is held by two of them.

    >>> D = pd.center_block(pd.BondBased(1.0), pd.lattice_family(1, 1), np.eye(1))
    >>> round(float(D[0, 0]), 3)
    -2.0
    """
    check_model(model, family, LatticeFamily)
    F = deformation_gradient(F, family.dim)
    if is_concrete(model, family, F) and has_series(model):
        return on_device(-2 * linearised(model, family, np.asarray(F)[None]).blocks[0].sum(axis=0))
    return _center_block(model, family, F)


@eqx.filter_jit
def _center_block(model: AbstractModel, family: LatticeFamily, F: Array) -> Array:
    return block_at_center(model, family, F)


@public_function
def p_wave_modulus(model: AbstractModel, family: LatticeFamily) -> Float[Array, ""]:
    """Compute the P-wave modulus of a model on an infinite lattice in the undeformed state.

    M = ∂P₁₁/∂F₁₁ at F = I

    Models that reproduce the moduli of their law exactly have M = λ + 2μ. All margins are divided by M.

    Parameters
    ----------
    model : AbstractModel
        The material model. Its constants must be single numbers.
    family : LatticeFamily
        Family of the lattice, from `lattice_family`.

    Returns
    -------
    array, shape ()
        M [pressure].

    Raises
    ------
    ValueError
        If the model cannot invert the shape tensor of the family.

    Examples
    --------
    >>> model = pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=1.0))
    >>> round(float(pd.p_wave_modulus(model, pd.lattice_family(2, 2))), 6)
    3.0
    """
    check_model(model, family, LatticeFamily)
    if is_concrete(model, family):
        return as_array(resting_modulus(model, family), family.xi.dtype)
    return modulus_at_rest(model, family)
