"""`pdjax bench`: the measured cases on the command line."""

import argparse
from pathlib import Path
from typing import Any

from .common import Job


def add(jobs: Any, formatter: Any) -> None:
    """The arguments of the job."""
    job = jobs.add_parser(
        "bench",
        formatter_class=formatter,
        help="speed against accuracy, measured on this machine: JSON and PNG for each case",
        description="Measure the cases. Writes DIR/CASE.json, row by row, and DIR/CASE.png; a run that was stopped goes"
        "\non with the missing rows. Rows of another machine, other versions or other settings are not mixed in.",
    )
    job.add_argument("case", nargs="*", help="names of cases (default: all; a wrong name lists them)")
    job.add_argument("--quick", action="store_true", help="small sizes, to see that all works: files CASE-quick.*")
    job.add_argument("--out", default="pdjax-bench", metavar="DIR", help="folder of the files (default pdjax-bench)")
    job.add_argument("--list", action="store_true", help="say which cases there are, measure nothing")
    job.add_argument(
        "--device-report",
        action="store_true",
        help="measure the device's own bandwidth and flops too, keep all in DIR/DEVICE, and write what fraction of"
        " them each row achieves",
    )
    job.add_argument("--json", action="store_true", help="print one JSON object instead of text")


def run(arguments: argparse.Namespace) -> Job:
    """Do the job; the files are written as the cases finish."""
    from ..bench.cases import CASES
    from ..bench.device import ROOFS, device_name, report
    from ..bench.harness import run_case

    def say(text: str) -> None:
        if not arguments.json:
            print(text, flush=True)

    unknown = [name for name in arguments.case if name not in CASES]
    if unknown:
        raise ValueError(f"there is no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    if arguments.list:
        width = max(map(len, CASES))
        say("\n".join(f"{name:<{width}}  {case.about}" for name, case in CASES.items()))
        return {"cases": {name: case.about for name, case in CASES.items()}}, None
    folder = Path(arguments.out)
    names = list(dict.fromkeys(arguments.case)) or list(CASES)
    if arguments.device_report:
        folder /= device_name()
        names = [ROOFS, *(name for name in names if name != ROOFS)]
    folder.mkdir(parents=True, exist_ok=True)
    refused: list[str] = []
    done: dict[str, dict] = {}
    for name in names:
        try:
            record = run_case(name, CASES[name], folder, arguments.quick, say)
        except ValueError as error:  # a file that is not ours to go on with: the other cases are measured all the same
            refused.append(f"{name}: {error}")
            continue
        done[name] = {"rows": len(record["rows"]), "left_out": record["left_out"]}
        say(f"{name}: {len(record['rows'])} rows in {folder}")
    if arguments.device_report and ROOFS in done:
        say(report(folder, arguments.quick))
    if refused:
        raise ValueError("\n".join(refused))
    return {"folder": str(folder), "cases": done}, None
