"""The settings of XLA that pdjax makes: one for all programs, before the first of them runs, and one for some.

On CPUs jaxlib 0.10 runs independent parts of a program side by side and can lose the end of one: the program then
never returns, with every thread idle. Forward and reverse derivatives of a few margins in one `jit` (batched `eigh`s in
conditionals) stop so within some ten calls, and never where the parts go one after the other; loops over bonds, maps
and transforms take as long either way, for each part uses all cores itself. What XLA_FLAGS says of it already stays.
Importing this module sets it; where JAX has run something before, it comes too late.
"""

import os
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jaxlib

Function = TypeVar("Function", bound=Callable[..., Any])

FLAG = "--xla_cpu_enable_concurrency_optimized_scheduler"

if FLAG not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FLAG}=false".strip()

# XLA refuses options that it does not know, so only the versions tried get them.
_TRIED = jaxlib.__version__.startswith("0.10.")
# For forces and matrices of bodies: half of the compilation, and they run as fast.
QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1} if _TRIED else {}
# For what runs once or a few times: a third of the compilation, and each run takes twice as long.
ONCE = {**QUICK, "xla_backend_optimization_level": 0} if _TRIED else {}


def quick_jit(options: dict) -> Callable[[Function], Function]:
    """`eqx.filter_jit` with QUICK or ONCE, for calls from the host: options are refused inside another program."""
    return lambda function: eqx.filter_jit(function, compiler_options=options)  # type: ignore[call-overload]
