# SPDX-License-Identifier: Apache-2.0
"""Tests that a script without its packages prints one line that says what to do."""
import subprocess
import sys
import unittest
from pathlib import Path

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
HINTS = {"figures": "scripts/setup.sh --figures", "export_lpips": "scripts/setup.sh --metrics",
         "evaluate_perceptual": "scripts/requirements-perceptual.txt", "convert_diet_gs": "pip install h5py",
         "convert_aedat4": "pip install h5py", "efnet/train_efnet": "scripts/setup.sh --python-torch",
         "efnet/export_efnet": "scripts/setup.sh --python-torch", "efnet/evaluate_efnet": "scripts/setup.sh --python-torch",
         "efnet/prepare_photographs": "scripts/setup.sh --python-torch"}


class MissingPackages(unittest.TestCase):
    def test_one_line_with_the_mend(self):
        for name, hint in HINTS.items():
            with self.subTest(name):
                # -S: no installed package is found. convert_aedat4 imports its packages only after it has opened a
                # recording.
                done = subprocess.run([sys.executable, "-S", SCRIPTS / f"{name}.py", __file__, "out"], capture_output=True, text=True)
                self.assertEqual(done.returncode, 2, done.stderr)
                self.assertRegex(done.stderr, rf"^{Path(name).name}: .*{hint}.*\n$")


if __name__ == "__main__":
    unittest.main()
