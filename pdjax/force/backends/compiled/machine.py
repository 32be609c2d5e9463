"""LLVM modules as machine code of this processor, and as call targets of XLA."""

import ctypes
import functools
import hashlib
import threading

import jax
from llvmlite import binding, ir

_ENGINES: dict[str, binding.ExecutionEngine] = {}  # they own the machine code, so they live as long as the process
_ALONE = threading.Lock()  # two threads may trace the same program


@functools.cache
def target() -> tuple[binding.TargetMachine, int]:
    """The processor of this machine, and how many numbers of 64 bits the loops treat at once.

    These fill two vectors of AVX-512, or one of any other kind.
    """
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    features = binding.get_host_cpu_features()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(), features=features.flatten(), opt=3, jit=True
    )
    return machine, 16 if features.get("avx512f") else 4 if features.get("avx2") else 2


def _address(name: str, text: str) -> int:
    """The address of the function `handler` of a module, compiled."""
    machine, _ = target()
    module = binding.parse_assembly(text)
    module.verify()
    tuning = binding.create_pipeline_tuning_options(speed_level=2)
    tuning.loop_unrolling = False  # the loops contain whole vectors already, and long bodies
    passes = binding.create_pass_builder(machine, tuning)
    passes.getModulePassManager().run(module, passes)
    _ENGINES[name] = binding.create_mcjit_compiler(module, machine)
    _ENGINES[name].finalize_object()
    return _ENGINES[name].get_function_address("handler")


def register(module: ir.Module) -> str:
    """Compile a module, give its function `handler` to XLA, and return the name of the call target.

    The name is made from the text of the module. A program that JAX has stored for another process therefore never
    calls other code.
    """
    text = str(module)
    name = "pdjax_" + hashlib.sha256(text.encode()).hexdigest()[:32]
    with _ALONE:
        if name not in _ENGINES:
            capsule = ctypes.pythonapi.PyCapsule_New
            capsule.restype, capsule.argtypes = ctypes.py_object, [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
            jax.ffi.register_ffi_target(name, capsule(_address(name, text), None, None), platform="cpu")
    return name
