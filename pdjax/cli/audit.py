"""`pdjax audit FILE`: whether the results in a file can be trusted."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._internal.pictures import write_picture
from .common import Formatter, Job, Jobs, add_influence
from .points import MOST_DRAWN, add_reading, out_name, read

if TYPE_CHECKING:
    from ..files.point_data import PointData
    from ..geometry.points import Points
    from ..trust.series import AuditSeries
    from ..trust.verdict import Audit

NAMES = ("displacement", "displacements", "disp", "u")  # names under which codes write a displacement


def add(jobs: Jobs, formatter: Formatter) -> None:
    """Add the command and its arguments."""
    job = jobs.add_parser(
        "audit",
        formatter_class=formatter,
        help="results from a file: whether they can be trusted, where not, and why",
        description="Judge results from a file, of pdjax or of another code: zero-energy modes, stability of the"
        "\nlattice under the stretch of every point, stability of the body, inverted families, and forces. A file with"
        "\nseveral states is judged state by state, unless --step names one.",
    )
    add_reading(job)
    job.add_argument(
        "--model",
        required=True,
        help='model of the results, such as "LPS" or "bond-level"; a wrong name lists all names',
    )
    job.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the law (default 1)")
    job.add_argument("--mu", type=float, default=1.0, help="shear modulus of the law (default 1)")
    add_influence(job)
    job.add_argument("--partial-volumes", action="store_true", help="count the part of a volume within the horizon")
    job.add_argument(
        "--surface-correction",
        choices=("energy", "volume"),
        help="bond weights that correct surfaces (bond-based, LPS)",
    )
    job.add_argument("--displacement", help="field of displacements [length] (default: the one there is)")
    job.add_argument("--force", help="field of internal forces [force], compared with those of the model")
    job.add_argument("--force-density", help="field of internal force densities [force/length^dim], compared")
    job.add_argument(
        "--held",
        help="set of supported points, or a field that is 1 on supported points or components, such as the field held"
        " of files of pdjax (default: the body is free)",
    )


def _displacement(data: "PointData", name: str | None, dim: int) -> np.ndarray:
    """The displacement of a state, under the given name or a usual one."""
    if name is not None:
        return data.vector(name, dim)
    for usual in NAMES:
        try:
            return data.vector(usual, dim)
        except ValueError as error:
            if "has no field" not in str(error):
                raise
    known = ", ".join(data.fields) or "none"
    raise ValueError(f"--displacement must name the field of displacements of {data.source.name}; its fields: {known}")


def _held(data: "PointData", name: str | None, dim: int) -> np.ndarray | None:
    """The supported points or components: a set, or a field of zeros and ones."""
    if name is None or name in data.sets:
        return None if name is None else data.sets[name]
    if name not in data.fields:
        sets, fields = (", ".join(names) or "none" for names in (data.sets, data.fields))
        raise ValueError(
            f"--held must name a set or a field of {data.source.name}; its sets: {sets}; its fields: {fields};"
            f" got {name!r}"
        )
    mask = data.fields[name]
    if not np.isin(mask, (0, 1)).all():
        raise ValueError(f"--held must name a field of zeros and ones; {name} of {data.source.name} has other numbers")
    return (data.vector(name, dim) if mask.ndim > 1 else mask).astype(bool)


def run(arguments: argparse.Namespace) -> Job:
    """Audit one state or all states of the file, print the verdict, and write a picture and the fields."""
    import pdjax as pd
    from pdjax.models.catalogue import model_name
    from pdjax.trust.own_lattice import own_lattice_family

    name = out_name(arguments.out)
    maker = pd.CATALOGUE[model_name(arguments.model)]
    body, data = read(arguments)
    several = len(data.times) > 1 and arguments.step is None
    influence: Any = arguments.influence.replace("_", " ")
    if arguments.partial_volumes:
        spacing = body.spacing or float(np.median(body.volumes)) ** (1 / body.dim)
        influence = pd.partial_volume_influence(influence, spacing)
    families = pd.families(body, arguments.horizon, influence)
    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu)  # type: ignore[call-arg]
    model = maker(law, own_lattice_family(families)[0])
    if arguments.surface_correction is not None:
        families = families.with_weight(pd.surface_correction(model, families, arguments.surface_correction))
    about = {"file": str(data.source), "model": repr(model), "horizon": arguments.horizon, "reading": list(data.notes)}
    held = _held(data, arguments.held, body.dim)
    if not arguments.json:
        for note in data.notes:
            print(note)
    if several:
        states = [_displacement(state, arguments.displacement, body.dim) for state in data.states()]
        fields: list[dict[str, np.ndarray]] = []
        keep = None if name is None else lambda state: fields.append(state.fields)
        series = pd.audit_states(model, families, states, times=data.times, held=held, each=keep)
        if not arguments.json:
            print(series)
        return about | series.as_dict(), None if name is None else lambda: _files_of_run(
            name, body, data, series, fields
        )
    given: dict[str, Any] = {
        key: None if field is None else data.vector(field, body.dim)
        for key, field in (("force", arguments.force), ("given_density", arguments.force_density))
    }
    state = pd.audit(model, families, _displacement(data, arguments.displacement, body.dim), held=held, **given)
    if not arguments.json:
        print(state)
    return about | state.as_dict() | {"time": data.time}, None if name is None else lambda: _files(
        name, body, data, state
    )


def _files(name: str, body: "Points", data: "PointData", state: "Audit") -> str:
    import pdjax as pd

    file = pd.export.write_vtk(body, path=name, fields=state.fields, sets=data.sets)
    return f"wrote {file}{_picture(name, body, lambda: pd.figures.audit(body, state))}"


def _files_of_run(
    name: str, body: "Points", data: "PointData", series: "AuditSeries", fields: list[dict[str, np.ndarray]]
) -> str:
    import pdjax as pd

    shared = set.intersection(*(set(each) for each in fields))
    columns = {key: np.stack([each[key] for each in fields]) for key in fields[0] if key in shared}
    file = pd.export.write_vtk(body, path=f"{name}.pvd", fields=columns, times=series.times, sets=data.sets)
    write_picture(pd.figures.audit_states(series), Path(f"{name}.png"))
    worst = series.first_audit or series.last_audit
    return f"wrote {file}, {name}.png{_picture(name + '-worst', body, lambda: pd.figures.audit(body, worst))}"


def _picture(name: str, body: "Points", draw) -> str:
    """Write the picture and return how the message goes on."""
    if len(body) > MOST_DRAWN and body.dim > 1:
        return f", and no picture, because {len(body)} points are more than {MOST_DRAWN}"
    write_picture(draw(), Path(f"{name}.png"))
    return f" and {name}.png"
