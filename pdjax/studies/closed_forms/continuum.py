"""Stability of homogeneous deformation in the continuum: h → 0 at fixed horizon, hydrostatic load.

    ∂f_k/∂x_k = −2 S (1 + a)^{2m−2} Γ(m),   S_ij = S δ_ij (the paper takes S = κa)
    Γ(m) = L⁻¹_pqii ∫ ω (ξ_p ξ_q/|ξ|⁴) [2(m−1) ξ_k²/|ξ|² + 1] dξ = R γ(m)
    R = ∫ ω/|ξ|² dξ / ∫ ω dξ > 0,   γ(m) = d + 2(m − 1)

since L⁻¹ : I = (d/∫ω) I and the mean of ξ_k²/|ξ|² over directions is 1/d. So m_cr = 1 − d/2. For constant
influence R is infinite in 1D and 2D: there the continuum diagonal is unbounded, only its sign has a
meaning.

Symbols: d dimension, δ horizon, ω influence, a hydrostatic strain, m order of the strain.
Source: Behzadinasab & Foster, section 3.2.1 (eqn:Gamma, eqn:gammaDef), section 6.1 (eqn:altS).
"""

import jax.numpy as jnp
import numpy as np

from ._common import check_dim, check_form, check_load


def gamma(m, dim, form="corrected"):
    """Γ(m)/R, the sign of the continuum diagonal: d + 2(m − 1).

    The dropped factor is R = ∫ ω/|ξ|² dξ / ∫ ω dξ, positive (see `radial_factor`). Printed: 2m − 1, 2m, 2m
    in 1D, 2D, 3D; the last should be 2m + 1.

    Arguments: m (...) [-]; dim 1, 2 or 3; form. Returns: (...) [-]. Raises: ValueError for dim, form.
    Source: proof of Proposition 1 after eqn:gammaCondition.
    """
    dim = check_dim(dim)
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    if check_form(form) == "printed" and dim == 3:
        return 2 * m
    return dim + 2 * (m - 1)


def m_cr(dim, form="corrected"):
    """The order at which Γ changes sign: 1 − d/2; printed 1/2, 0, 0 in 1D, 2D, 3D.

    Arguments: dim 1, 2 or 3; form. Returns: float [-]. Raises: ValueError for dim, form. Source:
    Proposition 1.
    """
    dim = check_dim(dim)
    return 0.0 if check_form(form) == "printed" and dim == 3 else 1 - dim / 2


def radial_factor(dim, horizon, influence=None):
    """R = ∫ ω/|ξ|² dξ / ∫ ω dξ over the ball |ξ| ≤ δ; infinite unless ω r^{d−2} → 0 at the centre.

    Quadrature: 64 Gauss–Legendre nodes in t, r = δt⁴, so that weak singularities at the centre become
    smooth.

    Arguments: dim; horizon δ [length]; influence callable (r, δ) → ω [-] (None: constant). Returns: ()
    [1/length²]. Raises: ValueError for dim. Source: the radial integrals in the proof of Proposition 1.
    """
    dim = check_dim(dim)
    horizon = jnp.asarray(horizon, dtype=jnp.result_type(horizon, float))
    if influence is None:
        return 3 / horizon**2 if dim == 3 else jnp.full_like(horizon, jnp.inf)
    nodes, weights = np.polynomial.legendre.leggauss(64)
    t, dt = (nodes + 1) / 2, weights / 2
    q, dq = t**4, 4 * t**3 * dt
    omega = influence(jnp.asarray(q) * horizon, horizon)
    ratio = jnp.sum(omega * q ** (dim - 3) * dq) / jnp.sum(omega * q ** (dim - 1) * dq)
    # ω r^{d−2} at r = 1e-8 δ tells a convergent integral (→ 0) from a divergent one (constant or growing).
    centre = influence(1e-8 * horizon, horizon) * 1e-8 ** (dim - 2)
    return jnp.where(centre > 1e-2, jnp.inf, ratio / horizon**2)


def continuum_diagonal(stress, a, m, dim, radial, form="corrected"):
    """∂f_k/∂x_k = −2 S (1 + a)^{2m−2} R γ(m) as h → 0, under the hydrostatic stress S_ij = S δ_ij.

    Arguments: stress S (...) [pressure], κa in the paper; a (...) [-]; m (...) [-]; dim; radial R, from
    `radial_factor` [1/length²]; form. Returns: (...) [pressure/length²]; negative where not shown unstable.
    Raises: ValueError for a, dim, form. Source: eqn:dfcontinuum, eqn:Gamma.
    """
    return -2 * stress * (1 + check_load(a)) ** (2 * m - 2) * radial * gamma(m, dim, form)


def material_test(stress, a, m, dim, radial, shift=1.0, form="corrected"):
    """dT·dY when the centre alone moves by ε: S ε² (1 + a)^{2m−2} R γ(m) = −½ ε² ∂f_k/∂x_k of the continuum.

    Printed: the sign is reversed, and ξ_l ξ_l/|ξ|² = 1 stands for ξ_1²/|ξ|² (mean 1/d), which gives
    −S ε² (1 + a)^{2m−2} R d (2m − 1). In 1D only the sign differs.

    Arguments: as `continuum_diagonal`; shift ε [length]. R may be the lattice's own Σ ω/|ξ|² / Σ ω: then
    the value is exact for the lattice. Returns: (...) [pressure]; positive where not shown unstable.
    Raises: ValueError for a, dim, form. Source: eqn:altS.
    """
    dim = check_dim(dim)
    sign, bracket = (-1, dim * (2 * m - 1)) if check_form(form) == "printed" else (1, gamma(m, dim))
    return sign * stress * shift**2 * (1 + check_load(a)) ** (2 * m - 2) * radial * bracket
