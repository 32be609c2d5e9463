"""The examples in the docstrings of all public names, run as a reader would run them, in float64."""

import doctest
import inspect
import types

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest

import pdjax as pd

matplotlib.use("Agg")
ROOMS = ("scenes", "observers", "figures", "closed_forms", "export")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def public():
    """(name, object) of everything that users reach from `pdjax`."""
    for name, value in vars(pd).items():
        if name[0] != "_" and not isinstance(value, types.ModuleType | dict | tuple):
            yield name, value
    for room in ROOMS:
        module = getattr(pd, room)
        for name, value in vars(module).items():
            own = getattr(value, "__module__", "").startswith("pdjax") and callable(value)
            exported = name in getattr(module, "__all__", [name])
            if (
                name[0] != "_"
                and own
                and exported
                and (hasattr(module, "__path__") or value.__module__ == module.__name__)
            ):
                yield f"{room}.{name}", value


PUBLIC = dict(public())


def documented(name):
    """(name, docstring) of an object and of its public methods."""
    value = PUBLIC[name]
    yield name, inspect.getdoc(value) or ""
    if inspect.isclass(value):
        for part, member in vars(value).items():
            if part[0] != "_" and (callable(member) or isinstance(member, property | classmethod | staticmethod)):
                yield f"{name}.{part}", inspect.getdoc(member) or ""


@pytest.mark.parametrize("name", PUBLIC)
def test_examples_give_what_they_show(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    parser, runner = doctest.DocTestParser(), doctest.DocTestRunner(optionflags=FLAGS, verbose=False)
    found = {part: text for part, text in documented(name) if ">>>" in text}
    assert name in found, f"the docstring of {name} has no example"
    for part, text in found.items():
        said = []
        test = parser.get_doctest(
            text, {"pd": pd, "np": np, "jax": jax, "jnp": jnp, "__name__": "__main__"}, part, None, 0
        )
        runner.run(test, out=said.append)
        assert runner.failures == 0, "".join(said)
