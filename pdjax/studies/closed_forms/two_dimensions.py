"""The 2D derivation for a hydrostatic load, printed and corrected, slip by slip (see `SLIPS`).

Every version of the diagonal, for S = κE under x = (1 + a) X and a constant influence, has the form

    ∂f_k/∂x_l = −κ (σ r/(M² h²)) (1+a)^{4m−2} [1 + q (1 − (1+a)^{−2m})] δ_kl,   q = 2gM/r

    M  weighted volume over V      printed πN     S1: πN²                   S1, S2: the number of bonds
    σ  Σ 1/|p|² over the bonds     printed 8 + 2π ln N                      S2: the finite sum
    r  from the tangent dS/dE      printed 2 (κδδ)  S3: 1 (κ/2 δδ, law "bulk"), 5 (κ I_sym, law "symmetric"),
                                                    5 becoming a ratio of finite sums with S2
    g  from the stress term        printed 2 (1/m)  S4: 1 (1/(2m))

so that the critical load is (1 + a)^{2m} = q/(1 + q). It does not depend on σ. With the law "bulk", the correction S2
therefore acts only through the number of bonds. The form with all corrections is the exact discrete diagonal of a
square lattice.

Symbols: p are the bonds over the spacing h, N = δ/h, κ is twice the 2D bulk modulus, d = 2.
Source: Behzadinasab & Foster, section 4.2 and appendices A to C.
"""

from collections.abc import Collection
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ._common import SLIPS, check_dim, check_load, check_ratio, corrected_slips, edge, lattice_bonds
from .lattice import symmetric_ratio

KNOWN = ("S1", "S2", "S3", "S4", "S13", "S14")
LAWS = ("bulk", "symmetric")


class LatticeSums(NamedTuple):
    """Six sums over a 2D family: `sij` = Σ p₁^i p₂^j/|p|^{i+j+2}.

    Attributes
    ----------
    s00, s20, s40, s22, s60, s42 : float
        The sums [-].

    Examples
    --------
    >>> sums = pd.closed_forms.lattice_sums_2d(1)
    >>> sums.s00, sums.s20
    (4.0, 2.0)
    """

    s00: float  # Σ 1/|p|²
    s20: float  # Σ p₁²/|p|⁴
    s40: float  # Σ p₁⁴/|p|⁶
    s22: float  # Σ p₁²p₂²/|p|⁶
    s60: float  # Σ p₁⁶/|p|⁸
    s42: float  # Σ p₁⁴p₂²/|p|⁸


def lattice_sums_2d(N, form="corrected"):
    """Compute the six sums Σ p₁^i p₂^j/|p|^{i+j+2} over a 2D family.

    The paper replaces them by the first ring of neighbours and an integral: 8 + 2π ln N, 4 + π ln N, 4 + ¾π ln N, ¼π ln
    N, 4 + ⅝π ln N, ⅛π ln N. The corrected form computes the finite sums (slip S2).

    Parameters
    ----------
    N : float
        Horizon over spacing [-].
    form : {"corrected", "printed"}
        Which version.

    Returns
    -------
    LatticeSums
        The sums [-]. Divided by h² and multiplied by the thickness b they are those of the paper.

    Raises
    ------
    ValueError
        If N is not a number ≥ 1, or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2, the six lattice sums.

    Examples
    --------
    For N = 1 there are four bonds with |p| = 1, so that Σ 1/|p|² = 4. The printed form gives 8.

    >>> pd.closed_forms.lattice_sums_2d(1).s00, pd.closed_forms.lattice_sums_2d(1, "printed").s00
    (4.0, 8.0)
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
    """Compute L⁻¹ of an isotropic family: (d(d+2)/V_ω) [½ I_sym − δδ/(2(d+2))].

    In 2D it is (2δ_kmδ_ln + 2δ_knδ_lm − δ_klδ_mn)/V_ω.

    Parameters
    ----------
    dim : {1, 2, 3}
        Dimension d.
    weighted_volume : float
        V_ω = ∫ ω dξ [length^dim].

    Returns
    -------
    array, shape (dim, dim, dim, dim)
        L⁻¹ [1/length^dim].

    Raises
    ------
    ValueError
        If dim is not 1, 2 or 3.

    References
    ----------
    Behzadinasab & Foster, appendix A (2D); L⁻¹ : I = (d/V_ω) I in section 3.2.1 for 1D to 3D.

    Examples
    --------
    The component 1111 in 2D is 2 + 2 − 1.

    >>> float(pd.closed_forms.inverse_shape_tensor(2, weighted_volume=1.0)[0, 0, 0, 0])
    3.0
    """
    dim = check_dim(dim)
    one = np.eye(dim)
    pairs = np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one)
    trace = np.einsum("ij,kl->ijkl", one, one)
    return dim * (dim + 2) * jnp.asarray(pairs / 4 - trace / (2 * (dim + 2))) / weighted_volume


def index_tensor_2d():
    """Return the tensor γ_ijklrs: 1 where four indices agree and the other two have the other value, else 0.

    It satisfies δ_ij δ_rs γ_ijklrs = 3 δ_kl.

    Returns
    -------
    array, shape (2, 2, 2, 2, 2, 2)
        γ [-].

    References
    ----------
    Behzadinasab & Foster, section 4.2, the index tensor γ_ijklrs.

    Examples
    --------
    Six indices can be chosen four at a time in 15 ways, and the two values can be swapped.

    >>> int(pd.closed_forms.index_tensor_2d().sum())
    30
    """
    ones = np.indices((2,) * 6).sum(axis=0)
    return jnp.asarray(((ones == 2) | (ones == 4)).astype(float))


def jacobian_2d_uniform(F, m, N, stress, tangent, spacing=1.0, form="corrected"):
    """Compute ∂f_k/∂x_l of the moved point itself under x = F X, with the isotropic L⁻¹ of appendix A.

    The sums over the bonds are the finite ones. The printed weighted volume is V_ω/V = πN; the corrected one is πN²
    (slip S1). Neither is that of the lattice. `jacobian_entry` at η = 0 is exact.

    Parameters
    ----------
    F : array, shape (2, 2)
        Deformation gradient [-].
    m : float
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    stress : array, shape (2, 2)
        S [pressure].
    tangent : array, shape (2, 2, 2, 2)
        dS/dE [pressure].
    spacing : float
        h [length].
    form : {"corrected", "printed"}
        Which version.

    Returns
    -------
    array, shape (2, 2)
        ∂f_k/∂x_l [pressure/length²].

    Raises
    ------
    ValueError
        If N is not a number ≥ 1, or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2, 2D Jacobian of a uniform deformation.

    Examples
    --------
    N = 1 at rest with dS/dE = δδ: the sum over the four bonds is 8 I, and the diagonal is −8/π².

    >>> tangent = np.einsum("ij,kl->ijkl", np.eye(2), np.eye(2))
    >>> entry = pd.closed_forms.jacobian_2d_uniform(np.eye(2), 1.0, 1, np.zeros((2, 2)), tangent)
    >>> round(float(entry[0, 0]), 4)
    -0.8106
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
    """Compute ∂f_k/∂x_l of the moved point itself under x = (1 + a) X, from the six lattice sums and the isotropic L⁻¹.

    Parameters
    ----------
    a : float
        Hydrostatic strain [-], above −1.
    m : float
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    stress : array, shape (2, 2)
        S [pressure].
    tangent : array, shape (2, 2, 2, 2)
        dS/dE [pressure].
    spacing : float
        h [length].
    form : {"corrected", "printed"} or collection of str
        Which version, or the slips to correct out of S1, S2.

    Returns
    -------
    array, shape (2, 2)
        ∂f_k/∂x_l [pressure/length²].

    Raises
    ------
    ValueError
        If a ≤ −1, N is not a number ≥ 1, or form is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2 and appendix B, 2D Jacobian under a hydrostatic load.

    Examples
    --------
    The value of `jacobian_2d_uniform` at rest, −8/π².

    >>> tangent = np.einsum("ij,kl->ijkl", np.eye(2), np.eye(2))
    >>> entry = pd.closed_forms.jacobian_2d_hydrostatic(0.0, 1.0, 1, np.zeros((2, 2)), tangent)
    >>> round(float(entry[0, 0]), 4)
    -0.8106
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
    """A moment tensor: `pure` where all indices agree, `mixed` where each value occurs an even number of times."""
    ones = np.indices((2,) * order).sum(axis=0)
    agree = (ones == 0) | (ones == order)
    return jnp.asarray(np.where(agree, pure, np.where(ones % 2 == 0, mixed, 0.0)))


def _coefficients(N, slips, law):
    """(σ, M, r, g), as the module's docstring defines them."""
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
    """Compute 1 + q (1 − (1+a)^{−2m}), q = 2gM/r, whose sign decides the 2D diagonal; positive is stable.

    M, r and g depend on the corrected slips; see `help(pd.closed_forms.two_dimensions)`. With all of them q = 2M/r. The
    printed form has q = 2πN. At m = 0 it has the branch 1 + 2πN log(1 + a), which is not the limit, 1 (slip S14).

    Parameters
    ----------
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    form : {"corrected", "printed"} or collection of str
        Which version: the exact one, the printed one, or the printed one with these slips corrected, out of S1, S2, S3,
        S4, S13, S14.
    law : {"bulk", "symmetric"}
        The law with S = κE under a hydrostatic load: dS/dE = (κ/2) δδ or κ I_sym. It matters only where S3 is
        corrected.

    Returns
    -------
    array, shape (...)
        The bracket [-].

    Raises
    ------
    ValueError
        If a ≤ −1, N is not a number ≥ 1, or form or law is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2, the two criteria for a hydrostatic load.

    Examples
    --------
    For N = 3 a point has 28 bonds and q = 56. With m = 1 and (1 + a)² = 1/2 the bracket is 1 − 56.

    >>> round(float(pd.closed_forms.bracket_2d(0.5**0.5 - 1, 1.0, 3)), 6)
    -55.0
    """
    a, slips = check_load(a), corrected_slips(form, KNOWN)
    _, volume, ratio, factor = _coefficients(N, slips, law)
    q = 2 * factor * volume / ratio
    bracket = 1 - q * jnp.expm1(-2 * m * jnp.log1p(a))
    return bracket if "S14" in slips else jnp.where(jnp.asarray(m) == 0, 1 + q * jnp.log1p(a), bracket)


def satisfies_criterion_2d(a, m, N, form="corrected", law="bulk"):
    """Return whether the 2D criterion admits the load: the bracket of `bracket_2d` is positive.

    Without the correction S13 the printed criterion demands a negative bracket.

    Parameters
    ----------
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    form : {"corrected", "printed"} or collection of str
        Which version: the exact one, the printed one, or the printed one with these slips corrected, out of S1, S2, S3,
        S4, S13, S14.
    law : {"bulk", "symmetric"}
        The law with S = κE under a hydrostatic load: dS/dE = (κ/2) δδ or κ I_sym. It matters only where S3 is
        corrected.

    Returns
    -------
    array of bool, shape (...)
        False where the criterion calls the load unstable.

    Raises
    ------
    ValueError
        If a ≤ −1, N is not a number ≥ 1, or form or law is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2, the two criteria for a hydrostatic load.

    Examples
    --------
    The printed criterion rejects the body at rest.

    >>> bool(pd.closed_forms.satisfies_criterion_2d(0.0, 1.0, 3))
    True
    >>> bool(pd.closed_forms.satisfies_criterion_2d(0.0, 1.0, 3, form="printed"))
    False
    """
    bracket = bracket_2d(a, m, N, form, law)
    return bracket > 0 if "S13" in corrected_slips(form, KNOWN) else bracket < 0


def diagonal_2d(a, m, N, modulus=1.0, spacing=1.0, form="corrected", law="bulk"):
    """Compute ∂f_k/∂x_k = −κ (σ r/(M²h²)) (1+a)^{4m−2} × `bracket_2d`, both eigenvalues of the 2D diagonal block.

    The paper prints −4(4 + π ln N)/(π²N²h²) κ (1+a)^{4m−2} [1 + 2πN(1 − (1+a)^{−2m})].

    Parameters
    ----------
    a : array, shape (...)
        Hydrostatic strain [-], above −1.
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    modulus : float
        κ, twice the 2D bulk modulus [pressure].
    spacing : float
        h [length].
    form : {"corrected", "printed"} or collection of str
        Which version: the exact one, the printed one, or the printed one with these slips corrected, out of S1, S2, S3,
        S4, S13, S14.
    law : {"bulk", "symmetric"}
        The law with S = κE under a hydrostatic load: dS/dE = (κ/2) δδ or κ I_sym. It matters only where S3 is
        corrected.

    Returns
    -------
    array, shape (...)
        ∂f_k/∂x_k [pressure/length²]. A positive value proves instability.

    Raises
    ------
    ValueError
        If a ≤ −1, N is not a number ≥ 1, or form or law is none of the values above.

    References
    ----------
    Behzadinasab & Foster, appendix C.

    Examples
    --------
    N = 1 at rest: σ = M = 4 and r = 1, so that the diagonal is −4/16.

    >>> float(pd.closed_forms.diagonal_2d(0.0, 1.0, 1))
    -0.25
    """
    a = check_load(a)
    sigma, volume, ratio, _ = _coefficients(N, corrected_slips(form, KNOWN), law)
    scale = modulus * sigma * ratio / (volume * spacing) ** 2
    return -scale * (1 + a) ** (4 * m - 2) * bracket_2d(a, m, N, form, law)


def critical_load_2d(m, N, form="corrected", law="bulk"):
    """Compute the hydrostatic strain at which the 2D diagonal loses its stability: the root of `bracket_2d`.

    log(1 + a) = −log(1 + 1/q)/(2m)

    The diagonal is unstable beyond the root, on the side away from 0. The root is negative for m > 0, positive for m <
    0, +inf at m = 0. At m = 0 the printed branch gives e^{−1/q} − 1 instead (slip S14).

    Parameters
    ----------
    m : array, shape (...)
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    form : {"corrected", "printed"} or collection of str
        Which version: the exact one, the printed one, or the printed one with these slips corrected, out of S1, S2, S3,
        S4, S13, S14.
    law : {"bulk", "symmetric"}
        The law with S = κE under a hydrostatic load: dS/dE = (κ/2) δδ or κ I_sym. It matters only where S3 is
        corrected.

    Returns
    -------
    array, shape (...)
        a_cr [-].

    Raises
    ------
    ValueError
        If N is not a number ≥ 1, or form or law is none of the values above.

    References
    ----------
    Behzadinasab & Foster, section 4.2, the two criteria for a hydrostatic load.

    Examples
    --------
    For N = 3, q = 2 · 28 bonds, and (1 + a)² = 56/57 for m = 1.

    >>> round(float(pd.closed_forms.critical_load_2d(1.0, 3)), 5)
    -0.00881
    """
    slips = corrected_slips(form, KNOWN)
    _, volume, ratio, factor = _coefficients(N, slips, law)
    q = 2 * factor * volume / ratio
    m = jnp.asarray(m, dtype=jnp.result_type(m, float))
    # `edge` solves it with z = 1/(2mq). At m = 0 there is no root.
    z = jnp.where(m == 0, -jnp.inf, 1 / (2 * q * jnp.where(m == 0, 1.0, m)))
    return edge(z, m) if "S14" in slips else jnp.where(m == 0, jnp.expm1(-1 / q), edge(z, m))


class Step(NamedTuple):
    """One row of `chain_2d`.

    Attributes
    ----------
    slip : str
        The slip corrected in this row, or "printed".
    corrected : tuple of str
        All slips corrected so far.
    what : str
        The slip in words.
    q : float
        q of `bracket_2d` [-].
    load : array, shape ()
        The critical load [-].

    Examples
    --------
    The printed criterion for N = 3 has q = 2πN = 18.85.

    >>> first = pd.closed_forms.chain_2d()[0]
    >>> first.slip, round(first.q, 2)
    ('printed', 18.85)
    """

    slip: str
    corrected: tuple[str, ...]
    what: str
    q: float
    load: jax.Array


def chain_2d(m=1.0, N=3, law="bulk", order: Collection[str] = ("S13", "S14", "S4", "S1", "S3", "S2")):
    """Compute the critical load of the 2D diagonal from the printed to the exact criterion, correcting one slip a row.

    Parameters
    ----------
    m : float
        Order of the Seth–Hill strain [-].
    N : float
        Horizon over spacing [-].
    law : {"bulk", "symmetric"}
        The law with S = κE under a hydrostatic load: dS/dE = (κ/2) δδ or κ I_sym.
    order : collection of str
        Order of the corrections.

    Returns
    -------
    list of Step
        The first row is the printed criterion. The last row is exact for the lattice if all slips are corrected.

    Raises
    ------
    ValueError
        If N is not a number ≥ 1, or law or order is none of the values above.

    References
    ----------
    Remark 5 of Behzadinasab & Foster quotes −0.037 for m = 1, N = 3. No row of this table has this value (slip S5).

    Examples
    --------
    >>> [(step.slip, round(float(step.load), 3)) for step in pd.closed_forms.chain_2d()[-3:]]
    [('S1', -0.017), ('S3', -0.009), ('S2', -0.009)]
    """
    steps: list[Step] = []
    done: tuple[str, ...] = ()
    for slip in ("printed", *order):
        done = done if slip == "printed" else (*done, slip)
        _, volume, ratio, factor = _coefficients(N, corrected_slips(done, KNOWN), law)
        what = SLIPS.get(slip, "as printed")
        steps.append(Step(slip, done, what, 2 * factor * volume / ratio, critical_load_2d(m, N, done, law)))
    return steps
