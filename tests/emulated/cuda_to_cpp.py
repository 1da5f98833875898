#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Converts a CUDA source to C++: launches kernel<<<grid, block, bytes, stream>>>(...) become calls, and shared
memory of dynamic size becomes a pointer.

    cuda_to_cpp.py IN.cu OUT.cpp
"""
import re
import sys
from pathlib import Path

LAUNCH = re.compile(r"([A-Za-z_]\w*(?:<[^;{}]*?>)?)\s*<<<(.*?)>>>\s*\(", re.DOTALL)

SHARED = re.compile(r"extern __shared__ ([\w: ]+?) (\w+)\[\];")


def as_cpp(text: str) -> str:
    """Keeps line numbers."""

    def call(found: re.Match) -> str:
        kernel, where = found.groups()
        start = f"::jade::emulated::launch([&](auto... all) {{ {kernel}(all...); }}, {where})("
        return start + "\n" * (found.group().count("\n") - start.count("\n"))

    text = SHARED.sub(r"\1* const \2 = static_cast<\1*>(::jade::emulated::shared_memory());", text)
    return LAUNCH.sub(call, text)


def main() -> None:
    source, target = map(Path, sys.argv[1:])
    text = source.read_text(encoding="utf-8")
    target.write_text(f'#line 1 "{source}"\n{as_cpp(text)}', encoding="utf-8")


if __name__ == "__main__":
    main()
