#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# From nothing to a sharp 3D scene: installs missing packages, builds, simulates the demo's blurry frames and events,
# trains the recommended preset (no router) on them, evaluates, prints where the results are, and opens the report on a
# desktop.
#
#   scripts/demo.sh [--set key=value ...]      further arguments are passed to jade_train
#
# Works without a GPU; uses one if there is one. Can be repeated: existing results are kept, and an interrupted training
# is resumed.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/demo.sh; exit ;; esac
step() { printf '\n+ %s\n' "$*" >&2; "$@"; }

step scripts/setup.sh
step scripts/build.sh jade_train jade_eval jade_simulate jade_inspect jade_render jade_export
if [ ! -f runs/demo-data/simulation.yaml ]; then
  rm -rf runs/demo-data
  step build/bin/jade_simulate --config configs/simulate/demo.yaml --output runs/demo-data
fi
if [ ! -f runs/demo/report.html ]; then
  resume=()
  [ -z "$(ls runs/demo/checkpoints 2>/dev/null)" ] || resume=(--resume)
  step build/bin/jade_train --config configs/demo.yaml --output runs/demo "${resume[@]}" "$@"
else
  [ $# -eq 0 ] || echo "demo: runs/demo is trained already, without '$*'; remove that folder to train again" >&2
  step build/bin/jade_eval --run runs/demo
fi
report="$PWD/runs/demo/report.html"
printf '\nreport: %s\nscene:  %s (drop it into any 3D Gaussian viewer)\n' "$report" "$PWD/runs/demo/point_cloud.ply"
# Only for a terminal on a desktop, not for automated checks.
if [ -t 1 ] && [ -z "${CI:-}" ] && [ -n "${DISPLAY:-}${WAYLAND_DISPLAY:-}" ]; then
  opener=$(command -v xdg-open || command -v open || true)
  [ -z "$opener" ] || ("$opener" "$report" </dev/null >/dev/null 2>&1 &)
fi
