#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Checks that lib/jade follows the module order of lib/layers.txt.

Fails on an include of a module that layers.txt does not list for the including module, on a module listed before
one that it uses, and on a folder that is not in layers.txt. `--root DIR` checks another tree (the tests use it).
"""
import argparse
import re
import sys
from pathlib import Path

INCLUDE = re.compile(r'^\s*#\s*include\s+"jade/([^/"]+)/')
SOURCES = {".h", ".cpp", ".cu", ".cuh", ".inc"}


def read_layers(path: Path) -> dict[str, list[str]]:
    layers: dict[str, list[str]] = {}
    for line in path.read_text().splitlines():
        if line and not line.startswith("#"):
            module, _, uses = line.partition(":")
            layers[module] = uses.split()
    return layers


def problems(root: Path) -> list[str]:
    layers = read_layers(root / "lib" / "layers.txt")
    found: list[str] = []
    known: set[str] = set()
    for module, uses in layers.items():
        for use in uses:
            if use not in known:
                found.append(f"lib/layers.txt: {module} uses {use}, which does not stand above it in the list")
        known.add(module)
    for folder in sorted((root / "lib" / "jade").iterdir()):
        if folder.is_dir() and folder.name not in layers:
            found.append(f"lib/jade/{folder.name}: not in lib/layers.txt")
        for file in sorted(folder.rglob("*")):
            if file.suffix not in SOURCES:
                continue
            for number, line in enumerate(file.read_text(errors="replace").splitlines(), 1):
                match = INCLUDE.match(line)
                if match and match[1] not in [folder.name, *layers.get(folder.name, [])]:
                    found.append(f"{file.relative_to(root)}:{number}: {folder.name} may not include {match[1]}"
                                 " (lib/layers.txt)")
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent)
    found = problems(parser.parse_args().root)
    for problem in found:
        print(problem)
    print(f"{len(found)} problems with the module order" if found else "the module order holds")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
