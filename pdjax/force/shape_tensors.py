# mypy: disable-error-code="arg-type"
"""The check that the shape tensors of a model are invertible, before any force is computed.

Many models invert a shape tensor of the reference configuration, such as

    K = Σ w ξ⊗ξ,    L = Σ w n⊗n⊗n⊗n,    w = ω V,  n = ξ/|ξ|.

A tensor is singular if the bonds of the family do not span enough directions. `check_shape_tensors` then raises
ValueError with the index of the point.

Each check runs once for each families object. K and L depend on the bonds alone, so all models that need them share one
check, and NumPy computes the sums. The tensor of another model is computed by one compiled program. It can depend on
constants of the model, and only a change of these constants repeats the check.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from .._internal.checks import on_device
from .._internal.dependence import known_part
from .._internal.memory import remember
from ..geometry.bonds import Bonds, Families, LatticeFamily
from ..models.base import AbstractModel
from ..models.kinematics import shape_tensor_K, shape_tensor_L
from ..models.pointwise import each_point, split_model

CHUNK = 512  # Families that NumPy sums at a time, so that the intermediate arrays stay in the CPU caches.


def _kinds(families: Families) -> tuple[np.ndarray, Bonds]:
    """One point of each kind of family of a lattice without arrays, and the bonds of these families."""
    grid = families.grid
    assert grid is not None and grid.kinds is not None
    examples, patterns = (np.asarray(x) for x in grid.kinds)
    xi = np.array(grid.offsets, families.dtype).reshape(-1, families.dim) * float(families.spacing or 1.0)
    xi = np.broadcast_to(xi, (len(patterns), *xi.shape))
    omega = np.asarray(grid.influence) * patterns
    volume = np.full(omega.shape, np.asarray(families.volumes)[0])
    return examples, Bonds(xi, np.zeros_like(xi), omega, volume, np.full(len(patterns), families.horizon))


def _at_rest(families: LatticeFamily | Families) -> tuple[np.ndarray, Bonds]:
    """The points whose families are checked, and the bonds of these families as NumPy arrays (families, bonds, …)."""
    if isinstance(families, LatticeFamily):
        bonds = families.bonds(on_device(np.eye(families.dim, dtype=families.xi.dtype)))
        return np.zeros(1, int), jax.tree.map(lambda x: np.asarray(x)[None], bonds)
    if families.xi is None:
        return _kinds(families)
    xi, volumes = np.asarray(families.xi), np.asarray(families.volumes)
    omega = np.asarray(families.influence) * np.asarray(families.weight)
    volume = volumes[np.asarray(families.neighbours)]
    return np.arange(len(xi)), Bonds(xi, np.zeros_like(xi), omega, volume, np.full(len(xi), families.horizon))


@eqx.filter_jit
def _by_program(model: AbstractModel, bonds: Bonds) -> Array | None:
    return each_point("shape_tensor", model, bonds)


def _by_numpy(of: Callable[[Bonds], np.ndarray], bonds: Bonds) -> np.ndarray:
    cuts = range(0, len(bonds.xi), CHUNK)
    return np.concatenate([of(jax.tree.map(lambda x, at=at: x[at : at + CHUNK], bonds)) for at in cuts])


def _refuse(model: AbstractModel, families: LatticeFamily | Families) -> None:
    """Raise ValueError if a tensor is singular, with the index of the point. All values are known, not traced."""
    points, bonds = _at_rest(families)
    of = model.shape_tensor
    if of is shape_tensor_K or of is shape_tensor_L:
        tensors = _by_numpy(of, bonds)
    else:
        if not isinstance(families, LatticeFamily):
            varying, shared = split_model(model, len(families))
            model = eqx.combine(jax.tree.map(lambda x: x[points], varying), shared)
        if eqx.filter_eval_shape(_by_program, model, bonds) is None:
            return
        tensors = np.asarray(_by_program(model, bonds))
    tensors = tensors.astype(float)
    values = np.linalg.eigvalsh((tensors + tensors.mT) / 2)
    # Rounding leaves an exactly singular tensor with a ratio of smallest to largest eigenvalue below 4 eps
    # (measured: 1e-16, in float32 3e-8).
    least = 1e-10 if bonds.xi.dtype == np.float64 else 1e-6
    bad = ~(values[..., 0] > least * values[..., -1])
    # An empty family exerts no force, so no model needs its tensor.
    bad &= (bonds.omega > 0).any(axis=-1).reshape(-1, *(1,) * (bad.ndim - 1))
    if not bad.any():
        return
    i = int(np.flatnonzero(bad)[0]) if bad.ndim == 1 else int(np.argwhere(bad)[0, 0])
    single = isinstance(families, LatticeFamily)
    where = "this lattice family" if single else f"the family of point {points[i]}"
    if bad.ndim == 2:
        b = int(np.argwhere(bad)[0, 1])
        reference = ", ".join(f"{x:.4g}" for x in bonds.xi[i, b])
        raise ValueError(
            f"{type(model).__name__} needs an invertible shape tensor for every bond's own family, and that of bond"
            f" {b}, ξ = ({reference}), of {where} is singular ({int(bad.sum())} such bonds): its members do not"
            " span enough directions; take a larger r or horizon, or another model"
        )
    where += "" if single else f" ({int(bad.sum())} such points)"
    if values[i, 0] < -least * np.abs(values[i]).max():
        raise ValueError(
            f"{type(model).__name__} needs a positive definite shape tensor, and that of {where} has the eigenvalue"
            f" {values[i, 0]:.3g}, because bonds have negative weights; use smaller negative weights"
        )
    count = int((bonds.omega[i] > 0).sum())
    raise ValueError(
        f"{type(model).__name__} needs an invertible shape tensor, and that of {where} is singular: its {count}"
        " bonds do not span enough directions; take a larger horizon or another model"
    )


def _tensors_of(families: LatticeFamily | Families) -> Callable[[AbstractModel], Array | None]:
    """The tensors of all families as a function of the model. Tracing it shows on which constants they depend."""
    points = 1 if isinstance(families, LatticeFamily) else len(families)
    bonds = families.xi.shape[-2] if families.xi is not None else len(families.grid.offsets)  # type: ignore[union-attr]
    sizes = ((points, bonds, families.dim), (points, bonds, families.dim), (points, bonds), (points, bonds), (points,))
    return lambda model: each_point("shape_tensor", model, Bonds(*map(jnp.zeros, sizes)))


def check_shape_tensors(model: AbstractModel, families: LatticeFamily | Families) -> None:
    """Raise ValueError if the model cannot invert a shape tensor of these families, whose values must be known.

    Nothing is checked if the tensor depends on a constant of the model that is traced.
    """
    of = model.shape_tensor
    if of is shape_tensor_K or of is shape_tensor_L:
        remember(families, ("invertible", of), lambda: _refuse(model, families))
        return
    known = known_part(families, "shape tensors", _tensors_of(families), model)
    if known is not None:
        key, there = known
        remember(families, ("invertible", key), lambda: _refuse(there, families))
