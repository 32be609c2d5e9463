"""The force density of a body, and the choice of the backend that computes it.

    f_i = Σ_j [T_ij − T_ji] V_j  [force/length^dim]

Four backends compute the same f. The public argument `way` names one of them; "auto" takes the fastest by measurement.

    "families"   Padded neighbour arrays of any cloud. In small bodies all bonds are evaluated at once, which compiles
                 faster. In larger bodies a model made of moments is evaluated slot by slot, so that memory grows with
                 the points and not with points × bonds.
    "slices"     A lattice without index arrays: the neighbours of all points at one offset are one slice of an array.
    "fft"        A lattice by convolutions, for models whose moments and bond force are polynomials of degree 1 or 2 in
                 the displacement. The cost does not grow with the horizon.
    "compiled"   Any lattice or cloud on a CPU, by loops that LLVM compiles from the formulas of models of moments.
                 It needs the package llvmlite.

Some data depend on the reference configuration alone: shape tensors, sums over the undeformed family, transforms of
kernels. They are computed once for each families object and for each set of the model constants that they depend on.
The families object keeps them. A plain `force_density` is therefore as fast as the operator of `force_operator`, also
inside a user's own `jax.jit`.
"""

import warnings

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import (
    as_array,
    choice,
    deformation_gradient,
    in_host_memory,
    inside_jit,
    is_concrete,
    on_host,
)
from .._internal.memory import remember, value_key
from .._internal.public import public_function
from .._internal.xla import QUICK, compiled_with
from ..geometry.bonds import Families
from ..models.base import AbstractModel
from ..models.promises import check_promises
from .backends import compiled, fft, padded, slices
from .backends.backend import Backend, BackendModule
from .fields import check_model, point_field

BACKENDS: dict[str, BackendModule] = {"families": padded, "slices": slices, "fft": fft, "compiled": compiled}
WAYS = ("auto", *BACKENDS)
HUGE = 3.0  # a body that moves apart by more than this many times its size has probably a wrong u
FASTEST = ("compiled", "slices", "families")  # "auto" takes the first that can, or "fft"
# Offsets from which "fft" of degree 1 is faster than these backends (3D: N = 3 has 122, N = 4 has 256).
MANY = {"slices": 100, "compiled": 250}


def ways_of(model: AbstractModel, families: Families) -> tuple[str, ...]:
    """The backends that can evaluate this model on these families: some of `BACKENDS`."""
    return tuple(way for way, backend in BACKENDS.items() if backend.refusal(model, families) is None)


def _refusal(model: AbstractModel, families: Families, way: str, mean: bool) -> str | None:
    """Why a backend cannot evaluate this model and body, or None if it can."""
    return "it takes no mean deformation F" if mean and way == "fft" else BACKENDS[way].refusal(model, families)


def _choose(model: AbstractModel, families: Families, way: str, mean: bool) -> str:
    if way == "auto" and padded.is_small(families):
        return "families"
    if way == "auto":
        found = next((w for w in FASTEST if _refusal(model, families, w, mean) is None), None)
        if found is None:
            raise ValueError(
                f"{type(model).__name__} needs families with arrays, but these were made with arrays=False; make them"
                " with arrays=True"
            )
        lattice = model.degree == 1 and families.grid is not None and found in MANY
        many = lattice and len(families.grid.offsets) >= MANY[found]  # type: ignore[union-attr]
        return "fft" if many and _refusal(model, families, "fft", mean) is None else found
    why = _refusal(model, families, way, mean)
    if why:
        able = [w for w in BACKENDS if _refusal(model, families, w, mean) is None]
        raise ValueError(
            f"way={way!r} cannot evaluate this model on these families: {why}; backends that can:"
            f" {', '.join(map(repr, able)) or 'none'}"
        )
    return way


class ForceOperator(eqx.Module):
    """Prepared force density of one model on one body, a function of the displacement.

    `force_operator` makes it. Call it as `operator(u)`, or as `operator(u, F)` with a mean deformation.

    Attributes
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body.
    backend : Backend
        The prepared backend.
    way : str
        Name of the backend: "families", "slices", "fft" or "compiled".

    Notes
    -----
    Two operators are equal only if they are the same object. `jax.jit(operator)` and `jax.checkpoint(operator)` need
    this.

    Examples
    --------
    >>> families = pd.families(pd.lattice((5, 4)), horizon=2.1)
    >>> operator = pd.force_operator(pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), families)
    >>> operator.way
    'families'
    >>> float(abs(operator(np.zeros((20, 2)))).max())
    0.0
    """

    model: AbstractModel
    families: Families
    backend: Backend
    way: str = eqx.field(static=True)

    def __hash__(self) -> int:
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def __call__(self, u, F=None) -> Float[Array, "points dim"]:
        """Compute the force density of the displacement u.

        Parameters
        ----------
        u : array, shape (points, dim)
            Displacements [length].
        F : array, shape (dim, dim), optional
            Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
            A periodic body can be strained in no other way.

        Returns
        -------
        array, shape (points, dim)
            f [force/length^dim].

        Raises
        ------
        ValueError
            If u or F has a wrong shape or is not finite, det F ≤ 0, or the backend takes no F or no complex u.
        """
        backend = self.backend
        if F is not None and not backend.takes_mean:
            raise ValueError(
                f"way={self.way!r} takes no mean deformation F; prepare the operator with way='slices' or 'families'"
            )
        u = point_field(u, self.families)
        if jnp.issubdtype(u.dtype, jnp.complexfloating) and not backend.takes_complex:
            raise ValueError(
                f"way={self.way!r} takes real u only; got {u.dtype}. For derivatives use jax.jvp. For complex u use"
                f" way='families' and a body of fewer than {padded.SMALL} bonds"
            )
        F = None if F is None else deformation_gradient(F, self.families.dim)
        traced = inside_jit()
        if traced and is_concrete(backend):
            backend = _hidden(backend)
        if backend.quick and not traced and is_concrete(self.model, backend, u, F):
            return _evaluate_quickly(backend, self.model, u, F)
        return _evaluate(backend, self.model, u, F)


def fast_energies(operator: ForceOperator, u: Array, F: Array | None) -> Float[Array, " points"] | None:
    """W of every point [energy/length^dim] for loops that have a prepared operator, or None if its backend has no fast
    way. It is not jitted, so that jitted functions can trace it."""
    return operator.backend.energy(operator.model, u, F)


def _hidden(backend: Backend) -> Backend:
    """The backend behind an optimization barrier, for use inside a user's compiled function.

    Without the barrier XLA treats the arrays as constants and computes with them during compilation, for seconds.
    """
    arrays, rest = eqx.partition(backend, eqx.is_array)
    return eqx.combine(jax.lax.optimization_barrier(arrays), rest)


def _force(backend: Backend, model: AbstractModel, u: Array, F: Array | None) -> Float[Array, "points dim"]:
    return backend.force(model, u, F)


_evaluate = eqx.filter_jit(_force)
_evaluate_quickly = compiled_with(QUICK)(_force)


def _backend(model: AbstractModel, families: Families, way: str) -> Backend:
    """The prepared backend. Streaming relies on the promises of a model made of moments, so they are tested first."""
    if model.by_moments and not (way == "families" and padded.is_small(families)):
        check_promises(model, families.dim)
    return BACKENDS[way].prepare(model, families)


def _prepared(model: AbstractModel, families: Families, way: str, mean: bool) -> tuple[AbstractModel, Backend, str]:
    """Check the arguments, and return the model for the forces, the prepared backend and its name."""
    check_model(model, families, Families)
    ready = model.specialised()
    way = _choose(ready, families, way, mean)
    return ready, _backend(model, families, way), way


@public_function
def force_operator(model: AbstractModel, families: Families, way: str = "auto", mean: bool = False) -> ForceOperator:
    """Prepare the force density of a body as a function of the displacement.

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    way : {"auto", "families", "slices", "fft", "compiled"}, optional
        Backend that computes the forces, as in `force_density`.
    mean : bool, optional
        True if the operator will be called with a mean deformation, `operator(u, F)`. Then "auto" does not choose
        "fft", which takes none.

    Returns
    -------
    ForceOperator
        A function of u that also works under `jax.jit`, `jax.grad` and `jax.jvp`.

    Raises
    ------
    ValueError
        If the model cannot invert the shape tensor of a point, or the backend cannot evaluate this model or body.

    Examples
    --------
    A uniform stretch with a mean deformation leaves no force on a periodic body.

    >>> families = pd.families(pd.lattice((5, 7), periodic=True), horizon=2.1)
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> operator = pd.force_operator(model, families, mean=True)
    >>> f = operator(np.zeros((35, 2)), np.diag([1.1, 1.0]))
    >>> bool(abs(f).max() < 1e-12)
    True
    """
    choice("way", way, WAYS)
    key = value_key(model) if isinstance(families, Families) and is_concrete(families) else None
    if key is None:
        ready = _prepared(model, families, way, mean)
    else:
        ready = remember(families, ("force", way, mean, key), lambda: _prepared(model, families, way, mean))
    return ForceOperator(ready[0], families, *ready[1:])


@public_function
def force_density(model: AbstractModel, families: Families, u, F=None, way: str = "auto") -> Float[Array, "points dim"]:
    """Compute the net internal force density of every point.

    f_i = Σ_j [T_ij − T_ji] V_j,    η_ij = (F − I) ξ_ij + u_j − u_i

    Parameters
    ----------
    model : AbstractModel
        The material model.
    families : Families
        Families of the body, from `families`.
    u : array, shape (points, dim)
        Displacements [length].
    F : array, shape (dim, dim), optional
        Homogeneous deformation gradient [-] under the displacement, x = F X + u. Default: the identity.
        A periodic body can be strained in no other way.
    way : {"auto", "families", "slices", "fft", "compiled"}, optional
        Backend that computes the forces: padded neighbour arrays for any cloud, slices of a lattice, convolutions on a
        lattice, or compiled loops for any cloud or lattice on a CPU, which need `pip install "pdjax[compiled]"`. All
        give the same result to rounding. "auto" takes the fastest of those that serve this model and body.

    Returns
    -------
    array, shape (points, dim)
        Force density [force/length^dim]. It is zero at a point without bonds.

    Raises
    ------
    ValueError
        If u or F has a wrong shape or is not finite, or det F ≤ 0. If the model cannot invert the shape tensor of a
        point; the message names the first such point. If the backend cannot evaluate this model or body; the message
        lists the backends that can. If the forces are not finite, outside of JAX transformations; the message names a
        bond that has collapsed.

    Examples
    --------
    Two points of volume 1 are joined by one spring of constant 1, stretched by 10 %. They attract each other.

    >>> families = pd.families(pd.lattice((2,)), horizon=1.0)
    >>> f = pd.force_density(pd.BondBased(1.0), families, np.array([[0.0], [0.1]]))
    >>> np.asarray(f).ravel().round(3).tolist()
    [0.1, -0.1]
    """
    f = force_operator(model, families, way, F is not None)(u, F)
    if in_host_memory(f):
        if not np.isfinite(np.asarray(f)).all():
            raise ValueError(_not_finite(families, np.asarray(f), u, F))
        _warn_of_huge_displacements(families, u)
    return f


def _spread(x: object) -> float:
    """The largest difference between two points of one component of x (points, dim)."""
    return float(np.ptp(np.asarray(x), axis=0).max())


def _warn_of_huge_displacements(families: Families, u: object) -> None:
    """Warn if displacements differ by more than HUGE times the size of the body: u is then probably in another unit."""
    positions = families.positions
    if positions is None or not is_concrete(u, positions):
        return
    size = remember(families, "size", lambda: _spread(positions))
    spread = _spread(u)
    if spread > HUGE * size:
        warnings.warn(
            f"the displacements differ by up to {spread:.3g}, and the body is {size:.3g} long: u must be in the unit of"
            " length of the positions, and be displacements, not deformed positions",
            stacklevel=3,
        )


def _not_finite(families: Families, f: np.ndarray, u: object, F: Array | np.ndarray | None) -> str:
    """Why forces are not finite: a bond has collapsed, or numbers overflow their precision."""
    bad = np.flatnonzero(~np.isfinite(f).all(axis=1))
    where = f"the forces on {len(bad)} points are not finite, the first is point {bad[0]}"
    if families.xi is not None:
        bonds = on_host(families.bonds(as_array(u, families.dtype), F))
        length = np.linalg.norm(bonds.xi + bonds.eta, axis=-1) / np.linalg.norm(bonds.xi, axis=-1)
        gone = np.argwhere(np.asarray(families.is_bond) & ~(length > 1e-12))
        if len(gone):
            i, slot = gone[0]
            j = int(np.asarray(families.neighbours)[i, slot])
            return (
                f"{where}: the bond from point {i} to point {j} has collapsed to length 0 ({len(gone)} such bonds)."
                " Check u there, or reduce the load"
            )
    if families.dtype == np.float32:
        return f"{where}: numbers of 32 bits overflow. Use units in which lengths are near 1, or float64"
    return f"{where}, although no bond has collapsed. Check that u [length] and the constants of the model are sensible"
