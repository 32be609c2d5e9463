"""VTK files of bodies and results, animations and figures of motions."""

import importlib.util
import json
import shutil

import numpy as np
import pytest
from PIL import Image

import pdjax as pd
from pdjax.files.vtk import write_vtk


@pytest.fixture(scope="module")
def plate():
    motion = pd.scenes.wave((9, 8), 2, model=pd.SethHill(1.0, pd.LinearElastic(lam=1.0, mu=1.0)), u0=0.1, periods=1.0)
    return motion.scene, pd.simulate(motion, dt=0.5, save_every=8, show_progress=False)


@pytest.mark.skipif(importlib.util.find_spec("meshio") is None, reason="needs meshio")
def test_vtk_files_hold_the_computed_fields(plate, tmp_path):
    import meshio

    scene, history = plate
    energy = np.arange(len(history.times) * 72.0).reshape(-1, 72)
    series = write_vtk(scene, history, tmp_path / "run", {"label": energy})
    listed = json.loads(series.read_text())["files"]
    assert [f["time"] for f in listed] == history.times.tolist()
    last = meshio.read(tmp_path / listed[-1]["name"])
    assert np.array_equal(last.points[:, :2], scene.body.positions) and not last.points[:, 2].any()
    assert np.array_equal(last.point_data["displacement"][:, :2], history.u[-1])
    assert np.array_equal(last.point_data["label"].reshape(-1), energy[-1])
    assert len(list(tmp_path.iterdir())) == len(listed) + 1  # no incomplete files remain
    with pytest.raises(ValueError, match="field label must have shape"):
        write_vtk(scene, history, tmp_path / "run", {"label": energy[:2]})
    with pytest.raises(FileNotFoundError):
        write_vtk(scene, history, tmp_path / "nowhere" / "run")


MESHIO = pytest.mark.skipif(importlib.util.find_spec("meshio") is None, reason="needs meshio")


@MESHIO
def test_tensors_have_nine_components_and_vectors_three(plate, tmp_path):
    import meshio

    scene, history = plate
    stress = np.random.default_rng(0).normal(size=(len(history.times), 72, 2, 2))
    series = write_vtk(scene, history, tmp_path / "run", {"stress": stress})
    last = json.loads(series.read_text())["files"][-1]["name"]
    read = meshio.read(tmp_path / last).point_data
    whole = read["stress"].reshape(72, 3, 3)
    assert np.array_equal(whole[:, :2, :2], stress[-1]) and not whole[:, 2].any() and not whole[:, :, 2].any()
    assert read["velocity"].shape == (72, 3) and np.array_equal(read["volume"].reshape(-1), scene.body.volumes)


@MESHIO
def test_the_vtk_library_reads_the_files(plate, tmp_path):
    vtk = pytest.importorskip("vtk")
    scene, _ = plate
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(write_vtk(scene, None, tmp_path / "one", {"stress": np.zeros((72, 2, 2))})))
    reader.Update()
    data = reader.GetOutput().GetPointData()
    assert data.GetArray("stress").GetNumberOfComponents() == 9 and reader.GetOutput().GetNumberOfPoints() == 72


@MESHIO
def test_equilibria_paths_points_families_and_scenes_can_be_written(tmp_path):
    import meshio

    body = pd.lattice((6, 3))
    fams, x = pd.families(body, 2.0), body.positions[:, 0]
    model = pd.SethHill(1.0, pd.LinearElastic(1.0, 1.0))
    scene = pd.scene(body, fams, model, pd.prescribe(x < 1, 0.0), pd.prescribe(x > 5, [0.1, 0.0]))
    found = pd.solve(scene)
    read = meshio.read(write_vtk(scene, found, tmp_path / "solved")).point_data
    assert np.array_equal(read["displacement"][:, :2], found.u)
    assert np.array_equal(read["held"][:, :2].astype(bool), ~scene.free) and read["prescribed"].max() == 0.1
    along = pd.equilibrium_path(scene, states=4)
    files = json.loads(write_vtk(scene, along, tmp_path / "along").read_text())["files"]
    assert len(files) == len(along.load_factors)
    again = meshio.read(tmp_path / files[-1]["name"]).point_data["displacement"]
    assert np.array_equal(again[:, :2], along.u[-1])
    for what, name in ((body, "points"), (fams, "families"), (scene, "scene")):
        file = write_vtk(what, path=tmp_path / name)
        assert file.name == f"{name}.vtu" and "volume" in meshio.read(file).point_data
    assert np.array_equal(meshio.read(tmp_path / "families.vtu").point_data["neighbours"].reshape(-1), fams.count)


@MESHIO
@pytest.mark.parametrize(
    "call, words",
    [
        (lambda scene, path: write_vtk("scene", None, path), "body must be Scene or Points or Families"),
        (lambda scene, path: write_vtk(scene, np.zeros((72, 2)), path), "result must be"),
        (lambda scene, path: write_vtk(scene), "path must name the files"),
        (lambda scene, path: write_vtk(scene, None, path, {"a": np.zeros(3)}), "field a must have shape"),
    ],
)
def test_wrong_arguments_of_write_vtk_are_refused(plate, tmp_path, call, words):
    with pytest.raises(ValueError, match=words):
        call(plate[0], tmp_path / "x")
    assert not list(tmp_path.iterdir())


def test_a_history_without_fields_is_refused(plate, tmp_path):
    scene, _ = plate
    bare = pd.simulate(pd.motion(scene, start=scene.closed_form), 4.0, dt=0.5, fields=False, show_progress=False)
    assert bare.u.shape == (1, 72, 2) and len(bare.times) == 9
    with pytest.raises(ValueError, match="kept no fields"):
        write_vtk(scene, bare, tmp_path / "run")
    with pytest.raises(ValueError, match="kept no fields"):
        pd.figures.animation(scene, bare, tmp_path / "run.gif")


def test_animation_has_a_frame_for_every_save(plate, tmp_path):
    scene, history = plate
    path = pd.figures.animation(scene, history, tmp_path / "run.gif", component=1, scale=2.0)
    with Image.open(path) as film:
        assert film.n_frames == len(history.times)
    assert [p.name for p in tmp_path.iterdir()] == ["run.gif"]
    with pytest.raises(ValueError, match=r"path must end in \.gif or \.mp4"):
        pd.figures.animation(scene, history, tmp_path / "run.avi")
    if shutil.which("ffmpeg") is None:
        with pytest.raises(ValueError, match="needs the program ffmpeg"):
            pd.figures.animation(scene, history, tmp_path / "run.mp4")


def test_figures_of_motion_draw_the_numbers():
    k = np.linspace(0.1, 3, 5)
    branch = pd.figures.Branch("m = 1", k, np.sin(k), "-", np.array([False] * 4 + [True]))
    axes = pd.figures.dispersion_curves({"small": [branch], "large": [branch]}, "title").axes
    assert len(axes) == 2 and np.array_equal(axes[0].lines[0].get_ydata(), np.sin(k))
    assert axes[0].lines[1].get_xdata().tolist() == [3.0]  # the ringed zero
    runs = {"a": {"strain": k, "force": k**2}}
    field = {"u": np.zeros((30, 3)), "shape": (5, 3, 2), "spacing": 0.5, "name": "a"}
    figure = pd.figures.cuboid(runs, "title", field)
    assert np.array_equal(figure.axes[0].lines[0].get_xdata(), 100 * k)
    assert sum(bool(a.images) for a in figure.axes) == 3
    field["u"] = np.outer(np.linspace(0, 1, 30), [1.0, 0.5, 1e-13])  # rounding is drawn on the largest scale
    figure = pd.figures.cuboid(runs, "title", field)
    limits = {a.images[0].get_clim() for a in figure.axes if a.images}
    assert len(limits) == 1 and "zero to rounding: u_z" in figure.subfigs[1].get_suptitle()
