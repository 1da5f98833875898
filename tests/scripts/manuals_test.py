#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests of the man pages and the completion that scripts/manuals.py generated from the built programs: they contain
every flag of --help, bash completes with them, and the shells and roff accept them.

    manuals_test.py BIN_FOLDER MANUALS_FOLDER
"""

import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

BIN, SHARE = Path(sys.argv[1]), Path(sys.argv[2]) / "share"
PROGRAMS = sorted(path.name for path in (SHARE / "bash-completion/completions").iterdir())


def completed(program, *words):
    """Completions that bash offers for the last word."""
    script = f"""source {SHARE}/bash-completion/completions/{program}
COMP_WORDS=({program} {' '.join(f"'{word}'" for word in words)}); COMP_CWORD={len(words)}
_{program}; printf '%s\\n' "${{COMPREPLY[@]}}" """
    return subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=True).stdout.split()


class Manuals(unittest.TestCase):
    def test_every_flag_of_help_is_in_all(self):
        self.assertGreaterEqual(len(PROGRAMS), 11)
        for program in PROGRAMS:
            said = subprocess.run([BIN / program, "--help"], capture_output=True, text=True, check=True).stdout
            flags = set(re.findall(r"^  (?:-\w,)?(--[a-z][a-z0-9-]+)", said, re.M))
            self.assertIn("--quiet", flags)
            pages = {
                "man": (SHARE / f"man/man1/{program}.1").read_text().replace("\\-", "-"),
                "bash": (SHARE / f"bash-completion/completions/{program}").read_text(),
                "zsh": (SHARE / f"zsh/site-functions/_{program}").read_text(),
            }
            for flag in flags:
                for kind, page in pages.items():
                    self.assertRegex(page, re.escape(flag) + r"\b", f"{program}, {kind}")
            self.assertNotIn("--print-interface", pages["bash"])

    def test_bash_completes(self):
        self.assertEqual(completed("jade_export", "--spz-v"), ["--spz-version"])
        self.assertEqual(completed("jade_export", "--coordinates", "s"), ["scene"])
        self.assertEqual(completed("jade_export", "--coordinates", ""), ["dataset", "scene"])
        # File names, bash's default without completions.
        self.assertEqual(completed("jade_export", "--ply", "s"), [])
        self.assertIn("--config", completed("jade_train", "--"))
        commands = completed("jade_bench", "")
        self.assertIn("splat", commands)
        said = subprocess.run([BIN / "jade_bench", "splat", "--help"], capture_output=True, text=True, check=True).stdout
        for own in re.findall(r"^  (--[a-z0-9-]+)", said, re.M):
            self.assertIn(own, completed("jade_bench", "splat", "--"))

    def test_shells_and_roff_take_them(self):
        for program in PROGRAMS:
            subprocess.run(["bash", "-n", SHARE / f"bash-completion/completions/{program}"], check=True)
            if shutil.which("zsh"):
                subprocess.run(["zsh", "-n", SHARE / f"zsh/site-functions/_{program}"], check=True)
            if shutil.which("groff"):
                done = subprocess.run(["groff", "-Kutf8", "-man", "-Tutf8", "-ww", "-z", SHARE / f"man/man1/{program}.1"],
                                      capture_output=True, text=True, check=True)
                self.assertEqual(done.stderr, "", program)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
