#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# All checks that do not run the program: format, module order, names of tests, comments, clang-tidy.
#
#   scripts/lint.sh [--fast]      --fast skips clang-tidy
#
# clang-tidy checks core, config, io and geometry, which include few heavy headers.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
case "${1:-}" in -h | --help) sed -n '3,/^[^#]/s/^# \{0,1\}//p' scripts/lint.sh; exit ;; esac
[ $# -eq 0 ] || [ "$*" = --fast ] || { echo "lint: expected --fast or nothing, found '$*'" >&2; exit 2; }
scripts/format.sh --check
python3 scripts/check_layers.py
python3 scripts/check_test_names.py
python3 scripts/check_english.py
if command -v node >/dev/null; then node scripts/lint_front.mjs; else echo "lint: the front end is not checked, node is missing: apt install nodejs" >&2; fi
if command -v hadolint >/dev/null; then hadolint Dockerfile; fi
[ "${1:-}" != --fast ] || exit 0

tool=$(command -v clang-tidy-14 || command -v clang-tidy || true)
[ -n "$tool" ] || { echo "lint: clang-tidy 14 is missing: apt install clang-tidy-14" >&2; exit 2; }
# A separate configuration: the release build combines files into one compilation.
cmake --preset tidy >/dev/null
cmake --build build-tidy --target jade_version >/dev/null
# clang supports neither GCC's precompiled header nor its warning flags.
filtered=$(mktemp -d); trap 'rm -rf "$filtered"' EXIT
python3 - build-tidy/compile_commands.json "$filtered/compile_commands.json" <<'PY'
import json, re, sys
commands = json.load(open(sys.argv[1]))
for entry in commands:
    command = re.sub(r'-include \S*cmake_pch\.hxx', '', entry["command"])
    command = re.sub(r'-Winvalid-pch|-fopenmp|-fuse-ld=\S+', '', command)
    entry["command"] = command[command.index(" ", command.index("ccache")) + 1:] if "ccache" in command else command
json.dump(commands, open(sys.argv[2], "w"))
PY
# A file without its own command (one for CUDA, say) would be checked with another file's.
mapfile -t files < <(git ls-files 'lib/jade/core/*.cpp' 'lib/jade/config/*.cpp' 'lib/jade/io/*.cpp' 'lib/jade/geometry/*.cpp' |
  while read -r file; do grep -qF "\"$PWD/$file\"" "$filtered/compile_commands.json" && echo "$file"; done)
echo "+ $tool on ${#files[@]} files" >&2
printf '%s\n' "${files[@]}" | xargs -P "$(nproc)" -n 2 "$tool" -p "$filtered" --quiet 2> >(grep -v 'warnings generated' >&2)
