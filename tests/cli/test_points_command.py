"""`pdjax points` reads a file, reports on its points, and writes a picture and the fields."""

import json

import numpy as np
import pytest

import pdjax as pd
from pdjax.cli import main


@pytest.fixture
def plates(tmp_path):
    """A CSV file of a plate of 6 × 5 points, a smaller plate far away and an isolated point."""
    plate, small = pd.lattice((6, 5)).positions, pd.lattice((3, 3)).positions
    X = np.concatenate([plate, small + np.array([20.25, 0.0]), [[40.0, 3.0]]])
    file = tmp_path / "plates.csv"
    np.savetxt(file, X, delimiter=",", header="x,y", comments="")
    return file


def test_the_command_prints_what_to_do(plates, capsys):
    assert main(["points", str(plates), "--horizon", "2.1", "--volume", "1"]) == 0
    said = capsys.readouterr().out
    assert "40 points in 2D" in said and "the first is point 39" in said
    assert "3 separate pieces of 30, 9, 1 points" in said
    assert [file.name for file in plates.parent.iterdir()] == ["plates.csv"]


def test_the_command_prints_the_report_of_the_library_as_json(plates, capsys):
    assert main(["points", str(plates), "--horizon", "2.1", "--volume", "1", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    body, _ = pd.read_points(plates, volume=1.0)
    report = pd.neighbour_report(body, 2.1)
    assert said["bonds"] == report.count.sum() // 2 and said["isolated_points"] == [39]
    assert said["piece_sizes"] == [30, 9, 1] and not said["ok"] and said["advice"] == list(report.advice)


def test_the_name_of_the_files_may_contain_dots(plates, capsys):
    name = plates.parent / "horizon.2.1"
    for given in (name, f"{name}.png"):
        assert main(["points", str(plates), "--horizon", "2.1", "--volume", "1", "--out", str(given)]) == 0
    assert {file.name for file in plates.parent.iterdir()} == {"plates.csv", "horizon.2.1.png", "horizon.2.1.vtu"}


def test_supports_may_be_a_field_of_zeros_and_ones(tmp_path, capsys):
    """`write_vtk` writes the supports of a scene as the field "held", which an audit of the file can name."""
    body = pd.lattice((6, 5))
    families, left = pd.families(body, 2.1), body.positions[:, 0] < 1
    model = pd.BondLevel(pd.LinearElastic(1.0, 1.0))
    scene = pd.scene(body, families, model, pd.prescribe(left), pd.body_force(~left, [0.001, 0.0]))
    found = pd.solve(scene)
    file = str(pd.export.write_vtk(scene, found, tmp_path / "plate"))
    command = ["audit", file, "--horizon", "2.1", "--model", "bond-level", "--json", "--held"]
    assert main([*command, "held"]) == 0
    said = json.loads(capsys.readouterr().out)
    state = pd.audit(model, families, found.u, held=~scene.free)
    assert abs(said["eigenvalue"] / state.eigenvalue - 1) < 1e-9
    for wrong, message in (("load", "a field of zeros and ones"), ("hold", "a set or a field")):
        assert main([*command, wrong]) == 2
        assert message in capsys.readouterr().err


def test_the_command_writes_a_picture_and_the_fields(plates, capsys):
    meshio = pytest.importorskip("meshio")
    out = plates.parent / "found"
    assert main(["points", str(plates), "--horizon", "2.1", "--volume", "1", "--out", str(out)]) == 0
    assert "found.vtu and" in capsys.readouterr().out
    fields = meshio.read(f"{out}.vtu").point_data
    assert fields["piece"].tolist() == [0] * 30 + [1] * 9 + [2] and fields["alone"].sum() == 1
    assert out.with_suffix(".png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--horizon", "-1", "--volume", "1"], "horizon must be finite and > 0"),
        (["--horizon", "2.1"], "volume"),
        (["--horizon", "2.1", "--volume", "1", "--out", "no-such-folder/x"], "does not exist"),
    ],
)
def test_bad_input_is_explained(plates, more, words, capsys):
    assert main(["points", str(plates), *more]) == 2
    assert words in capsys.readouterr().err
