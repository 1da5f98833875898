#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that tests mirror the library by name.

tests/ROOM/X_test.cpp tests the header X.h of lib/jade/ROOM; X_ASPECT_test.cpp tests one aspect of it, such as
router_cuda_test.cpp. A test of something else must be listed in tests/not_mirrored.txt with the reason. Folders
of tests without such a room are ignored. `--root DIR` checks another tree (the tests use it).
"""
import argparse
import sys
from pathlib import Path

LIST = Path("tests/not_mirrored.txt")


def read_list(path: Path) -> dict[str, str]:
    """Maps the path of a test to the reason why it has no header."""
    entries: dict[str, str] = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            test, _, reason = line.partition(":")
            entries[test] = reason.strip()
    return entries


def mirrors(test: Path, headers: set[str]) -> bool:
    name = test.name.removesuffix("_test.cpp")
    return any(name == header or name.startswith(header + "_") for header in headers)


def problems(root: Path) -> list[str]:
    listed = read_list(root / LIST)
    found = [f"{LIST}: {test}: expected a reason, found none" for test, reason in listed.items() if not reason]
    found += [f"{LIST}: {test}: no such file; take it out" for test in listed if not (root / test).is_file()]
    for room in sorted((root / "tests").iterdir()):
        library = root / "lib/jade" / room.name
        if not library.is_dir():
            continue
        headers = {header.stem for header in library.rglob("*.h")}
        for test in sorted(room.glob("*_test.cpp")):
            name = test.relative_to(root).as_posix()
            if mirrors(test, headers) == (name in listed):
                found.append(f"{LIST}: {name}: has a header of its name by now; take it out" if name in listed else
                             f"{name}: expected a name that begins with a header of lib/jade/{room.name}, found none; "
                             f"rename it, or add it to {LIST} with the reason")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    found = problems(parser.parse_args().root)
    for problem in found:
        print(problem)
    print(f"{len(found)} problems with the names of tests" if found else "tests mirror the library")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
