# SPDX-License-Identifier: Apache-2.0
"""The check of comments must catch what it is there for, and nothing else."""
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import check_english


class CheckEnglish(unittest.TestCase):
    def found(self, text, name="lib/jade/core/a.h"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / name
            path.parent.mkdir(parents=True)
            path.write_text(text)
            return check_english.problems(Path(folder))

    def test_a_comment_without_a_subject_is_named_with_its_line(self):
        self.assertIn("lib/jade/core/a.h:2: ", self.found("int a;\n/// Of a whole file.\n")[0])
        self.assertEqual(len(self.found("# The same for text.\n", "scripts/a.py")), 1)
        self.assertEqual(len(self.found("/**\n * What a link remembers.\n */\n", "lib/jade/page/front/a.js")), 1)

    def test_subjects_continuations_and_other_files_pass(self):
        self.assertEqual(self.found("/// SHA-256 of a whole file.\n/// Where it fails: an error.\n"), [])
        self.assertEqual(self.found("/// Offset of a row.\n"), [])
        self.assertEqual(self.found("Of a document.\n", "docs/a.md"), [])


if __name__ == "__main__":
    unittest.main()
