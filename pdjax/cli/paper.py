"""`pdjax paper`: reproduce the figures of the paper and test its claims."""

import argparse
import sys
from contextlib import closing
from pathlib import Path

from .common import Formatter, Job, Jobs


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "paper",
        formatter_class=formatter,
        help="figures and claims of the paper, checked with the exact Jacobian",
        description="Make every figure of the paper by Behzadinasab and Foster (2020) and test its claims with the"
        "\nexact Jacobian. The command writes DIR/paper-FIGURE.png, DIR/paper.json and DIR/paper.md. It updates them"
        "\nafter each figure, so that an interrupted run continues with the missing figures. Delete a picture to make"
        "\nit again.",
    )
    job.add_argument("--figure", nargs="+", metavar="NAME", help="figures to make (default: all; see --list)")
    job.add_argument("--out", metavar="DIR", help="output directory (default pdjax-paper, or pdjax-paper-quick)")
    job.add_argument(
        "--quick", action="store_true", help="reduced sizes, noted on each figure; takes about two minutes"
    )
    job.add_argument("--list", action="store_true", help="list the figures and stop")
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")


def run(arguments: argparse.Namespace) -> Job:
    """Make the figures and test the claims. Every file is written as soon as its figure is ready."""
    from .._internal.checks import choice
    from ..studies.paper import FIGURES, making, results

    if arguments.list:
        if not arguments.json:
            print("\n".join(f"{name:<14}{sheet.shows}" for name, sheet in FIGURES.items()))
        return {"figures": {name: sheet.shows for name, sheet in FIGURES.items()}}, None
    names = list(dict.fromkeys(choice("figure", name, list(FIGURES)) for name in arguments.figure or FIGURES))
    out = directory(Path(arguments.out or ("pdjax-paper-quick" if arguments.quick else "pdjax-paper")))
    found = results.read(out, arguments.quick)
    jobs = {}
    for name in names:
        if results.finished(found, out, name):
            _say(arguments, f"{name}: there already ({results.picture(out, name)})")
        else:
            jobs[name] = (name, arguments.quick, results.picture(out, name))
    with closing(making.each(making.make, jobs, making.processes(len(jobs)))) as finished:
        for name, (numbers, seconds) in finished:
            file = results.picture(out, name)
            results.keep(found, name, {"file": file.name, "shows": FIGURES[name].shows, "seconds": seconds}, numbers)
            results.write(found, out)
            _say(arguments, f"{name}: {file} ({seconds:.0f} s)")
    mine = [row for row in found["claims"] if row["figure"] in names]
    if not arguments.json:
        print("\n" + table(mine))
        print(f"\n{results.counts({'claims': mine})}; {out / 'paper.md'} lists them with the tests that check them")
    return {"out": str(out), "claims": mine, "figures": found["figures"]}, None


def directory(out: Path) -> Path:
    """Make the directory `out` if needed. Raise OSError now, not after the figures, if it can't be written."""
    from .._internal.checks import writable

    if out.exists() and not out.is_dir():
        raise NotADirectoryError(f"cannot write to {out}: it is a file; name a directory")
    if not out.parent.is_dir():
        raise FileNotFoundError(f"cannot make {out}: the directory {out.parent} does not exist")
    try:
        out.mkdir(exist_ok=True)
    except OSError as error:
        raise PermissionError(f"cannot make {out}: {error.strerror or error}") from error
    for file in ("paper.json", "paper.md"):
        writable(out / file)
    return out


def table(rows: list[dict]) -> str:
    """Format the claims for a terminal, in four lines each."""
    return "\n".join(
        f"{row['verdict'].upper():<10} {row['claim']} ({row['where']})\n"
        f"{'':<10} paper: {row['paper']}\n{'':<10} ours:  {row['ours']}\n{'':<10} {row['command']}"
        for row in rows
    )


def _say(arguments: argparse.Namespace, words: str) -> None:
    if not arguments.json:
        print(words, flush=True)
    else:
        print(words, file=sys.stderr, flush=True)
