"""Every Python block of the README runs, one after the other as a reader would; its commands are what CI runs."""

import json
import re
import shlex
from pathlib import Path

import pytest

from pdjax.cli import main, parser
from pdjax.studies.paper import results

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "README.md").read_text()
SHELL = "\n".join(re.findall(r"```sh\n(.*?)```", TEXT, flags=re.S))
COMMANDS = [line for line in SHELL.splitlines() if line.startswith("pdjax ")]
SHOWN = sorted(set(re.findall(r"`(pdjax [^`]*)`", results.markdown(results.read(ROOT / "benchmarks/results", False)))))


def with_tables(text):
    """The README with the tables of benchmarks/results/paper.json between its marks."""
    begin, end = results.MARKS
    tables = results.in_readme(results.read(ROOT / "benchmarks" / "results", quick=False))
    assert begin in text and end in text
    return f"{text.split(begin)[0]}{begin}\n{tables}\n{end}{text.split(end)[1]}"


def saved(name):
    return json.loads((ROOT / "benchmarks" / "results" / f"{name}.json").read_text())


def several(values, digits=0, scale=100.0):
    """−6.6, −4.4 and −2.1"""
    words = [f"{scale * v:.{digits}f}".replace("-", "−") for v in values]
    return f"{', '.join(words[:-1])} and {words[-1]}"


def sentences():
    """What the text says in numbers, made from the files of results."""
    sheets = {name: sheet["numbers"] for name, sheet in saved("paper")["figures"].items()}
    step, bars, body = sheets["step-bar"], sheets["singular-bar"], sheets["cuboid"]
    positive = {r["strain"]: r["its positive"] for r in step["outcomes"]}
    yield f"beyond {100 * step['own critical strain, n = 100']:.4f} %, a saddle".replace("-", "−")
    yield f"{positive[-1e-4]} positive eigenvalue at −0.01 %, {positive[-1e-3]} at −0.1 %"
    yield f"{100 * bars['m = 1, tension'][-1]['printed from local']:.1f} % from the nonlinear local solution"
    kinds = {r["n"]: r["kind"] for r in bars["m = 1, compression"]}
    yield (
        f"a minimum up to {max(n for n in kinds if kinds[n] == 'minimum')} points and a saddle from"
        f" {min(n for n in kinds if kinds[n] == 'saddle')} on"
    )
    pulled, pressed = (body[f"m = 0, {side}"] for side in ("tension", "compression"))
    for key, text in (("onset", "a spacing from {} % and {} % on"), ("onset by the symbol", "says {} % and {} %")):
        yield text.format(*(f"{100 * run[key]:+.1f}".replace("-", "−") for run in (pulled, pressed)))
    cuboid = saved("cuboid")
    rates = cuboid["onset of m = 0 in compression at other rates"]
    onsets = several([rates[r]["seen"] for r in ("0.02", "0.01", "0.0025")], 1)
    foretold = several([-rates[r]["symbol"] for r in ("0.02", "0.01", "0.0025")], 1)
    yield f"it is {onsets} % against predicted {foretold} %"
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
    yield f"to {100 * cases[2, 1.0, 'Wan']['critical']['negative']:.2f} % (2D hydrostatic)".replace("-", "−")
    speed = {name: row["speed of pdjax over it"]["Numba, lattice, 2"] for name, row in saved("peers")["forces"].items()}
    yield f"pdjax has {speed['PMB, N = 3']:.2f} (bond-based), {speed['LPS, N = 3']:.2f} (LPS)"
    yield f"{speed['Silling, N = 3']:.2f} (Silling; {speed['Silling, N = 6']:.1f} at a horizon of 6)"


@pytest.mark.parametrize("sentence", list(sentences()))
def test_numbers_in_the_text_are_those_of_the_results(sentence):
    assert sentence in " ".join(TEXT.split())


def test_python_blocks_run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # a checkpoint is written
    blocks = re.findall(r"```python\n(.*?)```", TEXT, flags=re.S)
    assert len(blocks) == 5
    scope: dict = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), scope)
    said = capsys.readouterr().out
    assert "symbol: unstable" in said
    assert "\nstable\n" in said  # the diagonal's verdict
    assert "-0.0254" in said
    assert "\nTrue saddle\n" in said
    assert "\n0.121" in said and "[[0.1214" in said  # the growth measured and the symbol's
    assert "ran to its end" in said
    assert "\n(441, 3)\n" in said  # the body with a hole, by FFT


def test_the_table_of_claims_is_that_of_the_results():
    """After a new run: `python tests/documents/test_readme.py` writes the tables anew."""
    assert TEXT == with_tables(TEXT)


def test_paths_and_links_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT) + re.findall(r"`((?:benchmarks|notebooks)/[^`]*)`", TEXT):
        assert (ROOT / target).exists(), target


def test_set_up_commands_are_what_ci_runs():
    ci = (ROOT / ".ci" / "run").read_text()
    for words in ('pip install --quiet -e ".[test', "python -m pytest", "pdjax map"):
        assert words in ci
    assert 'pip install -e ".[test]" && python -m pytest' in TEXT


@pytest.mark.parametrize("command", [*COMMANDS, *SHOWN])
def test_every_command_is_one(command):
    parser().parse_args(shlex.split(command)[1:])


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(command)[1:]) == 0


if __name__ == "__main__":
    (ROOT / "README.md").write_text(with_tables(TEXT))
