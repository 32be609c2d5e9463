"""The generalised finite-deformation model in a homogeneous deformation x = F X of a full lattice family.

    T⟨ξ⟩ = ω (n·(L⁻¹:S)·n) s^{2m−2} Y/|ξ|²,   Y = Fξ,  n = ξ/|ξ|,  s = |Y|/|ξ|
    L = Σ V ω n⊗n⊗n⊗n,   Ē_m = L⁻¹ : Σ V ω ((s^{2m} − 1)/(2m)) n⊗n

Jacobian entry, from g⟨ξ⟩ = ω s^{2m−2} Y/|ξ|², P⟨ξ⟩ = L⁻¹ : n⊗n and the stress stiffness
H⟨ξ⟩ = ω (P:S) (s^{2m−2}/|ξ|²) [2(m−1) Y⊗Y/|Y|² + I]:

    ∂f(X)/∂x(X+η) = V² Σ_ξ (P⟨ξ⟩ : dS/dE : P⟨η−ξ⟩) g⟨ξ⟩ ⊗ g⟨η−ξ⟩      neighbours of neighbours
                  + 2V H⟨η⟩                                            neighbours
                  − 2V δ(0, η) Σ_ξ H⟨ξ⟩                                the point itself

with all states zero off the family. Three terms, as printed: no slip was found in them. At η = 0 the first
and the last are the paper's diagonal; the last alone is its continuum limit.

Symbols: V volume of a point, ω influence, S stress and dS/dE tangent of the law at Ē_m, η vector to the
moved point. Source: Behzadinasab & Foster, section 3 (eqn:uniformT, the display before eqn:finaldf,
eqn:finaldf).
"""

import itertools

import jax.numpy as jnp
import numpy as np

from ..._internal.checks import is_concrete
from ._common import check_form, hydrostatic_strain


def dual_dyads(xi, weights):
    """P = L⁻¹ : n⊗n for every bond, L = Σ w n⊗n⊗n⊗n on symmetric tensors (Mandel's orthonormal basis).

    Arguments: xi (bonds, dim) [length]; weights w = ωV (bonds,). Returns: (bonds, dim, dim) [1/weight].
    """
    dim = xi.shape[1]
    basis = jnp.asarray(_mandel(dim), dtype=xi.dtype)
    n = xi / jnp.linalg.norm(xi, axis=1, keepdims=True)
    dyads = jnp.einsum("bi,bj,Aij->bA", n, n, basis)
    L = jnp.einsum("b,bA,bB->AB", weights, dyads, dyads)
    return jnp.einsum("bA,Aij->bij", jnp.linalg.solve(L, dyads.T).T, basis)


def _mandel(dim):
    basis = np.zeros((dim * (dim + 1) // 2, dim, dim))
    for row, (i, j) in enumerate(itertools.combinations_with_replacement(range(dim), 2)):
        basis[row, i, j] = basis[row, j, i] = 1.0 if i == j else np.sqrt(0.5)
    return basis


def check_family(xi, omega, tensor="L"):
    """`xi` and `omega` as arrays; ValueError if, seen now, a bond lacks its mirror or L is singular."""
    if is_concrete(xi, omega):
        bonds, weights = np.asarray(xi, dtype=float), np.asarray(omega, dtype=float)
        gap = np.linalg.norm(bonds[:, None] + bonds[None, :], axis=-1)
        size = np.linalg.norm(bonds, axis=1)
        if gap.min(axis=1).max() > 1e-6 * size.min() or not np.allclose(weights[gap.argmin(axis=1)], weights):
            raise ValueError("xi and omega must be a full family: with every bond its mirror, of the same influence")
        n = bonds / size[:, None]
        dyads = np.einsum("bi,bj,Aij->bA", n, n, _mandel(bonds.shape[1])) if tensor == "L" else n
        if np.linalg.cond(np.einsum("b,bA,bB->AB", weights, dyads, dyads)) > 1e6:
            raise ValueError(f"xi must span the shape tensor {tensor}; these {len(bonds)} bonds leave it singular")
    return jnp.asarray(xi, dtype=jnp.result_type(xi, float)), jnp.asarray(omega, dtype=jnp.result_type(omega, float))


def pairs_that_sum_to(eta, xi):
    """1 where ξ_a + ξ_b = η, else 0, (bonds, bonds): the middle points that X and X + η both see."""
    gap = eta - xi[:, None, :] - xi[None, :, :]
    shortest = jnp.min(jnp.sum(xi**2, axis=1))
    return (jnp.sum(gap**2, axis=-1) < 1e-6 * shortest).astype(xi.dtype)


def _states(xi, omega, volume, F, m, stress):
    """g (bonds, dim), P (bonds, dim, dim) and H (bonds, dim, dim) of the module's head."""
    dim = xi.shape[1]
    y = xi @ F.T
    r2, y2 = jnp.sum(xi**2, axis=1), jnp.sum(y**2, axis=1)
    P = dual_dyads(xi, omega * volume)
    power = omega * (y2 / r2) ** (m - 1) / r2
    stiff = 2 * (m - 1) * jnp.einsum("bk,bl->bkl", y, y) / y2[:, None, None] + jnp.eye(dim, dtype=xi.dtype)
    return power[:, None] * y, P, (power * jnp.einsum("bij,ij->b", P, stress))[:, None, None] * stiff


def uniform_force_state(F, m, stress, xi, omega, volume):
    """T of every bond in x = F X.

    Arguments: F (dim, dim) [-]; m () [-]; stress S (dim, dim) [pressure]; xi (bonds, dim) [length]; omega
    (bonds,) [-]; volume V () [length^d]. Returns: (bonds, dim) [force/volume²]. Raises: ValueError for xi,
    omega. Source: eqn:uniformT.
    """
    xi, omega = check_family(xi, omega)
    g, P, _ = _states(xi, omega, volume, jnp.asarray(F), m, stress)
    return jnp.einsum("bij,ij->b", P, stress)[:, None] * g


def jacobian_terms(eta, xi, omega, volume, F, m, stress, tangent):
    """The three terms of ∂f_k(X)/∂x_l(X+η): neighbours of neighbours, neighbours, the point itself.

    Arguments: eta (dim,) [length], up to two horizons, 0 for the diagonal block; xi (bonds, dim) a full
    family [length]; omega (bonds,) [-]; volume V () [length^d]; F (dim, dim) [-]; m () [-]; stress S (dim,
    dim) and tangent dS/dE (dim, dim, dim, dim) [pressure]. Returns: (3, dim, dim) [pressure/length²].
    Raises: ValueError for xi, omega. Source: the display before eqn:finaldf; η = 0, k = l is eqn:finaldf.
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
    """∂f_k(X)/∂x_l(X+η), exactly, for any homogeneous F: the sum of `jacobian_terms`.

    Arguments, raises and source: as `jacobian_terms`. Returns: (dim, dim) [pressure/length²].
    """
    return jnp.sum(jacobian_terms(eta, xi, omega, volume, F, m, stress, tangent), axis=0)


def static_integrand(here, there, form="corrected"):
    """What the static equation sums over the bonds: T[ξ](X) + T[ξ](X+ξ), which is 2T in a homogeneous state.

    Since T[ξ](X) = −T[−ξ](X+ξ), the difference of the equation of motion becomes a sum. Printed with a
    minus: then it is zero bond by bond and can not equal 2T (S15). The conclusion, Σ T = 0 by oddness,
    stands.

    Arguments: here T[ξ](X) and there T[ξ](X+ξ), (bonds, dim) [force/volume²]; form. Returns: (bonds, dim).
    Raises: ValueError for form. Source: the display after eqn:TforTwo.
    """
    return here - there if check_form(form) == "printed" else here + there


def local_strain(F, m):
    """E_m = (C^m − I)/(2m), C = FᵀF, log for m = 0; by eigenvectors, smooth in m, not at repeated stretches.

    Arguments: F (dim, dim) [-]; m () [-]. Returns: (dim, dim) [-]. Source: the local analog of eqn:strains.
    """
    F = jnp.asarray(F)
    stretch2, axes = jnp.linalg.eigh(F.T @ F)
    return jnp.einsum("ia,a,ja->ij", axes, hydrostatic_strain(jnp.sqrt(stretch2) - 1, m), axes)


def nonlocal_strain(F, m, xi, omega):
    """Ē_m = L⁻¹ : Σ ω ((s^{2m} − 1)/(2m)) n⊗n in x = F X.

    Arguments: F (dim, dim) [-]; m () [-]; xi (bonds, dim) [length]; omega (bonds,) [-]. Returns: (dim, dim)
    [-]. Raises: ValueError for xi. Source: eqn:C, eqn:strains.
    """
    xi, omega = check_family(xi, omega)
    s = jnp.linalg.norm(xi @ jnp.asarray(F).T, axis=1) / jnp.linalg.norm(xi, axis=1)
    return jnp.einsum("b,b,bij->ij", omega, hydrostatic_strain(s - 1, m), dual_dyads(xi, omega))


def strain_defect(F, m, xi, omega):
    """Ē_m − E_m: zero for m = 1 and for F = λQ, otherwise of second order in the strain (S12).

    Arguments, returns, raises: as `nonlocal_strain`. Source: the sentence after eqn:strains.
    """
    return nonlocal_strain(F, m, xi, omega) - local_strain(F, m)


def gradient_defect(F, xi, omega):
    """F̄ − F = (Σ ω Y⊗ξ) K⁻¹ − F, K = Σ ω ξ⊗ξ: zero for every F and every family.

    Arguments, returns: as `nonlocal_strain`, without m. Source: eqn:F.
    """
    xi, F = jnp.asarray(xi), jnp.asarray(F)
    K = jnp.einsum("b,bi,bj->ij", jnp.asarray(omega), xi, xi)
    moment = jnp.einsum("b,bi,bj->ij", jnp.asarray(omega), xi @ F.T, xi)
    return jnp.linalg.solve(K, moment.T).T - F
