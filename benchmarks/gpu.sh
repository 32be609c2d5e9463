#!/usr/bin/env bash
# Runs all benchmark cases on the device that JAX uses. Each row also reports which fraction of the bandwidth and of the
# flops of the device it achieves; both limits are measured in the same run. Results: results/DEVICE/*.json, *.png,
# device-report.txt. After an interruption, start the script again: it continues.
#
#   pip install -e ".[bench]" "jax[cuda12]"     # or another plugin of JAX
#   benchmarks/gpu.sh                           # or: benchmarks/gpu.sh --quick, benchmarks/gpu.sh jacobians precision
set -euo pipefail
cd "$(dirname "$0")"
python -c "import jax; print('devices:', jax.devices())"
exec pdjax bench --device-report --out results "$@"
