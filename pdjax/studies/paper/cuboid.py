"""The cuboid, 4 × 1 × 1, in tension and compression by its ends, explicit in time, m = 0, and the symbol's prediction.

The alternation of neighbouring points (¼ second differences, root mean square, over h) shows when a run becomes
unstable. Its onset is the strain at which it exceeds ONSET. The prediction is linear: the alternation at the strain
START, times exp ∫ γ dt with the growth rate γ = √(λ_max/ρ) of the symbol on the path of uniaxial stress. Runs with half
the time step are drawn as rings. At full size the order m = 1 is added, which the symbol calls stable in tension.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import pdjax as pd

from ...figures import COLOURS, SERIES
from ...scenes.alternation import roughness
from ._common import OPEN, Found, judge, linear, of_order, percent, sizes

LAW = linear(1.0, 1.0)
MODULUS = 2.5  # Young's, for λ = μ = 1
ONSET, START = 3e-2, 1e-2  # alternation over h; strain from which the prediction runs
STRAINS = np.array([0.002, 0.005, 0.01, 0.02, 0.04, 0.07, 0.1])
SIDES = {"tension": 1.0, "compression": -1.0}
SHADES = {"m = 0": SERIES[0], "m = 1": SERIES[1]}


def pull(model, strain: float, rate: float, shape, N: int = 3, halved: bool = False) -> dict:
    """One run with 100 saves: strains, force, alternation of each component, onset; the last u (points, 3) as "_u"."""
    motion = pd.scenes.cuboid(shape, N, strain, rate, model)
    body = motion.scene.body
    h, duration = body.spacing, motion.duration
    assert h is not None and duration is not None
    dt = 0.8 * pd.critical_time_step(motion) / (2 if halved else 1)
    steps = int(np.ceil(duration / dt / 100)) * 100
    history = pd.simulate(
        motion,
        dt=duration / steps,
        save_every=steps // 100,
        observers={"force": pd.observers.section_force(body, 0.5 * h * shape[0])},
        show_progress=False,
    )
    reached = strain * np.minimum(history.times / duration, 1)
    rough = np.array([roughness(np.asarray(history.u), shape, k) / h for k in range(3)])
    over = np.flatnonzero(rough.max(axis=0) > ONSET)
    return {
        "strain": reached.tolist(),
        "force over E0 A": (history.observed["force"][:, 0] / (MODULUS * h**2 * shape[1] * shape[2])).tolist(),
        "alternation over h": {axis: rough[k].tolist() for k, axis in enumerate("xyz")},
        "onset": float(reached[over[0]]) if len(over) else None,
        "reached": float(reached[-1]),
        "finished": history.finished,
        "reason": history.reason,
        "steps": int(history.steps),
        "energy error": float(np.abs(history.energies.error).max()),
        "_u": np.asarray(history.u[-1]),
    }


def growth(model, sign: float, strains=STRAINS, N: int = 3) -> np.ndarray:
    """γ of the symbol along uniaxial stress (strains,), for spacing and density 1."""
    loads = sign * np.asarray(strains, dtype=float)
    # The map compiles one program for a law and all its orders, but a new one for every function that makes a model.
    what: dict = {"law": model.law} if isinstance(model, pd.SethHill) else {"model": lambda _: model}
    order = float(getattr(model, "m", 0.0))
    found = pd.stability_map([order], loads, N=N, dim=3, path=pd.uniaxial_stress, show_progress=False, **what)
    return np.sqrt(np.where(found.verdict[0] == "unstable", np.maximum(found.eigenvalue[0], 0.0), 0.0))


def predicted(run: dict, rates: np.ndarray, rate: float, strains=STRAINS) -> tuple[np.ndarray, float | None]:
    """Alternation by linear growth, NaN before START, and the strain at which it exceeds ONSET (or None)."""
    strain = np.abs(run["strain"])
    gamma = np.interp(strain, np.r_[0.0, strains], np.r_[0.0, rates])
    exponent = np.concatenate([[0], np.cumsum(0.5 * (gamma[1:] + gamma[:-1]) * np.diff(strain))]) / rate
    worst = worst_alternation(run)
    first = int(np.searchsorted(strain, START))
    with np.errstate(over="ignore"):
        curve = worst[first] * np.exp(exponent - exponent[first])
    over = np.flatnonzero((curve > ONSET) & (np.arange(len(curve)) > first))
    curve[:first] = np.nan
    return curve, float(strain[over[0]]) if len(over) else None


def worst_alternation(run: dict) -> np.ndarray:
    """The largest alternation of the three components over h (saves,)."""
    return np.max(list(run["alternation over h"].values()), axis=0)


def make(quick: bool) -> tuple[dict, Figure]:
    """The sheet `cuboid`."""
    shape, N, rate = ((20, 5, 5), 2, 0.01) if quick else ((28, 7, 7), 3, 0.005)
    strains = STRAINS[1::2] if quick else STRAINS
    orders = {"m = 0": 0.0} if quick else {"m = 0": 0.0, "m = 1": 1.0}
    models = {name: of_order(m, LAW) for name, m in orders.items()}
    runs, curves, numbers = {}, {}, {"shape": shape, "N": N, "rate": rate, "onset above": ONSET}
    for name, model in models.items():
        for side, sign in SIDES.items():
            run = pull(model, sign * 0.1, rate, shape, N)
            gamma = shape[-1] * growth(
                model, sign, strains, N
            )  # the side of the body is 1; in the symbol the spacing is 1
            curve, by_symbol = predicted(run, gamma, rate, strains)
            runs[name, side], curves[name, side] = run, curve
            numbers[f"{name}, {side}"] = {
                "onset": run["onset"],
                "onset by the symbol": None if by_symbol is None else sign * by_symbol,
                "alternation at the end": {axis: v[-1] for axis, v in run["alternation over h"].items()},
                "largest alternation": float(worst_alternation(run).max()),
                "secant modulus at the end": run["force over E0 A"][-1] / run["reached"],
                "symbol's growth rates": gamma.tolist(),
                "steps": run["steps"],
                "energy error": run["energy error"],
            }
    again = {"compression": SIDES["compression"]} if quick else SIDES
    half = {side: pull(models["m = 0"], sign * 0.1, rate, shape, N, halved=True) for side, sign in again.items()}
    for side, run in half.items():
        whole = runs["m = 0", side]
        before = np.abs(whole["strain"]) <= abs(whole["onset"] or 0.1)
        gap = np.abs(np.subtract(run["force over E0 A"], whole["force over E0 A"]))
        numbers[f"m = 0, {side}, half the step"] = {
            "onset": run["onset"],
            "force differs before the onset by": float(gap[before].max() / np.abs(whole["force over E0 A"]).max()),
            "force differs after the onset by, in the mean": float(
                np.sum(gap[~before]) / max(1, np.sum(~before)) / np.abs(whole["force over E0 A"]).max()
            ),
            "steps": run["steps"],
        }
    return numbers, draw(runs, curves, half, shape, rate, N, quick)


def draw(runs: dict, curves: dict, half: dict, shape, rate: float, N: int, quick: bool) -> Figure:
    """Draw force and alternation against strain, and the displacements of m = 0 in compression."""
    figure = Figure(figsize=(12.4, 7.6), layout="constrained")
    grid = figure.add_gridspec(6, 3)
    axes = [[figure.add_subplot(grid[3 * row : 3 * row + 3, k]) for k in range(2)] for row in range(2)]
    shades = {name: SHADES[name] for name, _ in runs}
    for (force, rough), side in zip(axes, SIDES, strict=True):
        for name, shade in shades.items():
            run = runs[name, side]
            strain = 100 * np.array(run["strain"])
            force.plot(strain, run["force over E0 A"], color=shade, linewidth=1.2)
            rough.semilogy(strain[1:], worst_alternation(run)[1:], color=shade, linewidth=1.4)
            rough.semilogy(strain[1:], curves[name, side][1:], "--", color=shade, linewidth=0.9)
        ring: dict[str, Any] = {"mfc": "none", "mec": COLOURS["printed"], "ms": 5, "mew": 1.0, "zorder": 5}
        if side in half:
            strain, again = 100 * np.array(half[side]["strain"]), np.array(half[side]["force over E0 A"])
            force.plot(strain[::6], again[::6], "o", **ring)
        force.plot(strain, strain / 100, ":", color="#888888", linewidth=1.0)
        force.set_title(f"{side}: force", fontsize=10)
        force.set_ylabel("force / (E₀ A)  [–]")
        rough.set_title(f"{side}: alternation", fontsize=10)
        rough.set_ylabel("alternation / h  [–]")
        rough.axhline(ONSET, color="#888888", linewidth=0.7)
        rough.set_ylim(1e-5, 3)
        for on in (force, rough):
            on.set_xlabel("strain of the ends  [%]")
    last = runs["m = 0", "compression"]
    u = last["_u"].reshape(*shape, 3) * shape[-1]
    for k, (across, cut) in enumerate(zip("yyz", "zzy", strict=True)):
        on = figure.add_subplot(grid[2 * k : 2 * k + 2, 2])
        plane = (u[:, :, shape[2] // 2, k] if cut == "z" else u[:, shape[1] // 2, :, k]).T
        limit = np.abs(plane).max()
        image = on.imshow(plane, origin="lower", cmap="RdBu_r", vmin=-limit, vmax=limit, extent=(0, 4, 0, 1))
        on.set_title(
            f"m = 0 at {100 * last['reached']:.0f} %: u_{'xyz'[k]} / h, plane {cut} = ½".replace("-", "−"), fontsize=9
        )
        on.set_xlabel("x / side  [–]")
        on.set_ylabel(f"{across} / side  [–]")
        figure.colorbar(image, ax=on, shrink=0.7)
    handles = [Line2D([], [], color=shade, label=name) for name, shade in shades.items()]
    handles += [
        Line2D([], [], linestyle="", marker="o", label="m = 0, half the step", mfc="none", mec=COLOURS["printed"]),
        Line2D([], [], color="#555555", linestyle="--", label="predicted by the symbol"),
        Line2D([], [], color="#888888", linestyle=":", label="E₀ × strain"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9, frameon=False)
    words = f"Cuboid of {' × '.join(map(str, shape))} points, N = {N}, λ = μ = ρ = 1, strain rate {rate:g}"
    figure.suptitle(words + sizes(quick), fontsize=11)
    return figure


# --- what the numbers say of the claims


def cuboid(n: dict) -> Found:
    """Section 5.3."""
    runs = [n[f"m = 0, {side}"] for side in ("tension", "compression")]
    good = all(r["onset"] is not None for r in runs)
    seen = " and ".join(percent(r["onset"]) for r in runs if r["onset"] is not None)
    foretold = " and ".join(percent(r["onset by the symbol"]) for r in runs if r["onset by the symbol"] is not None)
    return f"neighbours alternate from {seen} on; the growth rates of the symbol predict {foretold}", judge(good)


def cuboid_step(n: dict) -> Found:
    """Section 5.3."""
    sides = [s for s in SIDES if f"m = 0, {s}, half the step" in n]
    half, whole = ([n[f"m = 0, {s}{end}"] for s in sides] for end in (", half the step", ""))
    onsets = [(h["onset"], w["onset"]) for h, w in zip(half, whole, strict=True)]
    same = all(None not in pair and abs(pair[0] - pair[1]) < 0.0021 for pair in onsets)
    before = max(h["force differs before the onset by"] for h in half)
    after = max(h["force differs after the onset by, in the mean"] for h in half)
    ours = f"half the step: the same onset; the force differs by {before:.2%} before it, by {after:.1%} (mean) after it"
    return ours, judge(same and before < 0.01 and after < 0.1)


def cuboid_fields(n: dict) -> Found:
    """Fig. 6 c to e: compression."""
    push, stretch = (n[f"m = 0, {side}"]["alternation at the end"] for side in ("compression", "tension"))
    words = ", ".join(f"u_{axis} {push[axis]:.2f}" for axis in "xyz")
    smoother = push["x"] < min(push["y"], push["z"])
    other = stretch["x"] > max(stretch["y"], stretch["z"])
    ours = f"u_x is smoother, but not smooth: alternation {words} of h; in tension u_x alternates most"
    return ours, judge(smoother and push["x"] < 1e-3, smoother and other)


def cuboid_when(n: dict) -> Found:
    """Fig. 6: the paper gives neither points nor rate, and the onset depends on both."""
    onset, shape = n["m = 0, compression"]["onset"], " × ".join(map(str, n["shape"]))
    return f"{percent(onset)} with {shape} points, N = {n['N']}, rate {n['rate']:g}; it depends on the rate", OPEN
