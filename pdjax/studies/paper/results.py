"""The results of the figures of the paper: `paper.json`, updated after each figure, and `paper.md`, its tables.

figures   name → file, seconds, quick, numbers of the sheet
claims    one row each: key, claim, where, paper, ours, verdict, command, figure, question, test
"""

import json
import platform
from pathlib import Path

import jax
import numpy as np

from ..._internal.checks import written_whole
from ..._internal.version import VERSION
from ...figures import table
from .claims import CLAIMS

_HEAD = ("claim", "where", "paper", "ours", "verdict", "command that shows it")


def picture(out: Path, name: str) -> Path:
    """Path of the picture of a sheet."""
    return out / f"paper-{name}.png"


def read(out: Path, quick: bool) -> dict:
    """The results of an earlier run in the directory, or empty ones. ValueError if that run had other sizes."""
    file = out / "paper.json"
    fresh = {"quick": quick, "machine": _machine(), "figures": {}, "claims": []}
    if not file.exists():
        return fresh
    try:
        found = json.loads(file.read_text())
        was = bool(found["quick"])
        found["figures"], found["claims"] = dict(found["figures"]), list(found["claims"])
    except (json.JSONDecodeError, KeyError, TypeError, ValueError, UnicodeDecodeError) as error:
        raise ValueError(f"{file} is not a result of pdjax paper, or is damaged: {error}; move it away") from None
    if was != quick:
        kinds = ("a full run", "a --quick run")
        raise ValueError(f"{out} holds {kinds[was]}; for {kinds[quick]} name another directory with --out")
    return found


def finished(found: dict, out: Path, name: str) -> bool:
    """Whether a sheet is complete with all its claims, made by this version."""
    mine = [row["key"] for row in found["claims"] if row["figure"] == name]
    wanted = [claim.key for claim in CLAIMS if claim.figure == name]
    made = found["figures"].get(name, {}).get("version")
    return made == VERSION and picture(out, name).exists() and mine == wanted


def keep(found: dict, name: str, record: dict, numbers: dict) -> None:
    """Add a finished sheet and the rows of its claims to the results, in the order of the table."""
    rows = {row["key"]: row for row in found["claims"]}
    rows |= {claim.key: claim.row(numbers) for claim in CLAIMS if claim.figure == name}
    figures = {**found["figures"], name: {**record, "version": VERSION, "numbers": plain(numbers)}}
    order = [claim.figure for claim in CLAIMS if claim.figure in figures]
    found["figures"] = {known: figures[known] for known in dict.fromkeys([*order, *figures])}
    found["claims"] = [rows[claim.key] for claim in CLAIMS if claim.key in rows]


def write(found: dict, out: Path) -> None:
    """Write both files. Each is written completely or not at all."""
    with written_whole(out / "paper.json") as stream:
        stream.write((json.dumps(found, ensure_ascii=False, indent=1) + "\n").encode())
    with written_whole(out / "paper.md") as stream:
        stream.write(document(found).encode())


def markdown(found: dict) -> str:
    """The table of all claims in Markdown, from the results."""
    return table(_HEAD, _cells(found["claims"], "claim", "where", "paper", "ours", "verdict", "command"))


def verdicts(figure: str, numbers: dict, leave: tuple[str, ...] = ()) -> str:
    """A table of the claims that the numbers of a sheet decide, without those whose keys are in `leave`."""
    rows = [claim.row(numbers) for claim in CLAIMS if claim.figure == figure and claim.key not in leave]
    head = ("claim", "where", "paper", "ours", "verdict")
    return table(head, _cells(rows, *head))


def refuted(found: dict) -> str:
    """A short table of the refuted claims."""
    rows = [row for row in found["claims"] if row["verdict"] == "refuted"]
    return table(("refuted", "paper", "exact"), _cells(rows, "claim", "paper", "ours"))


def questions(found: dict) -> str:
    """The steps of the derivation and the open conclusions, each with its answer and the test that checks it."""
    rows = [row for row in found["claims"] if row["question"]]
    head = ("question", "answer", "the paper's statement is", "tested by")
    return table(head, _cells(rows, "question", "ours", "verdict", "test"))


def document(found: dict) -> str:
    """The text of paper.md."""
    size = "a --quick run, reduced sizes" if found["quick"] else "full sizes"
    pictures = "\n".join(f"![{name}]({record['file']})" for name, record in found["figures"].items())
    return (
        f"# The paper, claim by claim ({size})\n\n{markdown(found)}\n\n"
        f"## Steps of the derivation and open conclusions\n\n{questions(found)}\n\n## Figures\n\n{pictures}\n"
    )


def _cells(rows: list[dict], *parts: str) -> list[list[str]]:
    """The named parts of each row as a table shows them: verdicts in bold, commands and tests as code."""
    dress = {"verdict": "**{}**", "command": "`{}`", "test": "`{}`"}
    return [[dress.get(part, "{}").format(row[part]) for part in parts] for row in rows]


def counts(found: dict) -> str:
    """The number of claims with each verdict, in words."""
    words = [row["verdict"] for row in found["claims"]]
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))


def plain(value):
    """Numbers as JSON can hold them: infinity and NaN become words."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    return value


def _machine() -> dict:
    return {"device": jax.devices()[0].device_kind, "python": platform.python_version(), "jax": jax.__version__}
