"""The order m_cr at which the diagonal of the continuum changes sign: printed, corrected and by autodiff.

    ∂f_k/∂x_k = −2 S (1 + a)^{2m−2} Γ(m)   as h → 0 at fixed horizon;   Γ(m_cr) = 0

Γ follows, up to its positive radial factor, from the autodiff block of a family of all directions (criterion
`continuum`). dT·dY of a moved centre is −½ of that diagonal. It is one forward derivative of the force state.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

from ...figures import COLOURS
from ...models.kinematics import seth_hill
from .. import closed_forms as cf
from ._common import Found, close, judge, linear, of_order, signed, sizes

LAW = linear(1.0, 1.0)
LOAD = -0.1


def gamma_exact(orders: np.ndarray, dim: int) -> np.ndarray:
    """Γ(m) over its radial factor (orders,), from the criterion `continuum` at a = −10 %."""
    margin = pd.stability_map(orders, [LOAD], N=2, dim=dim, law=LAW, criterion="continuum", show_progress=False).margin[
        :, 0
    ]
    stress = (dim + 2) * np.asarray(seth_hill(np.log1p(LOAD), orders))  # (dλ + 2μ) E_m
    return -margin * 3 / (2 * stress * (1 + LOAD) ** (2 * orders - 2))  # the margin's unit is λ + 2μ = 3


def zero(orders: np.ndarray, values: np.ndarray) -> float:
    """The root of a straight line through the values; Γ is linear in m."""
    slope, at_zero = np.polyfit(orders, values, 1)
    if not np.allclose(values, at_zero + slope * orders, atol=1e-9):
        raise RuntimeError("Γ(m) is not linear in m, so this fit cannot find its root; use a root finder")
    return float(-at_zero / slope)


@eqx.filter_jit
def moved_centre(family, a, m):
    """dT·dY if the centre alone moves by 1 along the first axis: printed, corrected, exact."""
    model, at = of_order(m, LAW), family.bonds((1 + a) * jnp.eye(family.dim))
    move = jnp.zeros_like(at.eta).at[:, 0].set(-1.0)
    change = jax.jvp(lambda eta: model.force_state(at._replace(eta=eta)), (at.eta,), (move,))[1]
    stress, radial = (family.dim + 2) * seth_hill(jnp.log1p(a), m), jnp.mean(1 / jnp.sum(family.xi**2, axis=1))
    forms = [cf.material_test(stress, a, m, family.dim, radial, form=form) for form in ("printed", "corrected")]
    return *forms, jnp.sum(at.volume[:, None] * change * move)


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `m-cr`."""
    samples = np.linspace(-1.5, 1.5, 5 if quick else 13)
    numbers: dict = {"m_cr": {}, "dT dY": {}}
    figure = Figure(figsize=(11.4, 4.0), layout="constrained")
    for dim, axes in zip((1, 2, 3), figure.subplots(1, 3, sharey=True), strict=True):
        family = pd.lattice_family(dim, 2)
        exact = gamma_exact(samples, dim)
        root = zero(samples, exact)
        forms = {form: cf.m_cr(dim, form) for form in ("printed", "corrected")}
        numbers["m_cr"][f"{dim}D"] = {**forms, "exact": root}
        test = dict(zip(("printed", "corrected", "exact"), map(float, moved_centre(family, 0.1, 0.8)), strict=True))
        numbers["dT dY"][f"{dim}D"] = test
        axes.axhline(0, color="#888888", linewidth=0.8)
        axes.plot(samples, cf.gamma(samples, dim), color=COLOURS["continuum"], linewidth=3.5, label="corrected")
        axes.plot(samples, cf.gamma(samples, dim, "printed"), "--", color=COLOURS["printed"], label="printed")
        axes.plot(samples, exact, "o", color=COLOURS["symbol"], markersize=4.5, label="exact, by autodiff")
        says = f"m_cr = {round(root, 9) + 0.0:g} exact, {forms['printed']:g} printed".replace("-", "−")
        axes.set_title(f"{dim}D: {says}", fontsize=10)
        axes.set_xlabel("order m of the Seth–Hill strain  [–]")
        axes.set_xlim(-1.6, 1.6)
    figure.axes[0].set_ylabel("Γ(m) over its radial factor  [–]")
    figure.axes[0].legend(fontsize=9, frameon=False)
    figure.suptitle(f"Order at which the diagonal of the continuum changes sign{sizes(quick)}", fontsize=11)
    return numbers, figure


# --- what the numbers say of the claims


def m_cr_plane(n: dict) -> Found:
    """Proposition 1 in 1D and 2D."""
    pairs = [n["m_cr"][dim] for dim in ("1D", "2D")]
    ours = ", ".join(f"{round(p['exact'], 9) + 0.0:g}" for p in pairs)
    return ours, judge(all(close(p["printed"], p["exact"]) for p in pairs))


def m_cr_space(n: dict) -> Found:
    """Proposition 1 in 3D."""
    p = n["m_cr"]["3D"]
    ours = f"{p['exact']:.4f}: the average of ξ_k²/|ξ|² is 1/3, so m_cr = 1 − d/2".replace("-", "−")
    return ours, judge(close(p["printed"], p["exact"]), close(p["corrected"], p["exact"]))


def moved_centre_sign(n: dict) -> Found:
    """The sign of dT·dY of a moved centre (section 6.1)."""
    p = n["dT dY"]["3D"]
    ours = f"{signed(p['exact'])}: the printed sign is wrong, and ξ_l ξ_l is printed for ξ₁²"
    return ours, judge(close(p["printed"], p["exact"]), close(p["corrected"], p["exact"]))
