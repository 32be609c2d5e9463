"""Every notebook runs from top to bottom in a fresh kernel of this interpreter, to the verdicts it was saved with."""

import json
import re
import shutil
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[2] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
# Both save time: garbage is collected as rarely as in the tests, and figures are made but not drawn as PNG (a tenth of
# the time; tests/figures draws them).
KERNEL = {
    "IPKernelApp": {"exec_lines": ["import gc; gc.set_threshold(200_000, 50, 100)"]},
    "InlineBackend": {"figure_formats": []},
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A kernel specification for this very interpreter; all that a kernel writes goes to the temporary directory."""
    kernel = tmp_path / "jupyter" / "kernels" / "here"
    kernel.mkdir(parents=True)
    command = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"]
    (kernel / "kernel.json").write_text(json.dumps({"argv": command, "display_name": "here", "language": "python"}))
    profile = tmp_path / "ipython" / "profile_default"
    profile.mkdir(parents=True)
    (profile / "ipython_kernel_config.json").write_text(json.dumps(KERNEL))
    monkeypatch.setenv("JUPYTER_PATH", str(tmp_path / "jupyter"))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    (tmp_path / "work").mkdir()
    for mesh in FOLDER.glob("*.msh"):
        shutil.copy(mesh, tmp_path / "work")
    return tmp_path / "work"


def outputs(notebook):
    return [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]


def verdicts(notebook):
    """The words in bold of all tables, in order."""
    texts = [output.get("data", {}).get("text/markdown", "") for output in outputs(notebook)]
    return re.findall(r"\*\*(confirmed|corrected|refuted)\*\*", "\n".join(texts))


def test_there_are_notebooks():
    assert NOTEBOOKS


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_runs(path, here, monkeypatch):
    """At the smallest size: the saved copy is of the full one, and its verdicts are the same."""
    monkeypatch.setenv("PDJAX_QUICK", "1")
    saved = nbformat.read(path, as_version=4)
    fresh = nbformat.read(path, as_version=4)
    client = NotebookClient(fresh, timeout=600, kernel_name="here", resources={"metadata": {"path": str(here)}})
    client.execute()  # raises at the first cell that fails
    assert verdicts(fresh) and verdicts(fresh) == verdicts(saved)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_saved_copy_is_complete(path):
    """Run in order, without an error or a warning, light enough to keep."""
    saved = nbformat.read(path, as_version=4)
    nbformat.validate(saved)
    counts = [cell.execution_count for cell in saved.cells if cell.cell_type == "code"]
    assert counts == list(range(1, len(counts) + 1))
    assert all(output.output_type not in ("error", "stream") for output in outputs(saved))
    assert path.stat().st_size < 1e6
