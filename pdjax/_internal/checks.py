"""Errors that teach: what was wrong, what was expected, what came.

Values known before tracing raise `ValueError` at once; values seen only as tracers are
guarded by `equinox.error_if`, so that a bad number never travels on silently.
"""

import contextlib
import dataclasses
import functools
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np


def is_concrete(*trees: Any) -> bool:
    """True if no leaf of the trees is a tracer: values can be looked at now."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def inside_jit() -> bool:
    """True while `jit` or `scan` traces: values made here are traced too, and the host can't look at any."""
    return isinstance(jax.device_put(np.float32(0)), jax.core.Tracer)


def computed(program: Any, *arguments: Any) -> Any:
    """What a jitted program gives for values that are known, as NumPy arrays; also while something else is traced."""
    with jax.core.eval_context():
        return jax.device_get(program(*arguments))


def computed_in_double(program: Any, *arguments: Any) -> Any:
    """`computed`, with numbers of 64 bits throughout, also where JAX is set to 32.

    What is computed on the host and decides a verdict is computed so: in 32 bits a stiffness over a length to the
    fourth is beyond all numbers for a lattice of a micrometre in SI units.
    """
    with _of_64_bits():
        return computed(program, *_double(arguments))


def _double(tree: Any) -> Any:
    """The tree with its floating arrays in double precision; those that have it stay as they are. Call it where JAX is
    set to 64 bits."""

    def wide(leaf: Any) -> Any:
        dtype = {"f": np.float64, "c": np.complex128}.get(getattr(getattr(leaf, "dtype", None), "kind", ""))
        if dtype is None or leaf.dtype == dtype:
            return leaf
        array: np.ndarray = np.asarray(leaf, dtype)
        return jax.device_put(array) if isinstance(leaf, jax.Array) else array

    return jax.tree.map(wide, tree)


def in_double(function: Callable) -> Callable:
    """A function that runs on the host, given numbers of 32 bits, computes in 64 and answers in 32; see
    `computed_in_double`. Under a transformation it is itself."""

    def is_single(leaf: Any) -> bool:
        return getattr(leaf, "dtype", None) == np.float32

    @functools.wraps(function)
    def run(*args: Any, **kwargs: Any) -> Any:
        given = (args, kwargs)
        if not any(map(is_single, jax.tree.leaves(given))) or not is_concrete(given) or inside_jit():
            return function(*args, **kwargs)
        with _of_64_bits():
            args, kwargs = _double(given)
            out = jax.device_get(eqx.filter(answer := function(*args, **kwargs), lambda x: isinstance(x, jax.Array)))
        narrow = jax.tree.map(lambda x: jax.device_put(np.asarray(x, np.float32) if x.dtype == float else x), out)
        return eqx.combine(narrow, eqx.filter(answer, lambda x: not isinstance(x, jax.Array)))

    return run


def _of_64_bits() -> Any:
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(True)
    from jax.experimental import enable_x64  # type: ignore[attr-defined]  # its old place

    return enable_x64(True)


def namespace(*trees: Any) -> Any:
    """NumPy if no leaf of the trees is a tracer, else jax.numpy.

    Every operation of jax.numpy outside a program compiles a program of its own, NumPy's compile nothing.
    """
    return np if is_concrete(*trees) else jnp


def frozen(tree: Any) -> Any:
    """The tree with no derivative flowing through it; values that are known stay as they are."""
    return jax.tree.map(lambda x: jax.lax.stop_gradient(x) if isinstance(x, jax.core.Tracer) else x, tree)


def in_host_memory(*trees: Any) -> bool:
    """Whether all values are known and none lies on an accelerator: moving arrays of a body would take longer than
    compiling a few programs."""
    arrays = [leaf for leaf in jax.tree.leaves(trees) if isinstance(leaf, jax.Array)]
    return is_concrete(arrays) and all(d.platform == "cpu" for a in arrays for d in a.devices())


def on_host(tree: Any) -> Any:
    """The tree with concrete JAX arrays as NumPy arrays; a scalar of weak type becomes a Python number.

    Python numbers leave the dtype of an array that they meet as it is, as scalars of weak type do. Tracers stay.
    """

    def value(leaf: Any) -> Any:
        if not isinstance(leaf, jax.Array) or isinstance(leaf, jax.core.Tracer):
            return leaf
        array = np.asarray(leaf)
        return array.item() if leaf.weak_type and array.ndim == 0 else array

    return jax.tree.map(value, tree)


def on_device(tree: Any) -> Any:
    """The tree with NumPy arrays and numbers as JAX arrays: the last step of what NumPy has computed.

    `jax.device_put` compiles nothing; `jnp.asarray` compiles a program for each shape. The arrays may share the memory
    of the NumPy arrays, so pass no array that a user may write to.
    """
    return jax.tree.map(lambda leaf: leaf if isinstance(leaf, jax.Array) else jax.device_put(leaf), tree)


def require(x: Any, ok: Any, message: str) -> Any:
    """Return `x`; raise with `message` where `ok` is false, now if concrete, at run time if traced."""
    if is_concrete(ok):
        if not bool(np.all(np.asarray(ok))):
            raise ValueError(message)
        return x
    return eqx.error_if(x, jnp.logical_not(jnp.all(ok)), message)


def check_positive(name: str, value: Any) -> None:
    """Refuse a constant that is not finite and > 0, where its value is known."""
    if is_concrete(value):
        number = np.asarray(value)
        require(value, np.isfinite(number) & (number > 0), f"{name} must be finite and > 0; got {value}")


def native(name: str, value: Any) -> np.ndarray:
    """A known array as NumPy has it, in the machine's byte order; refused where entries are masked or no numbers.

    Lists, pandas columns, read-only arrays, arrays in Fortran order or of the other byte order (meshio's) are taken.
    """
    if isinstance(value, np.ma.MaskedArray):
        hidden = int(np.ma.getmaskarray(value).sum())
        if hidden:
            raise ValueError(
                f"{name} has {hidden} masked entries, which stand for no number: fill them, {name}.filled(value), or"
                " leave their points away"
            )
        value = value.data
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"{name} must be an array of numbers; got {value!r:.80} ({error})") from None
    if array.dtype.kind not in "biufc" and array.dtype.name != "bfloat16":
        raise ValueError(f"{name} must be an array of numbers; got {value!r:.80}")
    return array if array.dtype.isnative else array.astype(array.dtype.newbyteorder("="))


def finite(name: str, value: Any) -> np.ndarray:
    """`value` as a NumPy array of floats; ValueError naming it if any entry is NaN or infinite."""
    array = native(name, value).astype(float)
    bad = np.flatnonzero(~np.isfinite(array).reshape(-1))
    if bad.size:
        raise ValueError(
            f"{name} must be finite; {bad.size} of {array.size} entries are not, the first at flat index {bad[0]}"
        )
    return array


def as_array(x: Any, dtype: Any = float, name: str = "a value") -> jax.Array:
    """`x` as a JAX array of a dtype, by default the float type that is set. A value that is known compiles nothing."""
    dtype = jax.dtypes.canonicalize_dtype(dtype)
    if not is_concrete(x):
        return jnp.asarray(x, dtype)
    if isinstance(x, jax.Array) and x.dtype == dtype and not x.weak_type:
        return x
    return jax.device_put(np.array(native(name, x), dtype))  # a copy, for a user may write to the original


def as_real(x: Any, name: str = "a constant") -> jax.Array:
    """An array of the default float type at least: a constant given as 1 is 1.0."""
    real = jnp.result_type(float)
    if isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.inexact):
        return x
    if not is_concrete(x):
        x = jnp.asarray(x)
        return x if jnp.issubdtype(x.dtype, jnp.inexact) else x.astype(real)
    if isinstance(x, float | complex) and not isinstance(x, np.generic):
        return jax.device_put(x)  # of weak type
    array = native(name, x)
    return jax.device_put(np.array(array, real if array.dtype.kind in "biu" else None))


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
    given, F = F, as_real(F, "F")
    if F.shape != (dim, dim):
        raise ValueError(f"F must be a ({dim}, {dim}) deformation gradient for this family; got shape {F.shape}")
    if not jnp.issubdtype(F.dtype, jnp.floating):
        F = F.astype(jnp.result_type(float))
    if is_concrete(given):
        value = np.asarray(given, dtype=float)
        ok = np.isfinite(value).all() and np.linalg.det(value) > 0
    else:
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


@contextlib.contextmanager
def moved_whole(path: str | os.PathLike, part: Path) -> Iterator[None]:
    """What is written to `part` becomes `path`, or nothing does; a disk that refuses is said with the file's name."""
    try:
        yield
        os.replace(part, path)
    except OSError as error:
        raise OSError(f"could not write {path}: {error.strerror or error}; what stood there is as it was") from error
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def written_whole(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A stream that becomes the file `path` when all of it is written, and nothing if something fails on the way."""
    path = writable(path)
    part = path.with_name(path.name + ".part")
    with moved_whole(path, part), open(part, "wb") as stream:
        yield stream


SIDES = {"negative": -1.0, "compression": -1.0, "positive": 1.0, "tension": 1.0}


def sign_of(side: Any) -> float:
    """The sign of the loads of a side: −1 for "negative" or "compression", 1 for "positive" or "tension"."""
    return SIDES[choice("side", side, list(SIDES))]
