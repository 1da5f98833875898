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

    def test_trailing_comments_and_docstrings_are_read_too(self):
        self.assertIn("a.h:2: ", self.found("int a;\nint b;  ///< What b is for.\n")[0])
        self.assertEqual(len(self.found('def a():\n    """As another one."""\n', "scripts/a.py")), 1)

    def test_a_vague_word_is_named_wherever_it_is_in_a_comment(self):
        for text in ("/// A frame that somebody asked for.", "int a;  // it tells the unit", "/// Ours are in px."):
            with self.subTest(text):
                self.assertEqual(len(self.found(f"{text}\n")), 1)
        self.assertEqual(len(self.found("a = 1  # whoever reads it\n", "scripts/a.py")), 1)

    def test_code_strings_and_quoted_words_pass(self):
        for text in ('log("ours");', "/// Calls tell() of the watcher.", '/// The word "anew" in a file.', "int tells = 0;"):
            with self.subTest(text):
                self.assertEqual(self.found(f"{text}\n"), [])

    def test_subjects_continuations_and_other_files_pass(self):
        self.assertEqual(self.found("/// SHA-256 of a whole file.\n/// Where it fails: an error.\n"), [])
        self.assertEqual(self.found("/// Offset of a row.\n"), [])
        self.assertEqual(self.found("Of a document.\n", "docs/a.md"), [])


if __name__ == "__main__":
    unittest.main()
