"""Dispersion at a tiny and at a large amplitude, compared with the symbol, and whether the large wave is a motion.

The paper puts u = u₀ exp i(kX − ωt) into the equation of motion and reads ω at X = t = 0. The figure shows the real
part. For small u₀ it is the frequency of the symbol, for every order. The frequency of a motion depends neither on the
place X nor on the sign of u₀: the wave with −u₀ is the same real wave, shifted by half a wavelength. The third panel
reads ω in three ways, beside real standing waves in time. Other numbers concern the zero at the edge of the zone: the
behaviour of that wave at rest and under load, and the continuum, which has no such zero.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

import pdjax as pd

from ...figures import COLOURS
from .. import closed_forms as cf
from ._common import Found, close, judge, linear, of_order, sizes

N, ORDERS, SMALL, LARGE = 3, (-1.0, 0.0, 0.5, 1.0, 2.0), 1e-6, 0.1
LAW = linear(1.0, 0.0)
READ = 2 * np.pi * 4 / 40  # the wave whose ω is read in several ways: four waves on forty points
WAYS = {"X = 0": (1.0, 0.0, "-"), "X = 2 h": (1.0, 2.0, "--"), "X = 5 h, half a wave": (1.0, 5.0, ":")}


def printed(k, u0: float, m: float, X: float = 0.0) -> np.ndarray:
    """ω as printed, complex, in units of c/h."""
    return np.sqrt(np.asarray(cf.dispersion_1d(k, u0, m, N, X=X)) + 0j)


def real_wave(u0: float, omega: float, m: float = 1.0) -> float:
    """Frequency of a standing wave [c/h] at READ, from the first return of the velocity to zero."""
    motion = pd.scenes.wave(40, N, READ, u0, of_order(m, LAW))
    dt = 0.002 * 2 * np.pi / omega
    history = pd.simulate(motion, 0.6 * 2 * np.pi / omega, dt=dt, save_every=1)
    a = np.asarray(pd.amplitude(history.v, motion.start))
    turn = np.flatnonzero((a[1:-1] < 0) & (a[2:] >= 0))[0] + 1
    return float(np.pi / (history.times[turn] + dt * a[turn] / (a[turn] - a[turn + 1])))


def edge_wave() -> dict:
    """Numbers of the wave at the edge of the zone, k = π/h, m = 1.

    These are the symbol over the modulus of the law, at rest and at ±1 % of strain, and the verdict at rest; and how
    far lattices are from the continuum at kδ = 2π, the minimum beyond kδ = π, in units of c/δ.
    """
    family, model, lowest = pd.lattice_family(1, N), of_order(1.0, LAW), 2 * np.pi
    at = {f"{a:+g}": float(pd.symbol(model, family, (1 + a) * np.eye(1), [np.pi])[0, 0]) for a in (-0.01, 0.0, 0.01)}
    continuum = float(np.sqrt(cf.dispersion_continuum_1d(lowest, 1.0)))
    lattice = {n: n * float(np.sqrt(cf.dispersion_limit_1d(lowest / n, n))) for n in (3, 6, 12, 24)}
    return {
        "λ h²/κ": at,
        "at rest": pd.stability(model, family, np.eye(1)).verdict,
        "continuum, ω δ/c at kδ = 2π": continuum,
        "lattices from it": {n: abs(omega - continuum) for n, omega in lattice.items()},
    }


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `dispersion`."""
    half = np.linspace(0.01, np.pi, 60 if quick else 200)
    k = np.append(half, np.linspace(np.pi, 2 * np.pi, len(half))[1:])
    exact = pd.dispersion(of_order(1.0, LAW), pd.lattice_family(dim=1, N=N), np.eye(1), k)
    symbol, zero_energy = np.asarray(exact.frequency[:, 0]), np.asarray(exact.zero_energy[:, 0])
    line = pd.figures.Branch("classical", k / np.pi, k, ":")
    small, large = (
        [line, *(pd.figures.Branch(f"m = {m:g}".replace("-", "−"), k / np.pi, printed(k, u0, m).real) for m in ORDERS)]
        for u0 in (SMALL, LARGE)
    )
    gap = max(float(np.abs(branch.omega - symbol).max()) for branch in small[1:])
    small.append(pd.figures.Branch("symbol", k / np.pi, symbol, "--", zero_energy))
    small.append(pd.figures.Branch("continuum", k / np.pi, np.sqrt(cf.dispersion_continuum_1d(k, N)), "-."))
    omega = float(np.sqrt(cf.dispersion_limit_1d(READ, N)))
    sizes_u0 = np.array([0.05, 0.1]) if quick else np.array([0.025, 0.05, 0.075, 0.1])
    real = [real_wave(float(u0), omega) / omega for u0 in sizes_u0]
    shift = np.array(real) - 1
    reads = {name: printed(READ, s * LARGE, 1.0, X) / omega for name, (s, X, _) in WAYS.items()}
    numbers = {
        "orders from the symbol, small u0": gap,
        "zeros of the symbol, k h / π": (k[zero_energy] / np.pi).tolist(),
        "wave at the zone's edge": edge_wave(),
        "|ω| h/c at k = π/h, large u0": {f"m = {m:g}": abs(complex(printed(np.pi, LARGE, m))) for m in ORDERS},
        "ω over the symbol's, m = 1, large u0": {n: [complex(w).real, complex(w).imag] for n, w in reads.items()},
        "the same, sign of u0 changed": [f(complex(printed(READ, -LARGE, 1.0) / omega)) for f in (np.real, np.imag)],
        "real waves: shift over u0²": (shift / sizes_u0**2).tolist(),
        "real waves: ω over the symbol's": dict(zip(map(float, sizes_u0), real, strict=True)),
    }
    figure = Figure(figsize=(14.6, 5.0), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(9.4, 5.2))[0]
    panels: dict[str, Sequence[pd.figures.Branch]] = {
        "u₀ = 10⁻⁶ h: every order agrees with the symbol": small,
        f"u₀ = {LARGE:g} h: the orders differ": large,
    }
    pd.figures.dispersion_curves(panels, f"The paper's dispersion relation, 1D, N = {N}{sizes(quick)}", 0.7, left)
    _draw_reads(right, sizes_u0, real, omega)
    return numbers, figure


def _draw_reads(on, sizes_u0: np.ndarray, real: list[float], omega: float) -> None:
    """Draw frequencies against u₀: of the complex wave, read at three places, and of real waves in time."""
    upper, lower = on.subplots(2, 1, sharex=True)
    u0 = np.linspace(1e-3, LARGE, 40)
    for name, (sign, X, style) in WAYS.items():
        found = np.array([printed(READ, sign * float(x), 1.0, X) / omega for x in u0])
        upper.plot(u0, found.real, style, color=COLOURS["printed"], label=f"complex wave at {name}")
        lower.plot(u0, found.imag, style, color=COLOURS["printed"])
    upper.plot(sizes_u0, real, "o", color=COLOURS["symbol"], markersize=5, label="real standing wave, in time")
    lower.plot(sizes_u0, np.zeros_like(sizes_u0), "o", color=COLOURS["symbol"], markersize=5)
    upper.set_ylabel("Re ω / ω of the symbol  [–]")
    lower.set_ylabel("Im ω / ω of the symbol  [–]")
    lower.set_xlabel("amplitude u₀ / h  [–]")
    upper.legend(fontsize=8, frameon=False)
    on.suptitle("m = 1, k h = 0.2 π: frequency against amplitude", fontsize=11)


# --- what the numbers say of the claims


def waves_small(n: dict) -> Found:
    """Section 5.4."""
    gap = n["orders from the symbol, small u0"]
    return f"they agree with the symbol to {gap:.0e} c/h", judge(gap < 1e-5)


def waves_zeros(n: dict) -> Found:
    """Fig. 7."""
    at_edge = n["|ω| h/c at k = π/h, large u0"]
    kept = [m for m, size in at_edge.items() if size < 1e-9]
    size = at_edge["m = 1"]
    ours = (
        f"true for tiny u₀; for 0.1 h true of {', '.join(kept)} only, of the drawn orders (m = 1: |ω| = {size:.2f} c/h)"
    )
    return ours, judge(len(kept) == len(at_edge), close(n["zeros of the symbol, k h / π"], [1.0]))


def waves_edge(n: dict) -> Found:
    """Fig. 7: the meaning of a zero frequency."""
    edge = n["wave at the zone's edge"]
    pressed, rest, pulled = (edge["λ h²/κ"][a] for a in ("-0.01", "+0", "+0.01"))
    turns = abs(rest) < 1e-14 and pulled < 0 < pressed
    lowest, gaps = edge["continuum, ω δ/c at kδ = 2π"], list(edge["lattices from it"].values())
    of_the_lattice = lowest > 0.5 and all(finer < 0.6 * coarser for coarser, finer in pairwise(gaps))
    grows, runs = np.sqrt(max(pressed, 0)), np.sqrt(max(-pulled, 0))
    ours = (
        f"at rest every order is {edge['at rest']}. For m = 1 the wave at π/h grows at {grows:.3f} c/h under 1 % of"
        f" compression and oscillates at {runs:.3f} c/h under 1 % of tension. The zero belongs to the lattice:"
        f" the limit of fine lattices, ω = (c/δ) Si(kδ), is above {np.floor(100 * lowest) / 100:.2f} c/δ for kδ > π"
    )
    return ours, judge(edge["at rest"] == "unstable", edge["at rest"] == "marginal" and turns and of_the_lattice)


def waves_large(n: dict) -> Found:
    """Section 5.4."""
    here, there = (complex(*n["ω over the symbol's, m = 1, large u0"][at]) for at in ("X = 0", "X = 2 h"))
    flipped, shift = complex(*n["the same, sign of u0 changed"]), n["real waves: shift over u0²"][-1]
    one = abs(here - there) < 1e-3 and abs(here - flipped) < 1e-3
    ours = (
        f"ω depends on where it is read ({here:.3f} at X = 0, {there:.3f} at 2h) and on the sign of u₀;"
        f" a real standing wave has that of the symbol times 1 {'-' if shift < 0 else '+'} {abs(shift):.2f} (u₀/h)²"
    )
    return ours.replace("-", "−").replace("j", "i"), judge(one, not one)
