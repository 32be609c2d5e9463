"""What a material model is: an energy of one family, or small functions of it.

    T_j = (1/V_j) ∂W/∂Y_j            force state [force/length^(2 dim)]

**By its energy** (`AbstractModel`): W(bonds), and everything else follows by autodiff.

**By a point state** (`PointStateModel`): `point_state(bonds) -> A` (sums over the family turned into what a bond needs)
and `bond_force(A_here, A_there, bond) -> t`; only A travels between points. Such a force state has a cheap exact
derivative, ∂T_b/∂Y_c = δ_bc B_b + G_b R_c, with B = ∂t/∂η, G = ∂t/∂A, R = ∂A/∂η: a block for each bond plus a
product of rank dim A. Most give A by what each bond adds to the sums, `moments(bond) -> (reference, deformed)`, and
what the sums make, `state(sums) -> A`: then bodies are evaluated without an array over points and bonds
(`pdjax.force.backends`).

**By the states of both ends** (`TwoStageModel`): `point_state(bonds) -> A`, linear in η, and `bond_energy(A_here,
A_there, bond) -> φ`, W_i = Σ_j φ(A_i, A_j, bond). The second stage, also a sum over the family, is the force on A,

    Λ_i = Σ_j [∂φ_ij/∂A_i + (V_j/V_i) ∂φ_ji/∂A_i],    T_ij = (1/V_j) [∂φ_ij/∂η_ij + Λ_i ∂A_i/∂η_ij]

so that f = Σ_j (T_ij − T_ji) V_j is the exact gradient of Σ V_i W_i; it reaches three rings of neighbours.

A model declares its promises as class attributes; the tests, the sparsity and the choice of method read them.

A user may call a method of a model with known values, outside any program. JAX would then compile every operation by
itself, a hundred programs for one number, so `one_program` compiles the method as a whole.
"""

import functools
import inspect
from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._internal.checks import floats_to_arrays, inside_jit, is_concrete
from .._internal.shown import shown
from ..geometry.bonds import EACH_BOND, Bonds
from .kinematics import displacement_gradient

PROMISES = (
    "hyperelastic",
    "objective",
    "balances_moments",
    "affine_exact",
    "moduli_exact",
    "rings",
    "needs_other_end",
    "even",
    "additive",
    "degree",
    "dims",
)


class Sums(NamedTuple):
    """What a family adds up to: the two trees of `moments` summed over its bonds, its horizon, the dimension."""

    reference: Any
    deformed: Any
    horizon: Array
    dim: int


WHOLE = ("energy", "force_state", "point_state", "strain", "stress", "local_energy")  # methods that are one program


def one_program(method: Callable) -> Callable:
    """A method of a model as one compiled program where all values are known; the plain function inside a program."""
    compiled = eqx.filter_jit(method)

    @functools.wraps(method)
    def called(self, *args):
        plain = not is_concrete(self, args) or inside_jit()
        return method(self, *args) if plain else compiled(self, *args)

    return called


class AbstractModel(eqx.Module):
    """A model by its energy: subclass it, define `energy(bonds) -> W`, and everything else follows.

    Fields given as Python floats become arrays of the precision that is set then, so that another value compiles
    nothing anew and has derivatives: branch on them with `jnp.where`. A field that is not a number of the material (a
    count, a choice) is an int, or `eqx.field(static=True)`.

    Promises (class attributes): `hyperelastic` the force is the gradient of an energy; `objective` a rigid
    rotation of the deformed body turns the forces and changes nothing else; `balances_moments` internal forces exert no
    moment; `affine_exact` every affine map gives the law's exact stress, at surfaces too; `moduli_exact`
    the tangent at rest inside a lattice is the law's; `rings` how many rings of
    neighbours the force on a point reaches; `needs_other_end` a bond's force needs the state of its far end; `even` the
    point state of a family is that of its mirror image, ξ → −ξ, and so is what each bond adds to its sums; `additive` a
    bond's force is linear in the point state (or has none) and odd in the bond, t(A, −ξ, −η) = −t(A, ξ, η), so that
    t(A_i) − t(A_j, −bond) = t(A_i + A_j); `degree` moments are polynomials in η of this degree and the bond force one
    of degree 1, both in proportion to ω V (0: they are not); `dims` the dimensions it is defined in.
    """

    by_state: ClassVar[bool] = False  # a bond's force is a function of point states, `bond_force`
    hyperelastic: ClassVar[bool] = True
    objective: ClassVar[bool] = True
    balances_moments: ClassVar[bool] = True
    affine_exact: ClassVar[bool] = False
    moduli_exact: ClassVar[bool] = True
    rings: ClassVar[int] = 2
    needs_other_end: ClassVar[bool] = False
    even: ClassVar[bool] = True
    additive: ClassVar[bool] = False
    degree: ClassVar[int] = 0
    dims: ClassVar[tuple[int, ...]] = (1, 2, 3)
    shared: ClassVar[tuple[str, ...]] = ()  # names of fields that hold an array which all points share

    def __init_subclass__(cls, **kwargs):
        super().__init_subclass__(**kwargs)
        for name in WHOLE:
            if inspect.isfunction(cls.__dict__.get(name)):
                setattr(cls, name, one_program(cls.__dict__[name]))

    def __check_init__(self):
        floats_to_arrays(self)

    def __repr__(self) -> str:
        return shown(self)

    @property
    def isotropic(self) -> bool:
        """Promise: no direction of the material is preferred (the lattice's own apart). False unless known."""
        return False

    @property
    def by_moments(self) -> bool:
        """Whether the point state is made from sums over single bonds, `moments(bond)`."""
        return False

    @property
    def controlled(self) -> bool:
        """Whether the model has a control of zero-energy modes."""
        return getattr(getattr(self, "base", self), "control", None) is not None

    @one_program
    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        """W [energy/length^dim], the energy density of one family: one number.

        `bonds` has .xi (bonds, dim) the bonds at rest, .eta (bonds, dim) = u_j − u_i, so that xi + eta are the deformed
        ones, .omega (bonds,) the influence, .volume (bonds,) of the neighbours, .horizon.
        """
        other = "" if type(self).force_state is not AbstractModel.force_state else ", and no force_state(bonds) either"
        raise NotImplementedError(f"{type(self).__name__} defines no energy(bonds){other}")

    @one_program
    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        """T [force/length^(2 dim)] on every bond of the family: (1/V) ∂W/∂η."""

        def energy(eta):
            W = self.energy(bonds._replace(eta=eta))
            if jnp.shape(W) != ():
                raise ValueError(
                    f"{type(self).__name__}.energy must return one number, the energy density of the family (a sum over"
                    f" its bonds); got shape {jnp.shape(W)}"
                )
            return W

        return jax.grad(energy)(bonds.eta) / bonds.volume[:, None]

    def shape_tensor(self, bonds: Bonds) -> Float[Array, "*sub n n"] | None:
        """The matrix that must be invertible for this model to make sense, one for each bond if bonds have
        sub-families; None if there is none."""
        return None

    @one_program
    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """The classical energy density this model stands for, ψ(F); models without one refuse."""
        raise ValueError(f"{type(self).__name__} has no classical law behind it: criterion 'local' does not apply")

    @one_program
    def strain(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Green–Lagrange strain of F̄ [-], unless the model has its own measure."""
        H = displacement_gradient(bonds)
        return (H + H.T + H.T @ H) / 2

    @one_program
    def stress(self, bonds: Bonds) -> Float[Array, "dim dim"]:
        """Σ V T⊗ξ [pressure], the first Piola–Kirchhoff stress, unless the model has its law's own stress."""
        return jnp.einsum("b,bi,bj->ij", bonds.volume, self.force_state(bonds), bonds.xi)


class PointStateModel(AbstractModel):
    """A model by its two small functions; the force state is their composition."""

    by_state: ClassVar[bool] = True

    def moments(self, bond: Bonds) -> tuple[Any, Any]:
        """What one bond (ξ (dim,), η (dim,), ω, V scalars) adds to the sums of its family: a tree that depends on the
        reference configuration alone, and one of the deformation. A bond with ω = 0 adds 0."""
        raise NotImplementedError

    def state(self, sums: Sums) -> Any:
        """A of a family from its sums."""
        raise NotImplementedError

    @property
    def by_moments(self) -> bool:
        """Whether the point state is made from sums over single bonds."""
        return type(self).moments is not PointStateModel.moments

    def point_state(self, bonds: Bonds) -> Any:
        """A: an array or a tree of arrays, from sums over the family."""
        each = jax.vmap(self.moments, (EACH_BOND,))(bonds)
        reference, deformed = jax.tree.map(lambda x: jnp.sum(x, axis=0), each)
        return self.state(Sums(reference, deformed, bonds.horizon, bonds.xi.shape[-1]))

    def bond_force(self, here: Any, there: Any, bond: Bonds) -> Float[Array, " dim"]:
        """t [force/length^(2 dim)] on one bond (ξ (dim,), η (dim,), ω, V scalars)."""
        raise NotImplementedError

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        """T on every bond, every point of the family being in this point's own state (homogeneous deformation)."""
        state = self.point_state(bonds)
        return jax.vmap(self.bond_force, (None, None, EACH_BOND))(state, state, bonds)


class TwoStageModel(AbstractModel):
    """A model by the energies of its bonds, which look at the states of both their ends."""

    rings: ClassVar[int] = 3
    needs_other_end: ClassVar[bool] = True

    def point_state(self, bonds: Bonds) -> Any:
        """A: an array or a tree of arrays, from sums over the family, linear in η."""
        raise NotImplementedError

    def bond_energy(self, here: Any, there: Any, bond: Bonds) -> Float[Array, ""]:
        """φ [energy/length^dim], the part of W that one bond brings (ξ (dim,), η (dim,), ω, V scalars)."""
        raise NotImplementedError

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        """W of a family whose points are all in this point's own state (homogeneous deformation)."""
        state = self.point_state(bonds)
        return jnp.sum(jax.vmap(self.bond_energy, (None, None, EACH_BOND))(state, state, bonds))
