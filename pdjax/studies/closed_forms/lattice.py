"""Exact hydrostatic forms on the simple cubic lattice, 1D to 3D, for S = λ tr(E) I + 2μE.

Diagonal, constant influence (the full form of what the paper sketches in 1D and 2D):

    ∂f_k/∂x_k = −(σ/(M h²)) (1+a)^{2m−2} [ c (1+a)^{2m}/M + 2 γ κ E_m(a) ]
    M = number of bonds,  σ = Σ 1/|p|²,  γ = d + 2(m−1),  κ = dλ + 2μ,  c = dλ + 2μ r_sym
    r_sym = M² Σ (p₁²/|p|⁴) |L⁻¹ : n⊗n|² / σ   (1, 5, 13.5 for an isotropic family in 1D, 2D, 3D)

since cubic symmetry makes L⁻¹ : I = (d/M) I exact. Symbol at the half-reciprocal points, k_i ∈ {0, π/h}:
there sin k·ξ = 0 for all bonds, the tangent term vanishes and 1 − cos k·ξ is 2 for the odd bonds, whose k·ξ
is an odd multiple of π, and 0 for the others:

    Ĵ(k) = −4 (d/Σω) κ E_m(a) (1+a)^{2m−2} [S₀ I + 2(m−1) S_n],   S₀ = Σ_odd ω/|ξ|²,  S_n = Σ_odd (ω/|ξ|²) n⊗n

Its sign is that of −E_m(a) × bracket, at any load: tension stable for m > 1 − S₀/(2 s_max), compression for
m < 1 − S₀/(2 s_min), with s the eigenvalues of S_n. As tr S_n = S₀, these two lie on either side of
1 − d/2: no m is stable on both sides, and in between none is on either.

Source: ours; the diagonal extends eqn:finaldf of Behzadinasab & Foster.
"""

import jax.numpy as jnp
import numpy as np

from ...infinite_lattice.brillouin import half_reciprocal_points
from ._common import check_dim, check_load, check_ratio, edge, hydrostatic_strain, lattice_bonds


def symmetric_ratio(dim, N):
    """r_sym of the module's head: how the tangent 2μ I_sym compares with a purely volumetric one [-].

    By cubic symmetry L has two numbers, A = Σ n₁⁴ and B = Σ n₁²n₂²: L⁻¹ : n⊗n has the diagonal
    (n_i² − dB/M)/(A − B), as A + (d−1)B = M/d, and n_i n_j/(2B) off it.
    """
    p = lattice_bonds(dim, N)
    r2 = np.sum(p**2, axis=1)
    dyads = p[:, :, None] * p[:, None, :] / r2[:, None, None]
    if dim == 1:
        return 1.0
    A, B = np.sum(dyads[:, 0, 0] ** 2), np.sum(dyads[:, 0, 1] ** 2)
    if min(B, A - B) < 1e-9 * A:
        raise ValueError(f"N = {N} gives {len(p)} bonds in {dim}D, too few for the shape tensor L that mu needs")
    dual = np.where(np.eye(dim) == 1, (dyads - dim * B / len(p)) / (A - B), dyads / (2 * B)) * len(p)
    return float(np.sum(p[:, 0] ** 2 / r2**2 * np.sum(dual**2, axis=(1, 2))) / np.sum(1 / r2))


def _coefficients(dim, N, lam, mu):
    """(σ, M, c, κ); r_sym needs all of L, which the smallest families lack, so it waits for a μ ≠ 0."""
    p = lattice_bonds(check_dim(dim), check_ratio(N))
    volumetric = isinstance(mu, (int, float)) and mu == 0
    c = dim * lam + (0.0 if volumetric else 2 * mu * symmetric_ratio(dim, N))
    return float(np.sum(1 / np.sum(p**2, axis=1))), len(p), c, dim * lam + 2 * mu


def lattice_diagonal(a, m, dim, N, lam, mu, spacing=1.0):
    """∂f_k/∂x_k of the moved point itself, x = (1 + a) X: the exact discrete diagonal; off-diagonals are 0.

    Arguments: a, m (...) [-]; dim 1, 2, 3; N; lam λ, mu μ [pressure]; spacing h [length]. Returns: (...)
    [pressure/length²]. Raises: ValueError for a, dim, N, or a family too small for L where μ ≠ 0.
    """
    a = check_load(a)
    sigma, count, c, kappa = _coefficients(dim, N, lam, mu)
    bracket = c * (1 + a) ** (2 * m) / count + 2 * (dim + 2 * (m - 1)) * kappa * hydrostatic_strain(a, m)
    return -sigma / (count * spacing**2) * (1 + a) ** (2 * m - 2) * bracket


def lattice_critical_load(m, dim, N, lam, mu):
    """The root of `lattice_diagonal` in a: (1 + a)^{−2m} = 1 + m c/(M γ κ); unstable beyond it, away from 0.

    Negative (compression) for m > 1 − d/2, positive below; infinite where the diagonal never fails.

    Arguments, raises: as `lattice_diagonal`. Returns: (...) [-].
    """
    _, count, c, kappa = _coefficients(dim, N, lam, mu)
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    slope = 2 * count * kappa * (dim + 2 * (m - 1))
    return edge(jnp.where(slope == 0, -jnp.inf, c / jnp.where(slope == 0, 1.0, slope)), m)


def odd_bond_sums(dim, N, influence=None):
    """S₀ and S_n at every half-reciprocal point: sums of ω/|p|² and (ω/|p|²) n⊗n over its odd bonds.

    Arguments: dim; N; influence callable (r, δ) → ω [-] (None: constant), called with h = 1.
    Returns: S₀ (2^dim − 1,) and S_n (2^dim − 1, dim, dim) [-]. Raises: ValueError for dim, N.
    """
    p, omega = _weights(dim, N, influence)
    odd = np.rint(half_reciprocal_points(dim) @ p.T / np.pi).astype(int) % 2
    r2 = np.sum(p**2, axis=1)
    weights = jnp.asarray(odd) * (omega / r2)
    return weights.sum(axis=1), jnp.einsum("kb,bi,bj->kij", weights, p, p / r2[:, None])


def _weights(dim, N, influence):
    p = lattice_bonds(dim, N)
    r = jnp.asarray(np.linalg.norm(p, axis=1))
    # Ties at the horizon are in the family; rounding must not put them beyond an influence that ends there.
    return p, jnp.ones_like(r) if influence is None else influence(jnp.minimum(r, float(N)), float(N))


def half_reciprocal_symbol(a, m, dim, N, lam, mu, spacing=1.0, influence=None):
    """Ĵ(k) under x = (1 + a) X at every half-reciprocal point, in the order of `half_reciprocal_points`.

    Arguments: a, m () [-]; others as `lattice_diagonal` and `odd_bond_sums`.
    Returns: (2^dim − 1, dim, dim) [pressure/length²]. Raises: ValueError for a, dim, N.
    """
    a = check_load(a)
    S0, Sn = odd_bond_sums(dim, N, influence)
    stress = (dim * lam + 2 * mu) * hydrostatic_strain(a, m)
    scale = -4 * dim / jnp.sum(_weights(dim, N, influence)[1]) * stress * (1 + a) ** (2 * m - 2) / spacing**2
    return scale * (S0[:, None, None] * jnp.eye(dim) + 2 * (m - 1) * Sn)


def hydrostatic_thresholds(dim, N, influence=None):
    """(m_compression, m_tension): the orders between which hydrostatic load fails on both sides.

    Below the first no half-reciprocal mode fails in compression, above the second none in tension; between
    them some mode fails on either side, at however small a load.

    m_tension = max over k of 1 − S₀/(2 s_max), m_compression = min over k of 1 − S₀/(2 s_min), −inf where
    s_min = 0. Both 1/2 in 1D. The law (κ > 0) plays no part. Necessary only: other wave vectors may fail
    too.

    Arguments: dim 1, 2, 3; N horizon over spacing; influence callable (r, δ) → ω (None: constant).
    Returns: two () arrays [-]. Raises: ValueError for dim, N.
    """
    S0, Sn = odd_bond_sums(dim, N, influence)
    s = jnp.linalg.eigvalsh(Sn)
    low = s[:, 0] > 1e-12 * S0
    compression = jnp.where(low, 1 - S0 / (2 * jnp.where(low, s[:, 0], 1.0)), -jnp.inf)
    return jnp.min(compression), jnp.max(1 - S0 / (2 * s[:, -1]))
