"""`pdjax points FILE`: check points from a file and a horizon before a calculation."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .._internal.checks import writable
from .._internal.pictures import write_picture
from .common import Formatter, Job, Jobs

if TYPE_CHECKING:
    from ..files.point_data import PointData
    from ..geometry.points import Points
    from ..geometry.report import NeighbourReport

MOST_DRAWN = 200_000  # points of a picture; 200 000 take 4 s and 0.6 GB


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "points",
        formatter_class=formatter,
        help="points from a file: neighbours, separate pieces, thin places, and what to change",
        description="Read points from a file and report what to know before a calculation: the numbers of neighbours,"
        "\nisolated points, separate pieces, thin places, volumes, and bonds as long as the horizon.",
    )
    add_reading(job)


def add_reading(job: argparse.ArgumentParser) -> None:
    """Add the arguments of a command that reads points from a file."""
    job.add_argument("file", help="text, CSV, npz, VTK, Gmsh, Abaqus, Exodus or LAMMPS file")
    job.add_argument("--horizon", type=float, required=True, help="horizon [length of the file]")
    job.add_argument(
        "--volume",
        type=_volume,
        help="volume of every point [length^dim], or lattice for spacing^dim (default: from the file)",
    )
    job.add_argument("--spacing", type=float, help="spacing of a lattice [length] (default: from the positions)")
    job.add_argument(
        "--dim", type=int, choices=(1, 2, 3), help="number of coordinates to read (default: from the file)"
    )
    job.add_argument("--step", type=int, help="state of a file that holds several, from 0 (-1: the last)")
    job.add_argument("--json", action="store_true", help="print the results as one JSON object")
    job.add_argument(
        "--out",
        help="write the pictures NAME.png and the fields NAME.vtu, or NAME.pvd for several states; default: no files",
    )


def read(arguments: argparse.Namespace) -> "tuple[Points, PointData]":
    """The points and the data of the file that the arguments name."""
    import pdjax as pd

    given = {name: getattr(arguments, name) for name in ("volume", "spacing", "dim")}
    step = -1 if arguments.step is None else arguments.step
    try:
        return pd.read_points(arguments.file, **given, step=step)
    except ImportError as error:
        raise ValueError(str(error)) from error


def out_name(out: str | None) -> str | None:
    """The NAME of the files to write, which may contain dots. A suffix that would be written is left out."""
    if out is None:
        return None
    name = out[:-4] if Path(out).suffix in (".png", ".vtu", ".pvd") else out
    writable(f"{name}.png")
    return name


def _volume(text: str) -> float | str:
    return text if text == "lattice" else float(text)


def run(arguments: argparse.Namespace) -> Job:
    """Read the points, print the report, and write a picture and the fields if a name is given."""
    import pdjax as pd

    body, data = read(arguments)
    report = pd.neighbour_report(body, arguments.horizon)
    out = _results(report) | {"points": len(body), "dim": body.dim, "notes": list(data.notes)}
    name = out_name(arguments.out)
    if not arguments.json:
        for note in data.notes:
            print(note)
        print(report)
    return out, None if name is None else lambda: _files(name, body, report)


def _results(report: "NeighbourReport") -> dict:
    """The numbers of the report as JSON can hold them."""
    return {
        "horizon": report.horizon,
        "horizon_over_spacing": report.horizon / report.spacing,
        "bonds": int(report.count.sum() // 2),
        "neighbours": {"min": int(report.count.min()), "max": int(report.count.max())},
        "isolated_points": np.flatnonzero(report.alone).tolist(),
        "piece_sizes": report.piece_sizes.tolist(),
        "thin_points": np.flatnonzero(report.thin).tolist(),
        "least_shape_ratio": float(report.shape_ratio.min()),
        "volumes": {"min": float(report.volumes.min()), "max": float(report.volumes.max())},
        "bonds_at_horizon": report.at_horizon,
        "longest_bond_within": report.below,
        "shortest_bond_beyond": report.above,
        "advice": list(report.advice),
        "ok": report.ok,
    }


def _files(name: str, body: "Points", report: "NeighbourReport") -> str:
    import pdjax as pd

    data = pd.export.write_vtk(body, path=name, fields=report.fields)
    if len(body) > MOST_DRAWN and body.dim > 1:
        return f"wrote {data}, and no picture, because {len(body)} points are more than {MOST_DRAWN}"
    picture = Path(f"{name}.png")
    write_picture(pd.figures.neighbours(body, report, f"horizon {report.horizon:g}"), picture)
    return f"wrote {data} and {picture}"
