"""Damaged files: every read ends in a result or in ValueError, OSError or ImportError, in bounded time and memory.

A seeded generator damages a valid file of each format: flipped bits, cut ends, lost and doubled lines, tokens that are
no numbers or too large, long lines, zero bytes, exchanged lines. `SAMPLES` is the table of formats. A new format is one
line: a function that writes a valid file into a folder and returns its path. `mesh_samples` has those of meshes.
"""

import re
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from mesh_samples import SAMPLES as MESHES

import pdjax as pd

BODY = pd.lattice((4, 3), 0.1)
FIELDS = {"u": np.linspace(0, 1, 24).reshape(12, 2), "n": np.arange(12)}
SETS = {"left": BODY.positions[:, 0] < 0.1}
TOKENS = [b"1e999", b"nan", b"-1", b"0", b"", b"-", b"9" * 30, b"1000000000000", b"1e-320", b"0x10", b"1_0", b"#", b'"']
TOKENS += [
    b",",
    b";",
    b"\t",
    b"\xff\xfe",
    b"ITEM: TIMESTEP",
    b"x",
    b"inf",
    b"true",
    b"None",
    b"\r",
    b"1,5",
    b"/dev/zero",
]
MEMORY = 64 * 2**20  # bytes; the samples have some kB, and measured reads take at most 5.3 MB
SECONDS = 10.0  # measured reads take at most 0.6 s of a busy machine


def written(name):
    return lambda folder: pd.write_points(folder / name, BODY, FIELDS, SETS)


def text(name, content):
    def write(folder):
        (folder / name).write_text(content)
        return folder / name

    return write


PERIDIGM = "# x y z block_id volume\n" + "".join(f"{k} {k % 3}.5 {0.1 * k} {k % 2} 1.5\n" for k in range(12))
DATA = (
    "title\n\n12 atoms\n1 atom types\n\n0 4 xlo xhi\n0 4 ylo yhi\n0 4 zlo zhi\n0.1 0 0 xy xz yz\n\nMasses\n\n1 1.0\n\n"
    + "Atoms # peri\n\n"
    + "".join(f"{k + 1} 1 1.0 2200 {k % 4} {k // 4} 0.5 0 {k % 2} 0\n" for k in range(12))
    + "\nVelocities\n\n"
    + "".join(f"{k + 1} {k} 0 0\n" for k in range(12))
)
DUMP = "".join(
    f"ITEM: TIME\n{0.1 * step}\nITEM: TIMESTEP\n{step}\nITEM: NUMBER OF ATOMS\n12\n"
    + "ITEM: BOX BOUNDS pp pp pp\n0 4\n0 4\n0 1\nITEM: ATOMS id type x y z vx vy vz vol\n"
    + "".join(f"{k + 1} 1 {k % 4 + 0.01 * step} {k // 4} 0.5 1 0 0 1\n" for k in range(12))
    for step in (0, 5, 10)
)
SAMPLES = {
    "text": written("a.txt"),
    "csv": written("a.csv"),
    "npz": written("a.npz"),
    "peridigm": text("b.txt", PERIDIGM),
    "lammps data": text("a.data", DATA),
    "lammps dump": text("a.dump", DUMP),
} | MESHES


def flip(raw, rng):
    for at in rng.integers(len(raw), size=rng.integers(1, 6)):
        raw[at] ^= 1 << rng.integers(8)
    return raw


def cut(raw, rng):
    return raw[: rng.integers(len(raw))]


def insert(raw, rng):
    at = int(rng.integers(len(raw)))
    return raw[:at] + TOKENS[rng.integers(len(TOKENS))] + raw[at:]


def replace(raw, rng):
    words = re.split(rb"([ ,\n])", raw)
    words[2 * rng.integers(len(words) // 2 + 1)] = TOKENS[rng.integers(len(TOKENS))]
    return b"".join(words)


def lines(raw, rng):
    parts = raw.split(b"\n")
    i, j = rng.integers(len(parts), size=2)
    kind = rng.integers(4)
    if kind == 0:
        del parts[i]
    elif kind == 1:
        parts.insert(j, parts[i])
    elif kind == 2:
        parts[i], parts[j] = parts[j], parts[i]
    else:
        parts[i] = parts[i] * int(rng.integers(2, 5000))
    return b"\n".join(parts)


def zeros(raw, rng):
    at = int(rng.integers(len(raw)))
    return raw[:at] + bytes(int(rng.integers(1, 9))) + raw[at + int(rng.integers(9)) :]


def number(raw, rng):
    """A whole number of 4 or 8 bytes in a binary file becomes another one, often huge."""
    at = int(rng.integers(max(1, len(raw) - 8)))
    size = int(rng.choice([2, 4, 8]))
    raw[at : at + size] = int(rng.choice([0, 1, 2**15, 2**16 - 1])).to_bytes(2, "little") * (size // 2)
    return raw


DAMAGES = (flip, cut, insert, replace, lines, zeros, number)


def damaged(raw, seed):
    rng = np.random.default_rng(seed)
    raw = bytearray(raw)
    for _ in range(rng.integers(1, 3)):
        raw = bytearray(DAMAGES[rng.integers(len(DAMAGES))](raw, rng)) or bytearray(b"\n")
    return bytes(raw)


def read(path, volume=None):
    """Read a file and all its states. Returns whether it could be read."""
    try:
        _, data = pd.read_points(path, volume=volume, step=0)
        for _ in data.states():
            pass
    except (ValueError, OSError, ImportError) as error:
        assert len(str(error)) > 20, error
        assert "is damaged or of another format: " not in str(error), error  # the reader itself must find the fault
        return False
    return True


def fuzz(name, folder, seeds, memory=False):
    """Damage and read a sample once for each seed. `memory`: also watch the memory, which takes some times as long."""
    path = SAMPLES[name](folder)
    raw = path.read_bytes()
    assert read(path), "the sample must be valid"
    if memory:
        tracemalloc.start()
    try:
        for seed in seeds:
            path.write_bytes(damaged(raw, seed))
            start = time.perf_counter()
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    read(path, "lattice" if seed % 4 == 0 else None)
            except BaseException as error:
                raise AssertionError(f"{name}, seed {seed}: {type(error).__name__}: {error}") from error
            assert time.perf_counter() - start < SECONDS, f"{name}, seed {seed}: time"
            if memory:
                assert tracemalloc.get_traced_memory()[1] < MEMORY, f"{name}, seed {seed}: memory"
                tracemalloc.reset_peak()
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", SAMPLES)
def test_damaged_files_are_read_or_refused(name, tmp_path):
    fuzz(name, tmp_path, range(20))


@pytest.mark.parametrize("name", SAMPLES)
def test_ten_thousand_damaged_files_are_read_or_refused(name, tmp_path):
    fuzz(name, tmp_path, range(10_000), memory=True)
