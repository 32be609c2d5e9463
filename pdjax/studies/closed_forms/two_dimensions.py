"""The 2D analytic chain for hydrostatic load, printed and corrected, slip by slip (see `SLIPS`).

Every version of the diagonal, for S = κE under x = (1 + a) X, constant influence, is

    ∂f_k/∂x_l = −κ (σ r/(M² h²)) (1+a)^{4m−2} [1 + q (1 − (1+a)^{−2m})] δ_kl,   q = 2gM/r

    M  weighted volume over V      printed πN     S1: πN²                   S1, S2: the number of bonds
    σ  Σ 1/|p|² over the bonds     printed 8 + 2π ln N                      S2: the finite sum
    r  from the tangent dS/dE      printed 2 (κδδ)  S3: 1 (κ/2 δδ, law "bulk"), 5 (κ I_sym, law "symmetric"),
                                                    5 becoming a ratio of finite sums with S2
    g  from the stress term        printed 2 (1/m)  S4: 1 (1/(2m))

so that the critical load is (1 + a)^{2m} = q/(1 + q). σ drops out of it: with the law "bulk", S2 matters
only by counting the bonds. The fully corrected form is the exact discrete diagonal of a square lattice.

Symbols: p bonds over the spacing h, N = δ/h, κ twice the 2D bulk modulus, d = 2.
Source: Behzadinasab & Foster, section 4.2 and appendices A to C.
"""

from collections.abc import Collection
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ._common import SLIPS, check_dim, check_load, check_ratio, corrected_slips, edge, lattice_bonds
from .lattice import symmetric_ratio

KNOWN = ("S1", "S2", "S3", "S4", "S13", "S14")
LAWS = ("bulk", "symmetric")


class LatticeSums(NamedTuple):
    """Sums `sij` = Σ p₁^i p₂^j/|p|^{i+j+2} over a family [-]."""

    s00: Any  # Σ 1/|p|²
    s20: Any  # Σ p₁²/|p|⁴
    s40: Any  # Σ p₁⁴/|p|⁶
    s22: Any  # Σ p₁²p₂²/|p|⁶
    s60: Any  # Σ p₁⁶/|p|⁸
    s42: Any  # Σ p₁⁴p₂²/|p|⁸


def lattice_sums_2d(N, form="corrected"):
    """The six sums over a 2D family: printed (first ring and an integral) or the finite sums (S2).

    Printed: 8 + 2π ln N, 4 + π ln N, 4 + ¾π ln N, ¼π ln N, 4 + ⅝π ln N, ⅛π ln N.

    Arguments: N horizon over spacing [-]; form. Returns: `LatticeSums` [-]; over h² and times b they are
    the paper's. Raises: ValueError for N, form. Source: the displays after eqn:2Ddfs.
    """
    N = check_ratio(N)
    if not corrected_slips(form, ("S2",)):
        ring = float(np.pi * np.log(N))
        return LatticeSums(8 + 2 * ring, 4 + ring, 4 + 3 * ring / 4, ring / 4, 4 + 5 * ring / 8, ring / 8)
    x2, y2 = (lattice_bonds(2, N) ** 2).T
    r2 = x2 + y2
    terms = (1 / r2, x2 / r2**2, x2**2 / r2**3, x2 * y2 / r2**3, x2**3 / r2**4, x2**2 * y2 / r2**4)
    return LatticeSums(*(float(np.sum(term)) for term in terms))


def inverse_shape_tensor(dim, weighted_volume):
    """L⁻¹ of an isotropic family: (d(d+2)/V_ω) [½ I_sym − δδ/(2(d+2))].

    In 2D it is (2δ_kmδ_ln + 2δ_knδ_lm − δ_klδ_mn)/V_ω.

    Arguments: dim 1, 2 or 3; weighted_volume V_ω = ∫ ω dξ [length^d]. Returns: (dim, dim, dim, dim)
    [1/length^d]. Raises: ValueError for dim. Source: appendix A (2D); L⁻¹ : I = (d/V_ω) I in sections 3.2.1
    for 1D to 3D.
    """
    dim = check_dim(dim)
    one = np.eye(dim)
    pairs = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    trace = np.einsum("ij,kl->ijkl", one, one)
    return dim * (dim + 2) * jnp.asarray(pairs / 4 - trace / (2 * (dim + 2))) / weighted_volume


def index_tensor_2d():
    """γ_ijklrs: 1 where four indices agree and two take the other value; δ_ij δ_rs γ_ijklrs = 3 δ_kl.

    Returns: (2, 2, 2, 2, 2, 2) [-]. Source: eqn:gamma.
    """
    ones = np.indices((2,) * 6).sum(axis=0)
    return jnp.asarray(((ones == 2) | (ones == 4)).astype(float))


def jacobian_2d_uniform(F, m, N, stress, tangent, spacing=1.0, form="corrected"):
    """∂f_k/∂x_l of the moved point itself, in x = F X, as finite sums with the *isotropic* L⁻¹ of appendix A.

    Printed: V_ω/V = πN; corrected πN² (S1). Neither is the lattice's own: `jacobian_entry` at η = 0 is.

    Arguments: F (2, 2) [-]; m () [-]; N; stress S (2, 2) and tangent dS/dE (2, 2, 2, 2) [pressure]; spacing
    h [length]; form. Returns: (2, 2) [pressure/length²]. Raises: ValueError for N, form. Source: eqn:2Ddf.
    """
    volume = np.pi * check_ratio(N) * (N if corrected_slips(form, ("S1",)) else 1)
    p = jnp.asarray(lattice_bonds(2, N))
    r2 = jnp.sum(p**2, axis=1)
    y = p @ jnp.asarray(F, dtype=p.dtype).T
    s2 = jnp.sum(y**2, axis=1) / r2
    yy = jnp.einsum("bk,bl->bkl", y, y) / jnp.sum(y**2, axis=1)[:, None, None]
    dual = 4 * jnp.einsum("bi,bj->bij", p, p) / r2[:, None, None] - jnp.eye(2)
    strain_work = jnp.einsum("bij,ijrs,brs->b", dual, tangent, dual) * s2 ** (2 * m - 1) / r2
    stress_work = jnp.einsum("ij,bij->b", stress, dual) * s2 ** (m - 1) / r2
    first = -jnp.einsum("b,bkl->kl", strain_work, yy) / volume**2
    second = jnp.einsum("b,bkl->kl", stress_work, 2 * (m - 1) * yy + jnp.eye(2))
    return (first - 2 * second / volume) / spacing**2


def jacobian_2d_hydrostatic(a, m, N, stress, tangent, spacing=1.0, form="corrected"):
    """∂f_k/∂x_l of the moved point itself, x = (1 + a) X, by the six lattice sums and the isotropic L⁻¹.

    Arguments: a, m () [-]; others as `jacobian_2d_uniform`; form may name slips out of S1, S2.
    Returns: (2, 2) [pressure/length²]. Raises: ValueError for a, N, form. Source: eqn:2Ddfss, appendix B.
    """
    a = check_load(a)
    slips = corrected_slips(form, ("S1", "S2"))
    sums = lattice_sums_2d(N, "corrected" if "S2" in slips else "printed")
    volume = np.pi * N**2 if "S1" in slips else np.pi * N
    one = np.eye(2)
    second = one * sums.s20
    fourth = _even_tensor(4, sums.s40, sums.s22)
    sixth = _even_tensor(6, sums.s60, sums.s42)
    dual_dual = (
        16 * jnp.einsum("ijklrs->klijrs", sixth)
        - 4 * jnp.einsum("rs,ijkl->klijrs", one, fourth)
        - 4 * jnp.einsum("ij,klrs->klijrs", one, fourth)
        + jnp.einsum("ij,rs,kl->klijrs", one, one, second)
    )
    dual = (
        8 * (m - 1) * jnp.einsum("ijkl->klij", fourth)
        + 4 * jnp.einsum("kl,ij->klij", one, second)
        - 2 * (m - 1) * jnp.einsum("ij,kl->klij", one, second)
        - jnp.einsum("ij,kl->klij", one, one) * sums.s00
    )
    first = -((1 + a) ** (4 * m - 2)) * jnp.einsum("klijrs,ijrs->kl", dual_dual, tangent) / volume**2
    rest = -2 * (1 + a) ** (2 * m - 2) * jnp.einsum("klij,ij->kl", dual, stress) / volume
    return (first + rest) / spacing**2


def _even_tensor(order, pure, mixed):
    """A moment tensor: `pure` where all indices agree, `mixed` where both values occur evenly often."""
    ones = np.indices((2,) * order).sum(axis=0)
    agree = (ones == 0) | (ones == order)
    return jnp.asarray(np.where(agree, pure, np.where(ones % 2 == 0, mixed, 0.0)))


def _coefficients(N, slips, law):
    """(σ, M, r, g) of the module's head."""
    if law not in LAWS:
        raise ValueError(f"law must be one of {', '.join(LAWS)}; got {law!r}")
    N = check_ratio(N)
    exact = "S2" in slips
    sigma = lattice_sums_2d(N, "corrected" if exact else "printed").s00
    volume = np.pi * N
    if "S1" in slips:
        volume = float(len(lattice_bonds(2, N))) if exact else np.pi * N**2
    ratio = 2.0
    if "S3" in slips:
        ratio = 1.0 if law == "bulk" else (symmetric_ratio(2, N) if exact else 5.0)
    return sigma, volume, ratio, 1.0 if "S4" in slips else 2.0


def bracket_2d(a, m, N, form="corrected", law="bulk"):
    """1 + q (1 − (1+a)^{−2m}), q = 2gM/r: the sign that decides the 2D diagonal; positive is stable.

    Printed q = 2πN, and at m = 0 the branch 1 + 2πN log(1 + a), which is not the limit 1 (S14).

    Arguments: a, m (...) [-]; N; form "printed", "corrected" or the slips to correct, out of S1 S2 S3 S4
    S13 S14; law "bulk" (dS/dE = κ/2 δδ) or "symmetric" (κ I_sym), seen with S3. Returns: (...) [-]. Raises:
    ValueError for a, N, form, law. Source: the criteria after eqn:hydro2De.
    """
    a, slips = check_load(a), corrected_slips(form, KNOWN)
    _, volume, ratio, factor = _coefficients(N, slips, law)
    q = 2 * factor * volume / ratio
    bracket = 1 - q * jnp.expm1(-2 * m * jnp.log1p(a))
    return bracket if "S14" in slips else jnp.where(jnp.asarray(m) == 0, 1 + q * jnp.log1p(a), bracket)


def satisfies_criterion_2d(a, m, N, form="corrected", law="bulk"):
    """Whether the criterion calls the load not unstable: bracket > 0; as printed (without S13), bracket < 0.

    Arguments, raises and source: as `bracket_2d`. Returns: (...) bool.
    """
    bracket = bracket_2d(a, m, N, form, law)
    return bracket > 0 if "S13" in corrected_slips(form, KNOWN) else bracket < 0


def diagonal_2d(a, m, N, modulus=1.0, spacing=1.0, form="corrected", law="bulk"):
    """∂f_k/∂x_k = −κ (σ r/(M²h²)) (1+a)^{4m−2} × `bracket_2d`, both eigenvalues of the 2D diagonal block.

    Printed: −4(4 + π ln N)/(π²N²h²) κ (1+a)^{4m−2} [1 + 2πN(1 − (1+a)^{−2m})].

    Arguments: modulus κ, twice the 2D bulk modulus [pressure]; spacing h [length]; others as `bracket_2d`.
    Returns: (...) [pressure/length²]. Raises: ValueError for a, N, form, law. Source: appendix C.
    """
    a = check_load(a)
    sigma, volume, ratio, _ = _coefficients(N, corrected_slips(form, KNOWN), law)
    scale = modulus * sigma * ratio / (volume * spacing) ** 2
    return -scale * (1 + a) ** (4 * m - 2) * bracket_2d(a, m, N, form, law)


def critical_load_2d(m, N, form="corrected", law="bulk"):
    """The root of `bracket_2d`: log(1 + a) = −log(1 + 1/q)/(2m); unstable beyond it, away from 0.

    Negative for m > 0, positive for m < 0, +inf at m = 0; the printed branch at m = 0 gives e^{−1/q} − 1
    instead.

    Arguments, raises and source: as `bracket_2d`, without a. Returns: (...) [-].
    """
    slips = corrected_slips(form, KNOWN)
    _, volume, ratio, factor = _coefficients(N, slips, law)
    q = 2 * factor * volume / ratio
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    # In terms of `edge`: z = 1/(2mq); at m = 0 there is no root.
    z = jnp.where(m == 0, -jnp.inf, 1 / (2 * q * jnp.where(m == 0, 1.0, m)))
    return edge(z, m) if "S14" in slips else jnp.where(m == 0, jnp.expm1(-1 / q), edge(z, m))


class Step(NamedTuple):
    """One row of the chain: the slip corrected here, all corrected so far, q and the critical load."""

    slip: str
    corrected: tuple[str, ...]
    what: str
    q: float
    load: jax.Array


def chain_2d(m=1.0, N=3, law="bulk", order: Collection[str] = ("S13", "S14", "S4", "S1", "S3", "S2")):
    """The critical load of the 2D diagonal from the printed criterion to the exact one, one slip at a time.

    Arguments: m () [-]; N; law; order of the corrections. Returns: list of `Step`, the first with slip
    "printed", the last exact for the lattice if all are corrected. Raises: ValueError for N, law, order.
    Source: Remark 5 quotes −0.037 for m = 1, N = 3, which is no row of this table (S5).
    """
    steps: list[Step] = []
    done: tuple[str, ...] = ()
    for slip in ("printed", *order):
        done = done if slip == "printed" else (*done, slip)
        _, volume, ratio, factor = _coefficients(N, corrected_slips(done, KNOWN), law)
        what = SLIPS.get(slip, "as printed")
        steps.append(Step(slip, done, what, 2 * factor * volume / ratio, critical_load_2d(m, N, done, law)))
    return steps
