"""Hyperelastic material laws: the strain energy density of one point. The stress is its derivative.

The attribute `takes` says which tensor a law is a function of. A law with `takes = "E"` is a function of a (Seth–Hill)
strain tensor, and its stress is S = ∂Ψ/∂E. A law with `takes = "F"` is a function of the deformation gradient, and its
stress is the first Piola–Kirchhoff stress P = ∂ψ/∂F. Energies are per reference volume.

    LinearElastic   Ψ = ½ λ tr(E)² + μ E:E            (St. Venant–Kirchhoff if E is Green–Lagrange, Hencky for m = 0)
    NeoHookean      ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)²,  J = det F     (Simo & Pister 1984 family)

Constants are arrays, so a new value does not cause a new compilation. In a body a constant of shape (points,) varies
from point to point.

λ and μ are the Lamé constants of the 3D solid. The same formula in 2D describes **plane strain** (E₃₃ = 0), and in 1D
uniaxial strain. **Plane stress** needs other constants or another energy, which `plane="stress"` of `from_young` and
`from_bulk` selects. The linear law then uses λ′ = 2λμ/(λ + 2μ) instead of λ, which is exact. `NeoHookean` solves at
every point for the stretch F₃₃ = f normal to the plane: ∂ψ/∂f = 0 gives μ (f² − 1) + λ log(J₂ f) = 0, where J₂ is the
determinant of the 2D F.
"""

from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float, PyTree

from .._internal.checks import as_real, check_positive, choice, floats_to_arrays, is_concrete
from .._internal.implicit_step import implicit_root
from .._internal.shown import shown
from .plane import check_young_and_poisson


def _trace(A: Float[Array, "dim dim"]) -> Float[Array, ""]:
    """A : I by a product with the constant I, because `jnp.trace` masks the matrix first."""
    return jnp.tensordot(np.eye(len(A), dtype=A.dtype), A, 2)


class Law(eqx.Module):
    """Base class of material laws: the strain energy density of one point.

    A subclass sets `takes` and `isotropic` and defines `energy`. pdjax computes the stress by automatic
    differentiation. Fields given as Python floats become arrays, so that another value does not recompile and
    derivatives exist.

    Attributes
    ----------
    takes : "E" or "F"
        "E" for a law in a strain tensor, "F" for a law in the deformation gradient.
    isotropic : bool
        True promises that the law prefers no direction. pdjax then uses the symmetry of the lattice to search fewer
        wave vectors. If in doubt, set False.
    one_number : tuple of str
        Names of the fields that hold one number, or one number for each point of a body. pdjax refuses any other shape.

    Examples
    --------
    >>> class Quadratic(pd.Law):
    ...     k: float
    ...     takes, isotropic = "E", True
    ...     def energy(self, E): return 0.5 * self.k * jnp.sum(E * E)
    >>> law = Quadratic(2.0)
    >>> law, round(float(law.energy(jnp.diag(jnp.array([0.1, 0.0])))), 3)
    (Quadratic(k=2.0), 0.01)
    """

    takes: eqx.AbstractVar[str]
    isotropic: eqx.AbstractVar[bool]
    one_number: ClassVar[tuple[str, ...]] = ()

    def __check_init__(self):
        floats_to_arrays(self)

    def __repr__(self) -> str:
        return shown(self)

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        """Compute the strain energy density of one point.

        Parameters
        ----------
        tensor : array, shape (dim, dim)
            The strain E [-] or the deformation gradient F [-], as `takes` says.

        Returns
        -------
        array, shape ()
            Energy density [pressure], the unit of the moduli.
        """
        raise NotImplementedError


def _lame_of_young(young, poisson) -> tuple[ArrayLike, ArrayLike]:
    """(λ, μ) [pressure] of the 3D solid. ValueError for E ≤ 0 or ν outside (−1, ½), unless the values are traced."""
    check_young_and_poisson(young, poisson, ("E", "nu"))
    mu = young / (2 * (1 + poisson))
    return 2 * mu * poisson / (1 - 2 * poisson), mu


def _lame_of_bulk(bulk, shear) -> tuple[ArrayLike, ArrayLike]:
    """(λ, μ) [pressure] of the 3D solid. ValueError for K ≤ 0 or G < 0, unless the values are traced."""
    check_positive("K", bulk)
    if is_concrete(shear) and not np.all(np.isfinite(np.asarray(shear)) & (np.asarray(shear) >= 0)):
        raise ValueError(f"G must be finite and >= 0; got {shear}")
    return bulk - 2 * shear / 3, shear


PLANES = ("strain", "stress")


class LinearElastic(Law):
    """Linear elastic law in a strain tensor, Ψ = ½ λ tr(E)² + μ E:E.

    The stress is S = λ tr(E) I + 2 μ E, in 1D S = (λ + 2μ) E. The law is St. Venant–Kirchhoff where the model gives it
    the Green–Lagrange strain (`Correspondence`, `SethHill` of order 1), and Hencky's law in `SethHill` of order 0.

    λ and μ are the Lamé constants of the 3D solid. The same constants in 2D describe plane strain, and in 1D uniaxial
    strain. For plane stress make the law with `from_young` or `from_bulk` and `plane="stress"`.

    Parameters
    ----------
    lam : float or array, shape (points,)
        Lamé constant λ [pressure]. An array gives every point of a body its own value.
    mu : float or array, shape (points,)
        Shear modulus μ [pressure].

    Examples
    --------
    Under a uniaxial strain of 0.1 the energy is ½ λ (0.1)² + μ (0.1)²:

    >>> law = pd.LinearElastic(lam=1.0, mu=1.0)
    >>> round(float(law.energy(jnp.diag(jnp.array([0.1, 0.0])))), 3)
    0.015
    """

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    one_number: ClassVar[tuple[str, ...]] = ("lam", "mu")
    takes = "E"
    isotropic = True

    @classmethod
    def from_young(cls, E, nu, plane: str = "strain") -> "LinearElastic":
        """Make the law from Young's modulus and Poisson's ratio.

        Parameters
        ----------
        E : float or array, shape (points,)
            Young's modulus of the 3D solid [pressure], > 0.
        nu : float or array, shape (points,)
            Poisson's ratio of the 3D solid [-], between −1 and ½.
        plane : "strain" or "stress"
            "strain" keeps λ and μ of the solid: 3D, plane strain in 2D, uniaxial strain in 1D. "stress" replaces λ by
            2λμ/(λ + 2μ): plane stress, for 2D bodies.

        Returns
        -------
        LinearElastic
            The law.

        Raises
        ------
        ValueError
            If E or ν is out of range or `plane` is another word.

        Examples
        --------
        >>> pd.LinearElastic.from_young(E=1.0, nu=0.25)
        LinearElastic(lam=0.4, mu=0.4)
        >>> round(float(pd.LinearElastic.from_young(E=1.0, nu=0.25, plane="stress").lam), 4)
        0.2667
        """
        return cls._of(*_lame_of_young(E, nu), plane)

    @classmethod
    def from_bulk(cls, K, G, plane: str = "strain") -> "LinearElastic":
        """Make the law from the bulk modulus and the shear modulus.

        Parameters
        ----------
        K : float or array, shape (points,)
            Bulk modulus of the 3D solid [pressure], > 0.
        G : float or array, shape (points,)
            Shear modulus [pressure], ≥ 0.
        plane : "strain" or "stress"
            As for `from_young`.

        Returns
        -------
        LinearElastic
            The law.

        Raises
        ------
        ValueError
            If K or G is out of range or `plane` is another word.

        Examples
        --------
        >>> pd.LinearElastic.from_bulk(K=3.0, G=1.5)
        LinearElastic(lam=2.0, mu=1.5)
        """
        return cls._of(*_lame_of_bulk(K, G), plane)

    @classmethod
    def _of(cls, lam, mu, plane: str) -> "LinearElastic":
        in_plane = choice("plane", plane, PLANES) == "stress"
        return cls(2 * lam * mu / (lam + 2 * mu) if in_plane else lam, mu)  # type: ignore[call-arg]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return 0.5 * self.lam * _trace(tensor) ** 2 + self.mu * jnp.sum(tensor * tensor)


class NeoHookean(Law):
    """Compressible neo-Hookean law, ψ = ½ μ (tr FᵀF − d − 2 log J) + ½ λ (log J)².

    J = det F and d is the dimension. At small strain the law equals LinearElastic(λ, μ). Models in a strain tensor
    (`SethHill`, `TupekRadovitzky`) cannot use it, because it is a law in the deformation gradient.

    Parameters
    ----------
    lam : float or array, shape (points,)
        Lamé constant λ of the 3D solid [pressure].
    mu : float or array, shape (points,)
        Shear modulus μ [pressure].
    plane : "strain" or "stress"
        "strain" uses λ and μ in the formula as it stands: 3D, plane strain in 2D, uniaxial strain in 1D. "stress" is
        plane stress, for 2D bodies only: the law solves for the stretch F₃₃ normal to the plane at every point.

    References
    ----------
    Simo & Pister 1984 (the family of energies).

    Examples
    --------
    F = diag(2, ½) keeps the area, so the energy is ½ μ (4 + ¼ − 2):

    >>> law = pd.NeoHookean(lam=1.0, mu=1.0)
    >>> float(law.energy(jnp.diag(jnp.array([2.0, 0.5]))))
    1.125
    """

    lam: Float[Array, "..."] = eqx.field(converter=as_real)
    mu: Float[Array, "..."] = eqx.field(converter=as_real)
    plane: str = eqx.field(static=True, default="strain")
    one_number: ClassVar[tuple[str, ...]] = ("lam", "mu")
    takes = "F"
    isotropic = True

    def __check_init__(self):
        choice("plane", self.plane, PLANES)

    @classmethod
    def from_young(cls, E, nu, plane: str = "strain") -> "NeoHookean":
        """Make the law from Young's modulus and Poisson's ratio at small strain.

        Parameters
        ----------
        E : float or array, shape (points,)
            Young's modulus of the 3D solid at small strain [pressure], > 0.
        nu : float or array, shape (points,)
            Poisson's ratio of the 3D solid at small strain [-], between −1 and ½.
        plane : "strain" or "stress"
            As for the class.

        Returns
        -------
        NeoHookean
            The law.

        Raises
        ------
        ValueError
            If E or ν is out of range or `plane` is another word.

        Examples
        --------
        >>> pd.NeoHookean.from_young(E=1.0, nu=0.25)
        NeoHookean(lam=0.4, mu=0.4, plane='strain')
        """
        return cls(*_lame_of_young(E, nu), plane)  # type: ignore[call-arg, arg-type]

    @classmethod
    def from_bulk(cls, K, G, plane: str = "strain") -> "NeoHookean":
        """Make the law from the bulk modulus and the shear modulus at small strain.

        Parameters
        ----------
        K : float or array, shape (points,)
            Bulk modulus of the 3D solid at small strain [pressure], > 0.
        G : float or array, shape (points,)
            Shear modulus at small strain [pressure], ≥ 0.
        plane : "strain" or "stress"
            As for the class.

        Returns
        -------
        NeoHookean
            The law.

        Raises
        ------
        ValueError
            If K or G is out of range or `plane` is another word.

        Examples
        --------
        >>> pd.NeoHookean.from_bulk(K=3.0, G=1.5, plane="stress")
        NeoHookean(lam=2.0, mu=1.5, plane='stress')
        """
        return cls(*_lame_of_bulk(K, G), plane)  # type: ignore[call-arg, arg-type]

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        log_J = jnp.log(jnp.linalg.det(tensor))
        across: Array | None = None  # log F₃₃ in plane stress
        if self.plane == "stress":
            if tensor.shape[0] != 2:
                raise ValueError(f'plane="stress" is for bodies of dim 2; this one has dim {tensor.shape[0]}')
            across = _log_stretch_across(self.lam, self.mu, log_J)
        H = tensor - jnp.eye(tensor.shape[0], dtype=tensor.dtype)
        excess = 2 * _trace(H) + jnp.sum(H * H)  # tr FᵀF − d without cancellation
        if across is not None:
            excess, log_J = excess + jnp.expm1(2 * across), log_J + across
        return 0.5 * self.mu * (excess - 2 * log_J) + 0.5 * self.lam * log_J**2


def _log_stretch_across(lam: Array, mu: Array, log_J2: Array) -> Float[Array, ""]:
    """x = log F₃₃ of plane stress: the root of μ (e^{2x} − 1) + λ (x + log J₂), which is convex and grows with x.

    Newton's method starts right of the root, where both terms are positive, and therefore stays on that side. The
    derivatives of the root are exact up to the third order.
    """

    def residual(x, lam, mu, log_J2):
        return mu * jnp.expm1(2 * x) + lam * (x + log_J2)

    frozen = jax.lax.stop_gradient((lam, mu, log_J2))
    start = jnp.maximum(0.0, -frozen[2])

    def newton(_, x):
        lam, mu, _ = frozen
        return x - residual(x, *frozen) / (2 * mu * jnp.exp(2 * x) + lam)

    x = jax.lax.fori_loop(0, 60, newton, start)
    return implicit_root(lambda x: residual(x, lam, mu, log_J2), x, order=3)


class EnergyLaw(Law):
    """Material law from a user's energy function.

    pdjax computes the stress by automatic differentiation. Energy and stress should be zero in the undeformed state.
    The function alone decides what the constants mean. If it has the form of `LinearElastic` with λ and μ of the 3D
    solid, a 2D body is in plane strain.

    Parameters
    ----------
    function : callable
        Energy density [pressure] as a function (tensor, constants) → scalar, written with `jax.numpy`.
    takes : "E" or "F"
        The tensor: "E" for a strain tensor, "F" for the deformation gradient.
    constants : tree of arrays
        Passed to `function`. The constants are traced, so results can be differentiated with respect to them.
    isotropic : bool
        True promises that the law prefers no direction.
    shared : tuple of str
        Names of the constants that are arrays which all points of a body share. Any other array whose first axis is as
        long as the body has points holds one value for each point.

    Raises
    ------
    ValueError
        If `takes` is another word.

    Examples
    --------
    >>> def stiffening(E, c):
    ...     return 0.5 * c["k"] * jnp.sum(E**2) + c["b"] * jnp.sum(E**2) ** 2
    >>> pd.EnergyLaw(stiffening, takes="E", constants={"k": 2.0, "b": 5.0}, isotropic=True)
    EnergyLaw(function=stiffening, takes='E', constants={'b': 5.0, 'k': 2.0}, isotropic=True)
    """

    function: Callable[[Array, PyTree], Array] = eqx.field(static=True)  # type: ignore[misc]
    takes: str = eqx.field(static=True)
    constants: PyTree = eqx.field(converter=lambda tree: jax.tree.map(as_real, tree), default=())
    isotropic: bool = eqx.field(static=True, default=False)
    shared: tuple[str, ...] = eqx.field(static=True, default=())

    def __check_init__(self):
        choice("takes", self.takes, ("E", "F"))

    def energy(self, tensor: Float[Array, "dim dim"]) -> Float[Array, ""]:
        return self.function(tensor, self.constants)


def law_label(law: Law) -> str:
    """Short text of a law for figures and files: LinearElastic(lam=1, mu=1). Saved files are compared by it."""
    values = {name: getattr(law, name) for name in ("lam", "mu", "constants") if hasattr(law, name)}
    constants = ", ".join(f"{k}={np.asarray(v):g}" if np.ndim(v) == 0 else f"{k}=…" for k, v in values.items())
    function = getattr(law, "function", None)
    name = getattr(function, "__name__", None) or type(law).__name__
    return f"{name}({constants})"


def law_stress(law: Law, tensor: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """Stress of a law [pressure]: the symmetric S = ∂Ψ/∂E for a law in E, P = ∂ψ/∂F for a law in F."""
    gradient = jax.grad(law.energy)(tensor)
    return (gradient + gradient.T) / 2 if law.takes == "E" else gradient
