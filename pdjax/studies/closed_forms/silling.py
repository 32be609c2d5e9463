"""The original correspondence model in a homogeneous deformation of a full lattice family.

    T⟨ξ⟩ = ω σ K⁻¹ ξ,   F̄ = (Σ V ω Y⊗ξ) K⁻¹,   K = Σ V ω ξ⊗ξ

    ∂f_k(X)/∂x_l(X+η) = A_kpln (K⁻¹)_pq (K⁻¹)_rn V² Σ_ξ ω⟨ξ⟩ [ω⟨η⟩ η_r + ω⟨η−ξ⟩ (η_r − ξ_r)] ξ_q,   A = ∂σ/∂F

The first part in brackets sums to zero over a full family. At η = 0 and for a constant influence Σ V ω² ξ⊗ξ = K. In a
3D ball K = (4π/15) δ⁵ I, so that ∂f_k/∂x_l = −(15 V/(4πδ⁵)) A_kplp. These forms contain no slip. The printed form is
the discrete one with the K of the ball in place of the K of the lattice. It is proportional to V. Therefore the
diagonal of the continuum is zero: it shows neither stability nor instability.

Symbols: σ is the first Piola–Kirchhoff stress, A its tangent (component kpln = ∂σ_kp/∂F_ln), V the volume of a point, ω
the influence. Source: Behzadinasab & Foster, section 3.3 (Jacobian of Silling's model).
"""

import jax.numpy as jnp

from .homogeneous import check_family, pairs_that_sum_to


def silling_entry(eta, xi, omega, volume, tangent):
    """Compute the exact Jacobian entry ∂f_k(X)/∂x_l(X+η) of the correspondence model.

    The deformation enters through the tangent of the law only.

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
    tangent : array, shape (dim, dim, dim, dim)
        A_kpln = ∂σ_kp/∂F_ln [pressure].

    Returns
    -------
    array, shape (dim, dim)
        ∂f_k/∂x_l [pressure/length²].

    Raises
    ------
    ValueError
        If xi and omega are not a full family, or the bonds leave K singular.

    References
    ----------
    Behzadinasab & Foster, section 3.3, general entry of the Jacobian.

    Examples
    --------
    In 1D with N = 1 and A = 1: K = 2, and the diagonal is −1/K.

    >>> xi = pd.closed_forms.lattice_bonds(1, 1)
    >>> entry = pd.closed_forms.silling_entry(np.zeros(1), xi, np.ones(2), 1.0, np.ones((1, 1, 1, 1)))
    >>> entry.tolist()
    [[-0.5]]
    """
    xi, omega = check_family(xi, omega, tensor="K")
    eta = jnp.asarray(eta, dtype=jnp.result_type(eta, float))
    lever = jnp.linalg.solve(volume * jnp.einsum("b,bi,bj->ij", omega, xi, xi), (omega[:, None] * xi).T).T
    through = jnp.einsum("ab,ap,bn->pn", pairs_that_sum_to(eta, xi), lever, lever)
    return volume**2 * jnp.einsum("kpln,pn->kl", tangent, through)


def silling_diagonal_3d(tangent, horizon, volume):
    """Compute the printed diagonal block of the correspondence model: −(15 V/(4πδ⁵)) ∂σ_kp/∂F_lp.

    It holds in 3D for a constant influence, with the K of the ball.

    Parameters
    ----------
    tangent : array, shape (3, 3, 3, 3)
        A_kpln = ∂σ_kp/∂F_ln [pressure].
    horizon : float
        δ [length].
    volume : float
        V [length³].

    Returns
    -------
    array, shape (3, 3)
        ∂f_k/∂x_l [pressure/length²].

    Raises
    ------
    ValueError
        If the tangent has another shape.

    References
    ----------
    Behzadinasab & Foster, section 3.3, the block of one point for a constant influence.

    Examples
    --------
    With A_kpln = δ_kl δ_pn, A_kplp = 3 δ_kl, and the diagonal is −45/(4π) for V = δ = 1.

    >>> tangent = np.einsum("kl,pn->kpln", np.eye(3), np.eye(3))
    >>> round(float(pd.closed_forms.silling_diagonal_3d(tangent, horizon=1.0, volume=1.0)[0, 0]), 4)
    -3.581
    """
    tangent = jnp.asarray(tangent)
    if tangent.shape != (3, 3, 3, 3):
        raise ValueError(f"tangent must have shape (3, 3, 3, 3) in this 3D form; got {tangent.shape}")
    return -15 * volume / (4 * jnp.pi * horizon**5) * jnp.einsum("kplp->kl", tangent)
