#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Builds OpenCV's core, imgproc and imgcodecs with only PNG, JPEG, TIFF and WebP, as static libraries, from Debian's
# source package. Debian's own build links GDAL, poppler, x265 and 150 MB more, which a wheel would have to include, and
# whose licences (GPL) would apply to it.
#
#   scripts/build_opencv.sh FOLDER      makes FOLDER/prefix; cmake -DOpenCV_DIR=FOLDER/prefix/lib/cmake/opencv4 finds it
#
# Needs root or a user who can run apt-get source, and libpng-dev, a libjpeg-dev, libtiff-dev, libwebp-dev. Exit code 3:
# one of them is missing.
set -euo pipefail
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' "${BASH_SOURCE[0]}"; exit ;; esac
fail() { printf 'build_opencv: %s\n' "$*" >&2; exit 3; }
[ $# -eq 1 ] || { printf 'build_opencv: expected a folder, found %s arguments\n' $# >&2; exit 2; }
for header in png.h jpeglib.h tiff.h webp/encode.h; do
  echo "#include <cstdio>
#include <$header>" | c++ -fsyntax-only -x c++ - 2>/dev/null ||
    fail "expected $header, found none; apt install libpng-dev libjpeg62-turbo-dev libtiff-dev libwebp-dev"
done
mkdir -p "$1"
cd "$1"
[ -f prefix/lib/cmake/opencv4/OpenCVConfig.cmake ] && exit

# Package sources for this call only; the machine's own are unchanged.
# shellcheck source=/dev/null
suite=$(. /etc/os-release && echo "$VERSION_CODENAME")
mkdir -p lists
echo "deb-src ${MIRROR:-http://deb.debian.org/debian} $suite main" >sources.list
apt=(apt-get -qq -o "Dir::Etc::sourcelist=$PWD/sources.list" -o Dir::Etc::sourceparts=- -o "Dir::State::lists=$PWD/lists")
{ "${apt[@]}" update && "${apt[@]}" source --download-only opencv 2>/dev/null; } ||
  fail "apt-get source opencv failed; is there a network?"
mkdir -p source
tar xf opencv_*.orig.tar.xz -C source --strip-components=1

off=(BUILD_{TESTS,PERF_TESTS,opencv_apps,EXAMPLES,DOCS,JAVA,opencv_python3}
  WITH_{GDAL,GDCM,OPENEXR,OPENJPEG,JASPER,LAPACK,EIGEN,IPP,ITT,OPENCL,TBB,OPENMP,PROTOBUF,QUIRC,ADE,VA,FFMPEG,GTK,GSTREAMER,V4L,1394})
off=("${off[@]/#/-D}")
cmake -S source -B build -G Ninja -DCMAKE_BUILD_TYPE=Release "-DCMAKE_INSTALL_PREFIX=$PWD/prefix" \
  -DBUILD_LIST=core,imgproc,imgcodecs -DBUILD_SHARED_LIBS=OFF -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCPU_DISPATCH= \
  -DOPENCV_PYTHON_SKIP_DETECTION=ON -DWITH_JPEG=ON -DWITH_PNG=ON -DWITH_TIFF=ON -DWITH_WEBP=ON "${off[@]/%/=OFF}" >configure.log ||
  { tail configure.log >&2; exit 1; }
cmake --build build --target install >build.log || { tail build.log >&2; exit 1; }
