"""The common parts of all benchmarks: timing, counts of the compiler, the machine, and result files that continue.

A case plans tasks, and each task is measured to give one row. The file of the case is written after every row, so that
an interrupted run continues with the missing rows. A row is a dictionary:

    method, settings, dtype                  identify the row; settings: a dictionary of the settings of the method
    seconds, fastest, slowest, spread        median, minimum and maximum of the repeated calls [s], and
                                             (slowest − fastest)/median [-]
    compile_seconds                          compilation [s]; first call − median where the host drives the program
    error                                    against an exact reference that the case describes; None without one
    bytes, flops, temporary_bytes            as the compiler counts them: every operand once for each use, without
                                             caches; None where the host drives several programs

A file never mixes rows of different machines, versions or settings. The case is refused instead.
"""

import json
import platform
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import jax
import numpy as np

from .._internal.checks import written_whole
from .._internal.json_values import plain
from .._internal.version import VERSION

if TYPE_CHECKING:
    import matplotlib.figure

try:
    from jax import enable_x64
except ImportError:  # before jax 0.8
    from jax.experimental import enable_x64  # type: ignore[attr-defined, no-redef]

ENOUGH = 0.3  # [s] of measuring: short calls are repeated until it is reached, at most MOST times
MOST = 30
Say = Callable[[str], None]
Result = TypeVar("Result")


class Task(NamedTuple):
    """A planned row: method, settings (JSON values) and dtype identify it, and `measure()` returns the rest."""

    method: str
    settings: dict
    measure: Callable[[], dict]
    dtype: str = "float64"

    @property
    def key(self) -> dict:
        """The entries that identify its row."""
        return {"method": self.method, "settings": self.settings, "dtype": self.dtype}


@dataclass(frozen=True)
class Case:
    """A benchmark.

    about: its description in one line. plan(quick): its tasks. draw(rows): a matplotlib Figure of the rows, as `flat`
    returns them. settings: the settings that all rows have in common.
    """

    about: str
    plan: Callable[[bool], Iterable[Task]]
    draw: Callable[[list[dict]], "matplotlib.figure.Figure"]
    settings: dict = field(default_factory=dict)


def machine() -> dict:
    """Return the processor, the device and the versions of this run."""
    cpu, cores = platform.processor() or platform.machine(), None
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        cores = sum(line.startswith("processor") for line in lines)
    except (OSError, StopIteration):
        pass
    versions = {"pdjax": VERSION} | {name: version(name) for name in ("jax", "numpy", "scipy", "diffrax")}
    return {
        "cpu": cpu,
        "cores": cores,
        "device": jax.devices()[0].device_kind,
        "python": platform.python_version(),
        **versions,
    }


def _seconds(work: Callable[[], Result]) -> tuple[float, Result]:
    start = time.perf_counter()
    result = jax.block_until_ready(work())
    return time.perf_counter() - start, result


def timed(work: Callable[[], object], repeats: int = 5) -> dict:
    """Time the first call, which compiles, and then the median, fastest and slowest of `repeats` calls [s]."""
    first, _ = _seconds(work)
    spent = [_seconds(work)[0] for _ in range(repeats)]
    return {"first": first, "median": float(np.median(spent)), "fastest": min(spent), "slowest": max(spent)}


def summary(spent: list[float]) -> dict:
    """Return the median and the spread of measured seconds."""
    median, low, high = float(np.median(spent)), min(spent), max(spent)
    return {"seconds": median, "fastest": low, "slowest": high, "spread": (high - low) / median, "calls": len(spent)}


def _repeated(work: Callable[[], object], repeats: int) -> dict:
    """Time at least `repeats` calls, and more if they are short [s]."""
    spent = [_seconds(work)[0] for _ in range(repeats)]
    while sum(spent) < ENOUGH and len(spent) < MOST:
        spent.append(_seconds(work)[0])
    return summary(spent)


def counted(compiled: Any) -> dict:
    """Return the bytes, flops and temporary bytes that the compiler counts; None where the backend does not count."""
    costs = compiled.cost_analysis() or {}
    costs = costs[0] if isinstance(costs, list) else costs
    memory = compiled.memory_analysis()
    return {
        "bytes": costs.get("bytes accessed"),
        "flops": costs.get("flops"),
        "temporary_bytes": None if memory is None else memory.temp_size_in_bytes,
    }


def kernel(function: Callable[..., Result], *arguments: object, repeats: int = 5) -> tuple[Result, dict]:
    """Return (result, row) of `function(*arguments)`, compiled as one program and called once before the timing."""
    start = time.perf_counter()
    compiled = jax.jit(function).lower(*arguments).compile()
    spent = time.perf_counter() - start
    result = jax.block_until_ready(compiled(*arguments))
    return result, {**_repeated(lambda: compiled(*arguments), repeats), "compile_seconds": spent, **counted(compiled)}


def hosted(work: Callable[[], Result], repeats: int = 3) -> tuple[Result, dict]:
    """Return (result, row) of code that the host drives. Its programs compile in the first call and are not counted."""
    first, result = _seconds(work)
    row = _repeated(work, repeats)
    unknown = {"bytes": None, "flops": None, "temporary_bytes": None}
    return result, {**row, "compile_seconds": max(first - row["seconds"], 0.0), **unknown}


def with_null(value: object) -> Any:
    """The value for a result file: null stands for NaN and infinity."""
    return plain(value, lambda _: None)


def read(file: Path) -> dict:
    """Read the file of a case. Raise ValueError if it is not one."""
    try:
        record = json.loads(file.read_text())
        record["machine"], record["settings"], record["rows"]
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ValueError(f"{file} is not a result of pdjax bench, or is damaged: {error!r}; remove it") from None
    return record


def _differences(there: dict, here: dict) -> str:
    names = [k for k in {**there, **here} if there.get(k) != here.get(k)]
    return "; ".join(f"{k} {there.get(k)!r} there, {here.get(k)!r} here" for k in names)


def _begun(file: Path, case: Case, quick: bool) -> dict:
    """Return the record to continue: that of the file if machine and settings agree, or a new one without a file."""
    fresh = {"machine": machine(), "settings": {"quick": quick, **case.settings}, "rows": [], "left_out": []}
    fresh = json.loads(json.dumps(fresh))
    if not file.exists():
        return fresh
    record = read(file)
    for what in ("machine", "settings"):
        if record[what] != fresh[what]:
            kind = "on another machine or with other versions" if what == "machine" else "with other settings"
            raise ValueError(
                f"{file} was measured {kind} ({_differences(record[what], fresh[what])}); rows are not mixed:"
                " name another folder (--out) or remove the file"
            )
    return {**record, "left_out": []}


def flat(rows: list[dict]) -> list[dict]:
    """Return the rows with their settings as entries of the row itself."""
    return [{**row["settings"], **row} for row in rows]


def _save(record: dict, file: Path) -> None:
    with written_whole(file) as stream:
        stream.write((json.dumps(with_null(record), ensure_ascii=False, indent=1) + "\n").encode())


def _named(task: Task) -> str:
    return ", ".join([task.method, *(f"{k} = {v}" for k, v in task.settings.items()), task.dtype])


def run_case(name: str, case: Case, folder: Path, quick: bool, say: Say) -> dict:
    """Measure the rows that `folder`/NAME.json lacks, one by one, then draw NAME.png; return the record.

    A quick run writes NAME-quick instead. A row that cannot be measured here, because a package is missing or the
    memory does not suffice, is reported and listed under "left_out", and the run continues. Raises ValueError for a
    file of another machine or other settings, and OSError if the files cannot be written.
    """
    stem = f"{name}-quick" if quick else name
    file = folder / f"{stem}.json"
    record = _begun(file, case, quick)

    def left_out(what: str, error: Exception) -> None:
        why = str(error).splitlines()[0]
        if isinstance(error, ModuleNotFoundError):
            why = f"needs the package {error.name}: pip install {error.name}"
        record["left_out"].append({"what": what, "why": why})
        say(f"{name}: {what} left out: {why}")

    with enable_x64(True):
        try:
            tasks = list(case.plan(quick))
        except ModuleNotFoundError as error:
            left_out("the whole case", error)
            return record
        for task in tasks:
            if any(task.key.items() <= row.items() for row in record["rows"]):
                continue
            try:
                with enable_x64(task.dtype == "float64"):
                    row = {**task.key, **task.measure()}
            except (ModuleNotFoundError, MemoryError, jax.errors.JaxRuntimeError) as error:
                left_out(_named(task), error)
                continue
            record["rows"].append(json.loads(json.dumps(with_null(row))))
            _save(record, file)
            distance = "" if row.get("error") is None else f", error {row['error']:.2e}"
            say(f"{name}: {_named(task)}: {row['seconds']:.3g} s{distance}")
    if record["rows"]:
        _save(record, file)
        with written_whole(folder / f"{stem}.png") as stream:
            case.draw(flat(record["rows"])).savefig(stream, dpi=140, format="png")
    return record


def results() -> Path:
    """Return the folder `results` beside the script that runs."""
    return Path(sys.modules["__main__"].__file__ or ".").resolve().parent / "results"


def write(name: str, numbers: dict, figure: "matplotlib.figure.Figure | None" = None) -> None:
    """Write results/NAME.json and, for a figure, NAME.png beside a script; print the numbers as well."""
    folder = results()
    folder.mkdir(exist_ok=True)
    numbers = {"machine": machine(), **numbers}
    (folder / f"{name}.json").write_text(json.dumps(numbers, indent=1) + "\n")
    print(json.dumps(numbers, indent=1))
    if figure is not None:
        figure.savefig(folder / f"{name}.png", dpi=140)
