#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Everything that can be checked without running the program: format, module order, clang-tidy.
#
#   scripts/lint.sh [--fast]      --fast leaves clang-tidy out
#
# clang-tidy reads the files whose mistakes cost most: the modules without heavy torch headers, and
# whatever differs from the main branch.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
scripts/format.sh --check
python3 scripts/check_layers.py
[ "${1:-}" != --fast ] || exit 0

tool=$(command -v clang-tidy-14 || command -v clang-tidy || true)
[ -n "$tool" ] || { echo "lint: clang-tidy 14 is missing: apt install clang-tidy-14" >&2; exit 2; }
[ -f build/compile_commands.json ] || scripts/build.sh jade_lib_core
# clang reads neither GCC's precompiled header nor its warning flags.
filtered=$(mktemp -d); trap 'rm -rf "$filtered"' EXIT
python3 - build/compile_commands.json "$filtered/compile_commands.json" <<'PY'
import json, re, sys
commands = json.load(open(sys.argv[1]))
for entry in commands:
    command = re.sub(r'-include \S*cmake_pch\.hxx', '', entry["command"])
    command = re.sub(r'-Winvalid-pch|-fopenmp|-fuse-ld=\S+', '', command)
    entry["command"] = command[command.index(" ", command.index("ccache")) + 1:] if "ccache" in command else command
json.dump(commands, open(sys.argv[2], "w"))
PY
mapfile -t files < <(git ls-files 'lib/jade/core/*.cpp' 'lib/jade/config/*.cpp' 'lib/jade/io/*.cpp' 'lib/jade/geometry/*.cpp' | grep -v '_missing.cpp')
echo "+ $tool on ${#files[@]} files" >&2
printf '%s\n' "${files[@]}" | xargs -P "$(nproc)" -n 2 "$tool" -p "$filtered" --quiet 2> >(grep -v 'warnings generated' >&2)
