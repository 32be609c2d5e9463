"""Zero-energy controls designed by gradient: the least penalty, controls by shells, and what they cost.

    python benchmarks/designed_stabilisers.py                 all parts; kept parts are not computed again
    python benchmarks/designed_stabilisers.py --part penalty  one part: penalty, fronts, transfer, methods, time

**penalty**: the least strength g of Silling's penalty (`pd.least_penalty`) that makes Seth–Hill models of several
orders m stable, on all load paths at ±1, ±5 and ±10 %, in 1D and 2D (N = 3) and 3D (N = 2). A rule of thumb g = c |a|
is fitted to it. Beside it are the errors of wave speeds at kh = 1 and the critical time step.

**fronts**: the smallest error of all phase speeds at kh = 1 that a stabiliser can have whose margin over ±5 % on all
four load paths is at most the given one (`pd.design`, ε-constraints). Silling's correspondence model and the Seth–Hill
model with a free order m have the published penalty, a control by shells (`pd.ShellControl`), the same with an
influence function by shells, and the same with an influence function that may be negative.

**transfer**: designed models on states and bodies that the design has not seen.

**methods**: error of the optimum found against wall time: optax's methods, L-BFGS, Nelder–Mead and a scan.

**time**: wall time of one design once its programs are compiled.
"""

import argparse
import json
import time

import jax
import jax.numpy as jnp
import numpy as np
import optax
from matplotlib.figure import Figure
from scipy.optimize import minimize
from stabiliser_fronts import LATTICES, LAW, Space, all_paths, designed, fronts, measures, transfer

import pdjax as pd
from pdjax.bench.harness import results, write
from pdjax.figures import SERIES

jax.config.update("jax_enable_x64", True)
NAME = "designed_stabilisers"
ORDERS = (-1.0, 0.0, 0.5, 1.0, 2.0)
LOADS = (-0.1, -0.05, -0.01, 0.01, 0.05, 0.1)
PARTS = ("penalty", "time", "methods", "fronts", "transfer")


def penalty(kept: dict, save) -> None:
    """The table of least penalties."""
    rows = kept.setdefault("penalty", [])
    done = {(r["dim"], r["m"], r["path"], r["a"]) for r in rows}
    for dim, N in LATTICES.items():
        family = pd.lattice_family(dim, N)
        for m in ORDERS:
            for path in all_paths(dim):
                for a in LOADS:
                    if (dim, m, path, a) in done:
                        continue
                    g = pd.least_penalty(
                        lambda g, m=m: pd.SethHill(m, LAW, pd.SillingControl(g)), family, pd.load_cases(path, [a])
                    )
                    rows.append({"dim": dim, "m": m, "path": path, "a": a, "g": g})
                save()
    kept["rule"] = rules(rows)
    costs = kept.setdefault("costs", [])
    if not costs:
        for dim, N in LATTICES.items():
            family = pd.lattice_family(dim, N)
            cases = pd.load_cases(all_paths(dim), [-0.05, 0.05])
            for name, of in (
                ("Silling", lambda g: pd.Correspondence(LAW, pd.SillingControl(g))),
                ("Seth–Hill 1", lambda g: pd.SethHill(1.0, LAW, pd.SillingControl(g))),
                ("Seth–Hill 0", lambda g: pd.SethHill(0.0, LAW, pd.SillingControl(g))),
            ):
                least = pd.least_penalty(of, family, cases)
                firm = pd.least_penalty(of, family, cases, margin=-0.01)
                for g in (0.0, least, firm, 0.02, 0.5, 100.0):
                    if np.isfinite(g):
                        row = {"dim": dim, "model": name, "g": float(g), "least": least, "for margin −0.01": firm}
                        costs.append(row | measures(of(g), family, cases))
                save()


def rules(rows: list[dict]) -> list[dict]:
    """For every dimension and order: the smallest c with g ≤ c |a| on all paths at ±1 %, and how well it does at ±10 %.

    `worst ratio` is the largest g/(c |a|) at ±5 and ±10 %. Above 1 the rule of thumb asks for too little.
    """
    found = []
    for dim in LATTICES:
        for m in ORDERS:
            for side in (-1, 1):
                mine = [r for r in rows if r["dim"] == dim and r["m"] == m and r["a"] * side > 0]
                small = max(r["g"] / abs(r["a"]) for r in mine if abs(r["a"]) == 0.01)
                finite = [r for r in mine if np.isfinite(r["g"])]
                ratios = [r["g"] / (small * abs(r["a"])) for r in finite if abs(r["a"]) > 0.01 and small > 0]
                found.append(
                    {
                        "dim": dim,
                        "m": m,
                        "side": "compression" if side < 0 else "tension",
                        "c": small,
                        "worst ratio": max(ratios, default=0.0),
                        "paths without a penalty": sorted({r["path"] for r in mine if not np.isfinite(r["g"])}),
                    }
                )
    return found


def _problem():
    """Two parameters, the penalty g and the order m, and the known optimum that the methods have to find."""
    family, cases = pd.lattice_family(2, 2), pd.load_cases("hydrostatic", [-0.05, 0.05])

    def build(p):
        return pd.SethHill(p[1], LAW, pd.SillingControl(p[0]))

    return family, cases, build


def methods(kept: dict, save) -> None:
    """The least penalty over all orders m: min g with the margin at ±5 % ≤ 0, by several methods."""
    family, cases, build = _problem()
    start, bounds = jnp.array([0.3, 0.2]), (jnp.array([0.0, -2.0]), jnp.array([2.0, 3.0]))

    def limit(model):
        return pd.worst_margin(model, family, cases)

    def search(optimiser, steps):
        return pd.design(build, start, lambda model: model.control.g, limit, optimiser, steps, bounds=bounds)

    search(None, 5)  # compiles
    rows = []
    best = search(None, 400)
    truth = min(
        (pd.least_penalty(lambda g, m=m: build((g, m)), family, cases), float(m)) for m in np.linspace(-1, 2, 61)
    )
    low, high = truth[1] - 0.05, truth[1] + 0.05
    for _ in range(30):  # golden section of the convex g(m)
        thirds = [low + (high - low) * t for t in (0.382, 0.618)]
        values = [pd.least_penalty(lambda g, m=m: build((g, m)), family, cases) for m in thirds]
        low, high = (low, thirds[1]) if values[0] < values[1] else (thirds[0], high)
    exact = min(values)
    for name, optimiser in (
        ("Adam, then L-BFGS (default)", None),
        ("Adam", optax.adam(0.02)),
        ("SGD with momentum", optax.sgd(0.02, 0.9)),
        ("AdaBelief", optax.adabelief(0.02)),
        ("RMSProp", optax.rmsprop(0.01)),
    ):
        for steps in (10, 30, 100, 300):
            begin = time.perf_counter()
            found = search(optimiser, steps)
            rows.append(
                _row(name, begin, float(found.objective) if found.feasible else np.inf, exact, found.evaluations)
            )
            print(rows[-1], flush=True)
    for most in (30, 100, 300):
        count = 0

        def merit(x):
            nonlocal count
            count += 1
            g, m = max(float(x[0]), 0.0), float(x[1])
            return g + 10 * max(0.0, float(limit(build((g, m)))))

        begin = time.perf_counter()
        done = minimize(
            merit, np.asarray(start), method="Nelder-Mead", options={"maxfev": most, "xatol": 1e-9, "fatol": 1e-12}
        )
        inside = float(limit(build((max(done.x[0], 0.0), done.x[1])))) <= 1e-6
        rows.append(_row("Nelder–Mead, exact penalty", begin, float(done.x[0]) if inside else np.inf, exact, count))
    for n in (5, 10, 20, 40):
        begin = time.perf_counter()
        feasible = [
            g for g in np.linspace(0.0, 0.2, n) for m in np.linspace(-1.0, 2.0, n) if float(limit(build((g, m)))) <= 0
        ]
        rows.append(_row(f"scan {n} × {n}", begin, min(feasible, default=np.inf), exact, n * n))
    kept["methods"] = {"exact g": exact, "exact m": (low + high) / 2, "default": best.objective, "rows": rows}
    save()


def _row(name, begin, value, exact, evaluations) -> dict:
    seconds = time.perf_counter() - begin
    return {"method": name, "seconds": seconds, "error": abs(value - exact), "evaluations": evaluations}


def timing(kept: dict, save) -> None:
    """Wall time of a design once compiled: the least penalty, and a control by shells, in 2D and 3D."""
    rows = {}
    for dim in (2, 3):
        family = pd.lattice_family(dim, LATTICES[dim])
        cases = pd.load_cases("hydrostatic", [-0.05, 0.05])
        space = Space(dim, False, None)
        for name, job in (
            (
                "least penalty by Newton",
                lambda: pd.least_penalty(lambda g: pd.SethHill(1.0, LAW, pd.SillingControl(g)), family, cases),  # noqa: B023
            ),
            (
                "least penalty by design",
                lambda: pd.design(
                    lambda g: pd.SethHill(1.0, LAW, pd.SillingControl(g)),
                    0.5,
                    lambda model: model.control.g,
                    lambda model: pd.worst_margin(model, family, cases),  # noqa: B023
                    bounds=(0.0, 2.0),
                ),
            ),
            ("control by shells", lambda: designed(space, -0.02, space.start, 80)),  # noqa: B023
        ):
            seconds = []
            for _ in range(2):
                begin = time.perf_counter()
                job()
                seconds.append(time.perf_counter() - begin)
            rows[f"{dim}D, {name}"] = {"first": seconds[0], "second": seconds[1]}
            print(dim, name, seconds, flush=True)
    kept["time"] = rows
    save()


def draw(kept: dict) -> Figure:
    """Least penalties by order m, fronts, and methods."""
    figure = Figure(figsize=(13, 4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    for i, m in enumerate(ORDERS):
        rows = [r for r in kept.get("penalty", []) if r["dim"] == 2 and r["m"] == m]
        worst = [max((r["g"] for r in rows if r["a"] == a), default=np.nan) for a in LOADS]
        left.plot([100 * a for a in LOADS], worst, "o-", color=SERIES[i], label=f"m = {m:g}", ms=4)
    left.set(xlabel="strain [%]", ylabel="least penalty g [-]", title="Seth–Hill, 2D, N = 3, worst load path")
    left.legend(frameon=False, fontsize=8)
    for i, (name, rows) in enumerate(
        (n, r) for n, r in kept.get("fronts", {}).items() if not n.startswith(("1D", "3D"))
    ):
        good = [r for r in rows if r["feasible"]]
        middle.plot(
            [100 * r["phase error"] for r in good],
            [r["margin"] for r in good],
            "o-",
            color=SERIES[i % 7],
            label=name,
            ms=4,
        )
    middle.set(xlabel="error of phase speeds at kh = 1 [%]", ylabel="margin over ±5 %, four paths [-]")
    middle.set_title("designed stabilisers, 2D, N = 3")
    middle.legend(frameon=False, fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    rows = kept.get("methods", {}).get("rows", [])
    names = list(
        dict.fromkeys(r["method"].split(" ")[0] if r["method"].startswith("scan") else r["method"] for r in rows)
    )
    for i, name in enumerate(names):
        mine = [r for r in rows if r["method"].startswith(name) and (name != "Adam" or r["method"] == "Adam")]
        mine = [r for r in mine if np.isfinite(r["error"])]
        right.plot(
            [r["seconds"] for r in mine],
            [max(r["error"], 1e-10) for r in mine],
            "osD^v*P"[i % 7] + "-",
            color=SERIES[i % 7],
            label=name,
            ms=4,
        )
    right.set(xlabel="wall time, compiled [s]", ylabel="error of the least g [-]", xscale="log", yscale="log")
    right.set_title("min g over m, 2D, N = 2, ±5 %")
    right.legend(frameon=False, fontsize=7)
    return figure


def main() -> None:
    """Compute the parts that are asked for and keep them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--part", choices=PARTS, nargs="*", default=list(PARTS))
    arguments = parser.parse_args()
    path = results() / f"{NAME}.json"
    kept = json.loads(path.read_text()) if path.exists() else {}

    def save() -> None:
        path.write_text(json.dumps(kept, indent=1) + "\n")

    run = {"penalty": penalty, "fronts": fronts, "transfer": transfer, "methods": methods, "time": timing}
    for part in arguments.part:
        run[part](kept, save)
    kept.pop("machine", None)
    write(NAME, kept, draw(kept))


if __name__ == "__main__":
    main()
