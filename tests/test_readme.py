"""Every Python block of the README runs, one after the other as a reader would; its commands are what CI runs."""

import re
from pathlib import Path

from pdjax.paper import results

ROOT = Path(__file__).parent.parent
TEXT = (ROOT / "README.md").read_text()


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
    """Between the markers stands the first table of benchmarks/results/paper.md: copy it there after a new run."""
    block = re.search(r"<!-- paper:begin -->\n(.*?)\n<!-- paper:end -->", TEXT, flags=re.S)
    assert block is not None
    assert block.group(1).strip() == results.markdown(results.read(ROOT / "benchmarks" / "results", quick=False))


def test_paths_and_links_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT) + re.findall(r"`((?:benchmarks|notebooks)/[^`]*)`", TEXT):
        assert (ROOT / target).exists(), target


def test_set_up_commands_are_what_ci_runs():
    ci = (ROOT / ".ci" / "run").read_text()
    for words in ('pip install --quiet -e ".[test', "python -m pytest", "pdjax map"):
        assert words in ci
    assert 'pip install -e ".[test]" && python -m pytest' in TEXT
