"""The time and the compiled programs of the first call of the main functions.

`CALLS` maps the name of each call to a function that prepares its arguments and returns the call. As a program,
`python -m pdjax.bench.first_calls NAME ...` measures the named calls one after the other in one process, with 64-bit
floats, and prints one JSON object for each:

    unit       seconds that the trivial program x + x takes to compile and run, median of five
    first      seconds of the first call
    second     seconds of a later call, median of five

With the option --count before the names it counts the programs instead. Counting takes time, so the two are separate:

    programs   programs that the first call requests from XLA, including those that a disk cache provides
    lines      lines of StableHLO of all these programs

`pdjax bench start` draws the table, and the tests compare the counts with budgets.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import pdjax as pd

Call = Callable[[], object]

REPEATS = 5


def _law() -> pd.LinearElastic:
    return pd.LinearElastic(lam=1.0, mu=1.0)  # type: ignore[call-arg, arg-type]


def _seth_hill() -> pd.SethHill:
    return pd.SethHill(1.0, _law())  # type: ignore[arg-type]


def _silling() -> pd.Correspondence:
    return pd.Correspondence(_law(), pd.SillingControl(1.0))  # type: ignore[arg-type]


def _compressed(dim: int) -> np.ndarray:
    return 0.97 * np.eye(dim)


def _stability(dim: int, model: pd.AbstractModel) -> Callable[[], pd.Stability]:
    family = pd.lattice_family(dim, 3)
    return lambda: pd.stability(model, family, _compressed(dim))


def _second_model() -> Call:
    jax.block_until_ready(_stability(2, _seth_hill())().margin)
    return _stability(2, pd.Correspondence(_law()))


def _critical_load(criterion: str) -> Call:
    model, family = _seth_hill(), pd.lattice_family(2, 3)
    return lambda: pd.critical_load(model, family, pd.hydrostatic, criterion)


def _critical_load_after_stability() -> Call:
    jax.block_until_ready(_stability(2, _seth_hill())().margin)
    return _critical_load("symbol")


def _center_block() -> Call:
    model, family = _seth_hill(), pd.lattice_family(2, 3)
    return lambda: pd.center_block(model, family, _compressed(2))


def _body(function: Callable) -> Call:
    """Prepare a function of Silling's model with its penalty on 10³ points, with families of up to 122 bonds."""
    model, families = _silling(), pd.families(pd.lattice((10, 10, 10)), 3.0)
    u = 1e-3 * np.random.default_rng(0).normal(size=(1000, 3))
    return lambda: function(model, families, u)


def _body_stability() -> Call:
    scene = pd.scenes.step_size_bar(100, 3, -1e-3)
    return lambda: pd.body_stability(scene).eigenvalue


def _solve() -> Call:
    body = pd.lattice((33, 3, 3))
    x = body.positions[:, 0]
    held, pulled = pd.prescribe(x < 3, 0.0), pd.prescribe(x > 30, [0.01, 0.0, 0.0])
    scene = pd.scene(body, pd.families(body, 1.5), _silling(), held, pulled)
    return lambda: pd.solve(scene).u


def _simulate() -> Call:
    wave = pd.scenes.wave(40)
    return lambda: pd.simulate(wave, show_progress=False).u


def _plate(function: Callable) -> Call:
    """Prepare a function of the Seth–Hill model on 5 × 3 points at rest."""
    body = pd.lattice((5, 3))
    model, families, u = _seth_hill(), pd.families(body, 2.0), np.zeros((15, 2))
    return lambda: function(model, families, u)


def _scene() -> Call:
    body = pd.lattice((5, 3))
    model, families = _seth_hill(), pd.families(body, 2.0)
    return lambda: pd.scene(body, families, model, pd.prescribe([0, 1, 2], 0.0))


def _force_state() -> Call:
    model, family = _seth_hill(), pd.lattice_family(2, 3)
    return lambda: pd.force_state(model, family, _compressed(2))


def _energy() -> Call:
    model, bonds = _seth_hill(), pd.lattice_family(2, 3).bonds(jnp.asarray(_compressed(2)))
    return lambda: model.energy(bonds)


# The calls that a user waits for. Each is measured in separate processes.
MAIN: dict[str, Callable[[], Call]] = {
    "stability, 2D": lambda: _stability(2, _seth_hill()),
    "stability, 3D": lambda: _stability(3, _seth_hill()),
    "stability, a second model": _second_model,
    "critical_load after stability": _critical_load_after_stability,
    "critical_load": lambda: _critical_load("symbol"),
    "critical_load, diagonal": lambda: _critical_load("diagonal"),
    "center_block": _center_block,
    "force_density, 10³ points": lambda: _body(pd.force_density),
    "jacobian, 10³ points": lambda: _body(pd.jacobian),
    "body_stability": _body_stability,
    "solve, 297 points in 3D": _solve,
    "simulate": _simulate,
}
# Calls that take less time than the import. They are measured one after the other in one process.
SMALL: dict[str, Callable[[], Call]] = {
    "lattice_family": lambda: lambda: pd.lattice_family(2, 3),
    "families": lambda: lambda: pd.families(pd.lattice((5, 3)), 2.0),
    "scene": _scene,
    "force_state": _force_state,
    "model.energy": _energy,
    "strain_energy": lambda: _plate(pd.strain_energy),
    "stress": lambda: _plate(pd.stress),
}
CALLS = MAIN | SMALL


def _seconds(call: Call) -> float:
    start = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - start


def _trivial(n: int) -> Call:
    return lambda: jax.jit(lambda x: x + x)(np.ones(n))


def _unit() -> float:
    """Return the median seconds of a trivial program that is compiled for each of five sizes."""
    spent = [_seconds(_trivial(n)) for n in (3, 5, 7, 11, 13)]
    return float(np.median(spent))


@contextmanager
def _compiling() -> Iterator[list[str]]:
    """Collect the StableHLO of the programs that the body of the `with` requests from XLA, one text each."""
    texts: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        jax.config.update("jax_include_debug_info_in_dumps", False)
        jax.config.update("jax_dump_ir_to", folder)
        try:
            yield texts
        finally:
            jax.config.update("jax_dump_ir_to", "")
            texts += [file.read_text() for file in Path(folder).glob("*_compile.mlir")]


def count(name: str) -> dict:
    """Count the programs, and their lines of StableHLO, that the first call of `name` in this process compiles."""
    call = CALLS[name]()
    with _compiling() as texts:
        jax.block_until_ready(call())
    return {"name": name, "programs": len(texts), "lines": sum(text.count("\n") for text in texts)}


def measure(name: str) -> dict:
    """Measure the first call of `name` in this process, later calls, and a trivial program [s]."""
    unit = _unit()
    call = CALLS[name]()
    first = _seconds(call)
    second = float(np.median([_seconds(call) for _ in range(REPEATS)]))
    return {"name": name, "unit": unit, "first": first, "second": second}


def main(arguments: list[str]) -> None:
    """Measure the named calls one after the other, or count their programs with the option --count."""
    jax.config.update("jax_enable_x64", True)
    counting = arguments[:1] == ["--count"]
    for name in arguments[1:] if counting else arguments:
        print(json.dumps(count(name) if counting else measure(name), ensure_ascii=False), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
