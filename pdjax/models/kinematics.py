"""Kinematics of one family: bond strains, shape tensors, nonlocal deformation gradient and nonlocal strain.

ξ is a bond of the reference configuration, η the difference of the displacements of its ends, ω its influence and V the
volume of the neighbour. With w_j = ω_j V_j, n = ξ/|ξ|, Y = ξ + η and the stretch s = |Y|/|ξ| of the bond:

    g = (2 ξ·η + η·η)/|ξ|²,   ℓ = log s = ½ log1p(g)                 (no cancellation at tiny strain)
    e_m = (s^{2m} − 1)/2m = ℓ φ(2mℓ),   φ(x) = expm1(x)/x             (m = 0: Hencky, the same formula)
    K = Σ w ξ⊗ξ,   L = Σ w n⊗n⊗n⊗n,   F̄ = I + (Σ w η⊗ξ) K⁻¹,   Ē_m = L⁻¹ : Σ w e_m n⊗n

Symmetric tensors are stored as Mandel vectors, (A₁₁, …, √2 A₁₂, …). A:B is then a dot product and L a symmetric
p × p matrix, p = d(d+1)/2.

φ is computed as φ(x) = exp(x/2) sinhc(x/2), with the even Taylor series of sinhc where |x| ≤ 2. It is smooth in s and
in m, with accurate third derivatives and beyond. A `where` between (s^{2m} − 1)/2m and log s would give wrong
derivatives at m = 0.

Sources: Silling et al. 2007 (K, F̄); Foster & Xu 2018 and Behzadinasab & Foster (L, Ē_m); Seth 1961, Hill 1968.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._internal.public import public_function
from ..geometry.bonds import Bonds


def _sinhc(y: Float[Array, "..."]) -> Float[Array, "..."]:
    """sinh(y)/y for |y| ≤ 1, with every derivative to rounding (9 terms: 1/19! = 8e-18)."""
    square = y**2
    series = jnp.ones_like(square)
    for n in range(9, 0, -1):
        series = 1 + series * square / (2 * n * (2 * n + 1))
    return series


def expm1_over(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """φ(x) = (eˣ − 1)/x [-], φ(0) = 1, with accurate derivatives of every order."""
    small = jnp.abs(x) <= 2
    root = jnp.exp(x / 2)
    near, far = jnp.where(small, x, 0), jnp.where(small, 4, x)
    return jnp.where(small, root * _sinhc(near / 2), (root * root - 1) / far)  # no cancellation beyond |x| = 2


@jax.custom_jvp
def log1p(g: Float[Array, "..."]) -> Float[Array, "..."]:
    """log(1 + g) [-] for g > −1, with a relative error of 5e-16; NaN for g < −1, −∞ at −1.

    In float64 on a CPU it takes a third of the time of `jnp.log1p` (0.8 instead of 2.7 ns).

    With 1 + g = 2^k f, f in [1/√2, √2], d = f − 1 and t = d/(2 + d), the logarithm is k log 2 + 2 artanh t, and 11
    terms of the series of artanh are enough. The quotient t is written as a product with a reciprocal on purpose: XLA
    moves a plain division through the products that follow and then divides in each of them.

    JAX forgets the derivative below in the reverse derivative of a loop (`jax.lax.scan`). A forward derivative of that
    one then goes through the formulas here. So f is q times a constant power of 2, and not made from the bits of q.
    """
    if g.dtype != jnp.float64:
        return jnp.log1p(g)
    q = 1 + g
    bits = jax.lax.bitcast_convert_type(q, jnp.uint64)
    exponent = jax.lax.shift_right_logical(bits, jnp.uint64(52)) | jnp.uint64(0x4330000000000000)
    k = jax.lax.bitcast_convert_type(exponent, jnp.float64) - (2.0**52 + 1023)  # 2^52 + n holds n in its last bits
    field = jnp.uint64(0x7FF0000000000000)  # of the exponent; with all its bits turned over it belongs to 2^(1 − k)
    twice = q * jax.lax.bitcast_convert_type((bits & field) ^ field, jnp.float64)
    upper = twice > 2 * math.sqrt(2)
    f, k = twice * jnp.where(upper, 0.25, 0.5), jnp.where(upper, k + 1, k)
    d = jnp.where(k == 0, g, f - 1)  # for k = 0 use g itself, because 1 + g has lost its last digits
    t = d * (1 / (2 + d))
    square = t * t
    series = jnp.full_like(square, 1 / 23)
    for n in range(10, 0, -1):
        series = series * square + 1 / (2 * n + 1)
    found = k * math.log(2) + (2 * t + 2 * t * square * series)
    return jnp.where((q > 0) & (q < jnp.inf), found, jnp.where(q == 0, -jnp.inf, jnp.where(q == jnp.inf, q, jnp.nan)))


@log1p.defjvp
def _log1p_jvp(primals, tangents):
    (g,), (dg,) = primals, tangents
    return log1p(g), dg * (1 / (1 + g))


@public_function
def log_stretch(xi: Float[Array, "... dim"], eta: Float[Array, "... dim"]) -> Float[Array, "..."]:
    """Compute the logarithmic stretch ℓ = log(|ξ + η|/|ξ|) of bonds.

    Parameters
    ----------
    xi : array, shape (..., dim)
        Bonds ξ of the reference configuration [length].
    eta : array, shape (..., dim)
        Differences η of the displacements of their ends [length].

    Returns
    -------
    array, shape (...)
        ℓ [-].

    Notes
    -----
    The formula uses the displacement and therefore has no cancellation at small strain. A bond that almost collapses
    loses digits: the relative error is 1e-14 at the stretch s = 1e-2 and 3e-10 at s = 1e-4.

    Examples
    --------
    All digits of a strain of 1e-9 are kept:

    >>> print(f"{float(jax.jit(pd.log_stretch)(np.array([1.0, 0.0]), np.array([1e-9, 0.0]))):.10g}")
    9.999999995e-10
    """
    return 0.5 * log1p(_growth(xi, eta))


def _growth(xi: Float[Array, "... dim"], eta: Float[Array, "... dim"]) -> Float[Array, "..."]:
    """g = s² − 1 [-]."""
    return jnp.sum((2 * xi + eta) * eta, axis=-1) / jnp.sum(xi * xi, axis=-1)


def growth_and_stretch(
    xi: Float[Array, "... dim"], eta: Float[Array, "... dim"]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """g = s² − 1 and s [-]. With them s − 1 = g/(1 + s) and (s − 1)/s = g/(1 + g + s), without cancellation."""
    g = _growth(xi, eta)
    return g, jnp.sqrt(1 + g)


def stretch_minus_one(xi: Float[Array, "... dim"], eta: Float[Array, "... dim"]) -> Float[Array, "..."]:
    """s − 1 = g/(1 + √(1 + g)) [-], without cancellation at small strain and without a logarithm."""
    g, s = growth_and_stretch(xi, eta)
    return g / (1 + s)


def seth_hill(ell: Float[Array, "..."], m) -> Float[Array, "..."]:
    """e_m = (s^{2m} − 1)/2m [-] from ℓ = log s, for any real m; e_0 = ℓ."""
    return ell * expm1_over(2 * m * ell)


ORDERS = (1.0, 0.5, 0.0, -0.5, -1.0)  # orders m whose bond strains need no power of the stretch


def bond_strain(xi: Float[Array, "... dim"], eta: Float[Array, "... dim"], m) -> Float[Array, "..."]:
    """e_m = (s^{2m} − 1)/2m [-] of bonds. An m of ORDERS given as a Python float needs no exponential."""
    g = _growth(xi, eta)
    if not isinstance(m, float):
        return seth_hill(0.5 * log1p(g), m)
    if m == 1.0:
        return 0.5 * g
    if m == 0.0:
        return 0.5 * log1p(g)
    if m == -1.0:
        return 0.5 * g / (1 + g)
    s = jnp.sqrt(1 + g)
    return g / (1 + s) if m == 0.5 else g / (s * (1 + s))


def power_over_square(xi: Float[Array, "... dim"], eta: Float[Array, "... dim"], m) -> Float[Array, "..."]:
    """s^{2m}/s² [-] of bonds, the derivative of e_m with respect to s²/2. An m of ORDERS as in `bond_strain`."""
    g = _growth(xi, eta)
    if not isinstance(m, float):
        return jnp.exp((m - 1) * log1p(g))
    if m == 1.0:
        return jnp.ones_like(g)
    inverse = 1 / (1 + g)
    if m == 0.0:
        return inverse
    if m == -1.0:
        return inverse * inverse
    root = jnp.sqrt(inverse)
    return root if m == 0.5 else root * inverse


def mandel_basis(dim: int) -> np.ndarray:
    """The orthonormal basis (p, dim, dim) of symmetric tensors, p = dim(dim+1)/2."""
    basis = []
    for i in range(dim):
        basis.append(np.zeros((dim, dim)))
        basis[-1][i, i] = 1
    for i in range(dim):
        for j in range(i + 1, dim):
            basis.append(np.zeros((dim, dim)))
            basis[-1][i, j] = basis[-1][j, i] = np.sqrt(0.5)
    return np.stack(basis)


def to_mandel(A: Float[Array, "... dim dim"]) -> Float[Array, "... p"]:
    """Mandel vector of (the symmetric part of) a tensor."""
    basis = jnp.asarray(mandel_basis(A.shape[-1]), dtype=A.dtype)
    return jnp.einsum("...ij,pij->...p", A, basis)


def from_mandel(v: Float[Array, "... p"], dim: int) -> Float[Array, "... dim dim"]:
    """The symmetric tensor of a Mandel vector."""
    return jnp.einsum("...p,pij->...ij", v, jnp.asarray(mandel_basis(dim), dtype=v.dtype))


def direction_mandel(xi: Float[Array, "... dim"]) -> Float[Array, "... p"]:
    """n⊗n of a bond as a Mandel vector (unit length), n = ξ/|ξ|."""
    return to_mandel(xi[..., :, None] * xi[..., None, :]) / jnp.sum(xi * xi, axis=-1)[..., None]


@public_function
def shape_tensor_K(bonds: Bonds) -> Float[Any, "*points dim dim"]:
    """Compute the shape tensor K = Σ w ξ⊗ξ of one family, or of many families.

    Parameters
    ----------
    bonds : Bonds
        Bonds of one family, from `family.bonds(F)`, or of many along leading axes, from `families.bonds(u)`.

    Returns
    -------
    array, shape (..., dim, dim)
        K [length^(dim+2)]. It is a NumPy array if `bonds.xi` is one.

    References
    ----------
    Silling et al. 2007.

    Examples
    --------
    A horizon of two spacings has the neighbours (1, 0), (1, 1), (2, 0) and their images: K₁₁ = 2 + 4 + 8.

    >>> bonds = pd.lattice_family(2, 2).bonds(np.eye(2))
    >>> print(np.asarray(pd.shape_tensor_K(bonds)))
    [[14. 0.]
     [ 0. 14.]]
    """
    w = bonds.omega * bonds.volume
    if isinstance(bonds.xi, np.ndarray):
        return (w[..., None] * bonds.xi).mT @ bonds.xi
    return jnp.einsum("...b,...bi,...bj->...ij", w, bonds.xi, bonds.xi)


@public_function
def shape_tensor_L(bonds: Bonds) -> Float[Any, "*points p p"]:
    """Compute the fourth-order shape tensor L = Σ w n⊗n⊗n⊗n as a Mandel matrix.

    Parameters
    ----------
    bonds : Bonds
        Bonds of one family, from `family.bonds(F)`, or of many along leading axes, from `families.bonds(u)`.

    Returns
    -------
    array, shape (..., p, p)
        L [length^dim], p = dim (dim + 1)/2. The Mandel vector of a symmetric A in 2D is (A₁₁, A₂₂, √2 A₁₂).

    References
    ----------
    Foster & Xu 2018; Behzadinasab & Foster.

    Examples
    --------
    >>> bonds = pd.lattice_family(2, 2).bonds(np.eye(2))
    >>> print(np.asarray(pd.shape_tensor_L(bonds)).round(12))
    [[5. 1. 0.]
     [1. 5. 0.]
     [0. 0. 2.]]
    """
    w, xi = bonds.omega * bonds.volume, bonds.xi
    if isinstance(xi, np.ndarray):
        i, j = np.nonzero(mandel_basis(xi.shape[-1]))[1:]
        first = i <= j  # the basis tensor of two different components lists their product twice
        i, j = i[first], j[first]
        v = xi[..., i] * xi[..., j] * (np.where(i == j, 1.0, np.sqrt(2)) / np.sum(xi * xi, axis=-1)[..., None])
        return (w[..., None] * v).mT @ v
    v = direction_mandel(xi)
    return jnp.einsum("...b,...bp,...bq->...pq", w, v, v)


def solve_positive(A: Float[Array, "n n"], b: Array) -> Array:
    """A⁻¹ b for a small symmetric positive definite A (n ≤ 6) and b (n,) or (n, k), by LDLᵀ written out.

    Plain arithmetic fuses and batches. The LAPACK call behind `jnp.linalg.solve` is slower on 10⁴ small matrices, and
    on two cores it was seen to hang at 5·10⁴ of them (jax 0.10: its threads wait for each other).
    """
    n = A.shape[0]
    L: list[list[Array | float]] = [[0.0] * n for _ in range(n)]
    D: list[Array] = []
    for i in range(n):
        for j in range(i):
            L[i][j] = (A[i, j] - sum(L[i][k] * D[k] * L[j][k] for k in range(j))) / D[j]
        D.append(A[i, i] - sum(L[i][k] ** 2 * D[k] for k in range(i)))
    x: list[Array] = []
    for i in range(n):
        x.append(b[i] - sum(L[i][k] * x[k] for k in range(i)))
    x = [value / pivot for value, pivot in zip(x, D, strict=True)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum(L[k][i] * x[k] for k in range(i + 1, n))
    return jnp.stack(x)


def gradient_moments(bond: Bonds) -> tuple[Float[Array, "dim dim"], Float[Array, "dim dim"]]:
    """The terms of one bond in the sums K and M = Σ w η⊗ξ."""
    weighted = bond.omega * bond.volume * bond.xi
    return jnp.outer(weighted, bond.xi), jnp.outer(bond.eta, weighted)


def gradient_of_moments(K: Float[Array, "dim dim"], M: Float[Array, "dim dim"]) -> Float[Array, "dim dim"]:
    """F̄ − I = M K⁻¹ [-]."""
    return solve_positive(K, M.T).T


def displacement_gradient(bonds: Bonds) -> Float[Array, "dim dim"]:
    """F̄ − I = (Σ w η⊗ξ) K⁻¹ [-], exact for every affine map and every family."""
    w = bonds.omega * bonds.volume
    moment = jnp.einsum("b,bi,bj->ij", w, bonds.xi, bonds.eta)
    return solve_positive(shape_tensor_K(bonds), moment).T


def bond_strain_moment(bonds: Bonds, m) -> Float[Array, " p"]:
    """Σ w e_m n⊗n as a Mandel vector [length^dim]."""
    w = bonds.omega * bonds.volume
    return (w * bond_strain(bonds.xi, bonds.eta, m)) @ direction_mandel(bonds.xi)


@public_function
def bond_average_strain(bonds: Bonds, m) -> Float[Array, " p"]:
    """Compute the nonlocal Seth–Hill strain Ē_m = L⁻¹ : Σ w e_m n⊗n of one family.

    Parameters
    ----------
    bonds : Bonds
        Bonds of one family, from `family.bonds(F)`.
    m : float
        Order m of the strain [-]; 1 is quadratic in the stretch, 0 logarithmic.

    Returns
    -------
    array, shape (p,)
        Ē_m [-] as a Mandel vector, p = dim (dim + 1)/2; in 2D (E₁₁, E₂₂, √2 E₁₂).

    Notes
    -----
    The strain is exact for similarities (a rotation times a uniform stretch), and for every affine map if m = 1. For
    other maps and orders it is exact to first order in the strain.

    References
    ----------
    Foster & Xu 2018; Behzadinasab & Foster.

    Examples
    --------
    A uniform stretch of 1.1 has the Green–Lagrange strain (1.1² − 1)/2 = 0.105:

    >>> bonds = pd.lattice_family(2, 2).bonds(1.1 * np.eye(2))
    >>> strain = jax.jit(pd.bond_average_strain)(bonds, 1.0)
    >>> print(np.abs(np.asarray(strain)).round(6))
    [0.105 0.105 0. ]
    """
    return solve_positive(shape_tensor_L(bonds), bond_strain_moment(bonds, m))


@public_function
def local_strain(F: Float[Array, "dim dim"], m) -> Float[Array, "dim dim"]:
    """Compute the classical Seth–Hill strain E_m(F) = (Cᵐ − I)/2m with C = FᵀF.

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-], det F > 0.
    m : float
        Order m of the strain [-]; 1 is Green–Lagrange, 0 is Hencky, ½ log C.

    Returns
    -------
    array, shape (dim, dim)
        E_m [-].

    Notes
    -----
    The computation uses no eigenvectors, so its derivatives are smooth where principal stretches are equal. In
    dimension d, C = c X, where c = (det C)^{1/d} is the mean squared stretch and X has the determinant 1. Then
    log C = log c I + log X, where log X = ∫₀¹ (X − I)(I + t(X − I))⁻¹ dt by 48 Gauss–Legendre points (the diagonal Padé
    approximant). Finally E_m = ½ log C φ(m log C), with φ from its matrix series
    by scaling and squaring. The error is of the size of rounding, 1e-13, for ratios of principal stretches up to 5
    (tests).

    References
    ----------
    Seth 1961; Hill 1968.

    Examples
    --------
    Hencky's strain of a stretch of 1.1 is log 1.1:

    >>> E = jax.jit(pd.local_strain)(np.diag([1.1, 1.0]), 0.0)
    >>> round(float(E[0, 0]), 4)
    0.0953
    """
    dim = F.shape[0]
    if dim == 1:
        return seth_hill(jnp.log(F), m)
    I = jnp.eye(dim, dtype=F.dtype)
    H = F - I
    C = I + H + H.T + H.T @ H
    mu = jnp.linalg.det(C) ** (1 / dim)
    D = (H + H.T + H.T @ H - (mu - 1) * I) / mu
    nodes, weights = np.polynomial.legendre.leggauss(48)
    t = jnp.asarray((nodes + 1) / 2, dtype=F.dtype)
    inverse = jax.vmap(lambda t: solve_positive(I + t * D, I))(t)
    log_X = jnp.einsum("q,qij->ij", jnp.asarray(weights / 2, dtype=F.dtype), D @ inverse)
    log_C = jnp.log(mu) * I + log_X
    # The Taylor series gives φ at A/2^6. Doubling returns to A: φ(2A) = φ(A)(e^A + I)/2 with e^A = I + A φ(A).
    doublings = 6
    A = m * log_C / 2**doublings
    phi = I
    for n in range(14, 0, -1):
        phi = I + A @ phi / (n + 1)
    for _ in range(doublings):
        phi = phi @ (I + A @ phi + I) / 2
        A = 2 * A
    E = log_C @ phi / 2
    return (E + E.T) / 2
