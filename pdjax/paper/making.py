"""Making sheets, one after the other or several at a time.

Most of a sheet's time is compiling, which is one thread's work: with a process to each core, two cores make a quick
run in 0.6 of the time of one process. The processes share nothing but JAX's settings and its cache of compiled
programs; what they find comes back to the one that started them, which alone writes the results.
"""

import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Generator
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any

import jax

LONGEST = ("cuboid", "step-bar", "singular-bar", "maps-2d")  # begun first, so that none is left alone at the end
MOST = 4  # processes: three sheets take most of the time, and each takes some GB
_SHARED = ("jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs")


def make(name: str, quick: bool, file: Path) -> tuple[dict, float]:
    """One sheet, its picture written to `file`: (numbers, seconds)."""
    from .._run_motions import write_picture
    from . import FIGURES

    start, before = time.perf_counter(), jax.config.read("jax_disable_most_optimizations")
    jax.config.update("jax_disable_most_optimizations", quick)  # small problems: compiling takes longer than running
    try:
        numbers, figure = FIGURES[name].make(quick)
    finally:
        jax.config.update("jax_disable_most_optimizations", before)
    write_picture(figure, file)
    return numbers, round(time.perf_counter() - start, 1)


def processes(jobs: int) -> int:
    """How many to use: one for each job and core, and no more than MOST."""
    return max(1, min(jobs, os.cpu_count() or 1, MOST))


def each(work: Callable, jobs: dict[str, tuple], count: int) -> Generator[tuple[str, Any], None, None]:
    """(name, work(*arguments)) of every job, as they are finished, by `count` processes; one: here, in their order.

    Arguments: work: a function that can be pickled, when count > 1; jobs: name → its arguments. Raises: what `work`
    raises, and ChildProcessError when a process ends without an answer. Whatever ends the loop over the answers
    ends the processes: close the iterator.
    """
    if count == 1:
        yield from ((name, work(*arguments)) for name, arguments in jobs.items())
        return
    spawn = multiprocessing.get_context("spawn")
    settings = {name: getattr(jax.config, name) for name in _SHARED}
    waiting = sorted(jobs, key=lambda name: LONGEST.index(name) if name in LONGEST else len(LONGEST))
    processes: list[Any] = []
    busy: dict[Any, str] = {}
    try:
        for _ in range(count):
            here, there = spawn.Pipe()
            processes.append(spawn.Process(target=_serve, args=(there, work, settings), daemon=True))
            processes[-1].start()
            there.close()  # the process has it alone, so that its end is seen
            busy[here] = waiting.pop(0)
            here.send(jobs[busy[here]])
        while busy:
            ready: Any = wait(list(busy))
            for end in ready:
                name = busy.pop(end)
                try:
                    good, answer = end.recv()
                except (EOFError, ConnectionError) as error:
                    raise ChildProcessError(
                        f"the process that made {name} ended without a result; was there memory enough? Run again: what"
                        f" is finished stays, and --figure {name} makes it alone"
                    ) from error
                if not good:
                    raise answer
                if waiting:
                    busy[end] = waiting.pop(0)
                    end.send(jobs[busy[end]])
                yield name, answer
    finally:
        for process in processes:
            process.terminate()
            process.join()


def _serve(end: Any, work: Callable, settings: dict) -> None:
    """One process: jobs in, (True, answer) or (False, error) out, until it is ended. Interrupts are for the first."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name, value in settings.items():
        jax.config.update(name, value)
    while True:
        arguments = end.recv()
        try:
            end.send((True, work(*arguments)))
        except Exception as error:
            error.add_note(traceback.format_exc())
            end.send((False, error))
