"""The command line `pdjax`, one file for each command.

A command reads its arguments, calls the package, prints the results and draws figures. It computes in float64, because
the verdicts depend on signs of eigenvalues. To add a command, write a file with the functions `add` and `run`, and add
one line to `COMMANDS`. The modules, in the order in which to read them:

    common      parts that the commands share: parser, arguments of a lattice, output files
    map         pdjax map, a stability map
    critical    pdjax critical, critical loads
    symbol      pdjax symbol, the spectrum of one state
    atlas       pdjax atlas, all models on all load paths
    design      pdjax design, the least penalty, a stabiliser or an influence function
    points      pdjax points FILE, what to know of points from a file
    audit       pdjax audit FILE, whether results from a file can be trusted
    run         pdjax run SCENE, which takes its scenes from the next five modules
    bars        the scenes singular-bar and step-bar of run
    cuboid      the scene cuboid of run
    wave        the scene wave of run
    fracture    the scenes spall-bar, branching-plate and kalthoff of run, in which bonds break
    slow_cracks the scenes of run in which a crack grows under a slow load
    motions     parts that cuboid and wave share
    paper       pdjax paper, the figures and claims of the paper
    bench       pdjax bench, measurements of speed and accuracy
"""

import argparse
import json
import sys
import warnings

from .._internal.compilation_cache import use_compilation_cache
from .._internal.json_values import plain
from . import atlas, audit, bench, critical, design, map, paper, points, run, symbol
from .common import Parser

COMMANDS = {
    "map": map,
    "critical": critical,
    "symbol": symbol,
    "atlas": atlas,
    "design": design,
    "points": points,
    "audit": audit,
    "bench": bench,
    "run": run,
    "paper": paper,
}

_EPILOG = """examples
  pdjax map                                     default stability map: 2D, N = 3, orders -2 to 2, loads up to 30 %
  pdjax map --dim 3 --path uniaxial-stress      the same map in 3D under uniaxial stress
  pdjax map --m=-1:2:61 --a=-0.1:0.1:81         a finer grid near the origin (lo:hi:count; = before a minus sign)
  pdjax critical --m 0 1 2                      critical loads of three orders in compression and tension
  pdjax symbol --m 0 --a=-0.02                  one state: verdict, most unstable wave and spectrum
  pdjax atlas --dim 2 3                         all models on all load paths: critical strains, zero-energy waves, cost
  pdjax design penalty --m 0 1                  the least zero-energy penalty for strains of +-5 %
  pdjax points body.csv --horizon 0.3           neighbours, separate pieces and thin places of points from a file
  pdjax audit run.pvd --model LPS --horizon 0.3 where results of any code can be trusted, and why not
  pdjax bench --quick                           speed and error of the numerical methods, at small sizes
  pdjax run singular-bar                        the paper's singular bar in tension and compression, two models
  pdjax run step-bar --strain=-0.001            the paper's step-size bar at one strain
  pdjax run cuboid --m 0                        the paper's cuboid in tension and compression, explicit dynamics
  pdjax run wave --a=-0.01 --j 20               a wave that grows: the shortest wave of a compressed bar
  pdjax run branching-plate --quick             a glass plate breaks: speed and branches of the crack, energy
  pdjax paper --quick                           all figures and claims of the paper, at reduced sizes

`pdjax COMMAND --help` explains the options of a command.
"""


def parser() -> argparse.ArgumentParser:
    """Make the parser of all commands."""
    formatter = argparse.RawDescriptionHelpFormatter
    whole = Parser(
        prog="pdjax",
        description="Find out at which loads a peridynamic material model is stable, with exact Jacobians.",
        epilog=_EPILOG,
        formatter_class=formatter,
    )
    jobs = whole.add_subparsers(dest="job", required=True, metavar="command")
    for command in COMMANDS.values():
        command.add(jobs, formatter)
    return whole


def _keep_compiled() -> None:
    """Keep compiled programs for later runs. If that fails, print one line and go on."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        use_compilation_cache()
    for warning in said:
        print(f"pdjax: {warning.message}", file=sys.stderr)


def main(argv: list[str] | None = None) -> int:
    """Run one command and return the exit code: 0 done, 2 bad input, 130 interrupted.

    `main` prints the numbers before it draws the figure, so that a full disk loses no results. Called as a program
    (`argv` None), it stores compiled programs for the next run.
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
        print(f"\npdjax {arguments.job}: interrupted; files that are already written are complete", file=sys.stderr)
        return 130
    return 0
