"""Short text of models, laws and controls for `print` and error messages.

Equinox prints `SethHill(m=f64[], law=LinearElastic(lam=f64[], mu=f64[]))`, which hides the values. `shown` prints
`SethHill(m=1.0, law=LinearElastic(lam=1.0, mu=1.0))` instead.
"""

import dataclasses

import equinox as eqx
import jax
import numpy as np


def shown(module: eqx.Module) -> str:
    """Name of the module and its fields with their values, on one line.

    A single number is shown by its value, an array by its shape: `array(20,)`. A value that JAX is tracing is shown as
    `traced(20,)`, and as `traced()` if it is a scalar. A field is left out where its value is its default, None or ().
    """
    fields = [f for f in dataclasses.fields(module) if f.repr and not _is_absent(f, getattr(module, f.name, None))]
    return f"{type(module).__name__}({', '.join(f'{f.name}={_value(getattr(module, f.name, None))}' for f in fields)})"


def _is_absent(field: dataclasses.Field, value: object) -> bool:
    return any(value is empty and field.default is empty for empty in (None, ()))


def _value(value: object) -> str:
    if isinstance(value, jax.core.Tracer):
        return f"traced{value.shape}"
    if isinstance(value, jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct):
        return str(np.asarray(value)) if _is_known_number(value) else f"array{value.shape}"
    if isinstance(value, eqx.Module) and type(value).__repr__ is eqx.Module.__repr__:
        return shown(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key!r}: {_value(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        entries = (f"{name}={_value(entry)}" for name, entry in zip(value._fields, value, strict=True))
        return f"{type(value).__name__}({', '.join(entries)})"
    if isinstance(value, tuple | list):
        text = ", ".join(map(_value, value))
        return f"[{text}]" if isinstance(value, list) else f"({text}{',' if len(value) == 1 else ''})"
    if callable(value) and not isinstance(value, eqx.Module) and hasattr(value, "__name__"):
        return value.__name__
    return repr(value)


def _is_known_number(value: jax.Array | np.ndarray | np.generic | jax.ShapeDtypeStruct) -> bool:
    """Whether the value is one number that this process can read."""
    if value.shape != () or isinstance(value, jax.ShapeDtypeStruct):
        return False
    return not isinstance(value, jax.Array) or (value.is_fully_addressable and not value.is_deleted())


def told(module: object) -> str:
    """The text of `print(module)` where its values are known and single, otherwise equinox's form."""
    try:
        return str(module)
    except (TypeError, ValueError, IndexError, jax.errors.JAXTypeError):
        return eqx.tree_pformat(module)
