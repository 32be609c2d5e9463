"""`pdjax run SCENE`: solve or simulate a scene, judge the result and draw it."""

import argparse

from . import bars, cuboid, fracture, slow_cracks, wave
from .common import Formatter, Job, Jobs

SCENES = {
    "singular-bar": bars,
    "step-bar": bars,
    "cuboid": cuboid,
    "wave": wave,
    **dict.fromkeys(fracture.CASES, fracture),
    **dict.fromkeys(slow_cracks.CASES, slow_cracks),
}


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its scenes."""
    parser = jobs.add_parser(
        "run",
        formatter_class=formatter,
        help=f"solve or simulate a body: {', '.join(list(SCENES)[:-1])} or {list(SCENES)[-1]}",
        description="Solve a static scene or simulate a moving one, judge the result and draw it. The command writes"
        "\nOUT.png and OUT.npz. `pdjax run SCENE --help` explains the options of a scene.",
    )
    scenes = parser.add_subparsers(dest="scene", required=True, metavar="scene")
    for module in dict.fromkeys(SCENES.values()):
        module.add(scenes)


def run(arguments: argparse.Namespace) -> Job:
    """Run the named scene."""
    return SCENES[arguments.scene].run(arguments)
