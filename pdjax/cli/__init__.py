"""The command line, one file for each command: `pdjax map`, `critical`, `symbol`, `atlas`, `bench`, `run`, `paper`.

A command reads its arguments, calls the package, prints and draws. It computes in float64, because the signs of
eigenvalues decide. A new command is one file with `add` and `run`, and one line in `COMMANDS`.
"""

import argparse
import json
import sys
import warnings

from .._internal.compilation_cache import use_compilation_cache
from .._internal.json_values import plain
from . import atlas, bench, critical, map, paper, run, symbol
from .common import Parser

COMMANDS = {
    "map": map,
    "critical": critical,
    "symbol": symbol,
    "atlas": atlas,
    "bench": bench,
    "run": run,
    "paper": paper,
}

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


def parser() -> argparse.ArgumentParser:
    """The parser of every command."""
    formatter = argparse.RawDescriptionHelpFormatter
    whole = Parser(
        prog="pdjax",
        description="Exact stability of peridynamic material models on infinite lattices.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    jobs = whole.add_subparsers(dest="job", required=True, metavar="job")
    for command in COMMANDS.values():
        command.add(jobs, formatter)
    return whole


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
    arguments = parser().parse_args(argv)
    import jax

    jax.config.update("jax_enable_x64", True)
    if argv is None:
        _keep_compiled()
    try:
        out, files = COMMANDS[arguments.job].run(arguments)
        if arguments.json:
            print(json.dumps(plain(out)), flush=True)
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
