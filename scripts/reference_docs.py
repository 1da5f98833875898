#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Generates docs/cli.md and docs/configuration.md from the output of the programs.

    scripts/reference_docs.py [--bin build/bin] [--check]

--check writes nothing and fails if a file differs (ctest `docs.reference`).
"""
import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ("jade_train", "jade_import", "jade_inspect", "jade_eval", "jade_render", "jade_export", "jade_view", "jade_deblur",
            "jade_simulate", "jade_sweep", "jade_bench")
CONFIGURED = {"jade_train": "Training, and every program that reads a data set", "jade_import": "Importing a recording",
              "jade_simulate": "Simulation"}
NEEDED = {"jade_import": ("/path/to/recording",)}  # required arguments of programs
NOTE = "<!-- Written by scripts/reference_docs.py; do not edit. -->\n"


def printed(program: Path, *arguments: str) -> str:
    done = subprocess.run([program, *arguments], capture_output=True, text=True, check=True)
    return "\n".join(line.rstrip() for line in done.stdout.splitlines()).strip()


def command_line(programs: Path) -> str:
    parts = [NOTE, "# Command line\n"]
    for name in PROGRAMS:
        help_text = printed(programs / name, "--help").replace(str(programs / name), name)
        parts.append(f"## {name}\n\n```text\n{help_text}\n```\n")
    return "\n".join(parts)


def configuration(programs: Path) -> str:
    parts = [NOTE, "# Configuration\n\nEvery key with its default, range and meaning, as `--print-config` prints them. `--set a.b=value` overrides a key.\n"]
    for name, title in CONFIGURED.items():
        parts.append(f"## {title}\n\n```yaml\n{printed(programs / name, *NEEDED.get(name, ()), '--print-config')}\n```\n")
    return "\n".join(parts)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", type=Path, default=ROOT / "build/bin")
    parser.add_argument("--check", action="store_true")
    arguments = parser.parse_args()
    code = 0
    for path, text in {"docs/cli.md": command_line(arguments.bin), "docs/configuration.md": configuration(arguments.bin)}.items():
        if not arguments.check:
            (ROOT / path).write_text(text)
        elif not (ROOT / path).exists() or (ROOT / path).read_text() != text:
            print(f"{path}: expected what the programs print, found other text; run scripts/reference_docs.py")
            code = 1
    return code


if __name__ == "__main__":
    sys.exit(main())
