# SPDX-License-Identifier: Apache-2.0
"""scripts/check_test_names.py on small trees."""
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import check_test_names  # noqa: E402


class CheckTestNames(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.root = Path(folder.name)
        for path in ("lib/jade/io/npy.h", "lib/jade/io/cpu/fast.h", "tests/io/npy_test.cpp", "tests/io/fast_test.cpp",
                     "tests/io/npy_damage_test.cpp", "tests/apps/anything_test.cpp"):
            self.write(path)
        self.write("tests/not_mirrored.txt", "# comment\n")

    def write(self, path, content=""):
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)

    def test_headers_and_their_aspects_are_fine(self):
        self.assertEqual(check_test_names.problems(self.root), [])

    def test_a_name_without_header_must_be_listed(self):
        self.write("tests/io/numpy_test.cpp")
        self.assertIn("tests/io/numpy_test.cpp: expected a name", check_test_names.problems(self.root)[0])
        self.write("tests/not_mirrored.txt", "tests/io/numpy_test.cpp: whole files\n")
        self.assertEqual(check_test_names.problems(self.root), [])

    def test_the_list_is_kept_short(self):
        self.write("tests/not_mirrored.txt", "tests/io/npy_test.cpp: old\ntests/io/gone_test.cpp: old\n")
        found = check_test_names.problems(self.root)
        self.assertEqual(len(found), 2)
        self.assertTrue(all("take it out" in problem for problem in found))

    def test_a_reason_is_asked_for(self):
        self.write("tests/io/numpy_test.cpp")
        self.write("tests/not_mirrored.txt", "tests/io/numpy_test.cpp:\n")
        self.assertIn("expected a reason", check_test_names.problems(self.root)[0])


if __name__ == "__main__":
    unittest.main()
