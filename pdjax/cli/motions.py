"""`pdjax run cuboid` and `pdjax run wave`: the scenes that move on the command line."""

import argparse
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Job = tuple[dict, Callable[[], str] | None]  # what was found; what writes the files and says which


def add_motions(scenes) -> None:
    """Add `cuboid` and `wave` to the scenes of `run`."""
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--N", type=float, default=3.0, help="horizon over spacing (default 3)")
    common.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    common.add_argument(
        "--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1; unused in 1D)"
    )
    common.add_argument(
        "--dt", type=float, help="time step (default 0.8 of the critical one, for a wave at most 1/300 period)"
    )
    common.add_argument("--animate", metavar="FILE", help="also a moving picture, FILE.gif (or .mp4 with ffmpeg)")
    common.add_argument("--vtk", metavar="NAME", help="also files for ParaView, NAME.vtu.series (needs meshio)")
    common.add_argument("--json", action="store_true", help="print one JSON object instead of text")

    job = scenes.add_parser("cuboid", parents=[common], help="a 3D body pulled or pushed by its ends, explicit in time")
    job.add_argument("--shape", type=int, nargs=3, default=[28, 7, 7], help="cells along x, y, z (default 28 7 7)")
    job.add_argument("--m", type=float, default=0.0, help="order of the Seth–Hill strain (default 0, the paper's)")
    job.add_argument("--model", default="seth-hill", help="seth-hill or correspondence (default seth-hill)")
    job.add_argument("--strain", type=float, nargs="+", default=[0.1, -0.1], help="of the ends (default 0.1 -0.1)")
    job.add_argument("--rate", type=float, default=0.005, help="strain rate, over the unit of time (default 0.005)")
    job.add_argument("--checkpoint", metavar="FILE", help="write and, where it exists, go on from FILE-STRAIN.npz")
    job.add_argument("--out", default="cuboid", help="name of the files without ending (default cuboid)")

    job = scenes.add_parser(
        "wave", parents=[common], help="a plane wave on a periodic lattice, and its frequency or growth"
    )
    job.add_argument("--dim", type=int, default=1, choices=(1, 2, 3), help="dimension (default 1)")
    job.add_argument("--n", type=int, default=40, help="points along each side (default 40)")
    job.add_argument("--j", type=int, nargs="+", default=[4], help="wave lengths along each side (default 4)")
    job.add_argument("--m", type=float, default=1.0, help="order of the Seth–Hill strain (default 1)")
    job.add_argument("--model", default="seth-hill", help="seth-hill or correspondence (default seth-hill)")
    job.add_argument("--a", type=float, default=0.0, help="hydrostatic strain below the wave (default 0)")
    job.add_argument("--u0", type=float, default=1e-6, help="amplitude over spacing (default 1e-6)")
    job.add_argument("--branch", type=int, default=-1, help="0 the slowest (or growing), −1 the fastest (default)")
    job.add_argument(
        "--periods",
        type=float,
        default=4.0,
        help="how long it runs (default 4 periods; a growing mode to 1 %% of the spacing)",
    )
    job.add_argument("--out", default="wave", help="name of the files without ending (default wave)")


def _model(arguments, dim: int):
    import pdjax as pd
    from pdjax._internal.checks import choice

    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu if dim > 1 else 0.0)  # type: ignore[call-arg, arg-type]
    choice("model", arguments.model, ("seth-hill", "correspondence"))
    return pd.SethHill(arguments.m, law) if arguments.model == "seth-hill" else pd.Correspondence(law)  # type: ignore


def _extras(arguments, name: str) -> dict[str, str]:
    """Pictures and files that were asked for beside the figure."""
    out = {}
    if arguments.animate:
        file = Path(arguments.animate)
        out["animation"] = str(file.with_name(f"{file.stem}{name}{file.suffix}"))
    if arguments.vtk:
        out["vtk"] = f"{arguments.vtk}{name}.vtu.series"
    return out


def _write_extras(extras: dict[str, str], scene, history) -> str:
    """Write them; which, in words."""
    import pdjax as pd
    from pdjax.files.vtk import write_vtk

    if "animation" in extras:
        pd.figures.animation(scene, history, extras["animation"], component=scene.body.dim - 1)
    if "vtk" in extras:
        write_vtk(scene, history, extras["vtk"].removesuffix(".vtu.series"))
    return "".join(f", {file}" for file in extras.values())


def _check_outputs(arguments) -> tuple[Path, Path]:
    """Every file that will be written, looked at before the run."""
    from pdjax._internal.checks import writable

    if arguments.animate and Path(arguments.animate).suffix not in (".gif", ".mp4"):
        raise ValueError(f"--animate takes a .gif or an .mp4; got {arguments.animate!r}")
    if arguments.animate and Path(arguments.animate).suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError("--animate to an .mp4 needs the program ffmpeg, which is not installed; name a .gif instead")
    for extra in (arguments.animate, arguments.vtk):
        if extra:
            writable(extra)
    if arguments.vtk:
        import importlib.util

        if importlib.util.find_spec("meshio") is None:
            raise ValueError("--vtk needs meshio: pip install meshio")
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    return picture, data


def write_picture(figure, picture: Path) -> None:
    """A PNG, whole or not there."""
    from pdjax._internal.checks import written_whole

    with written_whole(picture) as stream:
        figure.savefig(stream, format="png", dpi=150)


def write_out(draw: Callable[[], Any], picture: Path, arrays: dict[str, Any], data: Path) -> str:
    """The numbers, then the figure drawn of them, each whole or not there; what was written, in words."""
    from pdjax._internal.checks import written_whole

    with written_whole(data) as stream:
        np.savez(stream, **arrays)
    write_picture(draw(), picture)
    return f"wrote {data} and {picture}"


def roughness(u: np.ndarray, shape: tuple[int, ...], axis: int) -> np.ndarray:
    """How much a component alternates between neighbours (saves,) [length]: ¼ second differences, root mean square.

    The largest over the three directions; a smooth field's is of the order of h² u''/4.
    """
    field = u[..., axis].reshape(len(u), *shape)
    sizes = [np.diff(field, 2, axis=k + 1) / 4 for k in range(len(shape)) if shape[k] > 2]
    return np.max([np.sqrt(np.mean(d**2, axis=tuple(range(1, d.ndim)))) for d in sizes], axis=0)


def run_cuboid(arguments) -> Job:
    """Pull and push the cuboid; what was found, and what writes the files."""
    import pdjax as pd

    picture, data = _check_outputs(arguments)
    model = _model(arguments, 3)
    modulus = arguments.mu * (3 * arguments.lam + 2 * arguments.mu) / (arguments.lam + arguments.mu)
    runs: dict[str, dict[str, Any]] = {}
    rows: list[dict] = []
    arrays: dict[str, Any] = {}
    field: dict[str, Any] | None = None
    films: list[tuple] = []
    for strain in arguments.strain:
        motion = pd.scenes.cuboid(arguments.shape, arguments.N, strain, arguments.rate, model)
        scene = motion.scene
        shape = tuple(arguments.shape)
        h = 1.0 / shape[-1]
        watch = {"section": pd.observers.section_force(scene.body, 0.5 * h * shape[0])}
        keep = Path(f"{arguments.checkpoint}-{strain:g}.npz") if arguments.checkpoint else None
        history = pd.simulate(
            motion,
            dt=arguments.dt,
            observers=watch,
            checkpoint=keep,
            resume=keep is not None and keep.exists(),
            show_progress=not arguments.json,
        )
        area = h**2 * shape[1] * shape[2]
        reached = strain * np.minimum(history.times * arguments.rate / abs(strain), 1)
        force = history.observed["section"][:, 0] / (modulus * area)
        rough = {axis: roughness(np.asarray(history.u), shape, k) / h for k, axis in enumerate("xyz")}
        name = f"strain {strain:g}"
        runs[name] = {"strain": reached, "force": force}
        field = {"u": history.u[-1], "shape": shape, "spacing": h, "name": name}
        arrays |= {
            f"{name} strain": reached,
            f"{name} force": force,
            f"{name} u": history.u[-1],
            "X": scene.body.positions,
        }
        arrays |= {f"{name} roughness {axis}": values for axis, values in rough.items()}
        row = {
            "strain": strain,
            "finished": history.finished,
            "reason": history.reason,
            "steps": history.steps,
            "dt": float(history.dt),
            "energy_error": float(np.abs(history.energies.error).max()),
            "force": float(force[-1]),
            "roughness": {axis: float(values[-1]) for axis, values in rough.items()},
            **_extras(arguments, f"-{strain:g}"),
        }
        rows.append(row)
        if arguments.animate or arguments.vtk:
            films.append((_extras(arguments, f"-{strain:g}"), scene, history))
        if not arguments.json:
            print(f"{name}: {history}")
            print(f"  force through the middle {force[-1]:+.4f} E₀ A, where a classical bar has {reached[-1]:+.4f}")
            print("  alternation between neighbours / h: " + ", ".join(f"u_{a} {v[-1]:.1e}" for a, v in rough.items()))
    which = f"m = {arguments.m:g}" if arguments.model == "seth-hill" else "Silling's correspondence"
    title = f"cuboid of {' × '.join(map(str, arguments.shape))} points, N = {arguments.N:g}, {which}"

    def files() -> str:
        wrote = write_out(lambda: pd.figures.cuboid(runs, title, field), picture, arrays, data)
        return wrote + "".join(_write_extras(*film) for film in films)

    return {"figure": str(picture), "data": str(data), "cases": rows}, files


def run_wave(arguments) -> Job:
    """Run a wave, measure its frequency or growth, beside the symbol's; what was found, what writes the files."""
    import pdjax as pd

    picture, data = _check_outputs(arguments)
    dim, n = arguments.dim, arguments.n
    if len(arguments.j) > dim:
        raise ValueError(f"--j takes at most {dim} numbers in {dim}D; got {arguments.j}")
    model = _model(arguments, dim)
    k = 2 * np.pi * np.array([*arguments.j, *[0] * (dim - len(arguments.j))]) / n
    F = (1 + arguments.a) * np.eye(dim) if arguments.a else None
    how = {"F": F, "branch": arguments.branch, "periods": arguments.periods}
    motion = pd.scenes.wave(n, arguments.N, k, arguments.u0, model, dim, **how)
    fam = pd.lattice_family(dim, arguments.N)
    found = pd.dispersion(model, fam, np.eye(dim) if F is None else F, k[None])
    omega, growth = (float(x[0, arguments.branch]) for x in (found.frequency, found.growth))
    still = bool(found.zero_energy[0, arguments.branch])
    dt = arguments.dt
    if dt is None:  # 300 steps a period: Verlet's frequency is then right to 2e-5
        dt = min(0.8 * pd.critical_time_step(motion), 0.02 / (omega or growth or 1.0))
    history = pd.simulate(motion, dt=dt, show_progress=not arguments.json)
    size = np.asarray(pd.amplitude(history.u, motion.start))
    # a run that blew up has no rate of its own
    measured = pd.measured_rate(history.times, size) if history.finished and len(size) > 2 else pd.Rate(np.nan, np.nan)
    own = pd.verlet_rate(pd.Rate(growth, omega), history.dt)
    law = {"symbol": np.cosh(growth * history.times) if growth else np.cos(omega * history.times)}
    kind = "zero-energy mode" if still else "growing mode" if growth else "wave"
    waves = ", ".join(f"{x:.4g}" for x in k / np.pi)
    title = f"{kind} k = ({waves}) π/h, {dim}D, m = {arguments.m:g}, a = {arguments.a:g}, u₀ = {arguments.u0:g} h"
    arrays: dict[str, Any] = {
        "times": history.times,
        "amplitude": size,
        "u": history.u,
        "X": motion.scene.body.positions,
    }
    extras = _extras(arguments, "")
    out = {
        "k": k.tolist(),
        "kind": kind,
        "symbol": {"frequency": omega, "growth": growth},
        "measured": {"frequency": float(measured.frequency), "growth": float(measured.growth)},
        "verlet": {"frequency": float(own.frequency), "growth": float(own.growth)},
        "dt": float(history.dt),
        "steps": history.steps,
        "finished": history.finished,
        "reason": history.reason,
        "energy_error": float(np.abs(history.energies.error).max()),
        "figure": str(picture),
        "data": str(data),
        **extras,
    }
    if not arguments.json:
        print(f"{kind}, k = ({waves}) π/h")
        print(f"  symbol:   frequency {omega:.8g}, growth {growth:.8g}")
        if np.isfinite(measured.growth):
            print(f"  measured: frequency {measured.frequency:.8g}, growth {measured.growth:.8g}")
        if np.isfinite(own.frequency):
            exact = f"(exact for its step {history.dt:.4g})"
            print(f"  Verlet's: frequency {own.frequency:.8g}, growth {own.growth:.8g} {exact}")
        else:
            print(f"  Verlet's: none, its step {history.dt:.4g} is above the wave's own 2/ω = {2 / omega:.4g}")
        print(history)

    def files() -> str:
        wrote = write_out(lambda: pd.figures.motion(history, size, law, title, "[h √(ρ/E₀)]"), picture, arrays, data)
        return wrote + _write_extras(extras, motion.scene, history)

    return out, files
