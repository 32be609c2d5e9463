"""`pdjax audit` reads results from a file, judges them, and writes pictures and fields."""

import json

import numpy as np
import pytest

import pdjax as pd
from pdjax.cli import main

SHAPE = (12, 9)
BODY = pd.lattice(SHAPE)
X = BODY.positions
BOARD = (-1.0) ** np.indices(SHAPE).sum(axis=0).reshape(-1, 1) * np.array([1.0, 0.5])
SMOOTH = X * np.array([0.01, -0.003])
MODEL = ["--model", "bond-level", "--horizon", "2"]


@pytest.fixture
def run(tmp_path):
    """A PVD list of three states: rest, smooth, and smooth with a checkerboard."""
    states = np.array([0 * SMOOTH, SMOOTH, SMOOTH + 0.01 * BOARD])
    sets = {"left": X[:, 0] < 2}
    return pd.export.write_vtk(
        BODY, path=tmp_path / "run.pvd", fields={"displacement": states}, times=[0.0, 0.5, 2.0], sets=sets
    )


def test_a_run_is_judged_state_by_state(run, capsys):
    assert main(["audit", str(run), *MODEL, "--held", "left", "--json", "--out", str(run.with_name("found"))]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "untrusted" and said["first"] == 2 and said["times"] == [0.0, 0.5, 2.0]
    assert said["first_audit"]["findings"][0]["check"] == "zero-energy mode"
    points, data = pd.read_points(run.with_name("found.pvd"), step=2)
    assert data.times == (0.0, 0.5, 2.0) and len(points) == len(X)
    families = pd.families(BODY, 2.0)
    model = pd.BondLevel(pd.LinearElastic(1.0, 1.0))
    held = np.repeat(X[:, :1] < 2, 2, axis=1)
    state = pd.audit(model, families, SMOOTH + 0.01 * BOARD, held=held, body=False, margins=False)
    assert np.array_equal(data.fields["zero_energy"], state.zero_energy)
    for picture in ("found.png", "found-worst.png"):
        assert run.with_name(picture).stat().st_size > 10_000


def test_one_state_is_judged_and_drawn(run, capsys):
    out = run.with_name("one")
    assert main(["audit", str(run), *MODEL, "--step", "1", "--displacement", "Displacement", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "trusted: nothing was found" in said and "one.vtu and" in said
    assert out.with_suffix(".png").stat().st_size > 10_000
    assert {"score", "margin", "critical_factor"} <= set(pd.read_points(f"{out}.vtu")[1].fields)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--displacement", "u"], "no field 'u'; its fields are: displacement"),
        (["--held", "right"], "--held must name a set or a field of run.pvd; its sets: left;"),
        (["--force", "f"], "no field 'f'"),
        (["--model", "steel"], "model must be one of"),
        (["--step", "7"], "step must be from -3 to 2"),
        (["--surface-correction", "energy"], "BondLevel"),
        (["--horizon", "0.2"], "horizon"),
    ],
)
def test_errors_name_what_there_is(run, capsys, more, words):
    arguments = ["audit", str(run), *MODEL, "--step", "1", *more]
    assert main(arguments) == 2
    assert words in capsys.readouterr().err


def test_a_file_without_displacement_lists_its_fields(tmp_path, capsys):
    file = pd.write_points(tmp_path / "plate.csv", BODY, fields={"heat": X[:, 0]})
    assert main(["audit", str(file), *MODEL]) == 2
    assert "its fields: heat" in capsys.readouterr().err


def test_partial_volumes_and_corrections_are_those_of_the_library(tmp_path, capsys):
    file = pd.write_points(tmp_path / "plate.csv", BODY, fields={"u": SMOOTH})
    influence = pd.partial_volume_influence("constant", 1.0)
    families = pd.families(BODY, 2.0, influence)
    model = pd.CATALOGUE["LPS"](pd.LinearElastic(1.0, 1.0), pd.lattice_family(2, 2, influence=influence))
    families = families.with_weight(pd.surface_correction(model, families))
    density = np.asarray(pd.force_density(model, families, SMOOTH))
    file = pd.write_points(tmp_path / "plate.csv", BODY, fields={"u": SMOOTH, "f": density})
    options = ["--partial-volumes", "--surface-correction", "energy", "--force-density", "f", "--json"]
    assert main(["audit", str(file), "--model", "LPS", "--horizon", "2", *options]) == 0
    assert json.loads(capsys.readouterr().out)["force_error"] < 1e-13  # measured 2e-16 (text has 17 digits)
