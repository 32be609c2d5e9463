"""`pdjax run` of the scenes that break, at tiny sizes: the numbers, the files, and what is refused."""

import json

import numpy as np
import pytest

from pdjax.cli import main

TINY = {"spall-bar": "60", "branching-plate": "30", "kalthoff": "24"}


@pytest.mark.parametrize("scene", TINY)
def test_a_scene_runs_and_writes_its_files(scene, tmp_path, capsys):
    assert main(["run", scene, "--n", TINY[scene], "--json", "--out", str(tmp_path / "crack")]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["finished"] and out["broken_bonds"] > 0 and out["energy"]["error"] < 2e-2
    assert (tmp_path / "crack.png").stat().st_size > 10_000
    with np.load(tmp_path / "crack.npz") as kept:
        assert kept["broken_at"].shape == kept["neighbours"].shape
        assert np.isfinite(kept["broken_at"]).sum() == 2 * out["broken_bonds"]
        assert kept["damage"].shape == (len(kept["times"]), out["points"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["crack.npz", "crack.png"]


def test_a_command_says_in_words_what_broke(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "branching-plate", "--n", "30", "--model", "lps", "--stress", "14"]) == 0
    said = capsys.readouterr().out
    for words in ("first break at (0.05", "Rayleigh speed 3058 m/s", "released", "error", "wrote branching-plate"):
        assert words in said
    assert main(["run", "kalthoff", "--n", "24", "--speed", "1"]) == 0
    said = capsys.readouterr().out
    assert "no bond broke" in said and "upper notch: no crack" in said


def test_a_quick_run_is_small(tmp_path, capsys):
    assert main(["run", "spall-bar", "--quick", "--json", "--out", str(tmp_path / "bar")]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["points"] == 100
    assert abs(out["first_break"]["place"][0] - out["expected"]["place"][0]) < out["horizon"]
    assert 0 < out["first_break"]["time"] - out["expected"]["time"] < 2 * out["horizon"]


def test_wrong_arguments_are_refused(tmp_path, capsys):
    assert main(["run", "kalthoff", "--n", "50", "--out", str(tmp_path / "x")]) == 2
    assert "n must be a multiple of 4" in capsys.readouterr().err
    assert main(["run", "branching-plate", "--out", str(tmp_path / "no" / "x")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


SLOW = {"cracked-plate": "12", "double-cantilever": "6"}


@pytest.mark.parametrize("scene", SLOW)
def test_a_slow_crack_is_solved_and_writes_its_files(scene, tmp_path, capsys):
    assert main(["run", scene, "--n", SLOW[scene], "--json", "--out", str(tmp_path / "crack")]) == 0
    out = json.loads(capsys.readouterr().out)
    assert out["broken_bonds"] > 0 and 0 < out["first_break"] < 1.6
    assert abs(out["energy"]["error"]) < 1e-3  # measured 1e-5 and 2e-5
    assert (tmp_path / "crack.png").stat().st_size > 10_000
    with np.load(tmp_path / "crack.npz") as kept:
        assert np.isfinite(kept["broken_at"]).sum() == 2 * out["broken_bonds"]
        assert kept["alive"].shape == kept["broken_at"].shape


def test_the_command_of_the_cracked_plate_says_what_the_handbook_expects(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["run", "cracked-plate", "--n", "12", "--model", "bond-based"]) == 0
    said = capsys.readouterr().out
    for words in ("cracked-plate: 288 points", "first break at K =", "the handbook expects 1", "wrote cracked-plate"):
        assert words in said
