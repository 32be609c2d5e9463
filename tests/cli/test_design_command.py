"""Tests of `pdjax design`."""

import json

import pytest

from pdjax.cli import main

BAR = ["--dim", "1", "--N", "2"]


def test_the_least_penalty_of_a_bar_is_its_strain(capsys):
    """With m = 1 and N = 2 the least penalty at −5 % is the Green–Lagrange strain, (1 − 0.95²)/2."""
    assert main(["design", "penalty", *BAR, "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["rows"]
    assert row["g"] == pytest.approx(0.04875, abs=1e-12) and row["margin"] == pytest.approx(0, abs=1e-12)
    assert main(["design", "penalty", *BAR]) == 0
    assert "0.04875" in capsys.readouterr().out


def test_an_infinite_penalty_is_written_as_the_other_commands_write_infinity(tmp_path, capsys):
    """No penalty suffices for m = 1 at −30 %, beyond the load at which a long wave grows."""

    def refuse(name):
        raise AssertionError(f"{name} is not JSON")

    out = tmp_path / "penalty.json"
    assert main(["design", "penalty", *BAR, "--strain", "0.5", "--json", "--out", str(out)]) == 0
    for text in (capsys.readouterr().out, out.read_text()):
        (row,) = json.loads(text, parse_constant=refuse)["rows"]
        assert row == {"m": 1.0, "g": "inf"}


def test_a_stabiliser_is_designed_and_written(tmp_path, capsys):
    out = tmp_path / "stabiliser.json"
    assert main(["design", "stabiliser", *BAR, "--silling", "--steps", "25", "--out", str(out)]) == 0
    rows = json.loads(out.read_text())["rows"]
    designed, *published = rows
    assert designed["feasible"] and designed["margin"] < -0.02
    assert designed["phase error"] < min(row["phase error"] for row in published)
    assert f"wrote {out}" in capsys.readouterr().out


def test_no_influence_function_stabilises_a_compressed_bar(capsys):
    assert main(["design", "influence", *BAR, "--signed", "--steps", "8"]) == 0
    said = capsys.readouterr().out
    assert "(unstable)" in said and "no influence function, of either sign" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["design", "penalty", *BAR, "--path", "pull"], "path must be one of hydrostatic"),
        (["design", "penalty", *BAR, "--strain", "1.5"], "a must be > -1"),
        (["design", "penalty", *BAR, "--margin", "0.1"], "margin must be at most 0"),
        (["design", "influence", "--dim", "1", "--N", "1"], "at least two shells"),
        (["design", "stabiliser", *BAR, "--m", "0", "1"], "--m must be one order for stabiliser; got 0 1"),
        (["design", "influence", *BAR, "--m", "0", "1"], "--m must be one order for influence; got 0 1"),
        (["design", "stabiliser", *BAR, "--out", "no-such-folder/x"], "does not exist"),
    ],
)
def test_bad_input_names_its_cause(arguments, words, capsys):
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("pdjax design: ") and words in said
