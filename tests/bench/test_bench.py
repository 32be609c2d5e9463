"""The harness of the benchmarks with a tiny case: its files, their continuation and refusal; and `advise`."""

import json
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

import pdjax as pd
from pdjax.bench import cases, device, start
from pdjax.bench.chart import error_against_time
from pdjax.bench.first_calls import CALLS, MAIN
from pdjax.bench.harness import Case, Task, counted, kernel, run_case
from pdjax.cli import main


def tiny(counts, fail_at=None, error=KeyboardInterrupt, **settings):
    """Make a case of three rows. It appends each measured row to `counts`, and raises `error` at the row `fail_at`."""

    def measure(n):
        if n == fail_at:
            raise error
        counts.append(n)
        _, row = kernel(lambda x: jnp.sum(x * x), jnp.ones(n))
        return row | {"error": 10.0**-n}

    def plan(quick):
        return [Task("sum", {"n": n}, lambda n=n: measure(n)) for n in (1, 2, 3)]

    return Case("a tiny case", plan, lambda rows: error_against_time(rows, "tiny", "error  [–]"), settings)


def silent(_):
    """Print nothing."""


def test_a_row_holds_times_and_the_counts_of_the_compiler():
    A = jnp.ones((64, 64))
    result, row = kernel(lambda A, B: A @ B, A, A + 0)
    assert np.all(np.asarray(result) == 64)
    assert row["flops"] == pytest.approx(2 * 64**3, rel=0.02)  # measured: equal
    assert row["bytes"] == 3 * 64 * 64 * 8
    assert row["fastest"] <= row["seconds"] <= row["slowest"] and row["compile_seconds"] > 0
    assert row["spread"] == pytest.approx((row["slowest"] - row["fastest"]) / row["seconds"])


def test_counts_are_none_where_the_backend_does_not_count():
    class Mute:
        cost_analysis = memory_analysis = lambda self: None

    assert counted(Mute()) == {"bytes": None, "flops": None, "temporary_bytes": None}


def test_an_interrupted_run_continues_with_the_missing_rows(tmp_path):
    done = []
    with pytest.raises(KeyboardInterrupt):
        run_case("tiny", tiny(done, fail_at=3), tmp_path, False, silent)
    assert done == [1, 2] and [p.name for p in tmp_path.iterdir()] == ["tiny.json"]
    record = run_case("tiny", tiny(done), tmp_path, False, silent)
    assert done == [1, 2, 3] and [row["settings"]["n"] for row in record["rows"]] == [1, 2, 3]
    assert json.loads((tmp_path / "tiny.json").read_text()) == record
    assert (tmp_path / "tiny.png").stat().st_size > 5_000
    run_case("tiny", tiny(done), tmp_path, False, silent)
    assert done == [1, 2, 3]  # no row is measured twice
    run_case("tiny", tiny(done), tmp_path, True, silent)
    assert done == [1, 2, 3, 1, 2, 3] and (tmp_path / "tiny-quick.json").exists()  # quick rows are separate


@pytest.mark.parametrize("what", ["machine", "settings", "damaged"])
def test_a_file_of_another_machine_or_settings_is_refused_and_kept(what, tmp_path):
    run_case("tiny", tiny([]), tmp_path, False, silent)
    file, settings = tmp_path / "tiny.json", {}
    record = json.loads(file.read_text())
    if what == "machine":
        record["machine"]["cpu"] = "Z80"
    file.write_text(json.dumps(record) if what != "damaged" else '{"rows": ')
    before = file.read_text()
    if what == "settings":
        settings = {"load": 2}
    words = {"machine": "'Z80' there", "settings": "load None there, 2 here", "damaged": "is not a result"}[what]
    with pytest.raises(ValueError, match=words):
        run_case("tiny", tiny([], **settings), tmp_path, False, silent)
    assert file.read_text() == before


def test_a_row_that_cannot_be_measured_is_reported_and_the_run_continues(tmp_path, monkeypatch, capsys):
    def needs_numba(quick):
        raise ModuleNotFoundError("No module named 'numba'", name="numba")

    done = []
    table = {
        "peer": Case("needs a package", needs_numba, str),
        "tiny": tiny(done, fail_at=2, error=MemoryError("64 GiB")),
    }
    monkeypatch.setattr(cases, "CASES", table)
    assert main(["bench", "--out", str(tmp_path / "new" / "folder")]) == 0
    said = capsys.readouterr().out
    assert "peer: the whole case left out: needs the package numba" in said
    assert "tiny: sum, n = 2, float64 left out: 64 GiB" in said
    assert done == [1, 3]
    assert sorted(p.name for p in (tmp_path / "new" / "folder").iterdir()) == ["tiny.json", "tiny.png"]


def test_a_refused_file_does_not_stop_the_other_cases(tmp_path, monkeypatch, capsys):
    done = []
    monkeypatch.setattr(cases, "CASES", {"first": tiny([]), "second": tiny(done)})
    (tmp_path / "first.json").write_text("no")
    assert main(["bench", "--out", str(tmp_path)]) == 2
    assert "first.json is not a result" in capsys.readouterr().err
    assert done == [1, 2, 3]


def test_the_list_names_every_case_and_a_wrong_name_is_refused(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["bench", "--list"]) == 0
    said = capsys.readouterr().out
    assert all(f"{name} " in said and case.about in said for name, case in cases.CASES.items())
    assert main(["bench", "jacobian"]) == 2
    assert "there is no case jacobian; there are" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_device_report_gives_fractions_of_the_measured_rates(tmp_path):
    def save(name, rows):
        (tmp_path / f"{name}.json").write_text(json.dumps({"machine": {}, "settings": {}, "rows": rows}))

    save(
        "roofs",
        [{"method": m, "dtype": d, "rate": r} for m, r in (("triad", 1e9), ("matmul", 1e10)) for d in device.DTYPES],
    )
    row = {"method": "work", "dtype": "float64", "seconds": 0.5, "bytes": 1e8, "flops": 1e9, "settings": {"n": 7}}
    save("other", [row, {**row, "bytes": None}])
    device.report(tmp_path, False)
    lines = (tmp_path / "device-report.txt").read_text().splitlines()
    assert lines[0] == "triad float64: 1.0 GB/s"
    assert [line.split()[:3] for line in lines[6:]] == [["0.200", "0.2000", "0.5"]]  # 1e8/0.5/1e9, 1e9/0.5/1e10


LARGE = [name for name in cases.CASES if name not in ("start", device.ROOFS, "jacobians", "ways")]


@pytest.mark.parametrize("name", ["jacobians", "ways", *(pytest.param(n, marks=pytest.mark.long) for n in LARGE)])
def test_every_method_of_a_case_gives_an_accurate_row(name):
    """The first planned task of each method runs at a small size, and its error is small."""
    kinds = {}
    for task in cases.CASES[name].plan(True):
        kinds.setdefault(task.method, task)
    kinds.pop("complex step", None)  # the type checks of the tests accept real numbers only
    for task in kinds.values():
        row = task.measure()
        assert row["seconds"] > 0 and row["error"] is not None
        assert row["error"] < {"jacobians": 1e-2, "ways": 1e-13}.get(name, 10)  # 3e-3 (the largest step); 2e-15


def test_first_calls_are_medians_over_processes_and_have_cached_and_later_times(tmp_path, monkeypatch):
    """The processes are replaced: they report 1, 2, 3 ... seconds, and 0.5 s for the trivial program."""
    asked = []

    def process(arguments, kept, folder=None):
        asked.append((arguments, kept))
        names = [name for name in arguments if name in CALLS]
        told = {"programs": 2, "lines": 30} if "--count" in arguments else {}
        told |= {"unit": 0.5, "first": float(len(asked)), "second": 0.01}
        return 7.0, "\n".join(json.dumps({"name": name, **told}) for name in names)

    monkeypatch.setattr(start, "_run", process)
    row = start.answered(("simulate",), quick=False)["simulate"]
    assert [kept is None for _, kept in asked] == [False] * 3 + [True] * 5  # a count, 2 with the cache, 5 without
    assert (row["seconds"], row["fastest"], row["slowest"]) == (6.0, 4.0, 8.0)  # of the fourth process to the eighth
    assert (row["in_units"], row["cached_seconds"], row["second_seconds"]) == (12.0, 2.5, 0.01)
    assert (row["programs"], row["lines"], row["compile_seconds"]) == (2, 30, pytest.approx(5.99))
    asked.clear()
    record = run_case("start", start.CASE, tmp_path, True, silent)
    assert [row["method"] for row in record["rows"]][: len(CALLS)] == list(CALLS)
    assert {row["seconds"] for row in record["rows"][len(CALLS) :]} == {7.0}
    assert len(asked) == 3 * (len(MAIN) + 1) + 4 * 6 + 2  # small calls share processes; imports; a map twice
    assert (tmp_path / "start-quick.png").stat().st_size > 20_000


ROWS = {
    "slow": {"n": 400, "N": 3, "seconds": 2.0, "error": 1e-3},
    "middle": {"n": 100, "N": 3, "seconds": 0.5, "error": 1e-2},
    "fast": {"n": 50, "N": 1, "seconds": 0.1, "error": 1e-1},
    "none": {"n": 10, "N": 1, "seconds": 0.01, "error": None},
}


def measured(folder, name="statics", cpu="abacus", **changes):
    """Write a file of four rows, as `pdjax bench` does."""
    rows = [
        {
            "method": method,
            "settings": {"scene": "singular-bar", "n": row["n"], "N": row["N"]},
            "dtype": "float64",
            "seconds": row["seconds"],
            "error": row["error"],
        }
        for method, row in ROWS.items()
    ]
    (folder / f"{name}.json").write_text(json.dumps({"machine": {"cpu": cpu}, "settings": {}, "rows": rows}))


@pytest.fixture(scope="module")
def step_bar():
    return pd.scenes.step_size_bar(20)


def test_advice_is_the_fastest_row_that_meets_the_tolerance(step_bar, tmp_path):
    measured(tmp_path)
    found = pd.advise("singular-bar", 0.05, data=tmp_path)
    assert (found.method, found.error, found.seconds) == ("middle", 1e-2, 0.5)
    assert found.settings == {"n": 100, "N": 3, "dtype": "float64"}
    assert [row["method"] for row in found.evidence] == ["fast", "middle", "slow"]
    assert "middle, n = 100, N = 3, dtype = float64" in repr(found) and "on abacus" in repr(found)
    assert "4 × the time: slow, n = 400" in repr(found) and "fast" not in repr(found)
    assert pd.advise("singular-bar", 0.5, data=tmp_path).method == "fast"
    assert pd.advise(replace(step_bar, name="singular bar"), 1e-3, data=tmp_path).settings["n"] == 400  # by name


def test_advice_is_refused_with_the_scenes_and_the_best_row(step_bar, tmp_path):
    measured(tmp_path)
    with pytest.raises(ValueError, match=r"best of 3 is slow, n = 400, N = 3, dtype = float64, error 1.00e-03 in"):
        pd.advise("singular-bar", 1e-4, data=tmp_path)
    with pytest.raises(ValueError, match=r"no measurements of a scene 'step-size-bar'; there are\n  singular-bar:"):
        pd.advise(step_bar, 0.1, data=tmp_path)
    with pytest.raises(ValueError, match="holds no rows of wave: measure them with pdjax bench"):
        pd.advise("wave", 0.1, data=tmp_path)
    with pytest.raises(ValueError, match="tol must be a finite number > 0"):
        pd.advise("wave", 0.0, data=tmp_path)
    measured(tmp_path, "other", cpu="slide rule")
    with pytest.raises(ValueError, match="from 2 machines, whose times can't be compared: slide rule, abacus"):
        pd.advise("singular-bar", 0.05, data=tmp_path)


def test_advice_over_several_loads_counts_the_largest_error(tmp_path):
    """A criterion that is accurate at one load by chance is not recommended, nor one that lacks a load."""
    rows = [
        {"method": m, "settings": {"scene": "critical-load", "load": a}, "dtype": "float64", "seconds": s, "error": e}
        for m, a, s, e in (("lucky", "a", 0.1, 1e-4), ("lucky", "b", 0.1, 0.9), ("sure", "a", 1.0, 1e-3),
                           ("sure", "b", 3.0, 1e-4), ("alone", "a", 0.1, 1e-4))
    ]  # fmt: skip
    (tmp_path / "criteria.json").write_text(json.dumps({"machine": {"cpu": "abacus"}, "settings": {}, "rows": rows}))
    found = pd.advise("critical-load", 1e-2, data=tmp_path)
    assert (found.method, found.error, found.seconds) == ("sure", 1e-3, 2.0)
