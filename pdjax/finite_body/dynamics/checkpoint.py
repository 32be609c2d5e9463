"""Checkpoints of a run: everything that is needed to go on bit for bit, in one file that is whole or not there.

A checkpoint belongs to one motion, step and cadence: it carries a fingerprint of them and of the version, and is
refused by any other. It is written beside the old one and moved over it, so a run killed at any moment leaves a valid
one; a disk that is full costs a warning, and the old one stays.
"""

import hashlib
import importlib.metadata
import os
import re
import warnings
import zipfile
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._internal.checks import written_whole
from .verlet import State

VERSION = importlib.metadata.version("pdjax")


def fingerprint(program: str, *data: Any) -> str:
    """Names a run by what it computes and on what: the same in any process.

    program: the lowered text of its compiled steps, in which every law, schedule and observer is written out; data: its
    arrays and numbers.
    """
    digest = hashlib.sha256(VERSION.encode())
    digest.update(re.sub(r'backend_config = "[^"]*"', "", program).encode())  # addresses of callbacks
    for leaf in jax.tree.leaves(data):
        array = np.ascontiguousarray(leaf)
        digest.update(f"{array.shape} {array.dtype}".encode() + array.tobytes())
    return digest.hexdigest()


def save(path: str | os.PathLike, name: str, state: State, records: list[Any]) -> bool:
    """Write state and records so far; False with a warning if the disk refuses."""
    arrays = {f"state_{k}": np.asarray(x) for k, x in state._asdict().items()}
    columns = zip(*(jax.tree.leaves(r) for r in records), strict=True)
    arrays |= {f"record_{k}": np.stack([np.asarray(x) for x in column]) for k, column in enumerate(columns)}
    try:
        with written_whole(path) as stream:
            np.savez(stream, fingerprint=name, version=VERSION, **arrays)  # type: ignore[arg-type]
    except OSError as error:
        warnings.warn(
            f"no checkpoint was written: {error}; the run goes on",
            stacklevel=3,
        )
        return False
    return True


def load(path: str | os.PathLike, name: str, like: Any) -> tuple[State, list[Any]]:
    """State and records of a checkpoint; `like` is a record of the shape to restore.

    Raises: FileNotFoundError; ValueError for a file that is no checkpoint, of another version, or of another run.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no checkpoint at {path}: run once without resume to make it")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        found, version = str(arrays["fingerprint"]), str(arrays["version"])
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        raise ValueError(f"{path} is not a checkpoint of pdjax, or is damaged: {error}") from None
    if version != VERSION:
        raise ValueError(f"checkpoint {path} was written by pdjax {version}, this is {VERSION}: start the run anew")
    if found != name:
        raise ValueError(
            f"checkpoint {path} belongs to another run: its scene, model, density, schedule, observers, fields, dt or"
            " save_every differ from this one's (their defaults depend on the duration: to go on to a longer one, give"
            " both from the start), or another version of JAX wrote it"
        )
    state = State(*(jnp.asarray(arrays[f"state_{k}"]) for k in State._fields))
    leaves, structure = jax.tree.flatten(like)
    columns = [arrays[f"record_{k}"] for k in range(len(leaves))]
    records = [jax.tree.unflatten(structure, [c[i] for c in columns]) for i in range(len(columns[0]))]
    return state, records
