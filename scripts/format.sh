#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Formats all C++ and CUDA sources with clang-format 14, or checks them.
#
#   scripts/format.sh [--check]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/format.sh; exit ;; esac
# Reject unknown arguments instead of formatting everything.
[ $# -eq 0 ] || [ "$*" = --check ] || { echo "format: expected --check or nothing, found '$*'" >&2; exit 2; }
tool=$(command -v clang-format-14 || command -v clang-format || true)
[ -n "$tool" ] || { echo "format: clang-format 14 is missing: apt install clang-format-14" >&2; exit 2; }
"$tool" --version | grep -q 'version 14\.' || { echo "format: expected clang-format 14, found $("$tool" --version); other versions format differently" >&2; exit 2; }
flags=(-i)
[ "${1:-}" != --check ] || flags=(--dry-run --Werror)
git ls-files -z '*.h' '*.cpp' '*.cu' '*.cuh' | xargs -0 -r "$tool" "${flags[@]}"
