"""Stability of a homogeneous deformation in the continuum: h → 0 at fixed horizon, under a hydrostatic load.

    ∂f_k/∂x_k = −2 S (1 + a)^{2m−2} Γ(m),   S_ij = S δ_ij (the paper takes S = κa)
    Γ(m) = L⁻¹_pqii ∫ ω (ξ_p ξ_q/|ξ|⁴) [2(m−1) ξ_k²/|ξ|² + 1] dξ = R γ(m)
    R = ∫ ω/|ξ|² dξ / ∫ ω dξ > 0,   γ(m) = d + 2(m − 1)

The second form of Γ follows from L⁻¹ : I = (d/∫ω) I and from the mean of ξ_k²/|ξ|² over all directions, 1/d. So Γ
vanishes at m_cr = 1 − d/2. For a constant influence R is infinite in 1D and 2D. There the diagonal of the continuum is
unbounded, and only its sign has a meaning.

Symbols: d is the dimension, δ the horizon, ω the influence, a the hydrostatic strain, m the order of the strain.
Source: Behzadinasab & Foster, section 3.2.1 (diagonal of the continuum, Γ) and section 6.1 (dT·dY of a moved centre).
"""

import jax.numpy as jnp
import numpy as np

from ._common import check_dim, check_form, check_load


def gamma(m, dim, form="corrected"):
    """Compute γ(m) = Γ(m)/R = d + 2(m − 1), which has the sign of the continuum's diagonal.

    The omitted factor R = ∫ ω/|ξ|² dξ / ∫ ω dξ is positive (`radial_factor`). The paper prints 2m − 1, 2m, 2m in 1D,
    2D, 3D. The last one should be 2m + 1.

    Parameters
    ----------
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    form : {"corrected", "printed"}
        Which version of the formula.

    Returns
    -------
    array, shape (...)
        γ(m) [-].

    Raises
    ------
    ValueError
        If dim or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 3.2.1, proof of Proposition 1.

    Examples
    --------
    For m = 1 the second term vanishes and γ is the dimension.

    >>> float(pd.closed_forms.gamma(1.0, dim=3))
    3.0
    """
    dim = check_dim(dim)
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    if check_form(form) == "printed" and dim == 3:
        return 2 * m
    return dim + 2 * (m - 1)


def m_cr(dim, form="corrected"):
    """Return the order at which Γ(m) changes sign: 1 − d/2.

    The paper prints 1/2, 0, 0 in 1D, 2D, 3D. The last one should be −1/2.

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension.
    form : {"corrected", "printed"}
        Which version of the formula.

    Returns
    -------
    float
        m_cr [-].

    Raises
    ------
    ValueError
        If dim or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, Proposition 1.

    Examples
    --------
    >>> [pd.closed_forms.m_cr(dim) for dim in (1, 2, 3)]
    [0.5, 0.0, -0.5]
    """
    dim = check_dim(dim)
    return 0.0 if check_form(form) == "printed" and dim == 3 else 1 - dim / 2


def radial_factor(dim, horizon, influence=None):
    """Compute R = ∫ ω/|ξ|² dξ / ∫ ω dξ over the ball |ξ| ≤ δ.

    R is infinite unless ω r^{d−2} → 0 at the centre. The quadrature uses 64 Gauss–Legendre nodes in t with r = δt⁴.
    This substitution makes weak singularities at the centre smooth.

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension.
    horizon : array, shape ()
        Horizon δ [length].
    influence : callable, optional
        (r, δ) → ω [-]. The default is a constant influence.

    Returns
    -------
    array, shape ()
        R [1/length²].

    Raises
    ------
    ValueError
        If dim is not 1, 2 or 3.

    References
    ----------
    Behzadinasab & Foster, the radial integrals in the proof of Proposition 1.

    Examples
    --------
    For a constant influence in 3D, R = 3/δ².

    >>> float(pd.closed_forms.radial_factor(3, horizon=2.0))
    0.75
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
    # The integral converges if ω r^{d−2} tends to 0 at the centre. The test is at r = 1e-8 δ: the product is tiny there
    # for a convergent integral, and constant or large for a divergent one.
    centre = influence(1e-8 * horizon, horizon) * 1e-8 ** (dim - 2)
    return jnp.where(centre > 1e-2, jnp.inf, ratio / horizon**2)


def continuum_diagonal(stress, a, m, dim, radial, form="corrected"):
    """Compute ∂f_k/∂x_k = −2 S (1 + a)^{2m−2} R γ(m), the diagonal as h → 0 under the stress S_ij = S δ_ij.

    Parameters
    ----------
    stress : array, shape (...)
        S [pressure]; κa in the paper.
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    radial : array, shape ()
        R [1/length²], from `radial_factor`.
    form : {"corrected", "printed"}
        Which version of γ(m).

    Returns
    -------
    array, shape (...)
        ∂f_k/∂x_k [pressure/length²]. A positive value proves instability; a negative value proves nothing.

    Raises
    ------
    ValueError
        If a ≤ −1, or dim or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 3.2 (continuum limit of the diagonal) and section 3.2.1 (hydrostatic load).

    Examples
    --------
    With S = 1, a = 0, m = 1 and R = 0.75 the diagonal is −2 · 0.75 · 3.

    >>> float(pd.closed_forms.continuum_diagonal(1.0, 0.0, 1.0, dim=3, radial=0.75))
    -4.5
    """
    return -2 * stress * (1 + check_load(a)) ** (2 * m - 2) * radial * gamma(m, dim, form)


def material_test(stress, a, m, dim, radial, shift=1.0, form="corrected"):
    """Compute dT·dY of a family whose centre alone moves by ε: S ε² (1 + a)^{2m−2} R γ(m).

    It equals −½ ε² ∂f_k/∂x_k of the continuum. The paper prints −S ε² (1 + a)^{2m−2} R d (2m − 1): the sign is
    reversed, and ξ_l ξ_l/|ξ|² = 1 is used for ξ_1²/|ξ|², whose mean is 1/d. In 1D the two forms differ by the sign
    only.

    Parameters
    ----------
    stress : array, shape (...)
        S [pressure] of the hydrostatic stress S_ij = S δ_ij.
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    dim : {1, 2, 3}
        Dimension.
    radial : array, shape ()
        R [1/length²], from `radial_factor`. With the sum of a lattice, Σ ω/|ξ|² / Σ ω, the value is exact for that
        lattice.
    shift : array, shape ()
        Displacement ε of the centre [length].
    form : {"corrected", "printed"}
        Which version of the formula.

    Returns
    -------
    array, shape (...)
        dT·dY [pressure]. A negative value proves instability; a positive value proves nothing.

    Raises
    ------
    ValueError
        If a ≤ −1, or dim or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 6.1, dT·dY of a moved centre under a hydrostatic load.

    Examples
    --------
    It is −½ of the diagonal of the continuum, which is −4.5 for these values (see `continuum_diagonal`).

    >>> float(pd.closed_forms.material_test(1.0, 0.0, 1.0, dim=3, radial=0.75))
    2.25
    """
    dim = check_dim(dim)
    sign, bracket = (-1, dim * (2 * m - 1)) if check_form(form) == "printed" else (1, gamma(m, dim))
    return sign * stress * shift**2 * (1 + check_load(a)) ** (2 * m - 2) * radial * bracket
