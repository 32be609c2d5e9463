"""`pdjax symbol`: verdict and spectrum of one homogeneous state."""

import argparse
import itertools

import numpy as np

from .._internal.checks import writable
from .._internal.pictures import write_picture
from .common import Formatter, Job, Jobs, lattice_arguments, setting

_CORNERS: dict[int, list[tuple[str, tuple[int, ...]]]] = {
    1: [("Γ", (0,)), ("X", (1,))],
    2: [("Γ", (0, 0)), ("X", (1, 0)), ("M", (1, 1)), ("Γ", (0, 0))],
    3: [("Γ", (0, 0, 0)), ("X", (1, 0, 0)), ("M", (1, 1, 0)), ("R", (1, 1, 1)), ("Γ", (0, 0, 0))],
}


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "symbol",
        parents=[lattice_arguments()],
        formatter_class=formatter,
        help="one state: verdict, most unstable wave, spectrum along the edges of the Brillouin zone",
        description="Judge the stability of one homogeneous state of the Seth–Hill model and draw the spectrum of its"
        "\nsymbol. The symbol gives the frequency or the growth rate of every plane wave on the infinite lattice.",
    )
    job.add_argument("--m", type=float, default=1.0, help="order of the Seth–Hill strain (default 1)")
    job.add_argument("--a", type=float, default=-0.01, help="load a [-], negative in compression (default -0.01)")
    job.add_argument("--out", help="PNG file for a figure of the spectrum (default: no figure)")


def run(arguments: argparse.Namespace) -> Job:
    """Judge the state and print the result. Draw the spectrum if a file is named."""
    import jax.numpy as jnp

    import pdjax as pd

    law, path, influence = setting(arguments)
    picture = writable(arguments.out) if arguments.out else None
    family = pd.lattice_family(arguments.dim, arguments.N, influence=influence)
    model = pd.SethHill(arguments.m, law)
    pd.force_state(model, family, np.eye(arguments.dim))  # checks the family before the path uses it
    F = path(arguments.a, model, family)
    result = pd.stability(model, family, F, "symbol", arguments.resolution)
    corners = np.array([corner for _, corner in _CORNERS[arguments.dim]]) * np.pi
    steps = [np.linspace(p, q, 80, endpoint=False) for p, q in itertools.pairwise(corners)]
    waves = np.concatenate([*steps, corners[-1:]])
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(waves, axis=0), axis=1))])
    unit = float(pd.p_wave_modulus(model, family))
    values = np.asarray(jnp.linalg.eigvalsh(pd.symbol(model, family, F, waves)) / unit)
    out = {
        "verdict": result.verdict,
        "margin": float(result.margin),
        "tolerance": float(result.tolerance),
        "eigenvalue": float(result.eigenvalue),
        "wave_vector": np.asarray(result.wave_vector).tolist(),
        "mode": np.asarray(result.mode).tolist(),
        "resolution": result.resolution,
        "F": np.asarray(F).tolist(),
    }
    if picture is not None:
        out["figure"] = str(picture)
    if not arguments.json:
        k = ", ".join(f"{x:.4f}" for x in np.asarray(result.wave_vector) / np.pi)
        mode = ", ".join(f"{x:.4f}" for x in np.asarray(result.mode))
        print(f"{result.verdict}: margin {out['margin']:+.6e} (zero within {out['tolerance']:.0e})")
        print(f"wave vector ({k}) π/h, mode ({mode})")
        print(f"eigenvalue λ {out['eigenvalue']:+.6e} (for h = 1, unit of lam), λ h²/M {out['eigenvalue'] / unit:+.6e}")
        print(f"P-wave modulus M = λ + 2μ of the undeformed lattice: {unit:g}")
        print(f"search grid: {result.resolution} intervals from 0 to π/h")

    def files() -> str:
        assert picture is not None
        title = f"m = {arguments.m:g}, {arguments.path} a = {arguments.a:g}, {arguments.dim}D, N = {arguments.N:g}: "
        ticks = arc[np.minimum(80 * np.arange(len(corners)), len(arc) - 1)]
        names = [name for name, _ in _CORNERS[arguments.dim]]
        line = "the edges of the Brillouin zone"
        figure = pd.figures.dispersion(arc, values, ticks, names, f"{title}{result.verdict}", line)
        write_picture(figure, picture)
        return f"wrote {picture}"

    return out, None if picture is None else files
