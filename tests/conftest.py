"""Float64 for every test, shapes and types checked at every call, and one compiled cache of JAX functions."""

from pathlib import Path

import jax
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
install_import_hook("pdjax", "typecheck.checked")  # before pdjax is imported anywhere
settings.register_profile("pdjax", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("pdjax")


@pytest.fixture(scope="module", autouse=True)
def few_memory_maps():
    """Every compiled function maps memory, and a process may hold 65530 maps: forget them before LLVM aborts."""
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > 20_000:
        jax.clear_caches()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """What long.txt lists is long."""
    lines = (Path(__file__).parent / "long.txt").read_text(encoding="utf-8").splitlines()
    listed = {line for line in lines if line and not line.startswith("#")}
    for item in items:
        if item.nodeid in listed:
            item.add_marker(pytest.mark.long)


@pytest.fixture(scope="session")
def law():
    import pdjax as pd

    return pd.LinearElastic(lam=1.0, mu=1.0)
