# SPDX-License-Identifier: Apache-2.0
"""Tests that docs/troubleshooting.md quotes messages as the programs print them."""
import re
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def printed_text():
    """All string literals of the programs; adjacent ones are joined, with NUL in place of a value between them."""
    sources = [path.read_text() for folder in ("lib", "apps") for path in sorted((ROOT / folder).rglob("*.cpp"))]
    literals = []
    for source in sources:
        tokens = re.findall(r'"((?:[^"\\\n]|\\.)*)"|([^"]+)', source)
        for text, between in tokens:
            literals.append(text if text or not between else "" if between.isspace() else "\0")
        literals.append("\0")
    return "".join(literals)


def parts_of(message):
    """The words between the numbers N, M, W and H."""
    return [part for part in re.split(r"\b(?:WxH|[NM])\b", message) if part.strip()]


class Troubleshooting(unittest.TestCase):
    def test_every_quoted_message_is_printed_by_a_program(self):
        table = re.findall(r"^\| `([^`]+)`", (ROOT / "docs/troubleshooting.md").read_text(), re.MULTILINE)
        self.assertGreater(len(table), 10)
        printed = printed_text()
        for message in table:
            for part in parts_of(message):
                with self.subTest(message, part=part):
                    self.assertIn(part, printed)

    def test_a_message_that_no_program_prints_is_found(self):
        self.assertNotIn("no program prints this", printed_text())
        self.assertEqual(parts_of("N events need M GB"), [" events need ", " GB"])


if __name__ == "__main__":
    unittest.main()
