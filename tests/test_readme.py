"""Every Python block of the README runs, one after the other as a reader would; its commands are what CI runs."""

import re
import shlex
from pathlib import Path

import pytest

from pdjax.__main__ import _parser, main
from pdjax.paper import results

ROOT = Path(__file__).parent.parent
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
    """After a new run: `python tests/test_readme.py` writes the tables anew."""
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
    _parser().parse_args(shlex.split(command)[1:])


@pytest.mark.long
@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_runs(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(command)[1:]) == 0


if __name__ == "__main__":
    (ROOT / "README.md").write_text(with_tables(TEXT))
