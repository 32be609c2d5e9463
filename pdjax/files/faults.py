"""Errors of files that cannot be read: what is wrong with the file, in one sentence that names it."""

import contextlib
import lzma
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np


class FormatError(ValueError):
    """A file that cannot be read, with a message that is complete."""


# What decoders raise for damaged data. Other exceptions keep their traceback, because they show an error of a reader.
DECODING = (LookupError, ArithmeticError, EOFError, RuntimeError, zlib.error, lzma.LZMAError)


@contextlib.contextmanager
def readable(path: Path, what: str) -> Iterator[None]:
    """Turn any exception of a parser into a ValueError that names the file and says what was expected of it."""
    try:
        yield
    except (FormatError, OSError, ImportError):
        raise
    except MemoryError:
        raise FormatError(f"{path.name} announces more data than the memory of this machine holds") from None
    except Exception as error:
        raise FormatError(
            f"{path.name} must be a complete and valid {what}; the reader stopped with {type(error).__name__}:"
            f" {str(error)[:300]}. The file may be cut off or damaged: write it again"
        ) from (None if isinstance(error, DECODING) else error)


def fault(path: Path, words: str) -> FormatError:
    """An error about a file, to raise."""
    return FormatError(f"{path.name}: {words}")


def places(path: Path, tags: np.ndarray, wanted: np.ndarray, what: str) -> np.ndarray:
    """Where each wanted tag stands among `tags`."""
    order = np.argsort(tags, kind="stable")
    ordered = tags[order]
    if (ordered[1:] == ordered[:-1]).any():
        raise fault(path, f"{what} {int(ordered[np.flatnonzero(ordered[1:] == ordered[:-1])[0]])} is defined twice")
    at = np.minimum(np.searchsorted(ordered, wanted), max(len(tags) - 1, 0))
    if wanted.size and (not len(tags) or (ordered[at] != wanted).any()):
        lost = int(wanted[ordered[at] != wanted].flat[0]) if len(tags) else int(wanted.flat[0])
        raise fault(path, f"{what} {lost} is used, but the file does not define it")
    return order[at]
