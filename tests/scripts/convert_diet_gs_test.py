# SPDX-License-Identifier: Apache-2.0
"""Tests of convert_diet_gs.py on valid and damaged pickles written here."""
import pickle
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import h5py
import numpy as np

SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "convert_diet_gs.py"
COORDS = np.array([[0, 0], [4.5, 2], [7, 1]])
ROWS = np.array([[1, 30, 1], [2, 10, 0], [0, 20, 1]])  # id, us, polarity


class ConvertDietGs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.scene = Path(folder.name)
        self.events = self.scene / "events"
        self.events.mkdir()
        for name, value in (("events", ROWS), ("id_to_coords", COORDS), ("image_start", [5]), ("image_end", [35])):
            self.put(name, value)

    def put(self, name, value):
        (self.events / f"{name}.pickle").write_bytes(pickle.dumps(value))

    def run_on(self, scene):
        return subprocess.run([sys.executable, SCRIPT, scene], capture_output=True, text=True)

    def refused(self, pattern, scene=None):
        done = self.run_on(scene or self.scene)
        self.assertEqual(done.returncode, 3, done.stderr)
        self.assertRegex(done.stderr, rf"^convert_diet_gs: .*{pattern}.*\n$")
        self.assertFalse(list(self.scene.rglob("*.part")) + list(self.scene.rglob("*.h5")))

    def test_events_have_their_places_in_order_of_time(self):
        done = self.run_on(self.scene)
        self.assertEqual(done.returncode, 0, done.stderr)
        with h5py.File(self.events / "events.h5") as file:
            found = [file[name][:].tolist() for name in "xytp"]
        self.assertEqual(found, [[7, 0, 4.5], [1, 0, 2], [10, 20, 30], [-1, 1, 1]])
        self.assertEqual(np.load(self.events / "timestamps.npz")["timestamps_end"].tolist(), [35])

    def test_ids_beyond_the_table_are_told(self):
        for wrong in (3, -1):
            rows = ROWS.copy()
            rows[1, 0] = wrong
            self.put("events", rows)
            self.refused(f"events.pickle: expected ids from 0 to 2, the last of id_to_coords.pickle, found {wrong};")

    def test_other_contents_are_told(self):
        for name, value, pattern in (("events", ROWS[:, :2], r"expected rows of id, time, polarity; found shape \(3, 2\)"),
                                     ("events", ROWS * np.nan, "events.pickle: expected finite numbers"),
                                     ("id_to_coords", {0: (1, 2)}, "expected an array of numbers, found dict"),
                                     ("image_start", [[1], [2, 3]], "expected an array of numbers, found list"),
                                     ("image_end", [1, 2], "1 starts and 2 ends"),
                                     ("id_to_color", np.zeros((2, 2)), r"id_to_color.pickle: expected \[H, W, 3\]")):
            with self.subTest(name):
                self.setUp()
                self.put(name, value)
                self.refused(pattern)

    def test_missing_and_damaged_files_are_told(self):
        self.refused("no such folder; give the folder of a DiET-GS scene", self.scene / "none")
        (self.events / "events.pickle").write_bytes(b"no pickle")
        self.refused("events.pickle: cannot be read: .*; copy it again")
        (self.events / "events.pickle").unlink()
        self.refused("events.pickle: missing; copy the scene's events folder again")


if __name__ == "__main__":
    unittest.main()
