"""The generalised finite-deformation model in a homogeneous deformation x = F X of a full lattice family.

    T⟨ξ⟩ = ω (n·(L⁻¹:S)·n) s^{2m−2} Y/|ξ|²,   Y = Fξ,  n = ξ/|ξ|,  s = |Y|/|ξ|
    L = Σ V ω n⊗n⊗n⊗n,   Ē_m = L⁻¹ : Σ V ω ((s^{2m} − 1)/(2m)) n⊗n

The Jacobian entry uses g⟨ξ⟩ = ω s^{2m−2} Y/|ξ|², P⟨ξ⟩ = L⁻¹ : n⊗n and the stress stiffness
H⟨ξ⟩ = ω (P:S) (s^{2m−2}/|ξ|²) [2(m−1) Y⊗Y/|Y|² + I]:

    ∂f(X)/∂x(X+η) = V² Σ_ξ (P⟨ξ⟩ : dS/dE : P⟨η−ξ⟩) g⟨ξ⟩ ⊗ g⟨η−ξ⟩      neighbours of neighbours
                  + 2V H⟨η⟩                                            neighbours
                  − 2V δ(0, η) Σ_ξ H⟨ξ⟩                                the point itself

All states are zero outside the family. The paper prints the same three terms; they contain no slip. At η = 0 the first
and the last term are the diagonal of the paper. The last term alone is its continuum limit.

Symbols: V is the volume of a point, ω the influence, S the stress and dS/dE the tangent of the law at Ē_m, η the vector
to the moved point. Source: Behzadinasab & Foster, section 3.1 (force state of a uniform deformation) and section 3.2
(general entry and diagonal of the Jacobian).
"""

import itertools

import jax.numpy as jnp
import numpy as np

from ..._internal.checks import is_concrete
from ._common import check_form, hydrostatic_strain


def dual_dyads(xi, weights):
    """P = L⁻¹ : n⊗n for every bond, with L = Σ w n⊗n⊗n⊗n on symmetric tensors (in Mandel's orthonormal basis).

    Takes xi (bonds, dim) [length] and the weights w = ωV (bonds,). Returns (bonds, dim, dim) [1/weight].
    """
    dim = xi.shape[1]
    basis = jnp.asarray(_mandel(dim), dtype=xi.dtype)
    n = xi / jnp.linalg.norm(xi, axis=1, keepdims=True)
    dyads = jnp.einsum("bi,bj,Aij->bA", n, n, basis)
    L = jnp.einsum("b,bA,bB->AB", weights, dyads, dyads)
    return jnp.einsum("bA,Aij->bij", jnp.linalg.solve(L, dyads.T).T, basis)


def _mandel(dim):
    """Mandel's orthonormal basis of the symmetric tensors (dim(dim + 1)/2, dim, dim)."""
    basis = np.zeros((dim * (dim + 1) // 2, dim, dim))
    for row, (i, j) in enumerate(itertools.combinations_with_replacement(range(dim), 2)):
        basis[row, i, j] = basis[row, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return basis


def check_family(xi, omega, tensor="L"):
    """Return `xi` and `omega` as arrays. Raise ValueError if a bond lacks its opposite or the tensor is singular."""
    if is_concrete(xi, omega):
        bonds, weights = np.asarray(xi, dtype=float), np.asarray(omega, dtype=float)
        gap = np.linalg.norm(bonds[:, None] + bonds[None, :], axis=-1)
        size = np.linalg.norm(bonds, axis=1)
        if gap.min(axis=1).max() > 1e-6 * size.min() or not np.allclose(weights[gap.argmin(axis=1)], weights):
            raise ValueError("xi and omega must be a full family: for every bond ξ also −ξ, with the same influence")
        n = bonds / size[:, None]
        dyads = np.einsum("bi,bj,Aij->bA", n, n, _mandel(bonds.shape[1])) if tensor == "L" else n
        if np.linalg.cond(np.einsum("b,bA,bB->AB", weights, dyads, dyads)) > 1e6:
            raise ValueError(f"xi must span the shape tensor {tensor}; these {len(bonds)} bonds leave it singular")
    return jnp.asarray(xi, dtype=jnp.result_type(xi, float)), jnp.asarray(omega, dtype=jnp.result_type(omega, float))


def pairs_that_sum_to(eta, xi):
    """1 where ξ_a + ξ_b = η, else 0, (bonds, bonds): these pairs are the common neighbours of X and X + η."""
    gap = eta - xi[:, None, :] - xi[None, :, :]
    shortest = jnp.min(jnp.sum(xi**2, axis=1))
    return (jnp.sum(gap**2, axis=-1) < 1e-6 * shortest).astype(xi.dtype)


def _states(xi, omega, volume, F, m, stress):
    """g (bonds, dim), P (bonds, dim, dim) and H (bonds, dim, dim), as the module's docstring defines them."""
    dim = xi.shape[1]
    y = xi @ F.T
    r2, y2 = jnp.sum(xi**2, axis=1), jnp.sum(y**2, axis=1)
    P = dual_dyads(xi, omega * volume)
    power = omega * (y2 / r2) ** (m - 1) / r2
    stiff = 2 * (m - 1) * jnp.einsum("bk,bl->bkl", y, y) / y2[:, None, None] + jnp.eye(dim, dtype=xi.dtype)
    return power[:, None] * y, P, (power * jnp.einsum("bij,ij->b", P, stress))[:, None, None] * stiff


def uniform_force_state(F, m, stress, xi, omega, volume):
    """Compute the force state T of every bond in the homogeneous deformation x = F X.

    T⟨ξ⟩ = ω (n·(L⁻¹:S)·n) s^{2m−2} Y/|ξ|²

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    stress : array, shape (dim, dim)
        S of the law at the nonlocal strain [pressure].
    xi : array, shape (bonds, dim)
        Bonds of a full family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].
    volume : float
        V [length^dim].

    Returns
    -------
    array, shape (bonds, dim)
        T [force/volume²].

    Raises
    ------
    ValueError
        If xi and omega are not a full family (with every bond also its opposite), or the bonds leave L singular.

    References
    ----------
    Behzadinasab & Foster, section 3.1, force state of a uniform deformation.

    Examples
    --------
    In 1D with N = 1, L = 2. At rest under S = 1 the two bonds carry ∓1/2.

    >>> xi = pd.closed_forms.lattice_bonds(1, 1)
    >>> T = pd.closed_forms.uniform_force_state(np.eye(1), 1.0, np.eye(1), xi, np.ones(2), 1.0)
    >>> T[:, 0].tolist()
    [-0.5, 0.5]
    """
    xi, omega = check_family(xi, omega)
    g, P, _ = _states(xi, omega, volume, jnp.asarray(F), m, stress)
    return jnp.einsum("bij,ij->b", P, stress)[:, None] * g


def jacobian_terms(eta, xi, omega, volume, F, m, stress, tangent):
    """Compute the three terms of the Jacobian entry ∂f_k(X)/∂x_l(X+η) in a homogeneous deformation.

    The terms come from the neighbours of neighbours, from the neighbours, and from the point itself:
    V² Σ_ξ (P⟨ξ⟩ : dS/dE : P⟨η−ξ⟩) g⟨ξ⟩ ⊗ g⟨η−ξ⟩,   2V H⟨η⟩,   −2V δ(0, η) Σ_ξ H⟨ξ⟩
    with g = ω s^{2m−2} Y/|ξ|², P = L⁻¹ : n⊗n and H = ω (P:S) (s^{2m−2}/|ξ|²) [2(m−1) Y⊗Y/|Y|² + I].

    Parameters
    ----------
    eta : array, shape (dim,)
        η [length], up to two horizons; 0 for the diagonal block.
    xi : array, shape (bonds, dim)
        Bonds of a full family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].
    volume : float
        V [length^dim].
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    stress : array, shape (dim, dim)
        S of the law at the nonlocal strain [pressure].
    tangent : array, shape (dim, dim, dim, dim)
        dS/dE of the law at the nonlocal strain [pressure].

    Returns
    -------
    array, shape (3, dim, dim)
        The three terms [pressure/length²].

    Raises
    ------
    ValueError
        If xi and omega are not a full family (with every bond also its opposite), or the bonds leave L singular.

    References
    ----------
    Behzadinasab & Foster, section 3.2, general entry of the Jacobian. For η = 0, k = l it is the diagonal there.

    Examples
    --------
    In 1D at rest, without stress, only the first term is left.

    >>> xi, one = pd.closed_forms.lattice_bonds(1, 1), np.ones((1, 1, 1, 1))
    >>> terms = pd.closed_forms.jacobian_terms(
    ...     np.zeros(1), xi, np.ones(2), 1.0, np.eye(1), 1.0, np.zeros((1, 1)), one)
    >>> (terms[:, 0, 0] + 0.0).tolist()
    [-0.5, 0.0, 0.0]
    """
    xi, omega = check_family(xi, omega)
    eta, F = (jnp.asarray(x, dtype=jnp.result_type(x, float)) for x in (eta, F))
    g, P, H = _states(xi, omega, volume, F, m, stress)
    pairs = pairs_that_sum_to(eta, xi)
    through = jnp.einsum("ab,aij,ijrs,brs,ak,bl->kl", pairs, P, tangent, P, g, g, optimize=True)
    shortest = jnp.min(jnp.sum(xi**2, axis=1))
    at_bond = (jnp.sum((xi - eta) ** 2, axis=1) < 1e-6 * shortest).astype(xi.dtype)
    at_self = (jnp.sum(eta**2) < 1e-6 * shortest).astype(xi.dtype)
    direct = 2 * volume * jnp.einsum("b,bkl->kl", at_bond, H)
    return jnp.stack([volume**2 * through, direct, -2 * volume * at_self * jnp.sum(H, axis=0)])


def jacobian_entry(eta, xi, omega, volume, F, m, stress, tangent):
    """Compute the exact Jacobian entry ∂f_k(X)/∂x_l(X+η) for any homogeneous deformation F.

    It is the sum of the three terms of `jacobian_terms`.

    Parameters
    ----------
    eta : array, shape (dim,)
        η [length], up to two horizons; 0 for the diagonal block.
    xi : array, shape (bonds, dim)
        Bonds of a full family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].
    volume : float
        V [length^dim].
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    stress : array, shape (dim, dim)
        S of the law at the nonlocal strain [pressure].
    tangent : array, shape (dim, dim, dim, dim)
        dS/dE of the law at the nonlocal strain [pressure].

    Returns
    -------
    array, shape (dim, dim)
        ∂f_k/∂x_l [pressure/length²].

    Raises
    ------
    ValueError
        If xi and omega are not a full family (with every bond also its opposite), or the bonds leave L singular.

    References
    ----------
    Behzadinasab & Foster, section 3.2, general entry of the Jacobian.

    Examples
    --------
    A bar with N = 1 at rest: moving the point two spacings away changes the force by V²/(4h²) = 1/4.

    >>> xi, one = pd.closed_forms.lattice_bonds(1, 1), np.ones((1, 1, 1, 1))
    >>> entry = pd.closed_forms.jacobian_entry(
    ...     np.array([2.0]), xi, np.ones(2), 1.0, np.eye(1), 1.0, np.zeros((1, 1)), one)
    >>> entry.tolist()
    [[0.25]]
    """
    return jnp.sum(jacobian_terms(eta, xi, omega, volume, F, m, stress, tangent), axis=0)


def static_integrand(here, there, form="corrected"):
    """Compute what the static equation sums over the bonds: T⟨ξ⟩(X) + T⟨ξ⟩(X+ξ).

    In a homogeneous state it equals 2T.

    Parameters
    ----------
    here : array, shape (bonds, dim)
        T⟨ξ⟩(X) [force/volume²].
    there : array, shape (bonds, dim)
        T⟨ξ⟩(X+ξ) [force/volume²].
    form : {"corrected", "printed"}
        The paper prints the difference instead of the sum.

    Returns
    -------
    array, shape (bonds, dim)
        The integrand [force/volume²].

    Raises
    ------
    ValueError
        If form is none of the values above.

    Notes
    -----
    T⟨ξ⟩(X) = −T⟨−ξ⟩(X+ξ), so the difference in the equation of motion becomes a sum. The printed difference is
    zero for every bond and cannot equal 2T (slip S15). The conclusion of the paper, Σ T = 0 because T is odd, is
    right.

    References
    ----------
    Behzadinasab & Foster, section 3.1, the static equation of a uniform deformation.

    Examples
    --------
    >>> T = np.array([[-0.5], [0.5]])
    >>> pd.closed_forms.static_integrand(T, T)[:, 0].tolist()
    [-1.0, 1.0]
    """
    return here - there if check_form(form) == "printed" else here + there


def local_strain(F, m):
    """Compute the local Seth–Hill strain E_m = (C^m − I)/(2m), C = FᵀF; for m = 0 it is ½ log C.

    F = ∂x/∂X is the deformation gradient of the map from reference positions X to current positions x. The strain is
    computed from the eigenvectors of C. It is smooth in m, but its derivatives in F fail at repeated principal
    stretches. `pdjax.local_strain` has smooth derivatives there too.

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].

    Returns
    -------
    array, shape (dim, dim)
        E_m [-].

    References
    ----------
    Behzadinasab & Foster, section 2, the local analogue of the nonlocal Seth–Hill strain.

    Examples
    --------
    For m = 1 and a stretch of 1.1 it is (1.1² − 1)/2.

    >>> round(float(pd.closed_forms.local_strain(np.diag([1.1, 1.0]), 1.0)[0, 0]), 3)
    0.105
    """
    F = jnp.asarray(F)
    stretch2, axes = jnp.linalg.eigh(F.T @ F)
    return jnp.einsum("ia,a,ja->ij", axes, hydrostatic_strain(jnp.sqrt(stretch2) - 1, m), axes)


def nonlocal_strain(F, m, xi, omega):
    """Compute the nonlocal strain Ē_m = L⁻¹ : Σ ω ((s^{2m} − 1)/(2m)) n⊗n in the homogeneous deformation x = F X.

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    xi : array, shape (bonds, dim)
        Bonds of a full family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].

    Returns
    -------
    array, shape (dim, dim)
        Ē_m [-].

    Raises
    ------
    ValueError
        If xi and omega are not a full family (with every bond also its opposite), or the bonds leave L singular.

    References
    ----------
    Behzadinasab & Foster, section 2, nonlocal Cauchy–Green tensor and nonlocal Seth–Hill strain.

    Examples
    --------
    For m = 1 it equals the local strain.

    >>> xi = pd.closed_forms.lattice_bonds(2, 2)
    >>> round(float(pd.closed_forms.nonlocal_strain(np.diag([1.1, 1.0]), 1.0, xi, np.ones(12))[0, 0]), 3)
    0.105
    """
    xi, omega = check_family(xi, omega)
    s = jnp.linalg.norm(xi @ jnp.asarray(F).T, axis=1) / jnp.linalg.norm(xi, axis=1)
    return jnp.einsum("b,b,bij->ij", omega, hydrostatic_strain(s - 1, m), dual_dyads(xi, omega))


def strain_defect(F, m, xi, omega):
    """Compute the nonlocal strain minus the local one, Ē_m − E_m, in a homogeneous deformation.

    It is zero for m = 1 and for F = λQ with a rotation Q. Otherwise it is of second order in the strain (slip S12).

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    xi : array, shape (bonds, dim)
        Bonds of a full family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].

    Returns
    -------
    array, shape (dim, dim)
        Ē_m − E_m [-].

    Raises
    ------
    ValueError
        If xi and omega are not a full family (with every bond also its opposite), or the bonds leave L singular.

    References
    ----------
    Behzadinasab & Foster, section 2, the sentence after the nonlocal Seth–Hill strain.

    Examples
    --------
    A strain ten times larger has a difference a hundred times larger.

    >>> xi, one = pd.closed_forms.lattice_bonds(2, 2), np.ones(12)
    >>> defect = lambda e: abs(pd.closed_forms.strain_defect(np.diag([1 + e, 1.0]), 0.0, xi, one)).max()
    >>> round(float(defect(0.001) / defect(0.0001)))
    100
    """
    return nonlocal_strain(F, m, xi, omega) - local_strain(F, m)


def gradient_defect(F, xi, omega):
    """Compute F̄ − F = (Σ ω Y⊗ξ) K⁻¹ − F with K = Σ ω ξ⊗ξ.

    It is zero for every F and every family.

    Parameters
    ----------
    F : array, shape (dim, dim)
        Deformation gradient [-].
    xi : array, shape (bonds, dim)
        Bonds of a family [length].
    omega : array, shape (bonds,)
        Influence of the bonds [-].

    Returns
    -------
    array, shape (dim, dim)
        F̄ − F [-].

    References
    ----------
    Behzadinasab & Foster, section 2, nonlocal deformation gradient.

    Examples
    --------
    >>> xi = pd.closed_forms.lattice_bonds(2, 2)
    >>> bool(abs(pd.closed_forms.gradient_defect(np.diag([1.1, 0.8]), xi, np.ones(12))).max() < 1e-14)
    True
    """
    xi, F = jnp.asarray(xi), jnp.asarray(F)
    K = jnp.einsum("b,bi,bj->ij", jnp.asarray(omega), xi, xi)
    moment = jnp.einsum("b,bi,bj->ij", jnp.asarray(omega), xi @ F.T, xi)
    return jnp.linalg.solve(K, moment.T).T - F
