#!/usr/bin/env bash
# The whole benchmark on whatever device JAX has, with what fraction of the device's own bandwidth and flops (measured in
# the same run) each row achieves. Results: results/DEVICE/*.json, *.png, device-report.txt. Goes on after a stop.
#
#   pip install -e ".[bench]" "jax[cuda12]"     # or another plugin of JAX
#   benchmarks/gpu.sh                           # or: benchmarks/gpu.sh --quick, benchmarks/gpu.sh jacobians precision
set -euo pipefail
cd "$(dirname "$0")"
python -c "import jax; print('devices:', jax.devices())"
exec pdjax bench --device-report --out results "$@"
