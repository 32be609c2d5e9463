"""The command line: `pdjax map`, `critical`, `symbol`, `atlas`, `bench`, `run SCENE`, `paper` (or `python -m pdjax`).

Thin: it reads arguments, asks the package, prints and draws. Numbers are float64, for their signs are the product.
"""

import argparse
import itertools
import json
import math
import sys
import time
import warnings

import numpy as np

from ._internal.compilation_cache import use_compilation_cache
from .cli.atlas import add_atlas, run_atlas
from .cli.bench import add_bench, run_bench
from .cli.motions import Job
from .cli.paper import add_paper, run_paper
from .cli.run import add_run, run

_EPILOG = """examples
  pdjax map                                     the default map: 2D, N = 3, orders m in [-2, 2], |a| up to 30 %
  pdjax map --dim 3 --path uniaxial-stress      another dimension and load path
  pdjax map --m=-1:2:61 --a=-0.1:0.1:81         finer near the origin (lo:hi:count; write = before a minus sign)
  pdjax critical --m 0 1 2                      critical loads of three orders, every criterion, both sides
  pdjax symbol --m 0 --a=-0.02                  one state: its verdict, the wave that decides, its spectrum
  pdjax atlas --dim 2 3                         every model, every path: critical strains, zero-energy waves, cost
  pdjax bench --quick                           error against time of every choice, small sizes
  pdjax run singular-bar                        the paper's singular bar, tension and compression, both models
  pdjax run step-bar --strain=-0.001            the paper's step-size bar at one strain
  pdjax run cuboid --m 0                        the paper's cuboid, pulled and pushed, explicit in time
  pdjax run wave --a=-0.01 --j 20               the wave at the zone's edge of a compressed bar, which grows
  pdjax paper --quick                           every figure and claim of the paper, tried; reduced sizes
"""


_FIRST = 1024  # states that a first picture of a map needs


def _range(text: str) -> np.ndarray:
    """lo:hi:count → an even grid."""
    try:
        low, high, count = text.split(":")
        values = np.linspace(float(low), float(high), int(count))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected lo:hi:count such as -2:2:200, got {text!r}") from None
    if len(values) == 0:
        raise argparse.ArgumentTypeError(f"count must be at least 1, got {text!r}")
    return values


class _Parser(argparse.ArgumentParser):
    """Says how a value that starts with a minus sign is written."""

    def error(self, message: str):
        """Print the usage and the message, and leave with status 2."""
        hint = "" if "expected one argument" not in message else " (before a minus sign write =, as in --a=-0.1:0.1:81)"
        super().error(message + hint)


def _parser() -> argparse.ArgumentParser:
    formatter = argparse.RawDescriptionHelpFormatter
    parser = _Parser(
        prog="pdjax",
        description="Exact stability of peridynamic material models on infinite lattices.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    common = _Parser(add_help=False)
    common.add_argument("--dim", type=int, default=2, choices=(1, 2, 3), help="dimension (default 2)")
    common.add_argument("--N", type=float, default=3.0, help="horizon over lattice spacing (default 3)")
    common.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    common.add_argument("--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1)")
    common.add_argument(
        "--influence",
        default="constant",
        choices=("constant", "inverse_distance", "linear", "cubic_spline", "gaussian"),
        help="influence function of the bonds (default constant)",
    )
    common.add_argument(
        "--path",
        default="hydrostatic",
        choices=("hydrostatic", "uniaxial-strain", "uniaxial-stress", "simple-shear"),
        help="load path F(a) (default hydrostatic)",
    )
    common.add_argument("--resolution", type=int, help="grid intervals over half the Brillouin zone (default 8 N)")
    common.add_argument("--json", action="store_true", help="print one JSON object instead of text")

    jobs = parser.add_subparsers(dest="job", required=True, metavar="job")
    job = jobs.add_parser(
        "map",
        parents=[common],
        formatter_class=formatter,
        help="regions of stability over order m and load a: PNG, npz, table of critical loads",
        description="Draw where the Seth–Hill model of order m is stable under the load a: exactly, by the symbol,"
        "\nwith the lines of the cheaper criteria. Writes OUT.png and OUT.npz and prints critical loads.",
    )
    job.add_argument(
        "--m",
        type=_range,
        default="-2:2:200",
        help="orders lo:hi:count, = before a minus sign (default --m=-2:2:200)",
    )
    job.add_argument("--a", type=_range, default="-0.3:0.3:200", help="loads lo:hi:count (default -0.3:0.3:200)")
    job.add_argument("--out", default="pdjax-map", help="name of the files without ending (default pdjax-map)")

    job = jobs.add_parser(
        "critical",
        parents=[common],
        formatter_class=formatter,
        help="critical loads by every criterion",
        description="The load at which each criterion first fails, on both sides of the path: 0 means at once,"
        "\nnone that it does not within -90 % to +100 %.",
    )
    job.add_argument("--m", type=float, nargs="+", default=[0.0, 1.0], help="orders (default 0 1)")
    job.add_argument("--criterion", nargs="+", help="criteria (default: symbol and the cheap ones)")

    job = jobs.add_parser(
        "symbol",
        parents=[common],
        formatter_class=formatter,
        help="one state: verdict, deciding wave, spectrum along the zone's edges",
        description="The exact verdict on one homogeneous state, and the spectrum of its symbol.",
    )
    job.add_argument("--m", type=float, default=1.0, help="order of the Seth–Hill strain (default 1)")
    job.add_argument("--a", type=float, default=-0.01, help="load (default -0.01)")
    job.add_argument("--out", help="also draw the spectrum along the edges of the Brillouin zone to this PNG")

    add_atlas(jobs, formatter)
    add_bench(jobs, formatter)
    add_run(jobs, formatter)
    add_paper(jobs, formatter)
    return parser


def _setting(arguments):
    import pdjax as pd

    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu)  # type: ignore[call-arg]
    influence = getattr(pd, f"{arguments.influence}_influence")
    return law, pd.PATHS[arguments.path], influence


def _number(x: float) -> str:
    return f"{x:+.4f}" if math.isfinite(x) and x != 0 else {0.0: "0"}.get(x, "none" if math.isinf(x) else "undefined")


def _table(rows: list[dict]) -> str:
    """Critical loads: a line for each order, two columns for each criterion."""
    criteria = list(dict.fromkeys(row["criterion"] for row in rows))
    orders = list(dict.fromkeys(row["m"] for row in rows))
    at = {(r["m"], r["criterion"], r["side"]): _number(r["a_cr"]) for r in rows}
    lines = [
        "     m" + "".join(f"{c:>24}" for c in criteria),
        "      " + f"{'compression':>14}{'tension':>10}" * len(criteria),
    ]
    for m in orders:
        cells = (f"{at[m, c, 'negative']:>14}{at[m, c, 'positive']:>10}" for c in criteria)
        lines.append(f"{m:>6g}" + "".join(cells))
    return "\n".join(lines)


def _critical_rows(orders, names, law, path, influence, arguments) -> list[dict]:
    import pdjax as pd

    fam = pd.lattice_family(arguments.dim, arguments.N, influence=influence)
    return [
        {
            "m": float(m),
            "criterion": name,
            "side": side,
            "a_cr": float(
                pd.critical_load(pd.SethHill(m, law), fam, path, name, side, resolution=arguments.resolution)
            ),
        }
        for name in names
        for side in ("negative", "positive")
        for m in orders
    ]


def _plain(value):
    """JSON has no infinity or NaN: they become the strings a reader expects."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def _map(arguments) -> Job:
    import pdjax as pd
    from pdjax._internal.checks import writable
    from pdjax.cli.motions import write_picture

    law, path, influence = _setting(arguments)
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    start = time.perf_counter()
    rest = {"N": arguments.N, "dim": arguments.dim, "law": law, "path": path}
    rest |= {"influence": influence, "resolution": arguments.resolution}
    if arguments.m.size * arguments.a.size >= 16 * _FIRST:  # a picture soon, of every fourth m and a; then the map
        first = pd.stability_map(arguments.m[::4], arguments.a[::4], **rest)
        drawn = pd.figures.stability_map(first)
        drawn.suptitle("Coarse preview: every fourth order and load; the whole map follows", color="#B00020")
        write_picture(drawn, picture)
        seconds = time.perf_counter() - start
        print(f"coarse preview, {first.margin.size} states, in {picture} after {seconds:.1f} s", file=sys.stderr)
    lines = ["diagonal", "affine", "local", "continuum"]
    grid = pd.stability_map(arguments.m, arguments.a, lines=lines, save=data, **rest)
    seconds = time.perf_counter() - start
    orders = np.array([-1.0, 0.0, 0.5, 1.0, 2.0])
    rows = _critical_rows(orders, ["symbol", "diagonal"], law, path, influence, arguments)
    words, counts = np.unique(grid.verdict, return_counts=True)
    shares = {str(w): float(c / grid.verdict.size) for w, c in zip(words, counts, strict=True)}
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}, {grid.margin.size} states in {seconds:.1f} s")
        print("by the symbol: " + ", ".join(f"{share:.1%} {word}" for word, share in shares.items()) + "\n")
        print("critical loads a [-] (0: unstable at once; none: not within -0.9 to 1)")
        print(_table(rows) + "\n")
    out = {
        "figure": str(picture),
        "data": str(data),
        "seconds": seconds,
        "shares": shares,
        "critical_loads": rows,
        "settings": grid.settings,
    }

    def files() -> str:
        write_picture(pd.figures.stability_map(grid), picture)
        return f"wrote {picture} and {data}"

    return out, files


def _critical(arguments) -> Job:
    law, path, influence = _setting(arguments)
    names = arguments.criterion or ["symbol", "block", "diagonal", "continuum"]
    rows = _critical_rows(arguments.m, names, law, path, influence, arguments)
    if not arguments.json:
        print(f"{arguments.dim}D, N = {arguments.N:g}, {arguments.path}: critical loads a [-]")
        print("(0: unstable at once; none: not within -0.9 to 1; states that are marginal count as not unstable)")
        print(_table(rows))
    return {"critical_loads": rows}, None


_CORNERS: dict[int, list[tuple[str, tuple[int, ...]]]] = {
    1: [("Γ", (0,)), ("X", (1,))],
    2: [("Γ", (0, 0)), ("X", (1, 0)), ("M", (1, 1)), ("Γ", (0, 0))],
    3: [("Γ", (0, 0, 0)), ("X", (1, 0, 0)), ("M", (1, 1, 0)), ("R", (1, 1, 1)), ("Γ", (0, 0, 0))],
}


def _symbol(arguments) -> Job:
    import jax.numpy as jnp

    import pdjax as pd
    from pdjax._internal.checks import writable
    from pdjax.cli.motions import write_picture

    law, path, influence = _setting(arguments)
    picture = writable(arguments.out) if arguments.out else None
    fam = pd.lattice_family(arguments.dim, arguments.N, influence=influence)
    model = pd.SethHill(arguments.m, law)
    pd.force_state(model, fam, np.eye(arguments.dim))  # a singular family is refused before its path is asked
    F = path(arguments.a, model, fam)
    result = pd.stability(model, fam, F, "symbol", arguments.resolution)
    corners = np.array([corner for _, corner in _CORNERS[arguments.dim]]) * np.pi
    steps = [np.linspace(p, q, 80, endpoint=False) for p, q in itertools.pairwise(corners)]
    waves = np.concatenate([*steps, corners[-1:]])
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(waves, axis=0), axis=1))])
    unit = float(pd.p_wave_modulus(model, fam))
    values = np.asarray(jnp.linalg.eigvalsh(pd.symbol(model, fam, F, waves)) / unit)
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
        print(f"eigenvalue {out['eigenvalue']:+.6e} (spacing 1, unit of lam), λ h²/M {out['eigenvalue'] / unit:+.6e}")
        print(f"M = {unit:g}, the lattice's λ + 2μ at rest")
        print(f"zone grid: {result.resolution} intervals from 0 to π/h")

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


def _keep_compiled() -> None:
    """Keep compiled programs from run to run; where that can't be done, say so in one line and go on."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        use_compilation_cache()
    for warning in said:
        print(f"pdjax: {warning.message}", file=sys.stderr)


def main(argv: list[str] | None = None) -> int:
    """Run one job; 0 done, 2 bad input, 130 interrupted. Numbers are said before a file is written.

    As a program (argv None) it keeps what it compiles for the next time.
    """
    arguments = _parser().parse_args(argv)
    import jax

    jax.config.update("jax_enable_x64", True)
    if argv is None:
        _keep_compiled()
    jobs = {"map": _map, "critical": _critical, "symbol": _symbol, "atlas": run_atlas, "bench": run_bench, "run": run}
    jobs["paper"] = run_paper
    try:
        out, files = jobs[arguments.job](arguments)
        if arguments.json:
            print(json.dumps(_plain(out)), flush=True)
        wrote = files() if files is not None else ""
        if wrote and not arguments.json:
            print(wrote)
    except (ValueError, OSError) as error:
        print(f"pdjax {arguments.job}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\npdjax {arguments.job}: interrupted; what was written already stays, whole", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
