"""The cuboid in tension and compression, in more cases than the paper's figure (`pdjax paper --figure cuboid`).

The runs add Silling's correspondence model, other strain rates and other orders m. The growth rates of the body's own
Jacobian, in the homogeneous state of uniaxial stress, are compared with the growth rates of the symbol.
"""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse.linalg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import pdjax as pd
from pdjax.bench.harness import write
from pdjax.figures import SERIES
from pdjax.finite_body.factorisation import matrix
from pdjax.scenes.alternation import roughness
from pdjax.studies.paper.cuboid import LAW, ONSET, START, STRAINS, growth, predicted, pull

jax.config.update("jax_enable_x64", True)
FAMILY = pd.lattice_family(3, 3)
BEAR = (0.75, 1.0, 1.5, 2.0)  # orders whose critical tension is found
ALTERNATES = 0.25  # smallest alternation / size of an alternating mode; measured: above 0.5 or below 0.06


def growth_of_body(model, sign: float, shape) -> tuple[np.ndarray, np.ndarray]:
    """Growth rates γ of the body's Jacobian, with held ends, in the homogeneous state of uniaxial stress.

    Two rates are returned at each strain: of the modes that alternate between neighbours, and of the smooth modes
    (buckling as a column, spin about x). `roughness` measures the alternating modes only, so the two are kept apart.
    """
    motion = pd.scenes.cuboid(shape, 3, sign * 0.1, 0.005, model)
    body = motion.scene.body
    centre = body.positions - body.positions.mean(axis=0)
    rates = []
    for strain in sign * STRAINS:
        F = np.asarray(pd.uniaxial_stress(strain, model, FAMILY))
        u = jnp.asarray(centre @ (F - np.eye(3)).T)
        A = matrix(motion.scene, u, float(abs(strain) / 0.1)) / float(body.volumes[0])
        values, modes = scipy.sparse.linalg.eigsh(A, k=4, which="LA", tol=1e-4)
        fields = np.zeros((4, len(body) * 3))
        fields[:, np.asarray(motion.scene.unknowns)] = modes.T
        fields = fields.reshape(4, len(body), 3)
        size = np.sqrt(np.mean(np.sum(fields**2, axis=2), axis=1))
        rough = np.max([roughness(fields, shape, k) for k in range(3)], axis=0) / size > ALTERNATES
        grows = values > 1e-8 * float(pd.p_wave_modulus(model, FAMILY)) * shape[-1] ** 2
        if grows.all() and not rough.any():
            raise RuntimeError(f"all computed modes at {strain:+g} grow and are smooth: increase k of eigsh")
        rates.append([np.sqrt(np.max(values, where=grows & which, initial=0.0)) for which in (rough, ~rough)])
        print(f"body at {strain:+g}: {values}, alternating {rough}", flush=True)
    alternating, smooth = np.array(rates).T
    return alternating, smooth


def take_off(run: dict, rates: np.ndarray, rate: float) -> dict | None:
    """Measured growth rate of the alternation between ONSET/3 and 3 ONSET, and the symbol's mean rate meanwhile."""
    worst = np.max(list(run["alternation over h"].values()), axis=0)
    over = np.flatnonzero(worst > 3 * ONSET)
    if len(over) == 0:
        return None
    last = int(over[0])
    first = int(np.flatnonzero(worst[:last] < ONSET / 3)[-1])
    time = np.abs(run["strain"]) / rate
    gamma = np.interp(np.abs(run["strain"][first : last + 1]), np.r_[0.0, STRAINS], np.r_[0.0, rates])
    return {
        "from": run["strain"][first],
        "to": run["strain"][last],
        "seen": float(np.log(worst[last] / worst[first]) / (time[last] - time[first])),
        "symbol": float(gamma.mean()),
    }


def main() -> None:
    shape, rate = (28, 7, 7), 0.005
    side = shape[-1]  # the symbol's rates assume h = 1, but here the side is 1 and h = 1/side
    models = {"m = 0": pd.SethHill(0.0, LAW), "m = 1": pd.SethHill(1.0, LAW), "Silling": pd.Correspondence(LAW)}
    runs, gammas, own, smooth = {}, {}, {}, {}
    for name, model in models.items():
        for sign in (1.0, -1.0):
            key = f"{name}, {'tension' if sign > 0 else 'compression'}"
            runs[key] = pull(model, sign * 0.1, rate, shape)
            gammas[key] = side * growth(model, sign)
            own[key], smooth[key] = growth_of_body(model, sign, shape)
    halved = {
        side_name: pull(models["m = 0"], sign * 0.1, rate, shape, halved=True)
        for side_name, sign in (("tension", 1.0), ("compression", -1.0))
    }
    slower = {}
    for other in (0.02, 0.01, 0.0025):
        run = pull(models["m = 0"], -0.1, other, shape)
        key = "m = 0, compression"
        slower[other] = {
            "seen": run["onset"],
            "symbol": predicted(run, gammas[key], other)[1],
            "body": predicted(run, own[key], other)[1],
        }
    orders = np.linspace(-2, 2, 17)
    least = [
        (float(m), *(float(growth(pd.SethHill(float(m), LAW), s, (0.04,))[0]) for s in (1.0, -1.0))) for m in orders
    ]

    loads = {m: float(pd.critical_load(pd.SethHill(m, LAW), FAMILY, pd.uniaxial_stress, side="positive")) for m in BEAR}

    figure = Figure(figsize=(11.4, 7.8), layout="constrained")
    grid = figure.add_gridspec(6, 3)
    axes = np.array([[figure.add_subplot(grid[3 * row : 3 * row + 3, k]) for k in range(2)] for row in range(2)])
    pictures = [figure.add_subplot(grid[2 * k : 2 * k + 2, 2]) for k in range(3)]
    shades = dict(zip(models, SERIES, strict=False))
    table = {}
    for key, run in runs.items():
        name, where = key.split(", ")
        row = 0 if where == "tension" else 1
        strain = 100 * np.array(run["strain"])
        axes[row, 0].plot(strain, run["force over E0 A"], color=shades[name], linewidth=1.2, label=name)
        worst = np.max(list(run["alternation over h"].values()), axis=0)
        axes[row, 1].semilogy(strain[1:], worst[1:], color=shades[name], linewidth=1.4)
        curve, by_symbol = predicted(run, gammas[key], rate)
        again, by_body = predicted(run, own[key], rate)
        axes[row, 1].semilogy(strain[1:], curve[1:], "--", color=shades[name], linewidth=0.9)
        axes[row, 1].semilogy(strain[1:], again[1:], ":", color=shades[name], linewidth=1.2)
        table[key] = {
            "onset seen": run["onset"],
            "onset by the symbol": by_symbol,
            "onset by the body's Jacobian": by_body,
            "growth rate of the take-off": take_off(run, gammas[key], rate),
            "symbol's growth rates": dict(zip((100 * STRAINS).round(3).tolist(), gammas[key].tolist(), strict=True)),
            "body's growth rates": dict(zip((100 * STRAINS).round(3).tolist(), own[key].tolist(), strict=True)),
            "its smooth modes' growth rates": dict(
                zip((100 * STRAINS).round(3).tolist(), smooth[key].tolist(), strict=True)
            ),
            "their growth over the run, exponent": float(
                np.trapezoid(np.r_[0.0, smooth[key]], np.r_[0.0, STRAINS]) / rate
            ),
            "finished": run["finished"],
            "energy error": run["energy error"],
            "steps": run["steps"],
        }
    for where, run in halved.items():
        row = 0 if where == "tension" else 1
        strain = 100 * np.array(run["strain"])
        every = slice(None, None, 6)
        force = np.array(run["force over E0 A"])
        ring = {"mfc": "none", "mec": "#000000", "ms": 4.5, "mew": 0.8, "zorder": 5}
        axes[row, 0].plot(strain[every], force[every], "o", label="m = 0, half the step", **ring)
        table[f"m = 0, {where}, half the step"] = {"onset seen": run["onset"], "steps": run["steps"]}
    for row, where in enumerate(("tension", "compression")):
        axes[row, 0].set_title(f"{where}: force", fontsize=10)
        axes[row, 0].set_ylabel("force / (E₀ A)  [–]")
        axes[row, 1].set_title(f"{where}: alternation", fontsize=10)
        axes[row, 1].axhline(ONSET, color="#888888", linewidth=0.7)
        axes[row, 1].set_ylim(1e-7, 3)
        axes[row, 1].set_ylabel("alternation / h  [–]")
        for on in axes[row, :2]:
            on.set_xlabel("strain of the ends  [%]")
    u = runs["m = 0, compression"]["_u"].reshape(*shape, 3) * side
    mirror = float(np.abs(u[..., 1] - np.swapaxes(u[..., 2], 1, 2)).max())
    for on, k, across, cut in zip(pictures, range(3), "yyz", "zzy", strict=True):
        plane = (u[:, :, shape[2] // 2, k] if cut == "z" else u[:, shape[1] // 2, :, k]).T
        limit = np.abs(plane).max()
        image = on.imshow(plane, origin="lower", cmap="RdBu_r", vmin=-limit, vmax=limit, extent=(0, 4, 0, 1))
        on.set_title(f"m = 0 at −10 %: u_{'xyz'[k]} / h, plane {cut} = ½", fontsize=9)
        on.set_xlabel("x / side  [–]")
        on.set_ylabel(f"{across} / side  [–]")
        figure.colorbar(image, ax=on, shrink=0.8)
    handles, words = axes[0, 0].get_legend_handles_labels()
    for style, word in (("-", "measured"), ("--", "predicted by the symbol"), (":", "by the body's alternating modes")):
        handles.append(Line2D([], [], color="#555555", linestyle=style, linewidth=1.2))
        words.append(word)
    figure.legend(handles, words, loc="outside lower center", ncols=7, fontsize=8.5, frameon=False)
    points = " × ".join(map(str, shape))
    figure.suptitle(f"Cuboid of {points} points, N = 3, λ = μ = ρ = 1, strain rate {rate:g}", fontsize=11)
    for run in [*runs.values(), *halved.values()]:
        run.pop("_u")
    write(
        "cuboid",
        {
            "shape": shape,
            "rate": rate,
            "onset is alternation / h above": ONSET,
            "prediction starts at strain": START,
            "onsets": table,
            "onset of m = 0 in compression at other rates": slower,
            "critical tension of the symbol in uniaxial stress over the order": {
                str(m): a if np.isfinite(a) else "none to +100 %" for m, a in loads.items()
            },
            "m = 0 at -10 %: largest difference of u_y and mirrored u_z, over h": mirror,
            "growth rate of the symbol at 4 % over the order: (m, tension, compression), h = c = 1": least,
        },
        figure,
    )


if __name__ == "__main__":
    main()
