"""Float64 for every test, shapes and types checked at every call, and one compiled cache of JAX functions."""

import jax
import pytest
from hypothesis import settings
from jaxtyping import install_import_hook

jax.config.update("jax_enable_x64", True)
install_import_hook("pdjax", "typecheck.checked")  # before pdjax is imported anywhere
settings.register_profile("pdjax", deadline=None, max_examples=20, derandomize=True)
settings.load_profile("pdjax")


@pytest.fixture(scope="session")
def law():
    import pdjax as pd

    return pd.LinearElastic(lam=1.0, mu=1.0)
