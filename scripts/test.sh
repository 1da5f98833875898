#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs missing packages, builds, and runs all tests.
#
#   scripts/test.sh [CTEST ARGUMENTS]      for example: scripts/test.sh -R splat
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/test.sh; exit ;; esac
scripts/setup.sh
scripts/build.sh
run=(ctest --test-dir build --output-on-failure --no-tests=error "$@")
echo "+ ${run[*]}" >&2
"${run[@]}"
