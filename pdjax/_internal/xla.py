"""The settings of XLA that pdjax makes: one flag for all programs, and compiler options for some.

On CPUs jaxlib 0.10 runs independent parts of a program concurrently and can miss the end of one of them. The program
then never returns, although all threads are idle. For example, forward and reverse derivatives of a few margins in one
`jit` (batched `eigh` in conditionals) hang within about ten calls. They never hang if the parts run one after the
other. Loops over bonds, maps and transforms take the same time in both cases, because each part already uses all cores.
Where this jaxlib is installed, `set_flag` therefore turns the concurrent scheduler off, unless XLA_FLAGS already sets
this flag. JAX reads the flag at its first computation, so pdjax must be imported before that.
"""

import os
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jaxlib

Function = TypeVar("Function", bound=Callable)

FLAG = "--xla_cpu_enable_concurrency_optimized_scheduler"
AFFECTED = jaxlib.__version__.startswith("0.10.")  # the version that hangs; the options below are known for it

# For forces and matrices of bodies: they compile in half of the time and run as fast.
QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1} if AFFECTED else {}
# For programs that run once or a few times: they compile in a third of the time, and each run takes twice as long.
ONCE = {**QUICK, "xla_backend_optimization_level": 0} if AFFECTED else {}


def set_flag() -> None:
    """Turn XLA's concurrent scheduler off for the jaxlib version with which programs can hang."""
    if AFFECTED and FLAG not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FLAG}=false".strip()


def compiled_with(options: dict) -> Callable[[Function], Function]:
    """`eqx.filter_jit` with the options QUICK or ONCE, only for calls from the host: JAX refuses them elsewhere."""
    return lambda function: eqx.filter_jit(function, compiler_options=options)  # type: ignore[call-overload]
