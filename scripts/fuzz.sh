#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds the fuzz targets with clang under address and undefined sanitizers and runs each for a while.
#
#   scripts/fuzz.sh [SECONDS] [READER ...]     60 seconds each of: colmap ecf evt hdf5 llff npy npz
#
# Stops at the first finding; its input is left in build-fuzz/findings/ and can be given to
# build-fuzz/bin/jade_fuzz_<reader> again. JADE_FUZZ_BUILD names another build folder.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/fuzz.sh; exit ;; esac
seconds="${1:-60}"
shift || true
[[ $seconds =~ ^[1-9][0-9]*$ ]] || { echo "fuzz.sh: expected a number of seconds, found '$seconds'" >&2; exit 2; }
readers=("$@")
[ ${#readers[@]} -gt 0 ] || readers=(colmap ecf evt hdf5 llff npy npz)
build="${JADE_FUZZ_BUILD:-build-fuzz}"

compiler=""
for name in clang++ clang++-18 clang++-17 clang++-16 clang++-15 clang++-14; do
  if command -v "$name" > /dev/null; then compiler="$name"; break; fi
done
if [ -z "$compiler" ]; then
  echo "fuzz.sh: clang with libFuzzer is missing: apt install clang libclang-rt-14-dev" >&2
  exit 2
fi

run() { echo "+ $*" >&2; "$@"; }
run cmake -S . -B "$build" -G Ninja -DCMAKE_CXX_COMPILER="$compiler" -DJADE_CUDA=OFF \
  -DJADE_FUZZ=ON -DJADE_SANITIZE=address,undefined -DCMAKE_BUILD_TYPE=RelWithDebInfo \
  -DCMAKE_CXX_FLAGS="-fsanitize=fuzzer-no-link" > /dev/null
run ninja -C "$build" jade_fuzz

mkdir -p "$build/findings"
run "$build/bin/jade_fuzz_seeds" "$build/seeds"
# LibTorch is not instrumented: memory that it keeps until exit is not a leak, and its containers have no annotations.
# Allocations beyond the fuzzer's limit fail, as on a small machine: libhdf5 allocates as much as a damaged file says.
export ASAN_OPTIONS="detect_leaks=0:detect_odr_violation=0:detect_container_overflow=0:allocator_may_return_null=1:max_allocation_size_mb=2900"
export UBSAN_OPTIONS="print_stacktrace=1:halt_on_error=1"
for reader in "${readers[@]}"; do
  mkdir -p "$build/corpus/$reader"
  run nice -n 19 "$build/bin/jade_fuzz_$reader" -max_total_time="$seconds" -timeout=20 \
    -rss_limit_mb=3000 -max_len=65536 -print_final_stats=1 \
    -artifact_prefix="$build/findings/$reader-" "$build/corpus/$reader" "$build/seeds/$reader"
done
echo "fuzz.sh: nothing found in $seconds s each of: ${readers[*]}"
