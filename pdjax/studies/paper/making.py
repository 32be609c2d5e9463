"""Making sheets, one after the other or several at a time.

Most of a sheet's time is compiling, which is one thread's work: with a process to each core, two cores make a quick
run in 0.6 of the time of one process. The processes share nothing but JAX's settings and its cache of compiled
programs; what they find comes back to the one that started them, which alone writes the results.
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
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import jax

from ..._internal.threads import cores

LONGEST = ("cuboid", "step-bar", "singular-bar", "maps-2d")  # begun first, so that none is left alone at the end
MOST = 4  # processes: three sheets take most of the time, and each takes some GB
_SHARED = (
    "jax_enable_x64",
    "jax_platforms",
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
)


def make(name: str, quick: bool, file: Path) -> tuple[dict, float]:
    """One sheet, its picture written to `file`: (numbers, seconds)."""
    from ..._internal.pictures import write_picture
    from . import FIGURES

    start, before = time.perf_counter(), jax.config.read("jax_disable_most_optimizations")
    if quick:  # small problems: compiling takes longer than running
        jax.config.update("jax_disable_most_optimizations", True)
    try:
        numbers, figure = FIGURES[name].make(quick)
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
    write_picture(figure, file)
    return numbers, round(time.perf_counter() - start, 1)


def processes(jobs: int) -> int:
    """How many to use: one for each job and core, and no more than MOST; one alone on an accelerator, whose memory the
    first process has."""
    return max(1, min(jobs, cores(), MOST)) if jax.default_backend() == "cpu" else 1


def each(work: Callable, jobs: dict[str, tuple], count: int) -> Generator[tuple[str, Any], None, None]:
    """(name, work(*arguments)) of every job, as they are finished, by `count` processes; one: here, in their order.

    Arguments: work: a function that can be pickled, when count > 1; jobs: name → its arguments. Raises: what `work`
    raises, and ChildProcessError when a process ends without an answer. Whatever ends the loop over the answers
    ends the processes: close the iterator.
    """
    if count == 1:
        yield from ((name, work(*arguments)) for name, arguments in jobs.items())
        return
    waiting = sorted(jobs, key=lambda name: LONGEST.index(name) if name in LONGEST else len(LONGEST))
    started: list[Any] = []
    busy: dict[Any, str] = {}

    def ask(end: Any) -> None:
        busy[end] = waiting.pop(0)
        try:
            end.send(jobs[busy[end]])
        except OSError:
            pass  # its process has ended: the answer will say so

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
    "the process that made {0} ended without a result; was there memory enough? Run again: what is finished stays, and"
    " --figure {0} makes it alone"
)


def _start(work: Callable, count: int, started: list) -> list:
    """Start processes, adding each to `started`; our ends of their pipes."""
    spawn = multiprocessing.get_context("spawn")
    ends = []
    with _as_it_is_born():
        for _ in range(count):
            here, there = spawn.Pipe()
            process = spawn.Process(target=_serve, args=(there, work), daemon=True)
            process.start()
            started.append(process)
            there.close()  # the process has it alone, so that its end is seen
            ends.append(here)
    return ends


@contextmanager
def _as_it_is_born() -> Iterator[None]:
    """What a process started here inherits: JAX's settings, in the environment, for modules hold constants of the
    precision that is set when they are imported; and deaf ears for interrupts, which are for the first process."""
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


def _serve(end: Any, work: Callable) -> None:
    """One process: jobs in, (True, answer) or (False, error) out, until it is ended or the first process is gone."""
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
    """The error with its traceback as a note, as itself if that survives pickling."""
    said = traceback.format_exc()
    try:
        error = pickle.loads(pickle.dumps(error))
    except Exception:
        error = RuntimeError(f"{type(error).__name__}: {error}")
    error.add_note(said)
    return error
