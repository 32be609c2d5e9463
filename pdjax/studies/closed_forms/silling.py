"""The original correspondence model in a homogeneous deformation of a full lattice family.

    T⟨ξ⟩ = ω σ K⁻¹ ξ,   F̄ = (Σ V ω Y⊗ξ) K⁻¹,   K = Σ V ω ξ⊗ξ

    ∂f_k(X)/∂x_l(X+η) = A_kpln (K⁻¹)_pq (K⁻¹)_rn V² Σ_ξ ω⟨ξ⟩ [ω⟨η⟩ η_r + ω⟨η−ξ⟩ (η_r − ξ_r)] ξ_q,   A = ∂σ/∂F

The first part in brackets sums to zero over a full family. At η = 0 and for constant influence Σ V ω² ξ⊗ξ =
K, and in a 3D ball K = (4π/15) δ⁵ I: then ∂f_k/∂x_l = −(15 V/(4πδ⁵)) A_kplp. No slip was found here; the
printed form is the discrete one with K of the ball in place of the lattice's. It is of the order of V, so
that the continuum diagonal is zero: neither stable nor unstable.

Symbols: σ first Piola–Kirchhoff stress, A its tangent (component kpln = ∂σ_kp/∂F_ln), V volume, ω
influence. Source: Behzadinasab & Foster, section 3.3 (eqn:TFI to eqn:dfsimplified).
"""

import jax.numpy as jnp

from .homogeneous import check_family, pairs_that_sum_to


def silling_entry(eta, xi, omega, volume, tangent):
    """∂f_k(X)/∂x_l(X+η) of the correspondence model, exactly; F enters through the tangent alone.

    Arguments: eta (dim,) [length], up to two horizons; xi (bonds, dim) a full family [length]; omega
    (bonds,) [-]; volume V () [length^d]; tangent ∂σ_kp/∂F_ln (dim, dim, dim, dim) [pressure]. Returns:
    (dim, dim) [pressure/length²]. Raises: ValueError for xi, omega. Source: the display after eqn:FI.
    """
    xi, omega = check_family(xi, omega, tensor="K")
    eta = jnp.asarray(eta, dtype=jnp.result_type(eta, float))
    lever = jnp.linalg.solve(volume * jnp.einsum("b,bi,bj->ij", omega, xi, xi), (omega[:, None] * xi).T).T
    through = jnp.einsum("ab,ap,bn->pn", pairs_that_sum_to(eta, xi), lever, lever)
    return volume**2 * jnp.einsum("kpln,pn->kl", tangent, through)


def silling_diagonal_3d(tangent, horizon, volume):
    """∂f_k/∂x_l = −(15 V/(4πδ⁵)) ∂σ_kp/∂F_lp of the moved point: 3D, constant influence, K of the ball.

    Arguments: tangent (3, 3, 3, 3) [pressure]; horizon δ [length]; volume V [length³]. Returns: (3, 3)
    [pressure/length²]. Raises: ValueError for tangent. Source: eqn:dfsimplified.
    """
    tangent = jnp.asarray(tangent)
    if tangent.shape != (3, 3, 3, 3):
        raise ValueError(f"tangent must have shape (3, 3, 3, 3) in this 3D form; got {tangent.shape}")
    return -15 * volume / (4 * jnp.pi * horizon**5) * jnp.einsum("kplp->kl", tangent)
