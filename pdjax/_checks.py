"""Errors that teach: what was wrong, what was expected, what came.

Values known before tracing raise `ValueError` at once; values seen only as tracers are
guarded by `equinox.error_if`, so that a bad number never travels on silently.
"""

import dataclasses
import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


def is_concrete(*trees: Any) -> bool:
    """True if no leaf of the trees is a tracer: values can be looked at now."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def require(x: jax.Array, ok: Any, message: str) -> jax.Array:
    """Return `x`; raise with `message` where `ok` is false, now if concrete, at run time if traced."""
    if is_concrete(ok):
        if not bool(np.all(np.asarray(ok))):
            raise ValueError(message)
        return x
    return eqx.error_if(x, jnp.logical_not(jnp.all(ok)), message)


def check_positive(name: str, value: Any) -> None:
    """Refuse a constant that is not finite and > 0, where its value is known."""
    if is_concrete(value):
        require(value, jnp.isfinite(value) & (value > 0), f"{name} must be finite and > 0; got {value}")


def finite(name: str, value: Any) -> np.ndarray:
    """`value` as a NumPy array of floats; ValueError naming it if any entry is NaN or infinite."""
    array = np.asarray(value, dtype=float)
    bad = np.flatnonzero(~np.isfinite(array).reshape(-1))
    if bad.size:
        raise ValueError(
            f"{name} must be finite; {bad.size} of {array.size} entries are not, the first at flat index {bad[0]}"
        )
    return array


def as_real(x: Any) -> jax.Array:
    """An array of the default float type at least: a constant given as 1 is 1.0."""
    x = jnp.asarray(x)
    return x if jnp.issubdtype(x.dtype, jnp.inexact) else x.astype(jnp.result_type(float))


def floats_to_arrays(module: Any) -> None:
    """Python floats among the fields of a module that has just been made become arrays, but static ones."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if isinstance(value, float) and not field.metadata.get("static", False):
            object.__setattr__(module, field.name, as_real(value))


def choice(name: str, value: Any, allowed: Sequence[str]) -> str:
    """`value` if it is one of `allowed`; else ValueError listing them."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(allowed)}; got {value!r}")
    return value


def deformation_gradient(F: Any, dim: int) -> jax.Array:
    """`F` as a (dim, dim) array, refused where its shape is wrong, it is not finite or det F ≤ 0."""
    F = jnp.asarray(F)
    if F.shape != (dim, dim):
        raise ValueError(f"F must be a ({dim}, {dim}) deformation gradient for this family; got shape {F.shape}")
    if not jnp.issubdtype(F.dtype, jnp.floating):
        F = F.astype(jnp.result_type(float))
    ok = jnp.isfinite(F).all() & (jnp.linalg.det(F) > 0)
    return require(F, ok, "F must be finite with det F > 0 (no inverted or collapsed matter)")


def writable(path: str | os.PathLike) -> Path:
    """`path`, if a file can be created there; OSError now rather than after a long computation.

    Nothing is left behind, and an existing file is left as it is.
    """
    path = Path(path)
    if path.is_dir():
        raise IsADirectoryError(f"cannot write to {path}: it is a directory; name a file")
    if not path.parent.is_dir():
        raise FileNotFoundError(f"cannot write to {path}: the directory {path.parent} does not exist")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
        if path.exists():
            with open(path, "ab"):
                pass
    except OSError as error:
        raise PermissionError(f"cannot write to {path}: {error.strerror or error}") from error
    return path


@contextmanager
def moved_whole(path: str | os.PathLike, part: Path) -> Iterator[None]:
    """What is written to `part` becomes `path`, or nothing does; a disk that refuses is said with the file's name."""
    try:
        yield
        os.replace(part, path)
    except OSError as error:
        raise OSError(f"could not write {path}: {error.strerror or error}; what stood there is as it was") from error
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def written_whole(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A stream that becomes the file `path` when all of it is written, and nothing if something fails on the way."""
    path = writable(path)
    part = path.with_name(path.name + ".part")
    with moved_whole(path, part), open(part, "wb") as stream:
        yield stream
