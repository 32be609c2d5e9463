"""Which cracks are instabilities: a notched plate is pulled apart, with correspondence models, controls and LPS.

The plate has the width W and the height 2W/3, and a notch from the left edge through a third of its width. Its lower
and upper edges move apart at constant speed. All points start with the speed of a uniform strain rate. Bonds break at a
critical stretch, the same in all models, except beside the moved edges. λ = μ, plane strain, N = 3.015.

    Silling, Seth–Hill m = 0, Seth–Hill m = 1     each with three controls:
        none        no zero-energy control
        weak        the least penalty (`pd.least_penalty`) with the worst margin −0.02 at strains of ±3 %
        designed    the least penalty whose worst margin there is that of LPS at rest
    LPS, bond-based                               references without zero-energy modes

`pd.crack_or_instability` judges every burst. Times are given as the nominal strain, the opening over the height. The
finer plate has half the spacing and the same physical size and fracture energy: its critical stretch is √2 times that
of the coarse plate. The 50th broken bond of the coarse plate corresponds to the 100th of the fine one. A critical
stretch is not the same fracture energy in every model.
"""

import argparse
import time

import jax
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures.fracture import VERDICT_COLOURS, colours_of

jax.config.update("jax_enable_x64", True)
LAW, N, STRETCH, SPEED, STRAIN = pd.LinearElastic(1.0, 1.0), 3.015, 0.02, 0.008, 0.014
LOADS, LOAD = ["hydrostatic", "uniaxial-strain", "simple-shear"], 0.03
FINE = [(name, control) for name in ("Silling", "Seth–Hill m = 1") for control in ("none", "designed")]
# The references have no control. In the picture they stand beside these rows.
REFERENCES = {
    ("LPS", "none"): pd.LPS(2.0, 1.0),
    ("bond-based", "designed"): pd.BondBased.from_family(2.0, pd.lattice_family(2, N)),
}
MANY = 50  # bonds that break while the crack of the coarse plate grows by about two horizons
WEAK = -0.02  # worst margin of the weak control
CONTROLS = ("none", "weak", "designed")
ORDERS = {"Silling": None, "Seth–Hill m = 0": 0.0, "Seth–Hill m = 1": 1.0}


def model_of(name: str, g: float) -> pd.AbstractModel:
    """The model with Silling's penalty of strength g, or without a control for g = 0."""
    control = pd.SillingControl(g) if g else None
    return pd.Correspondence(LAW, control) if ORDERS[name] is None else pd.SethHill(ORDERS[name], LAW, control)


def strengths() -> dict[str, dict[str, float]]:
    """The penalty g of every model and control."""
    family, cases = pd.lattice_family(2, N), pd.load_cases(LOADS, [-LOAD, LOAD])
    reference = float(pd.stability(pd.LPS(2.0, 1.0), family, np.eye(2)).margin)
    goals = {"weak": WEAK, "designed": reference}
    found = {}
    for name in ORDERS:
        least = {
            control: pd.least_penalty(lambda g, name=name: with_penalty(name, g), family, cases, margin)
            for control, margin in goals.items()
        }
        found[name] = {"none": 0.0, **least}
    return found


def with_penalty(name: str, g: float) -> pd.AbstractModel:
    """The model with a penalty whose strength may be traced."""
    control = pd.SillingControl(g)
    return pd.Correspondence(LAW, control) if ORDERS[name] is None else pd.SethHill(ORDERS[name], LAW, control)


def opening(t):
    """The opening of the plate at a time."""
    return SPEED * t


class Plate:
    """The notched plate of `cells` points, whose spacing is 1."""

    def __init__(self, cells: tuple[int, int], coarse: int):
        self.body = pd.lattice(cells)
        self.cells, self.scale = cells, cells[0] / coarse
        X, (self.width, self.height) = self.body.positions, cells
        self.tip = self.width / 3
        notch = pd.Segment((0.0, self.height / 2), (self.tip, self.height / 2))
        self.families = pd.cut(pd.families(self.body, N), notch)
        self.held = np.minimum(X[:, 1], self.height - X[:, 1]) < 3
        self.safe = np.minimum(X[:, 1], self.height - X[:, 1]) < 6

    def run(self, model: pd.AbstractModel) -> tuple[pd.History, pd.FractureVerdict, pd.Scene, float]:
        """The run of a model, its verdicts, its scene, and the time in seconds of both."""
        start = time.perf_counter()
        side = np.sign(self.body.positions[:, 1] - self.height / 2)[:, None] * [0.0, 0.5]
        scene = pd.scene(self.body, self.families, model, pd.prescribe(self.held, side[self.held]))
        velocity = SPEED * (self.body.positions - [0.0, self.height / 2]) / self.height * [0.0, 1.0]
        motion = pd.motion(scene, schedule=opening, velocity=velocity)
        history = pd.simulate(
            motion,
            STRAIN * self.height / SPEED,
            dt=0.25 * pd.critical_time_step(motion),
            save_every=4,
            breaking=pd.CriticalStretch(STRETCH * np.sqrt(self.scale), no_fail=self.safe),
            show_progress=False,
        )
        found = pd.crack_or_instability(model, self.families, history, held=~scene.free, density=1.0)
        return history, found, scene, time.perf_counter() - start

    def strain_at(self, found: pd.FractureVerdict, bonds: float) -> float | None:
        """Nominal strain at the burst in which so many bonds have broken."""
        broken = np.cumsum([burst.bonds for burst in found.bursts])
        reached = np.flatnonzero(broken >= bonds)
        return found.bursts[reached[0]].time * SPEED / self.height if len(reached) else None

    def row(self, model: pd.AbstractModel) -> tuple[dict, pd.FractureVerdict]:
        """What is kept of a run."""
        history, found, _, seconds = self.run(model)
        X, hurt, broken = self.body.positions, found.damage > 0.3, found.damage > 0.1
        first = found.bursts[0] if found.bursts else None
        growing = found.first_instability
        return {
            "ending": history.reason,
            "first break at the strain": first and first.time * SPEED / self.height,
            f"strain at the {MANY}th broken bond": self.strain_at(found, MANY * self.scale),
            "verdict of the first burst": found.verdict,
            "margin before it": first and first.margin,
            "zero-energy share before it": first and first.zero_energy,
            "bursts": found.counts,
            "bonds": found.bonds,
            "first instability at the strain": None
            if growing is None
            else found.bursts[growing].time * SPEED / self.height,
            "crack length over the width": float(max(X[hurt, 0].max(initial=self.tip) - self.tip, 0.0) / self.width),
            "damaged part of the plate": float(broken.mean()),
            "energy error": float(np.abs(history.energies.error).max()),
            "seconds": seconds,
        }, found


def draw(panels: dict[tuple[str, str, str], tuple[Plate, pd.FractureVerdict]]) -> Figure:
    """The damage of all runs in the colours of the verdicts: a column a model, a row a plate and a control."""
    rows = sorted({(points, control) for points, _, control in panels}, key=lambda r: (r[0], CONTROLS.index(r[1])))
    figure = Figure(figsize=(3.1 * (len(ORDERS) + 1), 2.3 * len(rows) + 0.4), layout="constrained")
    grid = figure.subplots(len(rows), len(ORDERS) + 1, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for (points, name, control), (plate, found) in panels.items():
        column = list(ORDERS).index(name) if name in ORDERS else len(ORDERS)
        axes = grid[rows.index((points, control)), column]
        image = colours_of(found).reshape(*plate.cells, 3).transpose(1, 0, 2)
        axes.imshow(image, origin="lower", extent=(0, plate.width, 0, plate.height))
        axes.plot([0, plate.tip], [plate.height / 2] * 2, color="black", linewidth=1.5)
        axes.set_title(f"{name}{f', control: {control}' if name in ORDERS else ''}, {points}", fontsize=8)
    for verdict, colour in VERDICT_COLOURS.items():
        grid[0, 0].plot([], [], "s", color=colour, label=verdict)
    marks = grid[0, 0].get_legend_handles_labels()
    figure.legend(*marks, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the coarse plate only")
    quick = parser.parse_args().quick
    coarse, numbers, panels = 36, {"strengths": strengths(), "rows": []}, {}
    for cells in [(36, 24)] if quick else [(36, 24), (72, 48)]:
        plate, points = Plate(cells, coarse), " × ".join(map(str, cells))
        cases = [(name, control) for control in CONTROLS for name in ORDERS]
        if cells[0] > coarse:
            cases = [case for case in cases if case in FINE]
        for name, control in [*cases, *REFERENCES]:
            model = REFERENCES.get((name, control)) or model_of(name, numbers["strengths"][name][control])
            row, found = plate.row(model)
            own = control if name in ORDERS else "none needed"
            numbers["rows"].append({"points": points, "model": name, "control": own} | row)
            panels[points, name, control] = plate, found
            print(points, name, control, row, flush=True)
    write("cracks_or_instabilities-quick" if quick else "cracks_or_instabilities", numbers, draw(panels))


if __name__ == "__main__":
    main()
