"""The commands, run in process, write their files, tables and JSON; errors name the cause and leave no file."""

import errno
import json

import numpy as np
import pytest

from pdjax import StabilityMap
from pdjax.cli import main

SMALL = ["map", "--m=-1:2:4", "--a=-0.1:0.1:3"]


def test_map_writes_figure_data_and_table(tmp_path, capsys):
    assert main([*SMALL, "--out", str(tmp_path / "small")]) == 0
    said = capsys.readouterr().out
    assert (tmp_path / "small.png").stat().st_size > 10_000
    grid = StabilityMap.load(tmp_path / "small.npz")
    assert grid.verdict.tolist()[2] == ["unstable", "marginal", "stable"]  # m = 1
    assert grid.settings["law"] == "LinearElastic(lam=1, mu=1)"
    assert "-0.0254" in said  # m = 1, diagonal
    assert "60.1%" not in said  # the shares belong to this map, not to the default map
    assert sorted(p.name for p in tmp_path.iterdir()) == ["small.npz", "small.png"]


def test_json_is_one_object(tmp_path, capsys):
    assert main(["critical", "--dim", "1", "--m", "1", "--criterion", "diagonal", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["critical_loads"]
    loads = {row["side"]: row["a_cr"] for row in rows}
    assert loads["negative"] == pytest.approx(-0.0741799, abs=1e-6)  # the paper's -0.074
    assert loads["positive"] == "inf"


def test_critical_loads_are_proved_on_request(capsys):
    arguments = ["critical", "--dim", "1", "--m", "1", "--criterion", "symbol", "--certify"]
    assert main([*arguments, "--json"]) == 0
    proofs = {row["side"]: row for row in json.loads(capsys.readouterr().out)["proofs"]}
    assert all(row["proved"] for row in proofs.values())
    assert proofs["negative"]["verdict"] == "proved unstable at once"
    assert proofs["positive"]["verdict"] == "proved stable at every load up to the limit"
    assert main(arguments) == 0
    assert "m = 1, positive loads, a = none: proved stable at every load" in capsys.readouterr().out


def test_signs_of_a_map_are_proved_on_request(tmp_path, capsys):
    map_ = ["map", "--dim", "1", "--m=0:1:2", "--a=-0.1:0.1:4", "--out", str(tmp_path / "map")]
    assert main([*map_, "--certify"]) == 0
    assert "proved: 50.0% stable, 50.0% unstable, 0.0% open" in capsys.readouterr().out
    assert main([*map_, "--certify", "0.01", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["proved"] == {"stable": 0.5, "unstable": 0.5, "open": 0.0}
    assert main([*map_, "--certify", "0"]) != 0
    assert "tol must be" in capsys.readouterr().err


def test_symbol_prints_the_result_of_the_library(tmp_path, capsys):
    out = tmp_path / "spectrum.png"
    assert main(["symbol", "--m", "0", "--a=-0.02", "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "unstable"
    assert said["eigenvalue"] == pytest.approx(0.0420924, abs=1e-6)
    assert np.isclose(np.linalg.norm(said["mode"]), 1)
    assert out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["map", "--N", "0.5"], "N (horizon / spacing)"),
        (["map", "--N", "1"], "invertible shape tensor"),
        (["map", "--a=-1.2:0:5"], "a must be > -1"),
        (["map", "--m=nan:1:3"], "m must be finite"),
        (["map", "--out", "no-such-folder/x"], "does not exist"),
        (["critical", "--criterion", "norm"], "criterion must be one of"),
        (["symbol", "--a=-1.5"], "a must be > -1"),  # in 2D this is a half-turn with det F > 0
        (["symbol", "--resolution", "1"], "resolution must be"),
        (["run", "step-bar", "--strain=-1"], "strain must be finite and > -1"),
        (["run", "step-bar", "--n", "12"], "n must be a whole number >= 13"),
        (["run", "step-bar", "--method", "guess"], "method must be one of"),
        (["run", "singular-bar", "--stress=-0.5"], "no local equilibrium at the loaded end"),
        (["run", "singular-bar", "--model", "rubber"], "model must be one of"),
        (["run", "singular-bar", "--out", "no-such-folder/x"], "does not exist"),
        (["run", "wave", "--n", "6", "--j", "2"], "longer than two horizons"),
        (["run", "wave", "--j", "1", "2"], "--j takes at most 1 numbers in 1D"),
        (["run", "wave", "--j", "2", "--dt=-1"], "dt must be finite and > 0"),
        (["run", "wave", "--animate", "nowhere/x.gif"], "does not exist"),
        (["run", "cuboid", "--shape", "6", "2", "2"], "more than 12 cells"),
        (["run", "cuboid", "--rate", "0"], "rate must be"),
    ],
)
def test_bad_input_prints_an_error_and_leaves_no_file(arguments, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["map", "--m", "abc"], ["map", "--dim", "4"], []])
def test_wrong_arguments_print_the_usage(arguments, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert "usage: pdjax" in capsys.readouterr().err


def test_an_interrupted_map_keeps_the_old_file(tmp_path, capsys, monkeypatch):
    """After an interrupt the exit code is 130, and the file of the last run is unchanged."""
    import pdjax.infinite_lattice.maps

    old = tmp_path / "small.npz"
    old.write_bytes(b"old")
    monkeypatch.setattr(pdjax.infinite_lattice.maps, "_few_states", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    assert main([*SMALL, "--out", str(tmp_path / "small")]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert old.read_bytes() == b"old"


def test_run_step_bar_prints_a_minimum_and_a_saddle(tmp_path, capsys):
    assert main(["run", "step-bar", "--strain", "1", "-0.0001", "--out", str(tmp_path / "bar")]) == 0
    said = capsys.readouterr().out
    assert "a minimum: largest eigenvalue -65.78, 0 positive" in said
    assert "a saddle: largest eigenvalue +0.1622, 1 positive" in said
    arrays = np.load(tmp_path / "bar.npz")
    assert np.allclose(arrays["seth-hill 1 u"], arrays["seth-hill 1 known"], atol=1e-12)  # measured 1e-16
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bar.npz", "bar.png"]


def test_run_singular_bar_in_json(tmp_path, capsys):
    arguments = ["run", "singular-bar", "--n", "60", "--stress", "1e-3", "--out", str(tmp_path / "bar"), "--json"]
    assert main(arguments) == 0
    cases = json.loads(capsys.readouterr().out)["cases"]
    assert [c["model"] for c in cases] == ["seth-hill", "correspondence"]
    assert all(c["converged"] and c["kind"] == "minimum" for c in cases)
    assert cases[0]["distance"] < 0.5 * cases[1]["distance"]  # measured 0.12 and 0.38
    assert (tmp_path / "bar.png").stat().st_size > 10_000


def test_run_wave_measures_the_growth_rate_of_the_symbol(tmp_path, capsys):
    arguments = [
        "run",
        "wave",
        "--a=-0.01",
        "--n",
        "16",
        "--j",
        "8",
        "--branch",
        "0",
        "--out",
        str(tmp_path / "w"),
        "--json",
    ]
    assert main(arguments) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["kind"] == "growing mode" and said["finished"]
    assert said["symbol"]["growth"] == pytest.approx(0.1214115, abs=1e-6)
    assert said["measured"]["growth"] == pytest.approx(said["symbol"]["growth"], rel=1e-2)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["w.npz", "w.png"]


def test_run_cuboid_prints_how_it_ended_and_resumes_from_its_checkpoint(tmp_path, capsys):
    arguments = ["run", "cuboid", "--shape", "9", "3", "3", "--N", "2", "--strain=-0.02", "--rate", "0.01"]
    keep = ["--checkpoint", str(tmp_path / "keep"), "--out", str(tmp_path / "c")]
    assert main([*arguments, *keep]) == 0
    said = capsys.readouterr().out
    assert "ran to its end" in said and "alternation between neighbours" in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["c.npz", "c.png", "keep--0.02.npz"]
    force = np.load(tmp_path / "c.npz")["strain -0.02 force"]
    assert main([*arguments, *keep]) == 0  # the checkpoint holds the finished run, so the numbers are equal
    assert np.array_equal(np.load(tmp_path / "c.npz")["strain -0.02 force"], force)


@pytest.mark.parametrize("dt", ["10", "4.6"])
@pytest.mark.filterwarnings("ignore:dt =")
def test_a_wave_above_the_critical_step_is_reported_and_saved(dt, tmp_path, capsys):
    """A run that diverges after too few saves for a rate still prints its end and writes its files."""
    assert main(["run", "wave", "--dt", dt, "--out", str(tmp_path / "w")]) == 0
    said = capsys.readouterr().out
    assert "is above the critical step" in said and "measured:" not in said
    assert sorted(p.name for p in tmp_path.iterdir()) == ["w.npz", "w.png"]


def test_a_full_disk_loses_no_numbers(tmp_path, capsys, monkeypatch):
    """Numbers are printed before files are written, arrays before the picture, and the error names the file."""
    from matplotlib.figure import Figure

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Figure, "savefig", full)
    assert main(["run", "wave", "--out", str(tmp_path / "w"), "--json"]) == 2
    said = capsys.readouterr()
    assert json.loads(said.out)["finished"]
    assert f"could not write {tmp_path / 'w.png'}: No space left on device" in said.err
    assert [p.name for p in tmp_path.iterdir()] == ["w.npz"]


def test_an_animation_that_cannot_be_written_is_refused_before_the_run(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda _: None)
    assert main(["run", "wave", "--animate", str(tmp_path / "w.mp4"), "--out", str(tmp_path / "w")]) == 2
    assert "needs the program ffmpeg" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_large_map_shows_a_first_picture_of_every_fourth_state(tmp_path, capsys, monkeypatch):
    import pdjax as pd
    from pdjax.cli import map as command

    seen = []

    def quick(m, a, save=None, **_):
        seen.append((len(m), len(a), (tmp_path / "large.png").exists()))
        margin = np.add.outer(m, a)
        grid = StabilityMap(
            m, a, np.array([3.0]), margin, margin, 0 * margin, m, a, {}, {"criterion": "symbol", "dim": 2}
        )
        grid.settings.update(law="none", path="hydrostatic", influence="constant_influence", resolution=[8])
        return grid

    monkeypatch.setattr(pd, "stability_map", quick)
    monkeypatch.setattr(command, "critical_rows", lambda *_: [])
    assert main(["map", "--m=-1:2:160", "--a=-0.1:0.1:161", "--out", str(tmp_path / "large")]) == 0
    assert seen == [(40, 41, False), (160, 161, True)]
    assert "coarse preview, 1640 states, in" in capsys.readouterr().err


def test_a_map_of_one_order_ends_with_a_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["map", "--m=1:1:1", "--a=-.1:.1:3", "--out", "row"]) == 0
    assert (tmp_path / "row.png").stat().st_size > 0


def test_a_value_with_a_minus_sign_is_explained(capsys):
    with pytest.raises(SystemExit):
        main(["map", "--m", "-2:2:41"])
    assert "before a minus sign write =" in capsys.readouterr().err
