"""What every benchmark shares: the machine's name, medians with spread, and a result file."""

import json
import platform
import time
from pathlib import Path

import jax
import numpy as np

RESULTS = Path(__file__).parent / "results"


def machine() -> dict:
    """What ran it."""
    cpu = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        cpu = next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
        cores = sum(line.startswith("processor") for line in lines)
    except (OSError, StopIteration):
        cores = None
    return {
        "cpu": cpu,
        "cores": cores,
        "device": jax.devices()[0].device_kind,
        "python": platform.python_version(),
        "jax": jax.__version__,
        "numpy": np.__version__,
    }


def timed(work, repeats: int = 5) -> dict:
    """First call (with compilation) apart; then the median, fastest and slowest of `repeats` calls, in seconds."""
    start = time.perf_counter()
    jax.block_until_ready(work())
    first = time.perf_counter() - start
    spent = []
    for _ in range(repeats):
        start = time.perf_counter()
        jax.block_until_ready(work())
        spent.append(time.perf_counter() - start)
    return {"first": first, "median": float(np.median(spent)), "fastest": min(spent), "slowest": max(spent)}


def write(name: str, numbers: dict, figure=None) -> None:
    """results/NAME.json, and NAME.png if there is a figure; the numbers are printed too."""
    RESULTS.mkdir(exist_ok=True)
    numbers = {"machine": machine(), **numbers}
    (RESULTS / f"{name}.json").write_text(json.dumps(numbers, indent=1) + "\n")
    print(json.dumps(numbers, indent=1))
    if figure is not None:
        figure.savefig(RESULTS / f"{name}.png", dpi=140)
