"""Load paths: one number a → a homogeneous deformation F(a), with F(0) = I.

A path is any function (a, model, family) → F (dim, dim), traced by JAX. Its attribute `symmetry` (default "inversion")
says what the deformed cubic lattice keeps, and so how far the Brillouin zone can be folded; `stretch` (default
False) says that 1 + a is a stretch, so that a > −1 is needed.

    hydrostatic      F = (1 + a) I
    uniaxial strain  F = diag(1 + a, 1, 1)
    uniaxial stress  F = diag(1 + a, b, b), b solved so that the lateral stress P₂₂ of the model on this family is 0
    simple shear     F = I + a e₁⊗e₂
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .._internal.checks import is_concrete
from .._internal.public import public_function
from ..force.fields import affine_stress
from ..geometry.bonds import LatticeFamily
from ..models.base import AbstractModel

Path = Callable[[Any, AbstractModel, LatticeFamily], Float[Array, "dim dim"]]


def check_stretch(a: Any) -> None:
    """Refuse loads, where they are known, whose stretch 1 + a is none."""
    if is_concrete(a):
        loads = np.atleast_1d(np.asarray(a, dtype=float))
        bad = ~(loads > -1)
        if bad.any():
            i = int(np.argmax(bad))
            which = f"a[{i}] = {loads[i]:g}" if np.ndim(a) else f"a = {loads[0]:g}"
            raise ValueError(f"a must be > -1, for 1 + a is a stretch of this path; got {which}")


def _keeps(symmetry: str, stretch: bool = True):
    def mark(path):
        @public_function
        @functools.wraps(path)
        def checked(a, model, family):
            if stretch:
                check_stretch(a)
            return path(a, model, family)

        checked.symmetry, checked.stretch = symmetry, stretch  # type: ignore[attr-defined]
        return checked

    return mark


@_keeps("cubic")
def hydrostatic(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """F = (1 + a) I; a > −1 is the stretch minus one [-]."""
    return (1 + a) * jnp.eye(family.dim, dtype=family.xi.dtype)


@_keeps("tetragonal")
def uniaxial_strain(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """F = diag(1 + a, 1, 1): no lateral motion."""
    return jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 0].add(a)


@_keeps("tetragonal")
def uniaxial_stress(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """F = diag(1 + a, b, b) with the lateral Piola stress zero (Newton; NaN where it finds no state)."""
    if family.dim == 1:
        return uniaxial_strain(a, model, family)
    lateral = jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 0].set(0)

    def stretched(log_b, a):
        return uniaxial_strain(a, model, family) + jnp.expm1(log_b) * lateral

    def lateral_stress(log_b, a, model, family):
        return affine_stress(model, family, stretched(log_b, a))[1, 1]

    eps = float(jnp.finfo(family.xi.dtype).eps)
    frozen = jax.lax.stop_gradient((a, model, family))
    found: optx.Solution = optx.root_find(
        lambda log_b, _: lateral_stress(log_b, *frozen),
        optx.Newton(rtol=64 * eps, atol=64 * eps),
        jnp.zeros((), family.xi.dtype),
        max_steps=50,
        throw=False,
    )
    exists = found.result == optx.RESULTS.successful
    at = jnp.where(exists, found.value, 0.0)
    # Newton's step from the root is the implicit function theorem: taken twice, it has exact derivatives to third order
    log_b = at
    for _ in range(2):
        value, slope = jax.jvp(lambda b: lateral_stress(b, a, model, family), (log_b,), (jnp.ones_like(at),))
        log_b = log_b - value / slope
    return stretched(jnp.where(exists, log_b, jnp.nan), a)


@_keeps("inversion", stretch=False)
def simple_shear(a, model: AbstractModel, family: LatticeFamily) -> Float[Array, "dim dim"]:
    """F = I + a e₁⊗e₂ (dim 2 or 3); a is the amount of shear [-]."""
    if family.dim == 1:
        raise ValueError("simple_shear needs dim 2 or 3; this family has dim 1")
    return jnp.eye(family.dim, dtype=family.xi.dtype).at[0, 1].add(a)


PATHS: dict[str, Path] = {
    "hydrostatic": hydrostatic,
    "uniaxial-strain": uniaxial_strain,
    "uniaxial-stress": uniaxial_stress,
    "simple-shear": simple_shear,
}


def path_symmetry(path: Path, family: LatticeFamily, isotropic: bool) -> str:
    """What the deformed lattice keeps along `path`: only inversion if its weights or its material prefer directions."""
    return getattr(path, "symmetry", "inversion") if family.cubic and isotropic else "inversion"
