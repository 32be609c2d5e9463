"""Checkpoints of a run: one file with everything that is needed to continue the run bit for bit.

A checkpoint of `simulate` belongs to one motion, one time step and one `save_every`. It contains a fingerprint of these
and of the version of pdjax, and `load` raises ValueError for the checkpoint of another run. `solve_breaking` writes its
checkpoints with the same functions.

`save` writes a new file beside the old one and then renames it. A run that is killed at any moment therefore leaves a
valid checkpoint. If the disk is full, `save` gives a warning and the old checkpoint stays.
"""

import hashlib
import os
import re
import warnings
import zipfile
from pathlib import Path
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import PyTree

from ..._internal.checks import Tree, writable, written_whole
from ..._internal.version import VERSION

State = TypeVar("State")
DIFFERS = (
    "its scene, initial state, breaking criterion, model, density, schedule, observers, fields, dt or save_every differ"
    " from those of this run, or another version of JAX wrote it; the defaults of dt and save_every depend on the"
    " duration, so give both from the start if you want to extend a run later"
)


def fingerprint(program: str, *data: PyTree) -> str:
    """Return a hash of what a run computes and of its data. It is the same in every process.

    program: the lowered text of the compiled steps, which contains every law, schedule and observer. data: the arrays
    and numbers of the run.
    """
    digest = hashlib.sha256(VERSION.encode())
    # `backend_config` holds addresses of callbacks, which differ between processes.
    digest.update(re.sub(r'backend_config = "[^"]*"', "", program).encode())
    for leaf in jax.tree.leaves(data):
        array = np.ascontiguousarray(leaf)
        digest.update(f"{array.shape} {array.dtype}".encode() + array.tobytes())
    return digest.hexdigest()


def fresh(path: str | os.PathLike, resume: bool, stacklevel: int = 4) -> Path:
    """The path of a checkpoint that can be written. Without `resume` an existing file is renamed, with a warning."""
    path = writable(path)
    if path.exists() and not resume:
        old = path.with_name(path.name + ".old")
        os.replace(path, old)
        warnings.warn(
            f"the checkpoint {path} exists already and is kept as {old}; to continue from it, pass resume=True",
            stacklevel=stacklevel,
        )
    return path


def save(path: str | os.PathLike, name: str, state: PyTree, records: list[Tree]) -> bool:
    """Write the state and all records so far. Gives a warning and returns False if the file cannot be written."""
    arrays = {f"state_{k}": np.asarray(x) for k, x in enumerate(jax.tree.leaves(state))}
    columns = zip(*(jax.tree.leaves(r) for r in records), strict=True)
    arrays |= {f"record_{k}": np.stack([np.asarray(x) for x in column]) for k, column in enumerate(columns)}
    try:
        with written_whole(path) as stream:
            np.savez(stream, fingerprint=name, version=VERSION, **arrays)  # type: ignore[arg-type]
    except OSError as error:
        warnings.warn(
            f"no checkpoint was written: {error}; the run continues, and an earlier checkpoint stays as it is",
            stacklevel=3,
        )
        return False
    return True


def load(
    path: str | os.PathLike, name: str, state: State, like: Tree, differs: str = DIFFERS
) -> tuple[State, list[Tree]]:
    """Return the state and the records of a checkpoint. `state` and `like`, a record, give the structures to restore.

    `differs` says in the message for the checkpoint of another run in what the two runs may differ.

    Raises FileNotFoundError if there is no file, and ValueError if the file is not a checkpoint, or if another version
    of pdjax or another run wrote it.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"no checkpoint at {path}: run once without resume to write it")
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = dict(file)
        mark, version = str(arrays["fingerprint"]), str(arrays["version"])
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        raise ValueError(f"{path} is not a checkpoint of pdjax, or is damaged: {error}") from None
    if version != VERSION:
        raise ValueError(f"checkpoint {path} was written by pdjax {version}, this is {VERSION}: start the run again")
    if mark != name:
        raise ValueError(f"checkpoint {path} belongs to another run: {differs}")
    leaves, structure = jax.tree.flatten(state)
    state = jax.tree.unflatten(structure, [jnp.asarray(arrays[f"state_{k}"]) for k in range(len(leaves))])
    leaves, structure = jax.tree.flatten(like)
    columns = [arrays[f"record_{k}"] for k in range(len(leaves))]
    records = [jax.tree.unflatten(structure, [c[i] for c in columns]) for i in range(len(columns[0]))]
    return state, records
