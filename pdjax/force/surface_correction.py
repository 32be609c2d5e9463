"""Surface correction: bond weights that make up for the neighbours which a point near a surface lacks.

A family at a surface is not a full ball, so the moduli of `BondBased` and `LPS` are wrong there. A factor β_ij on each
bond corrects part of the error. It is symmetric, β_ij = β_ji, so forces stay the gradient of an energy.

**volume** (Le & Bobaru 2018). V_i = Σ_j ω_ij V_j is the volume of the family of point i and V₀ that of a full one:

    β_ij = 2 V₀/(V_i + V_j)

**energy** (Madenci & Oterkus 2014). W_ik is the energy density of point i under a unit extension along axis k, and W₀ₖ
that of a full family. The factors g_ik = W₀ₖ/W_ik are averaged over both ends, and an ellipsoid with the averages as
semi-axes gives the factor of a bond along the unit vector n:

    β_ij = 1/√(Σ_k (n_k/ḡ_k)²),    ḡ_k = (g_ik + g_jk)/2

A bond shares its factor with its other end, so the energies are not W₀ₖ afterwards. The method is therefore applied
again to the corrected bonds, and the factors are multiplied. The published method is a single pass.

**What the methods can do.** The surface of a bond-based body is too soft, because bonds are missing. Both methods make
it stiffer. "volume" overshoots for loads along the surface, since it replaces bonds at right angles to the load.
"energy" with many passes makes the energy of every point exact under an extension along each axis.

LPS divides its sums by the weighted volume. A factor that all bonds of a family share changes nothing, and a half ball
already has the right moduli. The error comes from the points at a distance 0 < z < δ from the surface, where the family
lacks a cap. There Σ w ξ⊗ξ is not isotropic, the dilatation θ is wrong under an extension, and the body is too stiff
along the surface. "volume" gives large weights to the bonds along the surface, which makes this error larger. "energy"
compares the energies of LPS itself, which depend on Poisson's ratio, and gives these bonds smaller weights. It does not
converge to exact energies: five passes leave some percent, and far more passes make the weights extreme.

Neither method corrects the energy of shear. The axes are those of the coordinates.

Sources: Le & Bobaru 2018, Comput. Mech. 61, 499–518; Madenci & Oterkus 2014, sections 4.2 and 7.
"""

import numpy as np
from jaxtyping import Array, Float

from .._internal.checks import choice, is_concrete, on_device
from .._internal.public import public_function
from ..geometry.bonds import Families, cells_within
from ..models.base import AbstractModel
from .fields import check_model

METHODS = ("energy", "volume")
ROWS = 20_000  # points whose energies are computed at a time, so that memory grows with the weights alone


def _influence_at(families: Families, r: np.ndarray) -> np.ndarray:
    """ω at the lengths r, interpolated between the lengths of the bonds of the body."""
    known, omega = np.asarray(families.is_bond), np.asarray(families.influence)
    lengths = np.linalg.norm(np.asarray(families.xi), axis=-1)[known]
    lengths, first = np.unique(lengths, return_index=True)
    return np.interp(r, lengths, omega[known][first])


def _directions(dim: int) -> np.ndarray:
    """Unit vectors whose mean of n⊗n⊗n⊗n is that of all directions, (directions, dim)."""
    if dim == 1:
        return np.array([[1.0], [-1.0]])
    if dim == 2:
        angle = 2 * np.pi * np.arange(6) / 6
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    golden = (1 + 5**0.5) / 2  # the vertices of an icosahedron
    first = np.array([[0.0, a, b * golden] for a in (-1, 1) for b in (-1, 1)])
    vertices = np.concatenate([np.roll(first, k, axis=1) for k in range(3)])
    return vertices / np.sqrt(1 + golden**2)


def full_family(families: Families) -> tuple[np.ndarray, np.ndarray]:
    """w = ω V (1, bonds) and ξ (1, bonds, dim) of a full family: the lattice's own one, or a ball for a cloud."""
    dim, horizon = families.dim, float(families.horizon)
    if families.spacing is not None:
        h = families.spacing
        xi = cells_within(dim, horizon / h) * h
        volume = np.full(len(xi), h**dim)
    else:
        q, weight = np.polynomial.legendre.leggauss(64)
        ball = {1: 2.0, 2: np.pi, 3: 4 / 3 * np.pi}[dim]
        own = min((float(np.median(families.volumes)) / ball) ** (1 / dim), horizon / 2)  # a point is not its neighbour
        r, step = own + (horizon - own) * (1 + q) / 2, (horizon - own) * weight / 2
        n = _directions(dim)
        shell = dim * ball * r ** (dim - 1) * step
        xi = (r[:, None, None] * n).reshape(-1, dim)
        volume = np.repeat(shell / len(n), len(n))
    return (_influence_at(families, np.linalg.norm(xi, axis=1)) * volume)[None], xi[None]


def _by_volume(families: Families, w: np.ndarray) -> np.ndarray:
    V, full = w.sum(axis=1), float(full_family(families)[0].sum())
    total = V[:, None] + V[np.asarray(families.neighbours)]
    return np.divide(2 * full, total, out=np.ones_like(w), where=total > 0)


def _by_energy(model: AbstractModel, families: Families, w: np.ndarray, passes: int) -> np.ndarray:
    neighbours, xi = np.asarray(families.neighbours), np.asarray(families.xi)
    full = model.extension_energies(lambda *powers: _axis_sums(*full_family(families), *powers))
    beta = np.ones_like(w)
    for _ in range(passes):
        now = w * beta
        energies = model.extension_energies(lambda *powers, now=now: _axis_sums(now, xi, *powers))
        # A family without bonds, or in a plane at right angles to an axis, has no energy to correct.
        g = np.divide(full, energies, out=np.ones(energies.shape), where=energies > 0)
        for at in range(0, len(w), ROWS):
            part = slice(at, at + ROWS)
            n = xi[part] / np.linalg.norm(xi[part], axis=-1, keepdims=True)
            mean = (g[part, None] + g[neighbours[part]]) / 2
            beta[part] /= np.sqrt(np.sum((n / mean) ** 2, axis=-1))
    return beta


def _axis_sums(w: np.ndarray, xi: np.ndarray, power: int, order: int) -> np.ndarray:
    """Σ w |ξ|^power n_k^order along every axis k, n = ξ/|ξ|, shape (families, dim)."""
    sums = np.empty((len(w), xi.shape[-1]))
    for at in range(0, len(w), ROWS):
        part = slice(at, at + ROWS)
        r = np.linalg.norm(xi[part], axis=-1)
        sums[part] = np.einsum("pb,pbk->pk", w[part] * r ** (power - order), xi[part] ** order)
    return sums


@public_function
def surface_correction(
    model: AbstractModel, families: Families, method: str = "energy", passes: int = 3
) -> Float[Array, "points bonds"]:
    """Compute bond weights that correct the moduli of bond-based and LPS bodies near surfaces.

    Parameters
    ----------
    model : AbstractModel
        A `BondBased` or `LPS` model.
    families : Families
        Families of the body, from `families`. Bonds that are cut count as missing.
    method : {"energy", "volume"}, optional
        "energy" compares the energies of every point under extensions along the axes with those of a full family.
        "volume" compares the volumes of the families.
    passes : int, optional
        Number of times that "energy" is applied. 1 is the published method. Default 3.

    Returns
    -------
    array, shape (points, bonds)
        Factors β_ij = β_ji > 0 [-] for `families.with_weight`. They are 1 for bonds farther from all surfaces than
        `passes` + 1 horizons, and for padding.

    Raises
    ------
    ValueError
        If the model needs no such correction or has none, the method is unknown, `passes` is not a whole number > 0, an
        argument is traced, the families have a horizon for each point, or they were made with `arrays=False`.

    Notes
    -----
    A full family is that of the interior of the lattice, or for a cloud a ball without the cell of its centre. In a
    cloud the factors also correct the error of the sums as integrals, so they are not exactly 1 in the interior. ω of a
    full family is interpolated between the lengths of the bonds that the body has.

    The strain in the middle of a plate of 30 × 10 points that is pulled at its ends (horizon 3.015 spacings) has an
    error of +6.0 % with `BondBased`, −9.0 % with "volume", −2.9 % with one pass of "energy" and −1.1 % with three. For
    `LPS` in plane stress with ν = ¼ the errors are −10.8 %, −12.4 %, −5.1 % and −1.6 %. The error falls with the width
    of the plate (benchmarks/surface_correction.py).

    In 3D a bar of 24 × 7 × 7 points keeps an error
    of −4.0 % (`BondBased`) and −7.0 % (`LPS`, ν = ¼) with three passes, from +23.2 % and −19.9 %.

    Correspondence models need no correction, because their mean deformation gradient is exact for affine maps at
    surfaces too. Do not combine the correction with `BondBased.from_family(bulk, families)`, whose micromoduli are
    already larger at surfaces.

    References
    ----------
    Le & Bobaru 2018; Madenci & Oterkus 2014.

    Examples
    --------
    A bar with bonds to the nearest neighbours: the two end points have half of the bonds.

    >>> families = pd.families(pd.lattice((4,)), horizon=1.0)
    >>> beta = pd.surface_correction(pd.BondBased(1.0), families, method="volume")
    >>> np.asarray(beta[1]).round(3).tolist()
    [1.333, 1.0]
    >>> corrected = families.with_weight(beta)
    """
    check_model(model, families, Families)
    families.need_arrays()
    choice("method", method, METHODS)
    if not float(passes).is_integer() or passes < 1:
        raise ValueError(f"passes must be a whole number > 0, the number of times 'energy' is applied; got {passes!r}")
    if not is_concrete(model, families):
        raise ValueError("surface_correction computes on the host; call it outside jit and grad")
    if type(model).extension_energies is AbstractModel.extension_energies:
        reason = (
            "needs none: it is exact under affine maps at surfaces too"
            if model.affine_exact
            else "has none; define extension_energies in its class"
        )
        raise ValueError(f"surface_correction is for BondBased and LPS; {type(model).__name__} {reason}")
    if np.ndim(families.horizon):
        raise ValueError("surface_correction needs one horizon for all points; these families have one for each")
    volumes, omega = np.asarray(families.volumes, float), np.asarray(families.influence * families.weight, float)
    w = omega * volumes[np.asarray(families.neighbours)]
    beta = _by_volume(families, w) if method == "volume" else _by_energy(model, families, w, int(passes))
    return on_device(np.where(np.asarray(families.is_bond), beta, 1.0).astype(families.dtype))
