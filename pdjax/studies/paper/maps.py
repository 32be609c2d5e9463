"""The stability maps of the paper over (m, a) under a hydrostatic load, N = 3, compared with the symbol.

Further numbers: which sides are unstable at once on several lattices; whether m = 0 is stable; which orders are stable
on which side; the effect of a stabiliser; the critical load of the classical law itself.
"""

import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import pdjax as pd

from ...models.kinematics import seth_hill
from .. import closed_forms as cf
from ._common import CONSTANTS, Found, at_once, family_within, judge, linear, of_order, percent, sizes

LINE = linear(1.0, 0.0)
LAW = linear(1.0, 1.0)
N = 3


def sweep(dim: int, law, quick: bool) -> pd.StabilityMap:
    """The map. An even number of orders and loads avoids m = 0 and a = 0."""
    count = 40 if quick else 200
    lines = ("diagonal",) if quick else ("diagonal", "affine", "local")
    orders, loads = np.linspace(-2, 2, count), np.linspace(-0.3, 0.3, count)
    return pd.stability_map(orders, loads, N=N, dim=dim, law=law, lines=lines, show_progress=False)


def law_fails(m: float, far: float) -> float:
    """The load between rest and `far` at which the classical law ψ(E_m) loses its ellipticity, 2D."""
    family, model = pd.lattice_family(2, N), of_order(m, LAW)
    margin = lambda a: float(pd.stability(model, family, (1 + a) * np.eye(2), "local").margin)  # noqa: E731
    return brentq(margin, 0.0, far, xtol=1e-9)


def beyond_hydrostatic(quick: bool) -> dict:
    """Numbers for the discussion: m = 0 in 3D, the classical law, a stabiliser, the stable orders by side."""
    plane, penalised = pd.lattice_family(2, N), of_order(1.0, LAW, pd.SillingControl(jnp.asarray(0.5)))
    found = {
        "the law itself, m = 1": law_fails(1.0, -0.3),
        "the law itself, m = −1": law_fails(-1.0, 0.3),
        "with Silling's penalty, m = 1": {
            f"{a:+g}": pd.stability(penalised, plane, (1 + a) * np.eye(2)).verdict for a in (-0.18, -0.01)
        },
        "orders that bear uniaxial stress": {
            side: [float(x) for x in pd.stable_orders(plane, LAW, pd.uniaxial_stress, side)]
            for side in ("negative", "positive")
        },
    }
    if not quick:  # the fine Brillouin zone in 3D takes minutes
        space = pd.lattice_family(3, N)
        found["tension, m = 0, 3D"] = float(pd.critical_load(of_order(0.0, LAW), space, side="positive"))
    return found


def printed_2d(found: pd.StabilityMap) -> dict[str, dict[str, float]]:
    """Compare the printed 2D criterion over the map, with its inequality reversed, with the diagonal by autodiff.

    This is done for the two laws with the paper's S = κE and for λ = μ = 1. The result is the share of states for which
    the criterion is wrong, and the relative error of the corrected formula.
    """
    orders, loads = found.line_m, found.line_a
    m, a = orders[:, None], loads[None, :]
    printed = np.asarray(cf.bracket_2d(a, m, N, "printed"))
    out = {}
    for name, (lam, mu) in CONSTANTS.items():
        by_autodiff = pd.stability_map(orders, loads, N, 2, linear(lam, mu), criterion="diagonal", show_progress=False)
        exact = by_autodiff.eigenvalue
        lattice = np.asarray(cf.lattice_diagonal(a, m, 2, N, lam, mu))
        out[name] = {
            "printed is wrong about": float(np.mean((printed > 0) != (exact < 0))),
            "corrected from autodiff": float(np.max(abs(lattice - exact)) / np.max(abs(exact))),
        }
    return out


def shares(found: pd.StabilityMap) -> dict[str, float]:
    """Share of a map that is unstable, by the symbol and by the diagonal, and on which side of the order m."""
    bad, a, m = found.verdict == "unstable", found.a[None, :], found.m[:, None]
    seen = found.lines["diagonal"] > 0
    return {
        "unstable": float(bad.mean()),
        "unstable by the diagonal": float(seen.mean()),
        "unstable in tension above m = 1/2": float((bad & (a > 0) & (m > 0.5)).sum()),
        "unstable in compression below m = 1/2": float((bad & (a < 0) & (m < 0.5)).sum()),
        "stable in compression above m = 1/2": float((~bad & (a < 0) & (m > 0.5)).sum()),
        "stable in tension below m = 1/2": float((~bad & (a > 0) & (m < 0.5)).sum()),
    }


def make_1d(quick: bool) -> tuple[dict, Figure]:
    """The sheet `maps-1d`."""
    found = sweep(1, LINE, quick)
    m, a = found.line_m[:, None], found.line_a[None, :]
    exact = 2 * found.lines["diagonal"]  # the margin is ∂f/∂x over 2M/h², with M = h = 1
    printed = np.asarray(cf.diagonal_1d(a, m, N, stress=seth_hill(np.log1p(a), m), tangent=1.0))
    horizons = (1, 2, 3) if quick else (1, 2, 3, 5, 8)
    numbers = {
        "printed diagonal from autodiff": float(np.max(abs(printed - exact)) / np.max(abs(exact))),
        **shares(found),
        "fails at once [compression, tension]": {
            f"m = {order:g}": {n: at_once(order, LINE, 1, n, horizons[-1]) for n in horizons} for order in (1.0, 0.0)
        },
        "verdict of m = 1/2 at ±10 %": [
            pd.stability(of_order(0.5, LINE), family_within(1, N, horizons[-1]), (1 + s) * np.eye(1)).verdict
            for s in (-0.1, 0.1)
        ],
    }
    return numbers, _titled(pd.figures.stability_map(found), quick)


def make_2d(quick: bool) -> tuple[dict, Figure]:
    """The sheet `maps-2d`."""
    found = sweep(2, LAW, quick)
    plane, space = (2, 3) if quick else (2, 3, 4), (2,) if quick else (2, 3)
    lattices = [(2, n, plane[-1]) for n in plane] + [(3, n, space[-1]) for n in space]
    numbers = {
        **shares(found),
        "diagonal by law": printed_2d(found),
        "fails at once [compression, tension]": {
            f"m = {order:g}": {f"{d}D, N = {n}": at_once(order, LAW, d, n, reach) for d, n, reach in lattices}
            for order in (1.0, 0.0, -1.5)
        },
        "diagonal, m = 1, 2D": {n: float(cf.lattice_critical_load(1.0, 2, n, 1.0, 1.0)) for n in (2, 3, 4)},
        "diagonal, m = 0, 3D": float(cf.lattice_critical_load(0.0, 3, 3, 1.0, 1.0)),
        "compression holds below, tension above m =": {
            f"{d}D, N = {n}": [float(x) for x in cf.hydrostatic_thresholds(d, n)] for d in (2, 3) for n in (2, 3)
        },
        **beyond_hydrostatic(quick),
    }
    luck = "; its printed and exact lines nearly coincide, but only for N = 3 and λ = μ"
    return numbers, _titled(pd.figures.stability_map(found), quick, luck)


def _titled(figure: Figure, quick: bool, more: str = "") -> Figure:
    below = f"left: exact Jacobian; right: diagonal of the paper{more}"
    figure.suptitle(f"{figure.get_suptitle()}\n{below}{sizes(quick)}", fontsize=11)
    return figure


# --- what the numbers say of the claims


def map_1d(n: dict) -> Found:
    """Fig. 2."""
    gap = n["printed diagonal from autodiff"]
    share, exact = n["unstable by the diagonal"], n["unstable"]
    ours = (
        f"agrees with autodiff to {gap:.0e}; the diagonal calls {share:.0%} of the map unstable, the symbol {exact:.0%}"
    )
    return ours, judge(gap < 1e-12)


def sides_1d(n: dict) -> Found:
    """Section 4.1: the sides are right, but the instability begins at rest."""
    right_sides = n["unstable in tension above m = 1/2"] == 0 == n["unstable in compression below m = 1/2"]
    all_of_them = n["stable in compression above m = 1/2"] == 0 == n["stable in tension below m = 1/2"]
    return "the sides are right, but every state on them is unstable: there a_cr = 0", judge(
        right_sides and not all_of_them, all_of_them
    )


def map_2d(n: dict) -> Found:
    """Fig. 3."""
    laws, words = n["diagonal by law"], {"bulk": "S = K tr(E) I", "symmetric": "S = κE"}
    wrong = {name: law["printed is wrong about"] for name, law in laws.items()}
    exact = all(law["corrected from autodiff"] < 1e-12 for law in laws.values())
    shares = {name: f"{100 * share:.2g} %" for name, share in wrong.items()}
    said = " and ".join(f"{shares[name]} of the states for {law}" for name, law in words.items())
    ours = (
        f"wrong about {said}. For λ = μ = 1, which is neither law, it is wrong about {shares['λ = μ = 1']}; there the"
        f" diagonal calls {100 * n['unstable by the diagonal']:.0f} % of the map unstable, the symbol"
        f" {100 * n['unstable']:.0f} %"
    )
    return ours, judge(any(wrong[name] == 0 for name in words), exact)


def slightest(n: dict) -> Found:
    """Remark 3: it is true of every lattice too."""
    once = n["fails at once [compression, tension]"]
    holds = all(c and not t for c, t in once["m = 1"].values()) and all(t and not c for c, t in once["m = 0"].values())
    lattices = ", ".join(map(str, once["m = 1"]))
    return f"true of every lattice too: a_cr = 0 in compression for m = 1, in tension for m = 0, N = {lattices}", judge(
        holds
    )


def discretisation(n: dict) -> Found:
    """Remark 6."""
    once = n["fails at once [compression, tension]"]
    one = {N: c for N, (c, _) in once["m = 1"].items()}
    some_side = all(c or t for cases in once.values() for c, t in cases.values())
    ours = f"true of the diagonal; by the symbol a_cr = 0 in {'; '.join(N for N, yes in one.items() if yes)}"
    return ours, judge(not some_side, some_side)


def logarithmic(n: dict) -> Found:
    """Remark 7."""
    once = n["fails at once [compression, tension]"]["m = 0"]
    words = []
    for lattice, (c, t) in once.items():
        tension = "tension"
        if lattice == "3D, N = 3" and not t:
            tension = f"tension from {percent(n['tension, m = 0, 3D'])}"
        fails = [w for w, yes in (("compression", c), (tension, t or lattice == "3D, N = 3")) if yes]
        words.append(f"{lattice}: {' and '.join(fails)}")
    own = percent(n["diagonal, m = 0, 3D"])
    return f"unstable: {'; '.join(words)}; there even the diagonal is unstable from {own}", judge(
        not any(c or t for c, t in once.values())
    )


def source(n: dict) -> Found:
    """Section 6.3."""
    down, up = n["the law itself, m = 1"], n["the law itself, m = −1"]
    lattice = n["fails at once [compression, tension]"]["m = 1"]["2D, N = 3"][0]
    ours = f"2D hydrostatic: the law of m = 1 at {percent(down)}, of m = −1 at {percent(up)}; the lattice of m = 1 at 0"
    return ours, judge(lattice and -0.3 < down < -0.1 and 0.1 < up < 0.3)


def stabilised(n: dict) -> Found:
    """Section 6.2."""
    with_penalty, own = n["with Silling's penalty, m = 1"], n["the law itself, m = 1"]
    held = all(word == "stable" for word in with_penalty.values())
    ours = f"Silling's penalty (g = ½) keeps m = 1 stable at −18 %; the law itself is unstable from {percent(own)}"
    return ours if held else "Silling's penalty (g = ½) does not keep m = 1 stable at −18 %", judge(not held)


def switch(n: dict) -> Found:
    """Section 6.2: it works under a hydrostatic load only."""
    orders = n["orders that bear uniaxial stress"]
    low, high = n["compression holds below, tension above m ="]["2D, N = 3"]
    none = np.isnan(orders["negative"]).all()
    ours = (
        f"hydrostatic: m < {low:.3f} is stable in compression, m > {high:.3f} in tension; under uniaxial stress no"
        " order is stable in compression"
    ).replace("-", "−")
    return ours if none else "some order is stable in uniaxial compression", judge(bool(none))
