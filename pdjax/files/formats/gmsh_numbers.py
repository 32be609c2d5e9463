"""Numbers of a section of a Gmsh file, written as text or in binary. Both kinds never give more than the section holds.

A letter tells the kind of a number: i for int, s for size_t, d for double.
"""

import numpy as np


class Text:
    """Numbers of a section written as text. `take` never returns more numbers than there are."""

    def __init__(self, body: bytes) -> None:
        self.numbers, self.at = np.array(body.split(), float), 0

    def take(self, kind: str, count: int) -> np.ndarray:
        if not 0 <= count <= len(self.numbers) - self.at:
            raise ValueError(f"{count} numbers are announced, {len(self.numbers) - self.at} follow")
        found = self.numbers[self.at : self.at + count]
        self.at += count
        return found if kind == "d" else _whole(found)

    def rows(self, count: int, kinds: str) -> list[np.ndarray]:
        """Columns of a table, one for each letter of `kinds`."""
        table = self.take("d", count * len(kinds)).reshape(count, len(kinds))
        return [table[:, k] if kind == "d" else _whole(table[:, k]) for k, kind in enumerate(kinds)]


def _whole(numbers: np.ndarray) -> np.ndarray:
    """Numbers that were read as floats as integers."""
    if not (np.abs(numbers) < 2.0**53).all():
        wrong = numbers[np.argmin(np.abs(numbers) < 2.0**53)]
        raise ValueError(f"counts and numbers of nodes and elements must be whole numbers; got {wrong}")
    return numbers.astype(np.int64)


class Binary:
    """Numbers of a binary section: i (int), s (size_t) and d (double)."""

    def __init__(self, body: bytes, order: str, size: int) -> None:
        self.body, self.at = body, 0
        self.dtypes = {"i": np.dtype(f"{order}i4"), "s": np.dtype(f"{order}u{size}"), "d": np.dtype(f"{order}f8")}

    def _bytes(self, dtype: np.dtype, count: int) -> np.ndarray:
        left = len(self.body) - self.at
        if not 0 <= count * dtype.itemsize <= left:
            raise ValueError(f"{count * dtype.itemsize} bytes are announced, {left} follow")
        found = np.frombuffer(self.body, dtype, count, self.at)
        self.at += count * dtype.itemsize
        return found

    def take(self, kind: str, count: int) -> np.ndarray:
        return self._bytes(self.dtypes[kind], count).astype(float if kind == "d" else np.int64)

    def rows(self, count: int, kinds: str) -> list[np.ndarray]:
        if len(set(kinds)) == 1:
            return list(self.take(kinds[0], count * len(kinds)).reshape(count, len(kinds)).T)
        dtype = np.dtype([(f"f{k}", self.dtypes[kind]) for k, kind in enumerate(kinds)])
        table = self._bytes(dtype, count)
        return [table[f"f{k}"].astype(float if kind == "d" else np.int64) for k, kind in enumerate(kinds)]


Stream = Text | Binary
