"""What can be identified from the measurements of a body, how certainly, and in how many solves?

1. The modulus field E(x) of the singular bar from its displacements under a force, without noise: one modulus for each
   free point, for several models. The local formula E = σ/ε is the start of the search.
2. The same bar with 1 % noise and few parameters: how often does the truth lie within two stated standard deviations?
3. One modulus for each point with 1 % noise: what Tikhonov and total variation regularisation do to bias and scatter.
4. The order m and the penalty g of a homogeneous bar from the record of one sensor in one wave.
5. Forward and linearised solves beside those of finite differences, and the memory of the adjoint of a run.

"1 % noise" is Gaussian noise whose standard deviation is 1 % of the root mean square of the data.
"""

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES
from pdjax.optimise.parameters import Parameters
from pdjax.optimise.predict_motions import Dynamics, _run_back, _run_forward
from pdjax.optimise.predict_statics import Statics
from pdjax.optimise.predictions import rates

jax.config.update("jax_enable_x64", True)
QUICK = "--quick" in sys.argv
REPEATS, SCATTER = (10, 2) if QUICK else (100, 10)
STRESS, ALPHA, NOISE = 1e-3, 10.0, 0.01
LAW = pd.LinearElastic(1.0, 0.0)
MODELS = {
    "Seth–Hill, m = 1": pd.SethHill(1.0, LAW),
    "Silling": pd.Correspondence(LAW),
    "bond-based": pd.BondBased(1.0),
    "Seth–Hill, m = 1, penalty g = 0.01": pd.SethHill(1.0, LAW, pd.SillingControl(0.01)),
    "Seth–Hill, m = 1, penalty g = 1": pd.SethHill(1.0, LAW, pd.SillingControl(1.0)),
}
CASES = [(name, N) for name in MODELS for N in (2, 3)]


class Bar:
    """The singular bar, whose moduli are parameters. The points that are held have the known modulus 1."""

    def __init__(self, N: int, base: pd.AbstractModel, n: int = 40):
        self.bar = pd.scenes.singular_bar(n, N, STRESS, ALPHA)  # its supports and loads serve all models
        if isinstance(base, pd.BondBased):  # of modulus 1
            base = pd.BondBased(1 / pd.p_wave_modulus(base, pd.lattice_family(1, N, 1 / n)))
        self.x, self.base, self.n, self.layer = self.bar.body.positions[:, 0], base, n, 2 * N
        self.truth = np.log(np.asarray(self.bar.model.factor)[self.layer :])
        held, free = np.arange(self.layer), np.arange(self.layer, n)
        load = np.asarray(self.bar.load)
        self.ends = (pd.prescribe(held, np.asarray(self.bar.prescribed)[held]), pd.body_force(free, load[free]))

    def scene(self, log_moduli) -> pd.Scene:
        """The scene for the logarithms of the moduli of the free points."""
        E = jnp.concatenate([jnp.ones(self.layer), jnp.exp(log_moduli)])
        return pd.scene(self.bar.body, self.bar.families, pd.graded(self.base, E), *self.ends)

    def at_nodes(self, values) -> pd.Scene:
        """The scene for log E at NODES, linear between them."""
        return self.scene(jnp.interp(self.x[self.layer :], NODES, values))

    def data(self, scene) -> np.ndarray:
        """Displacements of the equilibrium, to rounding."""
        found = pd.solve(scene, stability=False, show_progress=False)
        return np.asarray(pd.solve(scene, start=found.u, tolerance=1e-12, stability=False, show_progress=False).u)

    def local(self, u) -> np.ndarray:
        """log E by the local formula E = σ/ε, with the mean strain ε of the family of each point."""
        reach = self.layer // 2
        ends = np.clip(np.arange(self.n) + reach, 0, self.n - 1), np.clip(np.arange(self.n) - reach, 0, self.n - 1)
        strain = (u[ends[0], 0] - u[ends[1], 0]) / (self.x[ends[0]] - self.x[ends[1]])
        return -np.log(np.clip(strain / STRESS, 0.5, 50.0))[self.layer :]


NODES = np.array([0.2, 0.5, 0.55, 0.7, 1.0])


def exact_fields() -> list[dict]:
    rows = []
    for name, N in CASES:
        bar = Bar(N, MODELS[name])
        u = bar.data(bar.scene(bar.truth))
        start = np.full(bar.truth.size, -1.0)
        begun = time.perf_counter()
        found = pd.identify(bar.scene, start, u, show_progress=False)
        rows.append(
            {
                "model": name,
                "N": N,
                "parameters": start.size,
                "worst error of the start": worst(start, bar.truth),
                "worst relative error": worst(found.parameters, bar.truth),
                "converged": found.converged,
                "iterations": len(found.history) - 1,
                "condition": float(found.singular_values[0] / found.singular_values[-1]),
                "forward": found.solves.forward,
                "tangent": found.solves.tangent,
                "finite differences": found.solves.finite_differences,
                "seconds": time.perf_counter() - begun,
                **continued(bar, start, u),
                "x": bar.x[bar.layer :].tolist(),
                "E": np.exp(bar.truth).tolist(),
                "E local": np.exp(bar.local(u)).tolist(),
                "E found": np.exp(np.asarray(found.parameters)).tolist(),
            }
        )
        print({k: v for k, v in rows[-1].items() if not isinstance(v, list)}, flush=True)
    return rows


def continued(bar: Bar, start: np.ndarray, u: np.ndarray) -> dict:
    """The same search after searches with a total variation whose weight falls from 1e-2 to 1e-14."""
    solves = 0
    for weight in 10.0 ** np.arange(-2, -15, -2):
        penalty = pd.total_variation(weight, 0.01)
        how: dict = {"max_solves": 60, "tolerance": 1e-8, "show_progress": False}
        found = pd.identify(bar.scene, start, u, regularisation=penalty, **how)
        start, solves = np.asarray(found.parameters), solves + found.solves.forward
    found = pd.identify(bar.scene, start, u, show_progress=False)
    return {
        "continuation: worst relative error": worst(found.parameters, bar.truth),
        "continuation: converged": found.converged,
        "continuation: forward": solves + found.solves.forward,
    }


def worst(log_moduli, truth) -> float:
    """Largest relative error of the moduli."""
    return float(np.abs(np.expm1(np.asarray(log_moduli) - truth)).max())


def by_finite_differences() -> dict:
    """The first case again, by the same method of SciPy with its one-sided finite differences."""
    from scipy.optimize import least_squares

    bar = Bar(3, MODELS["Seth–Hill, m = 1"])
    u = bar.data(bar.scene(bar.truth))
    solves, size = [0], np.sqrt(np.mean(u**2))

    def residual(values):
        solves[0] += 1
        return (np.asarray(pd.solve(bar.scene(values), stability=False).u) - u).ravel() / size

    begun = time.perf_counter()
    found = least_squares(residual, np.full(bar.truth.size, -1.0), ftol=1e-10, xtol=1e-10, gtol=None, max_nfev=100)
    return {
        "worst relative error": worst(found.x, bar.truth),
        "forward": solves[0],
        "iterations": int(found.njev) - 1,
        "seconds": time.perf_counter() - begun,
    }


def covered(scene_of, start, truth, data, **more) -> dict:
    """How often the truth lies within two standard deviations, with the noise given and with it estimated."""
    sigma, random = NOISE * np.sqrt(np.mean(data**2)), np.random.default_rng(1)
    inside, estimated, errors, stated, forward = 0, 0, [], [], []
    for _ in range(REPEATS):
        noisy = data + sigma * random.normal(size=data.shape)
        found = pd.identify(scene_of, start, noisy, noise=sigma, show_progress=False, **more)
        assert found.converged, found
        error = np.asarray(found.values) - truth
        spread = np.sqrt(np.diag(found.covariance))
        counted = np.isfinite(found.residual).sum()
        unknown = spread * found.misfit * np.sqrt(counted / (counted - truth.size))
        inside = inside + (np.abs(error) < 2 * spread)
        estimated = estimated + (np.abs(error) < 2 * unknown)
        errors.append(error)
        stated.append(spread)
        forward.append(found.solves.forward)
    return {
        "repeats": REPEATS,
        "parameters": list(found.names),
        "truth": truth.tolist(),
        "within 2 standard deviations": inside.tolist(),
        "the same, noise estimated": estimated.tolist(),
        "scatter": np.std(errors, axis=0).tolist(),
        "stated standard deviation": np.mean(stated, axis=0).tolist(),
        "mean error": np.mean(errors, axis=0).tolist(),
        "forward solves": float(np.mean(forward)),
    }


def coverage_of_the_bar() -> dict:
    bar = Bar(3, MODELS["Seth–Hill, m = 1"])
    truth = np.interp(NODES, bar.x[bar.layer :], bar.truth)
    data = bar.data(bar.at_nodes(truth))[bar.layer :]
    return covered(bar.at_nodes, np.full(NODES.size, -1.0), truth, data, measure=lambda s, u: u[bar.layer :])


def regularised() -> list[dict]:
    bar = Bar(3, MODELS["Seth–Hill, m = 1"])
    data = bar.data(bar.scene(bar.truth))
    sigma = NOISE * np.sqrt(np.mean(data**2))
    kinds = {
        "none": lambda w: None,
        "Tikhonov, slopes": lambda w: pd.tikhonov(w, difference=1),
        "total variation": lambda w: pd.total_variation(w, 0.01),
    }
    rows = []
    for kind, make in kinds.items():
        for weight in (0.1, 1.0, 3.0, 10.0, 30.0, 100.0) if kind != "none" else (0.0,):
            random, found, inside, ended = np.random.default_rng(2), [], [], []
            for _ in range(SCATTER):
                noisy = data + sigma * random.normal(size=data.shape)
                start = np.full(bar.truth.size, -1.0)
                one = pd.identify(
                    bar.scene,
                    start,
                    noisy,
                    noise=sigma,
                    regularisation=make(weight),
                    tolerance=1e-6,
                    max_solves=60,
                    show_progress=False,
                )
                found.append(np.asarray(one.parameters))
                inside.append(np.abs(found[-1] - bar.truth) < 2 * np.asarray(one.standard_deviation))
                ended.append(one.converged)
            error = np.array(found) - bar.truth
            rows.append(
                {
                    "kind": kind,
                    "weight": weight,
                    "repeats": SCATTER,
                    "converged": int(np.sum(ended)),
                    "error": float(np.sqrt(np.mean(error**2))),
                    "bias": float(np.sqrt(np.mean(error.mean(axis=0) ** 2))),
                    "scatter": float(np.sqrt(np.mean(error.var(axis=0)))),
                    "share within 2 standard deviations": float(np.mean(inside)),
                    "first": found[0].tolist(),
                }
            )
            print({k: v for k, v in rows[-1].items() if not isinstance(v, list)}, flush=True)
    return rows


RING = pd.lattice((24,), periodic=True)
RING_FAMILIES = pd.families(RING, 2.0)
STEPS = {"duration": 24.0, "dt": 0.2, "save_every": 3}


def wave(p) -> pd.Motion:
    """A standing wave of three wavelengths on a ring of 24 points. Its amplitude of 0.3 spacings is not small."""
    model = pd.SethHill(p["m"], LAW, pd.SillingControl(p["g"]))
    start = 0.3 * np.cos(2 * np.pi * 3 / 24 * RING.positions)
    return pd.motion(pd.scene(RING, RING_FAMILIES, model, moving=True), start=start)


def sensor(motion, history):
    """The displacement of the first point, on a crest."""
    return history.u[1:, 0, 0]


def wave_record() -> dict:
    truth = {"g": 0.4, "m": 0.7}
    record = np.asarray(pd.simulate(wave(truth), **STEPS, show_progress=False).u)[1:, 0, 0]
    how: dict = {"measure": sensor, **STEPS}
    found = pd.identify(wave, {"g": 0.6, "m": 1.0}, record, show_progress=False, **how)
    starts = []
    for m in (-1.0, 0.0, 0.7, 1.5, 2.5):
        for g in (0.05, 0.2, 0.4, 0.8, 1.6):
            one = pd.identify(wave, {"g": g, "m": m}, record, show_progress=False, **how)
            reached = float(np.abs(np.asarray(one.values) - [0.4, 0.7]).max()) < 1e-6
            starts.append(
                {"m": m, "g": g, "reaches the truth": reached, "misfit": one.misfit, "end": one.values.tolist()}
            )
    return {
        "record": record.tolist(),
        "worst error": float(np.abs(np.asarray(found.values) - [0.4, 0.7]).max()),
        "iterations": len(found.history) - 1,
        "solves": found.solves._asdict(),
        "starts": starts,
        "with noise": covered(wave, {"g": 0.6, "m": 1.0}, np.array([0.4, 0.7]), record, **how),
    }


def memory() -> list[dict]:
    """Temporary bytes of the programs of a run with a Jacobian, as the compiler counts them."""
    parameters, rows = Parameters({"g": 0.4, "m": 0.7}), []
    for steps in (64, 256, 1024, 4096):
        run = {"duration": 0.05 * steps, "dt": 0.05, "save_every": steps}
        made = Dynamics(wave, parameters, wave({"g": 0.4, "m": 0.7}), lambda m, h: h.u[-1, 0], **run)
        made.motion = made.build(parameters.flat)
        found = rates(made.build, parameters.flat)
        arguments = made.motion, made.measure, made.run
        back = _run_back.lower(*arguments, np.arange(1), found.where, found.rates)
        forward = _run_forward.lower(*arguments, found.where, found.rates)
        sizes = [x.compile().compiled.memory_analysis().temp_size_in_bytes for x in (forward, back)]
        rows.append({"steps": steps, "tangent bytes": sizes[0], "adjoint bytes": sizes[1]})
        print(rows[-1], flush=True)
    return rows


def times() -> dict:
    """Time of a forward solve, and of one linearised solve, in dynamics (a ring of 16 moduli) and statics (a plate)."""
    ring = pd.lattice((2000,), periodic=True)
    families, start = pd.families(ring, 3.0), 0.3 * np.cos(2 * np.pi * 50 / 2000 * ring.positions)

    def sixteenths(p):
        model = pd.graded(pd.SethHill(0.7, LAW, pd.SillingControl(0.4)), p[np.arange(2000) // 125])
        return pd.motion(pd.scene(ring, families, model, moving=True), start=start)

    field = Parameters(np.ones(16))
    first = sixteenths(field.tree(field.flat))
    made = Dynamics(sixteenths, field, first, lambda m, h: h.u[1:, 5, 0], duration=40.0, dt=0.2, save_every=10)
    out = {"a run of 200 steps": best(lambda: made.predict(field.flat))}
    for name, adjoint in (("a tangent run, of 16", False), ("an adjoint run, of 16", True)):
        out[name] = best(lambda adjoint=adjoint: made.jacobian(field.flat, np.arange(16), adjoint)) / 16
    plate = pd.lattice((24, 16))
    families, left = pd.families(plate, 3.01), plate.positions[:, 0] < 6
    across = np.minimum(plate.positions[:, 0] // 6, 3).astype(int) * 4 + (plate.positions[:, 1] // 4).astype(int)

    def blocks(p):
        model = pd.graded(pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0)), p[across])
        return pd.scene(plate, families, model, pd.prescribe(left), pd.body_force(~left, [1e-3, 0.0]))

    still = Statics(blocks, field, blocks(field.tree(field.flat)), None)
    turn = [0]

    def again():
        turn[0] += 1
        still.predict(field.flat * (1 + 1e-3 * turn[0]))

    out["an equilibrium"] = best(again)
    out["a tangent solve, of 16"] = best(lambda: still.jacobian(field.flat, np.arange(768), False)) / 16
    out["an adjoint solve, of 16"] = best(lambda: still.jacobian(field.flat, np.arange(16), True)) / 16
    return out


def best(work, repeats: int = 5) -> float:
    """The fastest of several calls [s], after one that compiles."""
    work()
    spent = []
    for _ in range(repeats):
        begun = time.perf_counter()
        jax.block_until_ready(work())
        spent.append(time.perf_counter() - begun)
    return min(spent)


def draw(numbers: dict) -> Figure:
    """Draw the fields, the coverage, the regularisation, and the searches for (m, g)."""
    figure = Figure(figsize=(11.0, 7.6), layout="constrained")
    (field, cover), (weights, orders) = figure.subplots(2, 2)
    row = numbers["fields, no noise"][1]
    field.semilogy(row["x"], row["E"], color="black", lw=1.2, label="truth")
    field.semilogy(row["x"], row["E local"], "x", ms=5, color=SERIES[1], label="local formula σ/ε")
    label = f"identified: worst error {row['worst relative error']:.0e}".replace("-", "−")
    field.semilogy(row["x"], row["E found"], "o", ms=4.5, mfc="none", color=SERIES[0], label=label)
    field.set_xlabel("x / L  [–]")
    field.set_ylabel("modulus E / E₀  [–]")
    field.set_title(f"Singular bar, no noise: {row['parameters']} moduli, {row['model']}, N = {row['N']}", fontsize=9)
    field.legend(frameon=False, fontsize=8)

    bar, ring = numbers["coverage of the bar"], numbers["(m, g) from a wave record"]["with noise"]
    names = [f"log E({x:g} L)" for x in NODES] + ring["parameters"]
    y = np.arange(len(names))[::-1]
    share = 100 / bar["repeats"]
    cover.axvspan(88, 99, color="0.9", label="accepted: 88 to 99")
    for key, mark, shift, colour in (
        ("within 2 standard deviations", "o", 0.12, SERIES[0]),
        ("the same, noise estimated", "s", -0.12, SERIES[1]),
    ):
        label = "noise given" if mark == "o" else "noise estimated from the residuals"
        cover.plot(share * np.array(bar[key] + ring[key]), y + shift, mark, ms=5, color=colour, label=label)
    cover.set_yticks(y, names)
    cover.set_xlim(80, 100.5)
    cover.set_ylim(-2.2, len(names) - 0.5)
    cover.set_xlabel(f"repetitions with the truth within ±2 σ  [% of {bar['repeats']}]")
    cover.set_title("1 % noise, few parameters: is the stated uncertainty right?", fontsize=9)
    cover.legend(frameon=False, fontsize=8, loc="lower left")

    for kind, colour in (("Tikhonov, slopes", SERIES[1]), ("total variation", SERIES[0])):
        rows = [r for r in numbers["regularisation"] if r["kind"] == kind]
        w = [r["weight"] for r in rows]
        weights.loglog(w, [r["error"] for r in rows], "o-", ms=4, color=colour, label=f"{kind}: error")
        weights.loglog(w, [r["bias"] for r in rows], "--", color=colour, label="bias")
        weights.loglog(w, [r["scatter"] for r in rows], ":", color=colour, label="scatter")
    none = next(r for r in numbers["regularisation"] if r["kind"] == "none")
    weights.axhline(none["error"], color="black", lw=0.9, label="no regularisation: error")
    weights.set_xlabel("weight of the regularisation  [–]")
    weights.set_ylabel("root mean square in log E  [–]")
    weights.set_title("1 % noise, one modulus for each point", fontsize=9)
    weights.set_ylim(0.025, 4)
    weights.legend(frameon=False, fontsize=8, ncols=2)

    for start in numbers["(m, g) from a wave record"]["starts"]:
        good = start["reaches the truth"]
        orders.semilogy(start["m"], start["g"], "o" if good else "x", ms=6, color=SERIES[0] if good else SERIES[1])
    orders.semilogy([], [], "o", color=SERIES[0], label="the search from here reaches the truth")
    orders.semilogy([], [], "x", color=SERIES[1], label="it does not")
    orders.semilogy(0.7, 0.4, "*", ms=13, mfc="none", color="black", label="truth")
    orders.set_xlabel("order m at the start  [–]")
    orders.set_ylabel("penalty g at the start  [–]")
    orders.set_title("(m, g) from one sensor's record of a wave, no noise", fontsize=9)
    orders.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)
    return figure


def main() -> None:
    numbers: dict = {"fields, no noise": exact_fields(), "by finite differences": by_finite_differences()}
    print(numbers["by finite differences"], flush=True)
    numbers["coverage of the bar"] = coverage_of_the_bar()
    print(numbers["coverage of the bar"], flush=True)
    numbers["regularisation"] = regularised()
    numbers["(m, g) from a wave record"] = wave_record()
    numbers["memory of a run with its Jacobian"] = memory()
    numbers["seconds"] = times()
    write("inverse-quick" if QUICK else "inverse", numbers, draw(numbers))


if __name__ == "__main__":
    main()
