#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that comments and docstrings name their subject.

A comment that begins with "Of", "As", "What", "Whoever", "Where", "The same" and the like makes its reader guess what it
is about, and so do words such as "whoever", "nobody", "ours" or "tells" for a program. CONTRIBUTING.md has pairs of such
comments and better ones. `--root DIR` checks another tree (the tests use it).
"""
import argparse
import re
import sys
from pathlib import Path

FOLDERS = ("apps", "cmake", "lib", "python", "scripts", "tests")
SUFFIXES = {".h", ".cpp", ".cu", ".cuh", ".py", ".js", ".mjs", ".sh", ".css"}
MARK = r"(?://[/!]?<?|#|/?\*+)"
COMMENT = re.compile(rf"^\s*{MARK}(\s|$)")
RIDDLE = re.compile(rf"(?:^\s*{MARK}\s+|^.*?\s///<\s+|^\s*\"\"\")"
                    r"(Of|As|What|Who|Whoever|Whose|Where|The same|Likewise|Those|Nothing)\b")
VAGUE = re.compile(r"\b(whoever|nobody|somebody|ours?|anew|tells?|told|speaks?|teach(es)?|taught|lends?|lent|at hand|"
                   r"comes? back|stands? still)\b", re.IGNORECASE)
CODE_NAME = re.compile(r"`[^`]*`|\"[^\"]*\"|\w*_\w*|\w+\(\)")


def comment_of(line: str, python: bool) -> str:
    """The text of the comment or one-line docstring on a line, without quoted words and names of the code."""
    found = re.match(rf"^\s*{MARK}\s+(.*)$|^.*?\s\s(?:///<|//|#)\s+(.*)$" + (r"|^\s*\"\"\"(.*)$" if python else ""), line)
    return CODE_NAME.sub("", next((text for text in found.groups() if text), "")) if found else ""


def riddles(lines: list[str], python: bool = False) -> list[int]:
    """Numbers of the lines, from 1, on which a comment begins without a subject or has a vague word."""
    found = []
    for index, line in enumerate(lines):
        continues = index > 0 and COMMENT.match(lines[index - 1]) and lines[index - 1].strip() not in ("/**", "//", "#", "*")
        if RIDDLE.match(line) and not (continues and COMMENT.match(line)) or VAGUE.search(comment_of(line, python)):
            found.append(index + 1)
    return found


def problems(root: Path) -> list[str]:
    found = []
    for folder in FOLDERS:
        for path in sorted((root / folder).rglob("*")):
            if path.suffix not in SUFFIXES or not path.is_file() or path.name == "check_english_test.py":
                continue
            lines = path.read_text().splitlines()
            found += [f"{path.relative_to(root).as_posix()}:{number}: name the subject of this comment: "
                      f"{lines[number - 1].strip()}" for number in riddles(lines, path.suffix == ".py")]
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parents[1])
    found = problems(parser.parse_args().root)
    print("\n".join(found), end="\n" if found else "")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
