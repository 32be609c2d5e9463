"""Running cracks beside papers: the glass plate of Ha & Bobaru and the steel plate of Kalthoff & Winkler.

Each part is a set of runs of `pdjax.studies.running_cracks`:

    branching  the glass plate: horizons of 3 to 1 mm at N = 3, N = 4 at one horizon, the 14 MPa of the paper, LPS
    impact     the steel plate: horizons of 7.5 to 1.9 mm at N = 3, N = 4 at one horizon, LPS of two Poisson's ratios
    steps      both plates with time steps of 0.8 to 0.1 of the critical one

**Bands of acceptance**, fixed before the first run (with the sources in `pdjax.scenes.glass_plate` and
`pdjax.scenes.edge_impact`; the values are those that later papers quote or that their figures show, because the full
texts were not at hand):

    largest speed          below the Rayleigh speed c_R (Freund 1990), and 0.45 to 0.7 c_R (Bowden et al. 1967, Borden
                           et al. 2012, Bleyer et al. 2017)
    place of branching     8 to 24 mm from the notch (Ha & Bobaru 2010, Borden et al. 2012)
    angle of branching     30 to 60° (Quinn 2019, Borden et al. 2012)
    angle of Kalthoff      65 to 72° (Kalthoff 2000, Silling 2003)
    energy budget          closes to the second order of the time step

`python benchmarks/fracture_dynamics.py --part impact` runs one part and keeps the results of the others. `--part draw`
draws the picture again. All parts take 12 minutes on a busy machine of two cores.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES
from pdjax.figures.fields import outlines, paint
from pdjax.finite_body.dynamics.time_step import SAFETY_BREAKING
from pdjax.studies import running_cracks

jax.config.update("jax_enable_x64", True)
RESULTS = Path(__file__).parent / "results" / "fracture_dynamics.json"
FIELDS = Path(tempfile.gettempdir()) / "pdjax-fracture-dynamics.npz"  # the damage of the drawn runs, between the parts
GLASS = {"young": 72e9, "dim": 2, "plane": "stress"}
STEEL = {"young": 190e9, "dim": 2, "plane": "strain"}
DRAWN = {"glass": "branching", "steel": "impact"}


def inside(value, band):
    return bool(band[0] <= value <= band[1])


def run(name, body, n, N=3.015, share=SAFETY_BREAKING, model="bond-based", poisson=None, **more):
    """One run: its settings, its numbers, the bands it meets, and its time."""
    if model == "lps":
        more["model"] = pd.LPS.from_young(poisson=poisson, **(GLASS if body == "glass" else STEEL))
    make = pd.scenes.branching_plate if body == "glass" else pd.scenes.kalthoff
    simulate = running_cracks.branching if body == "glass" else running_cracks.impact
    scene = make(n, N, **more)
    dt = share * pd.critical_time_step(scene[0])
    began = time.perf_counter()
    history, out = simulate(scene, dt)
    seconds = time.perf_counter() - began
    settings = {"name": name, "body": body, "n": n, "N": N, "dt_over_critical": share, "model": model}
    settings |= {"poisson": poisson} if poisson else {}
    settings |= {key: value for key, value in more.items() if key != "model"}
    met = {"energy": out["energy"]["error"] < 1e-2}
    if body == "glass":
        met |= {
            "below_rayleigh": out["largest_speed"] < out["rayleigh"],
            "speed": inside(out["largest_speed"], out["expected"]["speed"]),
            "distance": inside(out["branching"]["distance"], out["expected"]["distance"]),
            "angle": inside(out["branching"]["angle"], out["expected"]["angle"]),
        }
    else:
        met |= {
            "below_rayleigh": all(crack["speed"] < out["rayleigh"] for crack in out["cracks"]),
            "angle": all(inside(crack["angle"], out["expected"]["angle"]) for crack in out["cracks"]),
        }
    row = settings | out | {"seconds": seconds, "ms_per_step": 1e3 * seconds / out["steps"], "met": met}
    row["released_over_area"] = out["energy"]["released"] / out["energy_of_area"]
    if "energy_at_critical_stretch" in out:
        row["overshoot"] = out["energy"]["released"] / out["energy_at_critical_stretch"]
    print(json.dumps({key: row[key] for key in ("name", "seconds", "met")}), flush=True)
    field = {"X": scene[0].scene.body.positions, "damage": history.observed["damage"][-1], "times": history.times}
    if "tip" in history.observed:
        field["tip"] = history.observed["tip"]
    return row, field


def keep(body, field):
    kept = dict(np.load(FIELDS)) if FIELDS.exists() else {}
    np.savez(FIELDS, **kept | {f"{body} {name}": values for name, values in field.items()})


def branching():
    rows = []
    for n in (100, 150, 200, 300):
        row, field = run(f"glass, horizon {3.015e2 / n:.2f} mm", "glass", n)
        rows.append(row)
    keep("glass", field)
    rows.append(run("glass, N = 4", "glass", 200, 4.02)[0])
    rows.append(run("glass, 14 MPa", "glass", 150, stress=14e6)[0])
    rows.append(run("glass, LPS, nu = 1/3", "glass", 150, model="lps", poisson=1 / 3)[0])
    return rows


def impact():
    rows = []
    for n in (40, 80, 160):
        row, field = run(f"steel, horizon {3.015e2 / n:.2f} mm", "steel", n)
        rows.append(row)
    keep("steel", field)
    rows.append(run("steel, N = 4", "steel", 108, 4.07)[0])
    rows.extend(run(f"steel, LPS, nu = {nu:g}", "steel", 80, model="lps", poisson=nu)[0] for nu in (0.25, 0.3))
    return rows


def steps():
    shares = (0.8, 0.4, 0.2, 0.1)
    rows = [run(f"glass, dt {share:g}", "glass", 100, share=share)[0] for share in shares]
    return rows + [run(f"steel, dt {share:g}", "steel", 80, share=share)[0] for share in shares]


def draw(found):
    """The two cracks, the way of the tip, and what the time step does."""
    kept = np.load(FIELDS)
    figure = Figure(figsize=(14.0, 7.6), layout="constrained")
    places = [["glass", "glass", "glass", "steel"], ["way", "steps", "angle", "steel"]]
    axes = figure.subplot_mosaic(places, height_ratios=[1.35, 1])
    for body in ("glass", "steel"):
        X, damage = kept[f"{body} X"], kept[f"{body} damage"]
        h = float(np.diff(np.unique(X[:, 0].round(9))).min())
        points = pd.lattice(tuple(np.round(X.max(axis=0) / h + 0.5).astype(int)), h)
        tiles = outlines(points, 1e3 * points.positions, np.ones(len(X), bool), (0, 1))
        centre = 1e3 * points.positions[:, None]
        tiles = centre + 1e3 * (tiles - centre)  # the outlines of a lattice have the size of its spacing in m
        paint(axes[body], tiles, damage, "damage φ  [-]", (0, 1), body == "glass", limits=(0.0, 1.0))
        axes[body].set(xlabel="x  [mm]", ylabel="y  [mm]")
    rows = {row["name"]: row for part in ("branching", "impact", "steps") for row in found.get(part, [])}
    glass = [row for row in found["branching"] if row["name"].startswith("glass, horizon")][-1]
    steel = [row for row in found["impact"] if row["name"].startswith("steel, horizon")]
    axes["glass"].set_title(f"glass, 12 MPa, δ = {1e3 * glass['horizon']:.2f} mm, 45 µs", fontsize=10)
    axes["steel"].set_title(f"steel, 16.5 m/s, δ = {1e3 * steel[-1]['horizon']:.2f} mm, 90 µs", fontsize=10)
    way = axes["way"]
    times, tip = 1e6 * kept["glass times"], 1e3 * kept["glass tip"]
    way.plot(times, tip, color=SERIES[0], label="tip of the glass plate")
    start = times[np.argmax(tip > 0)]
    wave = np.array([0.0, 50.0])  # mm
    way.plot(start + 1e3 * wave / glass["rayleigh"], wave, "--", color="#444444", label="Rayleigh speed")
    way.axhspan(*(1e3 * x for x in glass["expected"]["distance"]), color="#DCE9F5", label="branching in papers")
    way.set(xlabel="t  [µs]", ylabel="way along the notch  [mm]", ylim=(0, 78))
    way.legend(fontsize=8, frameon=False, loc="upper left")
    scan = axes["steps"]
    for body, colour in (("glass", SERIES[0]), ("steel", SERIES[2])):
        some = [row for row in found["steps"] if row["body"] == body]
        scan.plot([r["dt_over_critical"] for r in some], [r["overshoot"] for r in some], "o-", color=colour, label=body)
    scan.set(xlabel="time step over the critical one", ylabel="released energy over that at s₀", xlim=(0, 0.85))
    scan.axhline(1, color="#888888", linewidth=0.6)
    scan.legend(fontsize=8, frameon=False)
    angle = axes["angle"]
    angle.axhspan(65, 72, color="#DCE9F5", label="papers")
    springs = [row for row in rows.values() if row["body"] == "steel" and row["model"] == "bond-based"]
    coarse = [row for row in springs if row["dt_over_critical"] == 0.8]
    fourth = [row for row in springs if row["N"] > 4]
    for some, look, label in (
        (steel, "o-", "bond-based"),
        (fourth, "D", "bond-based, N = 4"),
        (coarse, "o", "bond-based, dt 0.8"),
    ):
        colour = SERIES[3] if some is coarse else SERIES[2]
        at = [(1e3 * row["horizon"], row["cracks"][1]["angle"]) for row in some]
        angle.plot(*zip(*at, strict=True), look, color=colour, label=label)
    for row, marker in zip(
        [r for r in rows.values() if r["body"] == "steel" and r["model"] == "lps"], "s^", strict=False
    ):
        label = f"LPS, ν = {row['poisson']:g}"
        angle.plot([1e3 * row["horizon"]], [row["cracks"][1]["angle"]], marker, color=SERIES[4], label=label)
    angle.set(xlabel="horizon  [mm]", ylabel="angle of the steel cracks  [degree]", xlim=(0, 9), ylim=(30, 74))
    angle.legend(fontsize=8, frameon=False, loc="lower left")
    return figure


PARTS = {"branching": branching, "impact": impact, "steps": steps}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", choices=[*PARTS, "draw"], help="run one part, and keep the results of the others")
    part = parser.parse_args().part
    found = json.loads(RESULTS.read_text()) if part and RESULTS.exists() else {}
    found.pop("machine", None)
    for name in PARTS if part is None else [part]:
        if name != "draw":
            found[name] = PARTS[name]()
    whole = all(name in found for name in PARTS) and FIELDS.exists()
    write("fracture_dynamics", found, draw(found) if whole else None)
