"""Work shared between the cores of the machine by threads.

Threads are sufficient, because compiled programs and scipy release Python's global lock.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Answer = TypeVar("Answer")


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(do: Callable[[Item], Answer], items: Sequence[Item]) -> Iterator[Answer]:
    """Yield `do(item)` for every item, in order. As many items run at once as there are cores.

    If an item raises an error or the caller stops, the items that have not started are cancelled.
    """
    with ThreadPoolExecutor(max(1, min(cores(), len(items)))) as pool:
        running = [pool.submit(do, item) for item in items]
        try:
            for each in running:
                yield each.result()
        finally:
            pool.shutdown(cancel_futures=True)
