"""What the numbers of each sheet say of each claim: functions numbers → (ours, verdict), for the table in `claims`.

The verdict follows from comparisons, never from a word typed in: it changes if the numbers do. `corrected` means that
the statement named in "ours" was compared with the exact value too and agrees.
"""

from itertools import pairwise

import numpy as np

from ._common import OPEN, close, judge, load, percent

Found = tuple[str, str]


def _signed(x: float, digits: int = 4) -> str:
    return f"{x:+.{digits}f}".replace("-", "−")


# --- one family


def equilibrium(n: dict) -> Found:
    """Section 3.1."""
    size = n["uniform"]["net force"]
    return f"net force {size:.0e} of the bonds' forces", judge(size < 1e-14)


def static(n: dict) -> Found:
    """The display after Eq. (TforTwo)."""
    u = n["uniform"]
    exact = u["bracket, exact"]
    ours = f"T + T: largest component {exact:.4f}, printed {u['bracket, printed']:.4f}; the sum is 0 either way"
    return ours, judge(close(u["bracket, printed"], exact), close(u["bracket, corrected"], exact))


def entry(n: dict) -> Found:
    """The display before Eq. (finaldf)."""
    gap = n["formula from autodiff"]
    return f"right, to {gap:.0e}, in all {n['entries of a row']} entries of a row", judge(gap < 1e-12)


def centre(n: dict) -> Found:
    """Remark 1."""
    size = n["uniform"]["strain of a moved centre"]
    return f"∂Ē/∂x = {size:.0e}", judge(size < 1e-14)


def strain(n: dict) -> Found:
    """The sentence after the strains."""
    s = n["strain"]
    exact = max(s["m = 1, any state"], s["any m, similarities"])
    ratios = s["smallest ratio of 10 % to 1 % stretch"], s["largest ratio of 10 % to 1 % stretch"]
    second = 50 < ratios[0] and ratios[1] < 200
    off = s["m = 0, 10 % stretch"]
    ours = f"for m = 1 and similarities ({exact:.0e}); else to first order: {off:.1e} off at m = 0, 10 % stretch"
    return ours, judge(max(exact, off) < 1e-14, exact < 1e-14 and second)


def silling(n: dict) -> Found:
    """Section 3.3."""
    states = n["Silling"].values()
    block, free = max(s["block"] for s in states), max(s["at the corner"] for s in states)
    words = {s["verdict"] for s in states}
    ours = f"its block, yes ({_signed(block, 3)} at most); the whole is {' or '.join(words)}: waves cost {free:.0e}"
    return ours, judge(words == {"stable"}, block < 0 and words == {"marginal"} and free < 1e-14)


# --- the continuum's diagonal


def m_cr_plane(n: dict) -> Found:
    """Proposition 1 in 1D and 2D."""
    pairs = [n["m_cr"][dim] for dim in ("1D", "2D")]
    ours = ", ".join(f"{round(p['exact'], 9) + 0.0:g}" for p in pairs)
    return ours, judge(all(close(p["printed"], p["exact"]) for p in pairs))


def m_cr_space(n: dict) -> Found:
    """Proposition 1 in 3D."""
    p = n["m_cr"]["3D"]
    ours = f"{p['exact']:.4f}: the average is 1/3, so m_cr = 1 − d/2".replace("-", "−")
    return ours, judge(close(p["printed"], p["exact"]), close(p["corrected"], p["exact"]))


def moved_centre(n: dict) -> Found:
    """Eq. (altS)."""
    p = n["dT dY"]["3D"]
    ours = f"{_signed(p['exact'])}: the sign is wrong, and ξ_l ξ_l stands for ξ₁²"
    return ours, judge(close(p["printed"], p["exact"]), close(p["corrected"], p["exact"]))


# --- critical loads


def quoted_1d(n: dict) -> Found:
    """Remark 4."""
    found = {N: n["1D diagonal"][N] for N in (1, 3)}
    ours = ", ".join(_signed(a) for a in found.values())
    return ours, judge([round(a, 3) for a in found.values()] == [-0.184, -0.074])


def nonlocality(n: dict) -> Found:
    """Remark 4, of the whole Jacobian."""
    diagonal, at_once = list(n["1D diagonal"].values()), n["1D symbol fails at once"]
    grows = all(a < b < 0 for a, b in pairwise(diagonal))
    ours = f"of the diagonal; the symbol's a_cr is 0 at N = {', '.join(str(N) for N, yes in at_once.items() if yes)}"
    return ours, judge(grows and not any(at_once.values()), grows)


def volume(n: dict) -> Found:
    """Eq. (2Ddf)."""
    bonds = n["2D, N = 3"]["bonds"]
    ours = f"{bonds} bonds; πN² = {np.pi * 9:.2f}, so N⁴ and N² for N² and N"
    return ours, judge(close(np.pi * 3, bonds, 0.02), close(np.pi * 9, bonds, 0.02))


def sums(n: dict) -> Found:
    """The six sums after Eq. (2Ddfs)."""
    exact, printed = (n["2D, N = 3"][f"sum of 1/p², {form}"] for form in ("exact", "printed"))
    return f"{exact:.3f}, summed: axis points are counted twice", judge(close(exact, printed, 0.02), exact < printed)


def law(n: dict) -> Found:
    """Eq. (hydro2Ds)."""
    stiffness = n["2D, N = 3"]["I : dS/dE : I of S = κE over κ"]
    two = [stiffness["bulk"], stiffness["symmetric"]]
    return f"{two[0]:g}, for every law of that kind", judge(close(two, 4.0), close(two, 2.0))


def which_law(n: dict) -> Found:
    """Eq. (hydro2Ds)."""
    d = n["2D, N = 3"]["diagonal by autodiff"]
    bulk, symmetric = _signed(d["bulk"]), _signed(d["symmetric"])
    return f"a_cr = {bulk} for S = K tr(E) I, {symmetric} for S = κE", OPEN


def factor(n: dict) -> Found:
    """Appendix C."""
    q = n["2D, N = 3"]["q of the general formula"]
    ours = f"πN = {q:.2f}, by the paper's own general formula"
    return ours, judge(close(q, 6 * np.pi), close(q, 3 * np.pi))


def quoted_2d(n: dict) -> Found:
    """Remark 5."""
    printed = n["2D, N = 3"]["chain"]["bulk"][0][2]
    half = n["1D diagonal"][3] / 2
    ours = f"the criterion gives {_signed(printed)}; {_signed(half, 3)} is half the 1D load; no set of repairs gives it"
    return ours, judge(-0.037 in n["2D, N = 3"]["reachable"])


def inequality(n: dict) -> Found:
    """The criteria before Fig. 3."""
    p = n["2D, N = 3"]
    stable = p["at rest, by autodiff"] == "stable"
    ours = f"the diagonal at rest is {p['at rest, by autodiff']}: the bracket must be positive"
    return ours, judge(p["at rest"]["printed"] == stable, p["at rest"]["corrected"] == stable)


def hencky(n: dict) -> Found:
    """The branch m = 0 before Fig. 3."""
    p = n["2D, N = 3"]
    ours = f"{load(p['m = 0, by autodiff'])}: the limit of the bracket is 1, not 1 + 2πN ln(1 + a)"
    both = np.isinf(p["m = 0"]["corrected"]) and np.isinf(p["m = 0, by autodiff"])
    return ours, judge(close(p["m = 0"]["printed"], p["m = 0, by autodiff"]), bool(both))


def dimension(n: dict) -> Found:
    """Remark 5, of the exact diagonal with λ = μ = 1."""
    one, two, three = n["diagonal of λ = μ = 1, N = 3"].values()
    ours = (
        f"of the diagonal, {', '.join(_signed(a) for a in (one, two, three))} (λ = μ = 1): {two / one:.2f} of 1D in 2D"
    )
    if all(m < 1 for m in n["order above which compression fails at once, N = 3"].values()):
        ours += "; the symbol's load is 0 in each"
    return ours, judge(one < two < three < 0 and close(two / one, 0.5, 0.05), one < two < three < 0)


# --- the maps


def map_1d(n: dict) -> Found:
    """Fig. 2."""
    gap = n["printed diagonal from autodiff"]
    share, exact = n["unstable by the diagonal"], n["unstable"]
    return f"right, to {gap:.0e}; it sees {share:.0%} of the map unstable, the symbol {exact:.0%}", judge(gap < 1e-12)


def sides_1d(n: dict) -> Found:
    """Section 4.1: the sides are right, the edge is rest itself."""
    right_sides = n["unstable in tension above m = 1/2"] == 0 == n["unstable in compression below m = 1/2"]
    all_of_them = n["stable in compression above m = 1/2"] == 0 == n["stable in tension below m = 1/2"]
    return "on those sides, at once: every state of them is unstable", judge(
        right_sides and not all_of_them, all_of_them
    )


def slightest(n: dict) -> Found:
    """Remark 3: true of every lattice already."""
    once = n["fails at once [compression, tension]"]
    holds = all(c and not t for c, t in once["m = 1"].values()) and all(t and not c for c, t in once["m = 0"].values())
    lattices = ", ".join(map(str, once["m = 1"]))
    return f"of every lattice already: 0 in compression for m = 1, in tension for m = 0, N = {lattices}", judge(holds)


def discretisation(n: dict) -> Found:
    """Remark 6."""
    once = n["fails at once [compression, tension]"]
    one = {N: c for N, (c, _) in once["m = 1"].items()}
    some_side = all(c or t for cases in once.values() for c, t in cases.values())
    ours = f"of the diagonal; the symbol fails at once, in {'; '.join(N for N, yes in one.items() if yes)}"
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
    return f"unstable: {'; '.join(words)}, where even the diagonal fails at {own}", judge(
        not any(c or t for c, t in once.values())
    )


def source(n: dict) -> Found:
    """Section 6.3."""
    down, up = n["the law itself, m = 1"], n["the law itself, m = −1"]
    lattice = n["fails at once [compression, tension]"]["m = 1"]["2D, N = 3"][0]
    ours = f"2D hydrostatic: m = 1 at {percent(down)}, m = −1 at {percent(up)}; the lattice, m = 1, at 0"
    return ours, judge(lattice and -0.3 < down < -0.1 and 0.1 < up < 0.3)


def stabilised(n: dict) -> Found:
    """Section 6.2."""
    with_penalty, own = n["with Silling's penalty, m = 1"], n["the law itself, m = 1"]
    held = all(word == "stable" for word in with_penalty.values())
    ours = f"Silling's penalty (g = ½) holds m = 1 at −18 %, where the law itself fails at {percent(own)}"
    return ours if held else "Silling's penalty (g = ½) does not hold m = 1 at −18 %", judge(not held)


def switch(n: dict) -> Found:
    """Section 6.2: works under hydrostatic load alone."""
    orders = n["orders that bear uniaxial stress"]
    low, high = n["compression holds below, tension above m ="]["2D, N = 3"]
    none = np.isnan(orders["negative"]).all()
    ours = f"m < {low:.3f} and m > {high:.3f} do under hydrostatic load; no order bears uniaxial compression".replace(
        "-", "−"
    )
    return ours if none else "some order bears uniaxial compression", judge(bool(none))


# --- the bars


def bar_tension(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, tension"]
    best, order = rows[-1], n["order of convergence, m = 1, tension"]
    ours = f"a {best['kind']}; {best['distance']:.1%} off at {best['n']} points, falling as n^−{order:.2f}"
    falls = all(a["distance"] > b["distance"] for a, b in pairwise(rows))
    return ours, judge(all(r["kind"] == "minimum" for r in rows) and falls)


def bar_form(n: dict) -> Found:
    """Section 5.1: the local solution of the model's own law is nonlinear."""
    gap = n["m = 1, tension"][-1]["printed from local"]
    ours = f"the nonlinear local solution, which the bar tends to, is {gap:.1%} from it"
    return ours, judge(gap < 0.01, n["m = 1, tension"][-1]["distance"] < n["m = 1, tension"][-1]["from printed"])


def bar_compression(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, compression"]
    saddles = [r["n"] for r in rows if r["kind"] == "saddle"]
    minima = [r["n"] for r in rows if r["kind"] == "minimum"]
    ours = (
        f"a saddle from {min(saddles)} points on; up to {max(minima)} a minimum that alternates"
        if saddles
        else "a minimum"
    )
    return ours, judge(bool(saddles) and max(minima) < min(saddles))


def bar_points(n: dict) -> Found:
    """Section 5.1."""
    rows = n["m = 1, compression"]
    return "which it is depends on it: " + ", ".join(f"{r['n']}: {r['kind']}" for r in rows), OPEN


def bar_silling(n: dict) -> Found:
    """Section 5.1: alternates, and is no saddle."""
    rows = [*n["Silling, tension"], *n["Silling, compression"]]
    positive, least = max(r["positive"] for r in rows), min(r["alternation"] for r in rows)
    ours = f"no positive eigenvalue, so no instability; alternates all the same ({least:.0%} of u and more)"
    return ours, judge(positive > 0, positive == 0 and least > 0.01)


def step_tension(n: dict) -> Found:
    """Section 5.2."""
    rows = [r for r in n["outcomes"] if r["strain"] == 1.0]
    worst = max(r["distance"] for r in rows)
    good = worst < 1e-6 and all(r["kind"] == "minimum" for r in rows)
    return f"a minimum, found by {len(rows)} methods to {worst:.0e}", judge(good)


def step_size(n: dict) -> Found:
    """Section 5.2."""
    at = {s: next(r for r in n["outcomes"] if r["strain"] == s and r["method"] == "newton") for s in (-1e-4, -1e-3)}
    exact, far = at[-1e-4], at[-1e-3]
    fifth = next(r for r in n["outcomes"] if r["strain"] == -1e-3 and r["method"] == "newton, steps of a fifth")
    ours = (
        f"the state itself is a {exact['homogeneous']} ({exact['its positive']} positive at −0.01 %,"
        f" {far['its positive']} at −0.1 %); Newton finds that {exact['kind']}, then an alternating {far['kind']};"
        f" in steps of a fifth a {fifth['kind']}, {fifth['distance']:.0e} from the homogeneous state"
    )
    return ours, judge(all(r["homogeneous"] == "minimum" for r in at.values()), fifth["distance"] < 1e-6)


def step_region(n: dict) -> Found:
    """Section 5.2."""
    own, slopes = n["own critical strain, n = 100"], n["exponents"]
    words = " and ".join(f"n^{slopes[N]:.1f} (N = {N})".replace("-", "−") for N in (3, 2))
    ours = f"100 points: to {100 * own:.4f} %; with more it falls as {words}".replace("-", "−")
    return ours, judge(own < 0.9 * n["diagonal"])


# --- the cuboid


def cuboid(n: dict) -> Found:
    """Section 5.3."""
    runs = [n[f"m = 0, {side}"] for side in ("tension", "compression")]
    good = all(r["onset"] is not None for r in runs)
    seen = " and ".join(percent(r["onset"]) for r in runs if r["onset"] is not None)
    foretold = " and ".join(percent(r["onset by the symbol"]) for r in runs if r["onset by the symbol"] is not None)
    return f"neighbours alternate from {seen} on; the symbol's growth rates say {foretold}", judge(good)


def cuboid_step(n: dict) -> Found:
    """Section 5.3."""
    sides = ("tension", "compression")
    half, whole = ([n[f"m = 0, {s}{end}"] for s in sides] for end in (", half the step", ""))
    same = all(abs((h["onset"] or 0) - (w["onset"] or 0)) < 0.0021 for h, w in zip(half, whole, strict=True))
    gap = max(h["force differs before the onset by"] for h in half)
    return f"half the step: the same onset, force to {gap:.2%} before it", judge(same and gap < 0.01)


def cuboid_fields(n: dict) -> Found:
    """Fig. 6 c to e: compression."""
    push, stretch = (n[f"m = 0, {side}"]["alternation at the end"] for side in ("compression", "tension"))
    words = ", ".join(f"u_{axis} {push[axis]:.2f}" for axis in "xyz")
    smoother = push["x"] < min(push["y"], push["z"])
    other = stretch["x"] > max(stretch["y"], stretch["z"])
    ours = f"smoother, not smooth: alternation {words} of h; in tension it is u_x that alternates most"
    return ours, judge(smoother and push["x"] < 1e-3, smoother and other)


def cuboid_when(n: dict) -> Found:
    """Fig. 6: neither points nor rate are printed, and the onset depends on both."""
    onset, shape = n["m = 0, compression"]["onset"], " × ".join(map(str, n["shape"]))
    return f"{percent(onset)} with {shape} points, N = {n['N']}, rate {n['rate']:g}; it moves with the rate", OPEN


# --- waves


def waves_small(n: dict) -> Found:
    """Section 5.4."""
    gap = n["orders from the symbol, small u0"]
    return f"the symbol's, to {gap:.0e} c/h", judge(gap < 1e-5)


def waves_zeros(n: dict) -> Found:
    """Fig. 7."""
    at_edge = n["|ω| h/c at k = π/h, large u0"]
    kept = [m for m, size in at_edge.items() if size < 1e-9]
    ours = f"at tiny u₀, yes; at 0.1 h of those drawn only m = {', '.join(kept)} (m = 1: |ω| = {at_edge['1']:.2f} c/h)"
    return ours, judge(len(kept) == len(at_edge), close(n["zeros of the symbol, k h / π"], [1.0]))


def waves_large(n: dict) -> Found:
    """Section 5.4."""
    here, there = (complex(*n["ω over the symbol's, m = 1, large u0"][at]) for at in ("X = 0", "X = 2 h"))
    flipped, shift = complex(*n["the same, sign of u0 changed"]), n["real waves: shift over u0²"][-1]
    one = abs(here - there) < 1e-3 and abs(here - flipped) < 1e-3
    ours = (
        f"ω depends on where it is read ({here:.3f} at X = 0, {there:.3f} at 2h) and on the sign of u₀;"
        f" a real wave's moves by {shift:.2f} u₀²"
    )
    return ours.replace("-", "−").replace("j", "i"), judge(one, not one)
