"""`pdjax run SCENE`: a scene, solved or run, judged and drawn."""

import argparse
from typing import Any

from . import bars, cuboid, wave
from .common import Job

SCENES = {"singular-bar": bars, "step-bar": bars, "cuboid": cuboid, "wave": wave}


def add(jobs: Any, formatter: Any) -> None:
    """Add the command and its scenes."""
    parser = jobs.add_parser(
        "run",
        formatter_class=formatter,
        help="a scene: singular-bar, step-bar, cuboid or wave",
        description="Solve or run a scene, judge what was found, draw it. Writes OUT.png and OUT.npz.",
    )
    scenes = parser.add_subparsers(dest="scene", required=True, metavar="scene")
    for module in dict.fromkeys(SCENES.values()):
        module.add(scenes)


def run(arguments: argparse.Namespace) -> Job:
    """Run the scene that was asked for."""
    return SCENES[arguments.scene].run(arguments)
