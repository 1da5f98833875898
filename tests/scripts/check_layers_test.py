# SPDX-License-Identifier: Apache-2.0
"""Tests that the layer check catches violations."""
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import check_layers


class CheckLayers(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.root = Path(self.folder.name)
        self.write("lib/layers.txt", "# order\ncore:\nsplat: core\ntrain: core splat\n")
        self.write("lib/jade/core/error.h", '#include <string>\n')
        self.write("lib/jade/splat/render.h", '#include "jade/core/error.h"\n')

    def tearDown(self):
        self.folder.cleanup()

    def write(self, name, text):
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def test_order_that_holds(self):
        self.assertEqual(check_layers.problems(self.root), [])

    def test_include_against_the_order(self):
        self.write("lib/jade/core/bad.cpp", '\n#include "jade/splat/render.h"\n')
        self.assertIn("lib/jade/core/bad.cpp:2: core may not include splat", check_layers.problems(self.root)[0])

    def test_cycle_in_the_list(self):
        self.write("lib/layers.txt", "core: splat\nsplat: core\n")
        self.assertIn("core uses splat", check_layers.problems(self.root)[0])

    def test_unknown_folder(self):
        self.write("lib/jade/helpers/a.h", "")
        self.assertIn("lib/jade/helpers", check_layers.problems(self.root)[0])


if __name__ == "__main__":
    unittest.main()
