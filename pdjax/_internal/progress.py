"""The progress of a job on one line of the error stream. Nothing is shown if the stream is not a terminal."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")


def progress(items: Iterable[T], total: int, label: str, show: bool) -> Iterator[T]:
    """Yield the items. Show how many of `total` are done and an estimate of the time left."""
    show = show and sys.stderr.isatty()
    start = time.monotonic()
    for done, item in enumerate(items):
        if show:
            spent = time.monotonic() - start
            left = f"{spent / done * (total - done):4.0f} s left" if done else "compiling"
            bar = "█" * (24 * done // total)
            print(f"\r{label} [{bar:<24}] {done}/{total} {left:<12}", end="", file=sys.stderr, flush=True)
        yield item
    if show:
        print(f"\r{label} [{'█' * 24}] {total}/{total} {time.monotonic() - start:4.0f} s{' ' * 12}", file=sys.stderr)


class Residuals(list[float]):
    """Residuals of a solver. The terminal shows the latest residual and the current load factor."""

    def __init__(self, factor: float, show: bool):
        super().__init__()
        self.factor, self.show = factor, show and sys.stderr.isatty()

    def append(self, residual: float) -> None:
        """Append a residual and show it."""
        super().append(residual)
        if self.show:
            words = f"load factor {self.factor:.4g}, iteration {len(self) - 1}, relative residual {residual:.1e}"
            print(f"\r{words:<79}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        """End the line on the terminal."""
        if self.show:
            print(file=sys.stderr)


class Counter:
    """Steps of a search with an unknown end. The terminal shows how many of the allowed ones are done."""

    def __init__(self, total: int, label: str, show: bool):
        self.done, self.total, self.label, self.show = 0, total, label, show and sys.stderr.isatty()

    def tick(self) -> None:
        """Count one step."""
        self.done += 1
        if self.show:
            print(f"\r{self.label}: step {self.done} of at most {self.total}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        """End the line on the terminal."""
        if self.show:
            print(file=sys.stderr)
