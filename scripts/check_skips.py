#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Fails if ctest skipped tests that should have run, and lists them.

    scripts/check_skips.py RESULTS.xml [PATTERN ...]      RESULTS.xml: of ctest --output-junit
                                                          PATTERN: names that may be skipped, as '*.cuda'
"""
import argparse
import fnmatch
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

RAN = ("run", "fail")


def left_out(results: Path) -> dict[str, str]:
    """Names of the tests that did not run, with the last line of each."""
    found = {}
    for case in ElementTree.parse(results).iter("testcase"):
        if case.get("status") not in RAN:
            said = (case.findtext("system-out") or "").split("\n")
            found[case.get("name", "")] = next((line for line in reversed(said) if line.strip()), "without a word")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("results", type=Path)
    parser.add_argument("expected", nargs="*", metavar="PATTERN")
    arguments = parser.parse_args()
    try:
        skipped = left_out(arguments.results)
    except (OSError, ElementTree.ParseError) as error:
        print(f"check_skips: {arguments.results}: expected the results of ctest --output-junit: {error}", file=sys.stderr)
        return 3
    unexpected = {name: said for name, said in skipped.items()
                  if not any(fnmatch.fnmatchcase(name, pattern) for pattern in arguments.expected)}
    for name, said in unexpected.items():
        print(f"check_skips: {name} did not run: {said}", file=sys.stderr)
    print(f"{len(skipped)} tests did not run, {len(unexpected)} of them unexpectedly")
    return 1 if unexpected else 0


if __name__ == "__main__":
    sys.exit(main())
