"""Can a zero-energy control stabilise the Seth–Hill model? Critical hydrostatic strain against the control's strength.

The paper advises against stabilising the finite-deformation model but does not test it. Here each control is added to
the orders m = 1, ½, 0, −1. The strength of the penalty (g) and of the hourglass control (C) varies from 1e-3 to 10.
Wan's control has no strength parameter. Repeated subdivision finds the strength above which the states at ±1, ±5 and
±10 % strain are stable.
"""

import argparse

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES
from pdjax.infinite_lattice import criteria

jax.config.update("jax_enable_x64", True)
LAW = pd.LinearElastic(1.0, 1.0)
CONTROLS = {"penalty g": pd.SillingControl, "hourglass C": pd.LittlewoodControl}
COLOUR = dict(zip((1.0, 0.5, 0.0, -1.0), SERIES, strict=False))  # by order m
STATES = (0.01, 0.05, 0.1)


@eqx.filter_jit
def unstable(models, family, F, intervals):
    """True for each model of a batch that is unstable in the state F."""
    zone = criteria.family_zone(family, "cubic", intervals)

    def one(model):
        out = criteria.evaluate("symbol", model, family, F, zone)
        return out.margin > criteria.margin_tolerance(F.dtype, out.scale)

    return eqx.filter_vmap(one)(models)


def strength_needed(kind, m, family, a: float, intervals: int) -> float:
    """Smallest strength that makes the state (1 + a) I stable; 0 if none is needed, inf if 100 is not enough."""
    F = (1 + a) * jnp.eye(family.dim)

    def bad(strengths):
        models = eqx.filter_vmap(lambda g: pd.SethHill(m, LAW, kind(g)))(jnp.asarray(strengths))
        return np.asarray(unstable(models, family, F, intervals))

    grid = np.concatenate([[0.0], np.geomspace(1e-4, 100, 31)])
    flags = bad(grid)
    if not flags[0]:
        return 0.0
    for _ in range(3):
        i = int(np.argmax(~flags))
        if flags.all():
            return float("inf")
        grid = np.linspace(grid[i - 1], grid[i], 32)
        flags = bad(grid)
    return float(grid[int(np.argmax(~flags))])


def draw(numbers: dict) -> Figure:
    """Draw critical strain over strength: rows by dimension, columns by control; no failure is drawn on the frame."""
    dims = sorted({case["dim"] for case in numbers["cases"]})
    figure = Figure(figsize=(9.2, 3.5 * len(dims) + 0.6), layout="constrained")
    axes = figure.subplots(len(dims), 2, squeeze=False, sharex=True)
    for case in numbers["cases"]:
        if case["control"] not in CONTROLS:
            continue
        ax = axes[dims.index(case["dim"]), list(CONTROLS).index(case["control"])]
        for side, style in (("negative", "-"), ("positive", "--")):
            shown = np.clip(100 * np.array(case["critical"][side], dtype=float), -90, 100)
            ax.plot(numbers["strengths"], shown, style, color=COLOUR[case["m"]], lw=1.6)
    for row, dim in enumerate(dims):
        for column, name in enumerate(CONTROLS):
            ax = axes[row, column]
            ax.axhline(100 * numbers[f"law {dim}D"]["negative"], color="black", lw=0.9, ls=":")
            ax.set_xscale("log")
            ax.set_ylim(-90, 100)
            ax.set_title(f"{dim}D, N = 3, {name.split()[0]} control", fontsize=9)
            ax.set_ylabel("critical hydrostatic strain  [%]")
            if row == len(dims) - 1:
                ax.set_xlabel(f"strength {name.split()[1]} of the {name.split()[0]} control  [–]")
    for m, colour in COLOUR.items():
        axes[0, 0].plot([], [], color=colour, label=f"m = {m:g}".replace("-", "−"))
    axes[0, 0].plot([], [], color="gray", label="compression")
    axes[0, 0].plot([], [], "--", color="gray", label="tension")
    axes[0, 0].plot([], [], ":", color="black", label="local law, m = 1, compression")
    figure.suptitle(
        "Seth–Hill model with a zero-energy control, λ = μ = 1 (a line at 100 %: no instability up to +100 %)",
        fontsize=10,
    )
    handles = axes[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=7, fontsize=8, frameon=False)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="run 2D only, with four strengths")
    quick = parser.parse_args().quick
    strengths = np.geomspace(1e-3, 10, 4 if quick else 9)
    numbers: dict = {"law": "LinearElastic(1, 1)", "N": 3, "strengths": strengths.tolist(), "cases": []}
    dims = (2,) if quick else (2, 3)
    for dim in dims:
        family = pd.lattice_family(dim, 3)
        intervals = {2: 18, 3: 10}[dim]
        own = {
            side: float(pd.critical_load(pd.Correspondence(LAW), family, pd.hydrostatic, "local", side))
            for side in ("negative", "positive")
        }
        for m in COLOUR:
            bare = {
                side: float(pd.critical_load(pd.SethHill(m, LAW), family, side=side, resolution=intervals))
                for side in ("negative", "positive")
            }
            for name, kind in CONTROLS.items():
                case = {"dim": dim, "m": m, "control": name, "bare": bare, "critical": {}, "needed": {}}
                for side, sign in (("negative", -1), ("positive", 1)):
                    found = [
                        float(pd.critical_load(pd.SethHill(m, LAW, kind(g)), family, side=side, resolution=intervals))
                        for g in strengths
                    ]
                    case["critical"][side] = found
                    for a in STATES:
                        case["needed"][f"{100 * sign * a:+g} %"] = strength_needed(kind, m, family, sign * a, intervals)
                numbers["cases"].append(case)
            wan = pd.SethHill(m, LAW, pd.WanControl())
            numbers["cases"].append(
                {"dim": dim, "m": m, "control": "Wan", "bare": bare}
                | {
                    "critical": {
                        side: float(pd.critical_load(wan, family, side=side, resolution=intervals))
                        for side in ("negative", "positive")
                    }
                }
            )
        numbers[f"law {dim}D"] = own
    write("stabilisers-quick" if quick else "stabilisers", numbers, draw(numbers))


if __name__ == "__main__":
    main()
