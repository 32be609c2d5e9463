"""Checks of arguments, conversions between NumPy and JAX, and safe writing of files.

An error message says what is wrong, what was expected and what came. Values that are known before tracing raise
`ValueError` at once. Values that exist only inside a traced program are checked by `equinox.error_if` when the program
runs.
"""

import contextlib
import dataclasses
import functools
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, BinaryIO, ParamSpec, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike, DTypeLike

Tree = TypeVar("Tree")
Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
Numbers = jax.Array | np.ndarray  # an array of the kind that `namespace` tells
Same = TypeVar("Same", bound=Numbers)  # a result of the kind of the argument


def is_concrete(*trees: object) -> bool:
    """True if no leaf of the trees is a tracer, so that all values can be read now."""
    return not any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(trees))


def inside_jit() -> bool:
    """True while `jit` or `scan` traces. Arrays made then are tracers too, and the host cannot read their values."""
    return isinstance(jax.device_put(np.float32(0)), jax.core.Tracer)


def computed(program: Callable, *arguments: object) -> Any:
    """The results of a jitted program for concrete arguments, as NumPy arrays.

    It also works while another function is traced.
    """
    with jax.core.eval_context():
        return jax.device_get(program(*arguments))


def computed_in_double(program: Callable, *arguments: object) -> Any:
    """`computed` in float64, also where JAX is set to 32 bits.

    Computations on the host that decide a verdict use it. In float32 a stiffness divided by the fourth power of a
    length overflows for a lattice of a micrometre in SI units.
    """
    with _of_64_bits():
        return computed(program, *_double(arguments))


def _double(tree: Tree) -> Tree:
    """The tree with its floating-point arrays in double precision. Call it only where JAX is set to 64 bits.

    Arrays that have double precision already are returned unchanged.
    """

    def wide(leaf: Any) -> Any:
        dtype = {"f": np.float64, "c": np.complex128}.get(getattr(getattr(leaf, "dtype", None), "kind", ""))
        if dtype is None or leaf.dtype == dtype:
            return leaf
        array: np.ndarray = np.asarray(leaf, dtype)
        return jax.device_put(array) if isinstance(leaf, jax.Array) else array

    return jax.tree.map(wide, tree)


def in_double(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a function of the host so that it computes float32 arguments in float64 and returns float32.

    `computed_in_double` gives the reason. Under a JAX transformation the function runs unchanged, see also
    `differentiated_in_double`.
    """

    def is_single(leaf: object) -> bool:
        return getattr(leaf, "dtype", None) == np.float32

    @functools.wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        given = (args, kwargs)
        if not any(map(is_single, jax.tree.leaves(given))) or not is_concrete(given) or inside_jit():
            return function(*args, **kwargs)
        with _of_64_bits():
            args, kwargs = _double(given)
            out = jax.device_get(eqx.filter(answer := function(*args, **kwargs), lambda x: isinstance(x, jax.Array)))
        narrow = jax.tree.map(lambda x: jax.device_put(np.asarray(x, np.float32) if x.dtype == float else x), out)
        return eqx.combine(narrow, eqx.filter(answer, lambda x: not isinstance(x, jax.Array)))

    return run


def differentiated_in_double(function: Callable[Parameters, jax.Array]) -> Callable[Parameters, jax.Array]:
    """Decorate a function that `in_double` decorates and that returns one number: its gradient is computed in float64.

    The gradient with respect to float32 arguments is computed in float64 as the value is, and rounded to float32. In
    float32 the block of a bond overflows for a lattice of a micrometre in SI units: a modulus of 1e11 Pa gives 1e41.
    Inside `jit`, under `vmap` and for second derivatives, the function runs unchanged.
    """

    @functools.wraps(function)
    def run(*args: Parameters.args, **kwargs: Parameters.kwargs) -> jax.Array:
        leaves, form = jax.tree.flatten((args, kwargs))
        where = [i for i, x in enumerate(leaves) if isinstance(x, jax.core.Tracer) and x.dtype == np.float32]
        if not where or inside_jit():
            return function(*args, **kwargs)

        def of(values: list, rest: list) -> jax.Array:
            every = list(rest)
            for i, x in zip(where, values, strict=True):
                every[i] = x
            args, kwargs = jax.tree.unflatten(form, every)
            return function(*args, **kwargs)

        number = jax.custom_jvp(lambda values: of(values, leaves))

        @number.defjvp
        def _(primals, tangents):
            (values,), (rates,) = primals, tangents
            if is_concrete(values):
                rest = [None if i in where else x for i, x in enumerate(leaves)]
                with _of_64_bits():
                    wide = jax.device_get(jax.grad(of)(_double(values), _double(rest)))
                value, slopes = of(values, leaves), [np.asarray(x, np.float32) for x in wide]
            else:
                value, slopes = jax.value_and_grad(of)(values, leaves)
            return value, sum(jnp.sum(slope * rate) for slope, rate in zip(slopes, rates, strict=True))

        return number([leaves[i] for i in where])

    return run


def _of_64_bits() -> contextlib.AbstractContextManager:
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(True)
    from jax.experimental import enable_x64  # type: ignore[attr-defined]  # its old place

    return enable_x64(True)


def namespace(*trees: object) -> ModuleType:
    """NumPy if no leaf of the trees is a tracer, otherwise jax.numpy.

    Outside a compiled program every operation of jax.numpy compiles a separate program. NumPy compiles nothing.
    """
    return np if is_concrete(*trees) else jnp


def frozen(tree: Tree) -> Tree:
    """The tree with `stop_gradient` applied to its tracers. Concrete values are returned unchanged.

    Under `grad`, JAX 0.10 returns a traced Python number as a typed number, which `eqx.filter_jit` takes for a static
    argument. Every new value would compile a new program, so such a number becomes an array.
    """

    def value(x: object) -> object:
        if not isinstance(x, jax.core.Tracer):
            return x
        y = jax.lax.stop_gradient(x)
        return y if isinstance(y, jax.Array) else jax.device_put(np.asarray(y, x.dtype))

    return jax.tree.map(value, tree)


def in_host_memory(*trees: object) -> bool:
    """True if all values are concrete and no array lies on an accelerator.

    The move of a body's arrays from an accelerator to the host takes longer than the compilation of a few programs.
    """
    arrays = [leaf for leaf in jax.tree.leaves(trees) if isinstance(leaf, jax.Array)]
    return is_concrete(arrays) and all(d.platform == "cpu" for a in arrays for d in a.devices())


def on_host(tree: object) -> Any:
    """The tree with concrete JAX arrays converted to NumPy arrays, and weakly typed scalars to Python numbers.

    A Python number does not change the dtype of an array in the same operation, and neither does a weakly typed scalar.
    Tracers are returned unchanged.
    """

    def value(leaf: object) -> object:
        if not isinstance(leaf, jax.Array) or isinstance(leaf, jax.core.Tracer):
            return leaf
        array = np.asarray(leaf)
        return array.item() if leaf.weak_type and array.ndim == 0 else array

    return jax.tree.map(value, tree)


def on_device(tree: object) -> Any:
    """The tree with NumPy arrays and numbers converted to JAX arrays: the last step of a computation in NumPy.

    `jax.device_put` compiles nothing, whereas `jnp.asarray` compiles a program for each shape. The JAX arrays may share
    memory with the NumPy arrays. Do not pass an array that a user may write to.
    """
    return jax.tree.map(lambda leaf: leaf if isinstance(leaf, jax.Array) else jax.device_put(leaf), tree)


def require(x: Tree, ok: ArrayLike, message: str) -> Tree:
    """Return `x`, or raise an error with `message` if an entry of `ok` is false.

    A concrete `ok` raises ValueError now. A traced `ok` raises the error when the program runs.
    """
    if is_concrete(ok):
        if not bool(np.all(np.asarray(ok))):
            raise ValueError(message)
        return x
    return eqx.error_if(x, jnp.logical_not(jnp.all(ok)), message)


def check_positive(name: str, value: object) -> None:
    """Raise ValueError if a constant with a concrete value is not finite and > 0."""
    if is_concrete(value):
        number = np.asarray(value)
        require(value, np.isfinite(number) & (number > 0), f"{name} must be finite and > 0; got {value}")


def native(name: str, value: object) -> np.ndarray:
    """A concrete array as a NumPy array in the byte order of the machine.

    Lists, pandas columns, read-only arrays, arrays in Fortran order and arrays of the other byte order (from meshio)
    are accepted. Masked entries and entries that are not numbers raise ValueError.
    """
    if isinstance(value, np.ma.MaskedArray):
        hidden = int(np.ma.getmaskarray(value).sum())
        if hidden:
            raise ValueError(
                f"{name} has {hidden} masked entries, but every entry must be a number. Fill them with"
                f" {name}.filled(value), or remove the points that they belong to"
            )
        value = value.data
    try:
        array = np.asarray(value)
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"{name} must be an array of numbers; got {value!r:.80} ({error})") from None
    if array.dtype.kind not in "biufc" and array.dtype.name != "bfloat16":
        raise ValueError(f"{name} must be an array of numbers; got {value!r:.80}")
    return array if array.dtype.isnative else array.astype(array.dtype.newbyteorder("="))


def finite(name: str, value: object) -> np.ndarray:
    """`value` as a NumPy array of floats. ValueError with its name is raised if any entry is NaN or infinite."""
    array = native(name, value).astype(float)
    bad = np.flatnonzero(~np.isfinite(array).reshape(-1))
    if bad.size:
        raise ValueError(
            f"{name} must be finite; {bad.size} of {array.size} entries are not, the first at flat index {bad[0]}"
        )
    return array


def as_array(x: object, dtype: DTypeLike = float, name: str = "a value") -> jax.Array:
    """`x` as a JAX array, by default of the float type that JAX is set to. A concrete value compiles nothing."""
    dtype = jax.dtypes.canonicalize_dtype(dtype)
    if not is_concrete(x):
        return jnp.asarray(x, dtype)
    if isinstance(x, jax.Array) and x.dtype == dtype and not x.weak_type:
        return x
    return jax.device_put(np.array(native(name, x), dtype))  # a copy, for a user may write to the original


def as_real(x: object, name: str = "a constant") -> jax.Array:
    """`x` as an array. Integers and booleans become numbers of the default float type: 1 becomes 1.0."""
    real = jnp.result_type(float)
    if isinstance(x, jax.Array) and jnp.issubdtype(x.dtype, jnp.inexact):
        return x
    if not is_concrete(x):
        x = jnp.asarray(x)
        return x if jnp.issubdtype(x.dtype, jnp.inexact) else x.astype(real)
    if isinstance(x, float | complex) and not isinstance(x, np.generic):
        return jax.device_put(x)  # a weakly typed scalar
    array = native(name, x)
    return jax.device_put(np.array(array, real if array.dtype.kind in "biu" else None))


def floats_to_arrays(module: eqx.Module) -> None:
    """Convert the Python floats among the fields of a new module to arrays, except in static fields."""
    for field in dataclasses.fields(module):
        value = getattr(module, field.name, None)
        if isinstance(value, float) and not field.metadata.get("static", False):
            object.__setattr__(module, field.name, as_real(value))


def choice(name: str, value: Any, allowed: Sequence[str]) -> str:
    """`value` if it is one of `allowed`. Otherwise ValueError lists the allowed values."""
    if value not in allowed:
        raise ValueError(f"{name} must be one of {', '.join(allowed)}; got {value!r}")
    return value


def deformation_gradient(F: object, dim: int) -> jax.Array:
    """`F` as a (dim, dim) array. A wrong shape, an entry that is not finite or det F ≤ 0 raises an error."""
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
    """`path`, if a file can be created there. Otherwise OSError is raised now, before a long computation.

    The check leaves no file behind and does not change an existing file.
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
    """Rename the file `part` to `path` after the block has written it, or delete it if the block fails.

    An OSError in the block is raised again with the name of the file.
    """
    try:
        yield
        os.replace(part, path)
    except OSError as error:
        raise OSError(f"could not write {path}: {error.strerror or error}; an earlier file is unchanged") from error
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def written_whole(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """Open a stream that becomes the file `path` only after all of it is written. A failure leaves no file behind."""
    path = writable(path)
    part = path.with_name(path.name + ".part")
    with moved_whole(path, part), open(part, "wb") as stream:
        yield stream


SIDES = {"negative": -1.0, "compression": -1.0, "positive": 1.0, "tension": 1.0}


def sign_of(side: object) -> float:
    """The sign of the loads of a side: −1 for "negative" or "compression", 1 for "positive" or "tension"."""
    return SIDES[choice("side", side, list(SIDES))]
