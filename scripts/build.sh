#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Configures and builds the given targets, or everything, into build/.
#
#   scripts/build.sh [TARGET...]
#
# Reads JADE_CUDA=ON|OFF|AUTO (default AUTO) and CMAKE_CUDA_ARCHITECTURES="90" from the environment.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/build.sh; exit ;; esac
# Four source files per compilation halve the time of a clean build, most of which is spent in libtorch's templates.
configure=(cmake -S . -B build -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=4)
[ -z "${JADE_CUDA:-}" ] || configure+=("-DJADE_CUDA=$JADE_CUDA")
[ -z "${CMAKE_CUDA_ARCHITECTURES:-}" ] || configure+=("-DCMAKE_CUDA_ARCHITECTURES=$CMAKE_CUDA_ARCHITECTURES")
echo "+ ${configure[*]}" >&2
"${configure[@]}" >build-configure.log 2>&1 || { cat build-configure.log >&2; rm -f build-configure.log; exit 1; }
grep '^-- JADE-GS' build-configure.log >&2 || true
mkdir -p build && mv build-configure.log build/configure.log
build=(cmake --build build)
[ $# -eq 0 ] || build+=(--target "$@")
echo "+ ${build[*]}" >&2
"${build[@]}"
