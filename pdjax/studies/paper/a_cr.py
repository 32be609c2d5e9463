"""Critical loads for m = 1 against the horizon: quoted in the paper, printed, by the exact diagonal and by the symbol.

In 1D the printed diagonal is right. In 2D each slip of the printed criterion is corrected in turn, at N = 3. This is
done for the two simple laws with the paper's S = κE under a hydrostatic load: "bulk", S = ½κ tr(E) I, and "symmetric",
S = κE.
"""

import itertools
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import brentq

import pdjax as pd

from ...figures import COLOURS, SERIES
from ...models.kinematics import seth_hill
from .. import closed_forms as cf
from ._common import CONSTANTS, OPEN, Found, at_once, close, family_within, judge, linear, load, of_order, signed, sizes

QUOTED_1D, QUOTED_2D = {1: -0.184, 3: -0.074}, -0.037
LAWS = {name: linear(*constants) for name, constants in CONSTANTS.items()}
_STEPS = ("printed", "inequality", "m = 0 branch", "2πN → πN", "volume N²", "law's tangent", "finite sums")
STYLE = {"bulk": ":", "symmetric": "--", "λ = μ = 1": "-"}
_LAWS = {"bulk": "λ = ½, μ = 0", "symmetric": "λ = 0, μ = ½", "λ = μ = 1": "λ = μ = 1"}


def diagonal_root_1d(N: int, reach: int) -> float:
    """The root of ∂f/∂x of the bar, by autodiff, m = 1."""
    family, model = family_within(1, N, reach), of_order(1.0, LAWS["symmetric"])
    return brentq(lambda a: float(_block(model, family, (1 + a) * np.eye(1))[0, 0]), -0.5, 0, xtol=1e-14)


_block = eqx.filter_jit(pd.center_block)


def q_of_general_formula() -> float:
    """q of the criterion 1 + q [1 − (1 + a)^{−2m}], from the general 2D formula of the paper, N = 3."""

    @jax.jit
    def general(a):
        stress, pair = seth_hill(jnp.log1p(a), 1.0) * jnp.eye(2), jnp.einsum("ij,kl->ijkl", jnp.eye(2), jnp.eye(2))
        return cf.jacobian_2d_hydrostatic(a, 1.0, 3, stress, pair, 1.0, "printed")[0, 0]

    a = -0.07
    return float((general(a) / general(0.0) / (1 + a) ** 2 - 1) / (1 - (1 + a) ** -2))


def reachable_loads() -> list[float]:
    """a_cr for every set of corrections and both laws, to three digits: 2D, m = 1, N = 3."""
    subsets = [s for n in range(5) for s in itertools.combinations(("S1", "S2", "S3", "S4"), n)]
    return sorted(
        {round(float(cf.critical_load_2d(1.0, 3, s, law)), 3) for s in subsets for law in ("bulk", "symmetric")}
    )


def diagonal_roots_2d() -> dict[str, float]:
    """Roots of the 2D diagonal in compression, by autodiff, N = 3: m = 1 for each law, and m = 0; −∞ if none."""
    family, found = pd.lattice_family(2, 3), {}
    for name, m, law in (*((name, 1.0, law) for name, law in LAWS.items()), ("m = 0", 0.0, LAWS["λ = μ = 1"])):
        value = lambda a, m=m, law=law: float(_block(of_order(m, law), family, (1 + a) * np.eye(2))[0, 0])  # noqa: E731
        past = next((a for a in -np.geomspace(1e-3, 0.9, 40) if value(a) > 0), None)
        found[name] = -np.inf if past is None else brentq(value, past, 0.0, xtol=1e-14)
    return found


def slips_2d() -> dict:
    """Numbers of the steps from the printed 2D criterion to the exact one, N = 3."""
    family = pd.lattice_family(2, 3)
    stiffness = {
        k: float(np.einsum("iijj->", jax.jit(jax.hessian(LAWS[k].energy))(0.05 * jnp.eye(2)))) for k in CONSTANTS
    }
    diagonal = diagonal_roots_2d()
    chain = {law: [(s.slip, s.q, float(s.load)) for s in cf.chain_2d(1.0, 3, law=law)] for law in ("bulk", "symmetric")}
    block, rest = (np.asarray(_block(of_order(1.0, LAWS["λ = μ = 1"]), family, s * np.eye(2))) for s in (0.95, 1.0))
    return {
        "bonds": len(family.xi),
        "sum of 1/p², exact": float(jnp.sum(1 / jnp.sum(family.xi**2, axis=1))),
        "sum of 1/p², printed": cf.lattice_sums_2d(3, "printed").s00,
        "I : dS/dE : I of S = κE over κ": stiffness,
        "q of the general formula": q_of_general_formula(),
        "chain": chain,
        "diagonal by autodiff": diagonal,
        "reachable": reachable_loads(),
        "at rest": {form: bool(cf.satisfies_criterion_2d(0.0, 1.0, 3, form)) for form in ("printed", "corrected")},
        "at rest, by autodiff": "stable" if rest[0, 0] < 0 else "unstable",
        "m = 0": {form: float(cf.critical_load_2d(0.0, 3, form)) for form in ("printed", "corrected")},
        "m = 0, by autodiff": diagonal["m = 0"],
        "block is a multiple of I to": float(abs(block - block[0, 0] * np.eye(2)).max() / abs(block[0, 0])),
    }


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `a-cr`."""
    horizons = (1, 2, 3) if quick else (1, 2, 3, 4, 5, 6)
    planes = [N for N in horizons if N > 1]
    line = {N: diagonal_root_1d(N, max(horizons)) for N in horizons}
    plane = {name: {N: float(cf.lattice_critical_load(1.0, 2, N, *c)) for N in planes} for name, c in CONSTANTS.items()}
    numbers = {
        "1D diagonal": line,
        "1D diagonal, printed": {N: float(cf.critical_load_1d(1.0, N)) for N in horizons},
        "1D symbol fails at once": {N: at_once(1.0, LAWS["symmetric"], 1, N, max(horizons))[0] for N in horizons},
        "2D diagonal": plane,
        "2D diagonal, printed": {N: float(cf.critical_load_2d(1.0, N, "printed")) for N in planes},
        "2D symbol fails at once": {N: at_once(1.0, LAWS["λ = μ = 1"], 2, N, max(planes))[0] for N in planes},
        "diagonal of λ = μ = 1, N = 3": {
            f"{dim}D": float(cf.lattice_critical_load(1.0, dim, 3, 1.0, 1.0)) for dim in (1, 2, 3)
        },
        "diagonal of m = 0, λ = μ = 1, N = 3": {
            f"{dim}D": float(cf.lattice_critical_load(0.0, dim, 3, 1.0, 1.0)) for dim in (1, 2, 3)
        },
        "order above which compression fails at once, N = 3": {
            f"{dim}D": float(cf.hydrostatic_thresholds(dim, 3)[0]) for dim in (1, 2, 3)
        },
        "2D, N = 3": slips_2d(),
    }
    return numbers, draw(numbers, quick)


def _loads(axes, values: dict, colour: str, style: str, label: str) -> None:
    axes.plot(list(values), [100 * a for a in values.values()], style, color=colour, markersize=5, label=label)


def draw(numbers: dict, quick: bool) -> Figure:
    """Draw the 1D and 2D critical loads over N, and the chain of corrections at N = 3."""
    figure = Figure(figsize=(13.4, 4.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _loads(left, numbers["1D diagonal, printed"], COLOURS["printed"], "--", "diagonal, as printed")
    _loads(left, numbers["1D diagonal"], COLOURS["diagonal"], "o", "diagonal, by autodiff")
    _loads(middle, numbers["2D diagonal, printed"], COLOURS["printed"], "--", "diagonal, as printed")
    for name, values in numbers["2D diagonal"].items():
        _loads(middle, values, COLOURS["diagonal"], STYLE[name] + "o", f"diagonal, exact: {_LAWS[name]}")
    for on, dim, quoted in ((left, "1D", QUOTED_1D), (middle, "2D", {3: QUOTED_2D})):
        at_once = {N: 0.0 for N, yes in numbers[f"{dim} symbol fails at once"].items() if yes}
        _loads(on, at_once, COLOURS["symbol"], "-s", "symbol (exact): 0")
        on.plot(
            list(quoted), [100 * a for a in quoted.values()], "o", mfc="none", mec=SERIES[2], mew=1.8, ms=12,
            label="quoted in the paper",
        )  # fmt: skip
        on.set_title(f"{dim}, m = 1: critical compression", fontsize=10)
        on.set_xlabel("horizon over spacing N  [–]")
        on.set_ylabel("critical load a_cr  [%]")
        on.set_xticks(list(at_once))
        on.legend(fontsize=8, frameon=False, loc="lower right", handlelength=4.5)
    middle.set_ylim(-12, 0.6)
    chain = numbers["2D, N = 3"]["chain"]
    for law, steps in chain.items():
        y = [100 * step[2] for step in steps]
        right.plot(range(len(y)), y, "o" + STYLE[law], color=COLOURS["diagonal"], markersize=5, label=_LAWS[law])
        exact = 100 * numbers["2D, N = 3"]["diagonal by autodiff"][law]
        right.plot(len(y) - 1, exact, "o", mfc="none", mec=COLOURS["diagonal"], mew=1.4, ms=12)
    right.plot([], [], "o", mfc="none", mec=COLOURS["diagonal"], mew=1.4, ms=10, label="diagonal, by autodiff")
    right.axhline(100 * QUOTED_2D, color=SERIES[2], linewidth=1.2, linestyle="-.", label="quoted in the paper")
    right.set_xticks(range(len(steps)), _STEPS, fontsize=8, rotation=35, ha="right")
    right.set_title("2D, N = 3: printed criterion, corrected stepwise", fontsize=10)
    right.set_ylabel("critical load a_cr  [%]")
    right.set_ylim(-6.4, -0.4)  # room for the legend
    right.legend(fontsize=8, frameon=False, loc="lower left", bbox_to_anchor=(0.0, 0.02), handlelength=4.5)
    figure.suptitle(f"Critical loads of order m = 1{sizes(quick)}", fontsize=11)
    return figure


# --- what the numbers say of the claims


def quoted_1d(n: dict) -> Found:
    """Remark 4."""
    found = {N: n["1D diagonal"][N] for N in QUOTED_1D}
    ours = ", ".join(signed(a) for a in found.values())
    return ours, judge([round(a, 3) for a in found.values()] == list(QUOTED_1D.values()))


def nonlocality(n: dict) -> Found:
    """Remark 4, of the whole Jacobian."""
    diagonal, at_once = list(n["1D diagonal"].values()), n["1D symbol fails at once"]
    grows = all(a < b < 0 for a, b in pairwise(diagonal))
    ours = (
        f"true of the diagonal; by the symbol a_cr = 0 at N = {', '.join(str(N) for N, yes in at_once.items() if yes)}"
    )
    return ours, judge(grows and not any(at_once.values()), grows)


def volume(n: dict) -> Found:
    """The weighted volume in the 2D Jacobian (section 4.2)."""
    bonds = n["2D, N = 3"]["bonds"]
    ours = f"{bonds} bonds; πN² = {np.pi * 9:.2f}, so N² should be N⁴, and N should be N²"
    return ours, judge(close(np.pi * 3, bonds, 0.02), close(np.pi * 9, bonds, 0.02))


def sums(n: dict) -> Found:
    """The six lattice sums in 2D (section 4.2)."""
    exact, printed = (n["2D, N = 3"][f"sum of 1/p², {form}"] for form in ("exact", "printed"))
    return f"the finite sum is {exact:.3f}; the paper counts the points on the axes twice", judge(
        close(exact, printed, 0.02), exact < printed
    )


def law(n: dict) -> Found:
    """The tangent of the hydrostatic law in 2D (section 4.2)."""
    stiffness = n["2D, N = 3"]["I : dS/dE : I of S = κE over κ"]
    two = [stiffness["bulk"], stiffness["symmetric"]]
    return f"{two[0]:g}, for every law with S = κE under hydrostatic load", judge(close(two, 4.0), close(two, 2.0))


def which_law(n: dict) -> Found:
    """The law with S = κE that the paper uses in 2D (section 4.2)."""
    d = n["2D, N = 3"]["diagonal by autodiff"]
    bulk, symmetric = signed(d["bulk"]), signed(d["symmetric"])
    return f"a_cr = {bulk} for S = K tr(E) I, {symmetric} for S = κE", OPEN


def factor(n: dict) -> Found:
    """Appendix C."""
    q = n["2D, N = 3"]["q of the general formula"]
    ours = f"πN = {q:.2f}, by the general formula of the paper"
    return ours, judge(close(q, 6 * np.pi), close(q, 3 * np.pi))


def quoted_2d(n: dict) -> Found:
    """Remark 5."""
    printed = n["2D, N = 3"]["chain"]["bulk"][0][2]
    half = n["1D diagonal"][3] / 2
    ours = (
        f"the criterion gives {signed(printed)}; {signed(half, 3)} is half the 1D load; no set of corrections gives it"
    )
    return ours, judge(QUOTED_2D in n["2D, N = 3"]["reachable"])


def inequality(n: dict) -> Found:
    """The criteria before Fig. 3."""
    p = n["2D, N = 3"]
    stable = p["at rest, by autodiff"] == "stable"
    ours = f"the diagonal at rest is {p['at rest, by autodiff']}: the bracket must be positive"
    return ours, judge(p["at rest"]["printed"] == stable, p["at rest"]["corrected"] == stable)


def hencky(n: dict) -> Found:
    """The branch m = 0 before Fig. 3."""
    p = n["2D, N = 3"]
    ours = f"{load(p['m = 0, by autodiff'])}: the limit of the bracket for m → 0 is 1, not 1 + 2πN ln(1 + a)"
    both = np.isinf(p["m = 0"]["corrected"]) and np.isinf(p["m = 0, by autodiff"])
    return ours, judge(close(p["m = 0"]["printed"], p["m = 0, by autodiff"]), bool(both))


def dimension(n: dict) -> Found:
    """Remark 5, of the exact diagonal with λ = μ = 1."""
    one, two, three = n["diagonal of λ = μ = 1, N = 3"].values()
    ours = (
        f"true of the diagonal: {', '.join(signed(a) for a in (one, two, three))} for λ = μ = 1, so that the 2D value"
        f" is {two / one:.2f} of the 1D one"
    )
    if all(m < 1 for m in n["order above which compression fails at once, N = 3"].values()):
        ours += "; by the symbol a_cr = 0 in each"
    other = ", ".join(f"{dim} {load(a)}" for dim, a in n["diagonal of m = 0, λ = μ = 1, N = 3"].items())
    ours += f". For m = 0 it is not true of the diagonal either: {other}"
    return ours, judge(one < two < three < 0 and close(two / one, 0.5, 0.05), one < two < three < 0)
