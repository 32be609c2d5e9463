"""Making sheets, one after the other or several at a time in processes.

Most of the time of a sheet is compiling, which uses one thread. With one process for each core, two cores finish a
quick run in 0.6 of the time of one process. The processes share JAX's settings and its cache of compiled programs,
nothing else. They send their results to the first process, and only that process writes them.
"""

import multiprocessing
import os
import pickle
import signal
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, TypeVar

import jax

from ..._internal.threads import cores

Result = TypeVar("Result")

LONGEST = ("cuboid", "step-bar", "singular-bar", "maps-2d")  # started first, so that none of them runs alone at the end
MOST = 4  # processes: three sheets take most of the time, and each needs some GB of memory
_SHARED = (
    "jax_enable_x64",
    "jax_platforms",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)


def make(name: str, quick: bool, file: Path) -> tuple[dict, float]:
    """Make one sheet and write its picture to `file`: (numbers, seconds)."""
    from ..._internal.pictures import write_picture
    from . import FIGURES

    start, before = time.perf_counter(), jax.config.read("jax_disable_most_optimizations")
    if quick:  # in small problems compiling takes longer than running
        jax.config.update("jax_disable_most_optimizations", True)
    try:
        numbers, figure = FIGURES[name].make(quick)
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
    write_picture(figure, file)
    return numbers, round(time.perf_counter() - start, 1)


def processes(jobs: int) -> int:
    """One process for each job and core, at most MOST; one on an accelerator, because it holds all the memory."""
    return max(1, min(jobs, cores(), MOST)) if jax.default_backend() == "cpu" else 1


def each(work: Callable[..., Result], jobs: dict[str, tuple], count: int) -> Generator[tuple[str, Result], None, None]:
    """Yield (name, work(*arguments)) of every job as it finishes, by `count` processes; with count 1 here, in order.

    Arguments: work: a function that can be pickled, when count > 1; jobs: name → its arguments. Raises: what `work`
    raises, and ChildProcessError when a process ends without a result. If the loop over the results stops early, close
    the iterator: this ends the processes.
    """
    if count == 1:
        yield from ((name, work(*arguments)) for name, arguments in jobs.items())
        return
    waiting = sorted(jobs, key=lambda name: LONGEST.index(name) if name in LONGEST else len(LONGEST))
    started: list[BaseProcess] = []
    busy: dict[Connection, str] = {}

    def ask(end: Connection) -> None:
        busy[end] = waiting.pop(0)
        try:
            end.send(jobs[busy[end]])
        except OSError:
            pass  # the process has ended; reading its answer reports that

    try:
        for end in _start(work, count, started):
            ask(end)
        while busy:
            ready: Any = wait(list(busy))
            failed: list[Exception] = []
            for end in ready:
                name = busy.pop(end)
                try:
                    good, answer = pickle.loads(end.recv_bytes())
                except (EOFError, OSError):
                    good, answer = False, ChildProcessError(_ENDED.format(name))
                if good:
                    yield name, answer
                else:
                    failed.append(answer)
                if waiting and not failed:
                    ask(end)
            if failed:
                raise failed[0]
    finally:
        for process in started:
            process.terminate()
        for process in started:
            process.join()


_ENDED = (
    "the process that made {0} ended without a result, perhaps for lack of memory. Run again: finished figures are"
    " kept, and --figure {0} makes this one alone"
)


def _start(work: Callable, count: int, started: list) -> list:
    """Start processes, adding each to `started`. Return this end of each pipe."""
    spawn = multiprocessing.get_context("spawn")
    ends = []
    with _as_it_is_born():
        for _ in range(count):
            here, there = spawn.Pipe()
            process = spawn.Process(target=_serve, args=(there, work), daemon=True)
            process.start()
            started.append(process)
            there.close()  # only the process holds this end, so that its death closes the pipe
            ends.append(here)
    return ends


@contextmanager
def _as_it_is_born() -> Iterator[None]:
    """Set what a process started here inherits.

    JAX's settings go through the environment, because modules hold constants of the precision that is set when they are
    imported. Interrupts are ignored, because the first process handles them.
    """
    settings = {name.upper(): str(value) for name in _SHARED if (value := getattr(jax.config, name)) is not None}
    kept = {name: os.environ.get(name) for name in settings}
    main = threading.current_thread() is threading.main_thread()
    heard = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
    os.environ.update(settings)
    try:
        yield
    finally:
        for name, value in kept.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if main:
            signal.signal(signal.SIGINT, heard)


def _serve(end: Connection, work: Callable) -> None:
    """Serve jobs in one process, answering (True, result) or (False, error), until it or the first process ends."""
    while True:
        try:
            arguments = end.recv()
            try:
                answer = pickle.dumps((True, work(*arguments)))
            except Exception as error:
                answer = pickle.dumps((False, _portable(error)))
            end.send_bytes(answer)
        except (EOFError, BrokenPipeError):
            return


def _portable(error: Exception) -> Exception:
    """The error, or a RuntimeError with its words if it cannot be pickled, with its traceback as a note."""
    said = traceback.format_exc()
    try:
        error = pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(said)
    return error
