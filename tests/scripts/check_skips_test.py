# SPDX-License-Identifier: Apache-2.0
"""Tests of check_skips.py on output of the installed ctest."""
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "check_skips.py"
# CMake writes this for tests with SKIP_RETURN_CODE and DISABLED.
TESTS = """
add_test(passes "true")
add_test(fails "false")
add_test(splat.cuda "sh" "-c" "echo 'SKIPPED: needs a GPU'; exit 77")
add_test(sweep.slurm "sh" "-c" "echo 'SKIPPED: needs Slurm'; exit 77")
add_test(disabled "true")
set_tests_properties(splat.cuda sweep.slurm PROPERTIES SKIP_RETURN_CODE 77)
set_tests_properties(disabled PROPERTIES DISABLED ON)
"""


class CheckSkips(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        (Path(folder.name) / "CTestTestfile.cmake").write_text(TESTS)
        # A relative name is one in the build folder, as in .ci/run.
        subprocess.run(["ctest", "--test-dir", folder.name, "--output-junit", "tests.xml"], capture_output=True)
        cls.results = Path(folder.name) / "tests.xml"

    def check(self, *patterns, results=None):
        return subprocess.run([sys.executable, SCRIPT, results or self.results, *patterns], capture_output=True, text=True)

    def test_an_unexpected_skip_fails_and_is_named(self):
        done = self.check("*.cuda")
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.splitlines(), ["check_skips: sweep.slurm did not run: SKIPPED: needs Slurm",
                                                    "check_skips: disabled did not run: Disabled"])
        self.assertIn("splat.cuda did not run: SKIPPED: needs a GPU", self.check().stderr)

    def test_expected_skips_pass(self):
        done = self.check("*.cuda", "sweep.slurm", "disabled")
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_results_that_cannot_be_read_fail(self):
        for wrong in (self.results.parent / "nowhere.xml", SCRIPT):
            done = self.check("*", results=wrong)
            self.assertEqual((done.returncode, len(done.stderr.splitlines())), (3, 1), done.stderr)


if __name__ == "__main__":
    unittest.main()
