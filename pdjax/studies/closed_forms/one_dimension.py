"""The 1D analytic forms: diagonal, criterion, critical load; the plane wave; the singular bar.

    ∂f/∂x = −(2 H (1+a)^{2m−2} / (N h²)) [ (dS/dE)(1+a)^{2m}/(4N) + (2m−1) S ],   H = Σ_{p=1}^N 1/p²
    S = κE:   stable only if   b(a) = (1+a)^{2m}/(4N) + (2m−1) E_m(a) > 0,   E_m = ((1+a)^{2m} − 1)/(2m)

b is smooth through m = 0, where it is 1/(4N) − log(1+a): both printed branches are one function. In 1D L =
2N V is exact on the lattice, so these forms are the exact discrete ones; no slip was found in them.

Symbols: h spacing, N = δ/h, κ modulus, ω = 1, u₀ amplitude, k wave number, ρ mass density.
Source: Behzadinasab & Foster, section 4.1 (eqn:df1D), section 5.1 and section 5.4 (eqn:dispersion4).
"""

import jax.numpy as jnp
import numpy as np

from ..._internal.checks import is_concrete
from ._common import check_load, check_ratio, edge, hydrostatic_strain


def _harmonic(N):
    return float(np.sum(1.0 / np.arange(1, N + 1) ** 2))


def diagonal_1d(a, m, N, stress, tangent, spacing=1.0):
    """∂f/∂x of the discrete bar in x = (1 + a) X, for any law: the formula of the module's head.

    Arguments: a (...) [-]; m (...) [-]; N whole number; stress S (...) and tangent dS/dE (...) [pressure];
    spacing h [length]. Returns: (...) [pressure/length²]. Raises: ValueError for a, N. Source: eqn:df1D.
    """
    a, N = check_load(a), check_ratio(N, whole=True)
    bracket = tangent * (1 + a) ** (2 * m) / (4 * N) + (2 * m - 1) * stress
    return -2 * _harmonic(N) * (1 + a) ** (2 * m - 2) / (N * spacing**2) * bracket


def bracket_1d(a, m, N):
    """b(a) = (1+a)^{2m}/(4N) + (2m−1) E_m(a) for S = κE; the diagonal is stable where it is positive.

    Arguments: a (...) [-]; m (...) [-]; N whole number. Returns: (...) [-]. Raises: ValueError for a, N.
    Source: the two criteria after eqn:S1d, joined smoothly at m = 0.
    """
    a, N = check_load(a), check_ratio(N, whole=True)
    return (1 + a) ** (2 * m) / (4 * N) + (2 * m - 1) * hydrostatic_strain(a, m)


def critical_load_1d(m, N):
    """The root of `bracket_1d`: (1 + a)^{−2m} = 1 + 2m/(4N(2m − 1)); unstable beyond it, away from 0.

    Negative (compression) for m > 1/2, positive below; +inf where the diagonal never fails,
    2N/(4N + 1) ≤ m ≤ 1/2.

    Arguments: m (...) [-]; N whole number. Returns: (...) [-]. Raises: ValueError for N.
    Source: the criteria after eqn:S1d; Remark 4 quotes −0.184 (m = 1, N = 1) and −0.074 (N = 3).
    """
    N = check_ratio(N, whole=True)
    slope = 4 * N * (2 * jnp.asarray(m, dtype=jnp.result_type(m, float)) - 1)
    return edge(jnp.where(slope == 0, -jnp.inf, 1 / jnp.where(slope == 0, 1.0, slope)), m)


def dispersion_1d(k, amplitude, m, N, modulus=1.0, density=1.0, spacing=1.0, X=0.0):
    """ω² of u = u₀ e^{i(kX−ωt)} at t = 0 and X, the paper's 0 by default, S = κE: −ρu₀ω² e^{ikX} = Σ V [S(X) + S(X+ξ)]
    (Y²/ξ²)^{m−1} Y/(ω₀ξ²).

    The wave enters as a complex displacement into a nonlinear law, so ω² is complex and no motion of the
    bar: only its limit u₀ → 0 is (`dispersion_limit_1d`). It depends on X, and
    its imaginary part flips with the sign of u₀, which for a real wave is a shift by half its length.

    Arguments: k (...) [1/length]; amplitude u₀ ≠ 0 [length]; m scalar [-]; N whole; modulus κ [pressure];
    density ρ; spacing h, X [length]. Returns: complex (...) [1/time²]. Raises: ValueError for N, amplitude =
    0. Source: eqn:dispersion1 to eqn:dispersion4.
    """
    N = check_ratio(N, whole=True)
    if isinstance(amplitude, (int, float)) and amplitude == 0:
        raise ValueError("amplitude must not be 0; the limit is dispersion_limit_1d")
    phase = 1j * jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None]
    xi = spacing * jnp.asarray(lattice_numbers(N), dtype=phase.real.dtype)

    def stretch(at):
        """log |Y|/|ξ| of every bond of the point at X = at, continued to complex displacements."""
        lifted = amplitude * jnp.exp(phase[..., None] * at[:, None]) * jnp.expm1(phase[..., None] * xi)
        return jnp.log1p(lifted / xi)

    def stress(at):
        x = 2 * m * stretch(at)
        small = jnp.abs(x) < 1e-4  # series error 1e-16/120 relative; m = 0 lands here
        quotient = jnp.where(small, 1 + x / 2 + x**2 / 6 + x**3 / 24, jnp.expm1(x) / jnp.where(small, 1, x))
        return modulus * jnp.mean(stretch(at) * quotient, axis=-1)

    here = jnp.full(1, X, dtype=xi.dtype)
    log_s = stretch(here)[..., 0, :]
    pair = stress(here) + stress(here + xi)
    start = density * amplitude * jnp.exp(phase[..., 0] * X)
    return -jnp.mean(pair * jnp.exp((2 * m - 1) * log_s) / xi, axis=-1) / start


def lattice_numbers(N):
    """−N … −1, 1 … N."""
    return np.concatenate([np.arange(-N, 0), np.arange(1, N + 1)]).astype(float)


def dispersion_limit_1d(k, N, modulus=1.0, density=1.0, spacing=1.0):
    """ω² as u₀ → 0, the same for every m: κ/(ρN²h²) (Σ_{p=1}^N sin(kph)/p)²; zero at k = π/h.

    Arguments: k (...) [1/length]; N whole; modulus κ [pressure]; density ρ; spacing h [length].
    Returns: (...) [1/time²]. Raises: ValueError for N. Source: limit of eqn:dispersion4 (ours).
    """
    N = check_ratio(N, whole=True)
    p = np.arange(1, N + 1)
    k = jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None]
    return modulus / (density * N**2 * spacing**2) * jnp.sum(jnp.sin(k * p * spacing) / p, axis=-1) ** 2


def dispersion_continuum_1d(k, horizon, modulus=1.0, density=1.0):
    """ω² of the continuum, h → 0 at a fixed horizon, about rest: κ/(ρδ²) Si(kδ)², Si the sine integral.

    Si(x) > 0 for x > 0: no wave has frequency 0, the zero of `dispersion_limit_1d` at k = π/h is the lattice's. At a
    fixed k that tends to this, at the first order in h.

    Arguments: k (...) [1/length], |k| δ ≤ 200; horizon δ > 0 [length]; modulus κ [pressure]; density ρ.
    Returns: (...) [1/time²]. Raises: ValueError for |k| δ > 200 or δ ≤ 0. Source: ours; the integral that the sum of
    `dispersion_limit_1d` is for.
    """
    if is_concrete(k, horizon) and not (np.all(np.abs(np.asarray(k) * horizon) <= 200) and np.all(horizon > 0)):
        raise ValueError("horizon must be positive and |k| horizon at most 200, which the quadrature resolves")
    t, weight = np.polynomial.legendre.leggauss(160)  # Si(x) = ∫₀¹ sin(xt)/t dt, to 6e-13 for |x| ≤ 200
    t, weight = 0.5 * (t + 1), 0.5 * weight
    x = jnp.asarray(k, dtype=jnp.result_type(k, float))[..., None] * horizon
    return modulus / (density * horizon**2) * jnp.sum(weight * jnp.sin(x * t) / t, axis=-1) ** 2


def clamped_bar_critical_strain(free, N):
    """Leading order, for many free points, of the compression at which a clamped bar of order m = 1 becomes unstable.

    Near the zone's edge, k = π/h − q/h, the undeformed chain has λ = −κ/(N²h²) s(q)², s = −Σ (−1)^p sin(qp)/p, and a
    strain a adds −(4aκ/(Nh²)) Σ_{p odd} 1/p². The smallest q² that clamps allow is (π/n)² where s ≈ q (odd N); where
    s ≈ N(N+1) q³/12 (even N) the edge mode obeys a clamped sixth-order equation, q⁶ = (2π/n)⁶. So

        a_cr = −C (π/n)² (odd N),   −C (N(N+1)/12)² (2π/n)⁶ (even N),      1/C = 4 N Σ_{p odd ≤ N} 1/p²

    Arguments: free points n (...) between the clamps; N whole number. Returns: (...) [-]. Raises: ValueError for N.
    The relative error is of the order N/n. Source: ours; the symbol of eqn:dispersion4's limit with its stress term.
    """
    N = check_ratio(N, whole=True)
    p = np.arange(1, N + 1)
    softening = 4 * N * np.sum(1.0 / p[p % 2 == 1] ** 2)
    n = jnp.asarray(free, dtype=float)
    stiffness = (np.pi / n) ** 2 if N % 2 else (N * (N + 1) / 12) ** 2 * (2 * np.pi / n) ** 6
    return -stiffness / softening


def singular_bar_displacement(x, length, stress_ratio, alpha=10.0):
    """Local small-strain solution: u = (σ/E₀) L [x/L + α √(x/L − ½)], the root only beyond x = L/2.

    Arguments: x (...) [length], from the fixed end; length L; stress_ratio σ/E₀ [-]; alpha α [-].
    Returns: (...) [length]. Source: section 5.1.
    """
    beyond = jnp.maximum(x / length - 0.5, 0.0)
    return stress_ratio * length * (x / length + alpha * jnp.sqrt(beyond))


def singular_bar_strain(x, length, stress_ratio, alpha=10.0):
    """Local small-strain solution: ε = (σ/E₀) [1 + α/(2√(x/L − ½))], the second term only beyond x = L/2.

    Also E₀/E(x) times σ/E₀. Arguments, returns [-] and source: as `singular_bar_displacement`.
    """
    beyond = x / length > 0.5
    root = jnp.sqrt(jnp.where(beyond, x / length - 0.5, 1.0))
    return stress_ratio * (1 + jnp.where(beyond, alpha / (2 * root), 0.0))
