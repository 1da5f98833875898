#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that comments name their subject.

A comment that begins with "Of", "As", "What", "Whoever", "Where", "The same" and the like makes its reader guess what it
is about; CONTRIBUTING.md has pairs of such comments and better ones. `--root DIR` checks another tree (the tests use it).
"""
import argparse
import re
import sys
from pathlib import Path

FOLDERS = ("apps", "cmake", "lib", "python", "scripts", "tests")
SUFFIXES = {".h", ".cpp", ".cu", ".cuh", ".py", ".js", ".mjs", ".sh"}
COMMENT = re.compile(r"^\s*(//[/!]?<?|#|/?\*+)(\s|$)")
RIDDLE = re.compile(r"^\s*(//[/!]?<?|#|/?\*+)\s+(Of|As|What|Whoever|Whose|Where|The same|Likewise|Those|Nothing)\b")


def riddles(lines: list[str]) -> list[int]:
    """Numbers of the lines, from 1, on which a comment begins without a subject."""
    found = []
    for index, line in enumerate(lines):
        continues = index > 0 and COMMENT.match(lines[index - 1]) and lines[index - 1].strip() not in ("/**", "//", "#", "*")
        if RIDDLE.match(line) and not continues:
            found.append(index + 1)
    return found


def problems(root: Path) -> list[str]:
    found = []
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SUFFIXES or not path.is_file():
                continue
            lines = path.read_text().splitlines()
            found += [f"{path.relative_to(root).as_posix()}:{number}: name the subject of this comment first: "
                      f"{lines[number - 1].strip()}" for number in riddles(lines)]
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    found = problems(parser.parse_args().root)
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
