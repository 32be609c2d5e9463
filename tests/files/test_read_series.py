"""Lists of VTK files, and what `write_vtk` writes is read again with the same bits."""

import json
import os

import meshio
import numpy as np
import pytest

import pdjax as pd
from pdjax.files.read import opened
from pdjax.files.vtk import write_vtk


def fields_of(body, rng):
    count = len(body)
    return {
        "scalar": rng.normal(size=count),
        "single": rng.normal(size=count).astype(np.float32),
        "vector": rng.normal(size=(count, body.dim)),
        "tensor": rng.normal(size=(count, body.dim, body.dim)),
        "label": np.arange(count) - 3,
        "small": np.arange(count, dtype=np.uint16),
        "flag": np.arange(count) % 2 == 0,
        "bad": np.r_[np.nan, np.inf, -np.inf, rng.normal(size=count - 3)],
        "Name “β” <&>": rng.normal(size=(count, 5)),
    }


def assert_same(contents, body, fields, sets):
    dim = body.dim
    assert np.array_equal(contents.positions[:, :dim], body.positions) and not contents.positions[:, dim:].any()
    assert np.array_equal(contents.volumes, body.volumes)
    for name, values in fields.items():
        read = contents.fields[name]
        cut = read[(slice(None), *(slice(n) for n in values.shape[1:]))]
        assert np.array_equal(cut, values, equal_nan=values.dtype.kind == "f"), name
        assert read.dtype == (np.uint8 if values.dtype == bool else values.dtype)
    assert {name: mask.tolist() for name, mask in contents.sets.items()} == {n: m.tolist() for n, m in sets.items()}


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("name", ["one", "one.vtu", "one.pvd"])
def test_what_is_written_is_read_with_the_same_bits(dim, name, tmp_path):
    rng = np.random.default_rng(dim)
    body = pd.cloud(rng.random((9, dim)), 0.1 + rng.random(9))
    fields, sets = fields_of(body, rng), {"left side": body.positions[:, 0] < 0.5, "none": np.zeros(9, bool)}
    file = write_vtk(body, path=tmp_path / name, fields=fields, sets=sets)
    states = opened(file)
    assert states.times == ((0.0,) if name.endswith("pvd") else ())
    assert_same(states.at(0), body, fields, sets)
    again = write_vtk(body, path=tmp_path / "again", fields=states.at(0).fields, sets=states.at(0).sets)
    assert_same(opened(again).at(0), body, fields, sets)


@pytest.mark.parametrize(
    "name, listing", [("run", "run.vtu.series"), ("run.vtu.series", "run.vtu.series"), ("run.pvd", "run.pvd")]
)
def test_a_motion_is_read_with_its_times_and_states(name, listing, tmp_path):
    motion = pd.scenes.wave((7, 6), 2, model=pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=1.0)), u0=0.1, periods=1.0)
    history = pd.simulate(motion, dt=0.5, save_every=4, show_progress=False)
    held = motion.scene.body.positions[:, 0] < 2
    file = write_vtk(motion.scene, history, tmp_path / name, sets={"held": held})
    assert file.name == ("run.pvd" if name == "run.pvd" else "run.vtu.series")
    states = opened(file)
    assert states.times == tuple(history.times.tolist()) and len(states.times) > 1
    for k in range(len(states.times)):
        contents = states.at(k)
        assert np.array_equal(contents.fields["displacement"][:, :2], history.u[k])
        assert np.array_equal(contents.fields["velocity"][:, :2], history.v[k])
        assert np.array_equal(contents.sets["held"], held)
    assert len(list(tmp_path.iterdir())) == len(states.times) + 1


def test_the_vtk_library_reads_the_list_and_the_fields(tmp_path):
    vtk = pytest.importorskip("vtk")
    body = pd.plate((3.0, 2.0), 0.5)
    file = write_vtk(body, path=tmp_path / "x", fields={"β <&>": body.positions})
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(file))
    reader.Update()
    array = reader.GetOutput().GetPointData().GetArray("β <&>")
    assert array.GetNumberOfComponents() == 3 and array.GetTuple(5)[:2] == tuple(body.positions[5])


def test_an_interrupted_run_leaves_no_list(tmp_path, monkeypatch):
    body = pd.plate((3.0, 2.0), 0.5)
    scene = pd.scene(body, pd.families(body, 1.1), pd.BondBased(1.0), pd.prescribe(body.positions[:, 0] < 1, 0.0))
    path = pd.equilibrium_path(scene, states=3)
    file = write_vtk(scene, path, tmp_path / "x.pvd")
    before = sorted(p.name for p in tmp_path.iterdir())
    calls = []

    def failing(stream, *rest):
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("pdjax.files.vtk.write_vtu", failing)
    with pytest.raises(KeyboardInterrupt):
        write_vtk(scene, path, tmp_path / "x.pvd")
    assert not file.exists() and sorted(p.name for p in tmp_path.iterdir()) == [n for n in before if n != "x.pvd"]


@pytest.mark.parametrize("kind", ["pvd", "series"])
@pytest.mark.parametrize(
    "name", ["/etc/passwd.vtu", "../x.vtu", "a/../../x.vtu", "C:\\x.vtu", "..\\x.vtu", "", "x.vtm"]
)
def test_a_list_may_only_name_vtk_files_in_its_folder(kind, name, tmp_path):
    if kind == "pvd":
        path = tmp_path / "x.pvd"
        entry = f'<DataSet timestep="0" file="{name}"/>'
        path.write_text(f'<VTKFile type="Collection"><Collection>{entry}</Collection></VTKFile>')
    else:
        path = tmp_path / "x.vtu.series"
        path.write_text(json.dumps({"files": [{"name": name, "time": 0}]}))
    with pytest.raises(ValueError, match=r"may only name files in its own folder|must be VTU, PVTU or legacy VTK"):
        opened(path)


def parts_of_a_run(folder):
    """Two parts of five points as two processes write them. The second copies a point of the first."""
    x = np.linspace(0, 1, 5)
    for k, (rows, copied) in enumerate((([0, 1, 2], [0, 0, 0]), ([2, 3, 4], [1, 0, 0]))):
        points = np.stack([x[rows], x[rows] ** 2, np.zeros(3)], axis=1)
        data = {"volume": 1 + x[rows], "heat": x[rows]}
        cells = [("vertex", np.arange(3)[:, None])]
        mesh = meshio.Mesh(points, cells, point_data=data, cell_data={"vtkGhostType": [np.array(copied, np.uint8)]})
        meshio.vtu.write(folder / f"part-{k}.vtu", mesh)
    pieces = '<Piece Source="part-0.vtu"/><Piece Source="part-1.vtu"/>'
    head = '<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>'
    (folder / "run.pvtu").write_text(f"{head}{pieces}</PUnstructuredGrid></VTKFile>")
    entries = "".join(f'<DataSet timestep="0.5" part="{k}" file="part-{k}.vtu"/>' for k in range(2))
    entries += '<DataSet timestep="1.5" file="run.pvtu"/>'
    (folder / "run.pvd").write_text(f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>')
    return x


def test_parts_of_parallel_runs_are_joined_without_copies(tmp_path):
    x = parts_of_a_run(tmp_path)
    states = opened(tmp_path / "run.pvd")
    assert states.times == (0.5, 1.5)
    for contents in (opened(tmp_path / "run.pvtu").at(0), states.at(0), states.at(1)):
        assert np.array_equal(contents.positions[:, 0], x) and np.array_equal(contents.volumes, 1 + x)
        assert np.array_equal(contents.fields["heat"], x) and list(contents.fields) == ["heat"]


def test_links_out_of_the_folder_are_refused(tmp_path):
    (tmp_path / "in").mkdir()
    write_vtk(pd.bar(3), path=tmp_path / "out.vtu")
    try:
        os.symlink(tmp_path / "out.vtu", tmp_path / "in" / "x.vtu")
    except OSError:
        pytest.skip("this file system has no links")
    (tmp_path / "in" / "x.vtu.series").write_text('{"files": [{"name": "x.vtu", "time": 0}]}')
    with pytest.raises(ValueError, match="link that leads out of it"):
        opened(tmp_path / "in" / "x.vtu.series").at(0)


DATASET = '<DataSet timestep="1" file="a.vtu"/>'


@pytest.mark.parametrize(
    "name, body, words",
    [
        ("x.pvd", '<VTKFile type="Collection"><Collection></Collection></VTKFile>', "names none"),
        ("x.pvd", '<VTKFile type="PolyData"/>', "must hold a Collection; got type 'PolyData'"),
        ("x.pvd", "<!DOCTYPE x><VTKFile/>", "no document type"),
        ("x.pvd", "<VTKFile><Collection>", "complete and valid"),
        (
            "x.pvd",
            f'<VTKFile type="Collection"><Collection>{2 * DATASET}</Collection></VTKFile>',
            "2 parts of one time must be different files; got 1 files",
        ),
        ("x.vtu.series", "[1]", "the JSON must hold"),
        ("x.vtu.series", '{"files": [{"name": "a.vtu", "time": NaN}]}', "times must be finite"),
        ("x.vtu.series", "[" * 100000, "complete and valid"),
        ("x.pvtu", "<VTKFile/>", "must hold a PUnstructuredGrid with pieces"),
    ],
)
def test_damaged_lists_are_refused(name, body, words, tmp_path):
    (tmp_path / name).write_text(body)
    with pytest.raises(ValueError, match=words):
        opened(tmp_path / name).at(0)


def test_a_missing_file_of_a_list_is_named(tmp_path):
    (tmp_path / "x.vtu.series").write_text('{"files": [{"name": "gone.vtu", "time": 2}]}')
    states = opened(tmp_path / "x.vtu.series")
    with pytest.raises(FileNotFoundError, match=r"x\.vtu\.series names gone\.vtu"):
        states.at(0)


@pytest.mark.parametrize(
    "more, words",
    [
        ({"sets": {"a": np.zeros(3)}}, "set a must be a mask, bool of shape"),
        ({"fields": {"a": np.zeros(5, complex)}}, "field a must hold real numbers"),
        ({"fields": {"a\n": np.zeros(5)}}, "names of fields must be printable"),
        ({"fields": {"a": np.array(["x"] * 5)}}, "field a must be an array of numbers"),
        ({"fields": {"a": np.zeros((5, 0))}}, "field a must have shape"),
    ],
)
def test_fields_and_sets_that_vtk_does_not_have_are_refused(more, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        write_vtk(pd.bar(5), path=tmp_path / "x", **more)
    assert not list(tmp_path.iterdir())
