"""Settings of all tests: float64, shapes and types checked at every call, one folder of compiled programs.

Most of the time of the tests is compilation. XLA is therefore told not to optimise, which halves this time. With
XLA_FLAGS=" " in the environment, the tests use the same programs as users. All workers, notebooks and commands share a
folder of compiled programs. The process that starts the workers makes the folder, names it in the environment that they
inherit, and removes it at the end. A folder named in JAX_COMPILATION_CACHE_DIR is used instead and is not removed.
"""

import gc
import importlib.metadata
import os
import tempfile
from pathlib import Path

if "XLA_FLAGS" not in os.environ and importlib.metadata.version("jaxlib").startswith("0.10."):  # it knows these flags
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
install_import_hook("pdjax", "typecheck.checked")  # must come before the first import of pdjax
settings.register_profile("pdjax", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("pdjax")


# Tracing makes many small objects. Garbage collection at Python's default frequency takes a sixteenth of the time.
gc.set_threshold(200_000, 50, 100)


def pytest_unconfigure():
    """Remove the folder in the process that has made it."""
    if FOLDER is not None:
        FOLDER.cleanup()


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Clear compiled functions after a module if they use many memory maps. LLVM aborts beyond 65530 in a process."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 20_000:
        jax.clear_caches()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark the tests that long.txt and smoke.txt list, by id or by function. A function stands for all its cases."""
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
