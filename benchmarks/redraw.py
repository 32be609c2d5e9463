"""Draw the pictures in results/ again from the kept numbers, after a change of labels or colours.

No number is computed again and no result file is changed, with two exceptions that take seconds: the spectra of three
bars (`body_spectrum`) and the long runs of `integrators`, whose curves are not kept. The figures of `pdjax bench` use
the rows in pdjax/bench/measured. The curves of `cuboid` and of `pdjax paper` are not kept, so these programs must run
again.

    python benchmarks/redraw.py                 every picture
    python benchmarks/redraw.py peers bench-ways
"""

import json
import runpy
import sys
from pathlib import Path
from typing import Any

import pdjax as pd
from pdjax.bench.cases import CASES
from pdjax.bench.harness import flat, read, results

PROGRAMS = (
    "body_spectrum",
    "convergence",
    "criteria",
    "designed_stabilisers",
    "disorder",
    "influence_design",
    "integrators",
    "inverse",
    "models_on_scenes",
    "peers",
    "plate_with_hole",
    "proofs",
    "singular_bar",
    "stabilisers",
    "statics_at_scale",
    "surface_correction",
    "zone_accuracy",
)
MEASURED = Path(pd.__file__).parent / "bench" / "measured"


def figure(name: str) -> Any:
    """The figure of one picture: "atlas", "bench-CASE", or the name of a program in this folder."""
    if name == "atlas":
        return pd.figures.model_atlas(pd.Atlas.load(results() / "atlas.json"))
    if name.startswith("bench-"):
        case = name.removeprefix("bench-")
        return CASES[case].draw(flat(read(MEASURED / f"{case}.json")["rows"]))
    program = runpy.run_path(str(Path(__file__).with_name(f"{name}.py")))
    return program["draw"](json.loads((results() / f"{name}.json").read_text()))


def main() -> None:
    known = ["atlas", *(f"bench-{case}" for case in CASES), *PROGRAMS]
    wanted = sys.argv[1:] or known
    if unknown := sorted(set(wanted) - set(known)):
        sys.exit(f"redraw.py: no kept numbers for {', '.join(unknown)}; choose from {', '.join(known)}")
    for name in wanted:
        file = results() / f"{name}.png"
        figure(name).savefig(file, dpi=140)
        print(file, flush=True)


if __name__ == "__main__":
    main()
