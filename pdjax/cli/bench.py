"""`pdjax bench`: speed and accuracy, measured on this machine."""

import argparse
from pathlib import Path

from .common import Formatter, Job, Jobs


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "bench",
        formatter_class=formatter,
        help="speed and accuracy of the numerical methods, measured on this machine",
        description="Measure speed and accuracy of the numerical methods, case by case. The command writes"
        "\nDIR/CASE.json and DIR/CASE.png. It saves each row as soon as it is measured, so that an interrupted run"
        "\ncontinues with the missing rows. It refuses a file with rows of another machine, other versions or other"
        "\nsettings.",
    )
    job.add_argument("case", nargs="*", help="names of cases (default: all; see --list)")
    job.add_argument("--quick", action="store_true", help="small sizes, as a test; writes CASE-quick.*")
    job.add_argument("--out", default="pdjax-bench", metavar="DIR", help="output folder (default pdjax-bench)")
    job.add_argument("--list", action="store_true", help="list the cases and stop")
    job.add_argument(
        "--device-report",
        action="store_true",
        help="also measure the memory bandwidth and arithmetic rate of the device, and report which fraction of them"
        " each row reaches; writes to DIR/DEVICE",
    )
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")


def run(arguments: argparse.Namespace) -> Job:
    """Measure the cases. Each file is written while its case runs."""
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
        except ValueError as error:  # this case's file belongs to another setting; measure the other cases
            refused.append(f"{name}: {error}")
            continue
        done[name] = {"rows": len(record["rows"]), "left_out": record["left_out"]}
        say(f"{name}: {len(record['rows'])} rows in {folder}")
    if arguments.device_report and ROOFS in done:
        say(report(folder, arguments.quick))
    if refused:
        raise ValueError("\n".join(refused))
    return {"folder": str(folder), "cases": done}, None
