"""Load paths: a homogeneous deformation gradient F(a) for each load a, with F(0) = I.

A path is any function (a, model, family) → F (dim, dim) that JAX can trace. pdjax searches the part of the Brillouin
zone that the symmetry of the deformed lattice leaves (`pdjax.infinite_lattice.brillouin`). The paths of this module are
registered with `_keeps(symmetry, stretch)`: the symmetry that they keep, and whether 1 + a is a stretch, which needs
a > −1. For any other path only the inversion symmetry is used, which always holds and takes more time.

    hydrostatic      F = (1 + a) I
    uniaxial strain  F = diag(1 + a, 1, 1)
    uniaxial stress  F = diag(1 + a, b, b), with b such that the lateral stress P₂₂ of the model on this family is zero
    simple shear     F = I + a e₁⊗e₂
"""

import functools
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from .._internal.checks import choice, is_concrete
from .._internal.implicit_step import implicit_root
from .._internal.public import public_function
from ..force.fields import affine_stress
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel

Path = Callable[[Array, AbstractModel, LatticeFamily], Float[Array, "dim dim"]]


def check_stretch(a: ArrayLike) -> None:
    """Raise ValueError for concrete loads whose stretch 1 + a is not positive."""
    if is_concrete(a):
        loads = np.atleast_1d(np.asarray(a, dtype=float))
        bad = ~(loads > -1)
        if bad.any():
            i = int(np.argmax(bad))
            which = f"a[{i}] = {loads[i]:g}" if np.ndim(a) else f"a = {loads[0]:g}"
            raise ValueError(f"a must be > -1, because this path stretches the lattice by 1 + a; got {which}")


class Kept(NamedTuple):
    """What a path keeps: the symmetry of the deformed lattice, and whether a load a is a stretch minus one."""

    symmetry: str
    stretch: bool


KEPT: dict[Callable, Kept] = {}  # of the paths of pdjax; any other path keeps the inversion alone


def _keeps(symmetry: str, stretch: bool = True):
    """Register what a path keeps, and check the loads that it is given."""

    def registered(path):
        @public_function
        @functools.wraps(path)
        def checked(a, model, family):
            if stretch:
                check_stretch(a)
            return path(a, model, family)

        KEPT[checked] = Kept(symmetry, stretch)
        return checked

    return registered


def is_stretch(path: Path) -> bool:
    """Whether the loads of a path are known to be stretches minus one."""
    return path in KEPT and KEPT[path].stretch


@_keeps("cubic")
def hydrostatic(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """Load path of equal stretches in all directions.

    F = (1 + a) I

    Parameters
    ----------
    a : float
        Stretch minus one [-], a > −1. Negative a is compression.
    model : AbstractModel
        The material model. This path does not depend on it.
    family : LatticeFamily
        One family of the lattice, which gives the dimension.

    Returns
    -------
    array, shape (dim, dim)
        Deformation gradient F [-].

    Raises
    ------
    ValueError
        If a concrete `a` is not greater than −1.

    Examples
    --------
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> np.asarray(pd.hydrostatic(0.5, model, pd.lattice_family(2, 2))).tolist()
    [[1.5, 0.0], [0.0, 1.5]]
    """
    return (1 + a) * jnp.eye(family.dim, dtype=family.xi.dtype)


@_keeps("tetragonal")
def uniaxial_strain(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """Load path of a stretch along the first axis without lateral motion.

    F = diag(1 + a, 1, 1)

    Parameters
    ----------
    a : float
        Stretch minus one [-] along the first axis, a > −1. Negative a is compression.
    model : AbstractModel
        The material model. This path does not depend on it.
    family : LatticeFamily
        One family of the lattice, which gives the dimension.

    Returns
    -------
    array, shape (dim, dim)
        Deformation gradient F [-].

    Raises
    ------
    ValueError
        If a concrete `a` is not greater than −1.

    Examples
    --------
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> np.asarray(pd.uniaxial_strain(0.5, model, pd.lattice_family(2, 2))).tolist()
    [[1.5, 0.0], [0.0, 1.0]]
    """
    return jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 0].add(a)


@_keeps("tetragonal")
def uniaxial_stress(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """Load path of a stretch along the first axis with free lateral sides.

    F = diag(1 + a, b, b), with b such that P₂₂ = 0

    P is the first Piola–Kirchhoff stress of the model on this family. Newton's method finds b.

    Parameters
    ----------
    a : float
        Stretch minus one [-] along the first axis, a > −1. Negative a is compression.
    model : AbstractModel
        The material model.
    family : LatticeFamily
        One family of the lattice. In 1D the path is the same as `uniaxial_strain`.

    Returns
    -------
    array, shape (dim, dim)
        Deformation gradient F [-]. Its lateral entries b are NaN if Newton's method finds no stress-free state.

    Raises
    ------
    ValueError
        If a concrete `a` is not greater than −1.

    Notes
    -----
    Derivatives of F in `a` and in the constants of `model` and `family` are exact up to the third order.

    Examples
    --------
    For a law linear in the Green–Lagrange strain in 2D, b² = 1 − ν (a² + 2a) with ν = λ/(λ + 2μ) = 1/3.

    >>> model = pd.Correspondence(pd.LinearElastic(1.0, 1.0))
    >>> F = jax.jit(pd.uniaxial_stress)(0.1, model, pd.lattice_family(2, 1))
    >>> round(float(F[1, 1]), 4), round((1 - 0.21 / 3) ** 0.5, 4)
    (0.9644, 0.9644)
    """
    if family.dim == 1:
        return uniaxial_strain(a, model, family)
    lateral = jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 0].set(0)

    def stretched(log_b, a):
        return uniaxial_strain(a, model, family) + jnp.expm1(log_b) * lateral

    def lateral_stress(log_b, a, model, family):
        return affine_stress(model, family, stretched(log_b, a))[1, 1]

    eps = float(jnp.finfo(family.xi.dtype).eps)
    frozen = jax.lax.stop_gradient((a, model, family))
    nothing = jnp.zeros((), family.xi.dtype)
    at_rest = (jnp.zeros_like(frozen[0]), *frozen[1:])
    # In units of the lateral modulus at rest the tolerance does not depend on the unit of pressure.
    _, modulus = jax.jvp(lambda b: lateral_stress(b, *at_rest), (nothing,), (jnp.ones_like(nothing),))
    found: optx.Solution = optx.root_find(
        lambda log_b, _: lateral_stress(log_b, *frozen) / modulus,
        optx.Newton(rtol=64 * eps, atol=64 * eps),
        nothing,
        max_steps=50,
        throw=False,
    )
    exists = found.result == optx.RESULTS.successful
    at = jnp.where(exists, found.value, 0.0)
    log_b = implicit_root(lambda b: lateral_stress(b, a, model, family), at, order=3)
    return stretched(jnp.where(exists, log_b, jnp.nan), a)


@_keeps("inversion", stretch=False)
def simple_shear(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """Load path of simple shear in the plane of the first two axes.

    F = I + a e₁⊗e₂

    Parameters
    ----------
    a : float
        Amount of shear [-], of either sign.
    model : AbstractModel
        The material model. This path does not depend on it.
    family : LatticeFamily
        One family of a lattice of dimension 2 or 3.

    Returns
    -------
    array, shape (dim, dim)
        Deformation gradient F [-].

    Raises
    ------
    ValueError
        If the family has dimension 1.

    Examples
    --------
    >>> model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    >>> np.asarray(pd.simple_shear(0.5, model, pd.lattice_family(2, 2))).tolist()
    [[1.0, 0.5], [0.0, 1.0]]
    """
    if family.dim == 1:
        raise ValueError("simple_shear needs dim 2 or 3; this family has dim 1")
    return jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 1].add(a)


PATHS: dict[str, Path] = {
    "hydrostatic": hydrostatic,
    "uniaxial-strain": uniaxial_strain,
    "uniaxial-stress": uniaxial_stress,
    "simple-shear": simple_shear,
}
"""The load paths by name. Functions such as `critical_load` take the path or its name."""


def named_path(path: Path | str) -> Path:
    """The load path itself, or the one with this name in `PATHS`."""
    if isinstance(path, str):
        return PATHS[choice("path", path, list(PATHS))]
    if not callable(path):
        raise ValueError(
            f"path must be a function (a, model, family) -> F, such as pd.hydrostatic, or one of {', '.join(PATHS)};"
            f" got {path!r}"
        )
    return path


def path_symmetry(path: Path, family: LatticeFamily, isotropic: bool) -> str:
    """The symmetry of the deformed lattice along `path`.

    It is "inversion" if the bond weights or the material are not isotropic.
    """
    return KEPT[path].symmetry if path in KEPT and family.cubic and isotropic else "inversion"
