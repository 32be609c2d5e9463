"""Parts that the scenes `cuboid` and `wave` of `pdjax run` share: arguments, model, animations, files for ParaView."""

import argparse
import shutil
from pathlib import Path

from ..models.base import AbstractModel


def moving_arguments() -> argparse.ArgumentParser:
    """Make the arguments of `cuboid` and `wave`."""
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("--N", type=float, default=3.0, help="horizon over spacing [-] (default 3)")
    common.add_argument("--lam", type=float, default=1.0, help="first Lamé constant of the linear law (default 1)")
    common.add_argument(
        "--mu", type=float, default=1.0, help="shear modulus of the linear law (default 1; unused in 1D)"
    )
    common.add_argument(
        "--dt",
        type=float,
        help="time step [time] (default 0.8 of the critical step, for a wave at most 1/300 of a period)",
    )
    common.add_argument("--animate", metavar="FILE", help="also write an animation: FILE.gif, or FILE.mp4 with ffmpeg")
    common.add_argument("--vtk", metavar="NAME", help="also write NAME.vtu.series for ParaView")
    common.add_argument("--json", action="store_true", help="print the results as one JSON object")
    return common


def model(arguments: argparse.Namespace, dim: int) -> AbstractModel:
    """Return the material model that the arguments name."""
    import pdjax as pd
    from pdjax._internal.checks import choice

    law = pd.LinearElastic(lam=arguments.lam, mu=arguments.mu if dim > 1 else 0.0)  # type: ignore[call-arg, arg-type]
    choice("model", arguments.model, ("seth-hill", "correspondence"))
    return pd.SethHill(arguments.m, law) if arguments.model == "seth-hill" else pd.Correspondence(law)


def extras(arguments, name: str) -> dict[str, str]:
    """Names of the animation and the VTK files, if they were requested."""
    out = {}
    if arguments.animate:
        file = Path(arguments.animate)
        out["animation"] = str(file.with_name(f"{file.stem}{name}{file.suffix}"))
    if arguments.vtk:
        out["vtk"] = f"{arguments.vtk}{name}.vtu.series"
    return out


def write_extras(extras: dict[str, str], scene, history) -> str:
    """Write the animation and the VTK files, and return their names for the message."""
    import pdjax as pd
    from pdjax.files.vtk import write_vtk

    if "animation" in extras:
        pd.figures.animation(scene, history, extras["animation"], component=scene.body.dim - 1)
    if "vtk" in extras:
        write_vtk(scene, history, extras["vtk"].removesuffix(".vtu.series"))
    return "".join(f", {file}" for file in extras.values())


def check_outputs(arguments) -> tuple[Path, Path]:
    """Check before the run that every output file can be written. Return the picture and the data file."""
    from pdjax._internal.checks import writable

    if arguments.animate and Path(arguments.animate).suffix not in (".gif", ".mp4"):
        raise ValueError(f"--animate must name a .gif or an .mp4 file; got {arguments.animate!r}")
    if arguments.animate and Path(arguments.animate).suffix == ".mp4" and shutil.which("ffmpeg") is None:
        raise ValueError("--animate to an .mp4 needs the program ffmpeg, which is not installed; name a .gif instead")
    for extra in (arguments.animate, arguments.vtk):
        if extra:
            writable(extra)
    picture, data = (writable(f"{arguments.out}.{ending}") for ending in ("png", "npz"))
    return picture, data
