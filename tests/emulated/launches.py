#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a CUDA source with every kernel<<<grid, block, bytes, stream>>>(...) as a call of C++.

    launches.py IN.cu OUT.cpp
"""
import re
import sys
from pathlib import Path

LAUNCH = re.compile(r"([A-Za-z_]\w*(?:<[^;{}]*?>)?)\s*<<<(.*?)>>>\s*\(", re.DOTALL)


def as_calls(text: str) -> str:
    """Lines keep their numbers."""

    def call(found: re.Match) -> str:
        kernel, where = found.groups()
        start = f"::jade::emulated::launch([&](auto... all) {{ {kernel}(all...); }}, {where})("
        return start + "\n" * (found.group().count("\n") - start.count("\n"))

    return LAUNCH.sub(call, text)


def main() -> None:
    source, target = map(Path, sys.argv[1:])
    text = source.read_text(encoding="utf-8")
    target.write_text(f'#line 1 "{source}"\n{as_calls(text)}', encoding="utf-8")


if __name__ == "__main__":
    main()
