"""The 1D closed forms: diagonal, criterion and critical load; plane waves; clamped and singular bars.

    ∂f/∂x = −(2 H (1+a)^{2m−2} / (N h²)) [ (dS/dE)(1+a)^{2m}/(4N) + (2m−1) S ],   H = Σ_{p=1}^N 1/p²
    S = κE:   stable only if   b(a) = (1+a)^{2m}/(4N) + (2m−1) E_m(a) > 0,   E_m = ((1+a)^{2m} − 1)/(2m)

b is smooth in m at 0, where it equals 1/(4N) − log(1+a). So the two branches that the paper prints are one function. In
1D, L = 2N V is exact on the lattice. Therefore these forms are the exact discrete ones. They contain no slip.

Symbols: h is the spacing, N = δ/h, κ the modulus, ω = 1 the influence, u₀ the amplitude, k the wave number, ρ the mass
density.
Source: Behzadinasab & Foster, sections 4.1 (1D Jacobian), 5.1 (singular bar) and 5.4 (dispersion relation).
"""

import jax.numpy as jnp
import numpy as np

from ..._internal.checks import is_concrete
from ._common import check_load, check_ratio, edge, hydrostatic_strain


def _harmonic(N):
    """H = Σ_{p=1}^N 1/p²."""
    return float(np.sum(1.0 / np.arange(1, N + 1) ** 2))


def diagonal_1d(a, m, N, stress, tangent, spacing=1.0):
    """Compute the diagonal ∂f/∂x of the discrete bar under x = (1 + a) X, for any law.

    ∂f/∂x = −(2 H (1+a)^{2m−2} / (N h²)) [ (dS/dE)(1+a)^{2m}/(4N) + (2m−1) S ],   H = Σ_{p=1}^N 1/p²

    Parameters
    ----------
    a : array, shape (...)
        Strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : int
        Horizon over spacing [-].
    stress : array, shape (...)
        S of the law at the strain a [pressure].
    tangent : array, shape (...)
        dS/dE of the law at the strain a [pressure].
    spacing : float
        h [length].

    Returns
    -------
    array, shape (...)
        ∂f/∂x [pressure/length²]. A positive value proves instability.

    Raises
    ------
    ValueError
        If a ≤ −1, or N is not a whole number ≥ 1.

    References
    ----------
    Behzadinasab & Foster, section 4.1, 1D Jacobian of a uniform deformation.

    Examples
    --------
    At rest with N = 1, H = 1 and the bracket is 1/4.

    >>> float(pd.closed_forms.diagonal_1d(0.0, 1.0, 1, stress=0.0, tangent=1.0))
    -0.5
    """
    a, N = check_load(a), check_ratio(N, whole=True)
    bracket = tangent * (1 + a) ** (2 * m) / (4 * N) + (2 * m - 1) * stress
    return -2 * _harmonic(N) * (1 + a) ** (2 * m - 2) / (N * spacing**2) * bracket


def bracket_1d(a, m, N):
    """Compute b(a) = (1+a)^{2m}/(4N) + (2m−1) E_m(a), the criterion of the 1D diagonal for S = κE.

    The diagonal is negative (stable) where b is positive.

    Parameters
    ----------
    a : array, shape (...)
        Strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : int
        Horizon over spacing [-].

    Returns
    -------
    array, shape (...)
        b [-].

    Raises
    ------
    ValueError
        If a ≤ −1, or N is not a whole number ≥ 1.

    References
    ----------
    Behzadinasab & Foster, section 4.1, the two criteria for the linear law S = κE. Here they are one function, smooth
    at m = 0.

    Examples
    --------
    At rest E_m = 0 and b = 1/(4N).

    >>> float(pd.closed_forms.bracket_1d(0.0, 1.0, 1))
    0.25
    """
    a, N = check_load(a), check_ratio(N, whole=True)
    return (1 + a) ** (2 * m) / (4 * N) + (2 * m - 1) * hydrostatic_strain(a, m)


def critical_load_1d(m, N):
    """Compute the strain at which the 1D diagonal loses its stability: the root of `bracket_1d`.

    (1 + a)^{−2m} = 1 + 2m/(4N(2m − 1))

    The diagonal is unstable beyond the root, on the side away from 0. The root is negative (compression) for m > 1/2
    and positive below. It is +inf where the diagonal never fails, 2N/(4N + 1) ≤ m ≤ 1/2.

    Parameters
    ----------
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : int
        Horizon over spacing [-].

    Returns
    -------
    array, shape (...)
        a_cr [-].

    Raises
    ------
    ValueError
        If N is not a whole number ≥ 1.

    References
    ----------
    Behzadinasab & Foster, section 4.1, the criteria for the linear law S = κE. Remark 4 quotes −0.184 (m = 1, N = 1)
    and −0.074 (m = 1, N = 3).

    Examples
    --------
    For m = 1 and N = 1 the equation is (1 + a)⁻² = 1.5.

    >>> round(float(pd.closed_forms.critical_load_1d(1.0, 1)), 3)
    -0.184
    """
    N = check_ratio(N, whole=True)
    slope = 4 * N * (2 * jnp.asarray(m, dtype=jnp.result_type(m, float)) - 1)
    return edge(jnp.where(slope == 0, -jnp.inf, 1 / jnp.where(slope == 0, 1.0, slope)), m)


def dispersion_1d(k, amplitude, m, N, modulus=1.0, density=1.0, spacing=1.0, X=0.0):
    """Compute ω² of the paper's complex plane wave u = u₀ e^{i(kX−ωt)} in a bar with S = κE, read at t = 0 and X.

    −ρ u₀ ω² e^{ikX} = Σ V [S(X) + S(X+ξ)] (Y²/ξ²)^{m−1} Y/(ω₀ ξ²)

    The paper reads ω at X = 0.

    Parameters
    ----------
    k : array, shape (...)
        Wave number [1/length].
    amplitude : float
        u₀ [length], not 0.
    m : float
        Order of the Seth–Hill strain [-].
    N : int
        Horizon over spacing [-].
    modulus : float
        κ [pressure].
    density : float
        ρ [mass/volume].
    spacing : float
        h [length].
    X : float
        Position at which ω is read [length].

    Returns
    -------
    complex array, shape (...)
        ω² [1/time²].

    Raises
    ------
    ValueError
        If N is not a whole number ≥ 1, or the amplitude is 0.

    Notes
    -----
    The law is nonlinear, and the formula puts a complex displacement into it. So ω² is complex, and the
    wave is not a motion of the bar. Only the limit u₀ → 0 is one (`dispersion_limit_1d`). ω² depends on X. The sign of
    its imaginary part changes with the sign of u₀, although a real wave with −u₀ is the same wave, shifted by half a
    wavelength.

    References
    ----------
    Behzadinasab & Foster, section 5.4, from the force state of a plane wave to the dispersion relation.

    Examples
    --------
    For N = 1 and a tiny amplitude ω² = (κ/(ρh²)) sin²(kh), which is 1 at kh = π/2.

    >>> round(float(pd.closed_forms.dispersion_1d(np.pi / 2, 1e-6, 1.0, 1).real), 3)
    1.0
    """
    N = check_ratio(N, whole=True)
    if isinstance(amplitude, (int, float)) and amplitude == 0:
        raise ValueError("amplitude must not be 0; the limit is dispersion_limit_1d")
    phase = 1j * jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None]
    xi = spacing * jnp.asarray(lattice_numbers(N), dtype=phase.real.dtype)

    def stretch(at):
        """log |Y|/|ξ| of every bond of the point at X = `at`, continued to complex displacements."""
        lifted = amplitude * jnp.exp(phase[..., None] * at[:, None]) * jnp.expm1(phase[..., None] * xi)
        return jnp.log1p(lifted / xi)

    def stress(at):
        x = 2 * m * stretch(at)
        small = jnp.abs(x) < 1e-4  # the series has a relative error of 1e-16/120; it serves m = 0
        quotient = jnp.where(small, 1 + x / 2 + x**2 / 6 + x**3 / 24, jnp.expm1(x) / jnp.where(small, 1, x))
        return modulus * jnp.mean(stretch(at) * quotient, axis=-1)

    here = jnp.full(1, X, dtype=xi.dtype)
    log_s = stretch(here)[..., 0, :]
    pair = stress(here) + stress(here + xi)
    start = density * amplitude * jnp.exp(phase[..., 0] * X)
    return -jnp.mean(pair * jnp.exp((2 * m - 1) * log_s) / xi, axis=-1) / start


def lattice_numbers(N):
    """The numbers −N … −1, 1 … N of the neighbours of a point."""
    return np.concatenate([np.arange(-N, 0), np.arange(1, N + 1)]).astype(float)


def dispersion_limit_1d(k, N, modulus=1.0, density=1.0, spacing=1.0):
    """Compute ω² of plane waves of vanishing amplitude in the bar: κ/(ρN²h²) (Σ_{p=1}^N sin(kph)/p)².

    It is the same for every order m, and it vanishes at k = π/h.

    Parameters
    ----------
    k : array, shape (...)
        Wave number [1/length].
    N : int
        Horizon over spacing [-].
    modulus : float
        κ [pressure].
    density : float
        ρ [mass/volume].
    spacing : float
        h [length].

    Returns
    -------
    array, shape (...)
        ω² [1/time²].

    Raises
    ------
    ValueError
        If N is not a whole number ≥ 1.

    References
    ----------
    Derived here: limit u₀ → 0 of the dispersion relation of Behzadinasab & Foster, section 5.4.

    Examples
    --------
    For N = 1 it is sin²(k), which is 1 at k = π/2.

    >>> float(pd.closed_forms.dispersion_limit_1d(np.pi / 2, 1))
    1.0
    """
    N = check_ratio(N, whole=True)
    p = np.arange(1, N + 1)
    k = jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None]
    return modulus / (density * N**2 * spacing**2) * jnp.sum(jnp.sin(k * p * spacing) / p, axis=-1) ** 2


def dispersion_continuum_1d(k, horizon, modulus=1.0, density=1.0):
    """Compute ω² of plane waves about rest in the continuum, h → 0 at a fixed horizon: κ/(ρδ²) Si(kδ)².

    Si is the sine integral.

    Parameters
    ----------
    k : array, shape (...)
        Wave number [1/length], |k| δ ≤ 200.
    horizon : float
        δ > 0 [length].
    modulus : float
        κ [pressure].
    density : float
        ρ [mass/volume].

    Returns
    -------
    array, shape (...)
        ω² [1/time²].

    Raises
    ------
    ValueError
        If |k| δ > 200 or δ ≤ 0.

    Notes
    -----
    Si(x) > 0 for x > 0, so no wave of the continuum has frequency 0. The zero of `dispersion_limit_1d` at k = π/h is a
    property of the lattice. At a fixed k, `dispersion_limit_1d` tends to this function with an error of
    first order in h.

    References
    ----------
    Derived here: the integral whose Riemann sum is `dispersion_limit_1d`.

    Examples
    --------
    Si(π) = 1.8519, and its square is 3.43.

    >>> round(float(pd.closed_forms.dispersion_continuum_1d(np.pi, horizon=1.0)), 2)
    3.43
    """
    if is_concrete(k, horizon) and not (np.all(np.abs(np.asarray(k) * horizon) <= 200) and np.all(horizon > 0)):
        raise ValueError("horizon must be positive and |k| horizon at most 200, which the quadrature resolves")
    t, weight = np.polynomial.legendre.leggauss(160)  # Si(x) = ∫₀¹ sin(xt)/t dt, to 6e-13 for |x| ≤ 200
    t, weight = 0.5 * (t + 1), 0.5 * weight
    x = jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None] * horizon
    return modulus / (density * horizon**2) * jnp.sum(weight * jnp.sin(x * t) / t, axis=-1) ** 2


def clamped_bar_critical_strain(free, N):
    """Estimate the compression at which a clamped bar of order m = 1 becomes unstable, for many free points.

    a_cr = −C (π/n)² (odd N),   −C (N(N+1)/12)² (2π/n)⁶ (even N),   1/C = 4 N Σ_{p odd ≤ N} 1/p²

    This is the leading order in 1/n. The relative error is of the order N/n.

    Parameters
    ----------
    free : array, shape (...)
        Number n of free points between the clamps.
    N : int
        Horizon over spacing [-].

    Returns
    -------
    array, shape (...)
        a_cr [-].

    Raises
    ------
    ValueError
        If N is not a whole number ≥ 1.

    Notes
    -----
    Near the edge of the Brillouin zone, k = π/h − q/h, the undeformed chain has the eigenvalue
    λ = −κ/(N²h²) s(q)² with s = −Σ (−1)^p sin(qp)/p. A strain a adds −(4aκ/(Nh²)) Σ_{p odd} 1/p². For odd N, s ≈ q, and
    the smallest q² between the clamps is (π/n)². For even N, s ≈ N(N+1) q³/12, and the edge mode obeys a sixth-order
    equation with clamped ends: q⁶ = (2π/n)⁶.

    References
    ----------
    Derived here, from the limit u₀ → 0 of the dispersion relation of Behzadinasab & Foster, section 5.4, with its
    stress term.

    Examples
    --------
    For N = 1, C = 1/4. With n = 10 this gives −(π/10)²/4.

    >>> round(float(pd.closed_forms.clamped_bar_critical_strain(10, 1)), 4)
    -0.0247
    """
    N = check_ratio(N, whole=True)
    p = np.arange(1, N + 1)
    softening = 4 * N * np.sum(1.0 / p[p % 2 == 1] ** 2)
    n = jnp.asarray(free, dtype=float)
    stiffness = (np.pi / n) ** 2 if N % 2 else (N * (N + 1) / 12) ** 2 * (2 * np.pi / n) ** 6
    return -stiffness / softening


def singular_bar_displacement(x, length, stress_ratio, alpha=10.0):
    """Compute the local small-strain displacement of the singular bar.

    u = (σ/E₀) L [x/L + α √(x/L − ½)]; the root applies only beyond x = L/2.

    Parameters
    ----------
    x : array, shape (...)
        Position from the fixed end [length].
    length : float
        L [length].
    stress_ratio : float
        σ/E₀ [-].
    alpha : float
        α of the profile of the modulus [-].

    Returns
    -------
    array, shape (...)
        u [length].

    References
    ----------
    Behzadinasab & Foster, section 5.1.

    Examples
    --------
    At x = 3L/4 the bracket is 0.75 + 10 · 0.5 = 5.75.

    >>> round(float(pd.closed_forms.singular_bar_displacement(0.75, 1.0, 0.001)), 6)
    0.00575
    """
    beyond = jnp.maximum(x / length - 0.5, 0.0)
    return stress_ratio * length * (x / length + alpha * jnp.sqrt(beyond))


def singular_bar_strain(x, length, stress_ratio, alpha=10.0):
    """Compute the local small-strain strain of the singular bar.

    ε = (σ/E₀) [1 + α/(2√(x/L − ½))]; the second term applies only beyond x = L/2. The bracket is also E₀/E(x).

    Parameters
    ----------
    x : array, shape (...)
        Position from the fixed end [length].
    length : float
        L [length].
    stress_ratio : float
        σ/E₀ [-].
    alpha : float
        α of the profile of the modulus [-].

    Returns
    -------
    array, shape (...)
        ε [-].

    References
    ----------
    Behzadinasab & Foster, section 5.1.

    Examples
    --------
    At x = 3L/4 the bracket is 1 + 10/(2 · 0.5) = 11.

    >>> round(float(pd.closed_forms.singular_bar_strain(0.75, 1.0, 0.001)), 6)
    0.011
    """
    beyond = x / length > 0.5
    root = jnp.sqrt(jnp.where(beyond, x / length - 0.5, 1.0))
    return stress_ratio * (1 + jnp.where(beyond, alpha / (2 * root), 0.0))
