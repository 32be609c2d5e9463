"""README.md and benchmarks/README.md say what the results say, and their Python blocks and commands work.

After a new run of `pdjax paper` or `pdjax atlas`, `python tests/documents/test_readme.py` writes the tables anew.
"""

import importlib
import json
import re
import shlex
from pathlib import Path

import pytest

import pdjax as pd
from pdjax.cli import main, parser
from pdjax.studies.paper import results

# Around the claims table in benchmarks/README.md.
MARKS = ("<!-- paper:begin -->", "<!-- paper:end -->")
ROOT = Path(__file__).parents[2]
README, STUDIES = ROOT / "README.md", ROOT / "benchmarks" / "README.md"
TEXTS = {file: file.read_text() for file in (README, STUDIES)}
MODELS = {  # row of the README's table of models → the name of the model in `pd.CATALOGUE`
    "`BondBased`": "bond-based",
    "`LPS`": "LPS",
    "`Correspondence` (Silling)": "Silling",
    "the same with `SillingControl`": "Silling + penalty",
    "`SethHill`, m = 1": "Seth–Hill 1",
    "`SethHill`, m = 1, with `SillingControl`": "Seth–Hill 1 + penalty",
    "`BondLevel`": "bond-level",
    "`BondAssociated`": "bond-associated",
}
TIMES = {  # words of the README's table of tasks → (rows of pdjax/bench/measured/start.json, digits)
    "`pd.stability`, `pdjax symbol`": (["stability, 2D"], 1),
    "`pd.critical_load`, `pdjax critical`": (["critical_load"], 1),
    "`pd.stability_map`, `pdjax map`": (["pdjax map, cold"], 0),
    "`pd.force_density`, `pd.jacobian`": (["force_density, 10³ points", "jacobian, 10³ points"], 1),
    "`pd.body_stability`": (["body_stability"], 1),
    "`pd.scene`, `pd.solve`, `pd.figures.field`": (["solve, 297 points in 3D"], 1),
    "`pd.simulate`, `pd.export.write_vtk`": (["simulate"], 1),
}


def blocks(text, language):
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.S)


def commands(text):
    """The pdjax commands of the shell blocks."""
    return [line for block in blocks(text, "sh") for line in block.splitlines() if line.startswith("pdjax ")]


TO_RUN = commands(TEXTS[STUDIES].split("\n## Commands\n")[1])
SHOWN = re.findall(r"`(pdjax [^`]*)`", results.markdown(results.read(ROOT / "benchmarks/results", False)))
ALL_COMMANDS = sorted({*SHOWN, *(line for text in TEXTS.values() for line in commands(text))})


def saved(name):
    return json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text())


def percent(value, digits=1, sign=""):
    return f"{100 * value:{sign}.{digits}f}".replace("-", "−")


def several(values, digits=0, scale=100.0):
    """−6.6, −4.4 and −2.1"""
    words = [f"{scale * v:.{digits}f}".replace("-", "−") for v in values]
    return f"{', '.join(words[:-1])} and {words[-1]}"


def with_tables(text):
    """benchmarks/README.md with what benchmarks/results/paper.json says of the claims between its marks."""
    begin, end = MARKS
    assert begin in text and end in text
    found = results.read(ROOT / "benchmarks" / "results", quick=False)
    tables = f"{len(found['claims'])} claims: {results.counts(found)}.\n\n{results.refuted(found)}"
    return f"{text.split(begin)[0]}{begin}\n{tables}\n{end}{text.split(end)[1]}"


def model_rows():
    """The rows of the README's table of models, made from benchmarks/results/atlas.json."""
    records = {r["model"]: r for r in saved("atlas")["records"] if (r["dim"], r["N"]) == (2, 3.0)}
    for words, name in MODELS.items():
        record = records[name]
        loads = [record["critical"][path]["compression"][0] for path in ("hydrostatic", "uniaxial-stress")]
        edges = " | ".join(f"{percent(a)} %" if a else "0" for a in loads)
        errors = ", ".join(f"{percent(e, 0, '+')} %" for e in record["dispersion"])
        yield f"| {words} | {edges} | {record['zero_count']} | {errors} |"


def time_cells():
    """What the README's table of tasks says of time, made from the measured rows."""
    measured = json.loads((ROOT / "pdjax" / "bench" / "measured" / "start.json").read_text())["rows"]
    seconds = {row["method"]: row["seconds"] for row in measured}
    for words, (methods, digits) in TIMES.items():
        yield words, ", ".join(f"{seconds[method]:.{digits}f} s" for method in methods)


def sentences():
    """What benchmarks/README.md says in numbers, made from the files of results."""
    sheets = {name: sheet["numbers"] for name, sheet in saved("paper")["figures"].items()}
    step, bars, body = sheets["step-bar"], sheets["singular-bar"], sheets["cuboid"]
    positive = {r["strain"]: r["its positive"] for r in step["outcomes"]}
    yield f"beyond {percent(step['own critical strain, n = 100'], 4)} %, a saddle"
    yield f"{positive[-1e-4]} positive eigenvalue at −0.01 %, {positive[-1e-3]} at −0.1 %"
    yield f"{percent(bars['m = 1, tension'][-1]['printed from local'])} % from the nonlinear local solution"
    kinds = {r["n"]: r["kind"] for r in bars["m = 1, compression"]}
    yield (
        f"a minimum up to {max(n for n in kinds if kinds[n] == 'minimum')} points and a saddle from"
        f" {min(n for n in kinds if kinds[n] == 'saddle')} on"
    )
    pulled, pressed = (body[f"m = 0, {side}"] for side in ("tension", "compression"))
    for key, text in (("onset", "a spacing from {} % and {} % on"), ("onset by the symbol", "predict {} % and {} %")):
        yield text.format(*(percent(run[key], 1, "+") for run in (pulled, pressed)))
    cuboid = saved("cuboid")
    rates = cuboid["onset of m = 0 in compression at other rates"]
    onsets = several([rates[r]["seen"] for r in ("0.02", "0.01", "0.0025")], 1)
    foretold = several([-rates[r]["symbol"] for r in ("0.02", "0.01", "0.0025")], 1)
    yield f"the onset is at {onsets} % against predicted {foretold} %"
    tension = cuboid["critical tension of the symbol in uniaxial stress over the order"]
    yield f"m = 0.75, 1.5 and 2 bear {several([tension[m] for m in ('0.75', '1.5', '2.0')])} %"
    orders = sheets["maps-2d"]["compression holds below, tension above m ="]
    words = {d: [f"{x:.4f}".replace("-", "−") for x in orders[f"{d}, N = 3"]] for d in ("2D", "3D")}
    yield "compression m < {}, tension m > {} (2D); ".format(*words["2D"]) + "m < {}, m > {} (3D)".format(*words["3D"])
    cases = {(c["dim"], c["m"], c["control"]): c for c in saved("stabilisers")["cases"]}
    needed = {name: cases[2, 1.0, name]["needed"] for name in ("penalty g", "hourglass C")}
    loads = ("-1 %", "-5 %", "-10 %")
    yield f"g = {several([needed['penalty g'][a] for a in loads], 3, 1.0)} at −1, −5 and −10 %"
    yield f"C = {several([needed['hourglass C'][a] for a in loads], 3, 1.0)}"
    yield f"to {percent(cases[2, 1.0, 'Wan']['critical']['negative'], 2)} % (2D hydrostatic)"
    peers = saved("peers")
    for name, row in peers["forces"].items():
        every, lists = row["speed over Numba in every process"], row["speed of pdjax, cloud, over it"]
        words = f"{row['speed of pdjax over it']['Numba, lattice, 2']:.2f} ({min(every):.2f} to {max(every):.2f})"
        yield f"| {name.replace('PMB', 'bond-based')} | {words} | {lists['Numba, list, 2']:.2f} |"
    rows = peers["scaling and derivatives"].values()
    for key, text in (("jvp over force", "A JVP takes {} to {} times"), ("vjp over force", "a VJP {} to {} times")):
        yield text.format(*(f"{f(row[key] for row in rows):.1f}" for f in (min, max)))
    ratios = [row["a point of the large body over one of the small"] for row in rows]
    yield f"costs there {min(ratios):.2f} to {max(ratios):.2f} times"


@pytest.mark.parametrize("sentence", list(sentences()))
def test_numbers_in_the_text_are_those_of_the_results(sentence):
    assert sentence in " ".join(TEXTS[STUDIES].split())


@pytest.mark.parametrize("row", list(model_rows()))
def test_the_table_of_models_is_that_of_the_atlas(row):
    assert row in TEXTS[README].splitlines()


@pytest.mark.parametrize(("words", "time"), list(time_cells()))
def test_the_times_of_the_tasks_are_those_measured(words, time):
    (row,) = [line for line in TEXTS[README].splitlines() if f"| {words} |" in line]
    assert row.endswith(f"| {time} |")


def test_the_readme_is_short():
    assert len(TEXTS[README].splitlines()) <= 150
    assert len(TEXTS[README].split()) <= 1500


def run(source, scope):
    for block in blocks(source, "python"):
        exec(compile(block, "README.md", "exec"), scope)


def test_the_examples_print_what_the_readme_shows(capsys, monkeypatch):
    monkeypatch.chdir(ROOT)  # the second example reads a mesh of the repository
    examples, shown = blocks(TEXTS[README], "python"), blocks(TEXTS[README], "text")
    assert len(examples) == 2 and all(len(example.splitlines()) <= 12 for example in examples)
    run(TEXTS[README], {})
    assert capsys.readouterr().out == "".join(shown)


def test_python_blocks_of_the_studies_run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a checkpoint is written
    assert len(blocks(TEXTS[STUDIES], "python")) == 5
    run(TEXTS[STUDIES], {})
    said = capsys.readouterr().out
    assert "symbol: unstable" in said
    assert "-0.0254" in said
    assert "\nTrue saddle\n" in said
    assert "\n0.121" in said and "[[0.1214" in said  # the growth measured and the symbol's
    assert "ran to its end" in said
    assert "\n(441, 3)\n" in said  # the body with a hole, by FFT


def test_the_table_of_claims_is_that_of_the_results():
    assert TEXTS[STUDIES] == with_tables(TEXTS[STUDIES])


def anchor(heading):
    """The address that GitHub gives to a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("file", TEXTS, ids=["README.md", "benchmarks/README.md"])
def test_paths_and_links_exist(file):
    text = TEXTS[file]
    for target in re.findall(r"`((?:benchmarks|notebooks|pdjax|tests)/[^`]*\.\w+)`", text):
        assert "NAME" in target or (ROOT / target).exists(), target
    for target in re.findall(r"`(results/[^`]*\.\w+)`", text):
        assert "NAME" in target or (ROOT / "benchmarks" / target).exists(), target
    for target in re.findall(r"\]\(([^)]+)\)", text):
        path, _, place = target.partition("#")
        linked = (file.parent / path).resolve() if path else file
        assert linked.exists(), target
        if place:
            assert place in {anchor(h) for h in re.findall(r"^#+ (.*)$", linked.read_text(), flags=re.M)}, target


def test_the_notebooks_of_the_tasks_exist():
    table = TEXTS[README].split("\n## What you can do\n")[1].split("\n## ")[0]
    named = {
        name
        for line in table.splitlines()
        if line.startswith("| ")
        for name in re.findall(r"`(\w+)`", line.split(" | ")[2])
    }
    assert named and named <= {path.stem for path in (ROOT / "notebooks").glob("*.ipynb")}


@pytest.mark.parametrize("file", TEXTS, ids=["README.md", "benchmarks/README.md"])
def test_public_names_in_the_text_exist(file):
    for dotted in set(re.findall(r"\bpd\.([A-Za-z_][\w.]*\w)", TEXTS[file])):
        found = pd
        for name in dotted.split("."):
            found = getattr(found, name)


TABLES = {
    "CATALOGUE": "models.catalogue",
    "CRITERIA": "infinite_lattice.criteria",
    "PATHS": "infinite_lattice.paths",
    "BACKENDS": "force.operator",
    "READERS": "files.read",
    "POINT_CHECKS": "trust.checks",
    "COMMANDS": "cli",
}


def test_the_tables_that_additions_go_into_exist():
    named = re.findall(r" `([A-Z_]+)`", TEXTS[README].split("## Contribute")[1].split("##")[0])
    assert sorted(named) == sorted([*TABLES, "MODELS"])
    for table, module in TABLES.items():
        assert len(getattr(importlib.import_module(f"pdjax.{module}"), table)) > 2


def test_set_up_commands_are_what_ci_runs():
    ci = (ROOT / ".ci" / "run").read_text()
    for words in ('pip install --quiet -e ".[test', "python -m pytest", "pdjax map"):
        assert words in ci
    assert 'pip install -e ".[test]" && python -m pytest' in TEXTS[README]


@pytest.mark.parametrize("command", ALL_COMMANDS)
def test_every_command_is_one(command):
    parser().parse_args(shlex.split(command, comments=True)[1:])


@pytest.mark.long
@pytest.mark.parametrize("command", TO_RUN)
def test_every_command_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(command)[1:]) == 0


if __name__ == "__main__":
    STUDIES.write_text(with_tables(TEXTS[STUDIES]))
    print("the rows of the README's table of models are", *model_rows(), sep="\n")
