"""The study of the paper on the command line: its table, interrupted runs, bad input, and the stored results."""

import json
import multiprocessing
import os
import pickle
import re
import shlex
import time
from pathlib import Path

import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

from pdjax.cli import main, parser
from pdjax.studies import paper
from pdjax.studies.paper import a_cr, cuboid, m_cr, making, maps, results, singular_bar, step_bar
from pdjax.studies.paper._common import Claim, Sheet, judge

ROOT = Path(__file__).parents[2]
SAVED = ROOT / "benchmarks" / "results"
QUESTIONS = {
    "S1": ("volume",),
    "S2": ("sums",),
    "S3": ("law",),
    "S4": ("factor",),
    "S5": ("a_cr_2d",),
    "S6": ("dTdY",),
    "S7": ("discretisation", "nonlocality"),
    "S8": ("log",),
    "S9": ("step_size", "step_region"),
    "S10": ("waves_small", "waves_large"),
    "S11": ("m_cr_3d",),
    "S12": ("strain",),
    "S13": ("inequality",),
    "S14": ("hencky",),
    "S15": ("static",),
}


# --- the table


def test_every_claim_has_a_sheet_and_a_unique_key():
    keys = [claim.key for claim in paper.CLAIMS]
    assert len(set(keys)) == len(keys)
    assert {claim.figure for claim in paper.CLAIMS} == set(paper.FIGURES)


def test_tests_named_in_the_table_exist():
    for claim in paper.CLAIMS:
        if claim.test:
            file, name = claim.test.split("::")
            assert re.search(rf"^def {name}\(", (ROOT / file).read_text(), flags=re.M), claim.test


def test_each_suspected_slip_is_a_question_with_a_test():
    by_key = {claim.key: claim for claim in paper.CLAIMS}
    asked = sorted(key for keys in QUESTIONS.values() for key in keys)
    assert asked == sorted(key for key, claim in by_key.items() if claim.question)
    assert all(by_key[key].test for key in asked)


def test_commands_in_the_table_can_be_parsed():
    for claim in paper.CLAIMS:
        program, *words = shlex.split(claim.command or "pdjax paper --figure family")
        assert program == "pdjax"
        parser().parse_args(words)  # it exits on a wrong argument


# --- functions of the sheets


def test_the_alternation_of_a_zigzag_is_its_size():
    known = np.linspace(1, 2, 400)
    zigzag = 0.01 * (-1.0) ** np.arange(400)
    wanted = np.linalg.norm(zigzag[1:-1]) / np.linalg.norm(known)  # ¼ δ² of ±ε is ∓ε
    assert abs(singular_bar.alternation(known + zigzag, known) / wanted - 1) < 1e-12  # measured 2e-15


def test_prediction_of_a_constant_rate_is_an_exponential():
    """From 1e-3 at START with γ = 2 and the rate 0.01, ONSET is exceeded where exp(200 (ε − START)) = 30."""
    strain = np.linspace(0, 0.1, 2001)
    run = {"strain": strain, "alternation over h": {"x": np.full(2001, 1e-3)}}
    _, onset = cuboid.predicted(run, np.array([2.0, 2.0]), 0.01, np.array([1e-4, 0.1]))
    assert abs(onset - (cuboid.START + np.log(30) / 200)) < 6e-5  # measured 4e-5, a save's distance is 5e-5


def test_slope_of_a_power_law_and_zero_of_a_line():
    rows = [{"free": n, "strain": -3.0 * n**-6.0} for n in (10, 20, 50, 80)]
    assert abs(step_bar.slope(rows) + 6) < 1e-12  # measured 3e-15
    orders = np.array([-1.0, 0.0, 2.0])
    assert abs(m_cr.zero(orders, 3 * orders + 1.5) + 0.5) < 1e-14  # measured 0
    with pytest.raises(RuntimeError, match="not linear"):
        m_cr.zero(orders, orders**2)


def test_general_formula_and_roots_of_the_2d_diagonal():
    """q = πN from the literal sums; a_cr is the root of 1 + q[1 − (1 + a)⁻²] with q = 2M/r and M = 28 bonds."""
    assert abs(a_cr.q_of_general_formula() - 3 * np.pi) < 1e-9  # measured 7e-15
    found = a_cr.diagonal_roots_2d()
    assert abs(found["bulk"] - ((56 / 57) ** 0.5 - 1)) < 1e-12  # measured 4e-16
    assert found["m = 0"] == -np.inf
    assert -0.037 not in a_cr.reachable_loads()


# --- the command line


def test_list_names_every_figure(capsys):
    assert main(["paper", "--list"]) == 0
    said = capsys.readouterr().out
    assert all(name in said for name in paper.FIGURES)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--figure", "fig3"], "figure must be one of family, m-cr, a-cr, maps-1d"),
        (["--figure", "family", "--out", "no/such"], "does not exist"),
        (["--figure", "family", "--out", "a-file"], "it is a file"),
        (["--quick", "--out", "damaged"], "is damaged"),
        (["--out", "quick"], "holds a --quick run"),
    ],
)
def test_bad_input_is_reported_before_any_file_is_written(arguments, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a-file").write_text("")
    for name, text in (("damaged", "{"), ("quick", json.dumps({"quick": True, "figures": {}, "claims": []}))):
        (tmp_path / name).mkdir()
        (tmp_path / name / "paper.json").write_text(text)
    before = sorted(tmp_path.rglob("*"))
    assert main(["paper", *arguments]) == 2
    assert words in capsys.readouterr().err
    assert sorted(tmp_path.rglob("*")) == before


def answer(name: str, mood: str) -> str:
    """The work given to a process in the tests below."""
    if mood == "dies":
        os._exit(1)
    if mood == "sleeps":
        time.sleep(600)
    if mood == "fails":
        raise ValueError(f"{name} fails")
    if mood == "fails to be sent":
        raise jax.errors.TracerBoolConversionError(jax.make_jaxpr(lambda x: x)(1.0))  # it cannot be unpickled
    if mood == "answers what can't be sent":
        return lambda: name
    return f"{name}, float64: {jax.config.jax_enable_x64}, {maps.LAW.lam.dtype}"


def test_processes_have_the_settings_of_the_first_process():
    jobs = {"a": ("a", ""), "b": ("b", "")}
    found = dict(making.each(answer, jobs, 2))
    assert found == {name: f"{name}, float64: True, float64" for name in jobs} == dict(making.each(answer, jobs, 1))
    assert os.environ.get("JAX_ENABLE_X64") is None


def test_no_process_is_left_when_one_does_not_start():
    with pytest.raises((AttributeError, pickle.PicklingError)):
        list(making.each(lambda: None, {"a": (), "b": ()}, 2))
    assert not multiprocessing.active_children()


def test_an_accelerator_is_used_by_one_process(monkeypatch):
    assert making.processes(9) <= making.MOST
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert making.processes(9) == 1


@pytest.mark.parametrize(
    ("mood", "error", "words"),
    [
        ("fails", ValueError, "b fails"),
        ("fails to be sent", Exception, "Tracer|Jaxpr"),
        ("answers what can't be sent", (AttributeError, pickle.PicklingError), "lambda"),
        ("dies", ChildProcessError, "made b ended without"),
    ],
)
def test_an_error_in_a_sheet_ends_the_run_and_all_processes(mood, error, words):
    with pytest.raises(error, match=words):
        list(making.each(answer, {"a": ("a", "sleeps"), "b": ("b", mood)}, 2))
    assert not multiprocessing.active_children()


@pytest.fixture
def two_sheets(monkeypatch):
    """Two cheap sheets with a claim each. The second can be told to stop."""
    made = []
    stop = {"second": False}

    def sheet(name):
        def make(quick):
            if stop.get(name):
                raise KeyboardInterrupt
            made.append((name, quick))
            figure = Figure(figsize=(2, 2))
            figure.subplots().plot([0, 1], [0, 1])
            return {"value": np.float64(2.0), "none": np.inf}, figure

        return Sheet(name, make)

    def check(numbers):
        return f"{numbers['value']:g}", judge(numbers["value"] == 2)

    sheets = {name: sheet(name) for name in ("first", "second")}
    table = tuple(Claim(name, name, "here", "2", name, check, question="Is it two?", test="t") for name in sheets)
    monkeypatch.setattr(paper, "FIGURES", sheets)
    monkeypatch.setattr(making, "processes", lambda jobs: 1)  # another process would not see the patches
    monkeypatch.setattr(results, "CLAIMS", table)
    return made, stop


def test_an_interrupted_run_continues_with_the_missing_figures(two_sheets, tmp_path, capsys):
    made, stop = two_sheets
    out = tmp_path / "out"
    stop["second"] = True
    assert main(["paper", "--quick", "--out", str(out)]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert sorted(p.name for p in out.iterdir()) == ["paper-first.png", "paper.json", "paper.md"]
    stop["second"] = False
    assert main(["paper", "--quick", "--out", str(out)]) == 0
    assert made == [("first", True), ("second", True)]  # the first is not made again
    said = capsys.readouterr().out
    assert "first: there already" in said and "2 confirmed" in said
    found = json.loads((out / "paper.json").read_text())
    assert [row["key"] for row in found["claims"]] == ["first", "second"]
    assert found["figures"]["first"]["numbers"] == {"value": 2.0, "none": "inf"}
    assert "| Is it two? | 2 | **confirmed** | `t` |" in (out / "paper.md").read_text()
    (out / "paper-first.png").unlink()
    assert main(["paper", "--quick", "--out", str(out), "--json"]) == 0
    assert made[2:] == [("first", True)]
    assert len(json.loads(capsys.readouterr().out)["claims"]) == 2


# --- the stored results


def test_stored_results_are_those_of_the_table_of_claims():
    found = results.read(SAVED, quick=False)
    assert [row["key"] for row in found["claims"]] == [claim.key for claim in paper.CLAIMS]
    assert {row["verdict"] for row in found["claims"]} <= set(paper.VERDICTS)
    assert (SAVED / "paper.md").read_text() == results.document(found)
    assert all((SAVED / record["file"]).exists() for record in found["figures"].values())


@pytest.mark.long
def test_a_quick_run_has_the_verdicts_of_the_full_one(tmp_path, capsys):
    assert main(["paper", "--quick", "--out", str(tmp_path / "q"), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["claims"]
    kept = {row["key"]: row["verdict"] for row in results.read(SAVED, quick=False)["claims"]}
    assert {row["key"]: row["verdict"] for row in rows} == kept
