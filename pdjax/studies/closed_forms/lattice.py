"""Exact forms for a hydrostatic load on the simple cubic lattice, 1D to 3D, for S = λ tr(E) I + 2μE.

The diagonal for a constant influence (the full form of what the paper sketches in 1D and 2D):

    ∂f_k/∂x_k = −(σ/(M h²)) (1+a)^{2m−2} [ c (1+a)^{2m}/M + 2 γ κ E_m(a) ]
    M = number of bonds,  σ = Σ 1/|p|²,  γ = d + 2(m−1),  κ = dλ + 2μ,  c = dλ + 2μ r_sym
    r_sym = M² Σ (p₁²/|p|⁴) |L⁻¹ : n⊗n|² / σ   (1, 5, 13.5 for an isotropic family in 1D, 2D, 3D)

It is exact because L⁻¹ : I = (d/M) I on a cubic lattice.

The symbol at the half-reciprocal points, k_i ∈ {0, π/h}: there sin k·ξ = 0 for all bonds, and the tangent term
vanishes. 1 − cos k·ξ is 2 for the odd bonds, whose k·ξ is an odd multiple of π, and 0 for the others:

    Ĵ(k) = −4 (d/Σω) κ E_m(a) (1+a)^{2m−2} [S₀ I + 2(m−1) S_n],   S₀ = Σ_odd ω/|ξ|²,  S_n = Σ_odd (ω/|ξ|²) n⊗n

Its sign is that of −E_m(a) times the bracket, at any load. With s the eigenvalues of S_n, tension is stable for
m > 1 − S₀/(2 s_max) and compression for m < 1 − S₀/(2 s_min). As tr S_n = S₀, the first threshold is not below 1 − d/2
and the second is not above it. So no order m is stable on both sides, and an order between the thresholds is stable on
neither side.

Source: derived here. The diagonal extends that of Behzadinasab & Foster, section 3.2.
"""

import jax.numpy as jnp
import numpy as np

from ...infinite_lattice.brillouin import half_reciprocal_points
from ._common import check_dim, check_load, check_ratio, edge, hydrostatic_strain, lattice_bonds


def symmetric_ratio(dim, N):
    """r_sym: the effect of the tangent 2μ I_sym on the diagonal, over that of a purely volumetric tangent [-].

    By cubic symmetry L has two numbers, A = Σ n₁⁴ and B = Σ n₁²n₂². L⁻¹ : n⊗n has the diagonal components
    (n_i² − dB/M)/(A − B), as A + (d−1)B = M/d, and the others n_i n_j/(2B).
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
    """(σ, M, c, κ). The smallest families lack the L that r_sym needs, so r_sym is computed only for μ ≠ 0."""
    p = lattice_bonds(check_dim(dim), check_ratio(N))
    volumetric = isinstance(mu, (int, float)) and mu == 0
    c = dim * lam + (0.0 if volumetric else 2 * mu * symmetric_ratio(dim, N))
    return float(np.sum(1 / np.sum(p**2, axis=1))), len(p), c, dim * lam + 2 * mu


def lattice_diagonal(a, m, dim, N, lam, mu, spacing=1.0):
    """Compute the exact diagonal ∂f_k/∂x_k of the moved point itself under x = (1 + a) X, for S = λ tr(E) I + 2μE.

    ∂f_k/∂x_k = −(σ/(M h²)) (1+a)^{2m−2} [ c (1+a)^{2m}/M + 2 γ κ E_m(a) ]

    Here M is the number of bonds, σ = Σ 1/|p|², γ = d + 2(m−1), κ = dλ + 2μ, c = dλ + 2μ r_sym (r_sym: see the module).
    The influence is constant. The off-diagonal components are 0.

    Parameters
    ----------
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-].
    lam, mu : float
        λ and μ of the law [pressure].
    spacing : float
        h [length].

    Returns
    -------
    array, shape (...)
        ∂f_k/∂x_k [pressure/length²]. A positive value proves instability.

    Raises
    ------
    ValueError
        If a ≤ −1, if dim or N is out of range, or if μ ≠ 0 and the family is too small for L.

    References
    ----------
    Derived here; it extends the diagonal of Behzadinasab & Foster, section 3.2.

    Examples
    --------
    1D, N = 1, at rest, λ = 1, μ = 0: M = 2, σ = 2, c = 1, so that the diagonal is −(2/2)(1/2).

    >>> float(pd.closed_forms.lattice_diagonal(0.0, 1.0, 1, 1, lam=1.0, mu=0.0))
    -0.5
    """
    a = check_load(a)
    sigma, count, c, kappa = _coefficients(dim, N, lam, mu)
    bracket = c * (1 + a) ** (2 * m) / count + 2 * (dim + 2 * (m - 1)) * kappa * hydrostatic_strain(a, m)
    return -sigma / (count * spacing**2) * (1 + a) ** (2 * m - 2) * bracket


def lattice_critical_load(m, dim, N, lam, mu):
    """Compute the hydrostatic strain at which `lattice_diagonal` loses its stability.

    (1 + a)^{−2m} = 1 + m c/(M γ κ), with the symbols of `lattice_diagonal`

    The diagonal is unstable beyond the root, on the side away from 0. The root is negative (compression) for m > 1 −
    d/2 and positive below. It is infinite where the diagonal never fails.

    Parameters
    ----------
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-].
    lam, mu : float
        λ and μ of the law [pressure].

    Returns
    -------
    array, shape (...)
        a_cr [-].

    Raises
    ------
    ValueError
        If dim or N is out of range, or if μ ≠ 0 and the family is too small for L.

    Examples
    --------
    In 1D it is `critical_load_1d`: for m = 1 and N = 1, (1 + a)⁻² = 1.5.

    >>> round(float(pd.closed_forms.lattice_critical_load(1.0, 1, 1, lam=1.0, mu=0.0)), 3)
    -0.184
    """
    _, count, c, kappa = _coefficients(dim, N, lam, mu)
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    slope = 2 * count * kappa * (dim + 2 * (m - 1))
    return edge(jnp.where(slope == 0, -jnp.inf, c / jnp.where(slope == 0, 1.0, slope)), m)


def odd_bond_sums(dim, N, influence=None):
    """Compute the sums S₀ = Σ ω/|p|² and S_n = Σ (ω/|p|²) n⊗n over the odd bonds, at every half-reciprocal point.

    A bond is odd for the wave vector k if k·ξ is an odd multiple of π.

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-].
    influence : callable, optional
        (r, δ) → ω [-], called with h = 1. The default is a constant influence.

    Returns
    -------
    S0 : array, shape (2^dim − 1,)
        S₀ [-], in the order of `half_reciprocal_points`.
    Sn : array, shape (2^dim − 1, dim, dim)
        S_n [-].

    Raises
    ------
    ValueError
        If dim or N is out of range.

    Examples
    --------
    In 1D with N = 1 both bonds are odd at k = π/h, so that S₀ = 2.

    >>> S0, Sn = pd.closed_forms.odd_bond_sums(1, 1)
    >>> float(S0[0])
    2.0
    """
    p, omega = _weights(dim, N, influence)
    odd = np.rint(half_reciprocal_points(dim) @ p.T / np.pi).astype(int) % 2
    r2 = np.sum(p**2, axis=1)
    weights = jnp.asarray(odd) * (omega / r2)
    return weights.sum(axis=1), jnp.einsum("kb,bi,bj->kij", weights, p, p / r2[:, None])


def _weights(dim, N, influence):
    """The bonds over the spacing (bonds, dim) and their influence (bonds,)."""
    p = lattice_bonds(dim, N)
    r = jnp.asarray(np.linalg.norm(p, axis=1))
    # A bond as long as the horizon belongs to the family. Rounding must not move it beyond the end of the influence.
    return p, jnp.ones_like(r) if influence is None else influence(jnp.minimum(r, float(N)), float(N))


def half_reciprocal_symbol(a, m, dim, N, lam, mu, spacing=1.0, influence=None):
    """Compute the symbol Ĵ(k) under x = (1 + a) X at every half-reciprocal point, k_i ∈ {0, π/h} without k = 0.

    Ĵ(k) = −4 (d/Σω) κ E_m(a) (1+a)^{2m−2} [S₀ I + 2(m−1) S_n]

    S₀ and S_n are those of `odd_bond_sums`, κ = dλ + 2μ.

    Parameters
    ----------
    a : float
        Hydrostatic strain [-], above −1.
    m : float
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-].
    lam, mu : float
        λ and μ of the law [pressure].
    spacing : float
        h [length].
    influence : callable, optional
        (r, δ) → ω [-], called with h = 1. The default is a constant influence.

    Returns
    -------
    array, shape (2^dim − 1, dim, dim)
        Ĵ(k) [pressure/length²], in the order of `half_reciprocal_points`. A positive eigenvalue proves instability.

    Raises
    ------
    ValueError
        If a ≤ −1, or dim or N is out of range.

    References
    ----------
    Derived here.

    Examples
    --------
    1D, N = 1, m = 1, λ = 1: Ĵ(π/h) = −4 E with E = (1.1² − 1)/2 = 0.105.

    >>> round(float(pd.closed_forms.half_reciprocal_symbol(0.1, 1.0, 1, 1, lam=1.0, mu=0.0)[0, 0, 0]), 3)
    -0.42
    """
    a = check_load(a)
    S0, Sn = odd_bond_sums(dim, N, influence)
    stress = (dim * lam + 2 * mu) * hydrostatic_strain(a, m)
    scale = -4 * dim / jnp.sum(_weights(dim, N, influence)[1]) * stress * (1 + a) ** (2 * m - 2) / spacing**2
    return scale * (S0[:, None, None] * jnp.eye(dim) + 2 * (m - 1) * Sn)


def hydrostatic_thresholds(dim, N, influence=None):
    """Compute the two orders between which a hydrostatic load is unstable in compression and in tension.

    m_compression = min over k of 1 − S₀/(2 s_min),   m_tension = max over k of 1 − S₀/(2 s_max)

    k runs over the half-reciprocal points, S₀ and S_n are those of `odd_bond_sums`, s are the eigenvalues of S_n. Where
    s_min = 0 the first is −inf. In 1D both are 1/2.

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension.
    N : float
        Horizon over spacing [-].
    influence : callable, optional
        (r, δ) → ω [-]. The default is a constant influence.

    Returns
    -------
    m_compression : array, shape ()
        Below this order no half-reciprocal wave is unstable in compression [-].
    m_tension : array, shape ()
        Above this order no half-reciprocal wave is unstable in tension [-].

    Raises
    ------
    ValueError
        If dim or N is out of range.

    Notes
    -----
    Between the two orders some wave is unstable on either side, however small the load. The thresholds do
    not depend on the law (κ > 0). They are necessary conditions only: waves at other wave vectors may be unstable too.

    References
    ----------
    Derived here.

    Examples
    --------
    >>> low, high = pd.closed_forms.hydrostatic_thresholds(2, 2)
    >>> round(float(low), 3), round(float(high), 3)
    (-1.0, 0.333)
    """
    S0, Sn = odd_bond_sums(dim, N, influence)
    s = jnp.linalg.eigvalsh(Sn)
    low = s[:, 0] > 1e-12 * S0
    compression = jnp.where(low, 1 - S0 / (2 * jnp.where(low, s[:, 0], 1.0)), -jnp.inf)
    return jnp.min(compression), jnp.max(1 - S0 / (2 * s[:, -1]))
