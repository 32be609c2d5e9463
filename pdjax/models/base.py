"""What a material model is: an energy of one family, or two small functions of it.

    T_j = (1/V_j) ∂W/∂Y_j            force state [force/length^(2 dim)]

**By its energy** (`AbstractModel`): the model defines W(bonds). Automatic differentiation gives everything else.

**By a point state** (`PointStateModel`): the model defines `point_state(bonds) -> A`, which turns sums over the family
into what a bond needs, and `bond_force(A_here, A_there, bond) -> t`. Only A is exchanged between points. Such a force
state has a cheap exact derivative, ∂T_b/∂Y_c = δ_bc B_b + G_b R_c, with B = ∂t/∂η, G = ∂t/∂A, R = ∂A/∂η: one block for
each bond plus a product of rank dim A. Most models define A by the contribution of each bond to the sums,
`moments(bond) -> (reference, deformed)`, and by a function of the sums, `state(sums) -> A`. Then pdjax evaluates bodies
without any array over points × bonds (`pdjax.force.backends`).

**By the states of both ends** (`TwoStageModel`): the model defines `point_state(bonds) -> A`, linear in η, and
`bond_energy(A_here, A_there, bond) -> φ`, with W_i = Σ_j φ(A_i, A_j, bond). The second stage, also a sum over the
family, is the force on A,

    Λ_i = Σ_j [∂φ_ij/∂A_i + (V_j/V_i) ∂φ_ji/∂A_i],    T_ij = (1/V_j) [∂φ_ij/∂η_ij + Λ_i ∂A_i/∂η_ij]

so that f = Σ_j (T_ij − T_ji) V_j is the exact gradient of Σ V_i W_i. The force then reaches three rings of neighbours.

A model declares its properties as class attributes. The tests, the sparsity pattern and the choice of method use them.

A user may call a method of a model with concrete values, outside any compiled program. JAX would then compile every
operation separately, a hundred programs for one number. `one_program` compiles the method as a whole instead.
"""

import functools
import inspect
from collections.abc import Callable
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PyTree

from .._internal.checks import floats_to_arrays, inside_jit, is_concrete
from .._internal.shown import shown
from ..geometry.bonds import EACH_BOND, Bonds
from ..geometry.plane_sums import PlaneSums
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
    "keeps_reference",
    "dims",
)


class Sums(NamedTuple):
    """Sums over a family: the two trees of `moments` summed over its bonds, its horizon, and the dimension."""

    reference: PyTree
    deformed: PyTree
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
    """Base class of all models. A subclass that defines `energy(bonds) -> W` is a complete model.

    Fields given as Python floats become arrays of the current precision. A new value of such a field compiles nothing
    anew and has derivatives, so branch on it with `jnp.where`. A field that is not a material constant, such as a count
    or a choice, is an int or `eqx.field(static=True)`.

    Attributes
    ----------
    hyperelastic : bool
        The force is the gradient of an energy.
    objective : bool
        A rigid rotation of the deformed body rotates the forces and changes nothing else.
    balances_moments : bool
        The internal forces exert no moment.
    affine_exact : bool
        Every affine deformation has the law's exact stress, at surfaces too.
    moduli_exact : bool
        The tangent at rest inside a lattice is that of the law.
    rings : int
        Number of rings of neighbours that the force on a point depends on.
    needs_other_end : bool
        The force of a bond needs the state of its far end.
    even : bool
        The point state, and the contribution of each bond to its sums, do not change if ξ and η change their signs.
    additive : bool
        The force of a bond is linear in the point state (or has none) and odd in the bond, t(A, −ξ, −η) = −t(A, ξ, η).
        Then t(A_i) − t(A_j, −bond) = t(A_i + A_j).
    degree : int
        The moments are polynomials in η of this degree and the bond force is one of degree 1, both proportional to ω V.
        0 if they are not polynomials.
    keeps_reference : bool
        The sums over the reference configuration are those of the intact family, `bonds.reference`, after bonds have
        broken too. Otherwise they are those of the bonds that remain.
    dims : tuple of int
        Dimensions in which the model is defined.
    shared : tuple of str
        Names of the fields that hold an array which all points of a body share. Any other array whose first axis is as
        long as the body has points holds one value for each point.
    one_number : tuple of str
        Names of the fields that hold one number, or one number for each point of a body. pdjax refuses any other shape.

    Examples
    --------
    >>> class Springs(pd.AbstractModel):
    ...     c: float
    ...     def energy(self, bonds):
    ...         stretch = jnp.expm1(pd.log_stretch(bonds.xi, bonds.eta))
    ...         return 0.5 * self.c * jnp.sum(bonds.omega * bonds.volume * stretch**2)
    >>> pd.stability(Springs(1.0), pd.lattice_family(2, 2), np.eye(2)).verdict
    'stable'
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
    keeps_reference: ClassVar[bool] = False
    dims: ClassVar[tuple[int, ...]] = (1, 2, 3)
    shared: ClassVar[tuple[str, ...]] = ()  # names of fields that hold an array which all points share
    one_number: ClassVar[tuple[str, ...]] = ()  # names of fields that hold one number, or one for each point

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
        """True if the material prefers no direction (the lattice has its own). False unless this is known."""
        return False

    @property
    def by_moments(self) -> bool:
        """Whether the point state is made from sums over single bonds, `moments(bond)`."""
        return False

    def specialised(self) -> "AbstractModel":
        """The same model for prepared forces. A model may have a faster program for known values of its constants."""
        return self

    @property
    def has_shape_tensor(self) -> bool:
        """Whether the model inverts a shape tensor of the reference configuration."""
        return getattr(self.shape_tensor, "__func__", self.shape_tensor) is not AbstractModel.shape_tensor

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

    def extension_energies(self, sums: Callable[[int, int], np.ndarray]) -> np.ndarray:
        """W of every family under the unit extension ε = e_k⊗e_k along each axis k, up to a factor, (families, dim).

        `sums(power, order)` is Σ w |ξ|^power n_k^order for every family and axis. `surface_correction` needs this
        method; models without it refuse that correction.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no extension_energies(sums)")

    def cut_energy(self, sums: PlaneSums, uniform: bool) -> Array:
        """Energy per area that the bonds across a plane release when they break at the stretch s, over s².

        The unit is pressure · length. `sums` belong to the plane. If `uniform`, all bonds of the body have the stretch
        s, otherwise the crossing bonds alone. `CriticalStretch.from_fracture_energy` needs this method and refuses
        models without it.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no cut_energy(sums, uniform)")

    @one_program
    def local_energy(self, F: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """The classical energy density this model stands for, ψ(F); models without one refuse."""
        raise ValueError(
            f"{type(self).__name__} has no classical law behind it: criterion 'local' does not apply, and"
            " dispersion_error needs against='long waves'"
        )

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
    """Base class of models made of a point state A and of the force of a bond that depends on it.

    A subclass defines `bond_force(here, there, bond)`, and either `moments(bond)` with `state(sums)` or
    `point_state(bonds)`. The force state is their composition. The equations are in `pdjax.models.base`.

    Examples
    --------
    Springs whose force is that of the mean stretch of the family:

    >>> class MeanStretch(pd.PointStateModel):
    ...     c: float
    ...     def moments(self, bond):
    ...         weight = bond.omega * bond.volume
    ...         return weight * jnp.sum(bond.xi**2), weight * jnp.sum(bond.xi * bond.eta)
    ...     def state(self, sums):
    ...         return self.c * sums.deformed / sums.reference
    ...     def bond_force(self, here, there, bond):
    ...         return bond.omega * here * bond.xi
    >>> T = pd.force_state(MeanStretch(2.0), pd.lattice_family(1, 1), 1.1 * np.eye(1))
    >>> np.round(np.asarray(T).ravel(), 3).tolist()
    [0.2, -0.2]
    """

    by_state: ClassVar[bool] = True

    def moments(self, bond: Bonds) -> tuple[PyTree, PyTree]:
        """Contribution of one bond (ξ (dim,), η (dim,), ω, V scalars) to the sums of its family: a tree that depends on
        the reference configuration alone, and a tree of the deformation. A bond with ω = 0 contributes 0."""
        raise NotImplementedError

    def state(self, sums: Sums) -> PyTree:
        """A of a family from its sums."""
        raise NotImplementedError

    def energy_of_sums(self, sums: Sums) -> Float[Array, ""] | None:
        """The part of W [energy/length^dim] that is a function of the sums of the family, or None if there is none.

        W is this part plus the sum of `energy_of_bond`. A model that defines neither has its energy recorded by
        `energy`, which costs a run many times a force.
        """
        return None

    def energy_of_bond(self, sums: Sums, bond: Bonds) -> Float[Array, ""] | None:
        """The part of W [energy/length^dim] that belongs to one bond, given the sums of its family, or None."""
        return None

    @property
    def by_moments(self) -> bool:
        """Whether the point state is made from sums over single bonds."""
        return type(self).moments is not PointStateModel.moments

    def point_state(self, bonds: Bonds) -> PyTree:
        """A: an array or a tree of arrays, from sums over the family."""
        each = jax.vmap(self.moments, (EACH_BOND,))(bonds)
        reference, deformed = jax.tree.map(lambda x: jnp.sum(x, axis=0), each)
        return self.state(Sums(reference, deformed, bonds.horizon, bonds.xi.shape[-1]))

    def bond_force(self, here: PyTree, there: PyTree, bond: Bonds) -> Float[Array, " dim"]:
        """t [force/length^(2 dim)] on one bond (ξ (dim,), η (dim,), ω, V scalars)."""
        raise NotImplementedError

    def force_state(self, bonds: Bonds) -> Float[Array, "bonds dim"]:
        """T on every bond, every point of the family being in this point's own state (homogeneous deformation)."""
        state = self.point_state(bonds)
        return jax.vmap(self.bond_force, (None, None, EACH_BOND))(state, state, bonds)


class TwoStageModel(AbstractModel):
    """Base class of models whose bonds have an energy that depends on the point states of both ends.

    A subclass defines `point_state(bonds)`, linear in η, and `bond_energy(here, there, bond)`. The equations are in
    `pdjax.models.base`.

    Examples
    --------
    Springs of the mean displacement difference of both families:

    >>> class Mean(pd.TwoStageModel):
    ...     def point_state(self, bonds):
    ...         return jnp.sum((bonds.volume * bonds.omega)[:, None] * bonds.eta, axis=0)
    ...     def bond_energy(self, here, there, bond):
    ...         return 0.5 * bond.omega * bond.volume * jnp.sum((bond.eta + (here + there) / 2) ** 2)
    >>> energy = Mean().energy(pd.lattice_family(1, 1).bonds(1.1 * np.eye(1)))
    >>> round(float(energy), 4)
    0.01
    """

    rings: ClassVar[int] = 3
    needs_other_end: ClassVar[bool] = True

    def point_state(self, bonds: Bonds) -> PyTree:
        """A: an array or a tree of arrays, from sums over the family, linear in η."""
        raise NotImplementedError

    def bond_energy(self, here: PyTree, there: PyTree, bond: Bonds) -> Float[Array, ""]:
        """φ [energy/length^dim], the part of W that one bond brings (ξ (dim,), η (dim,), ω, V scalars)."""
        raise NotImplementedError

    def energy(self, bonds: Bonds) -> Float[Array, ""]:
        """W of a family whose points are all in this point's own state (homogeneous deformation)."""
        state = self.point_state(bonds)
        return jnp.sum(jax.vmap(self.bond_energy, (None, None, EACH_BOND))(state, state, bonds))
