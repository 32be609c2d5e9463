"""The settings of XLA that pdjax makes: one flag for all programs, and compiler options for some.

On CPUs jaxlib 0.10 runs independent parts of a program side by side and can lose the end of one of them. The program
then never returns, with every thread idle. Forward and reverse derivatives of a few margins in one `jit` (batched
`eigh`s in conditionals) stop in this way within some ten calls. They never do where the parts run one after the other.
Loops over bonds, maps and transforms take as long either way, because each part uses all cores itself. So `set_flag`
turns the concurrent scheduler off where that jaxlib is installed, unless XLA_FLAGS already says something about it.
JAX reads the flag at its first computation: import pdjax before that.
"""

import os
from collections.abc import Callable
from typing import Any, TypeVar

import equinox as eqx
import jaxlib

Function = TypeVar("Function", bound=Callable[..., Any])

FLAG = "--xla_cpu_enable_concurrency_optimized_scheduler"
AFFECTED = jaxlib.__version__.startswith("0.10.")  # the version with the fault, and the one whose options are known

# For forces and matrices of bodies: half of the compilation, and they run as fast.
QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1} if AFFECTED else {}
# For what runs once or a few times: a third of the compilation, and each run takes twice as long.
ONCE = {**QUICK, "xla_backend_optimization_level": 0} if AFFECTED else {}


def set_flag() -> None:
    """Turn XLA's concurrent scheduler off where it loses the end of programs."""
    if AFFECTED and FLAG not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FLAG}=false".strip()


def compiled_with(options: dict) -> Callable[[Function], Function]:
    """`eqx.filter_jit` with QUICK or ONCE, for calls from the host: inside another program JAX refuses options."""
    return lambda function: eqx.filter_jit(function, compiler_options=options)  # type: ignore[call-overload]
