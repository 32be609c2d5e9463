"""Tables of numbers in text files: lines of the same number of columns, separated by white space, commas or semicolons.

NumPy reads the table at once. Only if it fails are the lines read one by one, to say which line is wrong. Empty lines
and what follows a # are left out. Files are read as Latin-1, in which every byte is a character, so a comment in any
encoding does no harm.
"""

import csv
import itertools
import os
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

LONGEST = 65536  # bytes of the longest line of a header
WORDS = re.compile(r'"([^"]*)"|([^\s"]+)')


class Place(NamedTuple):
    """Where a table starts: byte `offset`, and the number of its first `line`, from 1. `rows`: how many, None: all."""

    path: Path
    offset: int
    line: int
    rows: int | None = None
    delimiter: str | None = None  # None: white space


def header_line(stream: BinaryIO, path: Path, number: int) -> str:
    """The next line of a binary stream, "" at the end. Raises ValueError if it is too long to be a line of text."""
    raw = stream.readline(LONGEST)
    if len(raw) == LONGEST:
        raise ValueError(
            f"{path}, line {number}: expected a line of text; got one of more than {LONGEST} bytes; the file may be"
            " binary or of another format"
        )
    if number == 1:
        if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise ValueError(f"{path} is text in UTF-16; expected UTF-8 or ASCII; save it in one of these encodings")
        raw = raw.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in raw:
        raise ValueError(f"{path}, line {number}: expected text; got a zero byte; the file may be binary or damaged")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def words(line: str) -> list[str]:
    """The words of a line, separated by white space or by commas or semicolons. A quoted word may hold separators."""
    delimiter = delimiter_of(line)
    if delimiter is None:
        return [quoted or plain for quoted, plain in WORDS.findall(line)]
    cells = next(csv.reader([line.replace("\r", " ").replace("\n", " ")], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in cells]


def delimiter_of(line: str) -> str | None:
    """The separator of the numbers of a line: a semicolon, a comma, or None for white space."""
    return next((mark for mark in ";," if mark in line), None)


def is_number(word: str) -> bool:
    """Whether NumPy reads this word as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word


def _lines(place: Place) -> Iterator[tuple[int, list[str]]]:
    """The line number and the cells of every line of a table that has any."""
    with open(place.path, encoding="latin-1") as text:
        text.seek(place.offset)
        found = 0
        for number, line in enumerate(text, start=place.line):
            line = line.partition("#")[0].strip()
            if line:
                yield number, [cell.strip() for cell in line.split(place.delimiter)]
                found += 1
                if found == place.rows:
                    return


def line_of(place: Place, row: int) -> int:
    """The number of the line that holds a row of a table."""
    return next(itertools.islice(_lines(place), row, None))[0]


def fits(place: Place, columns: int) -> None:
    """Raise ValueError if the file is too short for the announced rows: a number takes two bytes with its separator."""
    length = os.path.getsize(place.path) - place.offset + 1
    if place.rows is not None and place.rows * columns * 2 > length:
        raise ValueError(
            f"{place.path} announces {place.rows} lines of {columns} numbers, but has only {length - 1} bytes from line"
            f" {place.line}; the file is incomplete or damaged"
        )


def read_table(place: Place, names: list[str], kept: list[int] | None = None) -> np.ndarray:
    """Read a table of floats, (rows, columns). `names` are those of the columns; `kept`, the columns to read.

    Raises ValueError that names the line if a line has another number of columns or a word that is no number, or if the
    file ends too early.
    """
    fits(place, len(names))
    kept = list(range(len(names))) if kept is None else kept
    with open(place.path, encoding="latin-1") as text, warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # NumPy warns of empty tables and of empty lines
        text.seek(place.offset)
        try:
            values = np.loadtxt(
                text,
                ndmin=2,
                max_rows=place.rows,
                delimiter=place.delimiter,
                usecols=None if len(kept) == len(names) else kept,
            )
        except ValueError as error:
            raise _fault(place, names, kept, str(error)) from None
    if values.shape[0] and values.shape[1] != len(kept):
        raise _fault(place, names, kept, f"got {values.shape[1]} columns")
    if place.rows is not None and len(values) < place.rows:
        raise ValueError(
            f"{place.path} ends too early: expected {place.rows} lines of {len(names)} numbers ({', '.join(names)})"
            f" from line {place.line}; got {len(values)}; the file is incomplete"
        )
    return values.reshape(-1, len(kept))


def _fault(place: Place, names: list[str], kept: list[int], reason: str) -> ValueError:
    """The error that names the first wrong line of a table."""
    told = f"expected {len(names)} numbers ({', '.join(names):.200})"
    for number, cells in _lines(place):
        where = f"{place.path}, line {number}: {told}"
        if len(cells) != len(names):
            return ValueError(f"{where}; got {len(cells)} columns: {' '.join(cells)!r:.60}; correct or remove the line")
        for k in kept:
            if not is_number(cells[k]):
                return ValueError(f"{where}; got {cells[k]!r:.40} for {names[k]}; correct or remove the line")
    return ValueError(f"{place.path}: {told} in each line from line {place.line}; {reason}")
