"""Float64 for every test, shapes and types checked at every call, and one folder of compiled programs for all workers.

Most of the tests' time is compiling, so XLA is told not to optimise, which takes half of the time. With XLA_FLAGS=" "
in the environment the tests have the programs that users get. What one worker, notebook or command has compiled, the
others read from the folder; it is made by the process that starts the workers, named in the environment that they
inherit, and removed at the end. A folder named in JAX_COMPILATION_CACHE_DIR is used instead and stays.
"""

import gc
import importlib.metadata
import os
import tempfile
from pathlib import Path

if "XLA_FLAGS" not in os.environ and importlib.metadata.version("jaxlib").startswith("0.10."):  # the flags it knows
    os.environ["XLA_FLAGS"] = "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false"

import jax
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

FOLDER = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
    FOLDER = tempfile.TemporaryDirectory(prefix="pdjax-tests-", ignore_cleanup_errors=True)
    for name, value in {
        "jax_compilation_cache_dir": FOLDER.name,
        "jax_persistent_cache_min_compile_time_secs": 0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
    }.items():
        os.environ[name.upper()] = str(value)
        jax.config.update(name, value)

jax.config.update("jax_enable_x64", True)
install_import_hook("pdjax", "typecheck.checked")  # before pdjax is imported anywhere
settings.register_profile("pdjax", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("pdjax")


# Tracing makes many small objects: collecting them as often as Python does takes a sixteenth of the time.
gc.set_threshold(200_000, 50, 100)


def pytest_unconfigure():
    """Remove the folder where it was made."""
    if FOLDER is not None:
        FOLDER.cleanup()


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Every compiled function maps memory, and a process may hold 65530 maps: forget them before LLVM aborts."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 20_000:
        jax.clear_caches()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark what long.txt and smoke.txt list: ids, or functions, which stand for all their cases."""
    for mark in ("long", "smoke"):
        lines = (Path(__file__).parent / f"{mark}.txt").read_text(encoding="utf-8").splitlines()
        listed = {line for line in lines if line and not line.startswith("#")}
        for item in items:
            if item.nodeid in listed or item.nodeid.partition("[")[0] in listed:
                item.add_marker(mark)


@pytest.fixture(scope="session")
def law():
    import pdjax as pd

    return pd.LinearElastic(lam=1.0, mu=1.0)
