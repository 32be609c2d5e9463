"""The order of the rooms: imports point one way, and the two wings do not import each other."""

import ast
import importlib
from pathlib import Path

import pytest

import pdjax as pd

PACKAGE = Path(pd.__file__).parent
# From the lowest to the highest; rooms on one line do not import each other.
ORDER = [
    ("_internal",),
    ("geometry",),
    ("models",),
    ("force",),
    ("tangent",),
    ("infinite_lattice", "finite_body"),
    ("studies.closed_forms",),
    ("scenes",),
    ("optimise", "trust"),
    ("files", "figures"),
    ("studies", "bench"),
    ("cli",),
    ("",),
]
LEVEL = {room: level for level, rooms in enumerate(ORDER) for room in rooms}


def module_name(file):
    parts = file.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(file): file for file in PACKAGE.rglob("*.py") if file.name != "__main__.py"}


def room(module):
    return "studies.closed_forms" if module.startswith("studies.closed_forms") else module.partition(".")[0]


def imports(module, top_level_only=False):
    """(target module, imported name) of every import of a module of pdjax."""
    file = MODULES[module]
    tree = ast.parse(file.read_text(encoding="utf-8"))
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in tree.body if top_level_only else ast.walk(tree):
        if not isinstance(node, ast.ImportFrom):
            continue
        if node.level:
            base = package.split(".") if package else []
            base = base[: len(base) - (node.level - 1)]
            target = ".".join([*base, *(node.module.split(".") if node.module else [])])
        elif (node.module or "").startswith("pdjax."):
            target = node.module.removeprefix("pdjax.")
        else:
            continue
        for alias in node.names:
            inner = f"{target}.{alias.name}" if target else alias.name
            yield (inner, "") if inner in MODULES else (target, alias.name)


@pytest.mark.parametrize("module", [m for m in MODULES if m])
def test_imports_point_to_lower_rooms(module):
    mine = LEVEL[room(module)]
    for target, _ in imports(module):
        if target and room(target) != room(module):
            assert LEVEL[room(target)] < mine, f"{module} imports {target}"


def test_there_is_no_cycle_of_imports():
    done, path = set(), []

    def visit(module):
        assert module not in path, " -> ".join([*path, module])
        if module in done:
            return
        path.append(module)
        for target, name in imports(module, top_level_only=True):
            if target != module and not (target in MODULES and MODULES[target].name == "__init__.py" and not name):
                visit(target)
        path.pop()
        done.add(module)

    for module in MODULES:
        visit(module)


def test_no_module_imports_a_private_name_of_another():
    private = [(m, t, n) for m in MODULES for t, n in imports(m) if n.startswith("_") and not n.startswith("__")]
    assert not private


def test_public_names_are_documented_where_they_are_imported_from():
    for name, value in vars(pd).items():
        if not name.startswith("_") and callable(value):
            assert value.__doc__, name


@pytest.mark.parametrize(("old", "new"), [("maps", "infinite_lattice.maps"), ("paper", "studies.paper")])
def test_a_module_that_has_moved_says_where_it_is(old, new):
    with pytest.raises(ModuleNotFoundError, match=f"its content is now in pdjax.{new}"):
        importlib.import_module(f"pdjax.{old}")
    importlib.import_module(f"pdjax.{new}")


def test_every_moved_module_has_its_new_place():
    from pdjax._internal.moved import MOVED

    assert set(MOVED.values()) <= set(MODULES)


def test_an_unknown_module_gives_pythons_error():
    with pytest.raises(ModuleNotFoundError, match=r"^No module named 'pdjax\.nothing'$"):
        importlib.import_module("pdjax.nothing")
