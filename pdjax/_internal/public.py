"""Error messages of public functions that name an argument of the wrong kind.

The arguments are examined only after a call has failed, so a successful call takes no extra time. They are compared
with the annotations of the parameters. An argument must be an instance of the class of pdjax that its parameter is
annotated with. If the parameter is annotated as numbers, the argument must not be another object, a string or None.
"""

import functools
import inspect
import types
import typing
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")

HOME = str(Path(__file__).parents[1])
EARLIER = {"fam": "family", "fams": "families"}  # earlier names of arguments, still accepted
MADE = {  # how a user obtains an object of each class
    "Scene": "pdjax.scene(…) or a function of pdjax.scenes",
    "Motion": "pdjax.motion(scene, density) or a moving scene of pdjax.scenes",
    "Points": "lattice, bar, plate, cuboid or cloud",
    "LatticeFamily": "pdjax.lattice_family(dim, N)",
    "Families": "pdjax.families(body, horizon)",
    "Bonds": "family.bonds(F) or families.bonds(u)",
    "Criterion": "CriticalStretch, CriticalBondEnergy or BreakingRule",
    "Law": "LinearElastic, NeoHookean or EnergyLaw",
    "AbstractModel": "a model such as SethHill or Correspondence",
    "History": "what pdjax.simulate returns",
    "StabilityMap": "what pdjax.stability_map returns",
    "Plane": "Plane(point, normal)",
    "Segment": "Segment(start, end) in 2D",
    "Polygon": "Polygon(vertices) in 3D",
}


def _kinds(hint: object) -> tuple[type, ...]:
    """The classes that an annotation allows. The result is empty if the annotation names no class."""
    if isinstance(hint, types.UnionType) or typing.get_origin(hint) is typing.Union:
        return tuple(k for part in typing.get_args(hint) for k in _kinds(part))
    origin = typing.get_origin(hint)
    if isinstance(origin, type) and not issubclass(origin, Callable):  # type: ignore[arg-type]
        return (origin,)
    return (hint,) if isinstance(hint, type) and hint is not Any else ()


def _misfit(name: str, value: Any, hint: object, default: object) -> str | None:
    """The error message for an argument of the wrong kind, or None if the argument fits."""
    if value is default:
        return None
    kinds = _kinds(hint)
    told = [MADE[k.__name__] for k in kinds if k.__name__ in MADE]
    if told:
        fits = isinstance(value, kinds)
        names = " or ".join(k.__name__ for k in kinds if k.__name__ in MADE)
        return None if fits else f"{name} must be {names} ({'; '.join(told)}); got {_shown(value)}"
    if "Callable" in str(hint):
        return None if callable(value) or isinstance(value, str) else f"{name} must be a function; got {_shown(value)}"
    if Sequence in kinds and isinstance(value, str) and str not in kinds:  # a string is a sequence too
        return f"{name} must be numbers; got {_shown(value)}"
    if hasattr(value, "_fields") and not any(hasattr(k, "_fields") for k in kinds):  # a named tuple of pdjax
        return f"{name} must be numbers; got {_shown(value)}"
    if kinds and not any(issubclass(k, int | float | complex | np.ndarray | np.generic | jax.Array) for k in kinds):
        names = " or ".join(k.__name__ for k in kinds if k is not types.NoneType)
        return None if isinstance(value, kinds) or object in kinds else f"{name} must be {names}; got {_shown(value)}"
    if kinds and all(k in (int, float) for k in kinds) and np.ndim(value) > 0:
        return f"{name} must be one number; got an array of shape {np.shape(value)}"
    if isinstance(value, str) and str in kinds:
        return None
    ours = type(value).__module__.startswith("pdjax.")
    strange = value is None or ours or isinstance(value, str | eqx.Module | dict)
    wrong = strange or (callable(value) and not hasattr(value, "shape"))
    return f"{name} must be numbers; got {_shown(value)}" if wrong else None


def _shown(value: object) -> str:
    if isinstance(value, str | int | float | types.NoneType):
        return repr(value)[:60]
    return f"a function, {value.__name__}" if inspect.isfunction(value) else type(value).__name__


def _own(error: BaseException) -> bool:
    """True if a line of the package raised the error, not a function of another library."""
    last, trace = None, error.__traceback__
    while trace is not None:
        last, trace = trace.tb_frame.f_code.co_filename, trace.tb_next
    return last is not None and last.startswith(HOME)


def _annotations(function: Callable) -> dict[str, Any]:
    """The annotations of a function. Names of packages that are imported only on use are left out."""
    try:
        return typing.get_type_hints(function)
    except NameError:
        return {name: hint for name, hint in function.__annotations__.items() if not isinstance(hint, str)}


def public_function(function: Callable[Parameters, Result]) -> Callable[Parameters, Result]:
    """Decorate a function: errors name an argument of the wrong kind, and earlier argument names are accepted."""
    signature = inspect.signature(function)
    renamed = {old: new for old, new in EARLIER.items() if new in signature.parameters}

    @functools.wraps(function)
    def checked(*args: Parameters.args, **kwargs: Parameters.kwargs) -> Result:
        for old in renamed.keys() & kwargs.keys():
            if renamed[old] not in kwargs:
                kwargs[renamed[old]] = kwargs.pop(old)
        try:
            return function(*args, **kwargs)
        except Exception as error:
            if isinstance(error, ValueError) and _own(error):
                raise
            try:
                given = signature.bind(*args, **kwargs).arguments
            except TypeError:
                raise error from None  # Python's message names the unknown or missing argument
            hints = _annotations(function)
            for name, value in given.items():
                parameter = signature.parameters[name]
                if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
                    continue
                said = _misfit(name, value, hints.get(name), parameter.default)
                if said is not None:
                    raise ValueError(said) from None
            shapes = ", ".join(f"{n} {np.shape(v)}" for n, v in given.items() if isinstance(v, np.ndarray | jax.Array))
            if shapes and isinstance(error, TypeError | ValueError | IndexError):
                error.add_note(
                    f"{function.__name__} was given arrays of the shapes {shapes}; its docstring states the right ones"
                )
            raise

    return checked
